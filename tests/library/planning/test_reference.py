"""The motion that plans are judged by, against quadruple precision; and what the judge makes of it."""

import math
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numba import config

import rbfmu
import rbfmu_fmu
from rbfmu import Scene, SceneError, on_disk
from rbfmu.exceptions import PlanningWarning
from rbfmu.models.question import Question
from rbfmu.planning import fitting, judge as judge_module, reference as reference_module, select
from rbfmu.planning.judge import Judge, least_accuracy
from rbfmu.planning.reference import ReferenceTooLongError, reference_motion
from rbfmu.planning.select import plan
from rbfmu.runs.inputs import drive_of, input_tables
from rbfmu.runs.motion import attitude_error, relative_error
from rbfmu.runs.plan import Plan
from rbfmu.runs.steps import record
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu_kernels.integrators.substeps import tolerance_of_substep
from tests.support.command_line import call
from tests.support.quadruple import reference as quadruple
from tests.support.scenes.balls import ball
from tests.support.scenes.model_cases import MOVING, OFFSET

EPS = 2.0**-52
HELD = {"omega_b": MOVING["omega_b"], "attitude": MOVING["attitude"]}
LOADS = {
    "gravity_a": [0.3, -0.1, -9.81], "force_a": [0.2, 0.1, -0.3], "force_b": [0.1, -0.4, 0.2],
    "torque_a": [0.05, 0.02, -0.1], "torque_b": [0.1, -0.2, 0.15], "damping_b": [0.1, 0.02, 0.05],
}  # fmt: skip
QUIET = {"gravity_a": [0.0, 0.0, 0.0]}
SLENDER = 2.0 * (np.eye(3) - np.outer([2.0, 3.0, 6.0], [2.0, 3.0, 6.0]) / 49.0)
ALONG = np.cross([2.0, 3.0, 6.0], [1.0, 0.5, -2.0])
CASES = {
    "all loads": (OFFSET, MOVING, LOADS),
    "all loads on a pivot": (OFFSET | {"pivot": True}, HELD, LOADS),
    "free of torque": (OFFSET, MOVING, QUIET),
    "beam": ({"mass": 1.0, "inertia": SLENDER.tolist()}, {"omega_b": ALONG.tolist()}, QUIET),
    "from rest": ({"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, {}, QUIET | {"torque_b": [0.1, 0.0, 0.3]}),
    "small and fast": ({"mass": 1e-9, "inertia": [1e-18, 2e-18, 2.5e-18]}, {"omega_b": [3e5, 1e5, 2e5]}, QUIET),
}
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="too many steps to interpret")


def scene_of(name, **run):
    body, initial, loads = CASES[name]
    return Scene(body=body, initial=initial, loads=loads, run={"stop": 8.0, "step": 0.5, "accuracy": 1e-9} | run)


@compiled
@pytest.mark.skipif(quadruple.library() is None, reason="no C compiler with quadruple precision")
@pytest.mark.parametrize("name", CASES)
def test_the_reference_is_exact_to_the_last_digit_of_a_double(name):
    scale = 1e-5 if name == "small and fast" else 1.0
    scene, steps = scene_of(name), [0.0078125 * scale, 1.0 * scale, 4.0 * scale, 2.9921875 * scale]
    found, truth = reference_motion(scene, steps, 10**6), quadruple.motion(quadruple.parameters_of(scene), steps)
    assert np.max(attitude_error(found["quaternion"], np.array(truth.high["quaternion"]))) <= 4 * EPS
    for quantity, rows in found.items():
        if quantity != "quaternion":
            exact = np.array(truth.high[quantity]).reshape(rows.shape)
            # 5.5 eps of a beam's acceleration, which is round-off of its inertia; else below 1
            assert np.max(relative_error(rows, exact, 0.0)) <= 6 * EPS, quantity


def test_the_reference_tells_its_progress_and_stops_where_it_would_take_too_long():
    parts = []
    reference_motion(scene_of("from rest"), [0.1] * 20, 10**6, parts.append)
    assert parts == [1.0]
    with pytest.raises(ReferenceTooLongError):
        reference_motion(scene_of("from rest"), [1e4], 10)


@compiled
def test_the_judge_sees_an_error_in_every_quantity_and_none_in_a_tight_plan():
    scene = scene_of("all loads")
    tight = Plan("body under loads, by series", "", 13, tolerance=1e-16, order=20)
    for quantity in scene.outputs.quantities:
        judge = Judge(Question(scene.replace({"outputs.quantities": [quantity]})))
        loose = Plan("body under loads, by series", "", 13, tolerance=1e-4, order=6)
        assert judge.try_out(tight)[0] <= 1e-13, quantity
        assert judge.try_out(loose, at_once=16)[0] >= 1e-10, quantity


@pytest.mark.parametrize("error", [1e-14, 5.54e-13, 9.96e-13, 1.04e-7, 2.949])
def test_an_accuracy_that_is_told_is_no_less_than_the_error(error):
    assert error <= float(least_accuracy(error)) <= 1.1 * error


@compiled
def test_how_far_the_truth_may_be_off_counts_against_each_plan(monkeypatch):
    scene = scene_of("all loads").replace({"inputs.ports": ["torque_b"]})
    judge, found = Judge(Question(scene)), plan(scene)
    judge.doubt = 0.25
    assert judge.try_out(found)[0] == pytest.approx(0.25, rel=1e-6)
    tables = input_tables(scene, {"torque_b": np.full((16, 3), 0.1)}, "hold")
    monkeypatch.setattr(select, "largest_error", lambda *_: 0.25)  # of two series, and of each plan
    with pytest.raises(SceneError, match=r"the methods here reach 5\.0e-01 with them"):
        select.plan_for_inputs(Question(scene), found, partial(drive_of, scene, tables, "hold"))


@pytest.mark.thorough
@compiled
def test_round_off_of_all_steps_is_counted_where_pilot_runs_take_several_at_once():
    body, start = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, {"omega_b": [3.0, 5.0, -4.0]}
    loads = QUIET | {"torque_b": [0.01, 0.02, -0.03]}
    scene = Scene(body=body, initial=start, loads=loads, outputs={"quantities": ["quaternion"]},
                  run={"stop": 10.0, "step": 1e-4, "accuracy": 1e-9})  # fmt: skip
    judge, tight = Judge(Question(scene)), Dop853Plan("body under loads", "DOP853", 13, tolerance=1e-15)
    few, _ = judge.try_out(tight)
    assert judge.try_all_steps(replace(tight, error=few)) >= 2.0 * few


def test_what_is_but_round_off_of_the_loads_counts_relative_to_them():
    """A body that hangs, in an attitude that doubles cannot make exact: its rates are some 1e-17."""
    start = {"attitude": {"euler": "ZYX", "angles_deg": [180.0, 180.0, 0.0]}}
    body = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.0, 0.0, 1.0], "pivot": True}
    run = {"stop": 2.0, "step": 0.1, "accuracy": 1e-6}
    scene = Scene(body=body, initial=start, loads={"gravity_a": [0.0, 0.0, -9.81]}, run=run)
    judge = Judge(Question(scene))
    rates = np.linalg.norm(judge.motion["omega_b"], axis=1)
    assert 0.0 < np.max(rates) < 1e-12 < 1.0 < judge.floors["omega_b"]
    assert plan(scene).error <= 1e-6


@compiled
@pytest.mark.parametrize("mass", [1.0, 1e18])
@pytest.mark.parametrize("decay", [90.0, 9000.0])
def test_a_body_that_comes_to_rest_is_followed(mass, decay):
    """omega_0 exp(-d t / I), until doubles have no number as small; errors count relative to the largest rate."""
    loads, run = QUIET | {"damping_b": [mass * decay] * 3}, {"stop": 1.0, "step": 0.25, "accuracy": 1e-6}
    body = {"mass": mass, "inertia": [2.0 * mass, mass, mass]}
    scene = Scene(body=body, initial={"omega_b": [0.0, 0.3, 0.0]}, loads=loads, run=run)
    rates = reference_motion(scene, [0.25] * 4, 50_000)["omega_b"][:, 1]
    truth = 0.3 * np.exp(-decay * 0.25 * np.arange(5))
    np.testing.assert_allclose(rates, truth, rtol=1e-12, atol=1e-22 * 0.3)


@compiled
def test_a_pendulum_that_has_come_to_rest_is_planned():
    """It was said to reach inf, as it magnifies round-off: the unit of time had no bound, and NaN was passed over."""
    body = {"mass": 0.16, "inertia": [1.0, 0.7, 0.6], "pivot": True, "r_oc_b": [-0.9, 0.0, 0.8]}
    loads = {"gravity_a": [4.9, 0.0, -8.5], "damping_b": [0.0, 5.0, 0.0]}
    scene = Scene(body=body, initial={"omega_b": [0.0, 2.9, 0.0]}, loads=loads, outputs={"quantities": ["omega_b"]},
                  run={"stop": 300.0, "step": 7.5, "accuracy": 1e-2})  # fmt: skip
    assert plan(scene).error <= 1e-2


@compiled
@pytest.mark.parametrize(("bound", "most", "words"), [
    ("MAX_SUBSTEPS", 20, r"[0-9.e+]+ substeps take it on by [0-9.]+ s: it turns at [0-9.]+ rad/s"),
    ("MAX_TRIED", 20, r"pilot runs take more than 2e\+01 substeps"),
])  # fmt: skip
def test_a_run_too_long_to_be_planned_is_refused(bound, most, words, monkeypatch):
    monkeypatch.setattr(judge_module, "MAX_REFERENCE_STEPS", 5)
    monkeypatch.setattr(judge_module, bound, most)
    too_long = pytest.raises(SceneError, match=r"run\.stop = 8\.0: expected a shorter run, as " + words)
    with pytest.warns(PlanningWarning), too_long:
        plan(scene_of("all loads"))


@pytest.mark.parametrize(("rates", "substeps", "words"), [
    ([0.3, 1e-6, np.nan], 4e6, r"4\.0e\+06 substeps take it on by 0\.0001 s: damping is stiff, or another load"),
    ([1e9, 1e12, np.nan], 4e6, r"4\.0e\+06 substeps take it on by 0\.0001 s: it turns at 1e\+12 rad/s$"),
    ([0.3, np.nan, np.nan], 0, r"the 0\.0001 s from t = 0 s take too many substeps, or .* numbers: damping is stiff"),
    ([1e9, np.nan, np.nan], 0, r"the 0\.0001 s from t = 0 s take too many .* numbers: it turns at 1e\+09 rad/s$"),
    ([1e9, 2.0, np.nan], 50, r"the 0\.5 s from t = 0\.0001 s take too many .* numbers: damping is stiff, or another"),
])  # fmt: skip
def test_a_motion_that_was_given_up_says_how_far_it_came_and_why(rates, substeps, words):
    """As where series in doubles are refused, though those of more digits are not."""
    rows = np.array([[rate, 0.0, 0.0] for rate in rates])
    with pytest.raises(SceneError, match=r"run\.stop = 8\.0: expected a shorter run, as " + words):
        judge_module.refuse_unfinished(scene_of("all loads"), [1e-4, 0.5], rows, substeps)


def test_a_motion_that_was_given_up_says_when_by_the_clock_of_its_run():
    scene = scene_of("all loads").replace(run={"start": 3.0, "stop": 11.0})
    rows = np.array([[rate, 0.0, 0.0] for rate in (1e9, 2.0, np.nan)])
    with pytest.raises(SceneError, match=r"the 0\.5 s from t = 3\.0001 s take too many"):
        judge_module.refuse_unfinished(scene, [1e-4, 0.5], rows, 50)


@compiled
@pytest.mark.parametrize(
    ("tables", "named"),
    [({"events": {"e": "sqrt(1 - t)"}}, "events.e"), ({"outputs": {"o": "sqrt(1 - t)"}}, "outputs.o")],
)
def test_what_is_not_finite_from_a_time_on_is_named(tables, named):
    scene = scene_of("all loads").replace(tables)
    said = rf"run\.stop = 8\.0: expected one before t = 1\.\d* s, where {named} is not finite"
    with pytest.raises(SceneError, match=said):
        plan(scene)
    with pytest.raises(SceneError, match=rf"{named}: expected finite numbers with these parameters"):
        plan(scene.replace({named: "sqrt(t - 1)"}))


@compiled
def test_a_run_too_long_to_be_planned_under_its_inputs_is_refused(monkeypatch):
    scene = scene_of("all loads").replace({"inputs.ports": ["torque_b"]})
    found, tables = plan(scene), input_tables(scene, {"torque_b": np.full((16, 3), 0.1)}, "hold")
    for module in (select, judge_module):
        monkeypatch.setattr(module, "MAX_SUBSTEPS", 5)
    with pytest.raises(
        SceneError, match=r"run\.stop = 8\.0: expected a shorter run, as [0-9.e+]+ substeps take it on by"
    ):
        select.plan_for_inputs(Question(scene), found, partial(drive_of, scene, tables, "hold"))


@compiled
def test_a_quadrature_of_too_many_points_is_not_tried(monkeypatch):
    body, loads = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, QUIET | {"force_b": [0.1, 0.2, 0.3]}
    scene = Scene(body=body, initial={"omega_b": [3.0, 1.0, 2.0]}, loads=loads, outputs={"quantities": ["position"]},
                  run={"stop": 10.0, "step": 5.0, "accuracy": 1e-6})  # fmt: skip
    judge, points = Judge(Question(scene)), []
    for most in (fitting.MAX_POINTS, 20):
        monkeypatch.setattr(fitting, "MAX_POINTS", most)
        monkeypatch.setattr(
            judge, "try_out", lambda trial, **_: points.append(trial.order * 10.0 / trial.substep) or (1.0, 0.0)
        )
        fitting.cheapest_quadrature(judge.asked, judge)
        assert (max(points) > 20) == (most > 20)
        points.clear()


@compiled
def test_long_planning_says_what_it_does(monkeypatch):
    texts, lines = [], []
    monkeypatch.setattr(select, "said_after", lambda patience, text: texts.append(text) or nullcontext())
    for module, function in ((reference_module, reference_motion), (judge_module, record)):
        told = lambda *args, now=function, **named: lines.append(texts[0]()) or now(*args, **named)  # noqa: E731
        monkeypatch.setattr(module, function.__name__, told)
    plan(scene_of("all loads"))
    assert lines[:2] == [
        "rbfmu: planning scene takes long: its motion is followed in double-double arithmetic",
        "rbfmu: planning scene takes long: methods are tried on its motion, in pilot runs",
    ]


@pytest.mark.slow
@compiled
def test_planning_that_takes_long_says_why():
    scene = scene_of("all loads", stop=0.5).replace({"loads.damping_b": [1e7, 1e7, 1e7], "outputs.quantities": ["rpy"]})
    parts = []
    with pytest.warns(PlanningWarning, match="scene: planning takes more than some seconds, for .* damping is stiff"):
        assert plan(scene, progress=parts.append).error <= 1e-9
    assert parts[-1] == 1.0


@compiled
def test_that_planning_takes_long_is_said_where_it_was_asked_for(monkeypatch, tmp_path):
    monkeypatch.setattr(judge_module, "MAX_REFERENCE_STEPS", 1)
    scene = scene_of("from rest", stop=1.0)
    for ask in (rbfmu.plan, rbfmu.simulate, partial(rbfmu_fmu.build, path=tmp_path / "it.fmu")):
        with pytest.warns(PlanningWarning) as caught:
            ask(scene)
        assert [w.filename for w in caught] == [__file__]
    path = tmp_path / "slow.toml"
    path.write_text(
        "body = { mass = 1.0, inertia = [1, 2, 2.5] }\nloads = { gravity_a = [0, 0, 0], torque_b = [0.1, 0, 0.3] }\n"
        "run = { stop = 1.0, step = 0.5, accuracy = 1e-9 }\n"
    )
    monkeypatch.setattr(on_disk, "folder", lambda *_: tmp_path)  # where no plan is kept that took long before
    said = call("plan", path).stderr.splitlines()
    assert said == [f"Warning: slow: {judge_module.LONG}"]


@pytest.mark.parametrize(("span", "part", "allowed"), [(0.0, 0.1, 1e-6), (10.0, 0.1, 1e-8), (1e9, 1e-6, EPS)])
def test_a_substep_gets_its_share_of_the_run(span, part, allowed):
    assert tolerance_of_substep(1e-6, span, part) == pytest.approx(allowed, rel=4 * EPS)
    assert math.isinf(tolerance_of_substep(math.inf, 0.0, part))


@compiled
def test_the_judge_knows_how_much_a_motion_magnifies_errors():
    """exp(lambda t) above the pivot, lambda = sqrt(m g l / I); nothing where a body hangs."""
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 0.5], "pivot": True}
    run = {"stop": 4.0, "step": 0.1, "accuracy": 1e-6}
    inputs = {"ports": ["torque_b"]}
    loads = {"gravity_a": [0.0, 0.0, -10.0]}
    for height, least, most in ((1.0, 0.2, 5.0), (-1.0, 0.0, 0.0)):
        scene = Scene(body=body | {"r_oc_b": [0.0, 0.0, height]}, loads=loads, inputs=inputs, run=run)
        scene = scene.replace({"outputs.quantities": ["quaternion"]})
        growth, law = Judge(Question(scene)).growth(), math.exp(math.sqrt(10.0 / 2.0) * 4.0)
        assert max(least * law, 1.0) <= growth <= max(most * law, 3.0)
        assert plan(scene).tolerance == pytest.approx(0.25e-6 / growth)


@compiled
def test_a_body_that_stands_upright_is_planned_and_said_to_be_unstable_and_one_that_falls_is_refused():
    body = {"mass": 1.0, "inertia": [1.0, 1.2, 0.5], "pivot": True, "r_oc_b": [0.0, 0.0, 1.0]}
    run = {"stop": 20.0, "step": 0.1, "accuracy": 1e-6}
    held = Scene(body=body, loads={"gravity_a": [0.0, 0.0, -10.0]}, inputs={"ports": ["torque_b"]}, run=run)
    listed = held.replace(inputs={"ports": [], "parameters": ["torque_b"]})
    for scene in (held, listed):
        assert any("magnifies an error" in reason for reason in plan(scene).reasons)
    falling = listed.replace({"initial.omega_b": [0.1, 0.05, 0.2], "run.accuracy": 1e-9, "run.stop": 40.0})
    with pytest.raises(SceneError, match=r"run\.accuracy = 1e-09: expected one that this scene can meet"):
        plan(falling)


@pytest.mark.parametrize(("w", "torque"), [(0.1, 1e-3), (0.2, 0.5e-3)])
def test_a_small_pulse_may_start_a_body_from_rest(w, torque):
    """2026-11-28: refused as if it changed ever faster, where e^-700 begins, or where errors of its terms are zero."""
    scene = ball(f"{torque}*exp(-((t - 10)/{w})**2)", 14.0, 1.0)
    found, _ = reference_motion(scene, [10.0, 4.0], 10_000)["omega_b"][1:, 2] / (torque * w * math.sqrt(math.pi))
    assert found == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("inputs", [{"ports": ["torque_b"]}, {"parameters": ["c"]}])
def test_a_formula_that_hardly_moves_a_body_is_planned_as_a_load_in_numbers(inputs):
    """2026-11-28: refused, also with ports, where an error of the rate is large beside the motion ("reach 1.2e+00")."""
    scene = Scene(
        body={"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, loads={"torque_b": "c*[1, 0.3, 0]"}, constants={"c": 1e-14},
        inputs=inputs, outputs={"quantities": ["omega_b"]}, run={"stop": 20.0, "step": 20.0},
    )  # fmt: skip
    found = plan(scene)
    assert found.error <= 1e-9
    assert any("magnifies an error" in reason for reason in found.reasons)
