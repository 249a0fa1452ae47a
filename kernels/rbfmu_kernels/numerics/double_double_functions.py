"""Exponential, logarithm, sine, cosine and the angle of a point in double-double arithmetic, to some 1e-31.

The relative error of e^x grows with |x|, to 2e-29 at 660.
"""

import math

from ..compile.decorator import kernel
from . import double_double as dd, elementary
from .double_double import PI, DoubleDouble

_LN_2 = (0.6931471805599453, 2.3190468138462996e-17)
_HALVINGS, _TERMS_OF_EXP, _TERMS_OF_SINE = 9, 10, 17
"""The first omitted terms, over the sums: |r|^10 / 11! < 1e-39 for |r| <= ln 2 / 2^10, (pi / 4)^36 / 36! < 1e-45."""
_LARGEST, _LARGEST_LOGARITHM = 700.0, 665.5
"""Doubles end at e^709.8. The low parts of e^-x leave the range of doubles from x = 675 on: its error is 6e-29 at 680
and 3e-20 at 700."""


@kernel(inline=False)
def exponential(x: DoubleDouble) -> DoubleDouble:
    """Return e^x: a power of two times e^r, with a series for the 512th part of r; 0 or infinity out of range."""
    if not abs(x[0]) <= _LARGEST:
        return (x[0] if x[0] != x[0] else math.inf if x[0] > 0.0 else 0.0, 0.0)
    k = math.floor(x[0] / _LN_2[0] + 0.5)
    r = dd.scale(2.0**-_HALVINGS, dd.subtract(x, dd.multiply_float(_LN_2, k)))
    total = (0.0, 0.0)
    for n in range(_TERMS_OF_EXP, 0, -1):  # e^r - 1, which keeps its digits when it is squared
        total = dd.divide(dd.multiply(r, dd.add_float(total, 1.0)), (float(n), 0.0))
    for _ in range(_HALVINGS):
        total = dd.add(dd.scale(2.0, total), dd.multiply(total, total))
    half = k // 2  # 2^k alone may be out of range
    return dd.scale(math.ldexp(1.0, int(k - half)), dd.scale(math.ldexp(1.0, int(half)), dd.add_float(total, 1.0)))


@kernel(inline=False)
def logistic(x: DoubleDouble) -> DoubleDouble:
    """Return 1 / (1 + e^-x), for any x."""
    e = exponential(x if x[0] < 0.0 else dd.negate(x))
    return dd.divide(e if x[0] < 0.0 else (1.0, 0.0), dd.add_float(e, 1.0))


@kernel(inline=False)
def sine_and_cosine(x: DoubleDouble) -> dd.Two:
    """Return (sin x, cos x); x: rad. The error is 1e-31 |x| beyond a turn; NaN from |x| = 2^52 on."""
    k = math.floor(x[0] / (0.5 * PI[0]) + 0.5) if abs(x[0]) < 2.0**52 else math.nan
    r = dd.subtract(x, dd.multiply_float(dd.scale(0.5, PI), k))
    square = dd.multiply(r, r)
    s, c = (1.0, 0.0), (1.0, 0.0)
    for n in range(_TERMS_OF_SINE, 0, -1):
        s = dd.subtract((1.0, 0.0), dd.divide(dd.multiply(square, s), (2.0 * n * (2.0 * n + 1.0), 0.0)))
        c = dd.subtract((1.0, 0.0), dd.divide(dd.multiply(square, c), (2.0 * n * (2.0 * n - 1.0), 0.0)))
    s = dd.multiply(r, s)
    quadrant = int(k) & 3 if k == k else 0
    if quadrant & 1:
        s, c = c, dd.negate(s)
    return (dd.negate(s), dd.negate(c)) if quadrant & 2 else (s, c)


@kernel(inline=False)
def natural_logarithm(x: DoubleDouble) -> DoubleDouble:
    """Return ln x, from the logarithm in doubles by one step of Halley's method, which cubes its error.

    NaN where x or 1/x is beyond 1e289, where low parts of products are out of range.
    """
    first = elementary.logarithm(x[0])
    if not abs(first) <= _LARGEST_LOGARITHM:
        return (first if abs(first) == math.inf else math.nan, 0.0)
    power = exponential((first, 0.0))
    change = dd.divide(dd.subtract(x, power), dd.add(x, power))
    return dd.add_float(dd.scale(2.0, change), first)


@kernel(inline=False)
def angle_of(y: DoubleDouble, x: DoubleDouble) -> DoubleDouble:
    """Return the angle of the point (x, y), in [-pi, pi]: the angle in doubles plus the tangent of the rest."""
    first = elementary.atan2(y[0], x[0])
    s, c = sine_and_cosine((first, 0.0))
    across, along = dd.subtract(dd.multiply(y, c), dd.multiply(x, s)), dd.add(dd.multiply(x, c), dd.multiply(y, s))
    if along[0] == 0.0:
        return (first, 0.0)
    return dd.add_float(dd.divide(across, along), first)
