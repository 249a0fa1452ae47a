"""Outputs' derivatives: with respect to time against differences, by inputs against what follows at once."""

import numpy as np
import pytest
from numba import config

from rbfmu.models.question import Question
from rbfmu.planning.fitting import cheapest_fit
from rbfmu.planning.judge import Judge
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import QUANTITIES, Scene
from rbfmu.studies.dop853 import LOADED_DOP853, Dop853Plan
from rbfmu_kernels.body import memory, outputs
from rbfmu_kernels.buffer import NO_OUTPUTS, OK
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from rbfmu_kernels.models.prescribed_rates import OUTPUTS, PRESCRIBED_RATES
from rbfmu_kernels.quantities import OUTPUT

LOADS = {
    "gravity_a": [0.1, -0.3, -1.0], "force_b": [1.0, 0.5, 0.2], "force_a": [0.3, 0.1, -0.4],
    "torque_b": [0.1, 0.2, 0.1], "torque_a": [0.05, 0.3, 0.02], "damping_b": [0.1, 0.05, 0.02],
}  # fmt: skip
H = 1e-3


def body_at(pivot):
    body = {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]], "r_oc_b": [0.1, -0.2, 0.3]}
    initial = {"omega_b": [1.0, 2.0, -1.0], "attitude": {"rotvec": [0.3, -0.8, 0.5]}}
    initial |= {} if pivot else {"position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, 0.3]}
    run = {"stop": 4 * H, "step": H, "accuracy": 1e-13}
    scene = Scene(body=body | {"pivot": pivot}, initial=initial, loads=LOADS, run=run)
    z = filled_buffer(scene, Dop853Plan("body under loads", "DOP853", 13, tolerance=1e-15))
    z[LOADED_DOP853.BLOCKS["active"]] = 1.0
    initialize(scene, LOADED_DOP853, z)
    return z


def block(z, name):
    return z[LOADED_DOP853.BLOCKS[name]].copy()


def test_output_rates_are_the_outputs_differences():
    """Five points, order 4: error h^4 / 30 times the fifth derivative, some 1e-11, and round-off eps / h."""
    for pivot in (False, True):
        z = body_at(pivot)
        values = [z.copy()]
        for k in range(4):
            assert LOADED_DOP853.step(z, H) == OK
            values.append(z.copy())
            if k == 1:
                assert outputs.output_rates(z) == 0
                rates = z.copy()
        differences = (values[0] - 8.0 * values[1] + 8.0 * values[3] - values[4]) / (12.0 * H)
        for name in memory.OUTPUTS:
            rate = block(rates, f"d_{name}")
            np.testing.assert_allclose(rate, block(differences, name), rtol=1e-9, atol=1e-9, err_msg=f"{name} {pivot}")
            assert np.any(rate != 0.0) or (pivot and name in ("position", "velocity", "acceleration"))


def test_a_start_whose_outputs_alone_are_not_finite_is_told_so():
    z = body_at(False)
    z[LOADED_DOP853.BLOCKS["omega_b_0"]] = 1e200
    with np.errstate(all="ignore"):
        assert LOADED_DOP853.initialize(z) == NO_OUTPUTS


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="fits by pilot runs")
def test_what_nobody_wants_is_not_computed():
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, loads={"torque_b": [0.1, 0.0, 0.2]},
                  outputs={"quantities": ["omega_b"]})  # fmt: skip
    z = filled_buffer(scene, cheapest_fit(asked := Question(scene), Judge(asked)))
    initialize(scene, LOADED_TAYLOR, z)
    assert LOADED_TAYLOR.step(z, 0.1) == OK
    assert np.any(block(z, "omega_b") != 0.0)
    assert all(np.all(block(z, name) == 0.0) for name in memory.OUTPUTS if name != "omega_b")


def test_flags_of_unwanted_outputs_stand_in_the_order_of_the_quantities():
    assert tuple(memory.OUTPUTS) == QUANTITIES


def test_output_rates_of_prescribed_rates_are_differences_too():
    scene = Scene(inputs={"ports": ["omega_b"]}, initial={"attitude": {"rotvec": [0.3, -0.8, 0.5]}})
    z, blocks = filled_buffer(scene, Plan("prescribed rates", "", 4)), PRESCRIBED_RATES.BLOCKS
    initialize(scene, PRESCRIBED_RATES, z)
    values = []
    for k in range(5):
        z[blocks["omega_b"]] = [0.3, -1.2, 0.7]
        PRESCRIBED_RATES.outputs(z)
        values.append(z.copy())
        if k == 2:
            assert PRESCRIBED_RATES.output_rates(z) == OK
            rates = z.copy()
        assert PRESCRIBED_RATES.step(z, H) == OK
    differences = (values[0] - 8.0 * values[1] + 8.0 * values[3] - values[4]) / (12.0 * H)
    for name in OUTPUTS:
        rate, difference = rates[blocks[f"d_{name}"]], differences[blocks[name]]
        np.testing.assert_allclose(rate, difference, rtol=1e-9, atol=1e-9, err_msg=name)


# What follows at once when inputs change


INERTIA = [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]]
PORTS = {"force_a": [0.3, -2.0, 1.1], "force_b": [1.7, 0.2, -0.6], "torque_a": [-0.4, 0.9, 2.0],
         "torque_b": [0.8, -1.3, 0.5]}  # fmt: skip


def body(pivot, loads, omega):
    initial = {"omega_b": omega, "attitude": {"rotvec": [0.3, -0.8, 0.5]}}
    tables = {"mass": 2.0, "inertia": INERTIA, "r_oc_b": [0.1, -0.2, 0.3], "pivot": pivot}
    scene = Scene(body=tables, initial=initial, loads=loads)
    z = filled_buffer(scene, Dop853Plan("body under loads", "DOP853", 13, tolerance=1e-9))
    z[LOADED_DOP853.BLOCKS["active"]] = 1.0
    initialize(scene, LOADED_DOP853, z)
    return z


def followed(z, name, change):
    """(what feedthrough says, outputs before, outputs after) of a change of one input."""
    said, blocks = np.zeros_like(z), LOADED_DOP853.BLOCKS
    said[blocks[name]] = change
    assert outputs.feedthrough(z, said) == 0
    outputs.outputs(z)
    before = z.copy()
    z[blocks[name]] += change
    outputs.outputs(z)
    return [{n: buffer[blocks[n]] for n in memory.OUTPUTS} for buffer in (said, before, z)]


@pytest.mark.parametrize("pivot", [False, True])
@pytest.mark.parametrize("name", PORTS)
def test_outputs_change_by_what_feedthrough_says(name, pivot):
    """They are linear in the inputs, so that a change of any size shows it; round-off of what was there already."""
    said, before, after = followed(body(pivot, LOADS, [1.0, 2.0, -1.0]), name, PORTS[name])
    for output, row in OUTPUT.items():
        np.testing.assert_allclose(said[output], after[output] - before[output], rtol=1e-14, atol=1e-14)
        assert np.any(said[output] != 0.0) <= (name in row.feedthrough)
    if name.startswith("torque") or not pivot:
        assert np.all(said["alpha_b"] != 0.0)
    if not pivot:
        assert np.all(said["acceleration"] != 0.0)


@pytest.mark.parametrize("pivot", [False, True])
@pytest.mark.parametrize("name", PORTS)
def test_at_rest_and_unloaded_feedthrough_is_the_outputs_to_the_bit(name, pivot):
    z = body(pivot, {"gravity_a": [0.0, 0.0, 0.0]}, [0.0, 0.0, 0.0])
    said, _, after = followed(z, name, PORTS[name])
    for output in ("acceleration", "alpha_b"):
        assert said[output].tolist() == after[output].tolist()


def test_of_prescribed_rates_it_is_their_part_of_omega_a():
    scene = Scene(inputs={"ports": ["omega_b"]}, initial={"attitude": {"rotvec": [0.3, -0.8, 0.5]}})
    z, blocks = filled_buffer(scene, Plan("prescribed rates", "", 4)), PRESCRIBED_RATES.BLOCKS
    initialize(scene, PRESCRIBED_RATES, z)
    said = np.zeros_like(z)
    said[blocks["omega_b"]] = z[blocks["omega_b"]] = [0.3, -1.2, 0.7]
    assert PRESCRIBED_RATES.feedthrough(z, said) == PRESCRIBED_RATES.outputs(z) == 0
    assert said[blocks["omega_a"]].tolist() == z[blocks["omega_a"]].tolist()
    assert not said[blocks["quaternion"]].any()
    assert not said[blocks["rpy"]].any()
