"""What a command does so as to start and end soon."""

import atexit
import gc
import io
import os
import re
import subprocess
import sys

import rbfmu.__main__
from rbfmu import progress
from tests.support.paths import SCENES


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
    assert os.environ == {"OPENBLAS_NUM_THREADS": "2", "PYDANTIC_DISABLE_PLUGINS": "__all__"}


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
    monkeypatch.setattr(sys, "stderr", io.StringIO())
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
