"""Taylor series of any order for the motion of a body, with error control inside a communication step.

Only the body rate, and those loads that turn in b, are series of full order: few products. The attitude follows from
the rate by the two-point formula of Hermite and Obreshkov, exact to order 2 m from m derivatives at either end:
sum_k c_k h^k q^(k)(0) = sum_k c_k (-h)^k q^(k)(h), c_k = (2m - k)! m! / ((2m)! k! (m - k)!), which q = q_0 o D makes
explicit. Where a force turns with the body, velocity and position follow in the same way.
Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, I.8 and III.3; the step is chosen by
the last two terms: A. Jorba & M. Zou, Experimental Mathematics 14 (2005).

Works in a piece of a unit's buffer, whose row k holds the k-th coefficients of all series; states as in `dop853`.
"""

import math
from typing import Any

import numpy as np

from ._kernel import kernel
from .body_memory import put_vec3_at, vec3_at
from .dop853 import SPIN, TURNING, attitude_at, put_attitude, rate_at
from .dynamics import Body, Course, Loads, course_after, is_changing
from .layout import FINE, MOST_SUBSTEPS, NOT_REACHED
from .quaternion import add_scaled_quaternion, compose_quaternions, invert_quaternion, rotate
from .rotation import transform
from .shapes import Matrix, Quaternion, Vec3
from .vec3 import add, add_scaled, cross, is_nonzero, scale, subtract

MOST_ORDER = 24
ROW = 32
WORK = ROW * (MOST_ORDER + 1)
"""Size of the work space."""
_RATE, _TURN, _LOADS, _PRODUCT, _PUSH = 0, 3, 7, 25, 29
"""Places in a row: omega; D; arm_force and torque fixed in a, then their derivatives, twice; D o F_b; D F_b D*."""
_ROWS = 31
"""k & _ROWS is k for any row: an index that cannot be negative needs no check."""
_MOST_DERIVATIVES = 9
_WEIGHT = np.array(
    [
        [
            math.perm(m, k) * math.factorial(2 * m - k) / math.factorial(2 * m) if k <= m else 0.0
            for k in range(_MOST_DERIVATIVES + 2)
        ]
        for m in range(_MOST_DERIVATIVES + 1)
    ]
)
"""c_k k! of the two-point formula with m derivatives: [m, k]."""
_REMAINDER = np.array(
    [
        math.factorial(m) ** 2 / (math.factorial(2 * m) * math.factorial(2 * m + 1)) * 0.25**m
        for m in range(_MOST_DERIVATIVES + 1)
    ]
)
"""Its error: this times (2 h)^(2m+1) / 2 and the (2m+1)-th derivative."""
_FOUR = 4.0 ** np.arange(_MOST_DERIVATIVES + 1)
_PER = 1.0 / np.arange(1.0, MOST_ORDER + 2.0)
"""1 / (k + 1)."""

Torques = tuple[Vec3, Vec3, Vec3]
Acting = tuple[bool, bool, bool]
"""Whether a force fixed in a has an arm, whether a torque fixed in a acts, whether any load changes."""


@kernel
def derivatives_of_attitude(order: int) -> int:
    """How many the attitude needs beside rates of an order: measured, the least work from 1e-3 to 1e-12."""
    return (3 * order + 7) // 8


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
        a, b, c, d = attitude_at(s, _TURN + ROW * j)
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
        e, f, g, h = attitude_at(s, _TURN + ROW * ((k - j) & _ROWS))
        x += (b * e - a * f) + (d * g - c * h)
        y += (c * e - a * g) + (b * h - d * f)
        v += (d * e - a * h) + (c * f - b * g)
    return (x, y, v)


# Series


@kernel
def _turned_loads(s: Any, q: Quaternion, course: Course) -> None:
    """Row 0 of the loads that are fixed in a, and of their derivatives, as b sees them."""
    q_ba = invert_quaternion(q)
    for i in range(3):
        put_vec3_at(s, _LOADS + 6 * i, rotate(q_ba, course[i][1]))
        put_vec3_at(s, _LOADS + 6 * i + 3, rotate(q_ba, course[i][3]))


@kernel
def _next_load(s: Any, u: int, k: int, changes: bool) -> None:
    """Coefficient k + 1 at u of du/dt = u x omega + what stands 6 further, if it changes."""
    term = _cross_term(s, u, k)
    if changes:
        term = add(term, vec3_at(s, u + ROW * k + 6))
    put_vec3_at(s, u + ROW * (k + 1), scale(_PER[k], term))


@kernel(inline=False)
def _next_loads(s: Any, k: int) -> None:
    """The same of the derivatives."""
    for i in range(4):
        _next_load(s, _LOADS + 6 + 3 * i, k, i < 2)


@kernel
def _torque_b(loads: Loads, body: Body) -> Vec3:
    return add(loads[4], cross(body[3], loads[2]))


@kernel
def _acting(body: Body, course: Course) -> Acting:
    """Which loads there are."""
    force = is_nonzero(course[0][1]) or is_nonzero(course[1][1]) or is_nonzero(course[2][1])
    twisted = is_nonzero(course[0][3]) or is_nonzero(course[1][3]) or is_nonzero(course[2][3])
    return force and is_nonzero(body[3]), twisted, is_changing(course)


@kernel
def _torques(course: Course, body: Body) -> Torques:
    """The torque that is known in b: coefficients 0, 1, 2."""
    return _torque_b(course[0], body), _torque_b(course[1], body), scale(0.5, _torque_b(course[2], body))


@kernel(inline=False)
def _rate_series(s: Any, first: int, last: int, body: Body, torques: Torques, acting: Acting) -> None:
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
            torque = add(torque, cross(arm, vec3_at(s, _LOADS + ROW * k)))
        if twisted:
            torque = add(torque, vec3_at(s, _LOADS + 3 + ROW * k))
        put_vec3_at(s, ROW * (k + 1), scale(_PER[k], transform(M_inverse, torque)))
        if lifted:
            _next_load(s, _LOADS, k, changing)
        if twisted:
            _next_load(s, _LOADS + 3, k, changing)
        if changing:
            _next_loads(s, k)


@kernel(inline=False)
def _turn_series(s: Any, m: int) -> None:
    """Coefficients up to m of D, the attitude relative to that at the series' begin."""
    _put_turn(s, _TURN, 1.0, (1.0, 0.0, 0.0, 0.0))
    for k in range(m):
        _put_turn(s, _TURN + ROW * (k + 1), 0.5 * _PER[k], _turn_term(s, k))


@kernel
def _pushed(s: Any, k: int, lightness: float, force: Vec3) -> Quaternion:
    force = scale(lightness, force)
    return compose_quaternions(attitude_at(s, _TURN + ROW * k), (0.0, force[0], force[1], force[2]))


@kernel(inline=False)
def _push_series(s: Any, m: int, lightness: float, course: Course) -> None:
    """Coefficients below m of D F_b D* / mass: the turning acceleration in the axes that b has at the series' begin."""
    for k in range(m):
        product = _pushed(s, k, lightness, course[0][2])
        if k > 0:
            product = add_scaled_quaternion(product, 1.0, _pushed(s, k - 1, lightness, course[1][2]))
        if k > 1:
            product = add_scaled_quaternion(product, 0.5, _pushed(s, k - 2, lightness, course[2][2]))
        _put_turn(s, _PRODUCT + ROW * k, 1.0, product)
        put_vec3_at(s, _PUSH + ROW * k, _push_term(s, k))


# Steps


@kernel
def _sum(s: Any, u: int, order: int, h: float) -> Vec3:
    """The series at u, at h."""
    total = (0.0, 0.0, 0.0)
    for k in range(order, -1, -1):
        total = add_scaled(vec3_at(s, u + ROW * k), h, total)
    return total


@kernel
def _half_turn(s: Any, m: int, h: float) -> Quaternion:
    """The two-point formula's half: sum of c_k k! h^k D_k."""
    power, total = 1.0, (0.0, 0.0, 0.0, 0.0)
    for k in range(m + 1):
        total = add_scaled_quaternion(total, _WEIGHT[m, k] * power, attitude_at(s, _TURN + ROW * k))
        power *= h
    return total


@kernel
def _half_push(s: Any, m: int, h: float) -> tuple[Vec3, Vec3]:
    """The same of the velocity and of the position that an acceleration makes."""
    power, speed, path = h, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(m):
        push = scale(_PER[k] * power, vec3_at(s, _PUSH + ROW * k))
        power *= h
        speed = add_scaled(speed, _WEIGHT[m, k + 1], push)
        path = add_scaled(path, _WEIGHT[m, k + 2] * _PER[k + 1] * h, push)
    return speed, path


@kernel
def _move(z: Any, y: int, q: Quaternion, m: int, s: Any, h: float) -> None:
    """The two-point formula's half for velocity and position of the state z[y:], h < 0 at a step's end."""
    speed, path = _half_push(s, m, h)
    speed, path = rotate(q, speed), rotate(q, path)
    sign = math.copysign(1.0, h)
    for i in range(3):
        z[y + 11 + i] += sign * speed[i] if h < 0.0 else 0.0
        z[y + 8 + i] += 0.5 * abs(h) * z[y + 11 + i] + sign * path[i]
        z[y + 11 + i] += sign * speed[i] if h > 0.0 else 0.0


@kernel
def _power(x: float, n: int) -> float:
    total = 1.0
    while n > 0:
        total = total * x if n & 1 == 1 else total
        x, n = x * x, n >> 1
    return total


@kernel
def _largest(v: Vec3) -> float:
    return max(max(abs(v[0]), abs(v[1])), abs(v[2]))


@kernel(inline=False)
def _error(s: Any, order: int, h: float, push: float, n: int) -> float:
    """Estimate for a step of h: the last two terms relative to the rate, and the two-point formula's remainder (rad).

    push: a force's acceleration, relative to the velocity and at least 1 m/s, if it turns with the body.
    """
    m, rate, power = derivatives_of_attitude(order), 0.0, 1.0
    for k in range(4):
        rate = max(rate, _largest(vec3_at(s, ROW * k)) * power)
        power *= h
    last = max(_largest(vec3_at(s, ROW * (order - 1))), h * _largest(vec3_at(s, ROW * order))) * _power(h, order - 1)
    turn = h * rate
    last = last / rate if rate > 0.0 else 0.0
    if n == SPIN:
        return last
    remainder: float = _REMAINDER[m] * _power(turn * turn, m) * max(turn, _FOUR[m] * h * push)
    return max(last, remainder)


@kernel
def _nearer_size(h: float, order: int, excess: float) -> float:
    """About h excess^(-1 / order), without a root."""
    if not excess < 1e4:
        return 0.5 * h
    if excess < 1e-4:
        return 2.0 * h if excess < 1e-8 else 1.3 * h
    return h * ((order + 1.0) + (order - 1.0) * excess) / ((order - 1.0) + (order + 1.0) * excess)


@kernel
def _sums(s: Any, order: int, h: float, acting: Acting) -> None:
    """Row 0 of omega and of the loads that turn in b becomes their series' sum at h."""
    put_vec3_at(s, 0, _sum(s, 0, order, h))
    lifted, twisted, changing = acting
    for level in range(3 if changing else 1):
        u = _LOADS + 6 * level
        if lifted:
            put_vec3_at(s, u, _sum(s, u, order, h))
        if twisted:
            put_vec3_at(s, u + 3, _sum(s, u + 3, order, h))


@kernel(inline=False)
def taylor_advance(
    z: Any, y: int, w: int, size: int, n: int, order: int, h: float, tolerance: float, body: Body, course: Course
) -> int:
    """Advance the state z[y:] by h, the estimated error of each step at most `tolerance`; infinite: steps as kept.

    z[size] keeps the step size, z[size + 1] counts the steps.  Equal parts reach h, as in `dop853_advance`.
    NOT_REACHED where the motion is not finite or needs too many steps; state and size are then the caller's to restore.
    """
    s, m, now = z[w : w + WORK], derivatives_of_attitude(order), course
    acting, torques = _acting(body, course), _torques(course, body)
    turned = acting[0] or acting[1]
    put_vec3_at(s, 0, rate_at(z, y))
    if turned:
        _turned_loads(s, attitude_at(z, y), now)
    _rate_series(s, 0, order, body, torques, acting)
    if n != SPIN:
        _turn_series(s, m)
    if n == TURNING:
        _push_series(s, m, body[0], now)
    rest, low, tried = h, 0.0, 0
    while rest > 0.0:
        tried += 1
        if not (rest < MOST_SUBSTEPS * z[size] and tried < MOST_SUBSTEPS):
            return NOT_REACHED
        count = max(math.ceil(rest / z[size] * (1.0 - 1e-9)), 1)
        part = (rest + low) / count
        push = _largest(vec3_at(s, _PUSH)) / max(_largest(vec3_at(z, y + 11)), 1.0) if n == TURNING else 0.0
        excess = _error(s, order, part, push, n) / tolerance
        if not excess <= 1.0:
            z[size] = _nearer_size(part, order, 2.0 * excess)
            continue
        z[size + 1] += 1.0
        nearer = _nearer_size(part, order, 1.4 * excess) if tolerance < math.inf else z[size]
        z[size] = max(z[size], nearer) if count == 1 else nearer
        left = 0.0 if count == 1 else rest - part
        low += (rest - left) - part
        rest = left
        q, half = attitude_at(z, y), (1.0, 0.0, 0.0, 0.0)
        if n != SPIN:
            half = _half_turn(s, m, part)
        if n == TURNING:
            _move(z, y, q, m, s, part)
        _sums(s, order, part, acting)
        if acting[2]:
            now = course_after(course, h - rest)
            torques = _torques(now, body)
        put_vec3_at(z, y + 4, vec3_at(s, 0))
        if n != SPIN or rest > 0.0:
            _rate_series(s, 0, m if turned or rest == 0.0 else order, body, torques, acting)
        if n != SPIN:
            _turn_series(s, m)
            q = compose_quaternions(compose_quaternions(q, half), invert_quaternion(_half_turn(s, m, -part)))
            put_attitude(z, y, q)
        if n == TURNING:
            _push_series(s, m, body[0], now)
            _move(z, y, attitude_at(z, y), m, s, -part)
        if turned and rest > 0.0:
            _turned_loads(s, attitude_at(z, y), now)
            _rate_series(s, 0, order, body, torques, acting)
    return FINE
