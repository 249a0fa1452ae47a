"""Jacobi's sn, cn, dn as quotients of theta functions of the phase v = pi u / (2 K): short series in the nome q.

For kc >= NEAREST_KC, where q <= 0.134 and nothing cancels.  With x = cos 2v: theta_3, theta_4 = E +- x O;
theta_1, theta_2 = 2 q^(1/4) (sin, cos) v (P -+ x Q), each of E, O, P, Q even in x.

Near the separatrix by Jacobi's imaginary transformation: theta functions of nome q' = exp(-pi K / K') and imaginary
argument, as series in their decaying e = exp(-pi |u| / 2K') and in root q' / e.
Sources: DLMF 20.2, 20.7(viii), 22.2; nome: DLMF 19.5.5.
"""

import math
from typing import NamedTuple

from ..compile.decorator import kernel
from ..compile.wide import choose
from .agm import climb_scale
from .double_double import DoubleDouble, dd_add_float, dd_divide, dd_multiply, dd_negate, dd_sqrt, two_product
from .elementary import exp2
from .scaling import round_to_integer

_PI_OVER_LOG_2: DoubleDouble = (4.532360141827194, -3.4581174592298686e-16)

NEAREST_KC = 0.335
"""There q = 0.133, q^20 nothing beside 1, and so is q'^8 = 0.0074^8: the larger kc may be for `near_series`."""


class Theta(NamedTuple):
    """Coefficients of E (1, x^2, x^4), O, P, Q (1, x^2 each); then factors of sn, cn, dn."""

    e_0: float
    e_2: float
    e_4: float
    o_0: float
    o_2: float
    p_0: float
    p_2: float
    q_0: float
    q_2: float
    sn: float
    cn: float
    dn: float


@kernel(inline=False)
def theta_series(kc: DoubleDouble) -> Theta:
    """Return the series of the complementary modulus kc, NEAREST_KC <= kc <= 1.  Relative error <= 3 eps."""
    return theta_series_of(nome(dd_add_float(dd_negate(kc), 1.0)[0], kc[0]))


@kernel(inline=False)
def theta_series_of(q: float) -> Theta:
    """Return the series of the nome q <= 0.134."""
    q2 = q * q
    q4 = q2 * q2
    q6, q9, q12, q16 = q4 * q2, q4 * q4 * q, q4 * q4 * q4, q4 * q4 * q4 * q4
    e0, e2, e4 = 1.0 - 2.0 * (q4 - q16), 4.0 * q4 - 16.0 * q16, 16.0 * q16
    o0, o2 = 2.0 * q - 6.0 * q9, 8.0 * q9
    p0, p2 = 1.0 - q2 - q6 + q12, 4.0 * (q6 - q12)
    r0, r2 = 2.0 * (q2 - q6) - 4.0 * q12, 8.0 * q12
    e, o, pr = e0 + (e2 + e4), o0 + o2, (p0 + p2) + (r0 + r2)
    return Theta(e0, e2, e4, o0, o2, p0, p2, r0, r2, (e + o) / pr, (e - o) / pr, (e - o) / (e + o))


@kernel
def jacobi_from_theta(sin_v: float, cos_v: float, theta: Theta) -> tuple[float, float, float]:
    """Return (sn, cn, dn) of u at the phase v = pi u / (2 K), of any size.  Relative error <= 5 eps each."""
    e0, e2, e4, o0, o2, p0, p2, r0, r2, a, b, d = theta
    x = (cos_v - sin_v) * (cos_v + sin_v)
    x2 = x * x
    e, o = (e0 + x2 * e2) + (x2 * x2) * e4, x * (o0 + x2 * o2)
    p, r = p0 + x2 * p2, x * (r0 + x2 * r2)
    inverse = 1.0 / (e - o)
    return a * sin_v * (p - r) * inverse, b * cos_v * (p + r) * inverse, d * (e + o) * inverse


class Near(NamedTuple):
    """The root of the nome q'; factors of sn, cn, dn."""

    root_nome: float
    sn: float
    cn: float
    dn: float


@kernel(inline=False)
def near_series(kc: float) -> Near:
    """Return the series of the complementary modulus kc, 1e-300 <= kc <= NEAREST_KC.  Relative error <= 3 eps."""
    k = math.sqrt((1.0 - kc) * (1.0 + kc))
    root = math.sqrt(k)
    y = 0.5 * kc * kc / ((1.0 + k) * (1.0 + root) * (1.0 + root))
    y4 = (y * y) * (y * y)
    ratio = math.sqrt(0.5 * (1.0 + y4 * (2.0 + 15.0 * y4)) / (1.0 + k)) / (1.0 + root)  # root q' / kc
    return Near(kc * ratio, 1.0 / root, 1.0 / math.sqrt(k * ratio), 1.0 / math.sqrt(ratio))


@kernel(inline=False)
def near_scale(
    kc: DoubleDouble, agm: DoubleDouble, s: DoubleDouble, c: DoubleDouble
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return (W, pi a / 2K' over pi) with exp(-pi |u| / 2K') = 2^-|W x| at u = 2 K x and tan am(a, k') = s / c.

    kc <= NEAREST_KC, and agm is AGM(1, kc).
    """
    k = dd_sqrt(dd_add_float(dd_negate(dd_multiply(kc, kc)), 1.0))
    mean, _, phase = climb_scale(k, (0.0, 0.0), s, c)
    return dd_multiply(dd_divide(mean, agm), _PI_OVER_LOG_2), phase


Place = tuple[float, float, float, float]
"""Near the separatrix: e, the sign of u, -1 where half turns were odd and the rest of them, |x| <= 1/2."""


@kernel
def place_near(x: DoubleDouble, width: DoubleDouble) -> Place:
    """Return the place at the phase x, in half turns."""
    turns = round_to_integer(x[0])
    rest = x[0] - turns
    high, low = two_product(width[0], rest)
    low += width[0] * x[1] + width[1] * rest
    right = high > 0.0
    e = exp2(choose(right, -high, high), choose(right, -low, low))
    flip = choose(2.0 * round_to_integer(0.5 * turns) == turns, 1.0, -1.0)
    return (e, math.copysign(1.0, high), flip, rest)


@kernel
def jacobi_near(e: float, side: float, near: Near) -> tuple[float, float, float]:
    """Return (sn, cn, dn) of u, |u| <= K, from e = exp(-pi |u| / 2K') and side, the sign of u.

    Error <= 5 eps, of cn and dn relative.
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
