"""Elliptic functions and integrals in the forms the free rigid body needs: no cancellation for any modulus.

The scale of arithmetic-geometric means a_0 = 1, g_0 = kc (the complementary modulus), a' = (a + g) / 2, g' = sqrt(a g)
gives complete integrals and the phase x = pi u / (2 K) of an amplitude, in double-double; sn, cn, dn of a phase:
jacobi_theta.py.  Sources: DLMF 19.8, 22.7, 22.20.
"""

from ..compile.decorator import kernel
from ..compile.wide import all_of, always, any_of, choose
from .double_double import (
    DoubleDouble,
    dd_add,
    dd_add_float,
    dd_choose,
    dd_divide,
    dd_multiply,
    dd_scale,
    dd_sqrt,
    dd_subtract,
    two_product,
    two_sum,
)
from .scaling import power_of_two_for


@kernel
def jacobi_low_parts(sn: float, cn: float, dn: float, kc2: DoubleDouble) -> tuple[float, float, float]:
    """Return what to add to sn, cn, dn, each off by some eps.

    Then sn^2 + cn^2 = 1 and dn^2 = cn^2 + kc^2 sn^2 to 1e-30.
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
def climb_scale(
    kc: DoubleDouble, n: DoubleDouble, s: DoubleDouble, c: DoubleDouble
) -> tuple[DoubleDouble, DoubleDouble, DoubleDouble]:
    """Return (AGM(1, kc), sum, x / pi).

    They give Pi(-n) = pi / (4 AGM) (2 - n / (1 + n) sum), and x / pi = u / (2 K) of tan am = s / c.
    1e-300 <= kc <= 1, 0 <= n <= 1, s, c >= 0.  Pi: DLMF 19.8.7; x by Landen's descent, am' = am + atan(g / a tan am),
    in products of complex numbers.  Relative error about 1e-31, of x 1e-19.
    """
    a: DoubleDouble = (1.0, 0.0)
    g = kc
    p = dd_sqrt(dd_add_float(n, 1.0))
    term: DoubleDouble = (1.0, 0.0)
    total: DoubleDouble = (1.0, 0.0)
    turns, halves, goes_on = 0.0, 1.0, always(kc[0])
    for _ in range(16):
        ag = dd_multiply(a, g)
        a_plus_g = dd_add(a, g)
        gap = a[0] - g[0]
        # am' = 2 pi turns + the angle of (c, s)
        whole = 2.0 * turns + choose(c[0] < 0.0, choose(s[0] >= 0.0, 1.0, -1.0), 0.0)
        turns, halves = choose(goes_on, whole, turns), choose(goes_on, 0.5 * halves, halves)
        sc = dd_multiply(a_plus_g, dd_multiply(s, c))
        cc = dd_subtract(dd_multiply(a, dd_multiply(c, c)), dd_multiply(g, dd_multiply(s, s)))
        size = abs(sc[0]) + abs(cc[0])
        fits = (size > 1e-10) & (size < 1e10)
        if not all_of(fits):  # squared at each level
            power = choose(fits, 1.0, power_of_two_for(size))
            sc, cc = dd_scale(power, sc), dd_scale(power, cc)
        s, c = dd_choose(goes_on, sc, s), dd_choose(goes_on, cc, c)
        p2 = dd_multiply(p, p)
        p_sum = dd_add(p2, ag)
        epsilon = dd_divide(dd_subtract(p2, ag), p_sum)
        p = dd_choose(goes_on, dd_scale(0.5, dd_divide(p_sum, p)), p)
        term = dd_choose(goes_on, dd_scale(0.5, dd_multiply(term, epsilon)), term)
        total = dd_choose(goes_on, dd_add(total, term), total)
        done = (gap < 6e-4 * a[0]) & (abs(epsilon[0]) < 1e-3)
        a, g = dd_choose(goes_on, dd_scale(0.5, a_plus_g), a), dd_choose(goes_on, dd_sqrt(ag), g)
        goes_on = goes_on & (choose(done, 0.0, 1.0) > 0.0)
        if not any_of(goes_on):
            break
    # What is left is below 1e-6: series in h = (a - g) / a and epsilon, in double.
    gap_left = dd_subtract(a, g)
    h = gap_left[0] / a[0]
    p2, ag = dd_multiply(p, p), dd_multiply(a, g)
    epsilon_1 = dd_subtract(p2, ag)[0] / (p2[0] + ag[0])
    total = dd_add_float(total, 0.5 * term[0] * epsilon_1 * (1.0 + 0.25 * (epsilon_1 * epsilon_1 - 0.125 * h * h)))
    agm = dd_add_float(dd_add(a, dd_scale(-0.5, gap_left)), -a[0] * h * h * (0.0625 + h * 0.03125))
    # x = am - (h / 4 + h^2 / 8) sin 2 am + 3 h^2 / 64 sin 4 am, am = pi (2 turns + angle)
    size = 1.0 / (s[0] * s[0] + c[0] * c[0])
    sin_2, cos_2 = 2.0 * s[0] * c[0] * size, (c[0] - s[0]) * (c[0] + s[0]) * size
    rest = sin_2 * h * (0.09375 * h * cos_2 - 0.25 - 0.125 * h)
    x = dd_add_float(dd_add_float(angle_in_half_turns(s, c), _ONE_OVER_PI[0] * rest), 2.0 * turns)
    return (agm, total, dd_scale(halves, x))


_ONE_OVER_PI: DoubleDouble = (0.3183098861837907, -1.9678676675182486e-17)
_SIN_PI_8: DoubleDouble = (0.3826834323650898, -1.0050772696461588e-17)
_COS_PI_8: DoubleDouble = (0.9238795325112867, 1.7645047084336677e-17)
_SQRT_HALF: DoubleDouble = (0.7071067811865476, -4.833646656726457e-17)
_EIGHTHS = (
    (0.198912367379658, 1.0, _SIN_PI_8, _COS_PI_8),
    (0.6681786379192989, 2.0, _SQRT_HALF, _SQRT_HALF),
    (1.496605762665489, 3.0, _COS_PI_8, _SIN_PI_8),
    (5.027339492125848, 4.0, (1.0, 0.0), (0.0, 0.0)),
)
"""The tangent from which on a multiple of pi / 8 is the nearest, the multiple, its sine and cosine."""


@kernel(inline=False)
def angle_in_half_turns(y: DoubleDouble, x: DoubleDouble) -> DoubleDouble:
    """Return the angle of the point (x, y) over pi, in [-1, 1].

    Error about 1e-19: beyond double, short of double-double.
    """
    below, left = y[0] < 0.0, x[0] < 0.0
    y = dd_scale(choose(below, -1.0, 1.0), y)
    x = dd_scale(choose(left, -1.0, 1.0), x)
    # Turn the point by the nearest multiple of pi / 8.
    eighths = 0.0
    sine: DoubleDouble = (0.0, 0.0)
    cosine: DoubleDouble = (1.0, 0.0)
    for tangent, nearest, of_sine, of_cosine in _EIGHTHS:
        steeper = y[0] > tangent * x[0]
        eighths = choose(steeper, nearest, eighths)
        sine, cosine = dd_choose(steeper, of_sine, sine), dd_choose(steeper, of_cosine, cosine)
    along = dd_add(dd_multiply(x, cosine), dd_multiply(y, sine))
    across = dd_subtract(dd_multiply(y, cosine), dd_multiply(x, sine))
    t = dd_divide(across, along)
    # atan t = t - t^3 / 3 + t^5 / 5 - ...: the sum after t is below 3e-3, double is enough.
    z = t[0] * t[0]
    z2 = z * z
    p = 1.0 / 19.0 - z * (1.0 / 21.0) + z2 * (1.0 / 23.0)
    p = 1.0 / 15.0 - z * (1.0 / 17.0) + z2 * p
    p = 1.0 / 11.0 - z * (1.0 / 13.0) + z2 * p
    p = 1.0 / 7.0 - z * (1.0 / 9.0) + z2 * p
    p = 1.0 / 3.0 - z * (1.0 / 5.0) + z2 * p
    angle = dd_multiply(dd_add_float(t, -t[0] * z * p), _ONE_OVER_PI)
    angle = dd_add_float(angle, 0.125 * eighths)
    angle = dd_choose(left, dd_add_float(dd_scale(-1.0, angle), 1.0), angle)
    return dd_scale(choose(below, -1.0, 1.0), angle)
