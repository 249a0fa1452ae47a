"""Motion inside a substep: the polynomials that agree with rate and attitude and m derivatives of each at both ends.

Rows 0 to m of both series are known at the beginning of a substep h and, after it, at its end (see `taylor.turn`).
Where x is the part of the substep that has passed, the polynomial of degree 2 m + 1 is

    (1 - x)^(m+1) sum_j a_j (h x)^j S_(m-j)(x)  +  x^(m+1) sum_j b_j (-h (1 - x))^j S_(m-j)(1 - x),
    S_r(x) = sum_(i <= r) C(m + i, i) x^i,

with the coefficients a_j of the beginning and b_j of the end: Hermite's interpolation, written as a two-point Taylor
expansion (J. L. Lopez & N. M. Temme, Studies in Applied Mathematics 109 (2002) 297-311). Its error is at most
(h / 2)^(2m+2) / (2m + 2)! times the derivative of that order. The two-point formula of the substep itself, with m
derivatives as well, has one of h^(2m+1), so that outputs inside substeps are about as accurate as at their ends.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from ..compile.decorator import kernel
from ..compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from ..compile.wide import alike
from ..mechanics.equations_of_motion import RATE_ONLY, Rotation
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, scale_quaternion, square_of
from ..types import Array, Buffer, Quaternion, Vec3
from .substeps import Method, power_of
from .taylor_coefficients import FORCE_RATE, MAX_ORDER, RATE, ROW, TURN, product, term

_COUNTS = range(MAX_ORDER // 2)
_BINOMIAL = np.array([[math.comb(m + i, i) for i in range(len(_COUNTS) + 1)] for m in _COUNTS], dtype=float)
"""C(m + i, i): [m, i]."""


class Points(NamedTuple):
    """Times (n + 1,) from the start of a run on, s, and states (n, ROTATION) at all but the first."""

    time: Array
    states: Array


@kernel
def keep_beginning(s: Buffer, m: int) -> None:
    """Keep rows 0 to m of rate and attitude, before the substep's end replaces them.

    Loads are steady, so that rows of their derivatives are free.
    """
    for k in range(m + 1):
        put_lanes(s, term(FORCE_RATE, k), lanes_at(s, term(RATE, k)))
        put_lanes(s, product(FORCE_RATE, k), lanes_at(s, term(TURN, k)))


@kernel
def _from_one_end(s: Buffer, rates: int, turns: int, m: int, x: float, h: float) -> tuple[Any, Any]:
    """Return the sums over the rows of an end, of rate and attitude; x: the distance from it, in parts of h."""
    rate = turn = lanes(0.0, 0.0, 0.0, 0.0)
    total, power, step = alike(x, 1.0), alike(x, 1.0), h * x
    steps = lanes(step, step, step, step)
    for j in range(m, -1, -1):
        weights = lanes(total, total, total, total)
        rate = add_lanes(multiply_lanes(rate, steps), multiply_lanes(lanes_at(s, rates + ROW * j), weights))
        turn = add_lanes(multiply_lanes(turn, steps), multiply_lanes(lanes_at(s, turns + ROW * j), weights))
        power *= x
        total += _BINOMIAL[m, m - j + 1] * power
    return numbers(rate), numbers(turn)


@kernel
def _by_series(s: Buffer, order: int, t: float) -> Vec3:
    """Return the rate at t from the beginning of a substep, after which only row 0 of its series is that of the end."""
    steps, value = lanes(t, t, t, t), lanes_at(s, term(RATE, order))
    for k in range(order - 1, 0, -1):
        value = add_lanes(multiply_lanes(value, steps), lanes_at(s, term(RATE, k)))
    return numbers(add_lanes(multiply_lanes(value, steps), lanes_at(s, FORCE_RATE)))[:3]


@kernel(inline=False)
def motion_inside(s: Buffer, method: Method, m: int, h: float, x: float, q_0: Quaternion, q_1: Quaternion) -> Rotation:
    """Return attitude and rate where a part x of the substep h has passed; q_0, q_1: the attitudes at its ends.

    Without the attitude no rows at the end are made, and the rate's own series is used.
    """
    if method.n == RATE_ONLY:
        return Rotation(q_1, _by_series(s, method.order, h * x))
    y = 1.0 - x
    near, far = power_of(y, m + 1), power_of(x, m + 1)
    rate_0, turn_0 = _from_one_end(s, FORCE_RATE, product(FORCE_RATE, 0), m, x, h)
    rate_1, turn_1 = _from_one_end(s, RATE, TURN, m, y, -h)
    omega = add_scaled_quaternion(scale_quaternion(near, rate_0), far, rate_1)[:3]
    q = add_scaled_quaternion(
        compose_quaternions(q_0, scale_quaternion(near, turn_0)), 1.0,
        compose_quaternions(q_1, scale_quaternion(far, turn_1)),
    )  # fmt: skip
    return Rotation(scale_quaternion(1.0 / math.sqrt(square_of(q)), q), omega)


@kernel
def begin_points(states: Array) -> None:
    """Mark all points as not reached."""
    for k in range(len(states)):
        states[k, 0] = math.nan


@kernel
def put_rotation(states: Array, k: int, motion: Rotation) -> None:
    """Set a row of states."""
    states[k, 0], states[k, 1], states[k, 2], states[k, 3] = motion.q_ab
    states[k, 4], states[k, 5], states[k, 6] = motion.omega_b
    states[k, 7] = 0.0


@kernel
def place_of(time: Array, k: int, begin: float, h: float, is_last: bool) -> float:
    """Return the part of a substep h that has passed at time k; -1 after the substep, and at the end of the run.

    begin: of the substep, s from the start of the run; is_last: whether the run ends with the substep.
    """
    if k == len(time) - 1:
        return -1.0
    x = ((time[k] - time[0]) - begin) / h
    return min(max(x, 0.0), 1.0) if is_last or x <= 1.0 else -1.0  # type: ignore[no-any-return]
