"""The operations of formulas in double-double arithmetic: each one's value, and its Taylor coefficients.

The recurrences are those of `rbfmu.formulas.program`. A number of the work space has its coefficients side by side,
high parts in s[0], low ones in s[1].
"""

import math

from ..compile.decorator import kernel
from ..numerics import double_double as dd, double_double_functions as functions
from ..types import Array

KINDS = (
    "number", "place", "input", "state", "add", "subtract", "multiply", "divide", "sqrt", "exp", "log", "sin", "cos",
    "atan2", "power", "logistic", "side", "select", "scale",
)  # fmt: skip
"""`scale` is a product whose second factor is constant, so that only the first coefficient of that is needed."""
(
    _NUMBER, _PLACE, _INPUT, STATE, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, SQRT, _EXP, _LOG, _SIN, _COS, _ATAN2, POWER,
    _LOGISTIC, SIDE, _SELECT, _SCALE,
) = range(len(KINDS))  # fmt: skip
ROOTS = (SQRT, POWER)


@kernel
def _sum(s: Array, a: int, b: int, k: int, first: int, last: int) -> dd.DoubleDouble:
    """Return the sum of a[j] b[k - j] for j from first to last."""
    total = (0.0, 0.0)
    for j in range(first, last + 1):
        total = dd.add(total, dd.multiply(dd.at(s, a + j), dd.at(s, b + k - j)))
    return total


@kernel
def _sum_of_slopes(s: Array, a: int, b: int, k: int, last: int) -> dd.DoubleDouble:
    """Return the sum of j a[j] b[k - j] for j from 1 to last."""
    total = (0.0, 0.0)
    for j in range(1, last + 1):
        total = dd.add(total, dd.multiply_float(dd.multiply(dd.at(s, a + j), dd.at(s, b + k - j)), float(j)))
    return total


@kernel(inline=False)
def value_of(kind: int, i: int, a: int, b: int, c: int, s: Array) -> dd.DoubleDouble:
    """Return an operation's value; i: where its own coefficients begin; a, b, c: where its arguments' begin."""
    x, y = dd.at(s, a), dd.at(s, b)
    if kind == _ADD:
        return dd.add(x, y)
    if kind == _SUBTRACT:
        return dd.subtract(x, y)
    if kind in (_MULTIPLY, _SCALE):
        return dd.multiply(x, y)
    if kind == _DIVIDE:
        return dd.divide(x, y) if y[0] != 0.0 else (math.nan, 0.0)
    if kind == SQRT:
        return dd.root(x) if x[0] >= 0.0 else (math.nan, 0.0)
    if kind == _EXP:
        return functions.exponential(x)
    if kind == _LOG:
        return functions.natural_logarithm(x)
    if kind == _SIN:
        return functions.sine_and_cosine(x)[0]
    if kind == _COS:
        return functions.sine_and_cosine(x)[1]
    if kind == _ATAN2:
        return functions.angle_of(x, y)
    if kind == POWER and x[0] == 0.0:
        return (0.0 if y[0] > 0.0 else math.inf, 0.0)
    if kind == POWER:
        return functions.exponential(dd.multiply(y, functions.natural_logarithm(x)))
    if kind == _LOGISTIC:
        return functions.logistic(x)
    if kind == SIDE:
        return (math.copysign(1.0, x[0] + 0.0), 0.0)
    if kind == _SELECT:
        return dd.at(s, b) if x[0] > 0.0 else dd.at(s, c)
    return dd.at(s, i)


@kernel(inline=False)
def coefficient_of(kind: int, i: int, a: int, b: int, c: int, s: Array, k: int) -> dd.DoubleDouble:
    """Return an operation's k-th coefficient, k > 0; i, a, b, c: as in `value_of`."""
    n = float(k)
    if kind == _ADD:
        return dd.add(dd.at(s, a + k), dd.at(s, b + k))
    if kind == _SUBTRACT:
        return dd.subtract(dd.at(s, a + k), dd.at(s, b + k))
    if kind == _MULTIPLY:
        return _sum(s, a, b, k, 0, k)
    if kind == _SCALE:
        return dd.multiply(dd.at(s, a + k), dd.at(s, b))
    if kind == _DIVIDE:
        return dd.divide(dd.subtract(dd.at(s, a + k), _sum(s, b, i, k, 1, k)), dd.at(s, b))
    if kind == SQRT:
        rest = dd.subtract(dd.at(s, a + k), _sum(s, i, i, k, 1, k - 1))
        return dd.divide(rest, dd.scale(2.0, dd.at(s, i))) if s[0, i] != 0.0 else (0.0, 0.0)
    if kind == _EXP:
        return dd.divide(_sum_of_slopes(s, a, i, k, k), (n, 0.0))
    if kind == _LOG:
        rest = dd.subtract(dd.multiply_float(dd.at(s, a + k), n), _sum_of_slopes(s, i, a, k, k - 1))
        return dd.divide(rest, dd.multiply_float(dd.at(s, a), n))
    if kind in (_SIN, _LOGISTIC):
        return dd.divide(_sum_of_slopes(s, a, b, k, k), (n, 0.0))
    if kind == _COS:
        return dd.divide(dd.negate(_sum_of_slopes(s, a, b, k, k)), (n, 0.0))
    if kind == _ATAN2:
        turned = dd.subtract(_sum_of_slopes(s, a, b, k, k), _sum_of_slopes(s, b, a, k, k))
        rest = dd.subtract(turned, _sum_of_slopes(s, i, c, k, k - 1))
        return dd.divide(rest, dd.multiply_float(dd.at(s, c), n))
    if kind == POWER:
        rest = dd.subtract(dd.multiply(dd.at(s, b), _sum_of_slopes(s, a, i, k, k)), _sum_of_slopes(s, i, a, k, k - 1))
        return dd.divide(rest, dd.multiply_float(dd.at(s, a), n)) if s[0, a] != 0.0 else (0.0, 0.0)
    if kind == _SELECT:
        return dd.at(s, b + k) if s[0, a] > 0.0 else dd.at(s, c + k)
    return (0.0, 0.0)
