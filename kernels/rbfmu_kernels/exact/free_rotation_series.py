"""A free body's attitude, and its sn, cn, dn, at a place on the polhode: short series of Jacobi's theta functions.

Let v = pi u / 2K be the phase at u, and a' = pi a / 2K with sn(a, k') = 1 / sqrt(1 + kappa) (notation:
free_rotation.py). Then
    alpha = theta_4(v + i a' | q^2), beta = theta_1(v + i a' | q^2)
are e + i z and x + i y, but for signs and a common factor, of the quaternion (e, x, y, z) that turns the angular
momentum's axes to the body's, without its steady turn about the momentum.  Reason: by the addition theorem
|alpha|^2 +- |beta|^2 are (theta_4^2 +- theta_1^2)(v), each times a constant; by Landen's transformation dn is the
quotient of these; so (|alpha|^2 - |beta|^2) / (|alpha|^2 + |beta|^2) = A_s dn / G.  Direction cosines as such quotients
are due to Jacobi.
Sources: Whittaker & Watson, ch. 21; DLMF 20.2, 20.7, 22.7.

`NEAR` the separatrix Jacobi's imaginary transformation gives theta_2 and i theta_1 of b - i y, times
exp(-2 i b v / pi), with b = pi a / 4K', y = pi u / 4K' and the nome exp(-pi K / 2K'). They are series in
e = exp(-2 |y|) and p = nome / e.
"""

import math
from typing import NamedTuple

from ..buffer_access import record
from ..compile.decorator import kernel
from ..compile.wide import alike, any_of, choose
from ..numerics import double_double as dd, elementary, elliptic
from ..types import Quaternion, Vec3

TUMBLING, STEADY, SEPARATRIX, NEAR = 0.0, 1.0, 2.0, 3.0

Series = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float, float, float, float,
]  # fmt: skip
"""The numbers of a `TumblingSeries`, a `NearSeries` or a `SteadyTurn`; the last two are filled up with zeros."""


class TumblingSeries(NamedTuple):
    """The series away from the separatrix.

    Coefficients in c = cos 2v: of Re alpha, of Im alpha / (sin v cos v), of Re beta / sin v, of Im beta / cos v.
    """

    re_alpha: Quaternion
    im_alpha: Vec3
    re_beta: Vec3
    im_beta: Vec3
    jacobi: elliptic.Theta


class NearSeries(NamedTuple):
    """The series near the separatrix.

    Coefficients of theta_2 (even) and theta_1 (odd): cosines and sines of multiples of b, by powers of the nome.
    """

    even: Quaternion
    odd: Quaternion
    jacobi: elliptic.Near


class SteadyTurn(NamedTuple):
    """The constants of a steady motion: its axis in b."""

    axis: Vec3


_tumbling = record(TumblingSeries)
read_tumbling, flatten_tumbling = _tumbling[2:]
read_near, flatten_near = record(NearSeries, _tumbling.size)[2:]
read_steady, flatten_steady = record(SteadyTurn, _tumbling.size)[2:]


@kernel
def attitude(sin_v: float, cos_v: float, series: TumblingSeries) -> tuple[float, float, float, float]:
    """Return (Re alpha, Re beta, Im beta, Im alpha) at the phase v."""
    (a_0, a_1, a_2, a_3), (i_0, i_1, i_2), (b_0, b_1, b_2), (j_0, j_1, j_2), _ = series
    c = (cos_v - sin_v) * (cos_v + sin_v)
    return (
        a_0 + c * (a_1 + c * (a_2 + c * a_3)),
        sin_v * (b_0 + c * (b_1 + c * b_2)),
        cos_v * (j_0 + c * (j_1 + c * j_2)),
        sin_v * cos_v * (i_0 + c * (i_1 + c * i_2)),
    )


@kernel
def place_of(kind: float, x: dd.DoubleDouble, width: dd.DoubleDouble) -> elliptic.Place:
    """Return (sine, cosine, 0, 0) of the phase x, in half turns; NEAR the separatrix, the result of `place_near`."""
    if kind == TUMBLING:
        s, c = elementary.sincos_half_turns(x[0], x[1])
        return (s, c, alike(s, 0.0), alike(s, 0.0))
    return elliptic.place_near(x, width)


@kernel
def turn_of(kind: float, place: elliptic.Place, psi: dd.DoubleDouble, shift: float, series: Series) -> Quaternion:
    """Return the quaternion Z(psi) Q(u), of any length.

    psi: the steady turn. shift x, with the phase x, is a further turn NEAR the separatrix. Both are half angles, in
    half turns.
    """
    if kind == TUMBLING:
        sin_v, cos_v, _, _ = place
        e, x_p, x_r, x_s = attitude(sin_v, cos_v, read_tumbling(series))
        s, c = elementary.sincos_half_turns(psi[0], psi[1])
    else:
        decayed, side, flip, rest = place
        e, x_p, x_r, x_s = attitude_near(decayed, side, read_near(series))
        x_p, x_r = flip * x_p, flip * x_r
        high, low = dd.two_sum(psi[0], shift * rest)
        s, c = elementary.sincos_half_turns(high, low + psi[1])
    return (c * e - s * x_s, c * x_p - s * x_r, c * x_r + s * x_p, c * x_s + s * e)


@kernel
def jacobi_of(kind: float, place: elliptic.Place, series: Series) -> tuple[float, float, float]:
    """Return (sn, cn, dn) at a place on the polhode."""
    if kind == TUMBLING:
        sin_v, cos_v, _, _ = place
        return elliptic.jacobi_from_theta(sin_v, cos_v, read_tumbling(series).jacobi)
    decayed, side, flip, _ = place
    sn, cn, dn = elliptic.jacobi_near(decayed, side, read_near(series).jacobi)
    return (flip * sn, flip * cn, dn)


@kernel
def attitude_near(e: float, side: float, series: NearSeries) -> tuple[float, float, float, float]:
    """Return (Re alpha, Re beta, Im beta, Im alpha) from e = exp(-2 |y|) and the sign of y."""
    (c_0, c_1, c_2, c_3), (s_0, s_1, s_2, s_3), (root_nome, _, _, _) = series
    p, f = root_nome / e, root_nome * e
    p_2, e_1 = p * p, e * f
    p_3, e_2 = p * p_2, e_1 * f
    e_3 = e_2 * f
    return (
        c_0 * (1.0 + e) + (c_1 * (p + e_1) + (c_2 * (p_2 + e_2) + c_3 * (p_3 + e_3))),
        side * (c_0 * (1.0 - e) - (c_1 * (p - e_1) - (c_2 * (p_2 - e_2) - c_3 * (p_3 - e_3)))),
        s_0 * (1.0 + e) - (s_1 * (p + e_1) - (s_2 * (p_2 + e_2) - s_3 * (p_3 + e_3))),
        side * (s_0 * (1.0 - e) + (s_1 * (p - e_1) + (s_2 * (p_2 - e_2) + s_3 * (p_3 - e_3)))),
    )


_LEVELS = 12
"""The largest number of levels of Landen's descent."""


@kernel(inline=False)
def series_of(kappa: float, tilt: float, k2: float, kc: float, sign: float) -> TumblingSeries:
    """Return the series for kc >= NEAREST_KC, k2 = 1 - kc^2; tilt: A_p / (A_s + G); sign: that of I_s - I_p."""
    q = elliptic.nome(k2 / (1.0 + kc), kc)
    q2 = q * q
    b_0, d_0, f, h = _exponentials(kappa, tilt, k2, kc, q)
    q4 = q2 * q2
    q8, q12 = q4 * q4, (q4 * q4) * q4
    # q^(2 n^2) (e^(2 n a') +- e^(-2 n a')), and q^(2 (n + 1/2)^2) (e^((2 n + 1) a') +- ...)
    up_2, down_2, up_3, down_3 = q4 * (h * h), q8 * (f * f), q12 * (h * h * h), q8 * q8 * q2 * (f * f * f)
    b_1, d_1, b_2, d_2 = q2 * h * b_0, q4 * f * d_0, q8 * (h * h) * b_0, q12 * (f * f) * d_0
    cosh_1, cosh_2, cosh_3 = h + q2 * f, up_2 + down_2, up_3 + down_3
    sinh_1, sinh_2, sinh_3 = h - q2 * f, up_2 - down_2, up_3 - down_3
    return TumblingSeries(
        (1.0 - cosh_2, 3.0 * cosh_3 - cosh_1, 2.0 * cosh_2, -4.0 * cosh_3),
        (-2.0 * sign * (sinh_1 - sinh_3), 4.0 * sign * sinh_2, -8.0 * sign * sinh_3),
        (
            sign * ((b_0 + d_0) - ((b_1 + d_1) + (b_2 + d_2))),
            2.0 * sign * ((b_2 + d_2) - (b_1 + d_1)),
            4.0 * sign * (b_2 + d_2),
        ),
        (((b_2 - d_2) - (b_1 - d_1)) - (b_0 - d_0), 2.0 * ((b_1 - d_1) + (b_2 - d_2)), -4.0 * (b_2 - d_2)),
        elliptic.theta_series_of(q),
    )


@kernel(inline=False)
def _exponentials(kappa: float, tilt: float, k2: float, kc: float, q: float) -> tuple[float, float, float, float]:
    """Return (sqrt(q / f), sqrt(q f), f, q^2 / f), f = exp(-2 a') = exp(-pi a / K), q / f <= 1.

    Landen's descent gives f from kappa, or q / f from rho by the same function. The one with the larger start is
    computed, and the other follows from it.
    """
    below, k = 2.0 * math.sqrt(kc) / (1.0 + kc), k2 / ((1.0 + kc) * (1.0 + kc))
    root = 1.0 + math.sqrt(1.0 + kappa)
    y = kappa / (root * root)
    by_tilt = y <= tilt * tilt
    shift = _root_of_shift(choose(by_tilt, tilt * tilt, y), k, below)
    up, f = tilt * shift, choose(by_tilt, 1.0, y * (shift * shift))
    inverse = choose(up < 1e-300, 0.0, 1.0 / choose(up < 1e-300, 1.0, up))  # for so small an up q is 0
    return (
        choose(by_tilt, up, math.sqrt(q / f)),
        choose(by_tilt, q * inverse, math.sqrt(q * f)),
        choose(by_tilt, q * inverse * inverse, f),
        choose(by_tilt, q * (up * up), q * (q / f)),
    )


@kernel(inline=False)
def _root_of_shift(y: float, k: float, kc: float) -> float:
    """Return sqrt(f / y), where Landen's descent y' = y (y + k) / (1 + k y) ends at f^(2^n); kc: complement of k.

    With s = cn(a, k'_0), y is (1 - s) / (1 + s), f = exp(-pi a / K), and k of the level below k_0 is at most 6 y.
    """
    is_zero = y == 0.0
    y = choose(is_zero, 1.0, y)
    t, product, levels = k / y, 1.0, 0.0
    for _ in range(_LEVELS):
        goes_on = t > 1e-17
        if not any_of(goes_on):
            break
        factor = (1.0 + t) / (1.0 + k * y)
        product = choose(goes_on, product * product * factor, product)
        y = choose(goes_on, y * y * factor, y)
        t = choose(goes_on, t * t / (factor * (1.0 + kc) * (1.0 + kc)), t)
        root = k / (1.0 + kc)
        k = choose(goes_on, root * root, k)
        kc = choose(goes_on, 2.0 * math.sqrt(kc) / (1.0 + kc), kc)
        levels = levels + choose(goes_on, 1.0, 0.0)
    product = math.sqrt(product)
    for level in range(_LEVELS):
        if not any_of(levels > level):
            break
        product = choose(levels > level, math.sqrt(product), product)
    return choose(is_zero, 1.0, product)


@kernel(inline=False)
def near_series_of(
    root_kappa: dd.DoubleDouble, kc: dd.DoubleDouble, agm: dd.DoubleDouble, sign: float
) -> tuple[NearSeries, dd.DoubleDouble, float]:
    """Return (series, W, shift): 2 y = W x ln 2 at the phase v = pi x; the angle 2 b v / pi is shift x half turns.

    root_kappa: sqrt(kappa); agm: AGM(1, kc), kc < NEAREST_KC; sign: that of I_s - I_p.
    """
    width, phase = elliptic.near_scale(kc, agm, (1.0, 0.0), root_kappa)
    near = elliptic.near_series(kc[0])
    q = near.root_nome
    q4 = (q * q) * (q * q)
    s, c = elementary.sincos_half_turns(-0.5 * phase[0], -0.5 * phase[1])
    twice = 2.0 * (c - s) * (c + s)
    c_1, s_1 = c * (twice - 1.0), s * (twice + 1.0)
    c_2, s_2 = twice * c_1 - c, twice * s_1 - s
    c_3, s_3 = twice * c_2 - c_1, twice * s_2 - s_1
    q9 = q4 * q4 * q
    jacobi = elliptic.Near(q, sign * near.sn, near.cn, near.dn)
    series = NearSeries((c, q * c_1, q4 * c_2, q9 * c_3), (s, q * s_1, q4 * s_2, q9 * s_3), jacobi)
    return series, dd.scale(sign, width), sign * phase[0]
