"""The noise of measured data: given, estimated, and what errors rest on; how numbers vary in a fit."""

import warnings

import numpy as np
import pytest
from scipy import stats

import rbfmu
from rbfmu.ensembles.variables import symmetric
from rbfmu.identification.charts import changes, chart_of
from rbfmu.identification.measured import sigma_of
from rbfmu.identification.noise import are_too_few, estimated, too_large, trends

RNG_SEED = 20261123


def test_as_many_data_as_numbers_leave_the_noise_that_is_given():
    """Nothing is left of them, and the errors were told to be zero."""
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [1.0, 0.1, 0.2]})
    data = {"time": [0.0, 1.0], "omega_b": [[1.1, 0.2, 0.1], [np.nan] * 3]}
    found = rbfmu.fit(scene, data, ["initial.omega_b"], sigma=0.01)
    assert found.values == pytest.approx(data["omega_b"][0], abs=1e-9)
    assert found.standard_errors == pytest.approx(0.01, rel=1e-3)


def test_a_noise_that_is_given_makes_the_errors_whatever_residuals_are():
    """They were scaled by residuals: those of two rows that happen to be alike told errors of zero."""
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"omega_b": [1.0, 0.1, 0.2]})
    rows = np.array([[1.0, 0.1, 0.2], [1.0, 0.1, 0.2 + 1e-6]])
    found = rbfmu.fit(scene, {"time": [0.0, 1.0], "omega_b": rows}, ["initial.omega_b"], sigma=0.01)
    assert found.standard_errors == pytest.approx(0.01 / np.sqrt(2.0), rel=1e-3)
    assert found.doubts == ()
    f, given = np.random.default_rng(RNG_SEED + 5).normal(size=900), {"omega_b": 0.01}
    assert too_large(f, given) == too_large(1.3 * f, {}) == too_large(1.3 * f[:60], given) == []
    assert too_large(1.3 * f, given)[0].startswith("residuals are 1.3")


def test_successive_residuals_that_follow_each_other_are_doubted_and_a_few_far_ones_are_not():
    noise = 0.01 * np.random.default_rng(RNG_SEED + 8).normal(size=(200, 1))
    drift, outliers = 0.01 * np.sin(np.arange(200.0) / 20.0)[:, None], np.zeros((200, 1))
    outliers[90:93] = 1.0
    assert trends({"spin": noise}) == trends({"spin": noise + outliers}) == trends({"spin": (noise + drift)[:16]}) == []
    assert "residuals of spin follow each other" in trends({"spin": noise + drift})[0]
    names = [said.split()[2] for said in trends({"quaternion": np.tile(noise + drift, 3)})]
    assert names == ["attitude[1]", "attitude[2]", "attitude[3]"]


def test_residuals_within_the_scenes_accuracy_are_no_sign_of_a_wrong_model():
    """Data that rbfmu itself had made, without noise, left its own errors, which follow each other."""
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [0.5, 0.2, -0.3]},
        constants={"k": 0.3}, loads={"torque_b": "-k*norm(omega_b)*omega_b"}, outputs={"quantities": ["omega_b"]},
        run={"stop": 5.0, "step": 0.05},
    )  # fmt: skip
    run = rbfmu.simulate(scene.replace({"run.accuracy": 1e-12}))
    guess = scene.replace({"run.accuracy": 1e-4, "initial.omega_b": [0.4, 0.25, -0.2]})
    slow = np.linspace(-1.0, 1.0, len(run.time))[:, None]
    for off, said in ((3e-5, 0), (3e-3, 3)):
        data = {"time": run.time, "omega_b": run.omega_b + off * np.max(np.abs(run.omega_b)) * slow**2}
        assert len(rbfmu.fit(guess, data, ["initial.omega_b"]).doubts) == said


def test_errors_of_positions_are_relative_to_a_metre_at_least():
    """As the accuracy counts them, so that a vibration of 1e-5 m may be off by 1e-6 m at 1e-6."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "outputs": {"quantities": ["position"]}}
    still = {"loads": {"gravity_a": [0.0, 0.0, 0.0]}, "initial": {"velocity": [1e-5, 0.0, 0.0]}}
    scene = rbfmu.Scene.from_dict(tables | still | {"run": {"stop": 1.0, "step": 0.02}})
    t = np.linspace(0.0, 1.0, 51)
    for off, said in ((5e-7, 0), (5e-6, 1)):
        data = {"time": t, "position": np.outer(1e-5 * t + off * (2.0 * t - 1.0) ** 3, [1.0, 0.0, 0.0])}
        assert len(rbfmu.fit(scene, data, ["initial.velocity[1]"]).doubts) == said


@pytest.mark.thorough
def test_the_noise_of_few_numbers_of_an_output_is_what_the_fit_leaves_of_them():
    """One attitude, which the fit follows, told a noise of 1e-15 rad, and the attitude up to 50 standard errors off."""
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"omega_b": [1.0, 0.1, 0.2]})
    rng, turn = np.random.default_rng(RNG_SEED + 6), np.full((20, 3), np.nan)
    turn[0] = [0.01, 0.02, -0.02]
    rates = scene.initial.omega_b + 0.01 * rng.normal(size=(20, 3))
    data = {"time": np.arange(20.0), "omega_b": rates, "quaternion": rbfmu.quaternion_from_rotvec(turn)}
    with pytest.raises(ValueError, match=r"3 numbers of quaternion: the fit follows them.* expected its sigma"):
        rbfmu.fit(scene, data, ["initial.omega_b", "initial.attitude"])
    found = rbfmu.fit(scene, data, ["initial.omega_b", "initial.attitude"], {"quaternion": 0.01})
    assert found.standard_errors[3:] == pytest.approx(0.01, rel=0.3)
    assert found.sigma["omega_b"] == pytest.approx(0.01, rel=0.3)
    assert estimated("omega_b", rng.normal(size=(4, 3)), 6.0) == pytest.approx(np.sqrt(2.0), rel=0.5)


@pytest.mark.parametrize("loss", ["linear", "cauchy"])
def test_columns_that_always_are_zero_tell_no_noise(loss):
    """With two of three, a robust loss told errors of 1e-17, and least squares too small ones."""
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"omega_b": [1.0, 0.0, 0.0]})
    rates = np.zeros((30, 3))
    rates[:, 0] = 1.0 + 0.01 * np.random.default_rng(RNG_SEED + 7).normal(size=30)
    with warnings.catch_warnings(action="error"):
        found, alone = (
            rbfmu.fit(scene, {"time": np.arange(30.0), "omega_b": rates * one}, ["initial.omega_b[1]"], loss=loss)
            for one in ([1.0, 1.0, 1.0], [1.0, np.nan, np.nan])
        )
    assert found.standard_errors == pytest.approx(alone.standard_errors, rel=1e-6)
    assert found.sigma["omega_b"] == pytest.approx(alone.sigma["omega_b"], rel=1e-6)


def test_noise_is_a_number_or_a_file(tmp_path):
    assert sigma_of("0.01") == 0.01
    (tmp_path / "s.csv").write_text("omega_b,quaternion\n0.01,0.002\n")
    assert sigma_of(str(tmp_path / "s.csv")) == {"omega_b": 0.01, "quaternion": 0.002}
    (tmp_path / "s.csv").write_text("omega_b\n")
    with pytest.raises(ValueError, match="a row of outputs' names and a row"):
        sigma_of(str(tmp_path / "s.csv"))
    with pytest.raises(ValueError, match="sigma = '0,01': expected a number, or a CSV file of these"):
        sigma_of("0,01")


def test_noise_is_as_much_larger_than_residuals_as_a_fit_follows_numbers():
    rows = np.random.default_rng(3).normal(size=(20, 1))
    assert estimated("omega_b", rows, 15.0) == pytest.approx(2.0 * estimated("omega_b", rows, 0.0))
    with pytest.raises(ValueError, match="20 numbers of omega_b: the fit follows them"):
        estimated("omega_b", rows, 19.6)


def test_residuals_of_any_number_may_be_a_tenth_larger_than_the_noise_given():
    f = stats.norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    assert [len(too_large(size * f, {"omega_b": 1.0})) for size in (1.09, 1.11)] == [0, 1]


def test_so_many_rows_as_tell_a_trend_tell_noise():
    """Of 11 to 16 rows residuals were said to look like noise, though no correlation of so few can be doubted."""
    ramp = np.linspace(-1.0, 1.0, 40)[:, None]
    assert are_too_few({"spin": ramp[:16], "rate": np.where(np.arange(40)[:, None] < 16, ramp, np.nan)})
    assert not are_too_few({"spin": ramp[:16], "rate": ramp[:17]})
    assert trends({"spin": np.tile([[1.0], [1.0], [-1.0], [-1.0]], (4, 1))}) == [] != trends({"spin": ramp})


@pytest.mark.slow
def test_where_products_of_inertia_are_missing_a_doubt_says_how_they_vary():
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.2], [0.0, 0.2, 2.5]]},
        initial={"omega_b": [0.5, 0.8, -0.3]}, loads={"torque_b": [0.05, 0.0, 0.1]},
        outputs={"quantities": ["omega_b"]}, run={"stop": 10.0, "step": 0.25},
    )  # fmt: skip
    run, keys = rbfmu.simulate(scene), ["body.inertia", "initial.omega_b"]
    said, without = "body.inertia has no products", scene.replace({"body.inertia": [1.0, 2.0, 2.5]})
    assert rbfmu.fit(without, run, keys).doubts[-1].startswith(said)
    assert rbfmu.fit(scene, run, keys).doubts == ()
    assert not any(said in doubt for doubt in rbfmu.fit(without, run, ["initial.omega_b"]).doubts)


# How numbers vary: inside what a body can have, in units of their own, attitudes by turns


@pytest.mark.parametrize("inertia", [[1.0, 2.0, 2.5], [[1.0, 0.1, 0.2], [0.1, 1.5, -0.3], [0.2, -0.3, 2.0]]])
def test_an_inertia_stays_one_that_a_body_can_have(inertia):
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": inertia})
    chart = chart_of(scene, "body.inertia")
    rng = np.random.default_rng(1)
    for p in rng.normal(size=(50, chart.count)) * 2.0:
        rbfmu.check_inertia(np.array(chart.value(p)))
    p, step = 0.1 * rng.normal(size=chart.count), 1e-6 * np.eye(chart.count)
    slopes = np.array([(chart.numbers(p + dp) - chart.numbers(p - dp)) / 2e-6 for dp in step]).T
    np.testing.assert_allclose(chart.slopes(p), slopes, rtol=0, atol=1e-8)
    np.testing.assert_allclose(chart.value(0.0 * p), scene.body.M_c, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("inertia", [[1.0, 2.0, 2.5], [[1.0, 0.1, 0.2], [0.1, 1.5, -0.3], [0.2, -0.3, 2.0]]])
def test_an_inertia_with_products_is_at_the_edge_within_an_error_of_what_no_body_has(inertia):
    """The least of the second moments, tr(M) / 2 - M, is to be positive."""
    chart = chart_of(rbfmu.Scene(body={"mass": 1.0, "inertia": inertia}), "body.inertia")

    def least(numbers):
        M = symmetric(np.append(numbers, [0.0] * (6 - len(numbers)))[None])[0]
        return np.linalg.eigvalsh(0.5 * np.trace(M) * np.eye(3) - M)[0]

    p = 0.1 * np.random.default_rng(1).normal(size=chart.count)
    at, steps = chart.numbers(p), 1e-6 * np.eye(chart.count)
    error = np.linalg.norm([(least(at + step) - least(at - step)) / 2e-6 for step in steps])
    sizes = least(at) / error * np.array([0.999, 1.001])
    told = [chart.is_at_edge(p, size**2 * np.eye(chart.count)) for size in sizes]
    assert told == [False, chart.count == 6]  # three moments alone are as straight there as elsewhere


@pytest.mark.slow
def test_errors_of_an_inertia_at_the_edge_of_what_bodies_have_are_doubted():
    """The sum of squares of 486 numbers is 483 there and 500 at the truth, which is ten standard errors away."""
    rng = np.random.default_rng(25)
    x, y, z = rng.uniform(0.3, 1.0, 3)
    R = rbfmu.matrix_from_rotvec(rng.normal(size=3))
    inertia = R @ np.diag([y + z, z + x, x + y]) @ R.T
    scene = rbfmu.Scene(
        body={"mass": 1.5, "inertia": 0.5 * (inertia + inertia.T)},
        initial={"omega_b": rng.uniform(-1.0, 1.0, 3), "attitude": {"rotvec": rng.uniform(-1.0, 1.0, 3)}},
        loads={"torque_b": rng.uniform(-0.4, 0.4, 3), "damping_b": [0.1, 0.2, 0.15]},
        outputs={"quantities": ["omega_b", "quaternion"]}, run={"stop": 8.0, "step": 0.1, "accuracy": 1e-7},
    )  # fmt: skip
    rng.random(6)
    run, keys = rbfmu.simulate(scene), ["body.inertia", "loads.damping_b", "initial.attitude", "initial.omega_b"]
    data = {"time": run.time, "omega_b": run.omega_b + 0.02 * rng.normal(size=(81, 3))}
    turns = rbfmu.quaternion_from_rotvec(0.02 * rng.normal(size=(81, 3)))
    one = rbfmu.fit(scene, data | {"quaternion": rbfmu.compose_quaternions(run.quaternion, turns)}, keys)
    true = np.array(scene.body.inertia)[np.triu_indices(3)][[0, 3, 5, 1, 2, 4]]
    assert np.max(np.abs(one.values[:6] - true) / one.standard_errors[:6]) > 5.0
    assert one.doubts == ("body.inertia is within its error of what no body has: errors may be far too small",)


def test_an_inertia_shrinks_no_further_than_a_mass():
    """A search that came to a rod of 2e-12 kg m2 under a torque took hours: its rates grow by how thin it is."""
    scene = rbfmu.Scene(body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]})
    for key, lowest in (("body.mass", 2.0), ("body.inertia", 0.25)):
        chart = chart_of(scene, key)
        low, high = chart.bounds
        assert np.all(chart.numbers(np.minimum(low, 0.0)) > 1e-7 * lowest)
        assert np.all(chart.numbers(np.maximum(high, 0.0))[:3] > 1e6 * lowest)


def test_a_number_that_gets_a_larger_unit_stays_what_it_is():
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}
    scene, p = rbfmu.Scene(body=body, loads={"torque_b": [1.0, 0.0, 0.5]}), np.array([50.0, 0.0, 3.0])
    chart = chart_of(scene, "loads.torque_b")
    before = chart.numbers(p)
    assert chart.outgrown(p)
    np.testing.assert_allclose(chart.numbers(p), before, rtol=1e-15)
    assert p[0] == pytest.approx(50.0 / 51.0)
    assert not chart.outgrown(p)


def test_numbers_of_one_vector_that_are_free_one_by_one_all_change():
    scene = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [4.0, 2.0, 1.0]})
    charts = [chart_of(scene, f"initial.omega_b[{k}]") for k in (1, 3)]
    assert changes(charts, np.array([0.5, -1.0])) == {"initial.omega_b": [6.0, 2.0, -3.0]}


def test_an_attitude_varies_by_turns_of_any_size():
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"attitude": {"rotvec": [1.0, 2.0, 0.3]}}
    )
    chart, p = chart_of(scene, "initial.attitude"), np.array([0.8, -0.5, 1.1])

    def q_ab(x):
        return np.array(chart.value(x)["quaternion"])

    for k in range(3):
        dp = 1e-6 * np.eye(3)[k]
        turn = rbfmu.compose_quaternions(q_ab(p - dp) * [1, -1, -1, -1], q_ab(p + dp))
        np.testing.assert_allclose(chart.slopes(p)[:, k], turn[1:] / 1e-6, rtol=0, atol=1e-9)
