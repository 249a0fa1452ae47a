"""The traps of pythonfmu, each closed; what could crash runs in a process of its own."""

import ctypes
import inspect
import re
import shutil
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace

import fmpy
import pytest

import rbfmu_fmu
from rbfmu_fmu import builder
from rbfmu_fmu.builder import build
from rbfmu_fmu.native import platforms
from rbfmu_fmu.native.object_code import object_files
from rbfmu_fmu.python import pythonfmu_traps
from rbfmu_fmu.python.call_rules import INITIALIZING, INSTANTIATED, STEPPING, TERMINATED
from rbfmu_fmu.python.slave import Slave
from rbfmu_fmu.python.slave_access import Access
from tests.support.compilers import needs_linker
from tests.support.covering import some_of
from tests.support.fmu.c_host import rows_for_c_host, run_c_host
from tests.support.fmu.fmu_cases import WRONGS
from tests.support.fmu.fmu_importer import DISCARD, FATAL
from tests.support.fmu.fmus import built, copied, planned, run_case, scene, unzipped, unzipped_at
from tests.support.paths import ROOT


@cache
def refused():
    return run_case("refusals", unzipped("driven"))


@pytest.mark.parametrize("case", WRONGS)
def test_refusal_is_answered_logged_and_printed_and_leaves_no_trace(case):
    """The case itself asserts that this instance, the same after a reset, and another one all go on to the bit."""
    found, errors = refused()
    answer, printed = found[case], errors.splitlines()
    discarded = case.startswith(("step_", "time_")) and not case.endswith("initialisation")
    assert answer["status"] == (DISCARD if discarded else FATAL)
    assert answer["untouched"]
    category = "logStatusDiscard" if discarded else "logStatusFatal"
    messages = [text for status, named, text in answer["log"] if status == answer["status"] and named == category]
    assert all(named for _, named, _ in answer["log"])
    printed_by_it = [line for line in printed if line.startswith(f"[{case}]")]
    assert len(printed_by_it) == 1
    assert len(messages) == 1
    assert WRONGS[case][-1] in messages[0]
    assert WRONGS[case][-1] in printed_by_it[0]


def test_no_message_comes_without_a_category():
    """NULL for a category ends OMSimulator; what else the importer asks for it gets."""
    asked, refused, cancelled, chosen, off = run_case("logged_categories", unzipped("driven"))[0]
    assert asked == refused == ["logStatusFatal"]
    assert cancelled == []
    assert chosen == ["logStatusDiscard"]
    assert off == []


def test_paths_that_a_uri_spells_otherwise_are_told():
    for code in range(33, 0x250):
        spelled_otherwise = Path(f"/x{chr(code)}x").as_uri() != f"file:///x{chr(code)}x"
        assert bool(pythonfmu_traps.CRASHES_IN_PATH.search(chr(code))) == spelled_otherwise, chr(code)
    assert not pythonfmu_traps.CRASHES_IN_PATH.search("/tmp/a b")


def test_hundreds_of_errors_break_nothing():
    assert run_case("errors_again_and_again", unzipped("driven"))[0] is True


def test_bytes_are_refused_by_the_instance_that_is_asked_alone():
    """2026-11-30: all others were told too, which ended the process where one was freed before another call."""
    (told, *others), left = run_case("refused_beside_others", unzipped("driven"))[0]
    text = "fmi2DeSerializeFMUstate: these 8 bytes are no state of this FMU"
    assert told == [["logStatusFatal", text]] * 8
    assert others == [[]] * 8
    assert left == 0


def test_errors_are_survived_where_nobody_reads_stderr():
    assert run_case("closed_stderr", unzipped("driven"))[0] == [DISCARD, FATAL]


def test_state_of_another_fmu_is_refused_and_of_a_copy_taken():
    assert run_case("foreign_state", unzipped("brick"), unzipped("driven"))[0] is True


@needs_linker  # else an object file is shipped, which llvmlite links
@pytest.mark.parametrize("name", ["brick", "driven", "pendulum", "prescribed"])
def test_shipped_code_needs_no_numba_and_no_numpy(name):
    found, errors = run_case("shipped_code_alone", unzipped(name))
    assert found == run_case("rows", unzipped(name))[0]
    assert not errors


@pytest.mark.parametrize("name", some_of(["brick", "driven"], 1))
def test_built_without_a_linker_it_ships_an_object_file(name, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(platforms, "find_spec", lambda module: None)
    folder = unzipped_at(build(scene(name), tmp_path / "it.fmu", planned=planned(name)), tmp_path / "it")
    assert [path.suffix for path in folder.glob("resources/*/model-*")] == [".o"]
    found, errors = run_case("rows_and_imports", folder)
    assert found == [alone(name), []]
    assert not errors


def alone(name):
    return run_case("rows", unzipped(name))[0][0]


def test_a_run_imports_no_numba():
    assert run_case("rows_and_imports", unzipped("driven"))[0] == [alone("driven"), []]


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("brick", "driven", "pendulum")]


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["prescribed", *SLOW])
def test_compiling_anew_gives_the_same_bits(name):
    found, errors = run_case("rows_and_imports", unzipped(name), RBFMU_COMPILE="1")
    assert found == [alone(name), ["numba", "numpy"]]
    assert not errors


@pytest.mark.thorough
@pytest.mark.parametrize("spoil", [Path.unlink, lambda code: code.write_bytes(code.read_bytes()[:2000])])
def test_without_usable_object_code_numba_compiles(spoil, tmp_path):
    """None is there on another platform; damaged code would end the process in LLVM."""
    folder = copied("prescribed", tmp_path / "spoilt")
    (code,) = folder.glob("resources/*/model-*.so")
    spoil(code)
    found, errors = run_case("rows_and_imports", folder)
    assert found == [alone("prescribed"), ["numba", "numpy"]]
    assert errors.count("\n") == 1
    assert code.name in errors


@pytest.mark.thorough
def test_two_fmus_in_one_process_each_compute_their_own():
    a, b = unzipped("driven"), unzipped("pendulum")
    assert run_case("rows", a, b)[0] == [alone("driven"), alone("pendulum")]
    assert run_case("rows", b, a, b)[0] == [alone("pendulum"), alone("driven"), alone("pendulum")]


def test_what_a_value_reference_stands_for_is_said_of_any():
    (folder,) = unzipped("driven").glob("resources/rbfmu_*")
    access = Access(str(folder), folder.name.removeprefix("rbfmu_"))
    assert access.name_of(0) == access.names[0]
    assert access.name_of(len(access.names)) == "status"
    assert access.name_of(len(access.names) + 1) == f"value reference {len(access.names) + 1}"


BUILD_WHILE_ONE_RUNS = """
import sys
import fmpy
fmu, scene, path = sys.argv[1:]
fmpy.simulate_fmu(fmu, stop_time=0.01)
import rbfmu_fmu
rbfmu_fmu.build(scene, path)
"""


@pytest.mark.thorough
def test_an_fmu_is_built_whole_where_another_runs_in_the_process(tmp_path):
    """It brings a pythonfmu of its own, without libraries, which Python then takes for the one that is installed."""
    file, found = ROOT / "examples/scenes/earth.toml", tmp_path / "found.fmu"
    first = rbfmu_fmu.build(file, tmp_path / "first.fmu")
    subprocess.run([sys.executable, "-c", BUILD_WHILE_ONE_RUNS, first, file, found], check=True)
    assert found.read_bytes() == first.read_bytes()


OTHER_UNIT = """
from ..compile.decorator import kernel

@kernel(inline=False)
def initialize(z):
    return 0

@kernel(inline=False)
def step(z, h):
    z[{first}] += 1.0
    return 0

@kernel(inline=False)
def outputs(z):
    return 0

from types import SimpleNamespace
PRESCRIBED_RATES = SimpleNamespace(initialize=initialize, step=step, outputs=outputs)
"""


@pytest.fixture(scope="module")
def other_kernels(tmp_path_factory):
    """The FMU of the same scene from other kernels: its first output counts the steps."""
    place = scene("prescribed"), planned("prescribed")
    text = OTHER_UNIT.format(first=place[1].kernels.BLOCKS["quaternion"].start)
    other = ModuleType("rbfmu_kernels.models.other")
    other.__package__, other.SIZE = "rbfmu_kernels.models", place[1].kernels.SIZE
    exec(compile(text, "<other unit>", "exec"), other.__dict__)
    with pytest.MonkeyPatch.context() as patch:
        sources = builder.kernel_sources() | {"models/prescribed_rates.py": text.encode()}
        patch.setattr(builder, "kernel_sources", lambda: sources)
        patch.setattr(builder.object_code, "object_files", lambda unit, platform: object_files(other, platform))
        path = build(place[0], tmp_path_factory.mktemp("other") / "prescribed.fmu", planned=place[1])
    return unzipped_at(path, path.parent / "unzipped")


@pytest.mark.thorough
@pytest.mark.parametrize("compile_anew", ["0", pytest.param("1", marks=pytest.mark.thorough)])
def test_two_fmus_of_one_name_each_compute_with_their_own_kernels(other_kernels, compile_anew):
    folder = unzipped("prescribed")
    found = run_case("rows", folder, other_kernels, folder, RBFMU_COMPILE=compile_anew)[0]
    again = run_case("rows", other_kernels, folder, RBFMU_COMPILE=compile_anew)[0]
    assert found[0] == found[2] == again[1] == alone("prescribed")
    assert [row[0] for row in found[1]] == [k + 1.0 for k in range(20)]
    assert found[1] == again[0]


def test_the_first_instances_may_be_made_by_many_threads_at_once():
    assert run_case("threads_from_the_start", unzipped("driven"))[0] == [True, alone("driven")]


def test_pythonfmu_releases_its_interpreter_once_though_the_library_stays_loaded():
    """Else it does so again in the last moment of the process, in memory that is no more its own."""
    nm = shutil.which("nm") or pytest.skip("no nm")
    (library,) = (unzipped("brick") / "binaries" / "linux64").glob("*.so")
    symbols = subprocess.run([nm, "-C", library], capture_output=True, text=True, check=True).stdout.splitlines()
    (place,) = {line.split()[0] for line in symbols if line.endswith("::pyState")}
    assert run_case("released_at_exit", unzipped("brick"), place)[0] is True


def test_a_folder_with_a_space_in_its_path_works(tmp_path):
    assert run_case("rows", copied("driven", tmp_path / "a b"))[0] == [alone("driven")]


@pytest.mark.thorough
def test_a_thousand_lives_leave_nothing_behind():
    assert run_case("cycles", unzipped("driven"))[0] < 12.0


def test_fresh_folders_leave_no_path_behind():
    found = run_case("fresh_folders", built("driven"))[0]
    assert found == [run_case("rows", unzipped("driven"))[0][0]] * 5


@pytest.mark.parametrize(("name", "other", "compile_anew"), [("driven", "brick", "0"), ("prescribed",) * 2 + ("1",)])
def test_folders_may_vanish_under_running_instances(name, other, compile_anew):
    """Compiling anew, even before Numba has compiled: what it needs has been read."""
    assert run_case("deleted_folders", unzipped(name), unzipped(other), RBFMU_COMPILE=compile_anew)[0] is True


@pytest.mark.thorough
def test_fmpy_runs_it_where_rbfmu_is_not_installed():
    last, same = run_case("in_fmpy", built("brick"))[0]
    assert same
    here = fmpy.simulate_fmu(str(built("brick")), stop_time=0.5, output_interval=0.1)
    assert list(here[-1].item()) == last


@pytest.mark.thorough
def test_holding_the_thread_state_changes_nothing_in_a_python_host():
    assert run_case("rows", unzipped("driven"), RBFMU_HOLD_GIL="1")[0][0] == alone("driven")
    assert run_case("threads", unzipped("driven"), RBFMU_HOLD_GIL="1")[0] == [True] * 16


def test_the_gil_is_given_back_by_the_thread_that_took_it_alone(monkeypatch):
    """Python frees an instance in any thread; another's release ends the process."""
    released, held = [], pythonfmu_traps.HeldGil()
    monkeypatch.setattr(ctypes, "pythonapi", SimpleNamespace(PyGILState_Release=released.append))
    for thread, count in ((threading.get_ident() + 1, 0), (threading.get_ident(), 1)):
        held._thread = thread
        held.release()
        assert len(released) == count


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("host")


@pytest.mark.thorough
@pytest.mark.parametrize("held", ["0", "1"])
def test_a_host_without_python_gets_the_same_bits_with_the_gil_held_or_not(held, place):
    found, _ = run_c_host(place, "two_ports", 50, 1, RBFMU_HOLD_GIL=held)
    assert found == [rows_for_c_host("two_ports", 50)] * 4


@pytest.mark.thorough
def test_a_host_without_python_ends_well_after_compiling(place):
    """Much memory has then come and gone, so that a second release of the interpreter would be met."""
    found, _ = run_c_host(place, "prescribed", 20, 1, RBFMU_COMPILE="1")
    assert found == [rows_for_c_host("prescribed", 20)] * 4


def test_building_leaves_no_module_and_no_path_behind(tmp_path):
    path, modules, caching = list(sys.path), set(sys.modules), sys.dont_write_bytecode
    rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu")
    assert sys.path == path
    assert set(sys.modules) == modules
    assert sys.dont_write_bytecode == caching


def test_what_rests_on_the_inside_of_pythonfmu_stands_in_one_module():
    home = Path(pythonfmu_traps.__file__)
    modules = {p: p.read_text(encoding="utf-8") for p in Path(rbfmu_fmu.__file__).parent.rglob("*.py")}
    for sign in ("ctypes.pythonapi", "log_queue", "dladdr", "sys.path"):
        assert [path for path, text in modules.items() if sign in text] == [home], sign


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["rbfmu", "globals"])
def test_a_scene_may_have_a_name_of_python_s_or_of_the_fmu_s_own(name, tmp_path):
    named = scene("prescribed").replace(name=name)
    assert rbfmu_fmu.verify(rbfmu_fmu.build(named, tmp_path / "it.fmu")).passed


def test_older_pythonfmu_finds_the_script_s_class_by_its_text_and_passes_the_start_time_alone():
    script = builder.SCRIPT.format(package="p")
    assert re.search(r"^class (\w+)\(\s*Fmi2Slave\s*\)\s*:", script, re.MULTILINE)[1] == "Body"
    assert inspect.signature(Slave.setup_experiment).bind(None, 0.0)


@pytest.mark.parametrize(
    ("phase", "told"), [(INSTANTIATED, 5.0), (INITIALIZING, 5.0), (STEPPING, 0.0), (TERMINATED, 0.0)]
)
def test_a_start_time_is_told_to_no_motion_that_has_begun(phase, told):
    """Corners of formulas are told by it; pythonfmu could refuse the call by fmi2Fatal alone."""
    access = SimpleNamespace(description={"start_place": 0}, accuracy=1e-6)
    unit = SimpleNamespace(access=access, _phase=phase, _z=[0.0])
    Slave.setup_experiment(unit, 5.0)
    assert unit._z == [told]
