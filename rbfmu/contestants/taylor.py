"""Taylor series of any order for bodies in principal axes: each load's direction in b is a series of its own.

A vector f fixed in a has components in b with df/dt = f x omega, so that no product is of more than two series.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from rbfmu_kernels._kernel import kernel
from rbfmu_kernels.dynamics import Body, Loads, State, steady_acceleration
from rbfmu_kernels.quaternion import invert_quaternion, normalize, rotate
from rbfmu_kernels.shapes import Vec3
from rbfmu_kernels.vec3 import add, cross, is_nonzero, scale


@kernel
def _cross_term(u: Any, v: Any, k: int) -> Vec3:
    """The k-th coefficient of u x v."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c = u[j, 0], u[j, 1], u[j, 2]
        d, e, f = v[k - j, 0], v[k - j, 1], v[k - j, 2]
        x += b * f - c * e
        y += c * d - a * f
        z += a * e - b * d
    return (x, y, z)


@kernel
def _quaternion_term(q: Any, w: Any, k: int) -> tuple[float, float, float, float]:
    """The k-th coefficient of q o (0, w) / 2."""
    e, x, y, z = 0.0, 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c, d = q[j, 0], q[j, 1], q[j, 2], q[j, 3]
        f, g, h = w[k - j, 0], w[k - j, 1], w[k - j, 2]
        e -= b * f + c * g + d * h
        x += a * f + c * h - d * g
        y += a * g - b * h + d * f
        z += a * h + b * g - c * f
    return (0.5 * e, 0.5 * x, 0.5 * y, 0.5 * z)


@kernel
def _turned_term(q: Any, f: Vec3, k: int) -> Vec3:
    """The k-th coefficient of R(q) f = 2 (eps . f) eps + (eta^2 - eps . eps) f + 2 eta eps x f."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(k + 1):
        i = k - j
        s = 2.0 * (q[j, 1] * f[0] + q[j, 2] * f[1] + q[j, 3] * f[2])
        r = q[j, 0] * q[i, 0] - q[j, 1] * q[i, 1] - q[j, 2] * q[i, 2] - q[j, 3] * q[i, 3]
        t = 2.0 * q[j, 0]
        x += s * q[i, 1] + r * f[0] + t * (q[i, 2] * f[2] - q[i, 3] * f[1])
        y += s * q[i, 2] + r * f[1] + t * (q[i, 3] * f[0] - q[i, 1] * f[2])
        z += s * q[i, 3] + r * f[2] + t * (q[i, 1] * f[1] - q[i, 2] * f[0])
    return (x, y, z)


@kernel
def _gyroscopic_term(w: Any, k: int) -> Vec3:
    """The k-th coefficients of w_2 w_3, w_3 w_1, w_1 w_2."""
    x, y, z = 0.0, 0.0, 0.0
    for j in range(k + 1):
        x += w[j, 1] * w[k - j, 2]
        y += w[j, 2] * w[k - j, 0]
        z += w[j, 0] * w[k - j, 1]
    return (x, y, z)


@kernel
def _at(s: Any, k: int) -> Vec3:
    return (s[k, 0], s[k, 1], s[k, 2])


@kernel
def _put(s: Any, k: int, v: Vec3) -> None:
    s[k, 0], s[k, 1], s[k, 2] = v


@kernel
def _sum(s: Any, i: int, h: float) -> float:
    """Component i of a series at h."""
    total = 0.0
    for k in range(len(s) - 1, -1, -1):
        total = total * h + s[k, i]
    return total


@kernel
def _integral(s: Any, i: int, h: float) -> float:
    total = 0.0
    for k in range(len(s) - 1, -1, -1):
        total = total * h + s[k, i] / (k + 1.0)
    return total * h


Work = tuple[Any, Any, Any, Any, Any]
"""Coefficients of q, omega, v_c, and of `arm_force_a` and `torque_a` in b: arrays (order + 1, 4 or 3)."""


@njit  # type: ignore[untyped-decorator]
def work_space(order: int) -> Work:
    """For `series` of an order."""
    n = order + 1
    return np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))


@kernel(inline=False)
def series(work: Any, state: State, body: Body, loads: Loads) -> None:
    """The motion's Taylor coefficients at a state, to the order that the work space has room for."""
    q, w, v, f, g = work
    _, v_c, attitude, omega = state
    lightness, M, _, arm, damping, _ = body
    _, force_a, force_b, torque_a, torque_b = loads
    one, two, three = M[0][0], M[1][1], M[2][2]
    push, steady_torque = scale(lightness, force_b), add(torque_b, cross(arm, force_b))
    lifted, twisted, pushed = is_nonzero(force_a), is_nonzero(torque_a), is_nonzero(force_b)
    q_ba = invert_quaternion(attitude)
    q[0, 0], q[0, 1], q[0, 2], q[0, 3] = attitude
    _put(w, 0, omega)
    _put(v, 0, v_c)
    _put(v, 1, steady_acceleration(body, loads))
    _put(f, 0, rotate(q_ba, force_a))
    _put(g, 0, rotate(q_ba, torque_a))
    for k in range(len(q) - 1):
        s = 1.0 / (k + 1.0)
        x, y, z = _gyroscopic_term(w, k)
        torque = (
            (two - three) * x - damping[0] * w[k, 0],
            (three - one) * y - damping[1] * w[k, 1],
            (one - two) * z - damping[2] * w[k, 2],
        )
        if k == 0:
            torque = add(torque, steady_torque)
        if lifted:
            torque = add(torque, cross(arm, _at(f, k)))
            _put(f, k + 1, scale(s, _cross_term(f, w, k)))
        if twisted:
            torque = add(torque, _at(g, k))
            _put(g, k + 1, scale(s, _cross_term(g, w, k)))
        if pushed:
            turning = scale(s, _turned_term(q, push, k))
            _put(v, k + 1, add(turning, _at(v, k + 1)) if k == 0 else turning)
        d = _quaternion_term(q, w, k)
        _put(w, k + 1, (s * torque[0] / one, s * torque[1] / two, s * torque[2] / three))
        q[k + 1, 0], q[k + 1, 1], q[k + 1, 2], q[k + 1, 3] = s * d[0], s * d[1], s * d[2], s * d[3]


@kernel(inline=False)
def state_at(work: Any, r: Vec3, h: float) -> State:
    """The state at a time h after that of the series, |q| = 1; r: the position there."""
    q, w, v, _, _ = work
    return (
        add(r, (_integral(v, 0, h), _integral(v, 1, h), _integral(v, 2, h))),
        (_sum(v, 0, h), _sum(v, 1, h), _sum(v, 2, h)),
        normalize((_sum(q, 0, h), _sum(q, 1, h), _sum(q, 2, h), _sum(q, 3, h))),
        (_sum(w, 0, h), _sum(w, 1, h), _sum(w, 2, h)),
    )


@kernel
def _size(s: Any, k: int, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += s[k, i] * s[k, i]
    return math.sqrt(total)


@kernel
def _term(work: Any, k: int) -> float:
    """The k-th coefficient's size: attitude in rad, omega relative to itself, v_c to at least 1 m/s."""
    q, w, v, _, _ = work
    turn, rate = 2.0 * _size(q, k, 4), _size(w, k, 3) / max(_size(w, 0, 3), _size(w, 1, 3), 1e-300)
    return max(turn, rate, _size(v, k, 3) / max(_size(v, 0, 3), 1.0))


@kernel(inline=False)
def longest_step(work: Any, tolerance: float) -> float:
    """The step at which the last two terms are within the tolerance."""
    last = len(work[0]) - 1
    h = 1e30
    for k in range(last - 1, last + 1):
        size = _term(work, k)
        if size > 0.0:
            h = min(h, (tolerance / size) ** (1.0 / k))
    return h


def order_for(tolerance: float) -> int:
    """The order of least work.  A. Jorba & M. Zou, Experimental Mathematics 14 (2005), 3.1."""
    return math.ceil(1.0 - 0.5 * math.log(tolerance))


def taylor(order: int) -> Any:
    """`steps(y, h, n, body, loads)` of an order; off-diagonal M is ignored."""

    @njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
    def steps(y: State, h: float, n: int, body: Body, loads: Loads) -> State:
        work = work_space(order)
        for _ in range(n):
            series(work, y, body, loads)
            y = state_at(work, y[0], h)
        return y

    return steps


@kernel(inline=False)
def advance_within(
    work: Any, y: State, interval: float, tolerance: float, body: Body, loads: Loads
) -> tuple[State, float]:
    """(state after an interval, steps taken), every step's last two terms within the tolerance: no step is refused."""
    rest, steps = interval, 0.0
    while rest > 0.0:
        series(work, y, body, loads)
        count = math.ceil(rest / longest_step(work, tolerance) * (1.0 - 1e-9))
        part = rest / count
        y = state_at(work, y[0], part)
        rest = 0.0 if not count > 1 else rest - part
        steps += 1.0
    return y, steps
