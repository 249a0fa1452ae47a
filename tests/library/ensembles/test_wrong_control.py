"""What is said of controllers and tables that are wrong, and of members that they make fail."""

import numpy as np
import pytest

import rbfmu
from rbfmu import Controller, SceneError
from tests.library.ensembles.test_control import RUNS, SEED, STEPS, TABLES, damp, run


@pytest.fixture(scope="module")
def scene():
    return rbfmu.Scene.from_dict(TABLES, "driven")


def test_a_controller_that_gives_no_number_fails_its_member_alone(scene, planned):
    def fails(t, outputs, state, inputs, noise):
        inputs[4] = np.nan if t > 2.0 and noise[0] > 2.0 else 0.0

    controller = Controller(fails, noise=1)
    found, numbers = run(scene, planned, controller=controller), range(RUNS)
    late = {i: controller.noise_of(SEED, i, STEPS)[:, 0] > 2.0 for i in numbers}
    when = {i: 1.0 + 0.5 * k for i in numbers for k in reversed(np.flatnonzero(late[i])) if k > 2}
    assert 0 < len(when) < RUNS
    said = "driven: the controller gave force_a[2] at t = {!r} s: expected a finite number"
    assert found.failed == {i: said.format(float(t)) for i, t in when.items()}
    assert np.isnan(found.all["omega_b"][min(when)]).all()


def test_a_step_that_inputs_make_too_large_is_refused_with_its_time(scene, planned):
    def pushes(t, outputs, state, inputs, noise):
        inputs[0] = 1e300 if t == 3.0 else 0.0

    found = run(scene, planned, controller=pushes)
    assert set(found.failed.values()) == {"driven: the step from t = 3.0 s was refused: not finite"}
    assert len(found.failed) == RUNS


def wrong_at_once():
    """Return functions that take, read or write what they should not, give a value, or are not compiled."""

    def too_few(t, outputs, state, inputs):
        inputs[0] = 1.0

    def too_long(t, outputs, state, inputs, noise):
        inputs[6] = 1.0

    def no_state(t, outputs, state, inputs, noise):
        state[0] = 1.0

    def of_four(t, outputs, state, inputs, noise):
        inputs[:3] = outputs[:4]

    def gives(t, outputs, state, inputs, noise):
        return -outputs[4:7]

    def not_compiled(t, outputs, state, inputs, noise):
        inputs[0] = float(str(t))

    return too_few, too_long, no_state, of_four, gives, not_compiled


@pytest.mark.parametrize("wrong", wrong_at_once(), ids=lambda f: f.__name__)
def test_a_wrong_controller_is_told_what_was_expected(scene, planned, wrong):
    sizes = "10 outputs, 0 of state, 6 inputs and 0 of noise"
    expected = rf"driven: controller: .*Error: .*: expected f\(t, outputs, state, inputs, noise\) .*, of {sizes}"
    with pytest.raises(SceneError, match=f"(?s){expected}"):
        run(scene, planned, controller=wrong)


def test_what_a_controller_does_wrong_later_is_told(scene, planned):
    """A wrong index wrote beside the numbers, and could end the process."""

    def beyond(t, outputs, state, inputs, noise):
        if t > 1.0:
            inputs[len(inputs) + 3] = 1.0

    def divides(t, outputs, state, inputs, noise):
        inputs[0] = 1.0 if t == 1.0 else 1.0 / (t - t)

    for wrong, said in ((beyond, "IndexError: index is out of bounds"), (divides, "ZeroDivisionError: division")):
        expected = rf"driven: controller: {said}.*: expected f\(t, outputs, state, inputs, noise\)"
        with pytest.raises(SceneError, match=expected):
            run(scene, planned, controller=wrong)


@pytest.mark.parametrize(("wrong", "said"), [
    ({"function": 3.0}, "controller = 3.0: expected a function"),
    ({"state": [[0.0]]}, "state = .*: expected finite numbers in one row"),
    ({"state": [np.nan]}, "state = .*: expected finite numbers"),
    ({"noise": -1}, "noise = -1: expected how many"),
    ({"noise": 1.5}, "noise = 1.5: expected how many"),
    ({"noise": True}, "noise = True: expected how many"),
    ({"noise": "x"}, "noise = 'x': expected how many"),
    ({"state": "x"}, "state = 'x': expected finite numbers"),
    ({"state": 3}, "state = 3: expected finite numbers"),
    ({"state": {}}, "state = {}: expected finite numbers"),
])  # fmt: skip
def test_a_controllers_numbers_are_checked(wrong, said):
    with pytest.raises(ValueError, match=said):
        Controller(**{"function": damp} | wrong)


def test_wrong_tables_are_said_before_anything_runs_or_with_the_number_of_their_member(scene, planned):
    with pytest.raises(SceneError, match=r"driven: inputs 'torque': expected one of .* torque_b, force_a"):
        run(scene, planned, inputs={"torque": np.zeros((STEPS, 3))})
    with pytest.raises(SceneError, match=r"driven, member 11: inputs 'force_a': .*: expected \(times, values\)"):
        run(scene, planned, inputs=lambda i: {"force_a": np.zeros((STEPS if i < 11 else 2, 3))})
    for given in ({"inputs": {}}, {"controller": damp}):
        with pytest.raises(SceneError, match=r"given: expected none, as the scene has no ports"):
            run(scene.replace({"inputs.ports": []}), planned, **given)


def test_members_with_tables_of_their_own_do_not_each_tell_the_same_doubt(scene, planned):
    """A warning came from each member, at a line of the threads' module."""

    def push(i):
        return {"force_a": (np.array([1.0, 2.0 + 0.01 * i]), np.zeros((2, 3)))}

    with pytest.warns(rbfmu.SceneWarning, match="held for 3.9 s.*cut short") as told:
        run(scene, planned, inputs=push)
    assert [warning.filename for warning in told] == [run.__code__.co_filename]
