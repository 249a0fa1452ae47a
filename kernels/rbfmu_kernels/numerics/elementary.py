"""Elementary functions in plain double arithmetic: the same bits everywhere, in scalar code and in vectors.

They are branch-free (but for `relaxation`), so that LLVM vectorises them inside loops; no libm symbol but sqrt, fabs
and copysign, no fused operation, no cast. Polynomials are split into pairs (Estrin) for short chains of operations.
"""

import math

import numpy as np

from ..compile.decorator import kernel
from ..compile.wide import bits_of, choose, number_of
from .double_double import PI, two_product

__all__ = ["atan2", "sincos"]

_ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to an integer
_LARGEST = 1e15
"""The largest angle, rad: doubles are 0.125 apart there, and rounding by `_ROUND` is valid to 2^51 quarter turns."""
_TWO_OVER_PI = 0.6366197723675814
# pi / 2 as a sum; the first two have 36 bits, so that their products with |k| < 2^17 are exact (Cody & Waite).
_PIO2_1 = 1.5707963267923333
_PIO2_2 = 2.5633441515839558e-12
_PIO2_3 = 1.0562999066987428e-23
_PI, _PI_LOW = PI
_SPLIT = 2.0**27 + 1.0
_PI_1 = _SPLIT * _PI - (_SPLIT * _PI - _PI)
_PI_2 = _PI - _PI_1


@kernel
def sincos(x: float) -> tuple[float, float]:
    """Return (sin x, cos x).

    x is in rad.  Error <= 1 ulp to |x| = 2e5; then eps |x|, which is the round-off of x; beyond 1e15 x counts as 0.
    Infinite x gives NaN.
    """
    x = choose(abs(x) > _LARGEST, x - x, x)
    shifted = x * _TWO_OVER_PI + _ROUND
    k = shifted - _ROUND
    first = x - k * _PIO2_1
    w = k * _PIO2_2
    r = first - w
    tail = ((first - r) - w) - k * _PIO2_3
    return _in_quadrant(shifted, r, tail)


@kernel
def sincos_half_turns(high: float, low: float) -> tuple[float, float]:
    """Return (sin, cos) of pi (high + low), |low| <= half an ulp of high.

    Error <= 1.3 ulp to |high| = 2^46, 3 ulp to 2^48. Beyond, low takes the argument out of the series' range, and
    beyond 2^51 no digit is left.
    """
    shifted = 2.0 * high + _ROUND
    rest = high - 0.5 * (shifted - _ROUND)
    f = rest + low
    low -= f - rest
    c = _SPLIT * f  # pi f exactly (Dekker), with the parts of pi computed before
    f_1 = c - (c - f)
    f_2 = f - f_1
    r = _PI * f
    tail = ((_PI_1 * f_1 - r) + _PI_1 * f_2 + _PI_2 * f_1) + _PI_2 * f_2
    return _in_quadrant(shifted, r, tail + (_PI * low + _PI_LOW * f))


@kernel
def _in_quadrant(shifted: float, r: float, tail: float) -> tuple[float, float]:
    """Return (sin, cos) of k pi / 2 + r + tail; shifted is k plus `_ROUND`."""
    s, c = _sincos_near_zero(r, tail)
    quadrant = bits_of(shifted)  # its last two bits are those of k
    odd = quadrant & 1 != 0
    return (_signed(choose(odd, c, s), quadrant), _signed(choose(odd, s, c), quadrant + 1))


@kernel
def _signed(x: float, quadrant: np.int64) -> float:
    """Return x, or -x in the quadrants 2 and 3 (of 0 to 3)."""
    return number_of(bits_of(x) ^ ((quadrant & 2) << 62))


@kernel
def _sincos_near_zero(r: float, tail: float) -> tuple[float, float]:
    """Return (sin, cos) of r + tail, |r| <= pi / 4 and a little, with coefficients of FDLIBM."""
    z = r * r
    zz = z * z
    p = (1.66666666666666324348e-01 - z * 8.33333333332248946124e-03) + zz * (
        (1.98412698298579493134e-04 - z * 2.75573137070700676789e-06)
        + zz * (2.50507602534068634195e-08 - z * 1.58969099521155010221e-10)
    )
    sine = r + (tail - (z * r) * p)
    p = (4.16666666666666019037e-02 - z * 1.38888888888741095749e-03) + zz * (
        (2.48015872894767294178e-05 - z * 2.75573143513906633035e-07)
        + zz * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
    )
    half = 0.5 * z
    w = 1.0 - half
    return (sine, w + (((1.0 - w) - half) + (zz * p - r * tail)))


@kernel
def exp2(high: float, low: float) -> float:
    """Return 2^(high + low), |high| <= 1022, |low| <= an ulp of high.  Error <= 0.9 ulp."""
    shifted = high + _ROUND
    r = (high - (shifted - _ROUND)) + low
    z = r * r
    w = z * z
    a = (0.2402265069591007 + r * 0.055504108664821576) + z * (0.009618129107628477 + r * 0.0013333558146428441)
    b = 0.00015403530393381606 + r * 1.5252733804059838e-05
    b += z * (1.3215486790144305e-06 + r * 1.0178086009239696e-07)
    c = (7.054911620801121e-09 + r * 4.44553827187081e-10) + z * (2.5678435993488196e-11 + r * 1.3691488853904124e-12)
    first = r * 0.6931471805599453
    s = 1.0 + first
    p = s + (((1.0 - s) + first) + z * (a + w * (b + w * c)))
    return number_of((bits_of(shifted) + 1023) << 52) * p


@kernel
def scale_for_squares(largest: float) -> float:
    """Return a power of two that keeps squares in range.

    Numbers up to `largest`, times it, can be squared and summed without over- or underflow.
    """
    return choose(largest > 2.0**500, 2.0**-600, choose(largest < 2.0**-500, 2.0**600, 1.0))


_PIO4_HI = 0.7853981633974492  # 49 bits of pi / 4: its multiples up to 4 are exact
_PIO4_LO = -8.575622497214414e-16


@kernel
def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y), in [-pi, pi].

    x and y have any common unit and are not both beyond 2^1022; the signs of zeros count as in C.
    Error <= 1.7 ulp.  Two infinities give NaN.
    """
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    n, d = choose(steep, ax, ay), choose(steep, ay, ax)
    turn = n > 0.5 * d  # turn the point by -pi / 4; d - n is exact here
    n, d = choose(turn, n - d, n), choose(turn, n + d, d)
    d = choose(d == 0.0, 1.0, d)
    t = n / d
    z = t * t
    error = -t * (z * _atan_series(z))
    # All eight octants: +-(t + error) + a multiple of pi / 4.
    left = math.copysign(1.0, x) < 0.0
    eighths = choose(turn, 1.0, 0.0)
    eighths = choose(steep, 2.0 - eighths, eighths)
    eighths = choose(left, 4.0 - eighths, eighths)
    mirror = steep ^ left
    t = choose(mirror, -t, t)
    error = choose(mirror, -error, error)
    base = eighths * _PIO4_HI
    total = base + t
    return math.copysign(total + ((t - (total - base)) + (eighths * _PIO4_LO + error)), y)


@kernel
def _atan_series(z: float) -> float:
    """Return (1 - atan(t) / t) / z at z = t^2 <= 1/4, by a polynomial whose product with z is minimax.

    The error of this product, and so of atan(t) / t, is 2^-57.
    """
    w = z * z
    v = w * w
    a = (0.3333333333333329 - z * 0.1999999999997101) + w * (0.14285714281572354 - z * 0.11111110858617597)
    b = (0.09090900708337263 - z * 0.07692137205771797) + w * (0.06664401109265414 - z * 0.05861975487752309)
    c = (0.05137137829905682 - z * 0.04226037225301247) + w * (0.028028821654761716 - z * 0.010507511365742985)
    return (a + v * b) + (v * v) * c


_STEPS = (2.0**512, 2.0**256, 2.0**128, 2.0**64)


@kernel
def power_of_two_for(x: float) -> float:
    """Return a power of two with 2^-64 <= |power x| < 2^64.

    It is 2^-114 for the least subnormal numbers, and 1 for 0 and NaN.
    """
    size, power = abs(x), 1.0
    for step in _STEPS:
        inverse = 1.0 / step
        change = choose(size >= step, inverse, 1.0)
        size, power = size * change, power * change
        change = choose((size > 0.0) & (size < inverse), step, 1.0)
        size, power = size * change, power * change
    return power


@kernel
def round_to_integer(x: float) -> float:
    """Return the nearest integer (ties to even)."""
    shift = math.copysign(4503599627370496.0, x)  # 2^52
    return choose(abs(x) < 4503599627370496.0, (x + shift) - shift, x)


_LOG2_E, _LOG2_E_LOW = 1.4426950408889634, 2.0355273740931033e-17
_LN_2, _LN_2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10


@kernel
def exponential(x: float) -> float:
    """Return e^x; 0 below -708 and infinity above 708, near the ends of the range of doubles.  Error <= 1 ulp."""
    product, e = two_product(x, _LOG2_E)
    inside = abs(x) <= 708.0
    found = exp2(choose(inside, product, 0.0), choose(inside, e + x * _LOG2_E_LOW, 0.0))
    return choose(inside, found, choose(x != x, x, choose(x > 0.0, math.inf, 0.0)))


_ONE_OVER_FACTORIAL = (1.0 / np.cumprod(np.arange(1.0, 20.0))).tolist()
_EVEN, _ODD = tuple(_ONE_OVER_FACTORIAL[1::2]), tuple(_ONE_OVER_FACTORIAL[2::2])
"""1 / 2!, 1 / 4! and so on; 1 / 3!, 1 / 5! and so on."""


@kernel
def relaxation(x: float) -> tuple[float, float, float]:
    """Return exp(-x), (1 - exp(-x)) / x and (exp(-x) - 1 + x) / x^2, which are 1, 1 and 1/2 at x = 0.

    x >= 0.  Error <= 3 ulp.  Below 1, where the differences would cancel, by the series of sinh and cosh.
    """
    if x >= 1.0:
        left, inverse = exponential(-x), 1.0 / x
        return left, (1.0 - left) * inverse, (((x - 1.0) + left) * inverse) * inverse
    z, even, odd = x * x, 0.0, 0.0
    for k in range(len(_EVEN) - 1, -1, -1):
        even, odd = even * z + _EVEN[k], odd * z + _ODD[k]
    second = even - x * odd
    first = 1.0 - x * second
    return 1.0 - x * first, first, second


@kernel
def relaxed(rate: float, drive: float, damping_rate: float, t: float) -> tuple[float, float]:
    """Return (angle turned, rate) after the time t, where rate' = drive - damping_rate rate, damping_rate >= 0."""
    left, first, second = relaxation(damping_rate * t)
    gained = drive * t
    return (rate * first + gained * second) * t, rate * left + gained * first


@kernel
def logistic(x: float) -> float:
    """Return 1 / (1 + e^-x), for any x; 0 below -708.  Error <= 2 ulp."""
    e = exponential(-abs(x))
    return choose(x > 0.0, 1.0, e) / (1.0 + e)


@kernel
def logarithm(x: float) -> float:
    """Return ln x; -infinity at 0, NaN below.  Error <= 1 ulp (the algorithm and coefficients of FDLIBM's log)."""
    inside = (x > 0.0) & (x < math.inf)
    beyond = choose(x == 0.0, -math.inf, choose(x > 0.0, x, math.nan))
    small = x < 2.0**-1022
    x = choose(inside, choose(small, x * 2.0**54, x), 1.0)
    bits = bits_of(x)
    # k halvings bring x between sqrt(1/2) and sqrt(2)
    k = (bits - bits_of(0.7071067811865476)) >> 52
    f = number_of(bits - (k << 52)) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    n = (number_of(bits_of(_ROUND) + k) - _ROUND) - choose(small, 54.0, 0.0)
    return choose(inside, n * _LN_2 - ((half - (s * (half + (odd + even)) + n * _LN_2_LOW)) - f), beyond)
