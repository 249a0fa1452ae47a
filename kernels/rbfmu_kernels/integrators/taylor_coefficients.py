"""Taylor coefficients of a body's motion, in a piece of a model's buffer: one row of numbers for each term of a series.

The body rate, and those loads that turn in b, have series of full order, which take few products. The attitude, and the
acceleration by a force that turns with the body, have them to the order that `taylor` needs.
"""

from typing import Any, NamedTuple

import numpy as np

from ..buffer import places
from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import add_lanes, cyclic_at, lanes, lanes_at, multiply_lanes, numbers, put_cyclic, put_lanes
from ..compile.wide import all_of
from ..mechanics.equations_of_motion import Body, LoadPolynomial, Loads, acting_loads, is_changing
from ..mechanics.newton_euler import damping_torque
from ..rotations.matrix import transform
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, invert_quaternion, rotate
from ..rotations.vec3 import ZERO, add, cross, is_nonzero, scale, subtract
from ..types import Buffer, Matrix, Quaternion, Vec3

MAX_ORDER = 24
"""The order of least work at a tolerance eps is 1 - ln(eps) / 2 (Jorba & Zou 2005, 3.2): 19 at doubles' round-off.

Series for many communication steps pay at somewhat higher orders, as these steps share their cost.
"""
_IN_ROW, ROW = places({"first": 4, "second": 4})
"""A row holds a vector (x, y, z, 0) and the same as a second factor, (y, z, x, 0); or D and D o F_b."""
_SECOND: int = _IN_ROW["second"].start
_NAMES = (
    "rate", "turn", "force", "torque", "force_rate", "torque_rate", "force_rate_2", "torque_rate_2", "acceleration",
)  # fmt: skip
_SERIES = ROW * (MAX_ORDER + 1)
_, WORK = _LAYOUT = places(dict.fromkeys(_NAMES, _SERIES))
"""The series, and the size of the work space that holds them: the body rate; D, the attitude relative to that at the
series' beginning; force_a and torque_a as b sees them, and their derivatives; D F_b D* / mass, the acceleration by a
force that turns with the body."""
RATE, TURN, FORCE, TORQUE, FORCE_RATE, TORQUE_RATE, FORCE_RATE_2, TORQUE_RATE_2, ACCELERATION = _LAYOUT.at
TO_DERIVATIVE = FORCE_RATE - FORCE
"""The distance from a load's series to that of its derivative."""
ROWS = 31
"""k & ROWS is k for any row: an index that cannot be negative needs no check."""
AT_ONCE = 4
"""How many terms evaluation adds at once."""
PER = 1.0 / np.arange(1.0, MAX_ORDER + 2.0)
"""1 / (k + 1)."""

Torques = tuple[Vec3, Vec3, Vec3]


class SpaceFixedLoads(NamedTuple):
    """Whether a force fixed in a acts on an arm, whether a torque fixed in a acts, and whether any load changes."""

    lever_force: bool
    torque: bool
    changing: bool


@kernel
def term(series: int, k: int) -> int:
    """Return the place of the k-th coefficient of a series."""
    return series + ROW * k


@kernel
def product(series: int, k: int) -> int:
    """Return where the second half of the row of a series' k-th coefficient begins."""
    return series + _SECOND + ROW * k


# Coefficients


@kernel
def put_factors(s: Buffer, i: int, v: Vec3) -> None:
    """Store a vector as both factors of a product, in lanes: a read of the same lanes need not wait for the write."""
    put_lanes(s, i, lanes(v[0], v[1], v[2], 0.0))
    put_cyclic(s, i + _SECOND, lanes(v[1], v[2], v[0], 0.0))


@kernel
def _second_at(s: Buffer, i: int) -> Any:
    """Return a vector as the second factor of a product: (y, z, x, 0)."""
    return cyclic_at(s, i, i + _SECOND)


@kernel
def _inner_products(s: Buffer, u: int, v: int, k: int) -> Vec3:
    """Return the sum of u_j v_(k-j), v as second factor, without its two ends, which need the newest coefficients."""
    low = high = lanes(0.0, 0.0, 0.0, 0.0)
    i, j = ROW * ((k + 1) >> 1), ROW * (k >> 1)
    if i == j and k > 0:
        low = multiply_lanes(lanes_at(s, u + i), _second_at(s, v + i))
    while i > ROW:
        i, j = i - ROW, j + ROW
        low = add_lanes(low, multiply_lanes(lanes_at(s, u + i), _second_at(s, v + j)))
        high = add_lanes(high, multiply_lanes(lanes_at(s, u + j), _second_at(s, v + i)))
    return numbers(add_lanes(low, high))[:3]


@kernel
def _outer_products(s: Buffer, u: int, v: int, k: int) -> Vec3:
    """Return the sum of u_j x v_(k-j), as (z, x, y), without its two ends."""
    low = high = low_back = high_back = lanes(0.0, 0.0, 0.0, 0.0)
    i, j = ROW * ((k + 1) >> 1), ROW * (k >> 1)
    if i == j and k > 0:
        low = multiply_lanes(lanes_at(s, u + i), _second_at(s, v + i))
        low_back = multiply_lanes(_second_at(s, u + i), lanes_at(s, v + i))
    while i > ROW:
        i, j = i - ROW, j + ROW
        low = add_lanes(low, multiply_lanes(lanes_at(s, u + i), _second_at(s, v + j)))
        high = add_lanes(high, multiply_lanes(lanes_at(s, u + j), _second_at(s, v + i)))
        low_back = add_lanes(low_back, multiply_lanes(_second_at(s, u + i), lanes_at(s, v + j)))
        high_back = add_lanes(high_back, multiply_lanes(_second_at(s, u + j), lanes_at(s, v + i)))
    return subtract(numbers(add_lanes(low, high))[:3], numbers(add_lanes(low_back, high_back))[:3])


@kernel
def _products(s: Buffer, k: int, rate: Vec3, first: Vec3) -> Vec3:
    """Return the k-th coefficients of w_2 w_3, w_3 w_1, w_1 w_2; rate, first: coefficients k and 0 of omega."""
    v, x, y = _inner_products(s, RATE, RATE, k)
    a, b, c = first
    if k == 0:
        return (b * c, c * a, a * b)
    d, e, f = rate
    return (x + (b * f + e * c), y + (c * d + f * a), v + (a * e + d * b))


@kernel
def _squares(s: Buffer, k: int) -> Vec3:
    """Return the k-th coefficients of w_1^2, w_2^2, w_3^2."""
    x, y, v = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c = vec3_at(s, term(RATE, j))
        d, e, f = vec3_at(s, term(RATE, (k - j) & ROWS))
        x += a * d
        y += b * e
        v += c * f
    return (x, y, v)


@kernel
def _gyroscopic_term(s: Buffer, k: int, M: Matrix, products: Vec3) -> Vec3:
    """Return the k-th coefficient of -omega x M omega."""
    (a, d, e), (_, b, f), (_, _, c) = M
    x, y, v = products
    xx, yy, vv = _squares(s, k)
    off = (f * (vv - yy) + (d * y - e * v), e * (xx - vv) + (f * v - d * x), d * (yy - xx) + (e * x - f * y))
    return add(((b - c) * x, (c - a) * y, (a - b) * v), off)


@kernel
def _cross_term(s: Buffer, u: int, k: int, newest: Vec3, rate: Vec3) -> Vec3:
    """Return the k-th coefficient of u x omega; newest, rate: the k-th coefficients of u and omega."""
    v, x, y = _outer_products(s, u, RATE, k)
    last = cross(vec3_at(s, u), rate)
    return last if k == 0 else add((x, y, v), add(last, cross(newest, vec3_at(s, RATE))))


@kernel
def _turn_term(s: Buffer, k: int, turn: Quaternion, rate: Vec3, start: Vec3) -> Quaternion:
    """Return the k-th coefficient of D o (0, omega); turn, rate: both k-th coefficients; start: omega's 0-th."""
    e, x, y, v = 0.0, 0.0, 0.0, 0.0
    for j in range(1, k):
        a, b, c, d = quaternion_at(s, term(TURN, j))
        f, g, h = vec3_at(s, term(RATE, (k - j) & ROWS))
        e -= b * f + c * g + d * h
        x += a * f + (c * h - d * g)
        y += a * g + (d * f - b * h)
        v += a * h + (b * g - c * f)
    if k > 0:
        x, y, v = x + rate[0], y + rate[1], v + rate[2]
    a, b, c, d = turn
    f, g, h = start
    return (
        e - (b * f + c * g + d * h),
        x + (a * f + (c * h - d * g)),
        y + (a * g + (d * f - b * h)),
        v + (a * h + (b * g - c * f)),
    )


@kernel
def _acceleration_term(s: Buffer, k: int) -> Vec3:
    """Return the k-th coefficient of (D o F_b) o D*."""
    x, y, v = 0.0, 0.0, 0.0
    for j in range(k + 1):
        a, b, c, d = quaternion_at(s, product(TURN, j))
        e, f, g, h = quaternion_at(s, term(TURN, (k - j) & ROWS))
        x += (b * e - a * f) + (d * g - c * h)
        y += (c * e - a * g) + (b * h - d * f)
        v += (d * e - a * h) + (c * f - b * g)
    return (x, y, v)


# Series


@kernel
def end_series(s: Buffer, u: int, order: int) -> None:
    """Set the terms beyond `order` to zero, up to the next multiple of `AT_ONCE`, for evaluation."""
    for k in range(order + 1, (order + AT_ONCE - 1) // AT_ONCE * AT_ONCE + 1):
        put_lanes(s, term(u, k), lanes(0.0, 0.0, 0.0, 0.0))


@kernel
def turned_loads(s: Buffer, q: Quaternion, loads: LoadPolynomial, fixed: SpaceFixedLoads) -> None:
    """Set row 0 of the loads that are fixed in a, and of their derivatives, as b sees them; a force without an arm: 0.

    A load that is not 0 here has a series: `truncation` reads its last terms.
    """
    q_ba = invert_quaternion(q)
    put_factors(s, FORCE, rotate(q_ba, loads.value.force_a) if fixed.lever_force else ZERO)
    put_factors(s, TORQUE, rotate(q_ba, loads.value.torque_a))
    put_factors(s, FORCE_RATE, rotate(q_ba, loads.rate.force_a))
    put_factors(s, TORQUE_RATE, rotate(q_ba, loads.rate.torque_a))
    put_factors(s, FORCE_RATE_2, rotate(q_ba, loads.rate_2.force_a))
    put_factors(s, TORQUE_RATE_2, rotate(q_ba, loads.rate_2.torque_a))


@kernel
def _next_load(s: Buffer, u: int, k: int, newest: Vec3, rate: Vec3, changes: bool) -> Vec3:
    """Set and return coefficient k + 1 of the load u, by du/dt = u x omega, plus its derivative in a if it changes."""
    change = _cross_term(s, u, k, newest, rate)
    if changes:
        change = add(change, vec3_at(s, term(u + TO_DERIVATIVE, k)))
    change = scale(PER[k], change)
    put_factors(s, term(u, k + 1), change)
    return change


@kernel(inline=False)
def _next_loads(s: Buffer, k: int, rate: Vec3) -> None:
    """Set the coefficients k + 1 of the loads' derivatives."""
    for u in range(FORCE_RATE, ACCELERATION, _SERIES):
        _next_load(s, u, k, vec3_at(s, term(u, k)), rate, u < FORCE_RATE_2)


@kernel
def _torque_b(loads: Loads, body: Body) -> Vec3:
    return add(loads.torque_b, cross(body.arm_b, loads.force_b))


@kernel
def space_fixed_loads(body: Body, loads: LoadPolynomial) -> SpaceFixedLoads:
    """Return which loads fixed in a act, so that their series are needed, and whether any load changes."""
    acting = acting_loads(loads)
    return SpaceFixedLoads(acting.force_a and is_nonzero(body.arm_b), acting.torque_a, is_changing(loads))


@kernel
def known_torques(loads: LoadPolynomial, body: Body) -> Torques:
    """Return coefficients 0, 1, 2, in time, of the torque that loads fixed in b cause."""
    return _torque_b(loads.value, body), _torque_b(loads.rate, body), scale(0.5, _torque_b(loads.rate_2, body))


@kernel(inline=False)
def motion_series(
    s: Buffer, first: int, last: int, m: int, body: Body, torques: Torques, fixed: SpaceFixedLoads
) -> None:
    """Set the coefficients after `first`, up to `last`, of omega and of the loads that turn in b; up to m, of D too.

    Those up to `first` are known; torques: of `known_torques`.
    """
    (a, d, e), (_, b, f), (_, _, c) = body.inertia
    (p, _, _), (_, q, _), (_, _, r) = body.inertia_inverse
    diagonal = all_of((d == 0.0) & (e == 0.0) & (f == 0.0))
    x, y, v = p * (b - c), q * (c - a), r * (a - b)
    start, rate, turn = vec3_at(s, RATE), vec3_at(s, term(RATE, first)), (1.0, 0.0, 0.0, 0.0)
    force, space_torque = vec3_at(s, term(FORCE, first)), vec3_at(s, term(TORQUE, first))
    put_quaternion_at(s, TURN, turn)
    for k in range(first, last):
        torque = damping_torque(body.damping_b, rate)
        if k < 3:
            torque = add(torque, torques[k])
        if fixed.lever_force:
            torque = add(torque, cross(body.arm_b, force))
        if fixed.torque:
            torque = add(torque, space_torque)
        products = _products(s, k, rate, start)
        if diagonal:
            alpha = (x * products[0] + p * torque[0], y * products[1] + q * torque[1], v * products[2] + r * torque[2])
        else:
            alpha = transform(body.inertia_inverse, add(_gyroscopic_term(s, k, body.inertia, products), torque))
        if fixed.lever_force:
            force = _next_load(s, FORCE, k, force, rate, fixed.changing)
        if fixed.torque:
            space_torque = _next_load(s, TORQUE, k, space_torque, rate, fixed.changing)
        if fixed.changing:
            _next_loads(s, k, rate)
        if k < m:
            turn = _turn_term(s, k, turn, rate, start)
            half = 0.5 * PER[k]
            turn = (half * turn[0], half * turn[1], half * turn[2], half * turn[3])
            put_quaternion_at(s, term(TURN, k + 1), turn)
        rate = scale(PER[k], alpha)
        put_factors(s, term(RATE, k + 1), rate)


@kernel
def _turned_force(s: Buffer, k: int, inverse_mass: float, force: Vec3) -> Quaternion:
    return compose_quaternions(quaternion_at(s, term(TURN, k)), (0.0, *scale(inverse_mass, force)))


@kernel(inline=False)
def acceleration_series(s: Buffer, m: int, inverse_mass: float, loads: LoadPolynomial) -> None:
    """Set the coefficients below m of D F_b D* / mass, in the axes that b has at the series' beginning."""
    for k in range(m):
        total = _turned_force(s, k, inverse_mass, loads.value.force_b)
        if k > 0:
            total = add_scaled_quaternion(total, 1.0, _turned_force(s, k - 1, inverse_mass, loads.rate.force_b))
        if k > 1:
            total = add_scaled_quaternion(total, 0.5, _turned_force(s, k - 2, inverse_mass, loads.rate_2.force_b))
        put_quaternion_at(s, product(TURN, k), total)
        put_vec3_at(s, term(ACCELERATION, k), _acceleration_term(s, k))


SPEED, PATH = ACCELERATION + _SECOND, TURN + _SECOND
"""Where `path_series` has its results: in halves of rows that are free by then."""


@kernel
def path_series(s: Buffer, m: int) -> None:
    """Set m terms of the velocity over t and of the displacement over t^2 that the acceleration causes."""
    for k in range(m):
        speed = scale(PER[k], vec3_at(s, term(ACCELERATION, k)))
        x, y, z = scale(PER[k + 1], speed)
        put_lanes(s, term(SPEED, k), lanes(speed[0], speed[1], speed[2], 0.0))
        put_lanes(s, term(PATH, k), lanes(x, y, z, 0.0))
    end_series(s, SPEED, m - 1)
    end_series(s, PATH, m - 1)
