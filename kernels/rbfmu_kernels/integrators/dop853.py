"""The 8th-order Runge-Kutta pair DOP853 for the motion of a body, with error control inside a communication step.

Works in a piece of a unit's buffer: 12 stages of 16 numbers are too many for tuples. A state is q (4), omega (3), 0,
r_c (3), v_c (3), 0, 0: sizes that vectorise. No load depends on the position, so it is integrated only where a force
turns with the body (`TURNING`); else the first half suffices (`ROTATION`) and the position has a closed form.
"""

import math
from typing import Any

from ..buffer import FINE, MOST_SUBSTEPS, NOT_REACHED
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import (
    Body,
    LoadPolynomial,
    Loads,
    angular_acceleration,
    is_changing,
    loads_after,
    turning_acceleration,
)
from ..rotations.quaternion import quaternion_rate_b
from ..rotations.vec3 import dot
from ..types import Quaternion, Vec3
from .dop853_tableau import E3, E5, STAGES, A, C
from .substeps import substeps_in, tolerance_of_substep

SPIN, ROTATION, TURNING = 3, 8, 16
"""What of a state is integrated: the rate alone (here with the attitude), rotation, all."""
STATE = 16
LONGEST_STEP = 1e30
"""s: the step size of a body at rest without loads."""
WORK = STATE * (STAGES + 1)
"""Size of the work space: a trial state, then the stages' rates."""


@kernel
def attitude_at(z: Any, i: int) -> Quaternion:
    """The quaternion of the state that begins at z[i]."""
    return (z[i], z[i + 1], z[i + 2], z[i + 3])


@kernel
def put_attitude(z: Any, i: int, q: Quaternion) -> None:
    """Set the quaternion of the state that begins at z[i], scaled to length 1."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    z[i], z[i + 1], z[i + 2], z[i + 3] = s * q[0], s * q[1], s * q[2], s * q[3]


@kernel
def rate_at(z: Any, i: int) -> Vec3:
    """The body rate of the state that begins at z[i]."""
    return (z[i + 4], z[i + 5], z[i + 6])


@kernel(inline=False)
def _rates(z: Any, y: int, k: int, n: int, body: Body, loads: Loads) -> None:
    """z[k:] = d/dt of the state z[y:]."""
    q_ab, omega_b = attitude_at(z, y), rate_at(z, y)
    z[k], z[k + 1], z[k + 2], z[k + 3] = quaternion_rate_b(q_ab, omega_b)
    z[k + 4], z[k + 5], z[k + 6] = angular_acceleration(q_ab, omega_b, body, loads)
    if n == TURNING:
        z[k + 8], z[k + 9], z[k + 10] = z[y + 11], z[y + 12], z[y + 13]
        z[k + 11], z[k + 12], z[k + 13] = turning_acceleration(q_ab, body, loads)


@kernel
def _combine(z: Any, y: int, w: int, n: int, s: int, h: float) -> None:
    """Trial state z[w:] = z[y:] + h sum_l A[s, l] k_l; s is a literal, so that the sum unrolls and zeros vanish."""
    for j in range(n):
        total = 0.0
        for l in range(s):
            if A[s, l] != 0.0:
                total += A[s, l] * z[w + STATE * (l + 1) + j]
        z[w + j] = z[y + j] + h * total


@kernel(inline=False)
def _stage_loads(loads: LoadPolynomial, t: float) -> Loads:
    return loads_after(loads, t)


@kernel
def _stage(
    z: Any, y: int, w: int, n: int, s: int, t: float, h: float, body: Body, loads: LoadPolynomial, changing: bool
) -> None:
    """Stage s (a literal): trial state and its rates, loads at t + c_s h."""
    _combine(z, y, w, n, s, h)
    now = _stage_loads(loads, t + C[s] * h) if changing else loads.value
    _rates(z, w, w + STATE * (s + 1), n, body, now)


@kernel(inline=False)
def dop853_step(z: Any, y: int, w: int, n: int, t: float, h: float, body: Body, loads: LoadPolynomial) -> None:
    """One step of order 8 from the state z[y:] to the trial state z[w:], not normalised; the rates stay in z[w + 16:].

    t: time since the polynomial's beginning.  Stable to h d / I = 6.394 (damping) and h omega / 2 = 5.96 (attitude).
    """
    changing = is_changing(loads)
    _rates(z, y, w + STATE, n, body, _stage_loads(loads, t) if changing else loads.value)
    _stage(z, y, w, n, 1, t, h, body, loads, changing)
    _stage(z, y, w, n, 2, t, h, body, loads, changing)
    _stage(z, y, w, n, 3, t, h, body, loads, changing)
    _stage(z, y, w, n, 4, t, h, body, loads, changing)
    _stage(z, y, w, n, 5, t, h, body, loads, changing)
    _stage(z, y, w, n, 6, t, h, body, loads, changing)
    _stage(z, y, w, n, 7, t, h, body, loads, changing)
    _stage(z, y, w, n, 8, t, h, body, loads, changing)
    _stage(z, y, w, n, 9, t, h, body, loads, changing)
    _stage(z, y, w, n, 10, t, h, body, loads, changing)
    _stage(z, y, w, n, 11, t, h, body, loads, changing)
    _combine(z, y, w, n, 12, h)


@kernel(inline=False)
def _error(z: Any, y: int, w: int, n: int, h: float, span: float) -> float:
    """The step's error estimate: attitude in rad, the rest relative to the size of its vector (at least 1 for r, v)."""
    rate = max(_largest(z, y + 4), _largest(z, w + 4), 1e-300)
    rate = rate if rate * span <= 1.0 else 1.0 / span
    position, velocity = max(_largest(z, y + 8), 1.0), max(_largest(z, y + 11), 1.0)
    five, three = 0.0, 0.0
    for j in range(n):
        e5, e3 = 0.0, 0.0
        for l in range(STAGES):
            k = z[w + STATE * (l + 1) + j]
            e5 += E5[l] * k
            e3 += E3[l] * k
        size = 0.5 if j < 4 else (rate if j < 8 else (position if j < 11 else velocity))
        five += (e5 / size) * (e5 / size)
        three += (e3 / size) * (e3 / size)
    if five == 0.0:
        return 0.0
    return h * five / math.sqrt((five + 0.01 * three) * (7.0 if n == ROTATION else 13.0))


@kernel
def _largest(z: Any, i: int) -> float:
    return max(abs(float(z[i])), abs(float(z[i + 1])), abs(float(z[i + 2])))


@kernel
def first_step(z: Any, y: int, body: Body, loads: Loads) -> float:
    """A step size to begin with: half a radian at the rate and acceleration of the state z[y:]."""
    omega = rate_at(z, y)
    alpha = angular_acceleration(attitude_at(z, y), omega, body, loads)
    pace = math.sqrt(dot(omega, omega)) + math.sqrt(math.sqrt(dot(alpha, alpha)))
    return 0.5 / pace if pace > 0.0 else LONGEST_STEP


@kernel(inline=False)
def dop853_march(z: Any, y: int, w: int, n: int, h: float, substep: float, body: Body, loads: LoadPolynomial) -> int:
    """Advance the state z[y:] by h in equal steps of at most `substep`, without error control.

    NOT_REACHED where that needs too many; the state is then unchanged.
    """
    count = substeps_in(h, substep)
    if count == 0:
        return NOT_REACHED
    for i in range(count):
        dop853_step(z, y, w, n, h / count * i, h / count, body, loads)
        _accept(z, y, w, n)
    return FINE


@kernel(inline=False)
def dop853_advance(
    z: Any,
    y: int,
    w: int,
    size: int,
    n: int,
    h: float,
    tolerance: float,
    span: float,
    body: Body,
    loads: LoadPolynomial,
) -> int:
    """Advance the state z[y:] by h, each step's estimated error at most `tolerance`; span: see `body.memory.SETTINGS`.

    z[size] keeps the step size, z[size + 1] counts the steps tried.

    Equal parts reach h: each step is the rest divided by the number of steps that the kept size would need.
    NOT_REACHED where the motion is not finite or needs too many steps; state and size are then the caller's to restore.
    """
    rest, low, steps = h, 0.0, 0  # rest + low: the time left, so that a thousand steps end where h does
    while rest > 0.0:
        steps += 1
        count = substeps_in(rest, z[size])
        if count == 0 or steps >= MOST_SUBSTEPS:
            return NOT_REACHED
        part = (rest + low) / count
        dop853_step(z, y, w, n, h - rest, part, body, loads)
        z[size + 1] += 1.0
        error = _error(z, y, w, n, part, span) / tolerance_of_substep(tolerance, span, part)
        if error <= 1.0:
            growth = 6.0 if error < 2.6e-7 else 0.9 / math.sqrt(math.sqrt(math.sqrt(error)))
            _accept(z, y, w, n)
            left = 0.0 if count == 1 else rest - part
            low += (rest - left) - part
            rest = left
            z[size] = max(z[size], part * growth) if growth >= 1.0 else part * growth
        else:
            shrink = 0.9 / math.sqrt(math.sqrt(math.sqrt(error))) if math.isfinite(error) else 0.0
            z[size] = part * max(0.2, shrink)
    return FINE


@kernel
def _accept(z: Any, y: int, w: int, n: int) -> None:
    """The trial state becomes the state, its quaternion scaled to length 1."""
    for j in range(4, n):
        z[y + j] = z[w + j]
    put_attitude(z, y, attitude_at(z, w))
