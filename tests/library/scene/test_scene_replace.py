"""`Scene.replace`: other values, checked as a file's are."""

import math

import pytest

from rbfmu.scene.body import Body
from rbfmu.scene.scene import Run, SceneError
from tests.support.scenes.scene_tables import scene

SCENE = scene(initial={"omega_b": [0.1, 0.2, 0.3], "position": [1, 2, 3]}, run={"stop": 3.0})


def test_dotted_keys_and_tables_say_the_same() -> None:
    expected = scene(initial={"omega_b": [0.1, 0.2, 0.3], "position": [1, 2, 3]}, run={"stop": 5.0, "step": 0.5})
    assert SCENE.replace({"run.stop": 5, "run.step": 0.5}) == expected
    assert SCENE.replace(run={"stop": 5, "step": 0.5}) == expected
    assert SCENE.replace({"run.step": 0.5}, run={"stop": 5}) == expected
    assert SCENE.replace(run=Run(stop=5, step=0.5)) == expected
    assert SCENE.run.stop == 3.0


def test_nothing_changed_is_the_same_scene() -> None:
    assert SCENE.replace() == SCENE
    assert SCENE.replace({"name": "other"}).name == "other"


def test_what_stands_in_place_of_a_key_removes_it() -> None:
    assert SCENE.replace({"initial.omega_b_deg": [180, 0, 0]}).initial.omega_b == (math.pi, 0.0, 0.0)
    turned = SCENE.replace({"initial.attitude.euler": "ZYX", "initial.attitude.angles": [math.pi, 0, 0]})
    assert turned.initial.quaternion[3] == pytest.approx(1.0)
    assert turned.initial.position == (1.0, 2.0, 3.0)
    ball = SCENE.replace({"body.shape.kind": "sphere", "body.shape.radius": 1.0})
    assert ball.body == Body(mass=2.0, shape={"kind": "sphere", "radius": 1.0})


def test_quantities_that_nobody_asked_for_by_name_follow_from_the_motion() -> None:
    """A complaint about them would be about a key that nobody wrote."""
    still = SCENE.replace({"initial.omega_b": [0, 0, 0]})
    assert still.replace(body=None, inputs={"ports": ["omega_b"]}).outputs.quantities == (
        "quaternion",
        "rpy",
        "omega_a",
    )
    assert "position" not in SCENE.replace({"body.pivot": True}).outputs.quantities
    asked = SCENE.replace({"outputs.quantities": ["position"]})
    assert asked.replace({"body.pivot": True}).outputs.quantities == ("position",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"run.stop": -5}, "run.stop = -5.0: expected a time after run.start"),
        ({"run.accuracy": math.nan}, "run.accuracy = nan: expected a finite number"),
        ({"run.stpo": 5}, "run.stpo = 5: unknown key; did you mean stop?"),
        ({"rn.stop": 5}, "rn = { stop = 5 }: unknown key; did you mean run?"),
        ({"run": 5}, "run = 5: expected a table"),
        ({"run.stop.x": 5}, "run.stop = { x = 5 }: expected a number"),
        ({"body": None}, "body is missing"),
        ({"initial": {"omega_b": [1, 0, 0], "omega_b_deg": [1, 0, 0]}}, "not both"),
        ({"body.mass": -1}, "body.mass = -1: expected a number > 0"),
    ],
)
def test_a_bad_change_is_a_scene_error(changes: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        SCENE.replace(changes)
    assert message in str(caught.value)
    assert str(caught.value).startswith("scene: ")
