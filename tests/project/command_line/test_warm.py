"""`rbfmu warm`: what follows it plans nothing, and writes nothing to the folder of compiled code."""

import os
import subprocess
import sys

import pytest
from numba import config

SCENE = """
[body]
mass = 1.0
inertia = [1.0, 2.0, 3.0]
[initial]
omega_b = [0.1, 1.0, 0.1]
[loads]
torque_b = "-0.1*omega_b"
[run]
stop = 20.0
"""


def kept(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.thorough
def test_a_run_after_it_writes_nothing_to_the_cache_and_needs_no_home(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    cache = tmp_path / "cache"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "HOME": str(tmp_path / "none")}

    def rbfmu(*words):
        command = [sys.executable, "-m", "rbfmu", *words]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

    rbfmu("warm", "scene.toml")
    before = kept(cache)
    assert any(path.suffix == ".json" for path in before), "the plan is kept"
    rbfmu("run", "scene.toml", "-o", "motion.csv")
    assert kept(cache) == before
    assert not (tmp_path / "none").exists()


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(config, "CACHE_LOCATOR_CLASSES"), reason="this Numba finds another folder")
def test_it_fails_where_nothing_can_be_kept(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "scene.toml" / "no folder"),
        "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator",
    }
    command = [sys.executable, "-m", "rbfmu", "warm", tmp_path / "scene.toml"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("Error: compiled code cannot be kept here")
    assert line.endswith("set NUMBA_CACHE_DIR to a folder that can be written")
