"""What names, shapes and energies a scene's formulas may not have, and loads about a point that may be moved."""

import numpy as np
import pytest

import rbfmu
from rbfmu.runs.steps import motion_of

BODY = {"body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}}
PORT = {"inputs": {"ports": [{"name": "u", "size": 1}]}}
TRIP = {"events": {"trip": "omega_b[1] - 1"}}
SPRING = {"loads": {"potential": "dot(position, position)"}, "outputs": {"quantities": ["total_energy"]}}


@pytest.mark.parametrize(("tables", "said"), [
    (PORT | {"outputs": {"u_rate_2": "2*u"}}, r"outputs\.u_rate_2: expected another name: u_rate_2 means"),
    (TRIP | {"constants": {"trip_time": 1.0}}, r"constants\.trip_time: .* name: that is an FMU's of events\.trip"),
    (TRIP | {"formulas": {"trip_count": "t"}}, r"formulas\.trip_count: .* name: that is an FMU's of events\.trip"),
    ({"outputs": {"two": "[1, 2]"}}, r"outputs\.two\.value: expected a scalar or a vector of 3 numbers"),
    ({"loads": {"potential": "t*position[1]"}}, r"loads\.potential: expected a formula of position and attitude"),
    (SPRING | {"inputs": {"ports": ["torque_b"]}}, r"expected no total_energy: torque_b has no potential"),
    ({**SPRING, "loads": SPRING["loads"] | {"damping_b": [0, 1, 0]}}, r"no total_energy: damping_b has no potential"),
    ({**SPRING, "loads": SPRING["loads"] | {"force_b": [0, 1, 0]}}, r"no total_energy: force_b has no potential"),
])  # fmt: skip
def test_what_means_something_else_or_cannot_be_is_refused(tables, said):
    with pytest.raises(rbfmu.SceneError, match=said):
        rbfmu.Scene.from_dict(BODY | tables)


def test_an_event_of_an_output_that_is_wrong_is_no_fault_of_its_own():
    with pytest.raises(rbfmu.SceneError) as refused:
        rbfmu.Scene.from_dict(BODY | {"outputs": {"x": {"value": "t", "unit": 3}}, "events": {"e": "x - 1"}})
    assert [fault.partition(" = ")[0] for fault in refused.value.faults] == ["outputs.x.unit"]


BALANCED = {"inertia": [[1.0, 0.125, 0.0], [0.125, 1.5, 0.0], [0.0, 0.0, 2.0]], "r_oc_b": [0.25, 0.5, 0.0]}
"""Of 1 kg on a pivot at o, about which no product of inertia is left."""


@pytest.mark.parametrize(("listed", "value", "body"), [
    ("r_oc_b", [0.1, -0.2, 0.3], {}), ("r_oc_b", [0.1, -0.2, 0.3], {"pivot": True}),
    ("mass", 3.0, BALANCED | {"pivot": True}), ("inertia", [[2.0, 0.1, 0.2], [0.1, 2.5, 0.3], [0.2, 0.3, 3.0]], {}),
])  # fmt: skip
def test_formulas_hold_for_other_values_of_parameters_that_are_listed(listed, value, body):
    """Also where a number is zero in the scene, of which no formula would have a term."""
    scene = rbfmu.Scene.from_dict({
        "body": BODY["body"] | body, "initial": {"omega_b": [0.1, 0.2, 0.3]},
        "loads": {"gravity_a": [1, 0, -1], "force_b": [0.0 if body else 0.1, 0, 0], "torque_b": "-0.1*omega_b"},
        "inputs": {"parameters": [listed]}, "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 1.0, "step": 0.5},
    })  # fmt: skip
    changed = scene.replace({f"body.{listed}": value})
    as_an_fmu_has_it = motion_of(changed, rbfmu.plan(scene), [0.5, 0.5], ["omega_b"])["omega_b"]
    truth = rbfmu.simulate(changed.replace({"inputs": None})).omega_b
    np.testing.assert_allclose(as_an_fmu_has_it, truth, rtol=0, atol=1e-6)
