"""What `make` runs: all parts, whatever fails; ranges of dependencies; long subjects of commits are refused."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from tests.support import ranges
from tests.support.commit_subjects import LONGEST, too_long
from tests.support.paths import ROOT

needs_make = pytest.mark.skipif(not shutil.which("make"), reason="no make")
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
    for name in ("NUMBA_DISABLE_JIT", "MAKEFLAGS"):  # what `make test BIN=...` was told is for that one alone
        environment.pop(name, None)
    command = ["make", "-C", folder, "-f", ROOT / "Makefile", target, "VENV=."]  # the folder's name may have spaces
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    return done.returncode == 0, (folder / "log").read_text().splitlines()


@needs_make
@pytest.mark.parametrize(("fails", "well"), [("none", True), ("jit -n", False), ("1 -n", False)])
def test_the_tests_without_jit_run_whatever_became_of_the_others(fails, well, tmp_path):
    found, parts = made("thorough", "pytest", fails, tmp_path)
    assert found == well
    assert [part.split()[0] for part in parts] == ["jit", "1"]


@needs_make
@pytest.mark.parametrize(("fails", "well"), [("none", True), ("marks.kernels", False), ("marks.gallery", False)])
def test_all_benchmarks_run_whatever_became_of_the_first(fails, well, tmp_path):
    found, parts = made("bench", "python", fails, tmp_path)
    assert found == well
    listed = re.search(r"^BENCHES = (.+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert [part.rpartition(".")[2] for part in parts] == listed[1].split()


# Ranges of dependencies


TEST = "tests/project/test_makefile.py"


def test_a_word_that_is_not_known_is_refused(capsys):
    assert ranges.main(["lowset", "3.11", "tests/no_such_test.py"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("lowset, tests/no_such_test.py: expected of lowest, newest, 3.11")


def test_each_range_makes_fmus_of_its_own(tmp_path):
    """The newest packages were tested with FMUs that the lowest had built, of other bytes."""
    (tmp_path / "bin").mkdir()
    python = tmp_path / "bin" / "python"
    python.write_text('#!/bin/sh\ntest -z "$RBFMU_TESTS"\n')
    python.chmod(0o755)
    assert "RBFMU_TESTS" in os.environ
    assert ranges.tested(python, [TEST], tmp_path)


def test_what_is_asked_for_is_tested_and_the_status_says_how_it_went(capsys, monkeypatch):
    seen = []

    def tested(python, tests, folder):
        seen.append((python.parents[1].name, tests))
        return len(seen) != 2

    monkeypatch.setattr(ranges, "python_of", lambda version: sys.executable if version == "3.11" else None)
    monkeypatch.setattr(ranges, "install", lambda python, resolution, folder: folder / resolution / "bin" / "python")
    monkeypatch.setattr(ranges, "versions", lambda python: "numba 0.61.0")
    monkeypatch.setattr(ranges, "tested", tested)
    monkeypatch.setattr(ranges, "typed", lambda python: False)
    assert ranges.main(["lowest", "3.11", TEST]) == 0
    assert ranges.main(["newest"]) == 1
    assert ranges.main(["newest", "3.11"]) == 1  # as mypy fails
    assert seen == [("lowest", [TEST]), ("newest", ranges.TESTS), ("newest", ranges.TESTS)]
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "Python 3.11, lowest: passed with numba 0.61.0",
        "Python 3.11, newest: FAILED with numba 0.61.0",
    ]
    assert lines[2:-1] == [f"Python 3.{n}: not on this machine, not tried" for n in (12, 13, 14)]


# Subjects of commits


needs_git = pytest.mark.skipif(not shutil.which("git"), reason="no git")


def git(folder, *words):
    author = ("-c", "user.name=x", "-c", "user.email=x")
    done = subprocess.run(["git", "-C", folder, *author, *words], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(folder, subject):
    git(folder, "commit", "-q", "--allow-empty", "-m", subject, "-m", "x" * 100)
    return git(folder, "rev-parse", "HEAD")


@pytest.fixture
def clone(tmp_path):
    git(tmp_path, "init", "-q")
    return tmp_path


@needs_git
def test_a_long_subject_is_named_and_older_ones_are_not(clone):
    since = commit(clone, "o" * 100)
    commit(clone, "ä" * LONGEST)
    assert too_long(clone, since) == []
    commit(clone, "n" * (LONGEST + 1))
    assert too_long(clone, since) == ["n" * (LONGEST + 1)]


@needs_git
def test_nothing_is_said_where_nothing_can_be_seen(clone, tmp_path, monkeypatch):
    since = commit(clone, "first")
    commit(clone, "n" * (LONGEST + 1))
    git(tmp_path, "clone", "-q", "--depth", "1", f"file://{clone}", tmp_path / "shallow")
    assert too_long(tmp_path / "shallow", since) == []
    assert too_long(tmp_path.parent, since) == []
    monkeypatch.setenv("PATH", "")
    assert too_long(clone, since) == []
