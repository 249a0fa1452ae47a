"""Kernels that are plain Python until compiling pays: the same bits before and after, and nothing compiled too soon."""

import gc
import math
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from time import sleep
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import rbfmu
from rbfmu.runs.plan import Plan
from rbfmu_kernels.compile import numba_private, said, tiered
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.mechanics.inertia import principal_axes
from rbfmu_kernels.models.free import FREE_TRIAXIAL
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from rbfmu_kernels.rotations.euler_angles import quaternion_from_euler, zyx
from tests.support.command_line import call_by_count
from tests.support.paths import ROOT

M = ((1.0, 0.1, 0.0), (0.1, 2.0, 0.3), (0.0, 0.3, 2.5))
SCENE = ROOT / "examples" / "scenes" / "tumbling_brick.toml"


def in_python(function):
    """A tier that has not asked yet whether the code is kept, and never gets tired."""
    tier = tiered.Tiered(function, tiered.on_buffer(tiered.interpreted(function), function))
    tier._patience, tier._call = math.inf, tier._interpreted
    return tier


def assert_same_bits(scene, plan, steps):
    """Assert that plain Python and machine code leave the same buffer after so many steps."""
    found = []
    for way in (in_python, lambda function: function):
        z = rbfmu.runs.plan.filled_buffer(scene, plan)
        assert way(plan.kernels.initialize)(z) == 0
        for _ in range(steps):
            assert way(plan.kernels.step)(z, scene.run.step) == 0
        found.append(z.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize("name", sorted(p.stem for p in SCENE.parent.glob("*.toml")))
def test_plain_python_and_machine_code_give_the_same_bits(name):
    scene = rbfmu.load_scene(SCENE.with_stem(name))
    assert_same_bits(scene, rbfmu.plan(scene), 20)


@pytest.mark.thorough
def test_a_rate_whose_square_underflows_divides_nothing_by_pythons_zero():
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 0.5], "r_oc_b": [0.0, 0.0, -0.5], "pivot": True}
    loads = {"gravity_a": [0.0, 0.0, -9.81], "damping_b": [0.0, 0.0, 40.0]}
    run = {"stop": 12.0, "step": 6.0}
    scene = rbfmu.Scene(body=body, initial={"omega_b": [0.0, 0.0, 1.0]}, loads=loads, run=run)
    assert_same_bits(scene, Plan("body under loads, by series", "Taylor", 13, tolerance=1e-5, order=6, span=12.0), 2)


def test_numbers_and_tuples_come_back_as_pythons():
    moments, R = tiered.evaluated(principal_axes, M)
    assert (moments, R) == principal_axes(M)
    assert {type(x) for row in (moments, *R) for x in row} == {float}
    assert tiered.evaluated(quaternion_from_euler, zyx, (0.1, 0.2, 0.3)) == quaternion_from_euler(zyx, (0.1, 0.2, 0.3))


def plain(x):
    return ("plain", x)


def machine(x):
    return ("machine code", x)


def tier_of(monkeypatch, patience, calls=1):
    monkeypatch.setattr(tiered, "PATIENCE", patience)
    tier = tiered.Tiered(SimpleNamespace(py_func=plain, overloads={}), plain)
    tier.calls = calls
    return tier


@pytest.mark.parametrize(("patience", "calls", "is_compiled"), [
    (1e9, 1, False), (-1.0, 1, True), (0.005, 1e99, True), (1e9, 1e99, False),
])  # fmt: skip
def test_a_kernel_is_compiled_once_python_takes_the_time_for_that(patience, calls, is_compiled, monkeypatch):
    tier = tier_of(monkeypatch, patience, calls)
    monkeypatch.setattr(tiered, "process_time", iter((0.0, 0.001)).__next__)
    assert tier(1) == ("plain", 1)
    assert (tier._call is tier._kernel) == is_compiled


def test_in_haste_a_kernel_is_compiled_after_less(monkeypatch):
    """`rbfmu warm` compiles what a slower process would compile."""
    monkeypatch.setattr(tiered, "PATIENCE_PER_BYTE", 0.0)
    for haste, is_compiled in ((tiered.in_haste, True), (nullcontext, False)):
        tier = tier_of(monkeypatch, 0.005)
        monkeypatch.setattr(tiered, "process_time", iter((0.0, 0.001)).__next__)
        with haste():
            assert tier(1) == ("plain", 1)
        assert tier.is_compiled == is_compiled


def test_what_plain_python_took_in_earlier_processes_counts(monkeypatch, tmp_path):
    monkeypatch.setattr(tiered, "PATIENCE", 0.0015)
    monkeypatch.setattr(tiered, "PATIENCE_PER_BYTE", 0.0)
    monkeypatch.setattr(tiered, "process_time", iter((0.0, 0.001, 0.001, 0.002)).__next__)
    kept = SimpleNamespace(_cache_file=SimpleNamespace(_index_path=tmp_path / "kernel.nbi"))
    machine.py_func, machine.overloads, machine._cache, found = plain, {}, kept, []
    for _ in range(2):
        tier = tiered.Tiered(machine, plain)
        assert tier(1) == ("plain", 1)
        found.append(tier.is_compiled)
        del tier  # as where the process ends
        gc.collect()
    assert found == [False, True]
    (tmp_path / "kernel.nbi.time").write_text("0.002")
    assert tiered.Tiered(machine, plain)(1) == ("machine code", 1)


def test_a_long_kernel_is_waited_for_longer():
    short, long = (tiered.size_of_code(kernel) for kernel in (quaternion_from_euler, LOADED_TAYLOR.step))
    assert 0 < 5 * short < long
    assert tiered.Tiered(LOADED_TAYLOR.step, lambda *_: 0)._patience > 0.3


@kernel
def _next_quotient(z: Any, x: float) -> float:
    z[0] += 1.0
    return z[0] / z[1] + x


def test_a_division_by_zero_is_as_in_machine_code_and_what_it_cut_short_is_undone():
    z, other = np.array([1.0, 0.0]), np.array([1.0, 0.0])
    assert in_python(_next_quotient)(z, 1.0) == _next_quotient(other, 1.0) == math.inf
    assert z.tolist() == other.tolist() == [2.0, 0.0]


@kernel
def _next_quotient_of_none(z: Any, x: float) -> float:
    z[0] += 1.0
    return 1.0 / (1.0 - (1.0 if z[0] > 1.0 else 0.0)) + x


def test_so_is_one_by_a_number_that_is_no_buffers():
    z = np.array([1.0, 0.0])
    assert in_python(_next_quotient_of_none)(z, 1.0) == math.inf
    assert z.tolist() == [2.0, 0.0]


@kernel(inline=False)
def _more(x: float) -> float:
    return x + 1.0


@kernel
def _add_up(z: Any, count: int) -> float:
    for _ in range(count):
        z[0] = _more(z[0])
    return z[0] + 0.5


def test_a_call_that_takes_too_long_is_given_up_undone_and_made_by_machine_code():
    """2026-11-28: a step that had a hundred thousand pieces took minutes, as only between calls was asked."""
    python, ended, z = tiered.interpreted(_add_up), [], np.zeros(2)
    tier = tiered.Tiered(_add_up, tiered.on_buffer(lambda *args: (python(*args), ended.append(1))[0], _add_up))
    tier._patience = 0.0
    assert tier(z, 1_000) == 1_000.5
    assert (z.tolist(), ended) == ([1_000.0, 0.0], [])


def test_what_ctrl_c_stops_is_undone():
    """2026-11-28: a simulator went on from where a step was interrupted, at the time at which that had begun."""

    def stopped(z):
        z[0] = 7.0
        raise KeyboardInterrupt

    z = np.zeros(2)
    with pytest.raises(KeyboardInterrupt):
        tiered.on_buffer(stopped, stopped)(z)
    assert z.tolist() == [0.0, 0.0]


def test_what_others_have_compiled_meanwhile_is_used():
    compiled = SimpleNamespace(py_func=plain, overloads={})
    tier = tiered.Tiered(compiled, abs)
    tier(-1.0)
    assert tier._call == tier._interpreted
    compiled.overloads["a signature"] = "code"
    tier(-1.0)
    assert tier._call is compiled


def test_what_is_kept_is_not_interpreted():
    z = np.zeros(FREE_TRIAXIAL.SIZE)
    FREE_TRIAXIAL.step(z, 0.1)
    assert tiered.is_kept(FREE_TRIAXIAL.step, z, 0.1)
    assert not tiered.is_kept(FREE_TRIAXIAL.step, 1, 2, 3)


@pytest.mark.thorough
def test_a_run_of_a_closed_form_compiles_nothing(tmp_path):
    """The first run of NASA's brick took 13 s of CPU, nearly all of it for code that ran for a millisecond."""
    call_by_count(tmp_path, "run", SCENE)
    assert not [*tmp_path.rglob("*.nbi")]


@pytest.mark.parametrize(
    "module", ["rbfmu_kernels.models.pendulum", "rbfmu_0123456789ab.models.pendulum", "rbfmu.studies"]
)
def test_a_long_compilation_is_announced_once(module, monkeypatch, capsys):
    monkeypatch.setattr(said, "COMPILING_PATIENCE", 0.0)
    monkeypatch.delenv("RBFMU_QUIET", raising=False)
    ours = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=module))})
    listener = said.Announcer()
    for _ in range(2):
        listener.on_start(ours)
        listener._timer.join()
        listener.on_end(ours)
    assert capsys.readouterr().err == said.TEXT + "\n"


def test_short_ones_and_those_of_others_are_not_announced(monkeypatch, capsys):
    ours, others = (
        SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=m))})
        for m in ("rbfmu_kernels", "librosa")
    )
    listener = said.Announcer()
    monkeypatch.setattr(said, "COMPILING_PATIENCE", 1e6)
    monkeypatch.delenv("RBFMU_QUIET", raising=False)
    listener.on_start(ours)
    listener.on_end(ours)
    monkeypatch.setattr(said, "COMPILING_PATIENCE", 0.0)
    before = threading.active_count()
    listener.on_start(others)
    assert threading.active_count() <= before
    listener.on_end(others)
    assert capsys.readouterr().err == ""


def test_where_no_code_is_kept_the_compiler_is_not_set_up_to_load_it(monkeypatch):
    """That takes as long as a short run in plain Python, which compiles nothing."""
    set_up = []
    monkeypatch.setattr(numba_private.rtsys, "initialize", set_up.append)
    assert not tiered.is_kept(kernel(lambda x: x + 1.0), 1.0)
    assert set_up == []


def test_other_work_is_announced_but_not_while_something_is_compiled(monkeypatch, capsys):
    monkeypatch.delenv("RBFMU_QUIET", raising=False)
    monkeypatch.setattr(said.Announcer, "begun", said.Announcer.begun + 1)
    with said.said_after(0.0, lambda: "at work"):
        threads = [thread for thread in threading.enumerate() if thread.name == said.NAME]
        threads[-1].join(0.05)
        assert capsys.readouterr().err == ""
        monkeypatch.setattr(said.Announcer, "ended", said.Announcer.begun)
        threads[-1].join()
    assert capsys.readouterr().err == "at work\n"


class SlowlyKept:
    """A kernel whose code is kept on disk, and takes some time to load."""

    def __init__(self):
        self.overloads, self.added, self.targetctx, self._cache = {}, 0, None, self

    def load_overload(self, signature, context):
        sleep(0.02)
        return signature

    def add_overload(self, kept):
        self.overloads[kept] = kept
        self.added += 1


def test_threads_that_ask_for_kept_code_at_once_load_it_once():
    kernel = SlowlyKept()
    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(lambda _: tiered.has_code(kernel, ("float64",)), range(4)))
    assert kernel.added == 1


def test_without_stderr_nothing_is_said_on_stdout(monkeypatch, capsys):
    """2026-11-30: `rbfmu plan --json SCENE 2>&-` began with a line that is no JSON; a full disk ended the program."""
    monkeypatch.delenv("RBFMU_QUIET", raising=False)
    for stream in (None, SimpleNamespace(write=Mock(side_effect=OSError), flush=lambda: None)):
        monkeypatch.setattr(sys, "stderr", stream)
        said.say("compiling")
    assert capsys.readouterr().out == ""


def test_where_no_thread_can_be_started_work_goes_on(monkeypatch):
    """2026-11-30: in a container that bounds their number, planning ended with a traceback."""
    monkeypatch.setattr(threading.Thread, "start", Mock(side_effect=RuntimeError("can't start new thread")))
    with said.said_after(0.0, lambda: "at work"):
        pass
    ours = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__="rbfmu"))})
    listener = said.Announcer()
    listener.on_start(ours)
    listener.on_end(ours)
