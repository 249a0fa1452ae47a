"""Members of an ensemble: each is the scene that a user would have written, and is run by one plan for all."""

import numpy as np

import rbfmu
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.samples import draw, member, refused
from rbfmu.scene.scene import Scene

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
    found = refused(scene, samples)
    assert len(negative)
    assert list(found) == negative.tolist()
    assert all("body.mass = -" in text and f"member {row}" in text for row, text in found.items())


def test_one_plan_serves_all_members():
    scene = ensemble()
    planned = plan_ensemble(scene)
    samples = draw(scene, 0, 5)
    assert planned.plan_of(samples).tolist() == [0] * 5
    for row in range(5):
        result = rbfmu.simulate(member(scene, samples, row), planned=planned.plans[0])
        assert np.isfinite(result.quaternion).all()
