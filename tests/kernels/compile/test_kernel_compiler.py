"""How kernels are compiled: for Python only what Python calls, and once for all processes."""

import gc
import os
import re
import runpy
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock, call

import pytest
from llvmlite import binding
from numba import config, float64, njit, types
from numba.core import event
from numba.core.caching import NullCache
from numba.core.registry import cpu_target
from numba.cpython import builtins

from rbfmu_kernels import free_rotation, free_rotation_at, free_rotation_setup, rotate
from rbfmu_kernels.compile import code_cache, compiler, gufunc
from rbfmu_kernels.compile.code_cache import made_once
from rbfmu_kernels.compile.compiler import _IntermediateCode
from rbfmu_kernels.compile.decorator import kernel, loop
from rbfmu_kernels.compile.gufunc import Item

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiler")


OPAQUE = binding.llvm_version_info >= (16,)
"""Whether LLVM knows pointers of no type alone."""


@kernel
def callee(x: float) -> float:
    return x + 1.0


@kernel(inline=False)
def caller(x: float) -> float:
    return 2.0 * callee(x)


def test_what_kernels_call_has_no_entry_for_python_until_python_calls_it():
    assert njit(lambda x: caller(x) + callee(x))(1.0) == 6.0
    assert not caller.overloads
    assert caller(2.0) == 6.0
    assert not callee.overloads
    assert callee(2.0) == 3.0


NONE = 0


@kernel(inline=False)
def without_numbas_types(x: float) -> float:
    return x.no_such_name  # type: ignore[attr-defined, no-any-return]


@kernel
def of_what_there_is(x: float) -> float:
    return without_numbas_types(x) if NONE else x


def test_what_a_model_has_nothing_of_is_not_compiled():
    """A scene without events, say: that is a fifth of what compiling its formulas takes."""
    assert of_what_there_is(2.0) == 2.0


@pytest.mark.thorough
def test_a_kernel_called_by_compiled_code_first_has_the_same_bits_from_python():
    state = (1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5), (0.1, 0.2, 0.3)

    @njit
    def both(moments, q_0, omega, t):
        return free_rotation_at(free_rotation_setup(moments, q_0, omega), t)

    assert both(*state, 7.0) == free_rotation(*state, 7.0) == free_rotation_at(free_rotation_setup(*state), 7.0)


def test_a_callee_is_asked_for_once_a_signature_and_its_passes_are_not_announced():
    passes = event.RecordingListener()
    with event.install_listener("numba:run_pass", passes):

        @kernel
        def inner(x: float) -> float:
            return x + 1.0

        @kernel
        def outer(x: float) -> float:
            return inner(x) * inner(2.0) + inner(3.0)

        before = inner.get_call_template
        asked = []
        inner.get_call_template = lambda args, kws: asked.append(before(args, kws)) or asked[-1]
        assert outer(1.0) == 10.0
    assert len({id(template) for template, *_ in asked}) == 1 < len(asked)
    assert not passes.buffer


def test_a_sum_of_two_numbers_is_looked_up_once_for_types_and_code(monkeypatch):
    asked = []
    look_up = types.Function.get_call_type
    counted = lambda self, *rest: asked.append(self) or look_up(self, *rest)  # noqa: E731 - a method
    monkeypatch.setattr(types.Function, "get_call_type", counted)

    @kernel
    def many(x: float, y: float) -> float:
        return x * y + x * x * y + y * y * x + x * y * y

    assert many(1.0, 2.0) == 12.0
    assert len(asked) <= 2


def test_a_callee_keeps_its_variables_in_registers_before_it_is_merged():
    """Its caller's passes see less of it then; with Numba 0.61 its own passes do this, and more."""
    libraries = []

    class Watched(_IntermediateCode):
        def _optimize_functions(self, module):
            before = str(module)
            super()._optimize_functions(module)
            libraries.append((before.count("alloca"), str(module).count("alloca")))

    source = "define double @f(double %x) {\n %a = alloca double\n store double %x, double* %a\n"
    source += " %y = load double, double* %a\n ret double %y\n}\n"
    library = Watched(cpu_target.target_context.codegen(), "watched")
    library.add_llvm_module(binding.parse_assembly(source.replace("double*", "ptr") if OPAQUE else source))
    assert libraries == [(1, 0)]


def test_what_a_compilation_leaves_counts_as_old_and_nothing_is_frozen():
    gc.disable()
    try:
        young = [[] for _ in range(10_000)]
        assert gc.get_count()[0] > len(young) / 2
        compiler._count_as_old()
        assert gc.get_count()[0] < 1000
        assert gc.get_freeze_count() == 0
    finally:
        gc.enable()


def test_what_the_user_froze_stays_frozen():
    gc.freeze()
    try:
        compiler._count_as_old()
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()


@pytest.mark.thorough
def test_callees_are_found_in_the_cache(tmp_path, monkeypatch):
    """Another function that calls the same kernels compiles itself alone, and what is merged into it."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    code = (
        "from numba import njit; from numba.core import event; import rbfmu_kernels as k\n"
        "compiled = event.RecordingListener(); event.register('numba:compile', compiled)\n"
        "print(njit(lambda a, b, v: k.{}(k.principal_axes((a, b, v))[0], v))(*3 * ((1.0, 1.0, 1.0),)))\n"
        "print(sorted({{e.data['dispatcher'].__name__ for _, e in compiled.buffer}}))"
    )
    first, second = (
        subprocess.run([sys.executable, "-c", code.format(f)], capture_output=True, text=True, check=True).stdout
        for f in ("dot", "add")
    )
    assert "'principal_axes'" in first
    assert "'principal_axes'" not in second
    assert "'<lambda>'" in second


def test_a_change_of_any_module_makes_cached_code_stale(tmp_path):
    package = Path(code_cache.__file__).parents[1]
    copy = shutil.copytree(package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    assert code_cache.hash_of_sources(copy) == code_cache.SOURCES
    for path in copy.rglob("*.py"):
        content = path.read_bytes()
        path.write_bytes(content + b"#")
        assert code_cache.hash_of_sources(copy) != code_cache.SOURCES, path
        path.write_bytes(content)


def test_a_loop_of_another_package_is_compiled_anew_after_a_change_of_any_kernel(tmp_path, monkeypatch):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    compiled = []
    for sources in ("before", "before", "after"):
        monkeypatch.setattr(code_cache, "SOURCES", sources)
        compiled += loop(next_number, float64(float64)).stats.cache_misses.values()
    assert compiled == [1, 1]


def next_number(x):
    return x + 1.0


DAMAGE = [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: bytes(len(data))]


def with_a_wrong_bit(data: bytes) -> bytes:
    return data.replace(b"next_number", b"oext_number")


@pytest.mark.parametrize(
    ("ending", "damage"), [(".nbi", one) for one in DAMAGE] + [(".nbc", one) for one in (*DAMAGE, with_a_wrong_bit)]
)
def test_damaged_code_is_compiled_anew_and_replaced(ending, damage, tmp_path, monkeypatch):
    """2026-11-30: an index that a crash of the machine had left empty ended every command until it was deleted."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    compiled = []
    for damaged in (False, True, False):
        for file in tmp_path.rglob(f"*{ending}") if damaged else ():
            file.write_bytes(damage(file.read_bytes()))
        once = loop(next_number, float64(float64))
        assert once(1.0) == 2.0
        compiled.append(sum(once.stats.cache_misses.values()))
    assert compiled == [1, 1, 0]


def test_code_that_cannot_be_stored_serves_this_process(tmp_path, monkeypatch):
    """2026-11-30: files of another user, in a folder that users share, ended every command."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    loop(next_number, float64(float64))
    for file in [*tmp_path.rglob("*.nb?")]:
        file.unlink()
        file.mkdir()
    assert loop(next_number, float64(float64))(1.0) == 2.0


def test_a_kernel_of_ones_own_that_was_edited_is_compiled_anew(tmp_path):
    file, found = tmp_path / "mine.py", []
    for factor in (2.0, 3.0):
        file.write_text(
            "from rbfmu_kernels.compile.decorator import kernel\n"
            f"@kernel\ndef product(x: float) -> float:\n    return {factor} * x\n"
        )
        found.append(runpy.run_path(str(file))["product"](1.0))
    assert found == [2.0, 3.0]


def test_so_is_one_that_calls_what_was_edited_in_another_file(tmp_path):
    other, file, found = tmp_path / "other.py", tmp_path / "mine.py", []
    file.write_text(
        "import runpy\nfrom rbfmu_kernels.compile.decorator import kernel\n"
        f"factor = runpy.run_path({str(other)!r})['factor']\n"
        "@kernel\ndef product(x: float) -> float:\n    return factor(x) * x\n"
    )
    for factor in (2.0, 3.0):
        other.write_text(f"from numba import njit\n@njit\ndef factor(x):\n    return {factor}\n")
        found.append(runpy.run_path(str(file))["product"](1.0))
    assert found == [2.0, 3.0]


@pytest.mark.thorough
def test_loops_over_tiles_are_vectorised_over_items(monkeypatch):
    """LLVM does so only where it sees which memory is which; nothing but the time would tell."""
    loops = []
    monkeypatch.setattr(gufunc, "DiskCache", lambda loop: NullCache())  # stored code has no source left
    compiled = gufunc._compiled
    monkeypatch.setattr(gufunc, "_compiled", lambda loop: loops.append(compiled(loop)) or loops[-1])
    gufunc.tiled_gufuncs(Item(rotate), 0)
    assert re.search(r"fmul <\d+ x double>", loops[0].inspect_llvm())


def test_functions_of_numba_are_merged_into_the_kernel_that_calls_them():
    """2026-11-29: each process had names of its own for max, of which a caller of kept kernels had two or three.

    An FMU's bytes hung on which process had compiled what.
    """

    def clipped(x: float, y: float) -> float:
        return max(min(x, y), float(int(x)))

    (made,) = compiler.code_for_callers(clipped, float64(float64, float64)).overloads.values()
    names = [one.name for one in made.library._final_module.functions if not one.is_declaration]
    assert names == [made.fndesc.llvm_func_name]


def test_passes_that_know_no_builder_also_drop_addresses_that_nobody_uses():
    """So with Numba 0.61, where no code that keeps such an address would be cached."""
    made = Mock()
    library = SimpleNamespace(_codegen=Mock(_module_pass_manager=lambda **options: made), _final_module="module")
    _IntermediateCode._optimize_final_module(library)
    assert made.method_calls == [
        call.add_aggressive_dead_code_elimination_pass(),
        call.add_global_dce_pass(),
        call.run("module"),
    ]


SHARED = """
import sys
from numba import float64
from rbfmu_kernels.compile.decorator import kernel
@kernel
def inlined(x: float) -> float:
    return min(x, 1.0)
@kernel(inline=False)
def called(x: float) -> float:
    return min(x, 2.0)
kernels = {"inlined": inlined, "called": called}
for name in sys.argv[1:]:
    kernels[name](0.5)
source = called.inspect_llvm(called.signatures[0])
print(*sorted(word for word in source.replace("(", " ").split() if "ol_min" in word))
"""


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(builtins, "ol_min"), reason="this Numba has no function for min, but makes it in place")
def test_what_numba_defines_is_the_same_code_whichever_kernel_calls_it_first(tmp_path):
    """Its first caller's options would be its own, so that FMUs had bytes that hang on what was compiled before."""
    found = []
    for order in (["called", "inlined"], ["inlined", "called"]):
        script = tmp_path / order[0] / "shared.py"
        script.parent.mkdir()
        script.write_text(SHARED)
        elsewhere = {**os.environ, "NUMBA_CACHE_DIR": str(script.parent)}
        found.append(subprocess.check_output([sys.executable, script, *order], text=True, env=elsewhere))
    assert "ol_min" in found[0]
    assert re.sub(r"B\d+v\d+", "", found[0]) == re.sub(r"B\d+v\d+", "", found[1])


# The cache on disk


def test_one_process_at_a_time_compiles_what_others_need_too(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    kept = SimpleNamespace(_cache_file=SimpleNamespace(_index_path=str(tmp_path / "kernel.nbi")))
    beside, entered = tmp_path / "kernel.nbi.lock", threading.Event()

    def compile_here() -> None:
        with made_once(kept):
            entered.set()

    with beside.open("w") as held_by_another:
        fcntl.flock(held_by_another, fcntl.LOCK_EX)
        thread = threading.Thread(target=compile_here, daemon=True)
        thread.start()
        assert not entered.wait(0.05)
    thread.join(60.0)
    assert entered.is_set()
    assert not beside.exists()


def test_where_nothing_is_kept_each_compiles() -> None:
    with made_once(None):
        pass
