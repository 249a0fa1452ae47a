"""Doubts about scenes: one line each, and nothing fails."""

import math
import warnings
from pathlib import Path

import numpy as np
import pytest

import rbfmu
from rbfmu.runs.motion import doubts_of_sizes
from rbfmu.scene.scene import doubts_after, doubts_before
from tests.support.command_line import call
from tests.support.scenes.scene_tables import SMALLEST, scene

SLOW = {"stop": 1.0, "step": 0.1}


@pytest.mark.parametrize(("radius", "said"), [
    (3.9, None),
    (3.93, "at least 3.93 m, beyond 3.91 m, where 3 kg"),
    (1.01e-4, None),
    (0.99e-4, "9.9e-05 m, below 0.1 mm"),
])  # fmt: skip
def test_a_radius_of_gyration_out_of_the_common(radius: float, said: str | None) -> None:
    made = scene(body={"mass": 3.0, "inertia": [3.0 * radius**2] * 3})
    found = list(doubts_before(made))
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


def test_a_slender_beam_and_a_point_on_a_pivot_are_no_slip() -> None:
    for body in ({"mass": 1.0, "shape": {"kind": "beam", "length": 1.0}},
                 {"mass": 1.0, "inertia": [1e-10, 1.0, 1.0]},
                 {"mass": 1.0, "inertia": [0, 0, 0], "r_oc_b": [1, 0, 0], "pivot": True}):  # fmt: skip
        assert list(doubts_before(scene(body=body))) == []


def test_moments_in_kg_cm2_are_doubted_and_large_bodies_are_not() -> None:
    """A satellite of 50 kg; ship, asteroid, the Earth; a mast of 50 m."""
    sizes = {50.0: [1.0, 2.0, 3.0], 3e8: [6e10, 3e12, 3e12], 2e13: [2e19, 6e19, 6.5e19], 6e24: [8e37] * 3,
             20.0: [0.01, 4000.0, 4000.0]}  # fmt: skip
    for mass, inertia in sizes.items():
        assert list(doubts_before(scene(body={"mass": mass, "inertia": inertia}))) == []
    (doubt,) = doubts_before(scene(body={"mass": 50.0, "inertia": [1e4, 2e4, 3e4]}))
    assert doubt.startswith("the body's radius of gyration is at least 14.1 m, beyond 10 m")


def test_positions_below_the_error_allowed_are_doubted_and_round_off_is_not() -> None:
    """A vibration of 1e-8 m at 1e-6 was wrong without a word; loads in balance, and a turn about o, leave round-off."""
    shaken = {"force_a": [1e-6, 0.0, 0.0], "gravity_a": [0.0, 0.0, 0.0]}
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "outputs": {"quantities": ["position", "velocity"]}}
    made = scene(**tables, loads=shaken, run={"stop": 0.1, "step": 0.05, "accuracy": 1e-8})
    with pytest.warns(rbfmu.SceneWarning) as said:
        rbfmu.simulate(made)
    (doubt,) = [str(one.message) for one in said]
    assert "position: at most 5.0e-09 m, which may be wrong in every digit, as run.accuracy = 1e-08 is" in doubt
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.simulate(made.replace({"run.accuracy": 1e-9}))
        rbfmu.simulate(made.replace({"loads.force_a": [0.0, 0.0, 9.81], "loads.gravity_a": [0.0, 0.0, -9.81]}))
    turning = made.replace({"body.r_oc_b": [0.0, 0.0, 0.3], "initial.omega_b": [0.0, 0.0, 3.0]})
    rounded = {"position": np.full((3, 3), 1e-16), "velocity": np.full((3, 3), 1e-15)}
    assert list(doubts_of_sizes(turning, rounded)) == []


def test_a_force_at_a_pivot_is_doubted() -> None:
    """It passed in silence, as a number, formula or port, where the base of a gyroscope shakes: it moves nothing."""
    top = {"mass": 1.0, "inertia": [1.0, 1.0, 1.5], "r_oc_b": [0.0, 0.0, 0.5], "pivot": True}
    for loads, port, said in (
        ({"force_a": "[sin(t), 0, 0]", "force_b": [0.0, 1.0, 0.0]}, "torque_a", "loads.force_a and loads.force_b: no"),
        ({}, "force_b", "the port force_b: no effect, as the pivot holds o"),
        ({"torque_a": [1.0, 0.0, 0.0]}, "torque_a", None),
    ):
        made = scene(body=top, loads=loads, inputs={"ports": [port]})
        found = list(doubts_before(made))
        assert len(found) == (said is not None)
        assert said is None or found[0].startswith(said)
        assert list(doubts_before(made.replace({"body.pivot": False}))) == []


@pytest.mark.parametrize("turns", [0.99, 1.01])
def test_more_than_a_turn_a_step(turns: float) -> None:
    fast = {"omega_b": [0.0, 20.0 * math.pi * turns, 0.0]}
    found = list(doubts_before(scene(initial=fast, run=SLOW)))
    assert len(found) == (turns > 1.0)
    if found:
        assert "run.step = 0.1: 1.01 turns per communication step at the start" in found[0]
        assert "a turn takes 0.099 s" in found[0]
    assert list(doubts_before(scene(initial=fast, run=SLOW, outputs={"quantities": ["position", "omega_b"]}))) == []
    assert list(doubts_before(scene(initial=fast, run={"stop": 0.1, "step": 0.1}))) == []  # its end is shown


def test_a_body_that_is_spun_up_during_the_run() -> None:
    made = scene(loads={"torque_b": [0.0, 0.0, 2000.0]}, run=SLOW)
    assert list(doubts_before(made)) == []
    said = r"run.step = 0.1: 12.7 turns per communication step at the fastest"
    with pytest.warns(rbfmu.SceneWarning, match=said) as caught:
        result = rbfmu.simulate(made)
    assert [w.filename for w in caught] == [__file__]
    assert len(list(doubts_after(made, result.quantities))) == 1
    assert list(doubts_after(made, {"quaternion": result.quaternion})) == []  # no rates to look at


def test_python_is_warned_where_it_called(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_text("[body]\nmass = 1\ninertia = [1e6, 1e6, 1e6]\n[run]\nstop = 0.1\n")
    for ask in (lambda: rbfmu.simulate(path), lambda: rbfmu.plan(rbfmu.load_scene(path))):
        said = r"large: the body's radius of gyration is at least 1e\+03 m"
        with pytest.warns(rbfmu.SceneWarning, match=said) as caught:
            ask()
        assert [w.filename for w in caught] == [__file__]


def test_the_command_line_says_each_doubt_once_on_stderr(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_text(
        "[body]\nmass = 1\ninertia = [1e6, 1e6, 1e6]\n[initial]\nomega_b = [0, 0, 700]\n[run]\nstop = 0.1\n"
    )
    result = call("run", path)
    assert result.exit_code == 0
    lines = result.stderr.splitlines()
    assert [line.split(":")[0] for line in lines] == ["Warning"] * 2
    assert "Warning" not in result.stdout


def test_an_ordinary_scene_is_not_doubted() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.simulate(scene(body=SMALLEST["body"], run=SLOW))
