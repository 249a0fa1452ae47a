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

from ..compile.decorator import kernel
from ..numerics.double_double import DoubleDouble, dd_add, dd_multiply, dd_multiply_float, dd_scale, dd_subtract

ORDER, TOLERANCE = 26, 1e-22
"""Least work measured for errors far below double precision's."""
CROSSED, RATES, MOVED, STATE = 12, 12, 15, 21
"""Numbers of the state: rows of R_ab and the angular momentum in b, which are crossed with the rate; from where the
rate, and velocity and position of the centre of mass, stand; all."""
SERIES = 4 * (ORDER + 1) * CROSSED + (ORDER + 1) * STATE + CROSSED
"""Size of the series' work space."""
M, M_INVERSE, DAMPING, TORQUE_B, TORQUE_A, FORCE_A, ARM, PUSH_B, STEADY, R_OC, MASS = (
    0,
    9,
    18,
    21,
    24,
    27,
    30,
    33,
    36,
    39,
    42,
)
CONSTANTS = 43
"""Where a body's constants stand: M and its inverse; damping; torque known in b, torque and force known in a; the
force's arm; acceleration by a force that turns with the body, and by what does not; r_oc_b; mass (0 with a pivot)."""
OUTPUTS = {"position": 0, "velocity": 3, "acceleration": 6, "omega_b": 9, "omega_a": 12, "alpha_b": 15,
           "angular_momentum_a": 18, "kinetic_energy": 21, "rows": 22}  # fmt: skip
ROW, SCRATCH = 31, 35
"""Where a row of outputs has what; rows: R_ab."""
_LENGTH = ORDER + 1
_FIRST, _SECOND, _RATE_1, _RATE_2, _ALL = (i * _LENGTH * CROSSED for i in range(5))
_TERM = _ALL + _LENGTH * STATE
"""Places in the work space: crossed vectors as (y, z, x) and (z, x, y), rates as (z, x, y) and (y, z, x), all
coefficients, the newest cross products."""
_REST = [float(Fraction(1, k + 1) - Fraction(1.0 / (k + 1))) for k in range(_LENGTH)]
_PER = np.array([[1.0 / (k + 1) for k in range(_LENGTH)], _REST])


@kernel
def _at(s: Any, i: int) -> DoubleDouble:
    return (s[0, i], s[1, i])


@kernel
def _put(s: Any, i: int, a: DoubleDouble) -> None:
    s[0, i], s[1, i] = a


@kernel(inline=False)
def _add_product(s: Any, out: int, c: Any, i: int, x: Any, j: int) -> None:
    """s[out] += c[i] x[j]."""
    _put(s, out, dd_add(_at(s, out), dd_multiply(_at(c, i), _at(x, j))))


@kernel(inline=False)
def _cross(s: Any, out: int, a: Any, i: int, b: Any, j: int) -> None:
    """s[out:] += a[i:] x b[j:]."""
    for n in range(3):
        y, z = (n + 1) % 3, (n + 2) % 3
        _add_product(s, out + n, a, i + y, b, j + z)
        left = dd_multiply(_at(a, i + z), _at(b, j + y))
        _put(s, out + n, dd_subtract(_at(s, out + n), left))


@kernel(inline=False)
def _transform(s: Any, out: int, c: Any, i: int, x: Any, j: int) -> None:
    """s[out:] += (matrix at c[i:]) x[j:]."""
    for n in range(3):
        for k in range(3):
            _add_product(s, out + n, c, i + 3 * n + k, x, j + k)


@kernel(inline=False)
def _clear(s: Any, first: int, count: int) -> None:
    for i in range(first, first + count):
        s[0, i] = s[1, i] = 0.0


@kernel(inline=False)
def _torque(c: Any, x: Any, j: int, s: Any, out: int, known: bool) -> None:
    """s[out:] = torque by all loads, without the gyroscopic one, of the coefficients x[j:]; uses s[out + 3:]."""
    _clear(s, out, 6)
    for n in range(3):
        if known:
            _put(s, out + n, _at(c, TORQUE_B + n))
        damping = dd_multiply(_at(c, DAMPING + n), _at(x, j + RATES + n))
        _put(s, out + n, dd_subtract(_at(s, out + n), damping))
        for row in range(3):
            _add_product(s, out + n, c, TORQUE_A + row, x, j + 3 * row + n)
            _add_product(s, out + 3 + n, c, FORCE_A + row, x, j + 3 * row + n)
    _cross(s, out, c, ARM, s, out + 3)


@kernel(inline=False)
def _keep_factors(s: Any, k: int) -> None:
    """The k-th coefficients once more, in the order in which they are multiplied."""
    x = _ALL + k * STATE
    for i in range(CROSSED):
        at, y, z = k * CROSSED + i, (i + 1) % 3, (i + 2) % 3
        for part in range(2):
            s[part, _FIRST + at] = s[part, x + i - i % 3 + y]
            s[part, _SECOND + at] = s[part, x + i - i % 3 + z]
            s[part, _RATE_1 + at] = s[part, x + RATES + z]
            s[part, _RATE_2 + at] = s[part, x + RATES + y]


@kernel(inline=False)
def _cross_terms(s: Any, k: int) -> None:
    """The k-th coefficients of all vectors' cross products with the rate: lanes that the compiler makes vectors of."""
    _clear(s, _TERM, CROSSED)
    for j in range(k + 1):
        a, b = j * CROSSED, (k - j) * CROSSED
        for i in range(CROSSED):
            one = dd_multiply(_at(s, _FIRST + a + i), _at(s, _RATE_1 + b + i))
            other = dd_multiply(_at(s, _SECOND + a + i), _at(s, _RATE_2 + b + i))
            _put(s, _TERM + i, dd_add(_at(s, _TERM + i), dd_subtract(one, other)))


@kernel(inline=False)
def _expand(c: Any, s: Any, scratch: Any, unit: float) -> None:
    """All coefficients from the first, in units of time of `unit` s (a power of two)."""
    _keep_factors(s, 0)
    for k in range(ORDER):
        x, y = _ALL + k * STATE, _ALL + (k + 1) * STATE
        _cross_terms(s, k)
        _torque(c, s, x, scratch, 0, k == 0)
        for n in range(3):
            _put(scratch, n, dd_add(_at(scratch, n), _at(s, _TERM + 9 + n)))
        _clear(s, y, STATE)
        _transform(s, y + RATES, c, M_INVERSE, scratch, 0)
        for i in range(9):
            _put(s, y + i, _at(s, _TERM + i))
        for n in range(3):
            _put(s, y + MOVED + n, _at(c, STEADY + n) if k == 0 else (0.0, 0.0))
            _put(s, y + MOVED + 3 + n, _at(s, x + MOVED + n))
            for i in range(3):
                _add_product(s, y + MOVED + n, c, PUSH_B + i, s, x + 3 * n + i)
        per = dd_scale(unit, (_PER[0, k], _PER[1, k]))
        for i in range(STATE):
            _put(s, y + i, dd_multiply(per, _at(s, y + i)))
        _transform(s, y + 9, c, M, s, y + RATES)
        _keep_factors(s, k + 1)


@kernel
def _largest(s: Any, first: int, count: int) -> float:
    most = 0.0
    for i in range(first, first + count):
        most = max(most, abs(s[0, i]))
    return most


@kernel(inline=False)
def _longest(s: Any) -> float:
    """The step, in units of time, whose last two terms are within the tolerance; infinite where there are none."""
    rate, change = _largest(s, _ALL + RATES, 3), _largest(s, _ALL + STATE + RATES, 3)
    longest = math.inf
    for k in (ORDER - 1, ORDER):
        x = _ALL + k * STATE
        last = max(_largest(s, x, 9), _largest(s, x + MOVED, 3) / max(_largest(s, _ALL + MOVED, 3), 1.0))
        turning = _largest(s, x + RATES, 3)
        if turning > 0.0:
            last = max(last, turning / max(rate, change))
        if last > 0.0:
            longest = min(longest, (TOLERANCE / last) ** (1.0 / k))
    return longest


@kernel(inline=False)
def _evaluate(s: Any, t: float, low: float, state: Any) -> None:
    """The state at a time t + low (in units of time) after the series' begin."""
    x = _ALL + ORDER * STATE
    for i in range(STATE):
        _put(state, i, _at(s, x + i))
    for k in range(ORDER - 1, -1, -1):
        x = _ALL + k * STATE
        for i in range(STATE):
            _put(state, i, dd_add(dd_multiply((t, low), _at(state, i)), _at(s, x + i)))


@kernel
def _unit_of_time(c: Any, state: Any, scratch: Any) -> float:
    """A power of two, s, in which the motion is of order 1, so that no coefficient overflows; 1 at rest."""
    _torque(c, state, 0, scratch, 0, True)
    _cross(scratch, 0, state, 9, state, RATES)
    _clear(scratch, 6, 3)
    _transform(scratch, 6, c, M_INVERSE, scratch, 0)
    pace = max(_largest(state, RATES, 3), math.sqrt(_largest(scratch, 6, 3)))
    return 2.0 ** -math.floor(math.log2(pace)) if pace > 1e-290 else 1.0


@kernel(inline=False)
def reference_motion(c: Any, state: Any, times: Any, rows: Any, most: int, s: Any, scratch: Any) -> int:
    """Rows of outputs at times from the state's own on (s, pairs, increasing); the steps taken, -1 beyond `most`.

    The state moves to the last time.  Rows stay as they are from where the motion cannot be followed.
    s, scratch: work space of (2, SERIES) and (2, SCRATCH) numbers.
    """
    now, steps, k = (times[0, 0], times[1, 0]), 0, 0
    while k < times.shape[1]:
        unit = _unit_of_time(c, state, scratch)
        for i in range(STATE):
            _put(s, _ALL + i, _at(state, i))
        _expand(c, s, scratch, unit)
        longest = _longest(s)
        steps += 1
        if steps > most or not longest > 0.0:
            return -1
        while k < times.shape[1]:
            t = dd_scale(1.0 / unit, dd_subtract(_at(times, k), now))
            if t[0] > longest:
                break
            _evaluate(s, t[0], t[1], state)
            _put_outputs(c, state, scratch, rows, k)
            k += 1
        if k < times.shape[1]:
            _evaluate(s, longest, 0.0, state)
            now = dd_add(now, dd_scale(unit, (longest, 0.0)))
    return steps


@kernel(inline=False)
def _put_outputs(c: Any, x: Any, s: Any, rows: Any, k: int) -> None:
    """Row k of the outputs, from the state in double-double and rounded at the end."""
    _clear(s, 0, SCRATCH)
    _torque(c, x, 0, s, 0, True)
    _cross(s, 0, x, 9, x, RATES)
    _transform(s, 6, c, M_INVERSE, s, 0)  # alpha_b
    _cross(s, 9, x, RATES, c, R_OC)
    _cross(s, 12, x, RATES, s, 9)
    _cross(s, 12, s, 6, c, R_OC)
    _transform(s, 15, x, 0, c, R_OC)  # r_oc, velocity and acceleration of c relative to o, in a
    _transform(s, 18, x, 0, s, 9)
    _transform(s, 21, x, 0, s, 12)
    _transform(s, 24, x, 0, c, PUSH_B)
    _transform(s, 27, x, 0, x, RATES)
    _transform(s, 30, x, 0, x, 9)
    free = c[0, MASS] > 0.0
    for n in range(3):
        here, speed = _at(x, MOVED + 3 + n), _at(x, MOVED + n)
        if free:
            here, speed = dd_subtract(here, _at(s, 15 + n)), dd_subtract(speed, _at(s, 18 + n))
        push = dd_subtract(dd_add(_at(c, STEADY + n), _at(s, 24 + n)), _at(s, 21 + n))
        rows[k, n], rows[k, 3 + n], rows[k, 6 + n] = here[0], speed[0], push[0] if free else 0.0
        rows[k, 9 + n], rows[k, 12 + n] = x[0, RATES + n], s[0, 27 + n]
        rows[k, 15 + n], rows[k, 18 + n] = s[0, 6 + n], s[0, 30 + n]
        _add_product(s, 33, x, RATES + n, x, 9 + n)
        _put(s, 34, dd_add(_at(s, 34), dd_multiply(_at(x, MOVED + n), _at(x, MOVED + n))))
    energy = dd_add(_at(s, 33), dd_multiply(_at(c, MASS), _at(s, 34)))
    rows[k, 21] = dd_multiply_float(energy, 0.5)[0]
    for i in range(9):
        rows[k, 22 + i] = x[0, i]
