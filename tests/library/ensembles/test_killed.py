"""Stores of ensembles whose program was killed, or had a full disk: they go on with the same bits."""

import errno
import signal
import stat
import subprocess
import sys

import pytest

from rbfmu import EnsembleResult
from rbfmu.ensembles import store as stores
from tests.support.ensembles.satellite import STORES, assert_same, run, satellite
from tests.support.full_disk import full_disk
from tests.support.paths import ROOT, with_sources


def killed(store, moments):
    command = [sys.executable, "-m", "tests.support.ensembles.killed_runs", store, str(moments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=with_sources())
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


@pytest.mark.parametrize(
    "moments", [pytest.param(3, marks=pytest.mark.thorough), pytest.param(20, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("store", STORES)
def test_a_program_that_is_killed_at_any_moment_goes_on(whole, tmp_path, store, moments):
    rows = killed(tmp_path / store, moments)
    assert len(rows) == moments
    for place, *_ in rows:
        assert_same(whole, EnsembleResult.load(place))
    assert list(tmp_path.rglob("*.part*")) == []
    assert str(-signal.SIGKILL) in {row[4] for row in rows}  # some were killed twice
    assert len({row[1] for row in rows}) == moments


@pytest.mark.parametrize("store", STORES)
@pytest.mark.parametrize("size", [100, 6_000, 9_000, 12_000])
def test_a_full_disk_is_said_and_what_is_there_goes_on(whole, tmp_path, monkeypatch, store, size):
    monkeypatch.setattr(stores, "OFTEN", 0.0)
    monkeypatch.setattr(stores, "SHARE", 1e9)
    with full_disk(size), pytest.raises(OSError, match="too large") as caught:
        run(satellite(), tmp_path / store, executor=2)
    assert caught.value.errno == errno.EFBIG
    assert caught.value.filename.startswith(str(tmp_path / store))
    assert_same(whole, run(satellite(), tmp_path / store, resume=True))
    assert list(tmp_path.rglob("*.part*")) == []


@pytest.mark.parametrize("store", STORES)
def test_a_store_keeps_its_permissions_and_loses_what_a_killed_program_left(scene, tmp_path, store):
    """2026-12-01: a store that its owner alone may read was open to all once it was resumed."""
    run(scene, tmp_path / store, runs=17)
    (file,) = (path for path in tmp_path.rglob("*.npz"))
    file.chmod(0o600)
    file.with_name(f"{file.name}.0123abcd.part").write_bytes(b"half")
    (stays := file.with_name(f"{file.name}.a-folder.part")).mkdir()  # it cannot be removed, as another user's cannot
    run(scene, tmp_path / store, resume=True)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert list(tmp_path.rglob("*.part*")) == [stays]
