"""Ahead-of-time compilation of a model's entry functions to object files that need no Python and no Numba.

Numba compiles each entry. Of the result, only the inner function is kept, not its Python or C wrapper. It gets a plain
C signature; LLVM merges all entries, optimises them for the plain instruction set of a platform, and they are checked
to be self-contained. Numba's output is not optimised for a processor, so that bytes do not depend on the machine.

Object code is kept on disk beside Numba's compiled code, so that a model is compiled once for a platform. It is
identified by all it is made from: sources, versions, model, platform. If a file cannot be written or read, or is
damaged, the model is compiled again.
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

from rbfmu.on_disk import folder, kept
from rbfmu_fmu.native.platforms import BuildError, Platform
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.compile import code_cache, decorator, numba_private

ENTRIES = ("initialize", "step", "outputs", "output_rates", "feedthrough")
"""The entry functions, `int64 NAME(double *buffer)` except those in SECOND; a model need not have all of them."""

SECOND = {"step": types.float64, "feedthrough": types.CPointer(types.float64)}
"""The second argument of entries that have one."""

# sin, cos, atan2 and the like are missing here: C libraries differ in their last digit. The kernels have their own
# (`numerics/`), which are the same instructions on every platform.
LIBM = frozenset({"sqrt", "fabs", "copysign", "floor", "ceil", "memcpy", "memset", "memmove"})
"""The only symbols that an object may need from the platform: they are correctly rounded, or have no arithmetic."""

MOST = 100
"""The largest number of object files that are kept, about 100 kB each; the oldest are deleted."""
COMPILER, ENTRY = Path(__file__), Path(__file__).with_name("entry.ll.txt").read_text(encoding="ascii")
"""The file with the source of this compiler; and the template of an entry, in LLVM's language."""

_LOCK = threading.Lock()  # the LLVM modules of a Numba process must not be used concurrently


def object_files(model: Model, platform: Platform) -> dict[str, bytes]:
    """Return relocatable object files of the model's entries by name, with the same bytes each time.

    model.o runs on every processor of the platform. For each of the platform's features there is also a step_FEATURE.o,
    which has only a function `step_FEATURE` with the same results, bit by bit. Raises BuildError.
    """
    with _LOCK:
        objects = {"model.o": _object_file(model, platform, "")}
        return objects | {f"step_{f}.o": _object_file(model, platform, f) for f in platform.features}


@cache
def _object_file(model: Model, platform: Platform, feature: str) -> bytes:
    known = isinstance(model, Model) and model.step.__module__.startswith("rbfmu_kernels.")
    if not known:  # changes of its source would not be noticed, so its code is not kept
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
    """Rename the step, and make all entries internal; optimisation then removes what the step does not call."""
    module.get_function("step").name = name
    for function in module.functions:
        if function.name in ENTRIES:
            function.linkage = llvm.Linkage.internal


@cache
def _source(model: Model) -> str:
    """Return the LLVM source of all entries, which is not yet for a certain platform."""
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
    """Return LLVM source of `int64 NAME(double *, ...)` that calls Numba's `int32 inner(ret *, exc **, double *, ...)`.

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
    """Return the module optimised twice, as the second time finds more in loops that the first has unrolled.

    No pass may reorder sums: Numba marks no operation as fast, so LLVM keeps to IEEE 754 and the order of operations.
    Results then have the same bits as those of the kernels that Numba compiles for this process.
    """
    for _ in range(2):
        builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options(speed_level=3))
        builder.getModulePassManager().run(module, builder)
    return str(module)


def _without_counters(source: str) -> str:
    """Replace names that contain a counter of the process, by Numba or LLVM, so that builds are reproducible."""
    names: dict[str, str] = {}
    counted = r"(?:_ZN|NumbaEnv|switch\.table|\.const\.pickle)[\w.$%]+"  # pickles: Numba 0.61 names addresses
    return re.sub(counted, lambda found: names.setdefault(found[0], f"n{len(names)}"), source)


def _check_self_contained(module: llvm.ModuleRef) -> None:
    """Raise BuildError if the module needs anything that only a Python process has."""
    values = [*module.functions, *module.global_variables]
    foreign = {v.name for v in values if v.is_declaration and not v.name.startswith("llvm.")} - LIBM
    if "inttoptr" in str(module):  # how LLVM spells a call through an address that Numba wrote into the code
        foreign.add("an address of this process")
    if foreign:
        raise BuildError(f"the compiled model needs {', '.join(sorted(foreign))}")


def keep_or_compile(what: str, compile_anew: Callable[[], bytes]) -> bytes:
    """Return object code from disk, or compile and keep it; what: the names of model and platform."""
    versions = [numba.__version__, llvmlite.__version__, sys.version, llvm.get_process_triple()]
    made_with = "\n".join([code_cache.SOURCES, *versions, COMPILER.read_text(encoding="utf-8"), ENTRY])
    place = folder("rbfmu_objects", numba.config.CACHE_DIR)
    return kept(place / f"{hashlib.sha256((made_with + what).encode()).hexdigest()}.o", compile_anew, MOST)
