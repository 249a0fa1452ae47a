"""`make check` refuses long subjects of commits, and only where it can see them."""

import shutil
import subprocess

import pytest

from tests.support.commit_subjects import LONGEST, too_long

pytestmark = pytest.mark.skipif(not shutil.which("git"), reason="no git")


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


def test_a_long_subject_is_named_and_older_ones_are_not(clone):
    since = commit(clone, "o" * 100)
    commit(clone, "ä" * LONGEST)
    assert too_long(clone, since) == []
    commit(clone, "n" * (LONGEST + 1))
    assert too_long(clone, since) == ["n" * (LONGEST + 1)]


def test_nothing_is_said_where_nothing_can_be_seen(clone, tmp_path, monkeypatch):
    since = commit(clone, "first")
    commit(clone, "n" * (LONGEST + 1))
    git(tmp_path, "clone", "-q", "--depth", "1", f"file://{clone}", tmp_path / "shallow")
    assert too_long(tmp_path / "shallow", since) == []
    assert too_long(tmp_path.parent, since) == []
    monkeypatch.setenv("PATH", "")
    assert too_long(clone, since) == []
