"""Small motions keep their digits, or are refused: rates count relative to their largest, however small that is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu import Scene, SceneError
from rbfmu.planning.select import plan
from tests.support.quadruple import reference
from tests.support.quadruple.driving import outcome

pytestmark = pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
RATES = ["omega_b", "omega_a", "alpha_b", "angular_momentum_a", "kinetic_energy"]
DOWN, TILTED = [0.0, 0.0, -1.46], [0.3, -0.5, -1.2]


def swinging(omega_b, accuracy, arm=DOWN, wanted=("quaternion", "omega_b"), **run):
    """The pendulum of issue 24, at rest but for its rates where its arm hangs down."""
    hanging, _ = Rotation.align_vectors([DOWN], [arm]) if arm is TILTED else (Rotation.identity(), 0.0)
    body = {"mass": 6.6, "inertia": [10.0, 13.0, 14.0], "pivot": True, "r_oc_b": arm}
    initial = {"omega_b": omega_b, "attitude": {"quaternion": hanging.as_quat(scalar_first=True).tolist()}}
    run = {"stop": 2.0, "step": 0.02, "accuracy": accuracy} | run
    loads = {"gravity_a": [0.0, 0.0, -9.81]}
    return Scene(body=body, initial=initial, loads=loads, outputs={"quantities": list(wanted)}, run=run)


@pytest.mark.parametrize(("omega_b", "accuracy", "arm", "wanted"), [
    ([3e-5, -1e-4, 0.0], 1e-12, DOWN, ("quaternion", "omega_b")),
    ([3e-5, -1e-4, 0.0], 1e-12, DOWN, RATES),
    ([3e-9, -1e-8, 0.0], 1e-8, DOWN, ("omega_b",)),
    ([3e-13, -1e-12, 0.0], 1e-9, DOWN, RATES),
    ([3e-10, 1e-9, 0.0], 1e-6, [0.0, 0.0, 1.46], RATES),
    ([3e-10, 1e-9, 0.0], 1e-12, [0.0, 0.0, 1.46], RATES),
    ([3e-5, -1e-5, 0.0], 1e-9, TILTED, RATES),
])  # fmt: skip
def test_a_small_motion_is_as_accurate_as_it_is_said_to_be(omega_b, accuracy, arm, wanted):
    scene = swinging(omega_b, accuracy, arm, wanted)
    found = plan(scene)
    assert outcome(scene, found).error <= found.error + 1e-15 <= accuracy


def test_what_a_small_motion_loses_by_its_attitude_is_refused():
    """A quaternion of doubles is off by eps, so that the weight's torque is by eps m g r: much beside 1e-9 rad/s."""
    with pytest.raises(SceneError, match=r"run.accuracy = 1e-09: expected one that .* reach \d.\de-0[678]$"):
        plan(swinging([3e-9, -1e-9, 0.0], 1e-9, TILTED))


@pytest.mark.parametrize("moments", [[1.0, 2.0, 2.5], [2.0, 2.0, 1.5]])
def test_a_closed_form_says_what_a_small_acceleration_loses(moments):
    """Turned by hand, a body's matrix is exact to eps: alpha_b, 1e-9 of omega^2, loses 1e-7 of itself."""
    R = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    M = R @ np.diag(moments) @ R.T
    body, initial = {"mass": 2.0, "inertia": 0.5 * (M + M.T)}, {"omega_b": R @ [1e-9, 1e-9, 1.0]}
    run = {"stop": 10.0, "step": 0.1, "accuracy": 1e-6}
    scene = Scene(body=body, initial=initial, outputs={"quantities": ["alpha_b"]}, run=run)
    found = plan(scene)
    assert found.spec.closed_form
    assert 1e-9 < outcome(scene, found).error <= found.error + 1e-12
    with pytest.raises(SceneError, match=r"run.accuracy = 1e-09: expected at least .*, what double precision keeps"):
        plan(scene.replace({"run.accuracy": 1e-9}))


@pytest.mark.parametrize("quantities", [["alpha_b"], ["rpy", "omega_b", "alpha_b"]])
def test_a_small_rate_beside_a_large_one_keeps_its_digits_where_parameters_are_listed(quantities):
    """It was refused, as its own errors are small beside the large rate; an error at the start is not."""
    scene = Scene(
        body={"mass": 1.0, "inertia": [1.0, 1.9, 1.0]}, initial={"omega_b": [-6.245e-9, 3.0, 3.757e-9]},
        inputs={"parameters": ["inertia", "damping_b"]}, outputs={"quantities": quantities},
        run={"stop": 13.0, "step": 6.5, "accuracy": 5.5e-10},
    )  # fmt: skip
    found = plan(scene)
    assert outcome(scene, found).error <= scene.run.accuracy
