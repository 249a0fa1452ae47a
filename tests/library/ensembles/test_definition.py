"""The tables [ensemble] of a scene: what they may say, what is refused, and that a single run stays as it is."""

import json
import pickle
import tomllib
from contextlib import nullcontext

import numpy as np
import pytest

from rbfmu.scene.ensemble import lower_factor
from rbfmu.scene.scene import Scene
from rbfmu.scene.section import SceneError

BODY = {"mass": 50.0, "inertia": [10.0, 12.0, 15.0]}
SPHERE = {"mass": 50.0, "shape": {"kind": "sphere", "radius": 1.0}}
MASS = {"body.mass": {"normal": [50.0, 0.5]}}
TWO = MASS | {"loads.torque_b": {"normal": [[0, 0, 1], [0, 0, 0.1]]}}
CONTRACT = """
[body]
mass = 50.0
inertia = [10.0, 12.0, 15.0]
[ensemble]
runs = 10000
seed = 7
design = "random"
keep = ["final", "statistics"]
[ensemble.vary]
"body.mass" = { normal = [50.0, 0.5] }
"body.inertia" = { relative = 0.02 }
"initial.omega_b" = { uniform = [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]] }
"initial.attitude" = { rotvec_deg = 2.0 }
"loads.torque_b" = { normal = [[0, 0, 0.1], [0, 0, 0.01]] }
[ensemble.correlation]
components = ["body.mass", "loads.torque_b[3]"]
matrix = [[1, 0.5], [0.5, 1]]
"""


def scene(vary=MASS, body=BODY, correlation=None, ensemble=(), **tables):
    table = {"vary": vary} | dict(ensemble) | ({"correlation": correlation} if correlation is not None else {})
    return Scene.from_dict({"body": body, "ensemble": table} | tables, "varied.toml")


def test_the_contract_s_tables_are_read():
    found = Scene.from_dict(tomllib.loads(CONTRACT)).ensemble
    assert (found.runs, found.seed, found.design, found.keep) == (10000, 7, "random", ("final", "statistics"))
    assert found.parameters == ("mass", "inertia", "omega_b_0", "quaternion_0", "torque_b")
    names = [marginal.name for marginal in found.varying]
    assert names == [
        *("body.mass", "body.inertia[1]", "body.inertia[2]", "body.inertia[3]"),
        *("initial.omega_b[1]", "initial.omega_b[2]", "initial.omega_b[3]"),
        *("initial.attitude.rotvec_deg[1]", "initial.attitude.rotvec_deg[2]", "initial.attitude.rotvec_deg[3]"),
        "loads.torque_b[3]",
    ]


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_matrix_may_be_symmetric_to_round_off_in_any_units(unit):
    def varied(off):
        M = unit * np.array([[2.0, 0.0, 0.1 + off], [0.0, 3.0, 0.0], [0.1, 0.0, 4.0]])
        body = BODY | {"inertia": (0.5 * (M + M.T)).tolist()}
        return scene({"body.inertia": {"normal": [M.tolist(), 0.01 * unit]}}, body=body)

    assert varied(4e-16).ensemble.parameters == ("inertia",)
    with pytest.raises(SceneError, match="a symmetric matrix"):
        varied(5e-11)


def test_numpy_s_numbers_and_arrays_are_numbers():
    one = scene({"loads.torque_b": {"normal": [np.array([0, 0, 1]), np.float64(0.1)]}}, ensemble={"runs": np.int64(5)})
    other = scene({"loads.torque_b": {"normal": [[0, 0, 1], 0.1]}}, ensemble={"runs": 5})
    assert one == other


def test_an_ensemble_is_made_again_from_its_tables():
    made = Scene.from_dict(tomllib.loads(CONTRACT))
    again = Scene.from_dict(json.loads(json.dumps(made.to_dict())), made.name)
    assert again == made
    assert hash(pickle.loads(pickle.dumps(made))) == hash(made)
    assert again.to_dict() == made.to_dict()
    assert "'body.mass': {'normal': [50.0, 0.5]}" in repr(made)


def test_a_scene_without_an_ensemble_has_no_such_table():
    assert Scene.from_dict({"body": BODY}).ensemble is None
    assert "ensemble" not in Scene.from_dict({"body": BODY}).to_dict()
    assert scene().replace({"ensemble": None}) == Scene.from_dict({"body": BODY}, "varied")


def test_a_grid_with_other_points_has_as_many_runs():
    """2026-11-28: "ensemble.runs = 3: expected no such key, or 5", which nobody had written."""
    grid = {key: value | {"points": 3} for key, value in MASS.items()}
    finer = {key: value | {"points": 5} for key, value in MASS.items()}
    coarse = scene(grid, ensemble={"design": "grid"})
    assert coarse.replace({"run.stop": 3.0}).replace({"ensemble.vary": finer}).ensemble.runs == 5
    assert scene().replace(ensemble={"design": "grid", "vary": grid}).ensemble.runs == 3
    with pytest.raises(SceneError, match=r"ensemble\.runs = 4: expected no such key, or 3"):
        coarse.replace({"ensemble.runs": 4})


def test_one_part_may_be_kept_by_its_name_alone():
    assert scene(ensemble={"keep": "all"}) == scene(ensemble={"keep": ["all"]})
    with pytest.raises(SceneError, match=r'^varied.toml: ensemble\.keep = "every": expected a list .*, not "every"$'):
        scene(ensemble={"keep": "every"})


def test_keys_may_be_written_with_toml_s_own_dots():
    text = """
    body.mass = { normal = [50.0, 0.5] }
    body.shape.radius = { uniform = [0.9, 1.1] }
    initial.attitude.angles_deg = { normal = [[0, 0, 0], 1.0] }
    loads.torque_b.normal = [[0, 0, 1], [0, 0, 0.1]]
    """
    written = {"attitude": {"euler": "XYZ", "angles_deg": [0, 0, 0]}}
    found = scene(tomllib.loads(text), body=SPHERE, initial=written).ensemble
    quoted = {
        "body.mass": {"normal": [50.0, 0.5]},
        "initial.attitude": {"euler": "XYZ", "angles_deg": {"normal": [[0, 0, 0], 1.0]}},
        "loads.torque_b": {"normal": [[0, 0, 1], [0, 0, 0.1]]},
        "body.shape": {"kind": "sphere", "radius": {"uniform": [0.9, 1.1]}},
    }
    assert {variation.key: variation.table for variation in found.vary} == quoted
    assert scene(quoted, body=SPHERE, initial=written).ensemble == found


def test_a_scene_s_own_sequence_of_angles_counts():
    vary = {"initial.attitude.angles_deg": {"normal": [[10, 0, 0], 1.0]}}
    made = scene(vary, initial={"attitude": {"euler": "xyz", "angles_deg": [10, 0, 0]}})
    assert made.ensemble.vary[0].table == {"euler": "xyz", "angles_deg": {"normal": [[10, 0, 0], 1.0]}}
    assert Scene.from_dict(made.to_dict(), made.name) == made


def test_a_shape_stays_with_its_mass_until_another_inertia_is_stated():
    made = scene(body=SPHERE)
    assert made.ensemble.parameters == ("mass", "inertia")
    assert Scene.from_dict(made.to_dict(), made.name) == made
    assert made.replace({"body.inertia": [10.0, 12.0, 15.0]}).ensemble.parameters == ("mass",)
    box = made.replace({"body.shape": {"kind": "box", "sides": [1.0, 1.0, 2.0]}}).ensemble
    assert box.variation_of("body.shape").table == {"kind": "box", "sides": [1.0, 1.0, 2.0]}


def test_an_inertia_that_varies_outright_does_not_follow_the_shape():
    vary = MASS | {"body.inertia": {"normal": [[20.0, 20.0, 20.0], 0.1]}}
    assert scene(vary, body=SPHERE).ensemble.variation_of("body.shape") is None
    for follows in ({"relative": 0.1}, {"axes_deg": 1.0}):
        made = scene(MASS | {"body.inertia": follows}, body=SPHERE).ensemble
        assert made.variation_of("body.shape") is not None, follows


def test_moments_and_axes_of_an_inertia_vary_together():
    made = scene({"body.inertia": {"relative": 0.1, "axes_deg": [1.0, 0.0, 2.0]}}).ensemble
    assert [(m.name, m.kind, m.arguments) for m in made.varying] == [
        *((f"body.inertia[{k}]", "relative", (0.1,)) for k in (1, 2, 3)),
        ("body.inertia.axes_deg[1]", "normal", (0.0, 1.0)), ("body.inertia.axes_deg[3]", "normal", (0.0, 2.0)),
    ]  # fmt: skip


BEAM = {"mass": 1.0, "shape": {"kind": "beam", "length": 1.0}}
ALMOST_BEAM = {"mass": 1.0, "inertia": [1.5e-12, 1.0, 1.0]}
VARIED_SPHERE = {"kind": "sphere", "radius": {"normal": [1, 0.2]}}
NORMAL = {"normal": [[0, 0, 0], 1]}
FAULTS = [
    ({"vary": {}}, "ensemble.vary = {}: expected a table: keys of the scene"),
    ({"vary": 5}, "ensemble.vary = 5: expected a table"),
    ({"vary": {"body.mas": MASS["body.mass"]}},
     '"body.mas" = { normal = [50.0, 0.5] }: unknown key; did you mean body.mass?'),
    ({"vary": {"a": MASS["body.mass"]}}, "body.shape, constants.NAME, states.NAME"),
    ({"vary": {"body.mass": 5}},
     '"body.mass" = 5: expected a table with one of normal = [mean, standard deviation], uniform'),
    ({"vary": {"body.mass": {"normal": [50]}}},
     '"body.mass".normal = [50]: expected [mean, standard deviation], each a number > 0'),
    ({"vary": {"body.mass": {"normal": [50, -1]}}},
     '"body.mass".normal = [50, -1]: expected [mean, standard deviation]: a number >= 0'),
    ({"vary": {"body.mass": {"normal": [-50, 1]}}},
     '"body.mass".normal = [-50, 1]: expected [mean, standard deviation]: a number > 0'),
    ({"vary": {"body.mass": {"normal": [50, float("nan")]}}}, "a finite number >= 0 (kg)"),
    ({"vary": {"body.mass": {"uniform": [60, 50]}}}, "expected [low, high] in ascending order"),
    ({"vary": {"body.mass": {"triangular": [60, 50, 70]}}}, "expected [low, most likely, high] in ascending order"),
    ({"vary": {"body.mass": {"lognormal": [0, 1]}}},
     "[median, standard deviation of the logarithm]: a number > 0 (kg)"),
    ({"vary": {"body.mass": {"normal": [50, 1], "uniform": [1, 2]}}}, "expected a table with one of normal"),
    ({"vary": {"loads.torque_b": {"normal": [[0, 0], 1]}}}, "[mean, standard deviation]: 3 numbers (N m)"),
    ({"vary": {"loads.torque_b": {"relative": 0.1}}},
     '"loads.torque_b".relative = 0.1: expected 0 for loads.torque_b[1], as it is 0'),
    ({"vary": {"loads.damping_b": {"normal": [[-1, 0, 0], 1]}}}, "3 numbers >= 0 (N m s/rad)"),
    ({"vary": {"run.stop": {"normal": [5, 1]}}},
     '"run.stop" = { normal = [5, 1] }: expected a key of body, initial or loads'),
    ({"vary": {"initial.attitude": "random"}},
     '"initial.attitude" = "random": expected "uniform", { rotvec_deg = 2.0 }'),
    ({"vary": {"initial.attitude": {"quaternion": {"normal": [[1, 0, 0, 0], 0.1]}}}},
     'expected "uniform", { rotvec_deg = 2.0 }'),
    ({"vary": {"initial.attitude": {"euler": "ABC", "angles": NORMAL}}}, '.euler = "ABC": expected an Euler sequence'),
    ({"vary": {"initial.attitude": {"rotvec_deg": -1}}},
     ".rotvec_deg = -1: expected a number >= 0: standard deviations"),
    ({"vary": {"initial.attitude": {"rotvec_deg": 0}}}, "expected a distribution in which something varies"),
    ({"vary": {"body.shape.radius": {"normal": [1, 0]}}, "body": SPHERE},
     "radius = { normal = [1, 0] } }: expected a distribution in which something varies"),
    ({"vary": {"initial.attitude.angles_deg": NORMAL}}, 'expected "initial.attitude" = { rotvec_deg = 2.0 }'),
    ({"vary": {"body.inertia": {"normal": [np.eye(3).tolist(), 0.1], "axes_deg": 1}}}, "a matrix has its axes"),
    ({"vary": {"body.inertia": {"normal": [[[1, 1, 0], [0, 1, 0], [0, 0, 1]], 0.1]}}}, "a symmetric matrix"),
    ({"vary": {"body.inertia": {"relative": 0.1}}, "body": BEAM}, "a beam's two moments are equal"),
    ({"vary": {"body.inertia": {"relative": 0.1}}, "body": ALMOST_BEAM}, "body.mass, or the length of its shape"),
    ({"vary": {"body.shape.radius": {"normal": [1, 0.1]}}}, "expected no such key without body.shape"),
    ({"vary": {"body.shape.sides": NORMAL}, "body": SPHERE}, "expected a sphere with radius"),
    ({"vary": {"body.shape.radius": {"normal": [1, 0.1]}, "body.inertia": NORMAL}, "body": SPHERE},
     "expected relative or axes_deg"),
    ({"vary": {"initial.velocity": NORMAL}, "body": BODY | {"pivot": True}}, "expected no such key: the pivot holds o"),
    ({"vary": {"initial.omega_b": NORMAL, "initial.omega_b_deg": NORMAL}},
     "expected initial.omega_b or this, not both"),
    ({"vary": MASS | {"body": {"mass": {"normal": [50, 1]}}}},
     "= { normal = [50, 1] }: expected this or { normal = [50.0,"),
    ({"vary": {"body": {"shape": {"radius": {"normal": [1, 0.1]}}}, "body.shape": VARIED_SPHERE}, "body": SPHERE},
     '"body.shape.radius" = { normal = [1, 0.1] }: expected this or { kind = "sphere"'),
    ({"inputs": {"ports": ["omega_b"]}, "body": None},
     '"body.mass" = { normal = [50.0, 0.5] }: expected initial.attitude at most'),
    ({"ensemble": {"runs": 0}}, "ensemble.runs = 0: expected a whole number from 1 to 1000000000"),
    ({"ensemble": {"seed": -1}}, "ensemble.seed = -1: expected a whole number from 0"),
    ({"ensemble": {"design": "sobel"}}, 'ensemble.design = "sobel": expected "random" or "sobol"'),
    ({"ensemble": {"keep": ["some"]}}, 'ensemble.keep = ["some"]: expected a list of distinct names out of final'),
    ({"ensemble": {"rums": 3}}, "ensemble.rums = 3: unknown key; did you mean runs?"),
    ({"ensemble": {"design": "grid"}}, "expected points = the number of values in the grid"),
    ({"ensemble": {"design": "grid"}, "vary": {"initial.attitude": {"rotvec_deg": 2.0}}},
     '"initial.attitude" = { rotvec_deg = 2.0 }: expected no such key in a grid; or angles_deg, angles, rotvec'),
    ({"ensemble": {"design": "grid"}, "vary": {"body.inertia": {"relative": 0.1, "points": 3, "axes_deg": 1}}},
     '"body.inertia".axes_deg = 1: expected no such key in a grid'),
    ({"ensemble": {"design": "grid"}, "vary": {"initial.attitude": {"rotvec": NORMAL}}},
     '"initial.attitude" = { rotvec = { normal = [[0, 0, 0], 1] } }: expected points = the number'),
    ({"vary": {"body.mass": {"normal": [50, 1], "points": 3}}}, 'expected points in a grid alone: design = "grid"'),
    ({"vary": {"body.mass": {"normal": [50, 1], "points": 2000000}}},
     ".points = 2000000: expected a number of points of the grid, at most 1000000"),
    ({"vary": {"body.mass": {"normal": [50, 1], "points": 3}}, "ensemble": {"design": "grid", "runs": 7}},
     "ensemble.runs = 7: expected no such key, or 3: the points of the grid"),
    *(({"vary": {"loads.torque_b": {"uniform": [[0] * 3, [1] * 3], "points": n}}, "ensemble": {"design": "grid"}},
       f"ensemble.vary: a grid of {n**3} points: expected at most 1000000000") for n in (1250, 10_000)),
]  # fmt: skip
PAIR = ["body.mass", "loads.torque_b[3]"]
CORRELATIONS = [
    ({}, "ensemble.correlation.components is missing"),
    ({"components": ["body.mass"], "matrix": [[1.0]]}, "expected a list of at least two distinct numbers that vary"),
    ({"components": ["body.mass", "loads.torque_b"], "matrix": [[1, 0], [0, 1]]},
     "out of body.mass, loads.torque_b[3]"),
    ({"components": PAIR}, "expected either matrix (of correlations) or covariance"),
    ({"components": PAIR, "matrix": [[1, 1.5], [1.5, 1]]}, "expected a positive semidefinite matrix"),
    ({"components": PAIR, "matrix": [[1, 0.5], [0.4, 1]]}, "expected a symmetric matrix; rows 2 and 1 differ"),
    ({"components": PAIR, "matrix": [[1, 0.5], [0.500000001, 1]]}, "expected a symmetric matrix; rows 2 and 1 differ"),
    ({"components": PAIR, "matrix": [[2, 0.5], [0.5, 1]]}, "expected 1 on the diagonal; or the key covariance"),
    ({"components": PAIR, "matrix": [[1.0]]}, "expected 2 rows of 2 numbers, as components has"),
    ({"components": PAIR, "covariance": [[0.25, 0], [0, 0.2]]},
     "covariance = 0.2: expected the square of the standard deviation"),
    ({"components": PAIR, "covariance": [[0.25, 0], [0, -0.01]]}, "expected numbers > 0 on the diagonal"),
    ({"components": PAIR, "covariance": [[0.25, 0], [0, 0.0]]}, "[0.0, 0.0]]: expected numbers > 0 on the diagonal"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_each_fault_is_named_with_key_value_and_what_was_expected(changes, message):
    with pytest.raises(SceneError) as raised:
        scene(**changes)
    assert str(raised.value).startswith("varied.toml: ensemble")
    assert message in str(raised.value)
    assert len(raised.value.faults) == 1


@pytest.mark.parametrize(("correlation", "message"), CORRELATIONS, ids=[message for _, message in CORRELATIONS])
def test_each_fault_of_a_correlation_is_named(correlation, message):
    with pytest.raises(SceneError) as raised:
        scene(TWO, correlation=correlation)
    assert message in str(raised.value)


def test_three_correlations_may_contradict_each_other():
    vary = TWO | {"initial.omega_b": {"normal": [[0, 0, 0], [0, 0, 1]]}}
    matrix = np.array([[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]])
    correlation = {"components": [*PAIR, "initial.omega_b[3]"], "matrix": matrix.tolist()}
    with pytest.raises(SceneError, match="expected a positive semidefinite matrix"):
        scene(vary, correlation=correlation)
    matrix = np.abs(matrix).tolist()
    assert scene(vary, correlation=correlation | {"matrix": matrix}).ensemble.correlation is not None
    L = np.array(lower_factor(matrix))
    np.testing.assert_allclose(L @ L.T, matrix, rtol=1e-15)


@pytest.mark.parametrize("other", [-0.5, 0.4, 0.6])
def test_what_follows_from_one_number_is_correlated_as_that_one(other):
    vary = TWO | {"initial.omega_b": {"normal": [[0, 0, 0], [0, 0, 1]]}}
    for last, expectation in ((0.5, nullcontext()), (other, pytest.raises(SceneError, match="positive semidefinite"))):
        matrix = [[1.0, 1.0, 0.5], [1.0, 1.0, last], [0.5, last, 1.0]]
        with expectation:
            scene(vary, correlation={"components": [*PAIR, "initial.omega_b[3]"], "matrix": matrix})


def test_uniform_rotations_have_no_numbers_to_correlate_and_points_of_a_grid_are_independent():
    pair, uniform = {"matrix": [[1, 0.5], [0.5, 1]]}, MASS | {"initial.attitude": "uniform"}
    with pytest.raises(SceneError, match=r"expected numbers that vary, out of body\.mass"):
        scene(uniform, correlation={"components": ["body.mass", "initial.attitude.uniform[1]"]} | pair)
    grid = {key: value | {"points": 2} for key, value in TWO.items()}
    with pytest.raises(SceneError, match="expected none: the points of a grid are independent"):
        scene(grid, correlation={"components": PAIR} | pair, ensemble={"design": "grid"})


def test_all_faults_are_reported_at_once():
    with pytest.raises(SceneError) as raised:
        scene({"body.mass": 5, "loads.torque_b": {"normal": [1, 2]}}, body=BODY | {"mass": -1.0}, ensemble={"runs": 0})
    assert len(raised.value.faults) == 4
