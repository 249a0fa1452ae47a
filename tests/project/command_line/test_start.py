"""What a command does so as to start and end soon: what it imports, and plans of scene files that are kept."""

import atexit
import gc
import io
import os
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

import rbfmu.__main__
import rbfmu_fmu
from rbfmu import on_disk, progress
from tests.support.command_line import call
from tests.support.paths import ROOT, SCENES


def test_a_command_seldom_looks_for_garbage_and_leaves_it_at_the_end(monkeypatch):
    """What it imports and compiles lives until its end: looking through that takes a quarter of a short command."""
    thresholds, at_end = [], []
    monkeypatch.setattr("rbfmu.cli.main", lambda prog_name: None)
    monkeypatch.setattr(gc, "set_threshold", thresholds.append)
    monkeypatch.setattr(atexit, "register", at_end.append)
    rbfmu.__main__.main()
    assert thresholds == [rbfmu.__main__.YOUNG]
    assert gc.freeze in at_end


def test_a_command_spares_what_libraries_do_at_import_unless_it_is_asked_for(monkeypatch):
    monkeypatch.setattr("rbfmu.cli.main", lambda prog_name: None)
    monkeypatch.setattr(gc, "set_threshold", lambda young: None)
    monkeypatch.setattr(atexit, "register", lambda function: None)
    monkeypatch.setattr(os, "environ", {"OPENBLAS_NUM_THREADS": "2"})
    rbfmu.__main__.main()
    assert os.environ == {"OPENBLAS_NUM_THREADS": "2", "MPLBACKEND": "agg"}


@pytest.mark.thorough
def test_a_run_by_a_kept_plan_loads_only_what_it_needs(monkeypatch, tmp_path):
    """Models that are not taken, tables, bars and NumPy's masked arrays take a fifth of a short run."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    code = """
import sys
from rbfmu.cli import main

main(["run", sys.argv[1]], standalone_mode=False)
print([m for m in sys.modules if m.split(".")[0] == "rich" or m == "numpy.ma"])
print([m for m in sys.modules if m.startswith("rbfmu_kernels.models.")])
"""
    command = [sys.executable, "-c", code, SCENES / "fixed_camera.toml"]
    runs = [subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(2)]
    unneeded, models = runs[1].stdout.splitlines()[-2:]
    assert unneeded == "[]"
    assert "unturned" in models
    assert not {"loaded", "one_axis", "free"} & set(re.findall(r"models\.(\w+)", models))


class Terminal(io.StringIO):
    """Somebody sees what is written."""

    def isatty(self):
        return True


def test_a_bar_comes_only_where_a_run_is_long(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert list(progress.progress_bar("short")(range(9))) == list(range(9))
    assert sys.stderr.getvalue() == ""
    monkeypatch.setattr(progress, "SOON", -1.0)
    monkeypatch.setattr(progress, "OFTEN", 0.0)
    assert list(progress.progress_bar("long")(range(9))) == list(range(9))
    assert "long" in sys.stderr.getvalue()


def test_no_bar_where_nobody_would_see_it(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert progress.progress_bar("seen")
    monkeypatch.setenv("TERM", "dumb")
    assert progress.progress_bar("unseen") is None
    monkeypatch.setenv("TERM", "xterm")
    closed = io.StringIO()
    closed.close()
    for stream in (io.StringIO(), None, object(), closed):  # a program with windows has none, or one of its own
        monkeypatch.setattr(sys, "stderr", stream)
        assert progress.progress_bar("unseen") is None


def test_a_bar_says_what_it_is_told_and_goes(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(progress, "SOON", -1.0)
    with progress.bar("planning") as tell:
        tell(0.5)
        tell(1, 2, "half of the runs")  # too soon after the last
    assert "planning" in sys.stderr.getvalue()
    assert " 50%" in sys.stderr.getvalue()
    assert "half" not in sys.stderr.getvalue()
    monkeypatch.setattr(progress, "OFTEN", 0.0)
    with progress.bar("runs") as tell:
        tell(1, 4, "1 of 4 runs")
    assert "1 of 4 runs" in sys.stderr.getvalue()
    said = sys.stderr.getvalue()
    with progress.bar("hidden", shown=False) as tell:
        tell(1, 4)
    assert sys.stderr.getvalue() == said


@pytest.mark.thorough
def test_free_rotation_is_loaded_when_it_is_used():
    """Its modules take as long as those of all other array functions."""
    code = """
import sys, rbfmu_kernels as k, rbfmu.arrays

print([m for m in sys.modules if m.startswith("rbfmu_kernels.exact")])
print("free_rotation" in rbfmu.arrays.__all__, rbfmu.arrays.free_rotation.__name__)
print(callable(k.free_rotation_at), k.free_rotation.__name__)
for module in (k, rbfmu.arrays):
    print(hasattr(module, "no_such_function"))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:5] == ["[]", "True free_rotation", "True free_rotation", "False", "False"]


# Plans that are kept


SCENE = ROOT / "examples" / "scenes" / "t_handle.toml"
LOOK = "import sys; from rbfmu.cli import main; main({}, standalone_mode=False); print('numba' in sys.modules)"


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    path = tmp_path / "scene.toml"
    path.write_bytes(SCENE.read_bytes())
    return path


def said(*arguments):
    result = call(*arguments)
    assert result.exit_code == 0, result.output
    return result.output


def kept(path):
    return sorted((path.parent / "kept" / "rbfmu_plans").glob("*"))


@pytest.mark.parametrize("options", [(), ("--json",), ("--model", "full"), ("--accuracy", "1e-4")])
def test_a_plan_is_said_again_in_the_same_words(scene, options):
    first = said("plan", scene, *options)
    assert len(kept(scene)) == 1
    assert said("plan", scene, *options) == first
    assert len(kept(scene)) == 1


def test_a_kept_plan_needs_no_compiler(scene):
    said("plan", scene)
    command = [sys.executable, "-c", LOOK.format(["plan", str(scene)])]
    done = subprocess.run(command, env=os.environ, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "False"


def test_a_run_by_a_kept_plan_gives_the_same_bits(scene, tmp_path):
    files = [tmp_path / name for name in ("first.csv", "second.csv")]
    for file in files:
        said("run", scene, "-o", file)
    assert len(kept(scene)) == 1
    assert files[0].read_bytes() == files[1].read_bytes()


def test_an_fmu_is_built_by_the_kept_plan_and_has_the_bytes_of_a_plan_made_anew(scene, tmp_path, monkeypatch):
    """2026-11-29: `build` planned anew what `plan` and `run` had kept: half a minute, of a long shell in waves."""
    files = [tmp_path / name for name in ("kept.fmu", "anew.fmu")]
    said("plan", scene)
    monkeypatch.setattr("rbfmu.simulation._plan", None)
    with monkeypatch.context() as without:
        without.setattr("rbfmu_fmu.builder.plan", None)
        said("build", scene, "-o", files[0])
    rbfmu_fmu.build(scene, files[1])
    assert files[0].read_bytes() == files[1].read_bytes()


def test_another_scene_option_or_source_is_another_plan(scene, monkeypatch):
    said("plan", scene)
    said("plan", scene, "--accuracy", "1e-5")
    scene.write_text(scene.read_text() + "\n# another\n")
    said("plan", scene)
    monkeypatch.setattr(on_disk, "_stamp", lambda: b"other sources")
    said("plan", scene)
    assert len(kept(scene)) == 4


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs pipes that have paths")
def test_a_scene_from_a_pipe_has_a_plan_of_its_own(scene):
    """As of `rbfmu run <(...)`: it got the plan of the pipe before it, whose path and (no) bytes are the same."""
    for moments, model in (("1, 2, 3", "torque-free body"), ("1, 1, 2", "torque-free symmetric body")):
        reading, writing = os.pipe()
        text = f"body = {{ mass = 1, inertia = [{moments}] }}\ninitial = {{ omega_b = [1, 2, 3] }}\n"
        with open(writing, "w") as file:
            file.write(f"{text}outputs = {{ quantities = ['quaternion'] }}\n")
        assert said("run", f"/dev/fd/{reading}").startswith(f"{model}: ")
        os.close(reading)
    assert not kept(scene)


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="needs pipes that have paths")
def test_inputs_from_a_pipe_are_those_of_the_file(scene, tmp_path):
    """They were read twice, for the plan and the run; numbers in quotes are read in another way, from the begin."""
    text = "body = { mass = 1, inertia = [1, 2, 3] }\ninputs = { ports = ['torque_b'] }\n"
    scene.write_text(f"{text}run = {{ stop = 1, step = 0.5 }}\noutputs = {{ quantities = ['quaternion'] }}\n")
    table = tmp_path / "table.csv"
    table.write_text('time,torque_b[1],torque_b[2],torque_b[3]\n0,"0.1",0,0\n0.5,0,0.2,0\n')
    reading, writing = os.pipe()
    os.write(writing, table.read_bytes())
    os.close(writing)
    assert said("run", scene, "--inputs", f"/dev/fd/{reading}") == said("run", scene, "--inputs", table)
    os.close(reading)


def test_sources_and_versions_are_told_from_others(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(on_disk, "PACKAGES", ("one_package", "none_of_this_name"))
    monkeypatch.setattr(on_disk, "VERSIONS", {"one_package": "version.txt"})
    (tmp_path / "one_package" / "inner").mkdir(parents=True)
    stamps = [on_disk._stamp()]
    for file, content in (("__init__.py", ""), ("inner/one.py", "1"), ("inner/one.py", "12"), ("version.txt", "2")):
        (tmp_path / "one_package" / file).write_text(content)
        stamps.append(on_disk._stamp())
    assert len({*stamps}) == 5
    assert on_disk._stamp() == stamps[-1]
    os.utime(tmp_path / "one_package" / "inner" / "one.py", (1.0, 1.0))  # as of one that was edited to the same length
    assert on_disk._stamp() not in stamps


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe", b"null", b"{}", b'a line\n{"doubts": []}'])
def test_what_cannot_be_read_is_planned_anew(scene, content):
    first = said("plan", scene)
    written = kept(scene)[0].read_bytes()
    kept(scene)[0].write_bytes(content)
    assert said("plan", scene) == first
    assert kept(scene)[0].read_bytes() == written


def test_a_plan_that_was_edited_is_planned_anew(scene):
    first = said("plan", scene, "--json")
    path = kept(scene)[0]
    written = path.read_text()
    path.write_text(written.replace('"cost": ', '"cost": 1'))
    assert path.read_text() != written
    assert said("plan", scene, "--json") == first
    assert path.read_text() == written


def test_a_plan_in_the_place_of_another_is_planned_anew(scene):
    first, other = said("plan", scene, "--json"), said("plan", scene, "--json", "--model", "full")
    one, two = kept(scene)
    texts = one.read_text(), two.read_text()
    one.write_text(texts[1])
    two.write_text(texts[0])
    assert [said("plan", scene, "--json"), said("plan", scene, "--json", "--model", "full")] == [first, other]
    assert first != other


def test_where_nothing_can_be_written_it_is_planned_each_time(scene):
    (scene.parent / "kept").write_text("a file, no folder")
    assert said("plan", scene) == said("plan", scene)


def test_where_the_installation_cannot_be_written_plans_stand_in_the_user_s_folder(scene, tmp_path, monkeypatch):
    """2026-11-30: Numba's code stood there, but each command planned and built anew, and `rbfmu warm` kept no plan."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    first = said("plan", scene)
    (file,) = (tmp_path / ".cache" / "rbfmu" / "rbfmu_plans").iterdir()
    monkeypatch.setattr("rbfmu.plan", None)
    assert said("plan", scene) == first
    assert on_disk.folder("any", str(tmp_path)) == tmp_path / "any"
    monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError))
    assert on_disk.folder("any", None) == Path(on_disk.__file__).parent / "__pycache__" / "any"
    assert file.exists()


def test_a_doubt_is_said_each_time(scene):
    scene.write_text("[body]\nmass = 50.0\ninertia = [1e4, 2e4, 2.5e4]  # kg cm2\n[run]\nstop = 1.0\nstep = 0.1\n")
    results = [call("plan", scene) for _ in range(2)]
    assert results[0].stderr.count("Warning") == 1
    assert results[1].stderr == results[0].stderr
    assert len(kept(scene)) == 1


def test_the_oldest_go(scene, monkeypatch):
    monkeypatch.setattr(on_disk, "MOST", 2)
    said("plan", scene, "--accuracy", "1e-3")
    (oldest,) = kept(scene)
    os.utime(oldest, (1.0, 1.0))
    for accuracy in ("1e-4", "1e-5"):
        said("plan", scene, "--accuracy", accuracy)
    assert len(kept(scene)) == 2
    assert oldest not in kept(scene)
