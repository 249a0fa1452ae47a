"""Runs of ensembles: the same bits on any executor, threads, processes or others."""

import concurrent.futures as cf
import multiprocessing
import subprocess
import sys
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from rbfmu import SceneError, SimulationError, run_ensemble, simulate
from rbfmu.ensembles import running
from rbfmu.ensembles.chunks import origin
from tests.support.ensembles.satellite import PLAN, assert_same, run
from tests.support.paths import ROOT


def test_the_plan_makes_chunks_of_some_members(scene):
    assert 5 < running.Work(scene, PLAN, running.members_of_a_chunk(scene, PLAN)).chunks < 20


def test_a_run_can_be_looked_at_alone_and_has_the_same_bits(whole):
    for number in whole.good[[0, 7, -1]]:
        alone = simulate(whole.member(number), planned=PLAN)
        for name in whole.ended:
            assert (alone.quantities[name][-1] == whole.ends(name)[number]).all()
    with pytest.raises(ValueError, match=f"number = {whole.runs}: expected a whole number from 0 to {whole.runs - 1}"):
        whole.member(whole.runs)


@pytest.mark.parametrize("threads", [2, np.int64(7)])
def test_threads_give_the_same_bits(scene, whole, threads):
    assert_same(whole, run(scene, executor=threads))
    assert 0 < len(whole.failed) < 50


FIRST_RUN = """
from numba.core.typing.typeof import typeof_impl
from tests.support.ensembles.satellite import run, satellite
known = {*typeof_impl.registry}
run(satellite(), executor=2)
print({*typeof_impl.registry} - known)
"""


@pytest.mark.thorough
def test_threads_add_nothing_to_what_others_look_types_up_in():
    """2026-11-29: a first run failed once in a while: "dictionary changed size during iteration"."""
    done = subprocess.run([sys.executable, "-c", FIRST_RUN], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "set()\n"


def test_where_no_thread_can_be_started_it_is_said(scene, monkeypatch):
    """2026-11-30: it was a traceback of Python's."""
    monkeypatch.setattr(threading.Thread, "start", Mock(side_effect=RuntimeError("can't start new thread")))
    with pytest.raises(SimulationError, match="lost a chunk of the ensemble: RuntimeError: can't start new thread"):
        run(scene, executor=2)


def test_processes_give_the_same_bits(scene, whole):
    with cf.ProcessPoolExecutor(2, multiprocessing.get_context("forkserver")) as pool:
        assert_same(whole, run(scene, executor=pool))


class Reversed(cf.Executor):
    """An executor that runs what it has in reverse order, once it is asked for a result."""

    _max_workers = 3

    def __init__(self):
        self.waiting, self.most = [], 0

    def submit(self, function, /, *args):
        future = Waited(self)
        self.waiting.append((future, function, args))
        self.most = max(self.most, len(self.waiting))
        return future


class Waited(cf.Future):
    def __init__(self, pool):
        super().__init__()
        self.pool = pool

    def result(self, timeout=None):
        for future, function, args in reversed(self.pool.waiting):
            future.set_result(function(*args))
        self.pool.waiting.clear()
        return super().result(timeout)


def test_the_order_in_which_chunks_are_done_changes_nothing_and_few_wait(scene, whole):
    pool = Reversed()
    assert_same(whole, run(scene, executor=pool))
    assert pool.most == 3 * running.AHEAD


@pytest.mark.parametrize("wrong", [0, -1, "two", True, 2.5])
def test_what_is_no_executor_is_refused(scene, wrong):
    with pytest.raises(ValueError, match="executor = "):
        run(scene, executor=wrong)


def test_a_scene_without_ensemble_is_refused(scene):
    with pytest.raises(SceneError, match=r"ensemble is missing: expected a table \[ensemble\.vary\]"):
        run_ensemble(scene.replace({"ensemble": None}))


def test_an_executor_that_breaks_is_named(scene, tmp_path, whole):
    with cf.ProcessPoolExecutor(1, multiprocessing.get_context("forkserver")) as pool:
        pool.submit(int).result()
        for process in pool._processes.values():
            process.kill()
        with pytest.raises(SimulationError, match="the executor lost a chunk of the ensemble: BrokenProcessPool"):
            run(scene, tmp_path / "store.npz", pool)
    assert_same(whole, run(scene, tmp_path / "store.npz", resume=True))


@pytest.mark.parametrize("name", ["rbfmu", "rbfmu_kernels", "numpy"])
def test_workers_of_another_origin_are_refused(scene, monkeypatch, name):
    packed = running.pack(running.Work(scene, PLAN, 8))
    monkeypatch.setattr(running, "origin", lambda: origin() | {name: "other"})
    with pytest.raises(SimulationError, match=f"a worker has another {name}, whose bits"):
        running.run_packed(packed, 0)


@pytest.mark.parametrize("keep", [["final"], ["all", "statistics"]])
def test_a_grid_can_be_warmed(scene, keep):
    """It was refused, as one of other runs than its points."""
    varied = {
        "body.mass": {"normal": [50.0, 1.0], "points": 2},
        "initial.omega_b": {"normal": [[0.0, 0.1, 0.0], 0.01], "points": 2},
    }
    grid = scene.replace({"ensemble": None}).replace({"ensemble": {"design": "grid", "vary": varied, "keep": keep}})
    running.warm(grid, PLAN)
