"""Attitude from prescribed rates."""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from unit_cases import EPS, TURNED, Unit, assert_refused, distance

from rbfmu import rotate
from rbfmu.measures import attitude_error
from rbfmu.scene import Scene


def prescribed(**initial):
    return Unit(Scene(inputs={"ports": ["omega_b"]}, initial=initial))


@pytest.mark.parametrize("omega", [(0.3, -0.2, 0.5), (1e-9, 0.0, 0.0), (0.0, 40.0, 0.0), (3e3, -2e3, 1e3)])
def test_prescribed_rates_turn_the_attitude_exactly(omega):
    """Against R(q_0) exp(skew(omega) t) in 40 digits: round-off of the angle and of the result, however many steps."""
    unit, steps = prescribed(attitude=TURNED), 1000
    unit["omega_b"] = omega
    start = unit["quaternion"]
    unit.step(0.01, steps)
    with mp.workdps(40):
        t = mp.mpf(0.01) * steps
        angle = mp.sqrt(sum(mp.mpf(w) ** 2 for w in omega))
        q = [mp.cos(angle * t / 2), *(mp.sin(angle * t / 2) * w / angle for w in map(mp.mpf, omega))]
        a, b = [mp.mpf(float(x)) for x in start], q
        truth = [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
        error = float(mp.sqrt(sum((mp.mpf(float(x)) - y) ** 2 for x, y in zip(unit["quaternion"], truth, strict=True))))
    assert error <= EPS * (2.0 + 0.5 * 0.01 * steps * float(angle))
    np.testing.assert_allclose(unit["omega_a"], rotate(unit["quaternion"], omega), rtol=4 * EPS)


def test_prescribed_rates_do_not_care_how_time_is_chopped():
    whole, parts = prescribed(), prescribed()
    whole["omega_b"] = parts["omega_b"] = [0.3, -0.2, 0.5]
    whole.step(10.0)
    parts.step(0.01, 1000)
    assert distance(whole["quaternion"], parts["quaternion"]) <= 2 * EPS


def test_prescribed_rates_may_change_at_each_step():
    """Products of exact turns, as in q_0 exp(h_1 omega_1) exp(h_2 omega_2) ..."""
    rng = np.random.default_rng(1)
    unit, truth = prescribed(attitude=TURNED), Rotation.from_rotvec(TURNED["rotvec"])
    for omega in rng.normal(size=(50, 3)):
        unit["omega_b"] = omega
        unit.step(0.25, 2)
        truth = truth * Rotation.from_rotvec(0.5 * omega)
    assert attitude_error(unit["quaternion"], truth.as_quat(scalar_first=True)) <= 40 * EPS


def test_prescribed_rates_keep_the_quaternion_continuous():
    """A full turn about z ends at -q."""
    unit = prescribed()
    unit["omega_b"] = [0.0, 0.0, 2.0 * math.pi]
    unit.step(1.0 / 64.0, 64)
    assert distance(unit["quaternion"], [-1.0, 0.0, 0.0, 0.0]) <= 2 * EPS


@pytest.mark.parametrize(
    ("rate", "h"),
    [(math.nan, 0.1), (math.inf, 0.1), (1.0, 0.0), (1.0, -0.1), (1.0, math.nan), (1.0, math.inf), (1e10, 1e6)],
)
def test_prescribed_rates_refuse_what_leads_nowhere(rate, h):
    unit = prescribed(attitude=TURNED)
    unit["omega_b"] = [0.0, rate, 0.0]
    assert_refused(unit, h)


@pytest.mark.parametrize("bad", [[0.0] * 4, [math.nan, 0.0, 0.0, 1.0], [math.inf, 0.0, 0.0, 1.0]])
def test_prescribed_rates_refuse_a_bad_quaternion(bad):
    unit = prescribed()
    unit["quaternion_0"] = bad
    assert unit.kernels.initialize(unit.z) == 7
