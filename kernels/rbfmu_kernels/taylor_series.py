"""Taylor coefficients of a body's motion, in a piece of a unit's buffer whose row k holds the k-th of all series.

Of the body rate and of those loads that turn in b to full order, few products; of the attitude, and of the acceleration
by a force that turns with the body, as far as `taylor` needs.
"""

from typing import Any

import numpy as np

from ._kernel import kernel
from .body_memory import put_vec3_at, vec3_at
from .dop853 import attitude_at
from .dynamics import Body, Course, Loads, is_changing
from .quaternion import add_scaled_quaternion, compose_quaternions, invert_quaternion, rotate
from .rotation import transform
from .shapes import Matrix, Quaternion, Vec3
from .vec3 import add, cross, is_nonzero, scale, subtract

MOST_ORDER = 24
ROW = 32
WORK = ROW * (MOST_ORDER + 1)
"""Size of the work space."""
TURN, LOADS, _PRODUCT, PUSH = 3, 7, 25, 29
"""Places in a row, after omega's: D, the attitude relative to that at the series' begin; arm_force and torque fixed in
a, their derivatives, and theirs; D o F_b; D F_b D*, the push."""
_ROWS = 31
"""k & _ROWS is k for any row: an index that cannot be negative needs no check."""
PER = 1.0 / np.arange(1.0, MOST_ORDER + 2.0)
"""1 / (k + 1)."""

Torques = tuple[Vec3, Vec3, Vec3]
Acting = tuple[bool, bool, bool]
"""Whether a force fixed in a has an arm, whether a torque fixed in a acts, whether any load changes."""


@kernel
def _put_turn(z: Any, i: int, s: float, q: Quaternion) -> None:
    z[i], z[i + 1], z[i + 2], z[i + 3] = s * q[0], s * q[1], s * q[2], s * q[3]


# Coefficients


@kernel
def _products(s: Any, k: int) -> Vec3:
    """The k-th coefficients of w_2 w_3, w_3 w_1, w_1 w_2: the newest factors last, as they are waited for."""
    x, y, v = 0.0, 0.0, 0.0
    if k & 1 == 0:
        a, b, c = vec3_at(s, ROW * ((k >> 1) & _ROWS))
        x, y, v = b * c, c * a, a * b
    for j in range((k + 1) >> 1):
        i = ((k - 1) >> 1) - j
        a, b, c = vec3_at(s, ROW * (i & _ROWS))
        d, e, f = vec3_at(s, ROW * ((k - i) & _ROWS))
        x += b * f + e * c
        y += c * d + f * a
        v += a * e + d * b
    return (x, y, v)


@kernel
def _squares(s: Any, k: int) -> Vec3:
    """The k-th coefficients of w_1^2, w_2^2, w_3^2."""
    x, y, v = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c = vec3_at(s, ROW * j)
        d, e, f = vec3_at(s, ROW * ((k - j) & _ROWS))
        x += a * d
        y += b * e
        v += c * f
    return (x, y, v)


@kernel
def _gyroscopic_term(s: Any, k: int, M: Matrix) -> Vec3:
    """The k-th coefficient of -omega x M omega."""
    (a, d, e), (_, b, f), (_, _, c) = M
    x, y, v = _products(s, k)
    gyroscopic = ((b - c) * x, (c - a) * y, (a - b) * v)
    if d == 0.0 and e == 0.0 and f == 0.0:
        return gyroscopic
    xx, yy, vv = _squares(s, k)
    off = (
        f * (vv - yy) + (d * y - e * v),
        e * (xx - vv) + (f * v - d * x),
        d * (yy - xx) + (e * x - f * y),
    )
    return add(gyroscopic, off)


@kernel
def _cross_term(s: Any, u: int, k: int) -> Vec3:
    """The k-th coefficient of u x omega."""
    x, y, v = 0.0, 0.0, 0.0
    x2, y2, v2 = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c = vec3_at(s, u + ROW * j)
        d, e, f = vec3_at(s, ROW * ((k - j) & _ROWS))
        x += b * f
        y += c * d
        v += a * e
        x2 += c * e
        y2 += a * f
        v2 += b * d
    return (x - x2, y - y2, v - v2)


@kernel
def _turn_term(s: Any, k: int) -> Quaternion:
    """The k-th coefficient of D o (0, omega)."""
    e, x, y, v = 0.0, 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c, d = attitude_at(s, TURN + ROW * j)
        f, g, h = vec3_at(s, ROW * ((k - j) & _ROWS))
        e -= b * f + c * g + d * h
        x += a * f + (c * h - d * g)
        y += a * g + (d * f - b * h)
        v += a * h + (b * g - c * f)
    return (e, x, y, v)


@kernel
def _push_term(s: Any, k: int) -> Vec3:
    """The k-th coefficient of (D o F_b) o D*."""
    x, y, v = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c, d = attitude_at(s, _PRODUCT + ROW * j)
        e, f, g, h = attitude_at(s, TURN + ROW * ((k - j) & _ROWS))
        x += (b * e - a * f) + (d * g - c * h)
        y += (c * e - a * g) + (b * h - d * f)
        v += (d * e - a * h) + (c * f - b * g)
    return (x, y, v)


# Series


@kernel
def turned_loads(s: Any, q: Quaternion, course: Course) -> None:
    """Row 0 of the loads that are fixed in a, and of their derivatives, as b sees them."""
    q_ba = invert_quaternion(q)
    for i in range(3):
        put_vec3_at(s, LOADS + 6 * i, rotate(q_ba, course[i][1]))
        put_vec3_at(s, LOADS + 6 * i + 3, rotate(q_ba, course[i][3]))


@kernel
def _next_load(s: Any, u: int, k: int, changes: bool) -> None:
    """Coefficient k + 1 at u of du/dt = u x omega + what stands 6 further, if it changes."""
    term = _cross_term(s, u, k)
    if changes:
        term = add(term, vec3_at(s, u + ROW * k + 6))
    put_vec3_at(s, u + ROW * (k + 1), scale(PER[k], term))


@kernel(inline=False)
def _next_loads(s: Any, k: int) -> None:
    """The same of the derivatives."""
    for i in range(4):
        _next_load(s, LOADS + 6 + 3 * i, k, i < 2)


@kernel
def _torque_b(loads: Loads, body: Body) -> Vec3:
    return add(loads[4], cross(body[3], loads[2]))


@kernel
def acting_loads(body: Body, course: Course) -> Acting:
    """Which loads there are."""
    force = is_nonzero(course[0][1]) or is_nonzero(course[1][1]) or is_nonzero(course[2][1])
    twisted = is_nonzero(course[0][3]) or is_nonzero(course[1][3]) or is_nonzero(course[2][3])
    return force and is_nonzero(body[3]), twisted, is_changing(course)


@kernel
def known_torques(course: Course, body: Body) -> Torques:
    """The torque that is known in b: coefficients 0, 1, 2."""
    return _torque_b(course[0], body), _torque_b(course[1], body), scale(0.5, _torque_b(course[2], body))


@kernel(inline=False)
def rate_series(s: Any, first: int, last: int, body: Body, torques: Torques, acting: Acting) -> None:
    """Coefficients up to `last` of omega and of the loads that turn in b, from those up to `first`."""
    _, M, M_inverse, arm, damping, _ = body
    lifted, twisted, changing = acting
    for k in range(first, last):
        rate = vec3_at(s, ROW * k)
        drag = (damping[0] * rate[0], damping[1] * rate[1], damping[2] * rate[2])
        torque = subtract(_gyroscopic_term(s, k, M), drag)
        if k < 3:
            torque = add(torque, torques[k])
        if lifted:
            torque = add(torque, cross(arm, vec3_at(s, LOADS + ROW * k)))
        if twisted:
            torque = add(torque, vec3_at(s, LOADS + 3 + ROW * k))
        put_vec3_at(s, ROW * (k + 1), scale(PER[k], transform(M_inverse, torque)))
        if lifted:
            _next_load(s, LOADS, k, changing)
        if twisted:
            _next_load(s, LOADS + 3, k, changing)
        if changing:
            _next_loads(s, k)


@kernel(inline=False)
def turn_series(s: Any, m: int) -> None:
    """Coefficients up to m of D, the attitude relative to that at the series' begin."""
    _put_turn(s, TURN, 1.0, (1.0, 0.0, 0.0, 0.0))
    for k in range(m):
        _put_turn(s, TURN + ROW * (k + 1), 0.5 * PER[k], _turn_term(s, k))


@kernel
def _pushed(s: Any, k: int, lightness: float, force: Vec3) -> Quaternion:
    force = scale(lightness, force)
    return compose_quaternions(attitude_at(s, TURN + ROW * k), (0.0, force[0], force[1], force[2]))


@kernel(inline=False)
def push_series(s: Any, m: int, lightness: float, course: Course) -> None:
    """Coefficients below m of D F_b D* / mass: the turning acceleration in the axes that b has at the series' begin."""
    for k in range(m):
        product = _pushed(s, k, lightness, course[0][2])
        if k > 0:
            product = add_scaled_quaternion(product, 1.0, _pushed(s, k - 1, lightness, course[1][2]))
        if k > 1:
            product = add_scaled_quaternion(product, 0.5, _pushed(s, k - 2, lightness, course[2][2]))
        _put_turn(s, _PRODUCT + ROW * k, 1.0, product)
        put_vec3_at(s, PUSH + ROW * k, _push_term(s, k))
