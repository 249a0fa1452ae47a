"""Random scenes, planned and driven: none silently wrong, none refused without need; planted faults are found.

Each slow test says its first seed; a failure prints scenes that can be pasted. By hand: quadruple/campaign.py.
"""

import tomllib
from dataclasses import replace

import pytest

from rbfmu.planning.select import plan
from rbfmu.scene.scene import Scene
from tests.support.quadruple import plans, reference
from tests.support.quadruple.campaign import (
    FAILED,
    HONEST,
    KEYLESS,
    REFUSED,
    RIGHT,
    SILENT,
    settings_from,
    table,
    verdict_of,
    verdict_of_refusal,
)
from tests.support.quadruple.driving import Outcome, Setting, outcome, pasted, seen, true_motion
from tests.support.quadruple.errors import errors
from tests.support.quadruple.hard_scenes import KINDS, hard_scene
from tests.support.quadruple.plans import line, planned
from tests.support.quadruple.scenes import random_scene

pytestmark = pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
RUN = {"stop": 10.0, "step": 1.0, "accuracy": 1e-6}
SCENE = Scene(
    body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [0.1, 0.2, 0.3]}, run=RUN,
    loads={"gravity_a": [0.0, 0.0, 0.0], "torque_b": [0.01, 0.02, 0.0], "torque_a": [0.0, 0.01, 0.0]},
    outputs={"quantities": ["quaternion", "omega_b"]},
)  # fmt: skip


def verdict(planned, setting=Setting()):  # noqa: B008
    return verdict_of(SCENE, setting, outcome(SCENE, planned, setting))[0]


def test_a_plan_is_right_and_a_looser_one_is_found():
    planned = plan(SCENE)
    assert verdict(planned) == RIGHT
    assert verdict(replace(planned, order=6, tolerance=0.1), Setting(step=10.0)) == SILENT


def test_a_torque_off_by_a_thousandth_is_found():
    torque = {"torque_b": [0.01001, 0.02, 0.0], "torque_a": [0.0, 0.01, 0.0], "gravity_a": [0.0, 0.0, 0.0]}
    other = Scene.from_dict(SCENE.to_dict() | {"loads": torque})
    _, rows = seen(other, plan(other), Setting())
    assert verdict_of(other, Setting(), Outcome("", errors(rows, true_motion(other, Setting()))))[0] == RIGHT
    assert verdict_of(SCENE, Setting(), Outcome("", errors(rows, true_motion(SCENE, Setting()))))[0] == SILENT


def test_refusals_are_weighed():
    too_much = "run.accuracy = 1e-06: expected one that this scene can meet"
    assert verdict_of_refusal(SCENE, too_much)[0] == REFUSED
    exacting = Scene.from_dict(SCENE.to_dict() | {"run": RUN | {"accuracy": 1e-17}})
    assert verdict_of_refusal(exacting, too_much)[0] == HONEST
    changed = Setting(changes={"torque_b": [1.0, 0.0, 0.0]})
    assert verdict_of(SCENE, changed, Outcome('list "torque_b" under parameters'))[0] == HONEST
    assert verdict_of(SCENE, changed, Outcome("status 1 at step 1 of 10"))[0] == KEYLESS
    assert verdict_of(SCENE, Setting(), Outcome("status 1 at step 1 of 10"))[0] == REFUSED


@pytest.mark.thorough
@pytest.mark.parametrize(("accuracy", "verdict"), [(4.13e-10, HONEST), (1e-8, REFUSED)])
def test_what_the_rounding_of_a_scene_s_own_numbers_leaves_open_is_refused_truly(accuracy, verdict):
    """A pendulum that magnifies errors five million times: plain series reach 9e-11 by luck, others 8e-9."""
    _, one = hard_scene(1936)
    assert verdict_of_refusal(one.replace({"run.accuracy": accuracy}), "run.accuracy = ")[0] == verdict


@pytest.mark.parametrize("seed", range(0, 21))
def test_scenes_come_from_their_seeds_and_can_be_pasted(seed):
    kind, one = random_scene(seed)
    assert (kind, one) == random_scene(seed)
    assert Scene.from_dict({"name": one.name} | tomllib.loads(pasted(one, Setting()))) == one


def test_refusals_of_plans_name_a_key_and_are_true(monkeypatch):
    monkeypatch.setattr(plans, "MAX_SUBSTEPS", 1e4)
    assert plans.verdict_on(SCENE, "the motion is too long") == KEYLESS
    assert plans.verdict_on(SCENE, "run.stop = 10.0: expected a shorter run") == REFUSED
    spun_up = SCENE.replace({"loads": {"torque_b": [5e7, 0.0, 0.0]}, "run.stop": 1000.0})
    assert plans.verdict_on(spun_up, "run.stop = 1000.0: expected a shorter run") == HONEST


@pytest.mark.parametrize("seed", range(0, 6))
def test_hard_scenes_come_from_their_seeds(seed):
    kind, one = hard_scene(seed)
    assert (kind, one) == hard_scene(seed)
    assert kind == KINDS[seed]


# The campaign itself


SETTINGS, BLOCKS = 100, 50
CI = pytest.param(1007, 3 * SETTINGS, marks=pytest.mark.thorough)


@pytest.mark.filterwarnings("ignore::rbfmu.planning.judge.PlanningWarning")  # said, and no verdict on the answer
@pytest.mark.parametrize(("seed", "count"), [
    CI, *(pytest.param(1000 * block, SETTINGS, marks=pytest.mark.slow) for block in range(BLOCKS)),
])  # fmt: skip
def test_none_is_silently_wrong_and_none_refused_without_need(seed, count):
    found = [finding for finding, _ in settings_from(seed, count)]
    print(table(found))
    failures = [str(f) for f in found if f.verdict in FAILED]
    assert not failures, "\n\n".join(failures)


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "accuracy"), [(100_000, 2.5e-12), (1_000_000, 1.5e-12)])
def test_an_accuracy_above_the_round_off_of_many_steps_is_met(steps, accuracy):
    """It was 4.6e-12 where 2.1e-13 was promised, or was refused; round-off is 1.7e-12 and 0.9e-12 in these."""
    many = {"initial.omega_b": [3.0, 5.0, -4.0], "loads": {"gravity_a": [0.0] * 3, "torque_b": [0.01, 0.02, -0.03]}}
    one = SCENE.replace(many | {"run.step": 10.0 / steps, "run.accuracy": accuracy})
    assert verdict_of(one, Setting(), outcome(one, plan(one), Setting()))[0] == RIGHT


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::rbfmu.planning.judge.PlanningWarning")  # said, and no verdict on the answer
@pytest.mark.parametrize("seed", [100 * block for block in range(20)])
def test_every_plan_ends_and_what_is_refused_is_refused_with_a_key_and_truly(seed):
    """By hand, with the CPU time of each: quadruple/plans.py."""
    found = [one for number in range(seed, seed + 100) if (one := planned(number, number % 20 == 0))]
    assert found
    assert not [line(one) for one in found if one.verdict in FAILED]
