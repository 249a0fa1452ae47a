"""Elliptic functions and integrals in the forms that a free rigid body needs, without cancellation for any modulus.

The scale of arithmetic-geometric means a_0 = 1, g_0 = kc (the complementary modulus), a' = (a + g) / 2, g' = sqrt(a g)
gives complete integrals and the phase x = pi u / (2 K) of an amplitude, in double-double.

Jacobi's sn, cn, dn are quotients of theta functions of the phase v = pi u / (2 K). For kc >= NEAREST_KC, where the nome
q <= 0.134 and nothing cancels, these are short series in q.  With x = cos 2v: theta_3, theta_4 = E +- x O;
theta_1, theta_2 = 2 q^(1/4) (sin, cos) v (P -+ x Q), each of E, O, P, Q even in x.

For smaller kc, near the separatrix, Jacobi's imaginary transformation gives theta functions of the nome
q' = exp(-pi K / K') and of an imaginary argument: series in the decaying e = exp(-pi |u| / 2K') and in sqrt(q') / e.
Sources: DLMF 19.8, 20.2, 20.7(viii), 22.2, 22.7, 22.20; nome: DLMF 19.5.5.
"""

import math
from typing import NamedTuple

from ..compile.decorator import kernel
from ..compile.wide import alike, all_of, any_of, choose
from ..types import Vec3
from . import double_double as dd, elementary
from .double_double import ONE_OVER_PI, DoubleDouble, two_product, two_sum


@kernel
def jacobi_low_parts(sn: float, cn: float, dn: float, kc2: DoubleDouble) -> tuple[float, float, float]:
    """Return the corrections to add to sn, cn, dn, each of which has an error of some eps; kc2: kc^2.

    With them sn^2 + cn^2 = 1 and dn^2 = cn^2 + kc^2 sn^2 to 1e-30.
    """
    s_1, s_2 = two_product(sn, sn)
    c_1, c_2 = two_product(cn, cn)
    d_1, d_2 = two_product(dn, dn)
    k_1, k_2 = two_product(kc2[0], s_1)
    one, one_2 = two_sum(s_1, c_1)
    short = 0.5 * ((1.0 - one) - (one_2 + (s_2 + c_2)))
    total, total_2 = two_sum(c_1, k_1)
    rest = (total - d_1) + ((total_2 - d_2) + (c_2 + (k_2 + (kc2[0] * s_2 + kc2[1] * s_1))))
    return (short * sn, short * cn, short * dn + 0.5 * rest / dn)


@kernel(inline=False)
def climb_scale(kc: DoubleDouble, n: DoubleDouble, s: DoubleDouble, c: DoubleDouble) -> dd.Three:
    """Return (AGM(1, kc), sum, x / pi).

    They give Pi(-n) = pi / (4 AGM) (2 - n / (1 + n) sum), and x / pi = u / (2 K) at the amplitude tan am = s / c.
    1e-300 <= kc <= 1, 0 <= n <= 1, s, c >= 0.  Pi: DLMF 19.8.7; x by Landen's descent, am' = am + atan(g / a tan am),
    in products of complex numbers.  Relative error about 1e-31 of the AGM, some 1e-29 of Pi; error 1e-19 of x.
    """
    a: DoubleDouble = (1.0, 0.0)
    g = kc
    p = dd.root(dd.add_float(n, 1.0))
    term: DoubleDouble = (1.0, 0.0)
    total: DoubleDouble = (1.0, 0.0)
    turns, halves, goes_on = 0.0, 1.0, alike(kc[0], 1.0) > 0.0
    for _ in range(16):
        ag = dd.multiply(a, g)
        a_plus_g = dd.add(a, g)
        gap = a[0] - g[0]
        # am' = 2 pi turns + the angle of (c, s)
        whole = 2.0 * turns + choose(c[0] < 0.0, choose(s[0] >= 0.0, 1.0, -1.0), 0.0)
        turns, halves = choose(goes_on, whole, turns), choose(goes_on, 0.5 * halves, halves)
        sc = dd.multiply(a_plus_g, dd.multiply(s, c))
        cc = dd.subtract(dd.multiply(a, dd.multiply(c, c)), dd.multiply(g, dd.multiply(s, s)))
        size = abs(sc[0]) + abs(cc[0])
        fits = (size > 1e-10) & (size < 1e10)
        if not all_of(fits):  # these numbers are squared at each level
            power = choose(fits, 1.0, elementary.power_of_two_for(size))
            sc, cc = dd.scale(power, sc), dd.scale(power, cc)
        s, c = dd.choose(goes_on, sc, s), dd.choose(goes_on, cc, c)
        p2 = dd.multiply(p, p)
        p_sum = dd.add(p2, ag)
        epsilon = dd.divide(dd.subtract(p2, ag), p_sum)
        p = dd.choose(goes_on, dd.scale(0.5, dd.divide(p_sum, p)), p)
        term = dd.choose(goes_on, dd.scale(0.5, dd.multiply(term, epsilon)), term)
        total = dd.choose(goes_on, dd.add(total, term), total)
        done = (gap < 6e-4 * a[0]) & (abs(epsilon[0]) < 1e-3)
        a, g = dd.choose(goes_on, dd.scale(0.5, a_plus_g), a), dd.choose(goes_on, dd.root(ag), g)
        goes_on = goes_on & (choose(done, 0.0, 1.0) > 0.0)
        if not any_of(goes_on):
            break
    # The rest is below 1e-6: series in h = (a - g) / a and epsilon, in double.
    gap_left = dd.subtract(a, g)
    h = gap_left[0] / a[0]
    p2, ag = dd.multiply(p, p), dd.multiply(a, g)
    epsilon_1 = dd.subtract(p2, ag)[0] / (p2[0] + ag[0])
    total = dd.add_float(total, 0.5 * term[0] * epsilon_1 * (1.0 + 0.25 * (epsilon_1 * epsilon_1 - 0.125 * h * h)))
    agm = dd.add_float(dd.add(a, dd.scale(-0.5, gap_left)), -a[0] * h * h * (0.0625 + h * 0.03125))
    # x = am - (h / 4 + h^2 / 8) sin 2 am + 3 h^2 / 64 sin 4 am, am = pi (2 turns + angle)
    size = 1.0 / (s[0] * s[0] + c[0] * c[0])
    sin_2, cos_2 = 2.0 * s[0] * c[0] * size, (c[0] - s[0]) * (c[0] + s[0]) * size
    rest = sin_2 * h * (0.09375 * h * cos_2 - 0.25 - 0.125 * h)
    x = dd.add_float(dd.add_float(angle_in_half_turns(s, c), ONE_OVER_PI[0] * rest), 2.0 * turns)
    return (agm, total, dd.scale(halves, x))


_SIN_PI_8: DoubleDouble = (0.3826834323650898, -1.0050772696461588e-17)
_COS_PI_8: DoubleDouble = (0.9238795325112867, 1.7645047084336677e-17)
_SQRT_HALF: DoubleDouble = (0.7071067811865476, -4.833646656726457e-17)
_EIGHTHS = (
    (0.198912367379658, 1.0, _SIN_PI_8, _COS_PI_8),
    (0.6681786379192989, 2.0, _SQRT_HALF, _SQRT_HALF),
    (1.496605762665489, 3.0, _COS_PI_8, _SIN_PI_8),
    (5.027339492125848, 4.0, (1.0, 0.0), (0.0, 0.0)),
)
"""For each multiple of pi / 8: the tangent from which on it is the nearest one, the multiple, its sine and cosine."""


@kernel(inline=False)
def angle_in_half_turns(y: DoubleDouble, x: DoubleDouble) -> DoubleDouble:
    """Return the angle of the point (x, y) over pi, in [-1, 1].

    Error about 1e-19: beyond double, short of double-double.
    """
    below, left = y[0] < 0.0, x[0] < 0.0
    y = dd.scale(choose(below, -1.0, 1.0), y)
    x = dd.scale(choose(left, -1.0, 1.0), x)
    # Turn the point by the nearest multiple of pi / 8.
    eighths = 0.0
    sine: DoubleDouble = (0.0, 0.0)
    cosine: DoubleDouble = (1.0, 0.0)
    for tangent, nearest, of_sine, of_cosine in _EIGHTHS:
        steeper = y[0] > tangent * x[0]
        eighths = choose(steeper, nearest, eighths)
        sine, cosine = dd.choose(steeper, of_sine, sine), dd.choose(steeper, of_cosine, cosine)
    along = dd.add(dd.multiply(x, cosine), dd.multiply(y, sine))
    across = dd.subtract(dd.multiply(y, cosine), dd.multiply(x, sine))
    t = dd.divide(across, along)
    # atan t = t - t^3 / 3 + t^5 / 5 - ...: the sum after t is below 3e-3, so double is enough.
    z = t[0] * t[0]
    z2 = z * z
    p = 1.0 / 19.0 - z * (1.0 / 21.0) + z2 * (1.0 / 23.0)
    p = 1.0 / 15.0 - z * (1.0 / 17.0) + z2 * p
    p = 1.0 / 11.0 - z * (1.0 / 13.0) + z2 * p
    p = 1.0 / 7.0 - z * (1.0 / 9.0) + z2 * p
    p = 1.0 / 3.0 - z * (1.0 / 5.0) + z2 * p
    angle = dd.multiply(dd.add_float(t, -t[0] * z * p), ONE_OVER_PI)
    angle = dd.add_float(angle, 0.125 * eighths)
    angle = dd.choose(left, dd.add_float(dd.scale(-1.0, angle), 1.0), angle)
    return dd.scale(choose(below, -1.0, 1.0), angle)


_PI_OVER_LOG_2: DoubleDouble = (4.532360141827194, -3.4581174592298686e-16)

NEAREST_KC = 0.335
"""The limit between the two series. There q = 0.133, and q^20 and q'^8 = 0.0074^8 are negligible beside 1."""


class Theta(NamedTuple):
    """Coefficients of E (1, x^2, x^4), O, P, Q (1, x^2 each); then factors of sn, cn, dn."""

    e: Vec3
    o: tuple[float, float]
    p: tuple[float, float]
    q: tuple[float, float]
    factors: Vec3


@kernel(inline=False)
def theta_series(kc: DoubleDouble) -> Theta:
    """Return the series for the complementary modulus kc, NEAREST_KC <= kc <= 1.  Relative error <= 3 eps."""
    return theta_series_of(nome(dd.add_float(dd.negate(kc), 1.0)[0], kc[0]))


@kernel(inline=False)
def theta_series_of(q: float) -> Theta:
    """Return the series for the nome q <= 0.134."""
    q2 = q * q
    q4 = q2 * q2
    q6, q9, q12, q16 = q4 * q2, q4 * q4 * q, q4 * q4 * q4, q4 * q4 * q4 * q4
    e0, e2, e4 = 1.0 - 2.0 * (q4 - q16), 4.0 * q4 - 16.0 * q16, 16.0 * q16
    o0, o2 = 2.0 * q - 6.0 * q9, 8.0 * q9
    p0, p2 = 1.0 - q2 - q6 + q12, 4.0 * (q6 - q12)
    r0, r2 = 2.0 * (q2 - q6) - 4.0 * q12, 8.0 * q12
    e, o, pr = e0 + (e2 + e4), o0 + o2, (p0 + p2) + (r0 + r2)
    factors = (e + o) / pr, (e - o) / pr, (e - o) / (e + o)
    return Theta((e0, e2, e4), (o0, o2), (p0, p2), (r0, r2), factors)


@kernel
def jacobi_from_theta(sin_v: float, cos_v: float, theta: Theta) -> tuple[float, float, float]:
    """Return (sn, cn, dn) of u at the phase v = pi u / (2 K), of any size.  Relative error <= 5 eps each."""
    (e0, e2, e4), (o0, o2), (p0, p2), (r0, r2), (a, b, d) = theta
    x = (cos_v - sin_v) * (cos_v + sin_v)
    x2 = x * x
    e, o = (e0 + x2 * e2) + (x2 * x2) * e4, x * (o0 + x2 * o2)
    p, r = p0 + x2 * p2, x * (r0 + x2 * r2)
    inverse = 1.0 / (e - o)
    return a * sin_v * (p - r) * inverse, b * cos_v * (p + r) * inverse, d * (e + o) * inverse


class Near(NamedTuple):
    """The square root of the nome q', and factors of sn, cn, dn."""

    root_nome: float
    sn: float
    cn: float
    dn: float


@kernel(inline=False)
def near_series(kc: float) -> Near:
    """Return the series for the complementary modulus kc, 1e-300 <= kc <= NEAREST_KC.  Relative error <= 3 eps."""
    k = math.sqrt((1.0 - kc) * (1.0 + kc))
    root = math.sqrt(k)
    y = 0.5 * kc * kc / ((1.0 + k) * (1.0 + root) * (1.0 + root))
    y4 = (y * y) * (y * y)
    ratio = math.sqrt(0.5 * (1.0 + y4 * (2.0 + 15.0 * y4)) / (1.0 + k)) / (1.0 + root)  # root q' / kc
    return Near(kc * ratio, 1.0 / root, 1.0 / math.sqrt(k * ratio), 1.0 / math.sqrt(ratio))


@kernel(inline=False)
def near_scale(kc: DoubleDouble, agm: DoubleDouble, s: DoubleDouble, c: DoubleDouble) -> dd.Two:
    """Return (W, pi a / 2K' over pi) with exp(-pi |u| / 2K') = 2^-|W x| at u = 2 K x and tan am(a, k') = s / c.

    kc <= NEAREST_KC, and agm is AGM(1, kc).
    """
    k = dd.root(dd.add_float(dd.negate(dd.multiply(kc, kc)), 1.0))
    mean, _, phase = climb_scale(k, (0.0, 0.0), s, c)
    return dd.multiply(dd.divide(mean, agm), _PI_OVER_LOG_2), phase


Place = tuple[float, float, float, float]
"""Near the separatrix: e, the sign of u, 1 or -1 (an even or odd number of half turns), the rest of them |x| <= 1/2."""


@kernel
def place_near(x: DoubleDouble, width: DoubleDouble) -> Place:
    """Return the place at the phase x, in half turns; width: W of `near_scale`, with either sign."""
    turns = elementary.round_to_integer(x[0])
    rest = x[0] - turns
    high, low = two_product(width[0], rest)
    low += width[0] * x[1] + width[1] * rest
    right = high > 0.0
    e = elementary.exp2(choose(right, -high, high), choose(right, -low, low))
    flip = choose(2.0 * elementary.round_to_integer(0.5 * turns) == turns, 1.0, -1.0)
    return (e, math.copysign(1.0, high), flip, rest)


@kernel
def jacobi_near(e: float, side: float, near: Near) -> tuple[float, float, float]:
    """Return (sn, cn, dn) of u, |u| <= K, from e = exp(-pi |u| / 2K') and side, the sign of u.

    Error <= 5 eps, of cn and dn relative to dn: cn is 0 at u = K.
    """
    root_q, for_sn, for_cn, for_dn = near
    p, q = root_q / e, root_q * root_q
    p, e2, q2 = p * p, e * e, q * q
    q4, qe, p2 = q2 * q2, q * e2, p * p
    qee = qe * e2
    odd, even = (p + qe) + q4 * (q2 * p2 * p), 1.0 + (q2 * p2 + qe * qe * q2)
    sinh = (1.0 - e2) - (q * (p - qee) - q4 * (p2 - qe * qee))
    inverse = 1.0 / ((1.0 + e2) + (q * (p + qee) + q4 * (p2 + qe * qee)))
    return (
        for_sn * side * (sinh * inverse),
        for_cn * e * ((even - odd) * inverse),
        for_dn * e * ((even + odd) * inverse),
    )


@kernel
def nome(lack: float, kc: float) -> float:
    """Return the nome of kc >= NEAREST_KC, given lack = 1 - kc.

    It is a series in y = (1 - sqrt kc) / (2 (1 + sqrt kc)) <= 0.134.
    """
    root = math.sqrt(kc)
    y = 0.5 * lack / ((1.0 + root) * (1.0 + root))
    y4 = (y * y) * (y * y)
    series = 150.0 + y4 * (1707.0 + y4 * (20910.0 + y4 * 268616.0))
    return y + y * y4 * (2.0 + y4 * (15.0 + y4 * series))
