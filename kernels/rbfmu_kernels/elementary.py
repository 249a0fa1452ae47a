"""Sine, cosine and arctangent in plain double arithmetic: the same bits on every platform, in scalar code and in vectors.

Branch-free, so that LLVM vectorises them inside loops; no libm symbol but sqrt, fabs and copysign, no fused operation.
"""

import math

from ._kernel import kernel

_ROUND = 6755399441055744.0  # 1.5 2^52: adding and subtracting it rounds to an integer
_TWO_OVER_PI = 0.6366197723675814
# pi / 2 in three parts of 33 bits (their products with |k| < 2^20 are exact) and the rest.
_PIO2_1 = 1.5707963267341256
_PIO2_2 = 6.077100506303966e-11
_PIO2_3 = 2.0222662487111665e-21
_PIO2_4 = 8.4784276603689e-32


@kernel
def sincos(x: float) -> tuple[float, float]:
    """(sin x, cos x)."""
    k = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    first = x - k * _PIO2_1
    w2 = k * _PIO2_2
    second = first - w2
    w3 = k * _PIO2_3
    reduced = second - w3
    tail = ((second - reduced) - w3) + (((first - second) - w2) - k * _PIO2_4)
    reduced = 0.0 if abs(reduced) > 0.8 else reduced
    s, c = _sincos_near_zero(reduced, tail)
    quadrant = k - 4.0 * ((0.25 * k + _ROUND) - _ROUND)
    odd = abs(quadrant) == 1.0
    sine = c if odd else s
    cosine = s if odd else c
    flip_sine = abs(quadrant) == 2.0 or quadrant == -1.0
    flip_cosine = abs(quadrant) == 2.0 or quadrant == 1.0
    return (-sine if flip_sine else sine, -cosine if flip_cosine else cosine)


@kernel
def _sincos_near_zero(r: float, tail: float) -> tuple[float, float]:
    z = r * r
    v = z * r
    p = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08
    p = p * z + 2.75573137070700676789e-06
    p = p * z - 1.98412698298579493134e-04
    p = p * z + 8.33333333332248946124e-03
    s = r - ((z * (0.5 * tail - v * p) - tail) + v * 1.66666666666666324348e-01)
    p = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09
    p = p * z - 2.75573143513906633035e-07
    p = p * z + 2.48015872894767294178e-05
    p = p * z - 1.38888888888741095749e-03
    p = p * z + 4.16666666666666019037e-02
    half = 0.5 * z
    w = 1.0 - half
    c = w + (((1.0 - w) - half) + (z * (z * p) - r * tail))
    return (s, c)


_PIO4_HI = 0.7853981633974492  # 49 bits of pi / 4: its multiples up to 4 are exact
_PIO4_LO = -8.575622497214414e-16
_TAN_PIO8 = 0.4142135623730951
_SPLIT = 134217729.0  # 2^27 + 1: leaves the upper 26 bits
_HUGE, _TINY = 2.0**500, 2.0**-500
_UP, _DOWN = 2.0**600, 2.0**-600


@kernel
def atan2(y: float, x: float) -> float:
    """The angle of the point (x, y), in [-pi, pi]."""
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    n, d = (ax if steep else ay), (ay if steep else ax)
    unit = _DOWN if d > _HUGE else (_UP if d < _TINY else 1.0)
    n, d = unit * n, unit * d
    # Beyond pi / 8 turn the point by -pi / 4; the sums' rounding errors are kept.
    turn = n > _TAN_PIO8 * d
    total, difference = d + n, d - n
    n_error = n - (d - difference) if turn else 0.0
    d_error = n - (total - d) if turn else 0.0
    n, d = (-difference if turn else n), (total if turn else d)
    d = 1.0 if d == 0.0 else d
    # n / d = t + correction: t has 26 bits, so that the remainder n - t d is found exactly.
    reciprocal = 1.0 / d
    t = _upper_half(n * reciprocal)
    d_upper = _upper_half(d)
    remainder = (n - t * d_upper) - t * (d - d_upper)
    correction = (remainder + (n_error - t * d_error)) * reciprocal
    angle, error = _atan_near_zero(t, correction)
    # All eight octants: angle * sign + a multiple of pi / 4.
    left = math.copysign(1.0, x) < 0.0
    eighths = 1.0 if turn else 0.0
    eighths = 2.0 - eighths if steep else eighths
    eighths = 4.0 - eighths if left else eighths
    sign = -1.0 if steep != left else 1.0
    base = eighths * _PIO4_HI
    angle *= sign
    total = base + angle
    rounding = angle - (total - base)
    return math.copysign(total + (rounding + (eighths * _PIO4_LO + sign * error)), y)


@kernel
def _upper_half(x: float) -> float:
    c = _SPLIT * x
    return c - (c - x)


@kernel
def _atan_near_zero(t: float, tail: float) -> tuple[float, float]:
    """Atan(t + tail) as a sum, |t| <= tan(pi / 8)."""
    x = t + tail
    rest = (t - x) + tail
    z = x * x
    p = 1.62858201153657823623e-02 * z - 3.65315727442169155270e-02
    p = p * z + 4.97687799461593236017e-02
    p = p * z - 5.83357013379057348645e-02
    p = p * z + 6.66107313738753120669e-02
    p = p * z - 7.69187620504482999495e-02
    p = p * z + 9.09088713343650656196e-02
    p = p * z - 1.11111104054623557880e-01
    p = p * z + 1.42857142725034663711e-01
    p = p * z - 1.99999999998764832476e-01
    p = p * z + 3.33333333333329318027e-01
    return (x, rest * (1.0 - z) - x * (z * p))
