"""`make thorough` and `make bench` run all their parts; they fail where any part does."""

import os
import re
import shutil
import subprocess

import pytest

from tests.support.paths import ROOT

pytestmark = pytest.mark.skipif(not shutil.which("make"), reason="no make")
PART = """#!/bin/sh
echo "${NUMBA_DISABLE_JIT:-jit} $*" >> "$LOG"
case "${NUMBA_DISABLE_JIT:-jit} $*" in *"$FAILS"*) exit 1;; esac
"""


def made(target, program, fails, folder):
    """(whether all is well, a line for each part) of a target whose program fails where its line has this text."""
    (folder / "bin").mkdir()
    (folder / "bin" / program).write_text(PART)
    (folder / "bin" / program).chmod(0o755)
    environment = os.environ | {"LOG": str(folder / "log"), "FAILS": fails}
    environment.pop("NUMBA_DISABLE_JIT", None)
    command = ["make", "-C", ROOT, target, f"VENV={folder}"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    return done.returncode == 0, (folder / "log").read_text().splitlines()


@pytest.mark.parametrize(("fails", "well"), [("none", True), ("jit -n", False), ("1 -n", False)])
def test_the_tests_without_jit_run_whatever_became_of_the_others(fails, well, tmp_path):
    found, parts = made("thorough", "pytest", fails, tmp_path)
    assert found == well
    assert [part.split()[0] for part in parts] == ["jit", "1"]


@pytest.mark.parametrize(("fails", "well"), [("none", True), ("marks.kernels", False), ("marks.gallery", False)])
def test_all_benchmarks_run_whatever_became_of_the_first(fails, well, tmp_path):
    found, parts = made("bench", "python", fails, tmp_path)
    assert found == well
    listed = re.search(r"^BENCHES = (.+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert [part.rpartition(".")[2] for part in parts] == listed[1].split()
