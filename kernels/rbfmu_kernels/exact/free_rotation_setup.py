"""Computes the constants of a free body's motion (notation: free_rotation.py), in double-double where t multiplies."""

import math
from typing import NamedTuple

from ..buffer_access import record
from ..compile.decorator import kernel
from ..compile.wide import alike, all_of, any_of, choose
from ..numerics import double_double as dd, elementary, elliptic
from ..numerics.double_double import ONE_OVER_PI, DoubleDouble, Vector, two_product, two_sum
from ..rotations.quaternion import compose_quaternions, invert_quaternion
from ..types import SHAPES, FreeRotationNumbers, Quaternion, Vec3
from . import free_rotation_series, uniform_rotation
from .free_rotation_series import NEAR, SEPARATRIX, STEADY, TUMBLING, Series, SteadyTurn


class Polhode(NamedTuple):
    """The constants of a polhode, which follow from the moments and the state.

    a_s: A_s. g: G. rate_s: A_s / I_s. precession: the rate of psi / (4 pi). phase_rate and phase: rate and start of the
    phase x / pi. half_turn: the further increase of psi / (4 pi) in half a turn of the phase. k2: k^2.
    agm: AGM(1, kc).
    """

    a_s: DoubleDouble
    g: float
    rate_s: DoubleDouble
    precession: DoubleDouble
    phase_rate: DoubleDouble
    phase: DoubleDouble
    half_turn: DoubleDouble
    k2: float
    agm: DoubleDouble


@kernel(inline=False)
def symmetric_polhode(
    i_r: DoubleDouble, i_s: DoubleDouble, w_s: DoubleDouble, m_s: DoubleDouble,
    a_p2: DoubleDouble, am_s: DoubleDouble, am_c: DoubleDouble,
) -> Polhode:  # fmt: skip
    """Return the polhode of two equal moments: sn, cn, dn are sin, cos, 1; I_s may be 0."""
    g = dd.root(dd.add(a_p2, dd.multiply(m_s, m_s)))
    rate = dd.divide(dd.multiply(g, uniform_rotation.ONE_OVER_4PI), i_r)
    lam = dd.divide(dd.multiply(gap(i_s, i_r), w_s), i_r)
    x = elliptic.angle_in_half_turns(am_s, am_c)
    nu = dd.multiply(lam, ONE_OVER_PI)
    zero, one = alike(g[0], 0.0), alike(g[0], 1.0)
    return Polhode(m_s, g[0], w_s, rate, nu, x, (alike(g[0], -0.25), zero), zero, (one, zero))


@kernel(inline=False)
def triaxial_polhode(
    moments_prs: Vector, kappa: DoubleDouble, one_kappa: DoubleDouble, a_p2: DoubleDouble, a_s2: DoubleDouble,
    kc: DoubleDouble, am_s: DoubleDouble, am_c: DoubleDouble,
) -> Polhode:  # fmt: skip
    """Return the polhode of three different moments."""
    i_p, i_r, i_s = moments_prs
    g2 = dd.add(a_p2, a_s2)
    g, a_s = dd.root(g2), dd.root(a_s2)
    rate_s = dd.divide(a_s, i_s)
    lam = dd.multiply(gap(i_s, i_r), gap(i_s, i_p))
    lam = dd.multiply(rate_s, dd.root(dd.divide(lam, dd.multiply(i_p, i_r))))
    rho, one_rho = dd.divide(a_p2, a_s2), dd.divide(g2, a_s2)
    middle = kappa[0] <= rho[0]
    n, one_n = dd.choose(middle, kappa, rho), dd.choose(middle, one_kappa, one_rho)
    one_other = dd.choose(middle, one_rho, one_kappa)
    energy = dd.add(dd.multiply(a_p2, i_s), dd.multiply(a_s2, i_p))
    over = dd.multiply(g, dd.multiply(i_p, i_s))
    rate = dd.divide(dd.choose(middle, g, energy), dd.choose(middle, i_r, over))
    y = dd.multiply(n, dd.root(dd.divide(one_other, one_n)))
    agm, total, x = elliptic.climb_scale(kc, n, am_s, am_c)
    # T over a half turn is pi y (2 - total) / (2 AGM).
    half_turn = dd.scale(0.125, dd.divide(dd.multiply(y, dd.add_float(dd.negate(total), 2.0)), agm))
    half_turn = dd.choose(middle, dd.add_float(half_turn, -0.25), dd.negate(half_turn))
    nu = dd.multiply(dd.multiply(lam, agm), ONE_OVER_PI)
    rate = dd.multiply(rate, uniform_rotation.ONE_OVER_4PI)
    return Polhode(a_s, g[0], rate_s, rate, nu, x, half_turn, kappa[0] * rho[0], agm)


@kernel
def kappa_of(i_p: DoubleDouble, i_r: DoubleDouble, i_s: DoubleDouble) -> dd.Two:
    """Return (kappa, 1 + kappa), kappa = I_s (I_r - I_p) / (I_p (I_s - I_r))."""
    if all_of(dd.equal(i_p, i_r)):
        zero, one = alike(i_p[0], 0.0), alike(i_p[0], 1.0)
        return ((zero, zero), (one, zero))
    kappa = dd.divide(dd.multiply(gap(i_r, i_p), i_s), dd.multiply(gap(i_s, i_r), i_p))
    return (kappa, dd.add_float(kappa, 1.0))


@kernel
def gap(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return |a - b|, which is exact for floats."""
    below = dd.less(a, b)
    return dd.subtract(dd.choose(below, b, a), dd.choose(below, a, b))


@kernel
def polhode_axes(moments: Vector, omega: Vector) -> tuple[float, float, float, DoubleDouble, float]:
    """Return (p, r, s, d, unit), the axes as numbers 0, 1, 2; d is 0 on the separatrix.

    d unit^2 = |w_hi^2 I_hi (I_hi - I_r) - w_lo^2 I_lo (I_r - I_lo)|; hi, lo: axes of the largest and least moment.
    """
    a, b, c = moments
    lo = choose(_at_most(a, b) & _at_most(a, c), 0.0, choose(_at_most(b, c), 1.0, 2.0))
    hi = choose(_at_most(a, c) & _at_most(b, c), 2.0, choose(_at_most(a, b), 1.0, 0.0))
    r = 3.0 - lo - hi
    w_lo, w_hi, i_lo, i_hi = component(omega, lo), component(omega, hi), component(moments, lo), component(moments, hi)
    up = elementary.power_of_two_for(max(abs(w_lo[0]), abs(w_hi[0])))
    w_lo, w_hi = dd.scale(up, w_lo), dd.scale(up, w_hi)
    above, below = gap(i_hi, component(moments, r)), gap(component(moments, r), i_lo)
    upper = dd.multiply(dd.multiply(dd.multiply(w_hi, w_hi), i_hi), above)
    lower = dd.multiply(dd.multiply(dd.multiply(w_lo, w_lo), i_lo), below)
    d = dd.subtract(upper, lower)
    rest = abs(w_hi[1]) + abs(w_lo[1]) + abs(a[1]) + abs(b[1]) + abs(c[1])
    too_few = (abs(d[0]) < 1e-8 * upper[0]) & (rest == 0.0)
    # Eight or more of 32 digits cancel, and too few are left. If all numbers are floats, the sum can be exact.
    if any_of(too_few):
        zero = alike(d[0], 0.0)
        sums = _add_exactly((zero, zero, zero, zero), w_hi[0], i_hi[0], above)
        sums = _add_exactly(sums, w_lo[0], -i_lo[0], below)
        d = dd.choose(too_few, dd.add(two_sum(sums[0], sums[1]), (sums[2], sums[3])), d)
    other = d[0] < 0.0
    p, s, d = choose(other, hi, lo), choose(other, lo, hi), dd.choose(other, dd.negate(d), d)
    other = dd.equal(component(moments, s), component(moments, r))
    return (choose(other, s, p), r, choose(other, p, s), d, 1.0 / up)


@kernel
def component(v: Vector, k: float) -> DoubleDouble:
    """Return component k, 0, 1 or 2, of a vector."""
    return dd.choose(k == 0.0, v[0], dd.choose(k == 1.0, v[1], v[2]))


@kernel
def _at_most(a: DoubleDouble, b: DoubleDouble) -> bool:
    return dd.less(a, b) | dd.equal(a, b)


_Sums = tuple[float, float, float, float]


@kernel(inline=False)
def _add_exactly(sums: _Sums, w: float, moment: float, gap: DoubleDouble) -> _Sums:
    """Return the running sum plus w^2 moment gap, to 212 bits: cascaded error-free sums of 16 exact products."""
    s_1, s_2, s_3, s_4 = sums
    for part in gap:
        for lever in two_product(moment, part):
            for square in two_product(w, w):
                for term in two_product(square, lever):
                    s_1, e = two_sum(s_1, term)
                    s_2, e = two_sum(s_2, e)
                    s_3, e = two_sum(s_3, e)
                    s_4 += e
    return (s_1, s_2, s_3, s_4)


Columns = tuple[Quaternion, Quaternion, Quaternion, Quaternion]


class FreeRotation(NamedTuple):
    """The constants of one motion.

    kind: TUMBLING, STEADY, NEAR the separatrix or on it (SEPARATRIX). unit: the unit of all rates, 1/s.
    precession: the rate of psi / (4 pi). phase_rate and phase: rate and start of the polhode's phase in half turns, the
    rate halved. rates and rates_low: the largest rates about p, r, s, signed as along the body axes, and their low
    parts. kc_squared: the complementary modulus squared. width and shift: arguments of `place_near` and `turn_of` NEAR
    the separatrix. columns: the products of the attitude's constant first factor with 1, i_p, i_r, i_s, in body axes.
    p and r: which body axes these are, as numbers 1, 2, 3.
    """

    kind: float
    unit: float
    precession: DoubleDouble
    phase_rate: DoubleDouble
    phase: DoubleDouble
    rates: Vec3
    rates_low: Vec3
    kc_squared: DoubleDouble
    width: DoubleDouble
    shift: float
    columns: Columns
    p: float
    r: float
    series: Series


FREE_ROTATION_SIZE, put_free_rotation, read_free_rotation, flatten_free_rotation = record(FreeRotation)
SHAPES[FreeRotationNumbers] = (FREE_ROTATION_SIZE,)

_LEAST_KC = 1e-300
"""Below this a motion counts as on the separatrix: K(k) = ln(4 / kc), so a turn takes 690 time scales or more."""
_NONE: DoubleDouble = (0.0, 0.0)


@kernel(inline=False)
def steady_setup(q_0: Quaternion, omega: Vector, unit: float) -> FreeRotation:
    """Set up a constant rate: about a principal axis, across a symmetric body's axis, about any axis of a sphere."""
    (x, _), (y, _), (w, _) = omega
    axis, rate = uniform_rotation.turning_about(omega)
    return FreeRotation(
        kind=STEADY, unit=unit, precession=rate, phase_rate=_NONE, phase=_NONE, rates=(unit * x, unit * y, unit * w),
        rates_low=(0.0, 0.0, 0.0), kc_squared=(1.0, 0.0), width=_NONE, shift=0.0,
        columns=_columns(q_0, (1.0, 1.0, 1.0), 1.0, 2.0), p=1.0, r=2.0,
        series=free_rotation_series.flatten_steady(SteadyTurn(axis)),
    )  # fmt: skip


@kernel(inline=False)
def tumbling_setup(moments: Vector, q_0: Quaternion, omega: Vector, unit: float) -> FreeRotation:
    """Set up any other motion.

    moments and omega are scaled to about 1; `unit` undoes the scaling of omega.
    """
    p, r, s, distance, distance_unit = polhode_axes(moments, omega)
    i_p, i_r, i_s = component(moments, p), component(moments, r), component(moments, s)
    w_p, w_r, w_s = component(omega, p), component(omega, r), component(omega, s)
    exists = (i_p[0] > 0.0) & (i_r[0] > 0.0) & ((i_s[0] > 0.0) | dd.equal(i_p, i_r))
    nothing = (math.nan, math.nan)
    i_p, i_r = dd.choose(exists, i_p, nothing), dd.choose(exists, i_r, nothing)
    i_s, unit = dd.choose(exists, i_s, nothing), choose(exists, unit, math.nan)
    sign = choose(dd.less(i_p, i_s), 1.0, -1.0)
    sign_p = math.copysign(1.0, w_p[0])
    sign_s = math.copysign(1.0, w_s[0])
    sign_r = sign_p * sign_s * choose((r - p == 1.0) | (r - p == -2.0), 1.0, -1.0)
    w_p, w_r, w_s = dd.scale(sign_p, w_p), dd.scale(sign_r, w_r), dd.scale(sign_s, w_s)

    kappa, one_kappa = kappa_of(i_p, i_r, i_s)
    across = _momentum_across(i_p, i_r, w_p, w_r, one_kappa)
    polhode, kc, kc2 = _polhode_of((i_p, i_r, i_s), w_s, across, kappa, one_kappa, distance, distance_unit)
    kind, precession, width, shift, series = _periodic_part(polhode, kappa, kc, across.a_p, sign)
    phase = dd.scale(sign * math.copysign(1.0, across.m_r[0]), polhode.phase)
    a_r = dd.scale(sign, dd.multiply(dd.root(one_kappa), across.a_p))
    rate_p = dd.scale(unit * sign_p, dd.divide(across.a_p, i_p))  # A_p itself may be too small for the unit
    rate_r = dd.scale(unit * sign_r, dd.divide(a_r, i_r))
    rate_s = dd.scale(unit * sign_s, polhode.rate_s)
    q = (q_0[0], sign_p * _at(q_0, p), sign_r * _at(q_0, r), sign_s * _at(q_0, s))
    place = free_rotation_series.place_of(kind, phase, width)
    start = free_rotation_series.turn_of(kind, place, (0.0, 0.0), shift, series)
    q = compose_quaternions(q, invert_quaternion(start))
    half_rate = (0.5 * polhode.phase_rate[0], 0.5 * polhode.phase_rate[1])
    return FreeRotation(
        kind=kind, unit=unit, precession=precession, phase_rate=half_rate, phase=phase,
        rates=(rate_p[0], rate_r[0], rate_s[0]), rates_low=(rate_p[1], rate_r[1], rate_s[1]), kc_squared=kc2,
        width=width, shift=shift, columns=_columns(q, (sign_p, sign_r, sign_s), p + 1.0, r + 1.0), p=p + 1.0,
        r=r + 1.0, series=series,
    )  # fmt: skip


class _Across(NamedTuple):
    """The angular momentum across s: A_p, A_p^2, m_r^2 / (1 + kappa); m_r and m_p sqrt(1 + kappa) in any unit."""

    a_p: DoubleDouble
    a_p2: DoubleDouble
    m_r2: DoubleDouble
    m_r: DoubleDouble
    am_c: DoubleDouble


@kernel
def _momentum_across(
    i_p: DoubleDouble, i_r: DoubleDouble, w_p: DoubleDouble, w_r: DoubleDouble, one_kappa: DoubleDouble
) -> _Across:
    """Return what follows from the rates along p and r, which may both be tiny: a power of two scales them first."""
    up = elementary.power_of_two_for(max(w_p[0], abs(w_r[0])))
    m_p, m_r, down = dd.multiply(i_p, dd.scale(up, w_p)), dd.multiply(i_r, dd.scale(up, w_r)), 1.0 / up
    m_r2 = dd.divide(dd.multiply(m_r, m_r), one_kappa)
    a_p2 = dd.add(dd.multiply(m_p, m_p), m_r2)
    return _Across(
        a_p=dd.scale(down, dd.root(a_p2)), a_p2=dd.scale(down, dd.scale(down, a_p2)),
        m_r2=dd.scale(down, dd.scale(down, m_r2)), m_r=m_r, am_c=dd.multiply(dd.root(one_kappa), m_p),
    )  # fmt: skip


@kernel
def _polhode_of(
    moments_prs: Vector, w_s: DoubleDouble, across: _Across, kappa: DoubleDouble, one_kappa: DoubleDouble,
    distance: DoubleDouble, distance_unit: float,
) -> tuple[Polhode, DoubleDouble, DoubleDouble]:  # fmt: skip
    """Return the polhode, and kc and its square, which `distance` from the separatrix gives without cancellation."""
    i_p, i_r, i_s = moments_prs
    m_s, am_s = dd.multiply(i_s, w_s), dd.scale(math.copysign(1.0, across.m_r[0]), across.m_r)
    if all_of(dd.equal(i_p, i_r)):
        polhode = symmetric_polhode(i_r, i_s, w_s, m_s, across.a_p2, am_s, across.am_c)
        kc: DoubleDouble = (1.0, 0.0)
        kc2 = kc
    else:
        a_s2 = dd.add(dd.multiply(m_s, m_s), dd.multiply(kappa, across.m_r2))
        kc2 = dd.divide(dd.multiply(distance, i_s), dd.multiply(gap(i_s, i_r), a_s2))
        kc = dd.scale(distance_unit, dd.root(kc2))
        kc2 = dd.scale(distance_unit, dd.scale(distance_unit, kc2))
        above = kc[0] - 1.0 + kc[1] > 0.0
        kc, kc2 = dd.choose(above, (1.0, 0.0), kc), dd.choose(above, (1.0, 0.0), kc2)
        kc = dd.choose(kc[0] <= _LEAST_KC, (_LEAST_KC, 0.0), kc)
        polhode = triaxial_polhode(moments_prs, kappa, one_kappa, across.a_p2, a_s2, kc, am_s, across.am_c)
    return polhode, kc, kc2


@kernel
def _periodic_part(
    polhode: Polhode, kappa: DoubleDouble, kc: DoubleDouble, a_p: DoubleDouble, sign: float
) -> tuple[float, DoubleDouble, DoubleDouble, float, Series]:
    """Return kind, precession, width, shift and series of `FreeRotation`."""
    kind, width, shift, precession = TUMBLING, (0.0, 0.0), 0.0, polhode.precession
    besides = dd.multiply(dd.scale(sign, polhode.half_turn), polhode.phase_rate)
    if all_of(kc[0] >= elliptic.NEAREST_KC):
        g = choose(polhode.g > 0.0, polhode.g, a_p[0])  # it is a root of squares, and these may underflow
        tilt = a_p[0] / (polhode.a_s[0] + g)
        tumbling = free_rotation_series.series_of(kappa[0], tilt, polhode.k2, kc[0], sign)
        series = free_rotation_series.flatten_tumbling(tumbling)
        precession = dd.add(precession, besides)
    else:
        kind = NEAR
        near, width, shift = free_rotation_series.near_series_of(dd.root(kappa), kc, polhode.agm, sign)
        series = free_rotation_series.flatten_near(near)
        if all_of(kc[0] > _LEAST_KC):
            precession = dd.add(precession, besides)
        else:
            kind, shift = SEPARATRIX, 0.0
    return kind, precession, width, shift, series


@kernel
def _at(q: Quaternion, k: float) -> float:
    """Return component k, 0, 1 or 2, of a quaternion's vector part."""
    return choose(k == 0.0, q[1], choose(k == 1.0, q[2], q[3]))


@kernel(inline=False)
def _columns(q: Quaternion, signs: Vec3, p: float, r: float) -> Columns:
    """Return the products q o (1, i_p, i_r, i_s) in body axes; signs: those of p, r, s along the body axes."""
    (a, x, y, z), (on_p, on_r, on_s) = q, signs
    return (
        (a, *in_body_axes((on_p * x, on_r * y, on_s * z), p, r)),
        (-x, *in_body_axes((on_p * a, on_r * z, -on_s * y), p, r)),
        (-y, *in_body_axes((-on_p * z, on_r * a, on_s * x), p, r)),
        (-z, *in_body_axes((on_p * y, -on_r * x, on_s * a), p, r)),
    )


@kernel
def in_body_axes(v: Vec3, p: float, r: float) -> Vec3:
    """Return v, given along p, r and s, in body axes; p, r: which body axes these are, as numbers 1, 2, 3."""
    return (
        choose(p == 1.0, v[0], choose(r == 1.0, v[1], v[2])),
        choose(p == 2.0, v[0], choose(r == 2.0, v[1], v[2])),
        choose(p == 3.0, v[0], choose(r == 3.0, v[1], v[2])),
    )
