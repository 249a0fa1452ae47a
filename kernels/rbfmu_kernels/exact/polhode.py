"""The polhode of a free body: sizes, rates and phase of its angular momentum as the body sees it (free_rotation.py)."""

from typing import NamedTuple

from ..compile.decorator import kernel
from ..compile.wide import alike, all_of, any_of, choose
from ..numerics.agm import angle_in_half_turns, climb_scale
from ..numerics.double_double import (
    DoubleDouble,
    Vector,
    dd_add,
    dd_add_float,
    dd_choose,
    dd_divide,
    dd_equal,
    dd_less,
    dd_multiply,
    dd_negate,
    dd_scale,
    dd_sqrt,
    dd_subtract,
    two_product,
    two_sum,
)
from ..numerics.scaling import power_of_two_for
from .uniform_rotation import ONE_OVER_4PI

_ONE_OVER_PI: DoubleDouble = (0.3183098861837907, -1.9678676675182486e-17)


class Polhode(NamedTuple):
    """What the moments and the state make of it.

    a_s: A_s. g: G. rate_s: A_s / I_s. precession: the rate of psi / (4 pi). phase_rate and phase: rate and start of the
    phase x / pi. half_turn: psi / (4 pi) besides in half a turn of the phase. k2: k^2. agm: AGM(1, kc).
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
    g = dd_sqrt(dd_add(a_p2, dd_multiply(m_s, m_s)))
    rate = dd_divide(dd_multiply(g, ONE_OVER_4PI), i_r)
    lam = dd_divide(dd_multiply(gap(i_s, i_r), w_s), i_r)
    x = angle_in_half_turns(am_s, am_c)
    nu = dd_multiply(lam, _ONE_OVER_PI)
    zero, one = alike(g[0], 0.0), alike(g[0], 1.0)
    return Polhode(m_s, g[0], w_s, rate, nu, x, (alike(g[0], -0.25), zero), zero, (one, zero))


@kernel(inline=False)
def triaxial_polhode(
    moments_prs: Vector, kappa: DoubleDouble, one_kappa: DoubleDouble, a_p2: DoubleDouble, a_s2: DoubleDouble,
    kc: DoubleDouble, am_s: DoubleDouble, am_c: DoubleDouble,
) -> Polhode:  # fmt: skip
    """Return the polhode of three different moments."""
    i_p, i_r, i_s = moments_prs
    g2 = dd_add(a_p2, a_s2)
    g, a_s = dd_sqrt(g2), dd_sqrt(a_s2)
    rate_s = dd_divide(a_s, i_s)
    lam = dd_multiply(gap(i_s, i_r), gap(i_s, i_p))
    lam = dd_multiply(rate_s, dd_sqrt(dd_divide(lam, dd_multiply(i_p, i_r))))
    rho, one_rho = dd_divide(a_p2, a_s2), dd_divide(g2, a_s2)
    middle = kappa[0] <= rho[0]
    n, one_n = dd_choose(middle, kappa, rho), dd_choose(middle, one_kappa, one_rho)
    one_other = dd_choose(middle, one_rho, one_kappa)
    energy = dd_add(dd_multiply(a_p2, i_s), dd_multiply(a_s2, i_p))
    over = dd_multiply(g, dd_multiply(i_p, i_s))
    rate = dd_divide(dd_choose(middle, g, energy), dd_choose(middle, i_r, over))
    y = dd_multiply(n, dd_sqrt(dd_divide(one_other, one_n)))
    agm, total, x = climb_scale(kc, n, am_s, am_c)
    # T over a half turn is pi y (2 - total) / (2 AGM).
    half_turn = dd_scale(0.125, dd_divide(dd_multiply(y, dd_add_float(dd_negate(total), 2.0)), agm))
    half_turn = dd_choose(middle, dd_add_float(half_turn, -0.25), dd_negate(half_turn))
    nu = dd_multiply(dd_multiply(lam, agm), _ONE_OVER_PI)
    rate = dd_multiply(rate, ONE_OVER_4PI)
    return Polhode(a_s, g[0], rate_s, rate, nu, x, half_turn, kappa[0] * rho[0], agm)


@kernel
def kappa_of(i_p: DoubleDouble, i_r: DoubleDouble, i_s: DoubleDouble) -> tuple[DoubleDouble, DoubleDouble]:
    """Return (kappa, 1 + kappa), kappa = I_s (I_r - I_p) / (I_p (I_s - I_r))."""
    if all_of(dd_equal(i_p, i_r)):
        zero, one = alike(i_p[0], 0.0), alike(i_p[0], 1.0)
        return ((zero, zero), (one, zero))
    kappa = dd_divide(dd_multiply(gap(i_r, i_p), i_s), dd_multiply(gap(i_s, i_r), i_p))
    return (kappa, dd_add_float(kappa, 1.0))


@kernel
def gap(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return |a - b|, of floats exactly."""
    below = dd_less(a, b)
    return dd_subtract(dd_choose(below, b, a), dd_choose(below, a, b))


@kernel
def polhode_axes(moments: Vector, omega: Vector) -> tuple[float, float, float, DoubleDouble, float]:
    """Return (p, r, s, d, unit), the axes by the numbers 0, 1, 2; d is 0 on the separatrix.

    d unit^2 = |w_hi^2 I_hi (I_hi - I_r) - w_lo^2 I_lo (I_r - I_lo)|.
    """
    a, b, c = moments
    lo = choose(_at_most(a, b) & _at_most(a, c), 0.0, choose(_at_most(b, c), 1.0, 2.0))
    hi = choose(_at_most(a, c) & _at_most(b, c), 2.0, choose(_at_most(a, b), 1.0, 0.0))
    r = 3.0 - lo - hi
    w_lo, w_hi, i_lo, i_hi = dd_at(omega, lo), dd_at(omega, hi), dd_at(moments, lo), dd_at(moments, hi)
    up = power_of_two_for(max(abs(w_lo[0]), abs(w_hi[0])))
    w_lo, w_hi = dd_scale(up, w_lo), dd_scale(up, w_hi)
    above, below = gap(i_hi, dd_at(moments, r)), gap(dd_at(moments, r), i_lo)
    upper = dd_multiply(dd_multiply(dd_multiply(w_hi, w_hi), i_hi), above)
    lower = dd_multiply(dd_multiply(dd_multiply(w_lo, w_lo), i_lo), below)
    d = dd_subtract(upper, lower)
    rest = abs(w_hi[1]) + abs(w_lo[1]) + abs(a[1]) + abs(b[1]) + abs(c[1])
    too_few = (abs(d[0]) < 1e-8 * upper[0]) & (rest == 0.0)
    if any_of(too_few):  # digits would be left, and floats have more
        zero = alike(d[0], 0.0)
        sums = _add_exactly((zero, zero, zero, zero), w_hi[0], i_hi[0], above)
        sums = _add_exactly(sums, w_lo[0], -i_lo[0], below)
        d = dd_choose(too_few, dd_add(two_sum(sums[0], sums[1]), (sums[2], sums[3])), d)
    other = d[0] < 0.0
    p, s, d = choose(other, hi, lo), choose(other, lo, hi), dd_choose(other, dd_negate(d), d)
    other = dd_equal(dd_at(moments, s), dd_at(moments, r))
    return (choose(other, s, p), r, choose(other, p, s), d, 1.0 / up)


@kernel
def dd_at(v: Vector, k: float) -> DoubleDouble:
    """Return the component of number k, 0, 1 or 2."""
    return dd_choose(k == 0.0, v[0], dd_choose(k == 1.0, v[1], v[2]))


@kernel
def _at_most(a: DoubleDouble, b: DoubleDouble) -> bool:
    return dd_less(a, b) | dd_equal(a, b)


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
