"""What is drawn: each member by seed and number alone, distributions as their textbooks have them."""

import math
import platform
import sys
from statistics import NormalDist

import numpy as np
import pytest
from scipy import stats

import rbfmu
from rbfmu.ensembles import draws, members
from rbfmu.ensembles.draws import normal_scores
from rbfmu.ensembles.members import draw, refusals
from rbfmu.scene.scene import Scene
from rbfmu.scene.variations import LOGNORMAL, NORMAL, RELATIVE, TRIANGULAR, UNIFORM, Marginal

BODY = {"mass": 50.0, "inertia": [10.0, 12.0, 15.0]}
EVERYTHING = {
    "body.mass": {"lognormal": [50.0, 0.1]}, "body.inertia": {"relative": 0.1, "axes_deg": 3.0},
    "body.r_oc_b": {"triangular": [[-0.1] * 3, [0.0, 0.05, -0.1], [0.1] * 3]},
    "initial.position": {"normal": [[1.0, 2.0, 3.0], [0.1, 0.0, 0.3]]}, "initial.attitude": {"rotvec_deg": 2.0},
    "initial.omega_b_deg": {"uniform": [[-5.0, 0.0, 5.0], [5.0, 10.0, 10.0]]},
    "loads.damping_b": {"uniform": [[0.0, 0.1, 0.1], [0.1, 0.1, 0.2]]},
}  # fmt: skip
MANY = 20_000
LIKELY = 1e-4
"""The probability below which a statistical test fails; draws are the same each time, so it does so always or never."""


def ensemble(vary, runs=MANY, body=BODY, correlation=None, tables=None, **more):
    table = {"runs": runs, "vary": vary} | ({"correlation": correlation} if correlation else {}) | more
    return Scene.from_dict({"body": body, "name": "drawn"} | (tables or {}) | {"ensemble": table})


def equal(a, b, rows=slice(None)):
    assert a.applied.keys() == b.applied.keys()
    for mine, theirs in ((a.applied, b.applied), (a.drawn, b.drawn)):
        assert all(np.array_equal(mine[key][rows], theirs[key]) for key in mine)
    assert np.array_equal(a.redrawn[rows], b.redrawn)


# Member i by its number alone


@pytest.mark.parametrize("design", ["random", "sobol", "latin_hypercube"])
def test_a_member_is_the_same_in_any_chunk(design):
    scene = ensemble(EVERYTHING, runs=200, design=design, seed=3)
    together = draw(scene, 0, 200)
    for first, count in ((0, 1), (1, 1), (0, 7), (63, 64), (199, 1)):
        equal(together, draw(scene, first, count), slice(first, first + count))


def test_a_grid_s_member_is_the_same_in_any_chunk():
    scene = ensemble({"body.mass": {"uniform": [1.0, 2.0], "points": 5}, "loads.torque_b": {
        "normal": [[0.0, 0.0, 1.0], [0.0, 0.1, 0.1]], "points": [0, 2, 3]}}, runs=30, design="grid")  # fmt: skip
    together = draw(scene, 0, 30)
    equal(together, draw(scene, 11, 8), slice(11, 19))


def test_draws_of_a_number_hang_on_its_key_the_seed_and_the_member_alone():
    """Neither on how many runs there are, nor on what else varies."""
    few, more = ensemble(EVERYTHING, runs=10), ensemble(EVERYTHING, runs=5000)
    equal(draw(more, 0, 10), draw(few, 0, 10))
    alone = draw(ensemble({"body.mass": EVERYTHING["body.mass"]}), 0, 50)
    beside = draw(ensemble({k: EVERYTHING[k] for k in ("loads.damping_b", "body.mass")}), 0, 50)
    assert np.array_equal(alone.applied["body.mass"], beside.applied["body.mass"])
    one, other = (draw(ensemble(EVERYTHING, seed=seed), 0, 20) for seed in (0, 1))
    assert all(not np.any(one.drawn[name] == other.drawn[name]) for name in one.drawn)


def test_a_seed_gives_the_numbers_that_it_always_gave():
    """So that a kept store goes on with the members with which it began."""
    assert draws.uniform(7, "body.mass", 0, 3).tolist() == [0.06452718786181794, 0.686550338221972, 0.28989470730341843]
    assert draws.uniform(7, "body.mass", 1, 2, attempt=1).tolist() == [0.2547971648692861, 0.592962479178113]


def test_numbers_of_one_member_are_independent():
    names = [m.name for m in ensemble(EVERYTHING).ensemble.varying]
    cube = np.column_stack([draws.uniform(0, name, 0, MANY) for name in names])
    worst = np.max(np.abs(np.corrcoef(cube.T) - np.eye(len(names))))
    assert worst < stats.norm.isf(LIKELY / len(names) ** 2) / math.sqrt(MANY)
    serial = np.corrcoef(cube[1:, 0], cube[:-1, 0])[0, 1]
    assert abs(serial) < stats.norm.isf(LIKELY) / math.sqrt(MANY)


def test_array_functions_and_single_calls_draw_the_same_bits(monkeypatch):
    scene = ensemble(EVERYTHING | {"initial.attitude": "uniform"}, runs=300)
    single = draw(scene, 0, 300)
    monkeypatch.setattr(members, "FEW", 0)
    equal(draw(scene, 0, 300), single)


def test_members_beyond_the_runs_are_refused():
    scene = ensemble(EVERYTHING, runs=10)
    for first, count in ((-1, 2), (0, 11), (10, 1), (3, 0), (3, -1)):
        with pytest.raises(ValueError, match="expected members of the 10 runs"):
            draw(scene, first, count)


# Distributions


@pytest.mark.parametrize(("distribution", "expected"), [
    ({"normal": [50.0, 0.5]}, stats.norm(50.0, 0.5)),
    ({"uniform": [40.0, 60.0]}, stats.uniform(40.0, 20.0)),
    ({"lognormal": [50.0, 0.1]}, stats.lognorm(0.1, scale=50.0)),
    ({"triangular": [40.0, 42.0, 60.0]}, stats.triang(0.1, 40.0, 20.0)),
    ({"triangular": [40.0, 40.0, 60.0]}, stats.triang(0.0, 40.0, 20.0)),
    ({"relative": 0.02}, stats.norm(50.0, 1.0)),
])  # fmt: skip
@pytest.mark.parametrize("design", ["random", "sobol", "latin_hypercube"])
def test_values_are_distributed_as_stated(distribution, expected, design):
    scene = ensemble({"body.mass": distribution}, design=design, runs=4096)
    found = draw(scene, 0, 4096).applied["body.mass"]
    assert stats.kstest(found, expected.cdf).pvalue > LIKELY
    if design == "latin_hypercube":  # one in each of as many equal shares
        assert sorted(np.floor(4096 * expected.cdf(found))) == list(range(4096))


def test_a_number_that_is_drawn_too_large_is_that_of_its_member_alone():
    scene = ensemble({"body.mass": {"lognormal": [50.0, 1000.0]}}, runs=40)
    members = draw(scene, 0, 40)
    too_large = np.flatnonzero(np.isinf(members.applied["body.mass"])).tolist()
    assert 0 < len(too_large) < 40
    refused = refusals(scene, members)
    assert all("body.mass = inf: expected a finite number" in refused[row] for row in too_large)


def test_normal_scores_have_the_bits_of_pythons_own():
    """Where compilers of Python fuse no sums and products."""
    middle = [0.075, 0.5, 0.925]
    edges = [x for m in middle for x in (np.nextafter(m, 0.0), m, np.nextafter(m, 1.0))]
    u = np.concatenate([edges, [1e-300, 2.0**-54, 1.0 - 2.0**-53], np.random.default_rng(1).random(20_000)])
    found, expected = normal_scores(u), np.array([NormalDist().inv_cdf(x) for x in u.tolist()])
    assert np.max(np.abs(found - expected) / np.maximum(np.abs(expected), 1e-3)) < 4e-15
    assert (found == expected).all() or platform.machine() != "x86_64"


def test_probabilities_are_inside_the_unit_interval_however_far_off():
    found = draws.probabilities(np.array([-60.0, -8.0, 0.0, 8.0, 60.0]))
    assert (found > 0.0).all()
    assert (found < 1.0).all()
    assert found[2] == 0.5


def test_a_normal_score_is_so_many_deviations_above_the_middle():
    """By which numbers that depend on each other go the same way."""
    for kind, arguments, value in (
        (NORMAL, (2.0, 3.0), 5.0), (RELATIVE, (0.1,), 1.1), (LOGNORMAL, (2.0, 0.5), 2.0 * math.exp(0.5)),
    ):  # fmt: skip
        assert draws.values_of(Marginal("x", kind, arguments), np.empty(1), np.ones(1)) == pytest.approx([value])


def test_bounded_numbers_stay_within_their_bounds():
    u = np.concatenate([np.random.default_rng(1).random(1000), [0.0, 1.0]])
    for kind, arguments in (
        (UNIFORM, (1.0, 1.0 + 2.0**-52)), (UNIFORM, (-1.7e308, 1.7e308)), (TRIANGULAR, (0.1, 0.1, 0.1 + 2.0**-56)),
        (TRIANGULAR, (-0.1 - 2.0**-56, -0.1, -0.1)),
    ):  # fmt: skip
        found = draws.values_of(Marginal("x", kind, arguments), u)
        assert arguments[0] <= found.min() <= found.max() <= arguments[-1], (kind, arguments)


@pytest.mark.parametrize("design", ["random", "sobol", "latin_hypercube"])
def test_correlated_numbers_keep_their_own_distributions(design):
    vary = {"body.mass": {"uniform": [40.0, 60.0]}, "loads.torque_b": {"lognormal": [[1.0, 2.0, 3.0], [0.0, 0.0, 0.5]]}}
    correlation = {"components": ["loads.torque_b[3]", "body.mass"], "matrix": [[1.0, -0.8], [-0.8, 1.0]]}
    found = draw(ensemble(vary, runs=4096, correlation=correlation, design=design), 0, 4096)
    mass, torque = found.applied["body.mass"], found.applied["loads.torque_b"][:, 2]
    assert stats.kstest(mass, stats.uniform(40.0, 20.0).cdf).pvalue > LIKELY
    assert stats.kstest(torque, stats.lognorm(0.5, scale=3.0).cdf).pvalue > LIKELY
    rank = stats.spearmanr(mass, torque).statistic
    assert abs(rank - 6.0 / math.pi * math.asin(-0.4)) < 5.0 / math.sqrt(4096)
    assert np.all(found.applied["loads.torque_b"][:, :2] == [1.0, 2.0])


def test_numbers_may_depend_on_each_other_altogether():
    correlation = {"components": ["body.mass", "initial.position[1]"], "matrix": [[1.0, 1.0], [1.0, 1.0]]}
    vary = {"body.mass": {"normal": [50.0, 1.0]}, "initial.position": {"normal": [[0.0] * 3, [2.0, 0.0, 0.0]]}}
    found = draw(ensemble(vary, correlation=correlation), 0, 100)
    expected = 2.0 * (found.applied["body.mass"] - 50.0)
    assert np.allclose(found.applied["initial.position"][:, 0], expected, rtol=0.0, atol=1e-13)


def test_a_grid_has_every_combination_the_last_changing_first():
    vary = {"body.mass": {"uniform": [40.0, 60.0], "points": 3}, "loads.torque_b": {
        "normal": [[0.0, 0.0, 1.0], [0.0, 0.0, 0.1]], "points": 2}}  # fmt: skip
    scene = ensemble(vary, runs=6, design="grid")
    found = draw(scene, 0, 6)
    assert found.applied["body.mass"].tolist() == [40.0, 40.0, 50.0, 50.0, 60.0, 60.0]
    z = stats.norm.ppf(0.25)
    assert np.allclose(found.applied["loads.torque_b"][:, 2], [1.0 + 0.1 * z, 1.0 - 0.1 * z] * 3, rtol=1e-15)
    assert Scene.from_dict({"body": BODY, "ensemble": {"design": "grid", "vary": vary}}).ensemble.runs == 6


@pytest.mark.parametrize(("points", "expected"), [(1, [50.0]), (2, [40.0, 60.0]), (5, [40.0, 45.0, 50.0, 55.0, 60.0])])
def test_a_grid_goes_from_end_to_end_of_what_is_uniform(points, expected):
    scene = ensemble({"body.mass": {"uniform": [40.0, 60.0], "points": points}}, runs=points, design="grid")
    assert draw(scene, 0, points).applied["body.mass"].tolist() == expected


def test_sobol_points_fill_the_cube_evenly():
    scene = ensemble({"body.mass": {"uniform": [1.0, 2.0]}, "initial.position": {"uniform": [[0.0] * 3, [1.0] * 3]}},
                     runs=1024, design="sobol")  # fmt: skip
    cube = draws.points(scene.ensemble, 0, 1024)
    assert all(sorted(np.floor(1024 * column)) == list(range(1024)) for column in cube.T)
    assert np.all(np.ldexp(cube, draws.SOBOL_BITS + 1) % 2.0 == 1.0)  # in the middle of a cell, never 0


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube"])
def test_designs_say_what_to_install(design, monkeypatch):
    for name in ("scipy", "scipy.stats", "scipy.stats.qmc"):
        monkeypatch.setitem(sys.modules, name, None)
    draws._hypercube.cache_clear()
    with pytest.raises(ModuleNotFoundError, match=r'is not installed: pip install "rbfmu\[ensemble\]"'):
        draw(ensemble(EVERYTHING, runs=8, design=design), 0, 8)
    assert len(draw(ensemble(EVERYTHING, runs=8), 0, 8)) == 8


# Attitudes


def test_attitudes_about_the_scene_s_are_turned_by_normal_rotation_vectors():
    tables = {"initial": {"attitude": {"euler": "ZYX", "angles_deg": [90.0, 20.0, -30.0]}}}
    scene = ensemble({"initial.attitude": {"rotvec_deg": [1.0, 2.0, 0.0]}}, tables=tables)
    q = draw(scene, 0, MANY).applied["initial.attitude"]
    turn = rbfmu.compose_quaternions(rbfmu.invert_quaternion(np.array(scene.initial.quaternion)), q)
    u = np.degrees(rbfmu.rotvec_from_quaternion(turn))
    assert stats.kstest(u[:, 0], stats.norm(0.0, 1.0).cdf).pvalue > LIKELY
    assert stats.kstest(u[:, 1], stats.norm(0.0, 2.0).cdf).pvalue > LIKELY
    assert np.max(np.abs(u[:, 2])) < 1e-12


def test_uniform_attitudes_turn_a_vector_to_all_directions_alike():
    q = draw(ensemble({"initial.attitude": "uniform"}), 0, MANY).applied["initial.attitude"]
    assert np.max(np.abs(np.linalg.norm(q, axis=1) - 1.0)) < 4e-16
    angle = 2.0 * np.arccos(np.clip(np.abs(q[:, 0]), 0.0, 1.0))  # density (1 - cos angle) / pi on [0, pi]
    assert stats.kstest(angle, lambda a: (a - np.sin(a)) / np.pi).pvalue > LIKELY
    for axis in np.eye(3):
        v = rbfmu.rotate(q, axis)
        assert all(stats.kstest(column, stats.uniform(-1.0, 2.0).cdf).pvalue > LIKELY for column in v.T)


@pytest.mark.parametrize(("vary", "written"), [
    ({"euler": "ZYX", "angles_deg": {"normal": [[90.0, 0.0, 10.0], [5.0, 1.0, 1.0]]}}, "angles_deg"),
    ({"euler": "xyz", "angles": {"uniform": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]}}, "angles"),
    ({"rotvec": {"normal": [[0.1, 0.2, 0.3], 0.1]}}, "rotvec"),
])  # fmt: skip
def test_attitudes_may_vary_in_their_own_representation(vary, written):
    scene = ensemble({"initial.attitude": vary}, runs=20)
    found = draw(scene, 0, 20)
    for row in range(20):
        numbers = [found.drawn[f"initial.attitude.{written}[{k}]"][row] for k in (1, 2, 3)]
        attitude = {written: numbers} | ({"euler": vary["euler"]} if "euler" in vary else {})
        expected = Scene.from_dict({"body": BODY, "initial": {"attitude": attitude}}).initial.quaternion
        angle = float(rbfmu.angle_between(np.array(expected), found.applied["initial.attitude"][row]))
        assert angle < 1e-15
