"""Compiles a model's entry functions ahead of time to object files that need no Python and no Numba.

Numba compiles each entry; the inner function of the overload (not its Python or C wrapper) is kept, given a plain C
signature, merged, optimised by LLVM for the plain instruction set of a platform, and checked to be self-contained. What
Numba hands over is optimised for no processor, so that the bytes do not hang on the machine that compiles.

Object code is kept on disk beside Numba's compiled code: a model is compiled for a platform once. It is known by all
that it is made with: sources, versions, model, platform. Where nothing can be written or read, or a file is damaged,
the model is compiled anew.
"""

import hashlib
import re
import sys
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from string import Template

import llvmlite
import llvmlite.binding as llvm
import numba
from numba import carray, types

from rbfmu.on_disk import kept
from rbfmu_fmu.native.platforms import BuildError, Platform
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.compile import code_cache, decorator, numba_private

ENTRIES = ("initialize", "step", "outputs", "output_rates", "feedthrough")
"""The entry functions are `int64 NAME(double *buffer)`, but for SECOND; a model may do without some."""

SECOND = {"step": types.float64, "feedthrough": types.CPointer(types.float64)}
"""What an entry takes after the buffer."""

# sin, cos, atan2 and their kin are not among them: C libraries differ in their last digit. The kernels have their own
# (`numerics/`), which are the same instructions on every platform.
LIBM = frozenset({"sqrt", "fabs", "copysign", "floor", "ceil", "memcpy", "memset", "memmove"})
"""An object may leave only these symbols to the platform: correctly rounded everywhere, or no arithmetic."""

MOST = 100
"""The number of object files that are kept, some 100 kB each; the oldest go."""
COMPILER, ENTRY = Path(__file__), Path(__file__).with_name("entry.ll.txt").read_text(encoding="ascii")
"""The source of what compiles, besides the kernels; and that of an entry, in LLVM's language."""

_LOCK = threading.Lock()  # LLVM modules of one Numba process are not made for concurrent use


def object_files(model: Model, platform: Platform) -> dict[str, bytes]:
    """Return relocatable object files of the model's entries by name, the same bytes each time.

    model.o runs on every processor of the platform; for each of its features there is a step_FEATURE.o besides, with
    nothing but a `step_FEATURE` that gives the same bits.
    """
    with _LOCK:
        objects = {"model.o": _object_file(model, platform, "")}
        return objects | {f"step_{f}.o": _object_file(model, platform, f) for f in platform.features}


@cache
def _object_file(model: Model, platform: Platform, feature: str) -> bytes:
    known = isinstance(model, Model) and model.step.__module__.startswith("rbfmu_kernels.")
    if not known:  # its source is not among those that tell what is kept from what is stale
        return _compile(model, platform, feature)
    return keep_or_compile(f"{model.name} {platform} {feature}", lambda: _compile(model, platform, feature))


def _compile(model: Model, platform: Platform, feature: str) -> bytes:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(platform.triple).create_target_machine(
        cpu=platform.cpu, features=feature and f"+{feature}", opt=3, reloc="pic", codemodel="default"
    )
    module = llvm.parse_assembly(_source(model))
    module.triple, module.data_layout = platform.triple, str(machine.target_data)
    if feature:
        _keep_step(module, f"step_{feature}")
    module = llvm.parse_assembly(_without_counters(_optimise(module, machine)))
    _check_self_contained(module)
    return machine.emit_object(module)  # type: ignore[no-any-return]


def _keep_step(module: llvm.ModuleRef, name: str) -> None:
    """Rename the step; optimisation removes what it does not call."""
    module.get_function("step").name = name
    for function in module.functions:
        if function.name in ENTRIES:
            function.linkage = llvm.Linkage.internal


@cache
def _source(model: Model) -> str:
    """Return the LLVM source of all entries, which is for no platform yet."""
    first, *others = [_entry_module(model, name) for name in ENTRIES if hasattr(model, name)]
    for other in others:
        first.link_in(other)
    for value in [*first.functions, *first.global_variables]:
        if not value.is_declaration and value.name not in ENTRIES:
            value.linkage = llvm.Linkage.internal
    first.verify()
    return re.sub(r"^target (triple|datalayout).*$", "", str(first), flags=re.MULTILINE)


def _entry_module(model: Model, name: str) -> llvm.ModuleRef:
    """Return the model's entry as an LLVM module whose only external function has a plain C signature."""
    function, size = getattr(model, name), model.SIZE
    pointer = types.CPointer(types.float64)
    entry = {
        "step": lambda p, h: function(carray(p, (size,)), h),
        "feedthrough": lambda p, change: function(carray(p, (size,)), carray(change, (size,))),
    }.get(name, lambda p: function(carray(p, (size,))))
    signature = types.int64(pointer, SECOND[name]) if name in SECOND else types.int64(pointer)
    try:
        source, inner = numba_private.llvm_source(decorator.code_for_callers(entry, signature))
    except AttributeError as error:
        why = f"Numba {numba.__version__} does not give a function's LLVM source: {error}"
        why = "NUMBA_DISABLE_JIT is set: expected not, as FMUs have compiled code" if numba.config.DISABLE_JIT else why
        raise BuildError(why) from error
    module = llvm.parse_assembly(source)
    module.link_in(llvm.parse_assembly(_c_signature(name, inner, typed="double*" in source)))
    return module


def _c_signature(name: str, inner: str, typed: bool) -> str:
    """Return LLVM source of `int64 NAME(double *, ...)` around Numba's `int32 inner(ret *, exc **, double *, ...)`.

    typed: whether LLVM's pointers have types, as with Numba 0.61.
    """
    result, exception, buffer = ("i64*", "i8**", "double*") if typed else ("ptr",) * 3
    kind = {types.float64: "double", types.CPointer(types.float64): buffer}.get(SECOND.get(name))
    more, second = (f", {kind}", f", {kind} %second") if kind else ("", "")
    return Template(ENTRY).substitute(
        name=name, inner=inner, result=result, exception=exception, held=exception.removesuffix("*"), buffer=buffer,
        more=more, second=second,
    )  # fmt: skip


def _optimise(module: llvm.ModuleRef, target: llvm.TargetMachine) -> str:
    """Optimise twice: the second time finds more in loops that the first has unrolled.

    No pass may reorder sums: Numba marks no operation as fast, so LLVM keeps IEEE 754's order and the bits are those of
    the kernels that Numba compiles for this process.
    """
    for _ in range(2):
        builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options(speed_level=3))
        builder.getModulePassManager().run(module, builder)
    return str(module)


def _without_counters(source: str) -> str:
    """Rename what holds a counter of the process, so that builds are reproducible: names by Numba, tables by LLVM."""
    names: dict[str, str] = {}
    counted = r"(?:_ZN|NumbaEnv|switch\.table|\.const\.pickle)[\w.$%]+"  # pickles: Numba 0.61 names addresses
    return re.sub(counted, lambda found: names.setdefault(found[0], f"n{len(names)}"), source)


def _check_self_contained(module: llvm.ModuleRef) -> None:
    """Refuse what needs something that only a Python process has."""
    values = [*module.functions, *module.global_variables]
    foreign = {v.name for v in values if v.is_declaration and not v.name.startswith("llvm.")} - LIBM
    if "inttoptr" in str(module):  # how LLVM spells a call through an address that Numba wrote into the code
        foreign.add("an address of this process")
    if foreign:
        raise BuildError(f"the compiled model needs {', '.join(sorted(foreign))}")


def keep_or_compile(what: str, compile_anew: Callable[[], bytes]) -> bytes:
    """Return object code from disk, or compile and keep it; what: the model and the platform."""
    versions = [numba.__version__, llvmlite.__version__, sys.version, llvm.get_process_triple()]
    made_with = "\n".join([code_cache.SOURCES, *versions, COMPILER.read_text(encoding="utf-8"), ENTRY])
    folder = Path(numba.config.CACHE_DIR or Path(__file__).parent / "__pycache__") / "rbfmu_objects"
    return kept(folder / f"{hashlib.sha256((made_with + what).encode()).hexdigest()}.o", compile_anew, MOST)
