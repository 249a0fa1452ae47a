"""The small models against the exact motion and 40 digits, however long and in whatever steps."""

import math

import mpmath as mp
import numpy as np
import pytest

from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels import free_rotation
from tests.support.references import reference_mp as reference
from tests.support.scenes.model_cases import EPS, NO_GRAVITY, TURNED, Unit


def run(model, steps, **tables):
    """The unit's outputs after each of some steps, by name."""
    scene = Scene(**{"initial": {}, "loads": NO_GRAVITY} | tables)
    unit = Unit(scene, Plan(model, "", 0, tolerance=1e-17, order=16))
    rows = []
    for h in steps:
        unit.step(h)
        rows.append({name: unit[name] for name in ("quaternion", "omega_b", "position", "velocity")})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}, scene


def start(scene):
    return scene.initial.quaternion, scene.initial.omega_b


@pytest.mark.parametrize(
    "moments", [(1.0, 1.0, 0.3), (1.0, 1.0, 1.9), (0.7, 1.3, 0.7), (0.0, 2.0, 2.0), (1e-20, 2e-20, 2e-20)]
)
@pytest.mark.parametrize("t", [1e-3, 1.0, 1e6])
def test_a_symmetric_body_precesses_as_the_exact_motion(moments, t):
    """Some 5e5 turns at most: the phases are double-double."""
    omega = [0.0 if m == 0.0 else w for m, w in zip(moments, (1.1, -0.7, 3.0), strict=True)]
    found, scene = run("torque-free symmetric body", [t], body={"mass": 1.0, "inertia": moments},
                       initial={"omega_b": omega, "attitude": TURNED})  # fmt: skip
    q, w = free_rotation(moments, *start(scene), t)
    assert attitude_error(found["quaternion"][0], q) <= 10 * EPS
    np.testing.assert_allclose(found["omega_b"][0], w, rtol=0.0, atol=8 * EPS * 3.3)


def test_a_symmetric_body_in_any_axes_precesses_about_its_own():
    R = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
    M = R @ np.diag([2.0, 2.0, 1.0]) @ R.T
    tables = {"body": {"mass": 1.0, "inertia": (0.5 * (M + M.T)).tolist()}, "initial": {"omega_b": [1.0, 0.5, -2.0]}}
    found, _ = run("torque-free symmetric body", [0.5] * 20, **tables)
    exact, _ = run("torque-free body", [0.5] * 20, **tables)
    assert np.max(attitude_error(found["quaternion"], exact["quaternion"])) <= 1e-13
    np.testing.assert_allclose(found["omega_b"], exact["omega_b"], atol=1e-13)


@pytest.mark.parametrize("t", [1e-3, 1.0, 1e8])
@pytest.mark.parametrize("body", [(0.4, 0.4, 0.4), (1.0, 2.0, 2.5)])
def test_a_constant_rate_turns_as_the_exact_motion(body, t):
    omega = [0.3, -1.2, 0.7] if body[0] == body[2] else [0.0, 1.7, 0.0]
    found, scene = run("constant rate", [0.25 * t] * 4, body={"mass": 1.0, "inertia": body},
                       initial={"omega_b": omega, "attitude": TURNED})  # fmt: skip
    q, _ = free_rotation(body, *start(scene), t)
    assert attitude_error(found["quaternion"][-1], q) <= 10 * EPS


def test_quaternions_of_closed_forms_are_continuous():
    for model in ("constant rate", "one axis", "torque-free symmetric body"):
        found, _ = run(
            model, [0.1] * 200, body={"mass": 1.0, "inertia": [1.0, 1.0, 2.0]}, initial={"omega_b": [0, 0, 3.0]}
        )
        steps = np.sum(found["quaternion"][1:] * found["quaternion"][:-1], axis=1)
        np.testing.assert_allclose(steps, math.cos(0.15), rtol=1e-12)


def test_a_path_in_closed_form_gathers_no_round_off():
    """1e5 steps of 0.1 s, which no binary number is, end where one of 1e4 s does."""
    tables = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, "loads": {"gravity_a": [0.0, 0.1, -9.81]},
              "initial": {"velocity": [4.0, 5.0, 6.0]}}  # fmt: skip
    many, _ = run("no rotation", [0.1] * 100_000, **tables)
    with mp.workdps(40):
        t = 100_000 * mp.mpf(0.1)
        for axis in range(3):
            v, g = tables["initial"]["velocity"][axis], mp.mpf(tables["loads"]["gravity_a"][axis])
            exact = v * t + g * t * t / 2
            assert abs(many["position"][-1, axis] - exact) <= 4 * EPS * abs(exact)


@pytest.mark.parametrize("damping", [0.0, 1e-9, 0.3, 50.0])
@pytest.mark.parametrize("torque", [0.0, 2.0])
def test_one_axis_under_torque_and_damping_is_exact(torque, damping):
    """I omega' = T - d omega, over 300 rad."""
    body, initial = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, {"omega_b": [0.0, 0.0, 30.0], "attitude": TURNED}
    loads = NO_GRAVITY | {"torque_b": [0.0, 0.0, torque], "damping_b": [0.1, 0.2, damping]}
    found, scene = run("one axis", [2.5] * 4, body=body, initial=initial, loads=loads)
    with mp.workdps(40):
        t, pull, decay = mp.mpf(10), mp.mpf(torque) / mp.mpf(2.5), mp.mpf(damping) / mp.mpf(2.5)
        if decay:
            rest = (1 - mp.exp(-decay * t)) / decay
            rate = 30 * mp.exp(-decay * t) + pull * rest
            angle = 30 * rest + pull * (t - rest) / decay
        else:
            rate, angle = 30 + pull * t, 30 * t + pull * t * t / 2
        turn = [mp.cos(angle / 2), 0, 0, mp.sin(angle / 2)]
        e, x, y, z = (mp.mpf(c) for c in scene.initial.quaternion)
        c, s = turn[0], turn[3]
        truth = [float(v) for v in (e * c - z * s, x * c + y * s, y * c - x * s, z * c + e * s)]
    size = 30.0 if torque else (1.0 + float(decay * t)) * float(rate)  # a decay keeps its digits
    assert abs(found["omega_b"][-1, 2] - float(rate)) <= 8 * EPS * size
    assert attitude_error(found["quaternion"][-1], truth) <= 4 * EPS * float(angle)


@pytest.mark.thorough
@pytest.mark.parametrize("across", [0.0, 0.3])
@pytest.mark.parametrize("along", [0.0, 0.2])
@pytest.mark.parametrize(("moments", "torque"), [((2.0, 2.0, 1.0), 0.4), ((1.3, 0.7, 1.3), -2.0), ((0.5, 1, 1), 0.1)])
def test_a_symmetric_body_is_spun_up_as_in_40_digits(moments, torque, along, across):
    own = moments.index(min(moments, key=moments.count))
    omega, load, damping = [0.6, -0.5, 0.4], [0.0] * 3, [across] * 3
    load[own], damping[own] = torque, along
    loads = NO_GRAVITY | {"torque_b": load, "damping_b": damping}
    body = {"mass": 1.0, "inertia": list(moments)}
    tables = {"body": body, "initial": {"omega_b": omega}, "loads": loads, "outputs": {"quantities": ["omega_b"]}}
    found, scene = run("symmetric body spun up", [0.5] * 20, **tables)
    points = reference.motion(scene, (0.5 * np.arange(1.0, 21.0)).tolist())
    zero, blank = np.zeros((20, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (20, 1))
    fastest = float(np.max(np.abs(found["omega_b"])))
    turned = 10.0 * fastest  # rad, in whose sine and cosine round-off shows
    assert reference.errors(points, blank, found["omega_b"], zero, zero)["omega_b"] <= 4 * EPS * max(turned, 1.0)


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_a_swing_is_that_of_40_digits(steps):
    """Large swings of a damped body about a level axis, within the tolerance of round-off."""
    body = {"mass": 2.0, "inertia": [1.0, 2.0, 3.0], "r_oc_b": [0.1, -0.2, 0.0], "pivot": True}
    loads = {"gravity_a": [-9.81, 0.0, 0.0], "damping_b": [0.0, 0.0, 0.1], "torque_b": [0.0, 0.0, 0.3]}
    h, initial = 4.0 / steps, {"omega_b": [0.0, 0.0, 3.0]}
    found, scene = run("one swinging axis", [h] * steps, body=body, initial=initial, loads=loads)
    end = reference.motion(scene, [h * steps])
    zero = np.zeros((1, 3))
    errors = reference.errors(end, found["quaternion"][-1:], found["omega_b"][-1:], zero, zero)
    assert max(errors["attitude"], errors["omega_b"]) <= 200 * EPS
