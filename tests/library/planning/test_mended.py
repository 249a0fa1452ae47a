"""What was answered wrongly without a word, or refused without need, beside what random scenes show."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipk

import rbfmu
from rbfmu.exceptions import PlanningWarning
from rbfmu.models.question import Question
from rbfmu.planning import judge
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.steps import motion_of


@pytest.mark.parametrize("periods", [13, 89, 144])
def test_a_swing_is_no_rest_where_its_periods_meet_the_places_that_it_is_looked_at(periods):
    body = {"mass": 1.0, "inertia": [0.2, 0.2, 0.1], "r_oc_b": [0.0, 0.0, -1.0], "pivot": True}
    span = periods * 4.0 * float(ellipk(math.sin(0.05) ** 2)) * math.sqrt(1.2 / 9.81)
    initial, outputs = {"attitude": {"rotvec": [0.0, 0.1, 0.0]}}, {"quantities": ["quaternion"]}
    run = {"stop": span, "step": span, "accuracy": 1e-2}
    assert rbfmu.plan(rbfmu.Scene(body=body, initial=initial, outputs=outputs, run=run)).model == "undamped pendulum"


def test_a_plan_says_what_it_misses_in_steps_much_shorter_than_the_scenes():
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 0.6], "r_oc_b": [0.0, 0.0, 0.3], "pivot": True}
    initial = {"attitude": {"rotvec": [0.3, 0.2, 0.1]}, "omega_b": [0.35, 0.34, 0.49]}
    run, outputs = {"stop": 10.0, "step": 10.0, "accuracy": 0.03}, {"quantities": ["quaternion"]}
    scene = rbfmu.Scene(body=body, initial=initial, outputs=outputs, run=run)
    planned = rbfmu.plan(scene)
    steps = [0.25] * 40
    found, true = (
        motion_of(scene, one, steps, ["quaternion"])["quaternion"]
        for one in (planned, replace(planned, order=24, tolerance=1e-14))
    )
    worst = float(np.max(attitude_error(found, true)))
    assert worst > 2.0 * run["accuracy"]  # else choose another body
    said = re.search("in other communication steps than the scene's the error is up to (.+)", planned.reasons[-1])
    assert said
    assert 0.3 * worst < float(said[1]) < 3.0 * worst


def test_where_the_truth_is_in_doubles_what_rests_is_in_no_doubt(monkeypatch):
    """A top sleeps in a turned attitude: its angular acceleration is round-off alone, and differs between two runs."""
    monkeypatch.setattr(judge, "MAX_REFERENCE_STEPS", 10)
    turned = {"rotvec": [0.3, 0.5, -0.2]}
    down = rbfmu.rotate(rbfmu.quaternion_from_rotvec(turned["rotvec"]), [0.0, 0.0, -9.81])
    body = {"mass": 1.0, "inertia": [1.0, 1.2, 1.4], "r_oc_b": [0.0, 0.0, 0.2], "pivot": True}
    tables = {"body": body, "loads": {"gravity_a": down}, "initial": {"attitude": turned, "omega_b": [0.0, 0.0, 100.0]}}
    tables |= {"outputs": {"quantities": ["alpha_b"]}, "run": {"stop": 2.0, "step": 0.5}}
    one = judge.Judge(Question(rbfmu.Scene.from_dict(tables)))
    with pytest.warns(PlanningWarning):
        assert 0.0 < np.max(np.abs(one.motion["alpha_b"])) < 1e-9
    assert one.doubt < 1e-9


@pytest.mark.filterwarnings("ignore::rbfmu.SceneWarning")
@pytest.mark.parametrize("damping", [1.5e-18, 1.8e-18, 2.1e-18])
def test_a_smaller_model_meets_the_accuracy_with_what_the_larger_one_loses(damping):
    """It was 9.1e-12 from a model that loses 2.2e-12, and was taken at 1e-11."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0] * 3}, "initial": {"omega_b": [10.0, 0.0, 0.0]}}
    tables |= {"loads": {"damping_b": [damping] * 3}, "outputs": {"quantities": ["quaternion"]}}
    tables |= {"run": {"stop": 1e3, "step": 10.0, "accuracy": 1e-11}}
    assert rbfmu.plan(rbfmu.Scene.from_dict(tables)).error <= 1e-11
