"""A free body's attitude, and its sn, cn, dn, at a place on the polhode: short series of Jacobi's theta functions.

At u, phase v = pi u / 2K, and with a' = pi a / 2K, sn(a, k') = 1 / sqrt(1 + kappa) (notation: free_rotation.py),
    alpha = theta_4(v + i a' | q^2), beta = theta_1(v + i a' | q^2)
are, but for signs and their common length, e + i z and x + i y of the quaternion that turns the angular momentum's axes
to the body's, less its steady turn about the momentum.  For by the addition theorem |alpha|^2 +- |beta|^2 are
(theta_4^2 +- theta_1^2)(v), each times a constant, by Landen's transformation dn is the quotient of these, and so
(|alpha|^2 - |beta|^2) / (|alpha|^2 + |beta|^2) = A_s dn / G.  Jacobi (1849) has direction cosines as such quotients.
Sources: Whittaker & Watson, ch. 21; DLMF 20.2, 20.7, 22.7.

`NEAR` the separatrix by Jacobi's imaginary transformation: theta_2 and i theta_1 of b - i y, b = pi a / 4K',
y = pi u / 4K', of nome exp(-pi K / 2K'), as series in e = exp(-2 |y|) and p = nome / e, and exp(-2 i b v / pi) besides.
"""

from typing import NamedTuple

from ..compile.decorator import kernel
from ..compile.wide import alike
from ..numerics.double_double import DoubleDouble, two_sum
from ..numerics.elementary import sincos_half_turns
from ..numerics.jacobi_theta import Near, Theta, jacobi_from_theta, jacobi_near, place_near
from ..numerics.jacobi_theta import Place as Place
from ..records import record
from ..types import Quaternion, Vec3

TUMBLING, STEADY, SEPARATRIX, NEAR = 0.0, 1.0, 2.0, 3.0

Series = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float,
    float, float, float, float, float, float, float, float, float, float, float, float,
]  # fmt: skip
"""The numbers of a `TumblingSeries`, a `NearSeries` or a `SteadyTurn`; what the last two do not need is 0."""


class AttitudeSeries(NamedTuple):
    """Coefficients in c = cos 2v: of Re alpha, of Im alpha / (sin v cos v), of Re beta / sin v, of Im beta / cos v."""

    re_alpha_0: float
    re_alpha_1: float
    re_alpha_2: float
    re_alpha_3: float
    im_alpha_0: float
    im_alpha_1: float
    im_alpha_2: float
    re_beta_0: float
    re_beta_1: float
    re_beta_2: float
    im_beta_0: float
    im_beta_1: float
    im_beta_2: float


class NearAttitudeSeries(NamedTuple):
    """Coefficients of theta_2 (even) and theta_1 (odd): cosines and sines of multiples of b, by powers of the nome."""

    even_0: float
    even_1: float
    even_2: float
    even_3: float
    odd_0: float
    odd_1: float
    odd_2: float
    odd_3: float


class TumblingSeries(NamedTuple):
    """The series away from the separatrix."""

    attitude: AttitudeSeries
    jacobi: Theta


class NearSeries(NamedTuple):
    """The series near the separatrix."""

    attitude: NearAttitudeSeries
    jacobi: Near


class SteadyTurn(NamedTuple):
    """The constants of a steady motion: its axis in b."""

    axis: Vec3


_SIZE, _, read_tumbling, flatten_tumbling = record(TumblingSeries)
_, _, read_near, flatten_near = record(NearSeries, _SIZE)
_, _, read_steady, flatten_steady = record(SteadyTurn, _SIZE)


@kernel
def attitude(sin_v: float, cos_v: float, series: AttitudeSeries) -> tuple[float, float, float, float]:
    """Return (Re alpha, Re beta, Im beta, Im alpha) at the phase v."""
    a_0, a_1, a_2, a_3, i_0, i_1, i_2, b_0, b_1, b_2, j_0, j_1, j_2 = series
    c = (cos_v - sin_v) * (cos_v + sin_v)
    return (
        a_0 + c * (a_1 + c * (a_2 + c * a_3)),
        sin_v * (b_0 + c * (b_1 + c * b_2)),
        cos_v * (j_0 + c * (j_1 + c * j_2)),
        sin_v * cos_v * (i_0 + c * (i_1 + c * i_2)),
    )


@kernel
def place_of(kind: float, x: DoubleDouble, width: DoubleDouble) -> Place:
    """Return sine and cosine of the phase x, in half turns, or, NEAR, what `place_near` says."""
    if kind == TUMBLING:
        s, c = sincos_half_turns(x[0], x[1])
        return (s, c, alike(s, 0.0), alike(s, 0.0))
    return place_near(x, width)


@kernel
def turn_of(kind: float, place: Place, psi: DoubleDouble, shift: float, series: Series) -> Quaternion:
    """Return the quaternion, of any length.

    psi is the steady turn, shift x what NEAR adds; half angles are in half turns.
    """
    if kind == TUMBLING:
        sin_v, cos_v, _, _ = place
        e, x_p, x_r, x_s = attitude(sin_v, cos_v, read_tumbling(series).attitude)
        s, c = sincos_half_turns(psi[0], psi[1])
    else:
        decayed, side, flip, rest = place
        e, x_p, x_r, x_s = attitude_near(decayed, side, read_near(series))
        x_p, x_r = flip * x_p, flip * x_r
        high, low = two_sum(psi[0], shift * rest)
        s, c = sincos_half_turns(high, low + psi[1])
    return (c * e - s * x_s, c * x_p - s * x_r, c * x_r + s * x_p, c * x_s + s * e)


@kernel
def jacobi_of(kind: float, place: Place, series: Series) -> tuple[float, float, float]:
    """Return (sn, cn, dn)."""
    if kind == TUMBLING:
        sin_v, cos_v, _, _ = place
        return jacobi_from_theta(sin_v, cos_v, read_tumbling(series).jacobi)
    decayed, side, flip, _ = place
    sn, cn, dn = jacobi_near(decayed, side, read_near(series).jacobi)
    return (flip * sn, flip * cn, dn)


@kernel
def attitude_near(e: float, side: float, series: NearSeries) -> tuple[float, float, float, float]:
    """Return (Re alpha, Re beta, Im beta, Im alpha) from e = exp(-2 |y|) and the sign of y."""
    c_0, c_1, c_2, c_3, s_0, s_1, s_2, s_3 = series.attitude
    root_nome = series.jacobi.root_nome
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
