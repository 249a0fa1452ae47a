"""Formulas that leave a closed form closed: own outputs alone, and loads that come to those of a scene."""

import numpy as np
import pytest

import rbfmu
from rbfmu.planning.methods import whole_series
from rbfmu.runs.plan import Plan
from rbfmu_kernels.buffer import OK, STEP_REJECTED

BODY = {"mass": 2.0, "inertia": [0.3, 0.4, 0.5]}
TURNING = {"omega_b": [0.1, 2.0, 0.3], "velocity": [1.0, 2.0, 3.0], "position": [1.0, 0.0, 0.0]}
ABOUT_Z = {"omega_b": [0.0, 0.0, 3.0]}
FREE, ONE_AXIS, SPIN_UP, NONE = "torque-free body", "one axis", "symmetric body spun up", "no rotation"


def scene(loads=None, own=None, quantities=("omega_b",), initial=TURNING, **more):
    tables = {
        "body": BODY | more.pop("body", {}), "initial": initial, "constants": {"k": 0.5, "c": 0.2},
        "loads": loads or {}, "outputs": {"quantities": list(quantities), **(own or {})},
        "run": {"start": 3.0, "stop": 5.0, "step": 0.1, "accuracy": 1e-9},
    }  # fmt: skip
    return rbfmu.Scene.from_dict(tables | more, "it")


# Own outputs


OWN = {
    "wave": "k*sin(t)*R_ab[1,1]", "far": "position + velocity", "spin": "norm(omega_b)",
    "total_energy": "total_energy",
}  # fmt: skip


def test_own_outputs_leave_a_closed_form_closed():
    one = scene(own=OWN, body={"r_oc_b": [0.1, 0.0, 0.2]})
    planned = rbfmu.plan(one)
    assert (planned.model, planned.tolerance) == (FREE, 0.0)
    assert any("own outputs: functions of this motion" in line for line in planned.reasons)
    assert not planned.pinned  # as of a closed form that is exact
    found, plain = rbfmu.simulate(one), rbfmu.simulate(one.replace({"outputs.quantities": ["omega_b"]}))
    R = rbfmu.simulate(scene(quantities=("quaternion",), body={"r_oc_b": [0.1, 0.0, 0.2]})).quaternion
    expected = 0.5 * np.sin(found.time) * (1.0 - 2.0 * (R[:, 2] ** 2 + R[:, 3] ** 2))
    np.testing.assert_allclose(found.wave.ravel(), expected, rtol=0, atol=4e-15)
    np.testing.assert_array_equal(found.omega_b, plain.omega_b)
    energy = found.total_energy.ravel()
    np.testing.assert_allclose(energy, energy[0], rtol=1e-13)
    series = rbfmu.simulate(one, planned=whole_series(one, 16, 1e-15))
    for name in one.outputs.names:
        np.testing.assert_allclose(getattr(found, name), getattr(series, name), rtol=0, atol=1e-12)


def test_its_plan_is_read_back_and_its_steps_are_those_of_a_run():
    one = scene(own=OWN, inputs={"parameters": ["k", "omega_b_0"]})
    planned = rbfmu.plan(one)
    assert Plan.from_dict(planned.to_dict()).of_scene(one).kernels is planned.kernels
    simulator = rbfmu.Simulator(one, k=3.0, omega_b_0=[1.0, 2.0, 3.0])
    other = rbfmu.simulate(one.replace({"constants.k": 3.0, "initial.omega_b": [1.0, 2.0, 3.0]}), planned=planned)
    simulator.step()
    saved = simulator.save()
    simulator.step()
    kept = simulator.wave
    simulator.restore(saved)
    simulator.step()
    assert simulator.wave == kept == other.wave[2]
    assert simulator.time == other.time[2]


@pytest.mark.parametrize("changed", [
    {"body.inertia": [[0.3, 0.02, 0.01], [0.02, 0.4, 0.03], [0.01, 0.03, 0.5]]},
    {"loads.gravity_a": [1.0, 2.0, -3.0]},
    {"loads.force_a": [1.0, 0.0, -2.0]},
    {"body.r_oc_b": [0.1, -0.2, 0.3]},
])  # fmt: skip
def test_own_outputs_read_parameters_that_were_zero(changed):
    """A closed form serves with other values of what nobody lists; own outputs took what was zero for zero."""
    one = scene(own=OWN)
    parameter = {key.partition(".")[2]: value for key, value in changed.items()}
    expected = rbfmu.simulate(one.replace(changed))
    begun, reset = rbfmu.Simulator(one, **parameter), rbfmu.Simulator(one)
    reset.reset(**parameter)
    for simulator in (begun, reset):
        assert simulator.plan.model == FREE
        simulator.step()
        for name in OWN:
            np.testing.assert_array_equal(getattr(simulator, name), expected.quantities[name][1])


def test_a_step_is_refused_where_an_own_output_is_not_finite_and_all_is_as_it_was():
    one = scene(own={"end": "log(10*k - t)"}, constants={"k": 1.0}, inputs={"parameters": ["k"]})
    planned = rbfmu.plan(one)
    assert planned.model == FREE
    simulator = rbfmu.Simulator(one, k=0.35)
    z, kernels = simulator.buffer(), planned.kernels
    assert kernels.step(z, 0.25) == OK
    shown = slice(0, kernels.BLOCKS["series.kept"].start)
    before = z[shown].copy()
    assert kernels.step(z, 0.5) == STEP_REJECTED
    np.testing.assert_array_equal(z[shown], before)
    assert kernels.step(z, 0.125) == OK


# Loads


@pytest.mark.parametrize(("texts", "plain", "initial", "body", "model"), [
    ({"torque_b": "-c*omega_b"}, {"damping_b": [0.2] * 3}, ABOUT_Z, {}, ONE_AXIS),
    ({"torque_b": "[0, 0, k] - [0.1*omega_b[1], 0.3*omega_b[2], c*omega_b[3]]"},
     {"torque_b": [0, 0, 0.5], "damping_b": [0.1, 0.3, 0.2]}, ABOUT_Z, {}, ONE_AXIS),
    ({"torque_b": "[0, 0, k]"}, {"torque_b": [0, 0, 0.5]}, TURNING, {"inertia": [1, 1, 2]}, SPIN_UP),
    ({"force_a": "-mass*[0, 0, 2]"}, {"force_a": [0, 0, -4]}, TURNING, {}, FREE),
    ({"potential": "mass*3*position[3]"}, {"force_a": [0, 0, -6]}, TURNING, {}, FREE),
    ({"torque_b": "0*omega_b"}, {}, TURNING, {}, FREE),
])  # fmt: skip
def test_loads_that_are_those_of_a_scene_take_its_model_and_bits(texts, plain, initial, body, model):
    quantities = ("omega_b",) if model == SPIN_UP else ("quaternion", "position")
    by_text, by_numbers = (scene(loads, None, quantities, initial, body=body) for loads in (texts, plain))
    planned = rbfmu.plan(by_text)
    assert planned.model == rbfmu.plan(by_numbers).model == model
    found, expected = rbfmu.simulate(by_text, planned=planned), rbfmu.simulate(by_numbers)
    for name in quantities:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_plan_serves_other_constants_of_its_loads():
    one = scene({"torque_b": "[0, 0, k] - c*omega_b"}, initial=ABOUT_Z)
    other = one.replace({"constants.k": 0.7, "constants.c": 0.1})
    found = rbfmu.simulate(other, planned=rbfmu.plan(one))
    np.testing.assert_array_equal(found.omega_b, rbfmu.simulate(other).omega_b)
    with pytest.raises(rbfmu.SceneError, match="damping_b"):
        rbfmu.simulate(one.replace({"constants.c": -0.1}), planned=rbfmu.plan(one))


@pytest.mark.parametrize("more", [
    {"loads": {"torque_b": "[t, 0, 0]"}},
    {"states": {"u": {"start": 1.0, "rate": "-u"}}},
    {"inputs": {"ports": [{"name": "wind"}]}, "own": {"pull": "wind*omega_b[1]"}},
    {"own": {"wave": "sin(t)"}, "quantities": ()},  # of which no motion is asked
    {"loads": {"torque_b": "0.1*omega_b"}},  # what drives is no damping
    {"loads": {"torque_b": "-c*[omega_b[1], omega_b[2], omega_b[2]]"}},
    {"loads": {"torque_a": "-c*omega_b"}},
    {"loads": {"torque_b": "where(omega_b[3] > 1, 0.1, 0.2)*[0, 0, 1]"}},
    {"loads": {"torque_b": "to_b([0, 0, 1])"}},
    {"loads": {"torque_b": "-c*omega_b", "damping_b": [0.1, 0.1, 0.1]}},
    {"loads": {"torque_b": "[0, 0, k]"}, "inputs": {"parameters": ["k"]}},
])  # fmt: skip
def test_what_is_more_than_own_outputs_and_loads_of_a_scene_is_integrated(more):
    assert rbfmu.plan(scene(**{"initial": ABOUT_Z, "own": {"spin": "norm(omega_b)"}, **more})).model == "formulas"
