"""The one module that imports Numba's internals. All that is needed of them is listed here.

Each row was tried with Numba 0.61.0, 0.62.1, 0.63.1, 0.64.0, 0.65.1, 0.66.0, 0.67.0 and 0.68.1. Where a row is missing,
`MISSING` names it, and what Numba documents compiles instead (`decorator`, `gufunc`): the first call is slower, and the
bits are the same. Where all are there but behave otherwise, `reduced.internals_serve` finds it.
"""

import importlib
import operator
from typing import Any

_FEWER_PASSES = "Kernels are compiled by fewer passes, in half of the time."
_CALLEES = "What compiled code calls stays LLVM's intermediate code, without machine code of its own."
_CACHE = "Cached code is stamped with all sources, and is read without loading the compiler."
_SAID = "A long compilation is announced, and what code is kept is found before anything is compiled."
_LOOPS = "An array function's loop is compiled once and cached, and becomes a NumPy gufunc with fixed core sizes."

INTERNALS = {
    "numba.core.compiler:CompilerBase.define_pipelines": _FEWER_PASSES,
    "numba.core.compiler:CompilerBase.compile_extra": _FEWER_PASSES,
    "numba.core.compiler:Compiler": "It compiles kernels where the others behave otherwise than expected.",
    "numba.core.compiler:CompileResult.library": "Code for FMUs is made from LLVM's source of a function.",
    "numba.core.compiler:CompileResult.fndesc": "The name of a function in LLVM's source.",
    "numba.core.compiler:compile_result": _CALLEES,
    "numba.core.compiler_machinery:PassManager.add_pass": _FEWER_PASSES,
    "numba.core.compiler_machinery:PassManager.finalize": _FEWER_PASSES,
    "numba.core.compiler_machinery:PassManager._runPass": _FEWER_PASSES,
    "numba.core.untyped_passes:TranslateByteCode": _FEWER_PASSES,
    "numba.core.untyped_passes:FixupArgs": _FEWER_PASSES,
    "numba.core.untyped_passes:GenericRewrites": _FEWER_PASSES,
    "numba.core.untyped_passes:ReconstructSSA": _FEWER_PASSES,
    "numba.core.typed_passes:NopythonTypeInference": _FEWER_PASSES,
    "numba.core.typed_passes:PreLowerStripPhis": _FEWER_PASSES,
    "numba.core.typed_passes:AnnotateTypes": _FEWER_PASSES,
    "numba.core.typed_passes:NativeLowering": _FEWER_PASSES,
    "numba.core.typed_passes:NoPythonBackend": _FEWER_PASSES,
    "numba.core.compiler_machinery:register_pass": _FEWER_PASSES,
    "numba.core.lowering:Lower.lower_binop": "Sums and products are lowered by the signature that is known.",
    "numba.core.targetconfig:ConfigStack.enter": "Numba's own functions are compiled alike for all kernels.",
    "numba.core:ir.UNDEFINED": "Sums and products are lowered by the signature that is known.",
    "numba.core.typing:Context.resolve_function_type": "Sums and products of two numbers are resolved once, not each.",
    "numba.core.codegen:JITCodeLibrary.codegen": _CALLEES,
    "numba.core.codegen:JITCodeLibrary.get_pointer_to_function": _CALLEES,
    "numba.core.codegen:JITCodeLibrary.serialize_using_object_code": _CALLEES,
    "numba.core.codegen:JITCodeLibrary.serialize_using_bitcode": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._ensure_finalized": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._optimize_functions": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._optimize_final_module": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._finalize_final_module": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._finalize_dynamic_globals": _CALLEES,
    "numba.core.codegen:JITCodeLibrary._unserialize": _CALLEES,
    "numba.core.codegen:CPUCodegen._module_pass_manager": _CALLEES,
    "numba.core.dispatcher:Dispatcher.get_call_template": _CALLEES,
    "numba.core.dispatcher:Dispatcher.get_overload": _CALLEES,
    "numba.core.options:DefaultOptions._nrt": "Buffers are not counted: that costs half of a small model's step.",
    "numba.core.caching:CompileResultCacheImpl.rebuild": _CALLEES,
    "numba.core.caching:FunctionCache._load_overload": _CACHE,
    "numba.core.caching:FunctionCache._impl_class": _CACHE,
    "numba.core.caching:IndexDataCacheFile": _CACHE,
    "numba.core.caching:NullCache": _CACHE,
    "numba.core.compiler_lock:global_compiler_lock": "One process at a time compiles a function that others need too.",
    "numba.core.event:Listener": _SAID,
    "numba.core.event:register": _SAID,
    "numba.core.event:trigger_event": _SAID,
    "numba.core.dispatcher:Dispatcher.add_overload": _SAID,
    "numba.core.runtime:rtsys.initialize": _CACHE,
    "numba.core.ccallback:CFunc.compile": _LOOPS,
    "numba.core.ccallback:CFunc.address": _LOOPS,
    "numba.np.ufunc._internal:fromfunc": _LOOPS,
}
"""What is needed of Numba's internals (a name in a module, or a member of it), and what for."""

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
"""Options of what is not called from Python."""

MISSING = _look_up()
"""The first row that this version of Numba lacks; empty where it has all of them."""


def __getattr__(name: str) -> Any:
    """Return an internal of Numba by the name that the table has for it."""
    try:
        return _found[name]
    except KeyError:
        raise AttributeError(f"{name} is not among the internals of Numba that are listed and found") from None


def llvm_source(compiled: Any) -> tuple[str, str]:
    """Return LLVM's source of a function that Numba has compiled for one signature, and the function's name in it.

    The function there is `int32 name(result *, exception **, arguments ...)`. AttributeError: this version of Numba has
    no such thing.
    """
    (overload,) = compiled.overloads.values()
    return overload.library.get_llvm_str(), overload.fndesc.llvm_func_name
