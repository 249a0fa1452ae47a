"""The product without what Python has on POSIX alone, and without an encoding of files that is as on Linux."""

import re
import shlex
import subprocess
import sys

import pytest

from tests.support.paths import with_sources

SCENE = """
name = "Kreisel, größer"
[body]
mass = 1.0
inertia = [1.0, 2.0, 3.0]
[initial]
omega_b = [0.1, 1.0, 0.1]
[outputs]
speed = { value = "norm(omega_b)", unit = "rad/s", about = "wie schnell er sich dreht, größer als null" }
[run]
stop = 2.0
step = 0.5
[ensemble]
runs = 20
seed = 1
[ensemble.vary]
"body.mass" = { uniform = [0.9, 1.1] }
"""


def without_posix(folder, *lines):
    environment = with_sources(PYTHONWARNDEFAULTENCODING="1")
    command = [sys.executable, "-m", "tests.support.without_posix", *lines]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.mark.slow
def test_commands_need_nothing_of_posix(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    done = without_posix(
        tmp_path, "new fresh", "plan scene.toml", "run scene.toml -o motion.csv --plot motion.png",
        "ensemble scene.toml -o runs.npz --workers 2", "view motion.csv --scene scene.toml -o motion.html",
        "build scene.toml -o scene.fmu", "verify scene.fmu", "demo",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not list(tmp_path.rglob("*.lock"))


LOCK = """
from pathlib import Path
from rbfmu.ensembles.lock import store_lock
with store_lock(Path("runs.npz")):
    print("mine")
    {}
"""
OTHER = """
    import shlex, subprocess, sys
    line = shlex.join(("-c", Path("other.py").read_text(encoding="utf-8")))
    command = [sys.executable, "-m", "tests.support.without_posix", line]
    print(subprocess.run(command, capture_output=True, text=True, encoding="utf-8").stderr)
"""


@pytest.mark.thorough
def test_a_store_is_locked_on_windows(tmp_path):
    (tmp_path / "other.py").write_text(LOCK.format("pass"), encoding="utf-8")
    first, second = LOCK.format(OTHER.strip()), LOCK.format("pass")
    told = without_posix(tmp_path, shlex.join(("-c", first)), shlex.join(("-c", second)))
    assert re.search("BlockingIOError.* is being written by process", told.stdout), told.stderr
    assert told.stdout.count("mine") == 2, told.stderr
    assert not (tmp_path / "runs.npz.lock").exists()


FORGOTTEN = """
from pathlib import Path
exec("Path('x').write_text('')", {"Path": Path, "__name__": "rbfmu.forgotten"})
"""


@pytest.mark.thorough
@pytest.mark.parametrize(("code", "error"), [
    ("import os; os.fork()", "has no attribute 'fork'"),
    ("import fcntl", "import of fcntl halted"),
    (FORGOTTEN, "\nEncodingWarning"),
    ("open('aux.txt', 'w', encoding='utf-8')", "no name of a file on Windows"),
    ("open('a:b', 'w', encoding='utf-8')", "no name of a file on Windows"),
    ("import os; os.mkdir('x'); os.mkdir('X')", "the same file as one that is there"),
    ("import os; f = open('x', 'w', encoding='utf-8'); os.remove('x')", "is open, and Windows neither removes"),
    ("import os; f = open('x', 'w', encoding='utf-8'); os.replace('x', 'y')", "is open, and Windows neither"),
])  # fmt: skip
def test_what_of_posix_is_used_is_found(tmp_path, code, error):
    assert error in without_posix(tmp_path, shlex.join(("-c", code))).stderr
