"""The motion of a body by Taylor series in double-double arithmetic: what plans are judged by.

Far more accurate than what it judges and independent of the communication step: steps of its own, the series evaluated
wherever an output is asked for.  States are vectors in b: the body rate and R_ab's three rows, of which each is an axis
of a as b sees it, du/dt = u x omega; what is fixed in a is a sum of them.  The step is chosen by the last two terms:
A. Jorba & M. Zou, Experimental Mathematics 14 (2005).

Numbers are pairs of arrays' first index: [0, ...] high, [1, ...] low parts.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np

from .. import quantities
from ..buffer import places
from ..compile.decorator import kernel
from ..numerics import double_double as dd
from ..numerics.double_double import add_cross, add_product, add_transform, clear
from ..quantities import RELATIVE

ORDER, TOLERANCE = 26, 1e-22
"""Least work measured for errors far below double precision's."""
ENOUGH, STEADY = 0.15, 2.1
"""What a fifth of the steps must do of the times, and how much more than a tenth of them where they grow longer."""
REST = 1e-250
"""The rate, rad/s, below which a body rests: the last terms of smaller ones would leave the range of doubles."""
_LENGTH = ORDER + 1

STATE = {"R_ab": 9, "momentum_b": 3, "omega_b": 3, "v_c": 3, "r_c": 3}
_R_AB, _MOMENTUM, _OMEGA, _VELOCITY, _POSITION = places(STATE).starts(*STATE)
_STATE_SIZE = sum(STATE.values())
_CROSSED = _OMEGA
"""Numbers of the state that are crossed with the rate: the rows of R_ab and the momentum."""

CONSTANTS = {
    "M": 9, "M_inverse": 9, "damping_b": 3, "torque_b": 3, "torque_a": 3, "force_a": 3, "arm_b": 3,
    "a_turning_b": 3, "a_steady_a": 3, "r_oc_b": 3, "mass": 1,
}  # fmt: skip
"""A body's constants: torque_b holds all that is known in b; a_turning_b is the acceleration by a force that turns with
the body, a_steady_a that by what does not; mass is 0 with a pivot."""
(
    _M, _M_INVERSE, _DAMPING, _TORQUE_B, _TORQUE_A, _FORCE_A, _ARM, _A_TURNING, _A_STEADY, _R_OC, _MASS,
) = places(CONSTANTS).starts(*CONSTANTS)  # fmt: skip

OUTPUTS, ROW = _LAYOUT_OF_OUTPUTS = places(
    {row.name: row.size for row in quantities.OUTPUTS if row.error == RELATIVE and not row.judged_by} | {"R_ab": 9}
)
"""Where a row of outputs has what, and its size; the attitude is R_ab."""
(
    _OUT_POSITION, _OUT_VELOCITY, _OUT_ACCELERATION, _OUT_OMEGA_B, _OUT_OMEGA_A, _OUT_ALPHA, _OUT_MOMENTUM,
    _OUT_ENERGY, _OUT_R_AB,
) = _LAYOUT_OF_OUTPUTS.starts(
    "position", "velocity", "acceleration", "omega_b", "omega_a", "alpha_b", "angular_momentum_a", "kinetic_energy",
    "R_ab",
)  # fmt: skip

_SCRATCH = {
    "torque_b": 3, "lever_force_b": 3, "alpha_b": 3, "v_oc_b": 3, "a_oc_b": 3, "r_oc_a": 3, "v_oc_a": 3, "a_oc_a": 3,
    "a_turning_a": 3, "omega_a": 3, "momentum_a": 3, "omega_dot_momentum": 1, "v_squared": 1,
}  # fmt: skip
(
    _S_TORQUE, _S_LEVER_FORCE, _S_ALPHA, _S_V_OC_B, _S_A_OC_B, _S_R_OC, _S_V_OC, _S_A_OC, _S_A_TURNING, _S_OMEGA_A,
    _S_MOMENTUM, _S_OMEGA_DOT_MOMENTUM, _S_V_SQUARED,
) = places(_SCRATCH).starts(*_SCRATCH)  # fmt: skip
SCRATCH = sum(_SCRATCH.values())

_SERIES = dict.fromkeys(("first", "second", "rate_1", "rate_2"), _LENGTH * _CROSSED)
_SERIES |= {"all": _LENGTH * _STATE_SIZE, "products": _CROSSED}
_FIRST, _SECOND, _RATE_1, _RATE_2, _ALL, _PRODUCTS = places(_SERIES).starts(*_SERIES)
SERIES = sum(_SERIES.values())
"""The series' work space: crossed vectors as (y, z, x) and (z, x, y), rates as (z, x, y) and (y, z, x), all
coefficients, the newest cross products."""
_REST = [float(Fraction(1, k + 1) - Fraction(1.0 / (k + 1))) for k in range(_LENGTH)]
_PER = np.array([[1.0 / (k + 1) for k in range(_LENGTH)], _REST])


@kernel
def _coefficients(k: int) -> int:
    """Return where the k-th coefficients of the whole state stand."""
    return _ALL + k * _STATE_SIZE


@kernel(inline=False)
def _put_torque(c: Any, x: Any, j: int, s: Any, known: bool) -> None:
    """Put into the scratch s the torque by all loads, without the gyroscopic one, of the coefficients x[j:]."""
    clear(s, _S_TORQUE, 3)
    clear(s, _S_LEVER_FORCE, 3)
    for n in range(3):
        if known:
            dd.put(s, _S_TORQUE + n, dd.at(c, _TORQUE_B + n))
        damping = dd.multiply(dd.at(c, _DAMPING + n), dd.at(x, j + _OMEGA + n))
        dd.put(s, _S_TORQUE + n, dd.subtract(dd.at(s, _S_TORQUE + n), damping))
        for row in range(3):
            add_product(s, _S_TORQUE + n, c, _TORQUE_A + row, x, j + _R_AB + 3 * row + n)
            add_product(s, _S_LEVER_FORCE + n, c, _FORCE_A + row, x, j + _R_AB + 3 * row + n)
    add_cross(s, _S_TORQUE, c, _ARM, s, _S_LEVER_FORCE)


@kernel(inline=False)
def _keep_factors(s: Any, k: int) -> None:
    """Put the k-th coefficients once more, in the order in which they are multiplied."""
    x = _coefficients(k)
    for i in range(_CROSSED):
        at, y, z = k * _CROSSED + i, (i + 1) % 3, (i + 2) % 3
        for part in range(2):
            s[part, _FIRST + at] = s[part, x + i - i % 3 + y]
            s[part, _SECOND + at] = s[part, x + i - i % 3 + z]
            s[part, _RATE_1 + at] = s[part, x + _OMEGA + z]
            s[part, _RATE_2 + at] = s[part, x + _OMEGA + y]


@kernel(inline=False)
def _cross_terms(s: Any, k: int) -> None:
    """Compute the k-th coefficients of all cross products with the rate; the compiler makes vectors of the lanes."""
    clear(s, _PRODUCTS, _CROSSED)
    for j in range(k + 1):
        a, b = j * _CROSSED, (k - j) * _CROSSED
        for i in range(_CROSSED):
            one = dd.multiply(dd.at(s, _FIRST + a + i), dd.at(s, _RATE_1 + b + i))
            other = dd.multiply(dd.at(s, _SECOND + a + i), dd.at(s, _RATE_2 + b + i))
            dd.put(s, _PRODUCTS + i, dd.add(dd.at(s, _PRODUCTS + i), dd.subtract(one, other)))


@kernel(inline=False)
def _expand(c: Any, s: Any, scratch: Any, unit: float) -> None:
    """Compute all coefficients from the first, in units of time of `unit` s (a power of two)."""
    _keep_factors(s, 0)
    for k in range(ORDER):
        x, y = _coefficients(k), _coefficients(k + 1)
        _cross_terms(s, k)
        _put_torque(c, s, x, scratch, k == 0)
        for n in range(3):
            dd.put(scratch, _S_TORQUE + n, dd.add(dd.at(scratch, _S_TORQUE + n), dd.at(s, _PRODUCTS + _MOMENTUM + n)))
        clear(s, y, _STATE_SIZE)
        add_transform(s, y + _OMEGA, c, _M_INVERSE, scratch, _S_TORQUE)
        for i in range(_MOMENTUM):
            dd.put(s, y + i, dd.at(s, _PRODUCTS + i))
        for n in range(3):
            dd.put(s, y + _VELOCITY + n, dd.at(c, _A_STEADY + n) if k == 0 else (0.0, 0.0))
            dd.put(s, y + _POSITION + n, dd.at(s, x + _VELOCITY + n))
            for i in range(3):
                add_product(s, y + _VELOCITY + n, c, _A_TURNING + i, s, x + _R_AB + 3 * n + i)
        per = dd.scale(unit, (_PER[0, k], _PER[1, k]))
        for i in range(_STATE_SIZE):
            dd.put(s, y + i, dd.multiply(per, dd.at(s, y + i)))
        add_transform(s, y + _MOMENTUM, c, _M, s, y + _OMEGA)
        _keep_factors(s, k + 1)


@kernel
def _largest(s: Any, first: int, count: int) -> float:
    """Return the largest size of some numbers, NaN where one is: `max` alone passes NaN over."""
    most = 0.0
    for i in range(first, first + count):
        if math.isnan(s[0, i]):
            return math.nan
        most = max(most, abs(s[0, i]))
    return most


@kernel(inline=False)
def _longest(s: Any) -> float:
    """Return the step, in units of time, whose last two terms are within the tolerance, or infinity without any.

    It is NaN where a term is not finite.
    """
    rate, change = _largest(s, _coefficients(0) + _OMEGA, 3), _largest(s, _coefficients(1) + _OMEGA, 3)
    longest = math.inf
    for k in (ORDER - 1, ORDER):
        x, speed = _coefficients(k), _largest(s, _coefficients(0) + _VELOCITY, 3)
        if not _largest(s, x, _STATE_SIZE) < math.inf:
            return math.nan
        last = max(_largest(s, x + _R_AB, 9), _largest(s, x + _VELOCITY, 3) / max(speed, 1.0))
        turning = _largest(s, x + _OMEGA, 3)
        if turning > 0.0:
            last = max(last, turning / max(rate, change, REST))
        if last > 0.0:
            longest = min(longest, (TOLERANCE / last) ** (1.0 / k))
    return longest


@kernel(inline=False)
def _evaluate(s: Any, t: float, low: float, state: Any) -> None:
    """Put the state at a time t + low (in units of time) after the series' beginning."""
    x = _coefficients(ORDER)
    for i in range(_STATE_SIZE):
        dd.put(state, i, dd.at(s, x + i))
    for k in range(ORDER - 1, -1, -1):
        x = _coefficients(k)
        for i in range(_STATE_SIZE):
            dd.put(state, i, dd.add(dd.multiply((t, low), dd.at(state, i)), dd.at(s, x + i)))


@kernel
def _unit_of_time(c: Any, state: Any, scratch: Any, span: float) -> float:
    """Return a power of two, s, in which the motion is of order 1, so that no coefficient overflows.

    It is at most twice the span, s, that is to be covered: towards rest the motion takes ever longer, but damping and
    what loads pull back with are as fast as before.
    """
    _put_alpha(c, state, scratch)
    rate_scale = max(_largest(state, _OMEGA, 3), math.sqrt(_largest(scratch, _S_ALPHA, 3)), 1.0 / span)
    return math.ldexp(1.0, -math.floor(math.log2(rate_scale)))


@kernel(inline=False)
def _put_alpha(c: Any, state: Any, scratch: Any) -> None:
    """Put the angular acceleration of a state into the scratch, and the torque with the gyroscopic one."""
    _put_torque(c, state, 0, scratch, True)
    add_cross(scratch, _S_TORQUE, state, _MOMENTUM, state, _OMEGA)
    clear(scratch, _S_ALPHA, 3)
    add_transform(scratch, _S_ALPHA, c, _M_INVERSE, scratch, _S_TORQUE)


@kernel(inline=False)
def reference_motion(c: Any, state: Any, times: Any, rows: Any, most: int, s: Any, scratch: Any) -> int:
    """Set rows of outputs at increasing times (s, pairs) after the state; return the steps taken, -1 beyond `most`.

    It is -1 as well after a fifth of them, where these did too little, and the later ones no more than those before.
    The state moves to the last time.  Rows stay as they are from where the motion cannot be followed.
    s, scratch: work space of (2, SERIES) and (2, SCRATCH) numbers.
    """
    now, steps, k, tenth = (times[0, 0], times[1, 0]), 0, 0, 0.0
    span = times[0, -1] - times[0, 0]
    while k < times.shape[1]:
        unit = _unit_of_time(c, state, scratch, span)
        for i in range(_STATE_SIZE):
            dd.put(s, _coefficients(0) + i, dd.at(state, i))
        _expand(c, s, scratch, unit)
        longest = _longest(s)
        steps += 1
        done = now[0] - times[0, 0]
        if steps == most // 10:
            tenth = done
        if steps == most // 5 and done < min(ENOUGH * span, STEADY * tenth):
            return -1
        if steps > most or not longest > 0.0:
            return -1
        while k < times.shape[1]:
            t = dd.scale(1.0 / unit, dd.subtract(dd.at(times, k), now))
            if t[0] > longest:
                break
            _evaluate(s, t[0], t[1], state)
            _put_outputs(c, state, scratch, rows, k)
            k += 1
        if k < times.shape[1]:
            _evaluate(s, longest, 0.0, state)
            now = dd.add(now, dd.scale(unit, (longest, 0.0)))
    return steps


@kernel(inline=False)
def _put_outputs(c: Any, x: Any, s: Any, rows: Any, k: int) -> None:
    """Set row k of the outputs, from the state in double-double and rounded at the end."""
    clear(s, 0, SCRATCH)
    _put_alpha(c, x, s)
    add_cross(s, _S_V_OC_B, x, _OMEGA, c, _R_OC)
    add_cross(s, _S_A_OC_B, x, _OMEGA, s, _S_V_OC_B)
    add_cross(s, _S_A_OC_B, s, _S_ALPHA, c, _R_OC)
    add_transform(s, _S_R_OC, x, _R_AB, c, _R_OC)
    add_transform(s, _S_V_OC, x, _R_AB, s, _S_V_OC_B)
    add_transform(s, _S_A_OC, x, _R_AB, s, _S_A_OC_B)
    add_transform(s, _S_A_TURNING, x, _R_AB, c, _A_TURNING)
    add_transform(s, _S_OMEGA_A, x, _R_AB, x, _OMEGA)
    add_transform(s, _S_MOMENTUM, x, _R_AB, x, _MOMENTUM)
    free = c[0, _MASS] > 0.0
    for n in range(3):
        here, speed = dd.at(x, _POSITION + n), dd.at(x, _VELOCITY + n)
        if free:
            here, speed = dd.subtract(here, dd.at(s, _S_R_OC + n)), dd.subtract(speed, dd.at(s, _S_V_OC + n))
        a_o = dd.subtract(dd.add(dd.at(c, _A_STEADY + n), dd.at(s, _S_A_TURNING + n)), dd.at(s, _S_A_OC + n))
        rows[k, _OUT_POSITION + n], rows[k, _OUT_VELOCITY + n] = here[0], speed[0]
        rows[k, _OUT_ACCELERATION + n] = a_o[0] if free else 0.0
        rows[k, _OUT_OMEGA_B + n], rows[k, _OUT_OMEGA_A + n] = x[0, _OMEGA + n], s[0, _S_OMEGA_A + n]
        rows[k, _OUT_ALPHA + n], rows[k, _OUT_MOMENTUM + n] = s[0, _S_ALPHA + n], s[0, _S_MOMENTUM + n]
        add_product(s, _S_OMEGA_DOT_MOMENTUM, x, _OMEGA + n, x, _MOMENTUM + n)
        add_product(s, _S_V_SQUARED, x, _VELOCITY + n, x, _VELOCITY + n)
    energy = dd.add(dd.at(s, _S_OMEGA_DOT_MOMENTUM), dd.multiply(dd.at(c, _MASS), dd.at(s, _S_V_SQUARED)))
    rows[k, _OUT_ENERGY] = dd.multiply_float(energy, 0.5)[0]
    for i in range(9):
        rows[k, _OUT_R_AB + i] = x[0, _R_AB + i]
