"""Whatever is killed, and wherever: what was begun goes on, and ends with the same bits."""

import errno
import signal
import subprocess
import sys

import pytest

from rbfmu import EnsembleResult
from rbfmu.ensembles import store as stores
from tests.support.ensembles.satellite import assert_same, run, satellite
from tests.support.full_disk import full_disk
from tests.support.paths import ROOT, with_sources

STORES = ["store.npz", "store.zarr"]


def killed(store, moments):
    command = [sys.executable, "-m", "tests.support.ensembles.killed_runs", store, str(moments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=with_sources())
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def assert_all_go_on(whole, store, moments):
    rows = killed(store, moments)
    assert len(rows) == moments
    for place, *_ in rows:
        assert_same(whole, EnsembleResult.load(place))
    assert str(-signal.SIGKILL) in {row[4] for row in rows}  # some were killed twice
    assert len({row[1] for row in rows}) == moments


@pytest.mark.thorough
@pytest.mark.parametrize("store", STORES)
def test_a_program_that_is_killed_goes_on(whole, tmp_path, store):
    assert_all_go_on(whole, tmp_path / store, 3)


@pytest.mark.slow
@pytest.mark.parametrize("store", STORES)
def test_a_program_that_is_killed_at_twenty_moments_goes_on(whole, tmp_path, store):
    assert_all_go_on(whole, tmp_path / store, 20)


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
    assert list(tmp_path.rglob("*.partial")) == []
