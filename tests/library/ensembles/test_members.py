"""Members of an ensemble: each is the scene that a user would have written, and is run by one plan for all."""

import numpy as np
import pytest

import rbfmu
from rbfmu.ensembles.members import draw, member, refusals
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.scene.keys import scene_keys
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import LOADS

TABLES = {
    "name": "dispersed",
    "body": {"mass": 50.0, "shape": {"kind": "box", "sides": [0.6, 0.5, 0.4]}},
    "initial": {"attitude": {"euler": "ZYX", "angles_deg": [10.0, 0.0, 0.0]}, "omega_b": [0.1, 0.0, 1.0]},
    "loads": {"torque_b": [0.0, 0.0, 0.1], "gravity_a": [0.0, 0.0, 0.0]},
    "outputs": {"quantities": ["quaternion", "omega_b"]},
    "run": {"stop": 5.0, "step": 0.5},
}
VARY = {
    "body.mass": {"normal": [50.0, 0.5]},
    "body.inertia": {"relative": 0.02, "axes_deg": 1.0},
    "initial.omega_b": {"uniform": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]]},
    "initial.attitude": {"rotvec_deg": 2.0},
    "loads.torque_b": {"normal": [[0.0, 0.0, 0.1], [0.0, 0.0, 0.01]]},
}


def ensemble(vary=VARY, tables=TABLES, **more):
    return Scene.from_dict(tables | {"ensemble": {"runs": 50, "seed": 7, "vary": vary} | more})


def test_a_member_has_what_was_applied_to_the_bit():
    scene = ensemble()
    samples = draw(scene, 10, 5)
    for row in range(5):
        one = member(scene, samples, row)
        assert one.ensemble is None
        assert one.body.mass == samples.applied["body.mass"][row]
        assert one.body.inertia == tuple(map(tuple, samples.applied["body.inertia"][row].tolist()))
        assert one.initial.quaternion == tuple(samples.applied["initial.attitude"][row].tolist())
        assert one.initial.omega_b == tuple(samples.applied["initial.omega_b"][row].tolist())
        assert one.loads.torque_b == tuple(samples.applied["loads.torque_b"][row].tolist())
        assert one.run == scene.run
        assert one.outputs == scene.outputs


NUMBERS = {
    "body.mass": 1.0, "body.inertia": [1.0, 1.1, 1.2], "body.r_oc_b": [0.1] * 3,
    "body.shape.sides": [0.6, 0.5, 0.4], "body.shape.length": 2.0, "body.shape.radius": 0.5,
    "body.shape.semiaxes": [1.0] * 3,
    "initial.position": [1.0] * 3, "initial.velocity": [1.0] * 3, "initial.omega_b": [0.1] * 3,
    "initial.omega_b_deg": [5.0] * 3, "initial.attitude.angles_deg": [10.0] * 3, "initial.attitude.angles": [0.1] * 3,
    "initial.attitude.rotvec": [0.1] * 3,
} | {f"loads.{load.name}": [1.0] * 3 for load in LOADS}  # fmt: skip
SHAPES = {"sides": "box", "length": "beam", "radius": "sphere", "semiaxes": "ellipsoid"}
ONE_BY_ONE = [key.path for key in scene_keys() if key.table.split(".")[0] in ("body", "initial", "loads") and key.unit]


@pytest.mark.parametrize("path", ONE_BY_ONE)
def test_every_number_of_body_start_and_loads_can_vary(path):
    mean, name = NUMBERS[path], path.rpartition(".")[2]
    initial = {"attitude": {"euler": "ZYX", "angles": [0.0, 0.0, 0.0]}}
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    if path.startswith("body.shape"):
        body = {"mass": 1.0, "shape": {"kind": SHAPES[name], name: mean}}
    vary = {path: {"normal": [mean, [0.01] * 3 if isinstance(mean, list) else 0.01]}}
    scene = Scene.from_dict({"body": body, "initial": initial, "ensemble": {"runs": 2, "vary": vary}})
    samples = draw(scene, 0, 2)
    one, other = (member(scene, samples, row) for row in range(2))
    assert one != other
    assert plan_ensemble(scene.replace({"run.stop": 0.02})).model


def test_quaternions_and_matrices_of_the_attitude_vary_by_rotation_vectors():
    assert {"initial.attitude.quaternion", "initial.attitude.matrix"} == {
        key.path for key in scene_keys() if key.table == "initial.attitude" and not key.unit and key.name != "euler"
    }


def test_a_shape_s_inertia_follows_the_member_s_mass():
    scene = ensemble({"body.mass": {"normal": [50.0, 5.0]}})
    samples = draw(scene, 0, 3)
    for row, mass in enumerate(samples.applied["body.mass"].tolist()):
        written = Scene.from_dict(TABLES | {"body": TABLES["body"] | {"mass": mass}})
        assert member(scene, samples, row).body == written.body


def test_a_member_that_a_scene_refuses_is_told_with_the_message_of_its_check():
    scene = ensemble({"body.mass": {"normal": [50.0, 50.0]}})
    samples = draw(scene, 0, 50)
    negative = np.flatnonzero(samples.applied["body.mass"] <= 0.0)
    found = refusals(scene, samples)
    assert len(negative)
    assert list(found) == negative.tolist()
    assert all("body.mass = -" in text and f"member {row}" in text for row, text in found.items())


def test_one_plan_serves_all_members():
    scene = ensemble()
    planned, samples = plan_ensemble(scene), draw(scene, 0, 5)
    for row in range(5):
        result = rbfmu.simulate(member(scene, samples, row), planned=planned)
        assert np.isfinite(result.quaternion).all()


def test_a_slender_beam_s_members_are_checked_one_by_one():
    """A rate about the axis without inertia is no motion; one across it is."""
    beam = {"mass": 2.0, "shape": {"kind": "beam", "length": 1.0}}
    along = {"initial.omega_b": {"normal": [[0.0, 0.0, 1.0], [0.1, 0.0, 0.1]]}}
    across = {"initial.omega_b": {"normal": [[0.0, 0.0, 1.0], [0.0, 0.1, 0.1]]}}
    turning, steady = (ensemble(vary, TABLES | {"body": beam, "initial": {}, "loads": {}}) for vary in (along, across))
    found = refusals(turning, draw(turning, 0, 5))
    assert sorted(found) == [0, 1, 2, 3, 4]
    assert all("initial.omega_b" in text and "no rate about (1, 0, 0)" in text for text in found.values())
    assert not refusals(steady, draw(steady, 0, 5))
