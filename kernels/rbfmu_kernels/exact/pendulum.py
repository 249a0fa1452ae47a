"""Exact motion of an undamped plane pendulum, phi'' = -w_0^2 sin phi: it swings, turns over, rests or nears the top.

With W^2 = (w_0 sin(phi / 2))^2 + (phi' / 2)^2, constant, and Jacobi's functions of modulus k at u (DLMF 22.19(i)):
swinging, W < w_0: u' = w_0, k = W / w_0, (sin, cos)(phi / 2) = (k sn, dn), phi' = 2 W cn;
turning over, W >= w_0: u' = W, k = w_0 / W, (sin, cos)(phi / 2) = (sn, cn), phi' = 2 W dn, or both mirrored.
Numbers that grow with time are double-double, so the error does not grow, except near the separatrix. Tiny swings keep
all their digits.
"""

import math
from typing import NamedTuple

from ..buffer_access import record
from ..compile.decorator import kernel
from ..numerics import double_double as dd, elementary, elliptic
from ..numerics.double_double import ONE_OVER_PI, DoubleDouble
from .uniform_rotation import without_turns

Series = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""The numbers of a `Theta`, or of a `NearSeries`, filled up with zeros."""


class NearSeries(NamedTuple):
    """Jacobi's functions near the separatrix, and the width for `place_near`."""

    jacobi: elliptic.Near
    width: DoubleDouble


class Pendulum(NamedTuple):
    """The constants of one motion.

    kind: ORDINARY, NEAR the separatrix or on it (SEPARATRIX). swings: 1, or 0 where it turns over. amplitude:
    sin(phi / 2) over sn. fastest: the largest phi', with its sign where it turns over. phase_rate and phase: rate and
    start of the phase v / (2 pi).
    """

    kind: float
    swings: float
    amplitude: float
    fastest: float
    phase_rate: DoubleDouble
    phase: DoubleDouble
    series: Series


PENDULUM_SIZE, put_pendulum, read_pendulum, _ = record(Pendulum)
_theta = record(elliptic.Theta)
_read_theta, _flatten_theta = _theta[2:]
_read_near, _flatten_near = record(NearSeries, _theta.size)[2:]
ORDINARY, NEAR, SEPARATRIX = 0.0, 1.0, 2.0
_LEAST_KC = 1e-300
"""Below this a motion counts as on the separatrix: K(k) = ln(4 / kc), so a turn takes 690 time scales or more."""
_MAX_TURNS = 1e28  # turns of the phase from which on double-double has no digit left
_LAST_TURN = 0.2167123282101497  # u = 600 on the separatrix: from there on the body rests at the top, to 1e-260


@kernel(inline=False)
def pendulum_setup(x: DoubleDouble, y: DoubleDouble, z: DoubleDouble) -> Pendulum:
    """Return the constants of the motion from (x, z) = w_0 (sin, cos)(phi / 2) and y = phi' / 2, in 1/s; z >= 0."""
    side, sign = math.copysign(1.0, x[0]), math.copysign(1.0, y[0])
    gap = dd.subtract(z, dd.scale(sign, y))
    swings = gap[0] > 0.0
    w_0, w = _length(x, z), _length(x, y)
    fastest = w_0 if swings else w
    kc = _complementary_modulus(gap, dd.add(dd.scale(sign, y), z), fastest)
    kind = (ORDINARY if kc[0] >= elliptic.NEAREST_KC else NEAR) if kc[0] >= _LEAST_KC else SEPARATRIX
    kc = kc if kind != SEPARATRIX else (_LEAST_KC, 0.0)
    agm, half_turns = _climb(kc, dd.scale(side, x), dd.scale(sign, y) if swings else z)
    if swings and sign < 0.0:
        half_turns = dd.add_float(dd.negate(half_turns), 1.0)
    start = dd.scale(0.5 * side * (1.0 if swings else sign), half_turns)
    rate = dd.scale(0.5, dd.multiply(dd.multiply(fastest, agm), ONE_OVER_PI))
    if y[0] == 0.0 and z[0] == 0.0:  # balanced at the top
        rate, w = (0.0, 0.0), (0.0, 0.0)
    series = _flatten_theta(elliptic.theta_series(kc)) if kind == ORDINARY else _flatten_near(_near_series(kc, agm))
    if swings:
        return Pendulum(kind, 1.0, w[0] / w_0[0], 2.0 * w[0], rate, start, series)
    return Pendulum(kind, 0.0, sign, sign * 2.0 * w[0], rate, start, series)


@kernel(inline=False)
def half_angle_rates(a: DoubleDouble, b: DoubleDouble) -> dd.Two:
    """Return w_0 (sin, cos)(phi / 2) at the start, 1/s, the second >= 0; both are 0 where half of w_0^2 is 0.

    a, b: 1/s^2, such that phi'' = a cos theta + b sin theta after a turn by theta from the start.
    """
    large = dd.root(dd.scale(0.5, dd.add(_length(a, b), dd.scale(math.copysign(1.0, b[0]), b))))
    if large[0] == 0.0:
        return (0.0, 0.0), (0.0, 0.0)
    small = dd.divide(dd.scale(-0.5, a), large)
    if b[0] > 0.0:
        side = math.copysign(1.0, small[0])
        return dd.scale(side, large), dd.scale(side, small)
    return small, large


@kernel
def sincos_of_half_angle(x: DoubleDouble, z: DoubleDouble) -> tuple[float, float]:
    """Return (sin, cos)(phi / 2) from (x, z) = w_0 (sin, cos)(phi / 2); (0, 1) where w_0 = 0."""
    w_0 = _length(x, z)
    return (0.0, 1.0) if w_0[0] == 0.0 else (dd.divide(x, w_0)[0], dd.divide(z, w_0)[0])


@kernel
def pendulum_at(setup: Pendulum, t: DoubleDouble) -> tuple[float, float, float]:
    """Return (sin(phi / 2), cos(phi / 2), phi'), the last in rad/s, at a time t after the start, s.

    Error <= 4 eps of the largest size of each. Near the separatrix the error of cos(phi / 2) and of phi' / (2 w_0) is
    4 eps of the length of both together, and on it 4 (w_0 |t| + 1) eps. Near it the complementary modulus kc is small,
    and differences in double-double give kc^2 only to some 1e-32, so 1e-32 w_0 |t| / kc^2 is added. Beyond 1e14 turns
    3e-31 a turn is added; NaN beyond 1e28 turns.
    """
    kind, swings, amplitude, fastest, rate, start, series = setup
    if kind == ORDINARY:
        high, low = _phase(rate, start, t)
        s, c = elementary.sincos_half_turns(high, low)
        sn, cn, dn = elliptic.jacobi_from_theta(s, c, _read_theta(series))
    else:
        sn, cn, dn = _near(kind, rate, start, _read_near(series), t)
    if swings != 0.0:
        return amplitude * sn, dn, fastest * cn
    return amplitude * sn, cn, fastest * dn


@kernel
def _phase(rate: DoubleDouble, start: DoubleDouble, t: DoubleDouble) -> DoubleDouble:
    """Return the phase in half turns."""
    high, low = t
    high = high if abs(rate[0] * high) < _MAX_TURNS else math.nan
    return dd.scale(2.0, dd.add(without_turns(rate, (high, low)), start))


@kernel(inline=False)
def _near(
    kind: float, rate: DoubleDouble, start: DoubleDouble, series: NearSeries, t: DoubleDouble
) -> tuple[float, float, float]:
    """Return (sn, cn, dn) near the separatrix."""
    if kind == SEPARATRIX:
        x: DoubleDouble = (2.0 * min(max(rate[0] * t[0] + start[0], -_LAST_TURN), _LAST_TURN), 0.0)
    else:
        x = _phase(rate, start, t)
    e, side, flip, _ = elliptic.place_near(x, series.width)
    sn, cn, dn = elliptic.jacobi_near(e, side, series.jacobi)
    return flip * sn, flip * cn, dn


@kernel
def _near_series(kc: DoubleDouble, agm: DoubleDouble) -> NearSeries:
    width, _ = elliptic.near_scale(kc, agm, (0.0, 0.0), (1.0, 0.0))
    return NearSeries(elliptic.near_series(kc[0]), width)


@kernel
def _length(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return sqrt(a^2 + b^2)."""
    up = elementary.power_of_two_for(max(abs(a[0]), abs(b[0])))
    a, b = dd.scale(up, a), dd.scale(up, b)
    return dd.scale(1.0 / up, dd.root(dd.add(dd.multiply(a, a), dd.multiply(b, b))))


@kernel
def _complementary_modulus(gap: DoubleDouble, total: DoubleDouble, fastest: DoubleDouble) -> DoubleDouble:
    """Return sqrt |gap total| / fastest, at most 1; 1 where nothing moves or acts."""
    if fastest[0] == 0.0:
        return 1.0, 0.0
    root = dd.multiply(dd.root(dd.scale(math.copysign(1.0, gap[0]), gap)), dd.root(total))
    kc = dd.divide(root, fastest)
    return kc if kc[0] - 1.0 + kc[1] < 0.0 else (1.0, 0.0)


@kernel
def _climb(kc: DoubleDouble, s: DoubleDouble, c: DoubleDouble) -> dd.Two:
    """Return AGM(1, kc), and the phase in half turns where tan am = s / c, s and c >= 0; it is 0 if both are 0."""
    up = elementary.power_of_two_for(max(s[0], c[0]))
    c = dd.scale(up, c) if max(s[0], c[0]) > 0.0 else (1.0, 0.0)
    agm, _, half_turns = elliptic.climb_scale(kc, (0.0, 0.0), dd.scale(up, s), c)
    return agm, half_turns
