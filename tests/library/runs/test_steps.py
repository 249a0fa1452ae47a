"""Steps that are taken by a compiled loop: the bits, errors and ends of those that are taken one by one."""

from dataclasses import replace

import numpy as np
import pytest
from numba import config, float64

import rbfmu
from rbfmu.exceptions import SimulationError
from rbfmu.planning.methods import whole_series
from rbfmu.planning.select import plan
from rbfmu.runs import steps
from rbfmu.runs.inputs import HOLD, drive_of, undriven
from rbfmu.runs.steps import FIRST, LONG, Steps, record, substeps_counted

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="there is no loop")
RNG = np.random.default_rng(24)
BODY = {"body": {"mass": 2.0, "inertia": [1.0, 1.5, 2.0], "r_oc_b": [0.1, 0.0, -0.2]}}
START = {"initial": {"omega_b": [0.4, -0.3, 0.8]}}
RUN = {"run": {"stop": 5.0, "step": 0.02, "accuracy": 1e-8}}
PORT = BODY | START | RUN | {"inputs": {"ports": ["torque_b", "force_a"]}}
DRAG = {"loads": {"torque_b": "-0.1*norm(omega_b)*omega_b"}, "inputs": {"ports": ["torque_b"]}}
RATES = {"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}} | RUN
TABLE = np.array([0.0, 0.51, 1.333, 5.0]), RNG.normal(size=(4, 3))
SCENES = {
    "free": (BODY | START | RUN, {}),
    "held": (PORT, {"inputs": {"torque_b": TABLE, "force_a": RNG.normal(size=(250, 3))}}),
    "linear": (PORT, {"inputs": {"torque_b": TABLE}, "interpolate": "linear"}),
    "rates": (RATES, {"inputs": {"omega_b": TABLE}, "interpolate": "linear"}),
    "formula": (BODY | START | RUN | DRAG, {"inputs": {"torque_b": TABLE}, "interpolate": "linear"}),
}


@pytest.fixture
def calls(monkeypatch):
    """What the loop is called for: the steps from ... to ..."""
    loop, found = steps._compiled_loop(), []
    noted = lambda *args: found.append(args[-4:-2]) or loop(*args)  # noqa: E731
    monkeypatch.setattr(steps, "_compiled_loop", lambda: noted)
    return found


def both_ways(make, planned, monkeypatch):
    """What steps make one by one, and many at once."""
    planned.kernels.step.compile((float64[::1], float64))
    for before in (-(10**9), LONG + 1):
        monkeypatch.setattr(Steps, "taken_by_all", before)
        yield make()


@pytest.mark.parametrize("name", [*[*SCENES][:-1], pytest.param("formula", marks=pytest.mark.thorough)])
def test_a_loop_leaves_the_rows_of_single_steps(name, calls, monkeypatch):
    tables, driven = SCENES[name]
    scene, told = rbfmu.Scene.from_dict(tables), []
    planned = plan(scene)

    def run():
        told.clear()
        numbers = lambda given: (told.append(k) or k for k in given)  # noqa: E731
        return rbfmu.simulate(scene, planned=planned, progress=numbers, **driven)

    one_by_one, at_once = both_ways(run, planned, monkeypatch)
    assert told == list(range(1, 251))
    assert calls[0][0] == 1
    assert calls[0][1] <= 1 + FIRST
    assert calls[-1][1] == 250
    for quantity, rows in one_by_one.quantities.items():
        np.testing.assert_array_equal(rows, at_once.quantities[quantity], strict=True)


def test_a_model_without_input_derivatives_takes_its_steps_one_by_one(calls, monkeypatch):
    """The mean of a step, and the last value after it: a loop would leave the mean at communication points."""
    point = {"body": {"mass": 2.0, "inertia": [1.0, 1.5, 2.0]}, "inputs": {"ports": ["force_a"]}}
    scene = rbfmu.Scene.from_dict(point | RUN | {"outputs": {"quantities": ["position", "acceleration"]}})
    planned, driven = plan(scene), {"inputs": {"force_a": TABLE}, "interpolate": "linear"}
    assert "force_a_rate" not in planned.kernels.BLOCKS
    calls.clear()  # of the plan's own runs
    one_by_one, many = both_ways(lambda: rbfmu.simulate(scene, planned=planned, **driven), planned, monkeypatch)
    np.testing.assert_array_equal(one_by_one.acceleration, many.acceleration)
    assert not calls


@pytest.mark.parametrize("told", [(), (100,), (1, 30, 99, 100), (100, 1)])
def test_a_run_ends_where_who_wraps_its_numbers_stops(told, calls, monkeypatch):
    scene = rbfmu.Scene.from_dict(PORT)
    planned, whole = plan(scene), rbfmu.simulate(scene)
    for run in both_ways(lambda: rbfmu.simulate(scene, planned=planned, progress=lambda _: told), planned, monkeypatch):
        rows = 1 + max(told, default=0)
        np.testing.assert_array_equal(run.time, whole.time[:rows], strict=True)
        for name, shown in run.quantities.items():
            np.testing.assert_array_equal(shown, whole.quantities[name][:rows], strict=True)


def test_a_first_call_of_the_loop_is_short_where_steps_are_long(calls, monkeypatch):
    scene = rbfmu.Scene.from_dict(PORT)
    planned, drive = plan(scene), undriven(np.diff(scene.run.grid()).tolist())
    monkeypatch.setattr(steps, "SOON", 0.0)  # any step takes longer
    calls.clear()  # of the plan's own runs
    for _ in both_ways(lambda: record(Steps(scene, planned, drive, ()), ("omega_b",)), planned, monkeypatch):
        pass
    assert calls == [(k, k + 1) for k in range(1, 250)]


def test_a_step_that_is_refused_in_a_loop_is_named(calls, monkeypatch):
    tables = BODY | START | RUN | {"loads": {"torque_b": [0.0, 0.0, 0.0]}, "inputs": {"ports": ["torque_b"]}}
    scene, rows = rbfmu.Scene.from_dict(tables), np.zeros((250, 3))
    rows[100:] = 1e300
    planned = plan(scene)

    def message():
        with pytest.raises(SimulationError) as refused:
            rbfmu.simulate(scene, planned=planned, inputs={"torque_b": rows})
        return str(refused.value)

    one_by_one, at_once = both_ways(message, planned, monkeypatch)
    assert one_by_one == at_once
    assert "the step from t = 2.0 s was refused" in at_once
    assert calls


def test_a_loop_ends_after_so_many_substeps(calls, monkeypatch):
    scene = rbfmu.Scene.from_dict(PORT)
    planned = plan(scene)
    drive = undriven(np.diff(scene.run.grid()).tolist())
    ends = both_ways(lambda: record(Steps(scene, planned, drive, ()), ("omega_b",), 3.0), planned, monkeypatch)
    one_by_one, at_once = (found["omega_b"] for found in ends)
    assert 1 < np.isfinite(at_once[:, 0]).sum() < 250
    np.testing.assert_array_equal(one_by_one, at_once)
    assert calls


def test_too_many_substeps_are_said_of_the_time_up_to_which_they_go():
    scene = rbfmu.Scene.from_dict(PORT | {"run": {"start": 1.0, "stop": 6.0, "step": 0.02, "accuracy": 1e-8}})
    make = lambda: Steps(scene, planned, drive_of(scene, {}, HOLD), ["omega_b"])  # noqa: E731
    planned, most = plan(scene), 20.0
    with pytest.raises(SimulationError) as refused:
        make().course(["omega_b"], most=most)
    run, k = make(), 0
    while substeps_counted(run.kernels, run.z) <= most:
        k += 1
        assert run.advance(k)
    assert f": t = {float(scene.run.grid()[k])!r} s takes " in str(refused.value)


def test_a_run_that_is_over_stays_so_in_a_loop(calls, monkeypatch):
    scene = rbfmu.Scene.from_dict(PORT)
    planned, lengths = plan(scene), np.diff(scene.run.grid()).tolist()

    def ended():
        run = Steps(scene, planned, undriven(lengths), ())
        at, rows, k = run.places(["omega_b"]), np.zeros((251, 3)), 0
        while (taken := run.take(k + 1, at, rows, 3.0)) > k:
            k = taken
        z = run.z.copy()
        return k, run.take(k + 1, at, rows), rows, z, run.z

    one_by_one, at_once = both_ways(ended, planned, monkeypatch)
    assert 1 < at_once[0] == at_once[1] < 250
    assert not at_once[2][at_once[0] + 1 :].any()
    for found, other in zip(one_by_one, at_once, strict=True):
        np.testing.assert_array_equal(found, other)


def test_steps_in_parts_are_as_long_as_steps_and_counted(calls, monkeypatch):
    scene = rbfmu.Scene.from_dict(BODY | START | RUN)
    planned, every_second, shown = plan(scene), np.diff(scene.run.grid())[::2].tolist(), ("quaternion",)
    planned.kernels.step.compile((float64[::1], float64))
    for before in (-(10**9), LONG + 1):
        monkeypatch.setattr(Steps, "taken_by_all", before)
        in_parts = record(Steps(scene, planned, undriven(every_second, 2), shown), shown)["quaternion"]
        assert Steps.taken_by_all == before + 250
        whole = record(Steps(scene, planned, undriven(every_second), shown), shown)["quaternion"]
        np.testing.assert_allclose(in_parts, whole, rtol=0.0, atol=1e-13)
    assert calls


def test_the_loop_calls_no_step_that_it_would_have_to_compile(monkeypatch):
    """It was kept by its signature, so that each process compiled it anew."""
    scene = rbfmu.Scene.from_dict(PORT)
    planned = plan(scene)
    planned.kernels.step.compile((float64[::1], float64))
    monkeypatch.setattr(Steps, "taken_by_all", LONG + 1)
    run = Steps(scene, planned, undriven(np.diff(scene.run.grid()).tolist()), ())
    assert run.advance(1)
    assert run._goes_in_a_loop
    monkeypatch.setattr(planned.kernels.step, "overloads", {})
    assert not run._goes_in_a_loop


def test_a_run_whose_outputs_are_interpolated_is_taken_whole():
    scene = rbfmu.Scene.from_dict(BODY | START | RUN | {"loads": {"torque_b": [0.1, 0.05, -0.2]}})
    stepped = whole_series(scene, 8, 1e-9)
    whole, drive = replace(stepped, interpolated=True), undriven(np.diff(scene.run.grid()).tolist())
    found = rbfmu.simulate(scene, planned=whole)
    assert not np.array_equal(found.omega_b, rbfmu.simulate(scene, planned=stepped).omega_b)
    early = rbfmu.simulate(scene, planned=whole, progress=lambda numbers: numbers[:7])
    np.testing.assert_array_equal(early.omega_b, found.omega_b[:8])
    ended = record(Steps(scene, whole, drive, ()), ("omega_b",), 3.0)["omega_b"]
    assert np.isfinite(ended[0]).all()
    assert np.isnan(ended[1:]).all()


def test_no_outputs_are_interpolated_where_inputs_may_change():
    scene = rbfmu.Scene.from_dict(PORT)
    planned = replace(whole_series(scene, 12, 1e-9), interpolated=True)
    with pytest.raises(ValueError, match=r"Plan.interpolated = True: expected a plan by rbfmu\.plan, as the scene has"):
        rbfmu.simulate(scene, planned=planned)
