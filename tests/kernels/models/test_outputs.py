"""Outputs' derivatives: with respect to time against differences, by inputs against what follows at once."""

import numpy as np
import pytest
from numba import config

from rbfmu.models.question import Question
from rbfmu.planning.fitting import cheapest_fit
from rbfmu.planning.judge import Judge
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import QUANTITIES, Scene
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu_kernels.body import memory, outputs
from rbfmu_kernels.buffer import NO_OUTPUTS, OK
from rbfmu_kernels.models.prescribed_rates import OUTPUTS
from rbfmu_kernels.quantities import OUTPUT
from tests.support.scenes.model_cases import OFFSET, TURNED, Unit

LOADS = {
    "gravity_a": [0.1, -0.3, -1.0], "force_b": [1.0, 0.5, 0.2], "force_a": [0.3, 0.1, -0.4],
    "torque_b": [0.1, 0.2, 0.1], "torque_a": [0.05, 0.3, 0.02], "damping_b": [0.1, 0.05, 0.02],
}  # fmt: skip
H = 1e-3


def loaded(pivot, loads=LOADS, omega=(1.0, 2.0, -1.0)):
    """A body that shows all outputs."""
    initial = {"omega_b": list(omega), "attitude": TURNED}
    initial |= {} if pivot else {"position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, 0.3]}
    scene = Scene(body=OFFSET | {"pivot": pivot}, initial=initial, loads=loads)
    unit = Unit(scene, Dop853Plan("body under loads", "DOP853", 13, tolerance=1e-15))
    unit["active"] = 1.0
    assert unit.kernels.initialize(unit.z) == 0
    return unit


def pendulum():
    body = {"mass": 2.0, "inertia": [1.0, 1.3, 1.7], "r_oc_b": [0.0, 0.3, -0.2], "pivot": True}
    initial = {"attitude": {"rotvec": [0.4, 0.0, 0.0]}, "omega_b": [-2.0, 0.0, 0.0]}
    return Unit(Scene(body=body, initial=initial), Plan("undamped pendulum", "", 2))


def prescribed():
    scene = Scene(inputs={"ports": ["omega_b"]}, initial={"attitude": TURNED})
    unit = Unit(scene, Plan("prescribed rates", "", 4))
    unit["omega_b"] = [0.3, -1.2, 0.7]
    return unit


@pytest.mark.parametrize(("made", "names", "tolerance"), [
    (lambda: loaded(False), memory.OUTPUTS, 1e-9), (lambda: loaded(True), memory.OUTPUTS, 1e-9),
    (pendulum, ("quaternion", "omega_b", "alpha_b"), 1e-8), (prescribed, OUTPUTS, 1e-9),
], ids=["free", "pivot", "pendulum", "prescribed rates"])  # fmt: skip
def test_output_rates_are_the_outputs_differences(made, names, tolerance):
    """Five points, order 4: error h^4 / 30 times the fifth derivative, some 1e-11, and round-off eps / h."""
    unit, rows = made(), []
    for k in range(5):
        rows.append({name: np.atleast_1d(unit.refresh()[name]) for name in names})
        if k == 2:
            assert unit.kernels.output_rates(unit.z) == OK
            rates = {name: unit[f"d_{name}"] for name in names}
        unit.step(H)
    for name, rate in rates.items():
        a, b, _, c, d = (row[name] for row in rows)
        differences = (a - 8.0 * b + 8.0 * c - d) / (12.0 * H)
        np.testing.assert_allclose(rate, differences, rtol=tolerance, atol=tolerance, err_msg=name)
        held = made is prescribed or (unit["pivot"] and name in ("position", "velocity", "acceleration"))
        assert np.any(rate != 0.0) or held


def test_a_start_whose_outputs_alone_are_not_finite_is_told_so():
    unit = loaded(False)
    unit["omega_b_0"] = 1e200
    with np.errstate(all="ignore"):
        assert unit.kernels.initialize(unit.z) == NO_OUTPUTS


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="fits by pilot runs")
def test_what_nobody_wants_is_not_computed():
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, loads={"torque_b": [0.1, 0.0, 0.2]},
                  outputs={"quantities": ["omega_b"]})  # fmt: skip
    unit = Unit(scene, cheapest_fit(asked := Question(scene), Judge(asked))).step(0.1)
    assert {name for name in memory.OUTPUTS if np.any(unit[name] != 0.0)} == {"omega_b"}


def test_flags_of_unwanted_outputs_stand_in_the_order_of_the_quantities():
    assert tuple(memory.OUTPUTS) == QUANTITIES


# What follows at once when inputs change


PORTS = {"force_a": [0.3, -2.0, 1.1], "force_b": [1.7, 0.2, -0.6], "torque_a": [-0.4, 0.9, 2.0],
         "torque_b": [0.8, -1.3, 0.5]}  # fmt: skip


def followed(unit, name, change):
    """(what feedthrough says, outputs before, outputs after) of a change of one input."""
    said, blocks = np.zeros_like(unit.z), unit.kernels.BLOCKS
    said[blocks[name]] = change
    assert outputs.feedthrough(unit.z, said) == 0
    before = unit.refresh().z.copy()
    unit[name] += change
    return [{n: buffer[blocks[n]] for n in memory.OUTPUTS} for buffer in (said, before, unit.refresh().z)]


@pytest.mark.parametrize("pivot", [False, True])
@pytest.mark.parametrize("name", PORTS)
def test_outputs_change_by_what_feedthrough_says(name, pivot):
    """They are linear in the inputs, so that a change of any size shows it; round-off of what was there already."""
    said, before, after = followed(loaded(pivot), name, PORTS[name])
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
    unit = loaded(pivot, {"gravity_a": [0.0, 0.0, 0.0]}, [0.0, 0.0, 0.0])
    said, _, after = followed(unit, name, PORTS[name])
    for output in ("acceleration", "alpha_b"):
        assert said[output].tolist() == after[output].tolist()


def test_of_prescribed_rates_it_is_their_part_of_omega_a():
    unit = prescribed()
    said, blocks = np.zeros_like(unit.z), unit.kernels.BLOCKS
    said[blocks["omega_b"]] = unit["omega_b"]
    assert unit.kernels.feedthrough(unit.z, said) == unit.kernels.outputs(unit.z) == 0
    assert said[blocks["omega_a"]].tolist() == unit["omega_a"].tolist()
    assert not said[blocks["quaternion"]].any()
    assert not said[blocks["rpy"]].any()
