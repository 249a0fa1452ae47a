"""Ensembles on Dask: the same bits, whichever worker is killed; a scheduler that is lost is said, and nothing lost."""

import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config

from rbfmu import SimulationError
from rbfmu.ensembles import running
from rbfmu.ensembles.chunks import Work, run_chunk
from rbfmu.ensembles.result import EnsembleResult
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from tests.support.command_line import call
from tests.support.ensembles.satellite import FILE, PLAN, assert_same, run, satellite
from tests.support.paths import with_sources

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # of Dask's own


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as found:
        yield found


class Fatal:
    """A client with whose fifth chunk a process is killed, once: the worker, or another one."""

    def __init__(self, client, mark, victim=0):
        self.client, self.mark, self.victim, self.count = client, mark, victim, 0
        self.scheduler_info, self.nthreads, self.status = client.scheduler_info, client.nthreads, client.status

    def submit(self, task, *args, pure):
        self.count += 1
        kills = self.count == 5
        return self.client.submit(
            killing if kills else task, *([str(self.mark), self.victim, task] * kills), *args, pure=pure
        )


def killing(mark, victim, task, *args):
    """Kill a process, this one by default, unless the file `mark` says that it was done."""
    if not Path(mark).exists():
        Path(mark).touch()
        os.kill(victim or os.getpid(), signal.SIGKILL)
    return task(*args)


@pytest.mark.thorough
def test_workers_of_dask_give_the_same_bits(whole, cluster):
    with distributed.Client(cluster) as client:
        assert_same(whole, run(satellite(), executor=client))


@pytest.mark.thorough
def test_a_worker_that_is_killed_is_replaced(whole, cluster, tmp_path):
    with distributed.Client(cluster) as client:
        before = set(client.run(os.getpid).values())
        assert_same(whole, run(satellite(), executor=Fatal(client, tmp_path / "killed")))
        client.wait_for_workers(2, timeout=60)
        assert len(before & set(client.run(os.getpid).values())) == 1


def compiled_and_found():
    """How often a worker compiled the model's step, and how often it found the code kept."""
    stats = LOADED_TAYLOR.step.stats
    return sum(stats.cache_misses.values()), sum(stats.cache_hits.values())


@pytest.mark.slow
@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_four_workers_share_one_cache_and_little_is_sent(whole, tmp_path):
    env = {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    options = {"n_workers": 4, "threads_per_worker": 1, "dashboard_address": None, "env": env}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        assert_same(whole, run(satellite(), executor=client))
        found = [*client.run(compiled_and_found).values()]
    used = [one for one in found if sum(one)]
    assert [sum(column) for column in zip(*used, strict=True)] == [1, len(used) - 1]
    assert len(used) > 1
    scene = satellite().replace({"ensemble.keep": ["final"], "ensemble.runs": 4096})
    work = Work(scene, PLAN, 1024)
    there, chunk = running.pack(work), run_chunk(work, 0)
    back, numbers = len(pickle.dumps(chunk)), sum(values.nbytes for values in chunk.arrays.values())
    said = sum(len(text.encode()) for text in chunk.failed.values())
    print(
        f"sent a chunk: {len(there)} bytes; back a run: {back / 1024:.1f} bytes, {numbers / 1024:.1f} of them numbers"
    )
    assert len(there) < 8_000  # each task has them, whatever its members
    assert back < numbers + 8 * 1024 + 1.5 * said + 4_000


@pytest.mark.thorough
def test_the_command_line_takes_a_scheduler(cluster, tmp_path):
    for store, options in (("dask.npz", ["--scheduler", cluster.scheduler_address]), ("threads.npz", ["--workers", 2])):
        found = call("ensemble", FILE, "-o", tmp_path / store, *options)
        assert found.exit_code == 0, found.stderr
    assert_same(EnsembleResult.load(tmp_path / "dask.npz"), EnsembleResult.load(tmp_path / "threads.npz"))


@pytest.mark.thorough
def test_no_scheduler_is_said(monkeypatch):
    monkeypatch.setattr(running, "PATIENCE", "1s")
    found = call("ensemble", FILE, "--scheduler", "tcp://127.0.0.1:9")
    assert found.exit_code == 2
    assert "Error: no scheduler of Dask at 'tcp://127.0.0.1:9': " in found.stderr


class Lost:
    """A client whose scheduler died while the ensemble was planned: its error is an OSError."""

    submit = scheduler_info = None
    status = "connecting"

    def nthreads(self):
        raise distributed.comm.core.CommClosedError("ConnectionPool closing.")


def test_a_scheduler_that_died_before_the_first_chunk_is_said_and_a_closed_client_is_refused(tmp_path, monkeypatch):
    """2026-11-27: the command said "a file: ConnectionPool closing.", or ended with an AttributeError of Dask's."""
    with pytest.raises(SimulationError, match="the executor lost a chunk of the ensemble: CommClosedError: Conn"):
        run(satellite(), tmp_path / "store.npz", executor=Lost())
    monkeypatch.setattr(Lost, "status", "closed")
    with pytest.raises(ValueError, match="expected a client of Dask that is open"):
        run(satellite(), executor=Lost())


def process(module, *arguments):
    command = [sys.executable, "-m", f"distributed.cli.{module}", *arguments, "--no-dashboard"]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=with_sources())


@pytest.fixture
def scheduler():
    """A scheduler of its own process with a worker, and its address."""
    found = process("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
    lines = iter(found.stderr.readline, "")
    address = next(line.split()[-1] for line in lines if "Scheduler at:" in line)
    worker = process("dask_worker", address, "--nthreads", "1", "--no-nanny")
    yield found, address
    for one in (found, worker):
        one.kill()
        one.wait()
        one.stderr.close()


@pytest.mark.thorough
def test_a_scheduler_that_is_killed_is_said_and_what_is_done_stays(whole, scheduler, tmp_path):
    found, address = scheduler
    store = tmp_path / "store.npz"
    with running.dask_client(address) as client:
        client.wait_for_workers(1, timeout=60)
        with pytest.raises(SimulationError, match="the executor lost a chunk of the ensemble: ") as caught:
            run(satellite(), store, executor=Fatal(client, tmp_path / "killed", found.pid))
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="of 100 runs: expected all, resume it"):
        EnsembleResult.load(store)
    assert_same(whole, run(satellite(), store, resume=True))
