"""The quadruple-precision integrator against exact solutions and 40 digits."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from rbfmu.scene.scene import Scene
from tests.library.planning.test_reference import HELD, LOADS
from tests.support.quadruple import reference
from tests.support.quadruple.errors import attitude_errors, quantity_error
from tests.support.references import reference_mp
from tests.support.scenes.model_cases import MOVING, OFFSET
from tests.support.scenes.random_scenes import scenes

pytestmark = pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
PROMISED = 1e-25


def as_mp(truth, name, k):
    return [mp.mpf(float(a)) + mp.mpf(float(b)) for a, b in zip(truth.high[name][k], truth.low[name][k], strict=True)]


def distance(a, b):
    with mp.workdps(60):
        return float(mp.sqrt(sum((x - y) ** 2 for x, y in zip(a, b, strict=True))))


def compare_with_40_digits(scene, steps):
    times = np.cumsum([scene.run.start, *steps])
    truth = reference.motion(reference.parameters_of(scene), steps)
    for k, point in enumerate(reference_mp.motion(scene, times.tolist())):
        with mp.workdps(60):
            R = reference_mp.matrix_of(as_mp(truth, "quaternion", k))
            worst = [distance(R[i], point.R_ab[i]) for i in range(3)]
            for name in ("omega_b", "position", "velocity"):
                expected = getattr(point, name)
                size = max(1.0, float(mp.sqrt(sum(x * x for x in expected))))
                worst.append(distance(as_mp(truth, name, k), expected) / size)
        assert max(worst) < PROMISED, (k, worst)


@pytest.mark.thorough
@pytest.mark.parametrize("pivot", [False, True])
def test_all_loads_against_40_digits(pivot):
    initial = HELD if pivot else MOVING
    scene = Scene(body=OFFSET | {"pivot": pivot}, initial=initial, loads=LOADS, run={"stop": 8.0, "step": 1.0})
    compare_with_40_digits(scene, [0.0078125, 1.0, 4.0, 2.9921875])


def test_beam_in_any_axes_against_40_digits():
    n = np.array([2.0, 3.0, 6.0]) / 7.0
    M = 2.0 * (np.eye(3) - np.outer(n, n))
    omega = np.cross(n, [1.0, 0.5, -2.0])
    p = reference.parameters_of(Scene(body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}))
    p |= {"inertia": [*np.diag(M), M[0, 1], M[0, 2], M[1, 2]], "omega_b_0": omega.tolist()}
    truth = reference.motion(p, [1.0, 1.0])
    size = np.linalg.norm(omega)
    assert np.max(np.abs(np.linalg.norm(truth.high["omega_b"], axis=1) - size)) < 1e-15
    assert np.max(np.abs(truth.high["alpha_b"])) < 1e-11  # the matrix in double has no axis without inertia


def test_turn_about_a_fixed_axis_is_exact():
    """Constant torque and damping about z: omega = T/d + (w - T/d) exp(-d t / I)."""
    p = reference.parameters_of(Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}))
    p |= {"omega_b_0": [0.0, 0.0, 3.0], "torque_b": [0.0, 0.0, 0.5], "damping_b": [0.0, 0.0, 0.25]}
    truth = reference.motion(p, [0.5, 30.0])
    with mp.workdps(50):
        for k, t in ((1, mp.mpf(0.5)), (2, mp.mpf(30.5))):
            decay = mp.exp(-t / 10)
            angle = 2 * t + 10 * (1 - decay)
            assert distance(as_mp(truth, "omega_b", k), [0, 0, 2 + decay]) < PROMISED
            q = as_mp(truth, "quaternion", k)
            sign = 1 if q[0] * mp.cos(angle / 2) + q[3] * mp.sin(angle / 2) > 0 else -1
            assert distance(q, [sign * mp.cos(angle / 2), 0, 0, sign * mp.sin(angle / 2)]) < PROMISED


def test_torque_free_motion_conserves_momentum_and_energy():
    p = reference.parameters_of(Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, loads={"gravity_a": [0, 0, 0]}))
    p |= {"omega_b_0": [0.01, 3.0, -0.02], "r_oc_b": [0.1, 0.2, 0.3]}
    truth = reference.motion(p, [7.0] * 10)
    for name in ("angular_momentum_a", "kinetic_energy"):
        first = as_mp(truth, name, 0)
        assert all(distance(as_mp(truth, name, k), first) < PROMISED for k in range(11))


def test_held_inputs_are_known_loads_over_their_step():
    dyadic = {name: [round(64 * x) / 64 for x in v] for name, v in LOADS.items()}
    p = reference.parameters_of(Scene(body=OFFSET, initial=MOVING, loads=dyadic))
    u = {"force_a": [0.25, 0.5, -1], "force_b": [1, 0.5, 0.125], "torque_a": [0.0625, 0, 0.5], "torque_b": [0.5, 0, 1]}
    held = reference.motion(p, [0.5, 0.75], {name: np.array([v, v]) for name, v in u.items()})
    summed = {name: (np.array(p[name]) + v).tolist() for name, v in u.items()}
    known = reference.motion(p | summed, [1.25])
    for name in reference.QUANTITIES:
        assert distance(as_mp(held, name, 2), as_mp(known, name, 1)) < 100 * PROMISED, name


def test_inputs_change_from_step_to_step():
    """A body at rest pushed for a second, then left alone: v = t, then constant."""
    p = reference.parameters_of(Scene(body={"mass": 2.0, "inertia": [1, 1, 1]}, loads={"gravity_a": [0, 0, 0]}))
    truth = reference.motion(p, [1.0, 1.0, 2.0], {"force_a": [[2.0, 0, 0], [0, 0, 0], [0, 0, 4.0]]})
    assert truth.high["velocity"].tolist() == [[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 4]]
    assert truth.high["position"].tolist() == [[0, 0, 0], [0.5, 0, 0], [1.5, 0, 0], [3.5, 0, 4]]
    assert truth.high["acceleration"].tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 2]]


def test_prescribed_rates_are_turns():
    truth = reference.prescribed_motion([1, 0, 0, 0], [0.5, 2.0], [[0, 0, 3.0], [4.0, 0, 0]])
    with mp.workdps(40):
        a, b = mp.mpf(0.75), mp.mpf(4)
        ca, sa, cb, sb = mp.cos(a), mp.sin(a), mp.cos(b), mp.sin(b)
        assert distance(as_mp(truth, "quaternion", 2), [ca * cb, ca * sb, sa * sb, sa * cb]) < PROMISED


def test_rpy_are_those_of_the_quaternion():
    p = reference.parameters_of(Scene(body=OFFSET, initial=MOVING, loads=LOADS))
    truth = reference.motion(p, [0.5] * 20)
    assert quantity_error("rpy", truth.high["rpy"], truth) < 1e-15


def test_an_attitude_error_is_its_angle():
    p = reference.parameters_of(Scene(body=OFFSET, initial=MOVING, loads=LOADS))
    truth = reference.motion(p, [0.5] * 20)
    q, low = truth.high["quaternion"], truth.low["quaternion"]
    e = 1e-9
    turned = q + 0.5 * e * np.stack([-q[:, 3], q[:, 2], -q[:, 1], q[:, 0]], axis=1)  # about b's z
    assert attitude_errors(-turned, q, low) == pytest.approx(e, rel=1e-6)
    assert np.max(attitude_errors(q, q, low)) < 2.0**-52


@given(scenes())
@settings(
    max_examples=15, phases=[Phase.generate], deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)
def test_random_scenes_against_40_digits(scene):
    span = scene.run.stop - scene.run.start
    compare_with_40_digits(scene, [min(span, 4.0) / 2.0**k for k in (2, 1)])
