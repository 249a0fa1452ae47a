"""`feedthrough`: what outputs follow at once when inputs change, against the outputs before and after the change."""

import numpy as np
import pytest

from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu.studies.dop853 import LOADED_DOP853, Dop853Plan
from rbfmu_kernels.body import memory, outputs
from rbfmu_kernels.models.prescribed_rates import PRESCRIBED_RATES
from rbfmu_kernels.quantities import OUTPUT
from tests.kernels.models.test_output_rates import LOADS

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
