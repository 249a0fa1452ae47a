"""A unit's entry functions, compiled ahead of time to one object file that needs no Python and no Numba.

Numba compiles each entry; the inner function of the overload (not its Python or C wrapper) is kept, given a plain C
signature, merged, optimised by LLVM for the plain instruction set of the platform, and checked to be self-contained.
"""

import re
import threading
from typing import Any

import llvmlite.binding as llvm
from numba import carray, njit, types

from rbfmu.unit import Unit

ENTRIES = {"initialize": "", "step": "double", "outputs": ""}
"""Entry functions `int64 NAME(double *buffer[, double h])`."""

LIBM = frozenset({"sqrt", "fabs", "copysign", "floor", "ceil", "memcpy", "memset", "memmove"})
"""The only symbols that an object may leave to the platform: correctly rounded everywhere, or no arithmetic."""

BASE_CPU = {"x86_64": "x86-64", "aarch64": "generic"}
_DONE: dict[str, bytes] = {}
_LOCK = threading.Lock()  # LLVM modules of one Numba process are not made for concurrent use


class NotSelfContainedError(RuntimeError):
    """The compiled kernels need something that only a Python process has."""


def object_code(unit: Unit) -> bytes:
    """Relocatable object file of the unit's entries for this platform; the same bytes each time."""
    name = unit.__name__
    with _LOCK:
        if name not in _DONE:
            _DONE[name] = _compile(unit)
        return _DONE[name]


def _compile(unit: Unit) -> bytes:
    llvm.initialize_native_asmprinter()
    module = _merged([_entry_module(unit, name) for name in ENTRIES])
    target = _target_machine()
    module.triple, module.data_layout = target.triple, str(target.target_data)
    module = llvm.parse_assembly(_without_counters(_optimised(module, target)))
    _check_self_contained(module)
    return target.emit_object(module)  # type: ignore[no-any-return]


def platform_name() -> str:
    """The platform that `object_code` compiles for, e.g. x86_64-linux."""
    parts = llvm.get_process_triple().split("-")
    return f"{parts[0]}-{parts[2]}"


def _target_machine() -> Any:
    triple = llvm.get_process_triple()
    cpu = BASE_CPU.get(triple.split("-")[0], "")
    return llvm.Target.from_triple(triple).create_target_machine(cpu=cpu, opt=3, reloc="pic", codemodel="default")


def _entry_module(unit: Unit, name: str) -> Any:
    """The unit's entry as an LLVM module whose only external function has a plain C signature."""
    function, size = getattr(unit, name), unit.SIZE
    pointer = types.CPointer(types.float64)
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True}
    if name == "step":

        @njit(types.int64(pointer, types.float64), **options)  # type: ignore[untyped-decorator]
        def entry(p: Any, h: float) -> Any:
            return function(carray(p, (size,)), h)
    else:

        @njit(types.int64(pointer), **options)  # type: ignore[untyped-decorator]
        def entry(p: Any) -> Any:
            return function(carray(p, (size,)))

    (compiled,) = entry.overloads.values()
    inner = compiled.fndesc.llvm_func_name
    module = llvm.parse_assembly(compiled.library.get_llvm_str())
    for value in [*module.functions, *module.global_variables]:
        if not value.is_declaration and value.name != inner:
            value.linkage = llvm.Linkage.internal
    module.link_in(llvm.parse_assembly(_c_signature(name, inner)))
    module.get_function(inner).linkage = llvm.Linkage.internal
    return module


def _c_signature(name: str, inner: str) -> str:
    """LLVM source of `int64 NAME(double *, ...)` around Numba's `int32 inner(ret *, exc **, double *, ...)`."""
    declared, given = ("ptr, double", "ptr %z, double %h") if name == "step" else ("ptr", "ptr %z")
    return f"""
        declare i32 @"{inner}"(ptr, ptr, {declared})
        define i64 @{name}({given}) {{
            %result = alloca i64
            %exception = alloca ptr
            %failed = call i32 @"{inner}"(ptr %result, ptr %exception, {given})
            %value = load i64, ptr %result
            %bad = icmp ne i32 %failed, 0
            %status = select i1 %bad, i64 -1, i64 %value
            ret i64 %status
        }}"""


def _merged(modules: list[Any]) -> Any:
    for other in modules[1:]:
        modules[0].link_in(other)
    modules[0].verify()
    return modules[0]


def _optimised(module: Any, target: Any) -> str:
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return str(module)


def _without_counters(source: str) -> str:
    """Numba's mangled names hold a counter of the process: number them anew, so that builds are reproducible."""
    names: dict[str, str] = {}
    return re.sub(r"_ZN[\w.$%]+|NumbaEnv[\w.$%]+", lambda found: names.setdefault(found[0], f"n{len(names)}"), source)


def _check_self_contained(module: Any) -> None:
    values = [*module.functions, *module.global_variables]
    foreign = {v.name for v in values if v.is_declaration and not v.name.startswith("llvm.")} - LIBM
    if "inttoptr" in str(module):
        foreign.add("an address of this process")
    if foreign:
        raise NotSelfContainedError(f"the compiled unit needs {', '.join(sorted(foreign))}")
