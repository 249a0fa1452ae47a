"""The coefficients of `free_rotation_series`, once for a body's motion.

kc is the complementary modulus, k k = kappa rho.
"""

import math

from ..compile.decorator import kernel
from ..compile.wide import any_of, choose
from ..numerics.double_double import DoubleDouble, dd_scale
from ..numerics.elementary import sincos_half_turns
from ..numerics.jacobi_theta import Near, near_scale, near_series, nome, theta_series_of
from .free_rotation_series import (
    AttitudeSeries,
    NearAttitudeSeries,
    NearSeries,
    TumblingSeries,
)

_LEVELS = 12
"""Of Landen's descent, at most."""


@kernel(inline=False)
def series_of(kappa: float, tilt: float, k2: float, kc: float, sign: float) -> TumblingSeries:
    """Return the series of kc >= NEAREST_KC, k2 = 1 - kc^2; tilt: A_p / (A_s + G); sign of I_s - I_p."""
    q = nome(k2 / (1.0 + kc), kc)
    q2 = q * q
    b_0, d_0, f, h = _exponentials(kappa, tilt, k2, kc, q)
    q4 = q2 * q2
    q8, q12 = q4 * q4, (q4 * q4) * q4
    # q^(2 n^2) (e^(2 n a') +- e^(-2 n a')), and q^(2 (n + 1/2)^2) (e^((2 n + 1) a') +- ...)
    up_2, down_2, up_3, down_3 = q4 * (h * h), q8 * (f * f), q12 * (h * h * h), q8 * q8 * q2 * (f * f * f)
    b_1, d_1, b_2, d_2 = q2 * h * b_0, q4 * f * d_0, q8 * (h * h) * b_0, q12 * (f * f) * d_0
    cosh_1, cosh_2, cosh_3 = h + q2 * f, up_2 + down_2, up_3 + down_3
    sinh_1, sinh_2, sinh_3 = h - q2 * f, up_2 - down_2, up_3 - down_3
    attitude = AttitudeSeries(
        1.0 - cosh_2, 3.0 * cosh_3 - cosh_1, 2.0 * cosh_2, -4.0 * cosh_3,
        -2.0 * sign * (sinh_1 - sinh_3), 4.0 * sign * sinh_2, -8.0 * sign * sinh_3,
        sign * ((b_0 + d_0) - ((b_1 + d_1) + (b_2 + d_2))),
        2.0 * sign * ((b_2 + d_2) - (b_1 + d_1)), 4.0 * sign * (b_2 + d_2),
        ((b_2 - d_2) - (b_1 - d_1)) - (b_0 - d_0), 2.0 * ((b_1 - d_1) + (b_2 - d_2)), -4.0 * (b_2 - d_2),
    )  # fmt: skip
    return TumblingSeries(attitude, theta_series_of(q))


@kernel(inline=False)
def _exponentials(kappa: float, tilt: float, k2: float, kc: float, q: float) -> tuple[float, float, float, float]:
    """Return (sqrt(q / f), sqrt(q f), f, q^2 / f), f = exp(-2 a') = exp(-pi a / K), q / f <= 1.

    By that of f, from kappa, and q / f, from rho, which has the larger start: the same function of both.
    """
    below, k = 2.0 * math.sqrt(kc) / (1.0 + kc), k2 / ((1.0 + kc) * (1.0 + kc))
    root = 1.0 + math.sqrt(1.0 + kappa)
    y = kappa / (root * root)
    by_tilt = y <= tilt * tilt
    shift = _root_of_shift(choose(by_tilt, tilt * tilt, y), k, below)
    up, f = tilt * shift, choose(by_tilt, 1.0, y * (shift * shift))
    inverse = choose(up == 0.0, 0.0, 1.0 / choose(up == 0.0, 1.0, up))
    return (
        choose(by_tilt, up, math.sqrt(q / f)),
        choose(by_tilt, q * inverse, math.sqrt(q * f)),
        choose(by_tilt, q * inverse * inverse, f),
        choose(by_tilt, q * (up * up), q * (q / f)),
    )


@kernel(inline=False)
def _root_of_shift(y: float, k: float, kc: float) -> float:
    """Return sqrt(f / y), where Landen's descent y' = y (y + k) / (1 + k y) ends at f^(2^n); kc is that of k.

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
    root_kappa: DoubleDouble, kc: DoubleDouble, agm: DoubleDouble, sign: float
) -> tuple[NearSeries, DoubleDouble, float]:
    """Return (series, W, shift): 2 y = W x ln 2 at the phase v = pi x; the angle 2 b v / pi is shift x half turns.

    root_kappa: sqrt(kappa); agm: AGM(1, kc), kc < NEAREST_KC; sign of I_s - I_p.
    """
    one: DoubleDouble = (1.0, 0.0)
    width, phase = near_scale(kc, agm, one, root_kappa)
    near = near_series(kc[0])
    q = near.root_nome
    q4 = (q * q) * (q * q)
    s, c = sincos_half_turns(-0.5 * phase[0], -0.5 * phase[1])
    twice = 2.0 * (c - s) * (c + s)
    c_1, s_1 = c * (twice - 1.0), s * (twice + 1.0)
    c_2, s_2 = twice * c_1 - c, twice * s_1 - s
    c_3, s_3 = twice * c_2 - c_1, twice * s_2 - s_1
    q9 = q4 * q4 * q
    attitude = NearAttitudeSeries(c, q * c_1, q4 * c_2, q9 * c_3, s, q * s_1, q4 * s_2, q9 * s_3)
    series = NearSeries(attitude, Near(q, sign * near.sn, near.cn, near.dn))
    return series, dd_scale(sign, width), sign * phase[0]
