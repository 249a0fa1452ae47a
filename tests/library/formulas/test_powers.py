"""Roots and powers that come to zero in loads, and conditions on them."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rbfmu
from tests.support.scenes.balls import ball, pushed_ball


@pytest.mark.parametrize(("text", "gained"), [
    ("max(t - 0.3, 0)**1.5", 0.7**2.5 / 2.5), ("sqrt(max(0.3 - t, 0))", 0.3**1.5 / 1.5),
    ("abs(t - 0.4)**0.5", (0.4**1.5 + 0.6**1.5) / 1.5), ("max(0.2 - t*t, 0)**1.5", 0.0075 * math.pi),
    ("max(1.1*t - 1.1*0.477, 0)**1.5", 1.1**1.5 * 0.523**2.5 / 2.5),
    ("max(t - 0.3, 0)**1.7", 0.7**2.7 / 2.7), ("t**0.3*t", 1.0 / 2.3), ("(sqrt(2)*norm([t, t]))**0.6", 2**0.6 / 1.6),
])  # fmt: skip
def test_a_root_may_begin_and_end_beside_its_zero(text, gained):
    """At 5.6e-17 coefficients of order 26 leave the range of numbers: refused; t - 0.7, which comes to 0, was not.

    Nor was any whose zero round-off does not meet, as that of 0.2 - t*t, or has below zero, as 1.1*t - 1.1*0.477.
    """
    found = rbfmu.simulate(pushed_ball(text, stop=1.0, accuracy=1e-9)).velocity[-1, 0]
    assert found == pytest.approx(gained, rel=0, abs=1e-9)


@pytest.mark.parametrize("drag", [
    "abs(omega_b[3])**0.75*omega_b[3]", "abs(omega_b[3])**n*omega_b[3]", "norm(omega_b)**0.75*omega_b[3]",
    "(max(omega_b[3], 0)**1.75 - max(-omega_b[3], 0)**1.75)",
])  # fmt: skip
@pytest.mark.parametrize("start", [1.0, 0.1, 0.0])
def test_drag_by_a_power_of_the_rate_turns_with_it(drag, start):
    """It was refused where the rate came to zero: round-off made what the power is of less than zero there."""
    scene = ball(f"-1 - 0.5*{drag}", accuracy=1e-9, initial={"omega_b": [0.0, 0.0, start]}, constants={"n": 0.75})
    w = rbfmu.simulate(scene if "n*" in drag else scene.replace({"constants.n": None})).omega_b[-1, 2]
    passed = mpmath.quad(lambda u: 1 / (1 + abs(u) ** mpmath.mpf(0.75) * u / 2), [w, 0, start])
    assert float(passed) == pytest.approx(2.0, rel=0, abs=1e-9)


@pytest.mark.thorough
def test_a_norm_under_a_power_may_come_to_zero():
    """No method came to an end, as the root of the norm has no series there, and the power of it none either."""
    scene = ball("cos(t) - norm(omega_b)**0.4*omega_b[3]", 6.0, 0.5, 1e-6, initial={"omega_b": [0.0, 0.0, 0.5]})
    w = rbfmu.simulate(scene).omega_b[:, 2]
    exact = solve_ivp(lambda t, y: np.cos(t) - abs(y) ** 0.4 * y, (0.0, 6.0), [0.5], "DOP853",
                      np.arange(13) * 0.5, rtol=1e-11, atol=1e-13, max_step=1e-2).y[0]  # fmt: skip
    assert np.abs(w - exact).max() < 1e-6


@pytest.mark.thorough
@pytest.mark.parametrize(("root", "on"), [("sqrt(abs(t - 1e-3))", 0.251), ("abs(t - 1)**0.3", 2 * 0.5 ** (1 / 0.3))])
def test_a_condition_on_a_root_is_followed_from_its_corner(root, on):
    """2026-11-30: 5.0, told to be exact: coefficients beside the corner were beyond all numbers, and no zero found."""
    found = rbfmu.simulate(ball(f"where({root} < 0.5, 1, 0)", 5.0)).omega_b[-1, 2]
    assert found == pytest.approx(on, rel=0, abs=1e-6 * on)


@pytest.mark.thorough
def test_a_fast_body_with_ports_comes_to_the_zero_of_a_power():
    """Coefficients of order 20 and more overflow at 1e-20 s before the zero: neither plan nor judge came beyond it."""
    scene = ball("(1e5*max(3e-6 - t, 0))**1.5", 1e-5, 1e-6, 1e-9).replace({"inputs.ports": ["torque_b"]})
    expected = 1e-5 * 0.3**2.5 / 2.5
    assert rbfmu.simulate(scene).omega_b[-1, 2] == pytest.approx(expected, rel=1e-9)
    pushed = rbfmu.simulate(scene, {"torque_b": ([0.0, 2e-6], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.05]])})
    assert pushed.omega_b[-1, 2] == pytest.approx(expected + 0.05 * 8e-6, rel=1e-9)


@pytest.mark.parametrize("text", ["max(t - 0.3, 0)**-0.3", "max(t - 0.3, 0)**n"])
def test_what_is_infinite_at_its_corner_is_refused(text):
    with pytest.raises(rbfmu.SceneError, match="is not finite"):
        rbfmu.plan(pushed_ball(text, stop=1.0, accuracy=1e-4, constants={"n": -0.3} if "n" in text else {}))


@pytest.mark.thorough
def test_a_contact_too_short_for_its_time_is_refused():
    """A root counts as zero in round-off of the time: plan and judge had it so alike, which was wrong by 3e-7."""
    initial = {"position": [7311.0, 0.0, 0.0], "velocity": [-1.0, 0.0, 0.0]}
    scene = pushed_ball("1e6*sqrt(max(-position[1], 0))", stop=1e4, step=1e4, accuracy=1e-9, initial=initial)
    with pytest.raises(rbfmu.SceneError, match=r"the methods here reach \d\.\de-07$"):
        rbfmu.plan(scene)
