"""The one module that imports Numba's internals. All internals that we need are listed here.

Each row was tried with Numba 0.61.0, 0.62.1, 0.63.1, 0.64.0, 0.65.1, 0.66.0, 0.67.0 and 0.68.1. If a row is missing,
`MISSING` names it, and Numba's documented functions compile instead (`decorator`, `gufunc`): the first call is slower,
the bits are the same. If all rows exist but behave differently, `compiler.internals_serve` detects it.
"""

import importlib
import operator
from typing import Any

_MODULES = [
    # Kernels are compiled by fewer passes, in half of the time.
    ("numba.core.compiler", "CompilerBase.define_pipelines CompilerBase.compile_extra"),
    ("numba.core.compiler_machinery", "PassManager.add_pass PassManager.finalize PassManager._runPass register_pass"),
    ("numba.core.untyped_passes", "TranslateByteCode FixupArgs DeadBranchPrune GenericRewrites ReconstructSSA"),
    ("numba.core.typed_passes",
     "NopythonTypeInference PreLowerStripPhis AnnotateTypes NativeLowering NoPythonBackend"),
    # Functions that only compiled code calls stay LLVM's intermediate code, without machine code of their own.
    ("numba.core.compiler", "compile_result"),
    ("numba.core.codegen",
     "JITCodeLibrary.codegen JITCodeLibrary.get_pointer_to_function JITCodeLibrary._ensure_finalized "
     "JITCodeLibrary.serialize_using_object_code JITCodeLibrary.serialize_using_bitcode "
     "JITCodeLibrary._optimize_functions JITCodeLibrary._optimize_final_module JITCodeLibrary._unserialize "
     "JITCodeLibrary._finalize_final_module JITCodeLibrary._finalize_dynamic_globals "
     "CPUCodegen._module_pass_manager"),
    ("numba.core.dispatcher", "Dispatcher.get_call_template Dispatcher.get_overload"),
    ("numba.core.caching", "CompileResultCacheImpl.rebuild"),
    # Cached code is stamped with all sources, has a checksum, and is read without loading the compiler.
    ("numba.core.caching",
     "FunctionCache._load_overload FunctionCache._impl_class FunctionCache.save_overload NullCache "
     "IndexDataCacheFile._dump IndexDataCacheFile._load_index IndexDataCacheFile._load_data "
     "IndexDataCacheFile._data_path"),
    ("numba.core.runtime", "rtsys.initialize"),
    # A long compilation is announced, and cached code is found before anything is compiled.
    ("numba.core.event", "Listener register trigger_event"),
    ("numba.core.dispatcher", "Dispatcher.add_overload"),
    # An array function's loop is compiled once and cached, and becomes a NumPy gufunc with fixed core sizes.
    ("numba.core.ccallback", "CFunc.compile CFunc.address"),
    ("numba.np.ufunc._internal", "fromfunc"),
    ("numba.core", "cgutils.for_range_slice"),
    # Sums and products are lowered by the signature that type inference has found.
    ("numba.core.lowering", "Lower.lower_binop"),
    ("numba.core", "ir.UNDEFINED"),
    # Sums and products of two numbers are resolved once for each pair of types.
    ("numba.core.typing", "Context.resolve_function_type"),
    # Numba's own compiler compiles kernels where the other internals behave differently than expected.
    ("numba.core.compiler", "Compiler"),
    # Code for FMUs is made from LLVM's source of a function, found by its name in it.
    ("numba.core.compiler", "CompileResult.library CompileResult.fndesc"),
    # Numba's own functions are compiled with the same flags for all kernels.
    ("numba.core.targetconfig", "ConfigStack.enter"),
    # References to buffers are not counted: that would take half of a small model's step.
    ("numba.core.options", "DefaultOptions._nrt"),
    # One process at a time compiles a function that others need too.
    ("numba.core.compiler_lock", "global_compiler_lock"),
    # Imported by the first compilation, it would register types while other threads of an ensemble look types up.
    ("numba.experimental.function_type", "typeof_function_type"),
]  # fmt: skip
INTERNALS = [f"{module}:{name}" for module, names in _MODULES for name in names.split()]
"""The internals of Numba that we need: a name in a module, or a member of it."""

_found: dict[str, Any] = {}


def _look_up() -> str:
    for row in INTERNALS:
        module, _, path = row.partition(":")
        name = path.partition(".")[0]
        try:
            found = importlib.import_module(module)
            operator.attrgetter(path)(found)
            _found[name] = getattr(found, name)
        except (ImportError, AttributeError):
            return row
    return ""


CALLED_BY_CODE = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options for functions that Python does not call."""

MISSING = _look_up()
"""The first row that this version of Numba lacks; empty where it has all of them."""


def __getattr__(name: str) -> Any:
    """Return an internal of Numba by its name in the table."""
    try:
        return _found[name]
    except KeyError:
        raise AttributeError(f"{name} is not among the internals of Numba that are listed and found") from None


def llvm_source(compiled: Any) -> tuple[str, str]:
    """Return LLVM's source of a function that Numba has compiled for one signature, and the function's name in it.

    The function there is `int32 name(result *, exception **, arguments ...)`. AttributeError: this version of Numba
    does not provide the source.
    """
    (overload,) = compiled.overloads.values()
    return overload.library.get_llvm_str(), overload.fndesc.llvm_func_name
