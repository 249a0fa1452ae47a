"""Numbers of a scene from measured motion: found with their errors, or named where the data do not tell them."""

from types import SimpleNamespace

import numpy as np
import pytest

import rbfmu
from rbfmu.ensembles.members import draw
from rbfmu.identification.fit import HELD, _Search
from rbfmu.identification.measured import Measured, read_measured
from rbfmu.runs.inputs import HOLD
from rbfmu.sensitivities import Varied
from rbfmu_fmu.demo import NASA
from tests.support import fits
from tests.support.paths import ROOT

RNG_SEED = 20261123


@pytest.fixture(scope="module")
def case():
    """(truth, start, data) with gaps."""
    rng = np.random.default_rng(RNG_SEED)
    scene = fits.truth(rng)
    data = fits.measured(rng, scene)
    data["omega_b"][3:30] = np.nan
    data["quaternion"][50:60] = np.nan
    return scene, fits.start(rng, scene), data


@pytest.fixture(scope="module")
def found(case):
    _, begun, data = case
    return rbfmu.fit(begun, data, fits.FREE)


@pytest.mark.thorough
def test_numbers_are_found_within_their_errors(case, found):
    scene, begun, _ = case
    assert np.max(np.abs(fits.errors(found, scene, begun))) < 4.0
    assert found.unknown == () == found.doubts
    assert found.sigma == pytest.approx({"omega_b": 0.01, "quaternion": 0.01}, rel=0.2)
    np.testing.assert_allclose(np.diag(found.correlation), 1.0)
    assert rbfmu.simulate(found.scene).omega_b[-1] == pytest.approx(rbfmu.simulate(scene).omega_b[-1], abs=0.02)


@pytest.mark.thorough
def test_outliers_are_left_aside_by_a_robust_loss():
    rng = np.random.default_rng(RNG_SEED + 1)
    scene = fits.truth(rng)
    begun, data = fits.start(rng, scene), fits.measured(rng, scene, outliers=0.1)
    robust = rbfmu.fit(begun, data, fits.FREE, sigma=0.01, loss="cauchy")
    assert np.max(np.abs(fits.errors(robust, scene, begun))) < 4.0


def test_the_last_row_counts_whenever_the_run_starts():
    """2026-12-01: by round-off 5.7 + (14.28 - 5.7) is less than 14.28, and given sigma the last row did not count."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 1.0, 2.0]}, "initial": {"omega_b": [0.0, 0.0, 0.5]}}
    tables |= {"outputs": {"quantities": ["omega_b"]}, "run": {"start": 5.7, "stop": 15.0, "step": 1.0}}
    rates = np.outer([1.0, 1.0, 1.0, 1.04], [0.0, 0.0, 1.0])
    data = {"time": [5.7, 8.0, 11.0, 14.28], "omega_b": rates}
    found = rbfmu.fit(rbfmu.Scene.from_dict(tables, "spin"), data, ["initial.omega_b"], sigma=0.01)
    assert found.values == pytest.approx(rates.mean(axis=0), abs=1e-6)


@pytest.mark.thorough
def test_torque_free_motion_tells_ratios_of_moments_alone():
    rng = np.random.default_rng(RNG_SEED + 2)
    scene = fits.truth(rng).replace({"loads.torque_b": [0.0, 0.0, 0.0]})
    data = {name: rows for name, rows in fits.measured(rng, scene).items() if name != "quaternion"}
    one = rbfmu.fit(fits.start(rng, scene), data, ["body.inertia", "initial.omega_b", "body.mass"])
    assert np.isnan(one.values).tolist() == [True, True, True, False, False, False, True]
    assert np.isnan(np.diag(one.covariance)).tolist() == np.isnan(one.values).tolist()
    assert one.unknown[0] == "body.mass: nothing in these data tells it"
    assert one.unknown[1].startswith("body.inertia[1,1], body.inertia[2,2], body.inertia[3,3]: nothing tells a common")
    fitted, true = np.diag(one.scene.body.inertia), np.diag(scene.body.inertia)
    np.testing.assert_allclose(fitted / fitted[0], true / true[0], rtol=0.1)
    assert one.scene.body.mass == scene.body.mass
    with pytest.raises(ValueError, match="expected data that tell all numbers"):
        one.posterior()


@pytest.mark.slow
def test_a_pendulum_tells_no_number_of_those_that_it_tells_together_alone():
    """M_o, m r_oc and damping may all be larger by one factor; where a moment of mass is nearly zero as well."""
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 2.0, "inertia": [0.1, 0.2, 0.25], "pivot": True, "r_oc_b": [0.0, 0.0, -0.4]},
        "initial": {"attitude": {"rotvec": [0.5, 0.2, 0.0]}}, "loads": {"damping_b": [0.02, 0.02, 0.02]},
        "outputs": {"quantities": ["omega_b", "quaternion"]}, "run": {"stop": 10.0, "step": 0.1},
    })  # fmt: skip
    run, rng = rbfmu.simulate(scene), np.random.default_rng(1004)
    data = {"time": run.time, "omega_b": run.omega_b + 0.02 * rng.normal(size=run.omega_b.shape)}
    data["quaternion"] = run.quaternion + 0.005 * rng.normal(size=run.quaternion.shape)
    changes = {"body.r_oc_b": [0.05, 0, -0.4], "loads.damping_b": [0.03] * 3, "body.inertia": [0.084, 0.19, 0.27]}
    one = rbfmu.fit(scene.replace(changes), data, list(changes), sigma={"omega_b": 0.02, "quaternion": 0.01})
    assert np.isnan(one.values).tolist() == [False, False] + 7 * [True]
    assert len(one.unknown) == 1


def test_a_small_number_of_a_vector_is_not_told_where_its_factor_is_not():
    """2026-12-01: of k/m, with m begun 30 % off, k[2] = 0.01 came out as 0.01109 +- 0.00003."""
    rng, t = np.random.default_rng(RNG_SEED + 9), np.linspace(0.0, 2.0, 41)
    changes = {"body.inertia": [1.0] * 3, "initial": None, "constants": {"k": [1.0, 0.01, 0.0], "m": 1.3}}
    scene = SPINNING.replace(changes | {"loads": {"torque_b": "k/m"}})
    data = {"time": t, "omega_b": np.outer(t, [1.0, 0.01, 0.0]) + 1e-4 * rng.normal(size=(41, 3))}
    one = rbfmu.fit(scene, data, ["constants.k", "constants.m", "initial.omega_b"])
    assert np.isnan(one.values).tolist() == [True, True, False, True, False, False, False]


def test_a_direction_that_no_data_tell_is_said_by_its_ratio():
    """Of what changes by a twentieth of the most, relatively."""
    relative, direction = np.array([-0.5, 1.0, 0.052, 0.048]), np.array([2.0, -3.0, 0.5, 7.0])
    said = _Search._meaning(SimpleNamespace(_names="abcd"), relative, direction)
    assert said == "a, b, c: nothing tells a common change of them, as 1 : -1.5 : 0.25"


def test_a_search_is_held_to_where_it_begins_and_zeros_get_the_unit_that_moves_some_output_as_measured():
    scene = rbfmu.Scene(body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, loads={"gravity_a": [0.0, 0.0, 0.0]})
    data = {"time": [0.0, 1.0], "velocity": [[0.0] * 3, [3.0, 0, 0]], "position": [[0.0] * 3, [1.0, 0.0, 0.0]]}
    keys, known, zero = ["body.mass", "loads.force_a[1]"], read_measured(scene, data), np.zeros(2)
    search = _Search(scene, known, keys, {}, "linear", (None, HOLD))
    search._run_at_start(zero)
    assert search._charts[1].size == pytest.approx(4.0, rel=1e-6)  # N: by which the position is 1 m, the velocity 2 m/s
    begin = np.array([0.5, 0.0])  # without a force no data tell the mass
    still = Measured(known.time, {name: 0.0 * rows for name, rows in known.values.items()})
    found = search._minimize(begin, still, {"velocity": 1.0, "position": 1.0}, HELD)
    np.testing.assert_allclose(found, begin, atol=1e-9)


@pytest.mark.thorough
def test_a_model_that_lacks_a_load_leaves_residuals_that_are_no_noise():
    rng = np.random.default_rng(RNG_SEED + 3)
    scene = fits.truth(rng)
    one = rbfmu.fit(scene.replace({"loads.torque_b": [0.0, 0.0, 0.0]}), fits.measured(rng, scene), ["initial.omega_b"],
                    sigma=0.01)  # fmt: skip
    assert any(doubt.startswith("residuals of attitude[") and "follow each other" in doubt for doubt in one.doubts)
    assert any("times the noise that was given" in doubt for doubt in one.doubts)


@pytest.mark.thorough
def test_constants_and_inputs_and_angles_take_part():
    def scene(k):
        return rbfmu.Scene.from_dict({
            "body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "initial": {"omega_b": [0.5, 0.2, -0.3]},
            "constants": {"k": k}, "inputs": {"ports": ["torque_b"]}, "loads": {"torque_b": "-k*omega_b"},
            "outputs": {"quantities": ["rpy"], "spin": "norm(omega_b)"}, "run": {"stop": 5.0, "step": 0.25},
        })  # fmt: skip

    table = {"torque_b": ([0.0, 2.0, 5.0], [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.0]])}
    run = rbfmu.simulate(scene(0.3), inputs=table)
    data = {"time": run.time[1:], "rpy": run.rpy[1:], "spin": run.spin[1:]}
    one = rbfmu.fit(scene(0.1), data, "constants.k", inputs=table)
    assert one.values == pytest.approx([0.3], abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("guess", [0.0, 1.0])
def test_large_numbers_are_found_from_a_guess_that_knows_no_size(guess):
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 5e5, "inertia": [1e6, 1.1e6, 1.2e6]},
        "constants": {"thrust": 3e6, "moment": [2e5, -1e5, 5e4]},
        "loads": {"gravity_a": [0.0, 0.0, 0.0], "force_b": "[thrust, 0, 0]", "torque_b": "moment*sin(t)"},
        "outputs": {"quantities": ["velocity", "omega_b"]}, "run": {"stop": 10.0, "step": 0.1, "accuracy": 1e-9},
    })  # fmt: skip
    run, rng = rbfmu.simulate(scene), np.random.default_rng(RNG_SEED)
    noise = {"velocity": 0.1, "omega_b": 1e-3}
    data = {name: run.quantities[name] + sigma * rng.normal(size=(101, 3)) for name, sigma in noise.items()}
    begun = scene.replace({"constants.thrust": guess, "constants.moment": [guess, 0.0, 0.0]})
    one = rbfmu.fit(begun, {"time": run.time} | data, ["constants.thrust", "constants.moment"], sigma=noise)
    assert one.unknown == () == one.doubts
    assert np.max(np.abs(one.values - [3e6, 2e5, -1e5, 5e4]) / one.standard_errors) < 3.0


@pytest.mark.thorough
def test_a_fit_is_written_with_comments_and_read_again(tmp_path, found):
    file = tmp_path / "start.toml"
    file.write_text('# mine\n[body]\nmass = 1.0 # weighed\nshape = { kind = "box", sides = [1.0, 2.0, 3.0] }\n'
                    "[initial]\nomega_b_deg = [1, 2, 3]\n[loads]\ntorque_b = [0.1, 0, 0]\n")  # fmt: skip
    found.save(tmp_path / "fitted.toml", file)
    text = (tmp_path / "fitted.toml").read_text()
    assert "# weighed" in text
    assert "shape" not in text
    assert "omega_b_deg" not in text
    assert text.count("# fitted; standard error") == 3
    written = rbfmu.load_scene(tmp_path / "fitted.toml")
    assert written.body.inertia == found.scene.body.inertia
    assert written.initial.quaternion == pytest.approx(found.scene.initial.quaternion, abs=1e-15)
    with pytest.raises(TypeError, match="path = 3: expected a path"):
        found.save(3)
    found.save(tmp_path / "alone.toml")
    assert rbfmu.load_scene(tmp_path / "alone.toml").initial.omega_b == found.scene.initial.omega_b


@pytest.mark.thorough
def test_the_posterior_is_an_ensemble(found):
    members = draw(found.posterior(400), 0, 400).applied
    drawn = members["initial.omega_b"]
    np.testing.assert_allclose(drawn.std(axis=0), found.standard_errors[3:6], rtol=0.2)
    q_ab = np.array(found.scene.initial.quaternion)
    turns = rbfmu.compose_quaternions(rbfmu.invert_quaternion(q_ab), members["initial.attitude"])
    np.testing.assert_allclose(rbfmu.rotvec_from_quaternion(turns).std(axis=0), found.standard_errors[6:], rtol=0.2)
    np.testing.assert_allclose(np.diagonal(members["body.inertia"].std(axis=0)), found.standard_errors[:3], rtol=0.2)
    between = np.corrcoef(drawn.T)[0, 1]
    assert between == pytest.approx(found.correlation[3, 4], abs=0.2)


@pytest.mark.parametrize("known", [
    {"design": "grid", "vary": {"body.mass": {"normal": [1.0, 0.1], "points": 2}}},
    {"vary": {"body.mass": {"normal": [1.0, 0.1]}, "initial.omega_b": {"normal": [[0.0, 0.0, 1.0], 0.1]}},
     "correlation": {"components": ["body.mass", "initial.omega_b[3]"], "matrix": [[1.0, 0.5], [0.5, 1.0]]},
     "keep": ["all"]},
])  # fmt: skip
def test_the_posterior_stands_in_place_of_an_ensemble_that_was_there(known):
    """Its grid asked for points, its correlation for numbers that no longer varied."""
    one = rbfmu.fit(SPINNING.replace({"ensemble": known}), SPIN, ["initial.omega_b[3]"])
    left = one.posterior(40).ensemble
    assert (left.runs, left.design, left.correlation) == (40, "random", None)
    assert left.keep == ("all",) or "keep" not in known


def test_correlations_of_the_posterior_are_those_of_their_numbers_whatever_the_order_of_keys():
    """2026-12-01: numbers of one key on both sides of another's had the correlations of others."""
    free = ["initial.omega_b[3]", "loads.damping_b[3]", "initial.omega_b[1]"]
    one = rbfmu.fit(SPINNING, SPIN, free, sigma=0.02)
    known = one.posterior().ensemble.correlation
    assert known.components == ("initial.omega_b[3]", "initial.omega_b[1]", "loads.damping_b[3]")
    np.testing.assert_allclose(known.matrix[0][1:], one.correlation[0, [2, 1]], rtol=1e-12)


SPINNING = rbfmu.Scene.from_dict({
    "body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.0, 0.0, 1.0]},
    "loads": {"damping_b": [0.0, 0.0, 0.3]}, "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 5.0, "step": 0.1},
})  # fmt: skip
SPIN = {"time": np.linspace(0.0, 5.0, 51), "omega_b": np.zeros((51, 3))}
SPIN["omega_b"][:, 2] = 1.0 + 0.005 * SPIN["time"] + 0.02 * np.random.default_rng(5).normal(size=51)


def test_one_number_of_a_damping_is_bounded_as_all_of_them_are():
    """No body has the damping below zero that these data are nearest to: the rate then is the mean of theirs."""
    one = rbfmu.fit(SPINNING, SPIN, ["loads.damping_b[3]", "initial.omega_b[3]"], sigma=0.02)
    np.testing.assert_allclose(one.values, [0.0, SPIN["omega_b"][:, 2].mean()], rtol=0, atol=1e-6)


@pytest.mark.thorough
def test_residuals_are_drawn(found):
    panels = found.plot().axes
    assert [axes.get_ylabel() for axes in panels] == ["omega_b", "attitude"]
    shown, expected = panels[0].lines[0].get_ydata(), found.residuals["omega_b"][:, 0] / found.sigma["omega_b"]
    np.testing.assert_array_equal(shown, np.clip(expected, -6.0, 6.0))
    assert "initial.omega_b[1]" in repr(found)


@pytest.mark.thorough
def test_nasas_tumbling_brick_is_found_from_a_simulation_of_nasas():
    """Simulation 01 of NASA/TM-2015-218675, case 2, to its printed digits: ratios of moments, rates at the start."""
    brick = rbfmu.load_scene(ROOT / "examples" / "scenes" / "tumbling_brick.toml")
    rows = np.array(NASA["01"])
    guess = brick.replace({"body.inertia": [0.0027, 0.0080, 0.0093], "initial.omega_b": [0.18, 0.34, 0.5]})
    data = {"time": rows[:, 0], "omega_b": np.radians(rows[:, 1:4])}
    one = rbfmu.fit(guess, data, ["body.inertia", "initial.omega_b"])
    fitted, true = np.diag(one.scene.body.inertia), np.diag(brick.body.inertia)
    np.testing.assert_allclose(fitted / fitted[0], true / true[0], rtol=1e-8)
    np.testing.assert_allclose(np.degrees(one.scene.initial.omega_b), [10.0, 20.0, 30.0], rtol=1e-8)


@pytest.mark.parametrize(("asked", "said"), [
    ({"free": []}, "free: expected at least one key"),
    ({"free": ["body.colour"]}, r"'body\.colour': expected one of"),
    ({"free": ["body.inertia[1,1]"]}, r"expected body\.inertia as a whole"),
    ({"free": ["initial.attitude[3]"]}, r"initial\.attitude\[3\]': expected initial\.attitude as a whole"),
    ({"free": ["initial.omega_b", "initial.omega_b[1]"]}, "expected each number once"),
    ({"free": ["initial.omega_b", "initial.omega_b"]}, "expected each number once"),
    ({"loss": "square"}, "loss = 'square': expected one of linear"),
    ({"sigma": 0.0}, r"sigma: omega_b = 0\.0: expected a number > 0"),
    ({"sigma": {"rpy": 1.0}}, "sigma: 'rpy': expected some of omega_b"),
    ({"data": 3.0}, "expected a file, a Result, a DataFrame, or a mapping"),
    ({"data": {"time": [0, 1], "omega_b": [[1, 2], [1, 2]]}}, r"omega_b has shape \(2, 2\): expected \(2, 3\)"),
    ({"data": {"time": [0, 1], "omega_b": "x"}}, "omega_b must be real numbers"),
    ({"data": {"time": [0, 1], "omega_b": [[1, 2, 3], [1]]}}, "omega_b: expected an array of numbers"),
    ({"data": {"time": np.array([0, 1], "timedelta64[s]"), "omega_b": np.ones((2, 3))}}, "time must be real numb"),
    ({"data": {"time": [0, 1], "omega_b": np.ma.masked_less(np.eye(2, 3), 1)}}, "omega_b must have no mask"),
    ({"data": {"time": [0, 1], "rpy": [0.0, 1.0]}}, r"rpy has shape \(2,\): expected \(2, 3\)"),
    ({"data": {"time": [0, 1], "momentum": [1.0, 2.0]}}, r"momentum has shape \(2,\): expected \(2, 3\)"),
    ({"data": {"time": [0, 1], "energy": np.ones((2, 3))}}, r"energy has shape \(2, 3\): expected \(2, 1\)"),
    ({"data": {"time": [0, 1], "omega_b": [[1, 1, 1], [None] * 3]}}, "3 numbers: expected at least 4, more than"),
])  # fmt: skip
def test_what_cannot_be_fitted_is_refused_by_one_message(asked, said):
    outputs = {"momentum": "M_c @ omega_b", "energy": "dot(omega_b, M_c @ omega_b)"}
    scene = SPINNING.replace({"initial.omega_b": [1.0, 0.1, 0.2], "loads": None}, outputs=outputs)
    data = {"time": [0.0, 1.0, 2.0], "omega_b": np.ones((3, 3))}
    with pytest.raises(ValueError, match=said):
        rbfmu.fit(scene, **{"data": data, "free": ["initial.omega_b"], **asked})


def test_inputs_may_be_rows_for_the_scene_s_own_steps():
    """A fit takes one step, and told that it expected one row."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}, "initial": {"omega_b": [0.1, 0.2, 0.3]},
              "inputs": {"ports": ["torque_b"]}, "outputs": {"quantities": ["omega_b"]},
              "run": {"stop": 2.0, "step": 0.1}}  # fmt: skip
    scene, torque = rbfmu.Scene.from_dict(tables), np.linspace(0.0, 0.5, 60).reshape(20, 3)
    measured = rbfmu.simulate(scene, inputs={"torque_b": torque}).until(1.5)
    start = scene.replace({"initial.omega_b": [0.0, 0.1, 0.2]})
    found = rbfmu.fit(start, measured, ["initial.omega_b"], np.float32(1e-3), inputs={"torque_b": torque})
    np.testing.assert_allclose(found.values, [0.1, 0.2, 0.3], rtol=0, atol=1e-6)
    with pytest.raises(rbfmu.SceneError, match=r"inputs 'torque_b': shape \(19, 3\): expected .* or 20 rows"):
        rbfmu.fit(start, measured, ["initial.omega_b"], inputs={"torque_b": torque[1:]})


def test_a_part_of_the_time_that_has_the_start_alone_is_left_out():
    """Inputs have no value in a run without steps, which was a bare IndexError. An event ends no run of a fit."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}, "initial": {"omega_b": [0.1, 0.2, 0.3]},
              "inputs": {"ports": ["torque_b"]}, "outputs": {"quantities": ["quaternion", "omega_b"]},
              "constants": {"k": 0.1}, "loads": {"torque_b": "-k*omega_b"},
              "run": {"stop": 3.0, "step": 0.1}}  # fmt: skip
    scene = rbfmu.Scene.from_dict(tables)
    start = scene.replace({"constants.k": 0.2, "events": {"turned": {"when": "omega_b[1] - 0.09", "stop": True}}})
    inputs = {"torque_b": (np.array([0.0, 2.0]), np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]))}
    measured = rbfmu.simulate(scene, inputs=inputs)
    found = rbfmu.fit(start, measured, ["constants.k"], inputs=inputs)
    assert found.values[0] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.slow
def test_a_long_search_is_ended_or_said_to_have_no_end(monkeypatch):
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 2.0, "inertia": [[1.2, 0.1, -0.05], [0.1, 2.0, 0.08], [-0.05, 0.08, 2.5]]},
        "initial": {"omega_b": [0.3, 1.2, 0.2], "attitude": {"rotvec": [0.1, 0.2, 0.3]}},
        "inputs": {"ports": ["torque_b"]}, "outputs": {"quantities": ["quaternion"]},
        "run": {"stop": 20.0, "step": 0.25},
    })  # fmt: skip
    t, rng = np.linspace(0.0, 20.0, 81), np.random.default_rng(1027)
    inputs = {"torque_b": (t, np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(1.7 * t), 0.1 * np.sin(2.3 * t + 1.0)]))}
    noise = rbfmu.quaternion_from_rotvec(0.05 * rng.normal(size=(81, 3)))
    data = {"time": t, "quaternion": rbfmu.compose_quaternions(rbfmu.simulate(scene, inputs=inputs).quaternion, noise)}
    start = scene.replace({"initial.attitude": {"rotvec": [0.0, 0.0, 0.0]}})
    keys = ["body.inertia", "initial.omega_b", "initial.attitude"]
    one = rbfmu.fit(start, data, keys, sigma=0.05, inputs=inputs)
    true = [1.2, 2.0, 2.5, 0.1, -0.05, 0.08, 0.3, 1.2, 0.2]
    assert one.doubts == ()
    assert np.max(np.abs(one.values[:9] - true) / one.standard_errors[:9]) < 4.0
    monkeypatch.setattr("rbfmu.identification.fit.MOST_LAST", 60)
    assert rbfmu.fit(start, data, keys, sigma=0.05, inputs=inputs).doubts[0].startswith("the search came to no end")


@pytest.mark.thorough
def test_a_hopeless_start_comes_to_an_end():
    rng = np.random.default_rng(RNG_SEED + 4)
    scene = fits.truth(rng)
    data = fits.measured(rng, scene)
    far = scene.replace({"initial.omega_b": [8.0, -9.0, 2.0]})
    one = rbfmu.fit(far, {name: rows[20:27] for name, rows in data.items()}, ["initial.omega_b"], sigma=0.01)
    assert one.doubts


@pytest.mark.slow
def test_data_that_lead_to_ever_stiffer_motions_end_a_search_where_runs_become_long(monkeypatch):
    """Rates of zero under a torque ask for damping without end."""
    counted, along = [], Varied.along
    monkeypatch.setattr(Varied, "along", lambda self, *of: (along(self, *of), counted.append(self.substeps))[0])
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, outputs={"quantities": ["omega_b"]}, run={"stop": 10.0},
        loads={"torque_b": [0.1, 0.05, 0.02], "damping_b": [0.1, 0.1, 0.1]},
    )  # fmt: skip
    data = {"time": np.linspace(0.0, 10.0, 101), "omega_b": np.zeros((101, 3))}
    one = rbfmu.fit(scene, data, ["loads.damping_b"], sigma=1e-3)
    assert one.doubts[0].startswith("the search leads to runs of more than 3.0e+05 substeps, which are refused")
    assert max(counted) <= 3e5


@pytest.mark.slow
def test_a_fit_is_no_worse_than_its_beginning_though_the_first_data_lead_away():
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [0.3, 1.2, 0.2]},
        outputs={"quantities": ["quaternion"]}, run={"stop": 60.0, "step": 0.2},
    )  # fmt: skip
    run, faster = rbfmu.simulate(scene), rbfmu.simulate(scene.replace({"initial.omega_b": [0.3, 2.0, 0.2]}))
    measured = np.concatenate([faster.quaternion[:37], run.quaternion[37:]])
    found = rbfmu.fit(scene, {"time": run.time, "quaternion": measured}, ["initial.omega_b"])
    np.testing.assert_allclose(found.values, scene.initial.omega_b, atol=0.05)
