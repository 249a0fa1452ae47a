"""Members of an ensemble: each is the scene that a user would have written, and is run by one plan for all."""

import math

import numpy as np
import pytest
from scipy import stats

import rbfmu
from rbfmu.ensembles.members import draw, for_ends, impossible_rows, member, refusals, thin_rows
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.scene.keys import scene_keys
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import LOADS
from tests.library.ensembles.test_draws import BODY, LIKELY, MANY, ensemble

TABLES = {
    "name": "dispersed", "body": {"mass": 50.0, "shape": {"kind": "box", "sides": [0.6, 0.5, 0.4]}},
    "initial": {"attitude": {"euler": "ZYX", "angles_deg": [10.0, 0.0, 0.0]}, "omega_b": [0.1, 0.0, 1.0]},
    "loads": {"torque_b": [0.0, 0.0, 0.1], "gravity_a": [0.0, 0.0, 0.0]},
    "outputs": {"quantities": ["quaternion", "omega_b"]}, "run": {"stop": 5.0, "step": 0.5},
}  # fmt: skip
VARY = {
    "body.mass": {"normal": [50.0, 0.5]}, "body.inertia": {"relative": 0.02, "axes_deg": 1.0},
    "initial.omega_b": {"uniform": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]]}, "initial.attitude": {"rotvec_deg": 2.0},
    "loads.torque_b": {"normal": [[0.0, 0.0, 0.1], [0.0, 0.0, 0.01]]},
}  # fmt: skip


def dispersed(vary=VARY, tables=TABLES, **more):
    return Scene.from_dict(tables | {"ensemble": {"runs": 50, "seed": 7, "vary": vary} | more})


def test_a_member_has_what_was_applied_to_the_bit():
    scene = dispersed()
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
PARTS = ("body", "initial", "loads")
NO_NUMBER = "loads.potential"
ONE_BY_ONE = [
    key.path for key in scene_keys() if key.table.split(".")[0] in PARTS and key.unit and key.path != NO_NUMBER
]


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


def test_a_shape_s_inertia_follows_the_member_s_mass():
    scene = dispersed({"body.mass": {"normal": [50.0, 5.0]}})
    samples = draw(scene, 0, 3)
    for row, mass in enumerate(samples.applied["body.mass"].tolist()):
        written = Scene.from_dict(TABLES | {"body": TABLES["body"] | {"mass": mass}})
        assert member(scene, samples, row).body == written.body


def test_a_slender_beam_s_members_are_checked_one_by_one():
    """A rate about the axis without inertia is no motion; one across it is."""
    beam = {"mass": 2.0, "shape": {"kind": "beam", "length": 1.0}}
    along = {"initial.omega_b": {"normal": [[0.0, 0.0, 1.0], [0.1, 0.0, 0.1]]}}
    across = {"initial.omega_b": {"normal": [[0.0, 0.0, 1.0], [0.0, 0.1, 0.1]]}}
    turning, steady = (dispersed(vary, TABLES | {"body": beam, "initial": {}, "loads": {}}) for vary in (along, across))
    found = refusals(turning, draw(turning, 0, 5))
    assert sorted(found) == [0, 1, 2, 3, 4]
    assert all("initial.omega_b" in text and "no rate about (1, 0, 0)" in text for text in found.values())
    assert not refusals(steady, draw(steady, 0, 5))


FULL = [[10.0, 1.0, 0.5], [1.0, 12.0, -0.3], [0.5, -0.3, 15.0]]


def test_relative_moments_keep_the_axes_of_a_full_matrix():
    scene = ensemble({"body.inertia": {"relative": 0.03}}, body=BODY | {"inertia": FULL}, runs=500)
    found = draw(scene, 0, 500)
    moments, R_bp = rbfmu.principal_axes(np.array(FULL))
    turned = R_bp.T @ found.applied["body.inertia"] @ R_bp
    factors = np.column_stack([found.drawn[f"body.inertia[{k}]"] for k in (1, 2, 3)])
    assert np.max(np.abs(turned - (factors * moments)[:, None, :] * np.eye(3))) < 1e-13
    assert not found.redrawn.any()


def test_axes_turn_and_leave_the_moments():
    scene = ensemble({"body.inertia": {"axes_deg": [0.0, 0.0, 10.0]}}, runs=200)
    found = draw(scene, 0, 200)
    M, angle = found.applied["body.inertia"], np.radians(found.drawn["body.inertia.axes_deg[3]"])
    assert np.max(np.abs(np.linalg.eigvalsh(M) - [10.0, 12.0, 15.0])) < 1e-13
    assert np.allclose(M[:, 0, 1], (10.0 - 12.0) * np.sin(angle) * np.cos(angle), atol=1e-14)
    assert np.array_equal(M, M.transpose(0, 2, 1))


def test_elements_of_a_matrix_vary_one_by_one():
    spread = [[0.1, 0.01, 0.0], [0.01, 0.1, 0.02], [0.0, 0.02, 0.2]]
    scene = ensemble({"body.inertia": {"normal": [FULL, spread]}}, body=BODY | {"inertia": FULL})
    M = draw(scene, 0, MANY).applied["body.inertia"]
    assert stats.kstest(M[:, 1, 2], stats.norm(-0.3, 0.02).cdf).pvalue > LIKELY
    assert stats.kstest(M[:, 2, 2], stats.norm(15.0, 0.2).cdf).pvalue > LIKELY
    assert np.all(M[:, 0, 2] == 0.5)
    assert np.array_equal(M, M.transpose(0, 2, 1))


@pytest.mark.parametrize("design", ["random", "sobol", "latin_hypercube"])
def test_what_breaks_the_triangle_inequality_is_drawn_again_and_counted(design):
    flat = BODY | {"inertia": [1.0, 2.0, 3.0]}
    scene = ensemble({"body.inertia": {"relative": 0.02}, "body.mass": {"normal": [50.0, 1.0]}}, body=flat, runs=1000,
                     design=design)  # fmt: skip
    found = draw(scene, 0, 1000)
    rbfmu.check_inertia(found.applied["body.inertia"])
    again = found.redrawn
    assert 0.4 < np.mean(again > 0) < 0.6  # half of the draws break it
    assert abs(np.mean(again) - 1.0) < 5.0 * math.sqrt(2.0 / 1000.0)  # geometric: mean 1, variance 2
    assert not refusals(scene, found)
    kept = draw(scene.replace({"ensemble.vary": {"body.mass": {"normal": [50.0, 1.0]}}}), 0, 1000)
    same = kept.applied["body.mass"] == found.applied["body.mass"]
    assert design != "random" or np.array_equal(same, again == 0)


def test_draws_again_are_distributed_as_the_possible_ones():
    """Moments (a, b, c) with c of the scene a + b: the sample kept is that of all draws with c <= a + b."""
    scene = ensemble({"body.inertia": {"relative": 0.02}}, body=BODY | {"inertia": [1.0, 2.0, 3.0]})
    found = draw(scene, 0, MANY)
    c = found.drawn["body.inertia[3]"] * 3.0
    random = np.random.default_rng(5)
    a, b, other = (random.normal(m, 0.02 * m, MANY * 4) for m in (1.0, 2.0, 3.0))
    assert stats.ks_2samp(c, other[other <= a + b]).pvalue > LIKELY


def test_an_impossible_inertia_in_a_grid_is_refused_and_not_drawn_again():
    vary = {"body.inertia": {"uniform": [[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]], "points": [1, 1, 3]}}
    scene = ensemble(vary, runs=3, design="grid")
    found = draw(scene, 0, 3)
    assert not found.redrawn.any()
    assert list(refusals(scene, found)) == [2]
    assert "each principal moment at most the sum of the other two" in refusals(scene, found)[2]


def test_an_inertia_that_is_never_possible_ends_as_a_refused_member():
    vary = {"body.inertia": {"uniform": [[1.0, 1.0, 9.0], [1.1, 1.1, 9.5]]}}
    scene = ensemble(vary, runs=5)
    found = draw(scene, 0, 5)
    assert found.redrawn.tolist() == [100] * 5
    assert sorted(refusals(scene, found)) == list(range(5))


def test_an_inertia_at_the_border_is_possible_as_the_kernels_judge_it():
    scene = ensemble({"body.inertia": {"axes_deg": 1.0}}, body=BODY | {"inertia": [1.0, 2.0, 3.0]}, runs=300)
    assert not draw(scene, 0, 300).redrawn.any()


def test_a_mass_that_is_not_positive_is_refused_and_not_drawn_again():
    vary = {"body.mass": {"normal": [50.0, 50.0]}, "body.inertia": {"relative": 0.001}}
    scene = ensemble(vary, body={"mass": 50.0, "shape": {"kind": "sphere", "radius": 1.0}}, runs=100)
    found = draw(scene, 0, 100)
    negative, refused = np.flatnonzero(found.applied["body.mass"] <= 0.0), refusals(scene, found)
    assert len(negative)
    assert not found.redrawn.any()
    assert list(refused) == negative.tolist()
    assert all("body.mass = -" in text and f"member {row}" in text for row, text in refused.items())


def test_sizes_of_a_shape_vary_and_inertia_follows():
    shape = {"kind": "cylinder", "radius": 0.5, "length": 2.0}
    vary = {"body.shape.radius": {"normal": [0.5, 0.01]}, "body.mass": {"normal": [50.0, 1.0]}}
    scene = ensemble(vary, body={"mass": 50.0, "shape": shape}, runs=30)
    found = draw(scene, 0, 30)
    expected = rbfmu.cylinder_inertia(found.applied["body.mass"], found.applied["body.shape.radius"], 2.0)
    assert np.array_equal(found.applied["body.inertia"], expected)
    assert np.all(found.applied["body.shape.length"] == 2.0)
    row = member(scene, found, 4)
    sizes = shape | {"radius": float(found.applied["body.shape.radius"][4])}
    assert row.body == Scene.from_dict({"body": {"mass": row.body.mass, "shape": sizes}}).body


def test_many_matrices_are_judged_as_one_by_one():
    random = np.random.default_rng(8)
    moments = np.concatenate([random.uniform(0.0, 1.0, (200, 3)), [[1, 2, 3], [0, 1, 1], [0, 1, 1.1], [-1e-3, 1, 1]]])
    R = rbfmu.matrix_from_quaternion(rbfmu.normalize(random.normal(size=(len(moments), 4))))
    M = R @ (moments[:, None, :] * np.eye(3)) @ R.transpose(0, 2, 1)
    M = np.concatenate([0.5 * (M + M.transpose(0, 2, 1)), [np.full((3, 3), np.nan), np.full((3, 3), 1e300)]])
    wanted = [row for row in range(len(M)) if is_refused(M[row])]
    assert impossible_rows(M).tolist() == wanted
    assert 60 < len(wanted) < 140
    assert set(thin_rows(M).tolist()) >= {201, 202, 203, 204}


def is_refused(M):
    try:
        rbfmu.check_inertia(M)
    except ValueError:
        return True
    return False


def brick(**changes):
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "initial": {"omega_b": [0.1, 3.0, 0.2]},
              "loads": {"gravity_a": [0.0] * 3}, "run": {"stop": 20.0, "step": 0.1},
              "ensemble": {"runs": 4, "keep": ["final"], "vary": {"initial.omega_b": {"relative": 0.1}}}}  # fmt: skip
    return rbfmu.Scene.from_dict(tables, "brick").replace(changes)


def test_members_of_which_ends_alone_are_kept_take_one_step():
    found = rbfmu.run_ensemble(brick(), progress=False)
    assert found.time.tolist() == [0.0, 20.0]
    alone = rbfmu.simulate(found.member(2), planned=plan_ensemble(for_ends(brick())))
    assert alone.quaternion[-1].tobytes() == found.final["quaternion"][2].tobytes()
    every = rbfmu.run_ensemble(brick(**{"ensemble.keep": ["all"]}), progress=False)
    np.testing.assert_allclose(every.all["quaternion"][:, -1], found.final["quaternion"], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("change", [
    {"ensemble.keep": ["final", "statistics"]}, {"inputs.ports": ["torque_b"]}, {"events.turned": "omega_b[1]"},
])  # fmt: skip
def test_members_of_which_more_is_looked_at_take_the_steps_of_the_scene(change):
    scene = brick(**change)
    assert for_ends(scene) == scene
