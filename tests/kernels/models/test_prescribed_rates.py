"""Attitude from prescribed rates."""

import math

import mpmath as mp
import numpy as np
import pytest

from rbfmu import rotate
from rbfmu.planning.closed_forms import prescribed_rates_error
from rbfmu.scene.scene import Scene
from tests.support.references.free_rotation_mp import angle_to, compose
from tests.support.scenes.model_cases import EPS, TURNED, Unit


def prescribed(**run):
    return Scene(inputs={"ports": ["omega_b"]}, initial={"attitude": TURNED}, **run)


def turned(q, omega, t):
    """The attitude after a rate is held, in numbers of mpmath."""
    rate = mp.sqrt(sum(mp.mpf(float(w)) ** 2 for w in omega))
    half = rate * t / 2
    return compose(q, [mp.cos(half), *(mp.sin(half) * mp.mpf(float(w)) / (rate or 1) for w in omega)])


def start_of(unit):
    q = [mp.mpf(x) for x in unit["quaternion_0"].tolist()]
    length = mp.sqrt(sum(x * x for x in q))
    return [x / length for x in q]


@pytest.mark.parametrize("omega", [(0.3, -0.2, 0.5), (1e-9, 0.0, 0.0), (0.0, 40.0, 0.0), (3e3, -2e3, 1e3)])
@pytest.mark.parametrize("h", [0.01, 0.7, 1e4])
def test_prescribed_rates_turn_the_attitude_exactly(omega, h):
    """Against R(q_0) exp(skew(omega) t) in 40 digits: no error that grows with the steps or the angle (4e10 rad)."""
    unit, steps = Unit(prescribed()), 1000
    unit["omega_b"] = omega
    unit.step(h, steps)
    with mp.workdps(40):
        assert angle_to(unit["quaternion"], turned(start_of(unit), omega, mp.mpf(h) * steps)) <= 3 * EPS
    np.testing.assert_allclose(unit["omega_a"], rotate(unit["quaternion"], omega), rtol=4 * EPS)


WAYS = {
    "about changing axes, always as fast": lambda k: [math.sin(0.01 * k), math.cos(0.01 * k), 0.3],
    "at random": lambda k: np.random.default_rng(k).normal(size=3) * 3.0,
    "fast": lambda k: [100.0 + k, 200.0, 300.0],
    "to and fro": lambda k: [(-1.0) ** k * 0.7, 0.2, -0.4],
}


@pytest.mark.parametrize("way", WAYS)
def test_rates_that_change_lose_what_the_plan_may_promise(way):
    """Some 0.5 eps a change at worst, where each turn is rounded alike."""
    steps, h = 300, 1.7
    scene = prescribed(run={"stop": steps * h, "step": h})
    unit = Unit(scene)
    with mp.workdps(40):
        truth = start_of(unit)
        for k in range(steps):
            unit["omega_b"] = omega = WAYS[way](k)
            unit.step(h)
            truth = turned(truth, omega, mp.mpf(h))
        error = angle_to(unit["quaternion"], truth)
    assert error <= prescribed_rates_error(scene) <= 5e-13
    assert way != "about changing axes, always as fast" or error >= 0.1 * prescribed_rates_error(scene)


@pytest.mark.parametrize("way", [
    (0.0, 3.9, 0.0), (0.2, 3.5, 0.0), (0.0, 0.0, 7.9), (0.0, 2.0, 3.9), (0.2, 1.0, 5.0), (0.0, 30.0, 0.0),
    (0.0, 0.0, 99.0),
])  # fmt: skip
def test_a_step_from_rest_is_as_accurate_as_any(way):
    """Series of order 16, far enough at a steady rate, were off by 3e-11 where it rises by 4 rad/s in half a second."""
    unit, h, axes = Unit(prescribed()), 0.5, ([0.6, -0.64, 0.48], [0.48, 0.6, -0.64], [0.64, 0.48, 0.6])
    parts = [np.multiply(size, axis) for size, axis in zip(way, axes, strict=True)]
    unit["omega_b"], unit["omega_b_rate"], unit["omega_b_rate_2"] = parts
    with mp.workdps(40):
        terms, truth = [start_of(unit)], start_of(unit)
        for k in range(120):
            term = [mp.mpf(0)] * 4
            for part, before, factor in zip(parts, terms[::-1], (1, 1, mp.mpf(1) / 2), strict=False):
                turn = compose(before, [mp.mpf(0), *(factor * mp.mpf(float(w)) for w in part)])
                term = [a + b / (2 * (k + 1)) for a, b in zip(term, turn, strict=True)]
            terms.append(term)
            truth = [a + b * mp.mpf(h) ** (k + 1) for a, b in zip(truth, term, strict=True)]
        assert angle_to(unit.step(h)["quaternion"], truth) <= 8 * EPS
