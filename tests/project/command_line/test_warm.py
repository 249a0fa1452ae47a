"""`rbfmu warm`: what follows it plans nothing, and writes nothing to the folder of compiled code."""

import os
import subprocess
import sys

import pytest

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
