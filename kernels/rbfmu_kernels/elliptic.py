"""Elliptic functions and integrals in the forms the free rigid body needs: no cancellation for any modulus.

The scale of arithmetic-geometric means a_0 = 1, g_0 = kc (the complementary modulus), a' = (a + g) / 2, g' = sqrt(a g)
serves all: it turns an amplitude into its phase x = pi u / (2 K) (`climb_scale`, once), a phase into sn, cn, dn
(`jacobi_from_phase`, at each evaluation), and gives the complete integrals.
Gauss' transformation: DLMF 22.7(i); the descent is Bulirsch's (Numer. Math. 7, 1965) without his cotangents.
"""

import math

from ._kernel import kernel
from .double_double import (
    DoubleDouble,
    dd_add,
    dd_add_float,
    dd_divide,
    dd_multiply,
    dd_multiply_float,
    dd_scale,
    dd_sqrt,
    dd_subtract,
)

Levels = tuple[float, float, float, float, float, float, float, float, float, float, float, float, float, float]
"""f = 2 g / (a + g) of each level of the scale, 1 where its modulus is 0: 14 are enough for kc >= 1e-300."""


@kernel(inline=False)
def scale_levels(kc: float) -> Levels:
    """The levels of kc.  Error <= 2 eps each."""
    f5 = f6 = f7 = f8 = f9 = f10 = f11 = f12 = f13 = 1.0
    f0, k = _level(kc)
    f1, k = _level(k)
    f2, k = _level(k)
    f3, k = _level(k)
    f4, k = _level(k)
    if k < 1.0:
        f5, k = _level(k)
        f6, k = _level(k)
        f7, k = _level(k)
        f8, k = _level(k)
    if k < 1.0:
        f9, k = _level(k)
        f10, k = _level(k)
        f11, k = _level(k)
        f12, k = _level(k)
        f13, k = _level(k)
    return (f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, f10, f11, f12, f13)


@kernel
def _level(kc: float) -> tuple[float, float]:
    """F and the complementary modulus g' / a' of the level below."""
    inverse = 2.0 / (1.0 + kc)
    root = math.sqrt(kc) * inverse
    return (kc * inverse, root if root < 1.0 else 1.0)


@kernel(inline=False)
def jacobi_from_phase(sin_x: float, cos_x: float, levels: Levels) -> tuple[float, float, float]:
    """(sn, cn, dn) of u at the phase x = pi u / (2 K).

    |x| <= pi / 2.  Error <= 4 eps, in cn and dn relative.
    """
    f0, f1, f2, f3, f4, f5, f6, f7, f8, f9, f10, f11, f12, f13 = levels
    s, c, dn = sin_x, cos_x, 1.0
    if f5 < 1.0:
        if f9 < 1.0:
            s, c, dn = _descend(s, c, dn, f13)
            s, c, dn = _descend(s, c, dn, f12)
            s, c, dn = _descend(s, c, dn, f11)
            s, c, dn = _descend(s, c, dn, f10)
            s, c, dn = _descend(s, c, dn, f9)
        s, c, dn = _descend(s, c, dn, f8)
        s, c, dn = _descend(s, c, dn, f7)
        s, c, dn = _descend(s, c, dn, f6)
        s, c, dn = _descend(s, c, dn, f5)
    s, c, dn = _descend(s, c, dn, f4)
    s, c, dn = _descend(s, c, dn, f3)
    s, c, dn = _descend(s, c, dn, f2)
    s, c, dn = _descend(s, c, dn, f1)
    s, c, dn = _descend(s, c, dn, f0)
    length = 1.0 / math.sqrt(s * s + c * c)
    return (s * length, c * length, dn)


@kernel
def _descend(s: float, c: float, dn: float, f: float) -> tuple[float, float, float]:
    """From tan am = s / c and dn of one level to those of the level above, whose modulus is larger.

    tan am = (2 - f) s / (c dn); dn = (c^2 + f s^2) / (c^2 + (2 - f) s^2) with s, c of the lower level (DLMF 22.7.2-4).
    """
    c2, s2, inverse = c * c, s * s, 2.0 - f
    return (s * inverse, c * dn, (c2 + f * s2) / (c2 + inverse * s2))


@kernel(inline=False)
def climb_scale(
    kc: DoubleDouble, n: DoubleDouble, s: DoubleDouble, c: DoubleDouble, dn: DoubleDouble
) -> tuple[DoubleDouble, DoubleDouble, DoubleDouble]:
    """The AGM of (1, kc), the phase x = pi u / (2 K) of sn = s, cn = c, and (Pi(-n) / K - 1) (1 + n) / -n.

    0 < kc <= 1, 0 <= n <= 1, c >= 0.  Pi by DLMF 19.8.6-7, the phase by Gauss' transformation upwards:
    D = a dn, D'^2 = a a' (D + g) / (D + a), tan am' = tan am D' / a.  Relative error about 1e-30, of the phase 1e-18.
    """
    a: DoubleDouble = (1.0, 0.0)
    g, big_d = kc, dn
    p = dd_sqrt(dd_add_float(n, 1.0))
    term: DoubleDouble = (1.0, 0.0)
    total: DoubleDouble = (1.0, 0.0)
    for _ in range(20):
        ag = dd_multiply(a, g)
        mean = dd_scale(0.5, dd_add(a, g))
        ratio = dd_divide(dd_add(big_d, g), dd_add(big_d, a))
        big_d = dd_sqrt(dd_multiply(dd_multiply(a, mean), ratio))
        s = dd_multiply(s, big_d)
        c = dd_multiply(c, a)
        p2 = dd_multiply(p, p)
        p_sum = dd_add(p2, ag)
        term = dd_scale(0.5, dd_multiply(term, dd_divide(dd_subtract(p2, ag), p_sum)))
        p = dd_scale(0.5, dd_divide(p_sum, p))
        total = dd_add(total, term)
        close = abs(a[0] - g[0]) < 1e-8 * a[0] and abs(term[0]) < 1e-16
        a, g = mean, dd_sqrt(ag)
        if close:
            break
    # One more level, whose corrections are below 1e-16, needs no double-double.
    gap = dd_subtract(a, g)[0]
    s = dd_add_float(s, -0.5 * s[0] * gap / a[0])
    a = dd_add_float(a, -0.5 * gap)
    return (a, dd_atan2(s, c), total)


_PI_8 = (0.39269908169872414, 1.5308084989341915e-17)
_SIN_PI_8 = (0.3826834323650898, -1.0050772696461588e-17)
_COS_PI_8 = (0.9238795325112867, 1.7645047084336677e-17)
_SQRT_HALF = (0.7071067811865476, -4.833646656726457e-17)


@kernel
def dd_atan2(y: DoubleDouble, x: DoubleDouble) -> DoubleDouble:
    """The angle of the point (x, y), x >= 0.  Error about 1e-18: beyond double, short of double-double."""
    below = y[0] < 0.0
    sign = -1.0 if below else 1.0
    y = dd_scale(sign, y)
    # Turn the point by the nearest multiple of pi / 8.
    eighths = 0.0
    sine: DoubleDouble = (0.0, 0.0)
    cosine: DoubleDouble = (1.0, 0.0)
    if y[0] > 0.198912367379658 * x[0]:
        eighths, sine, cosine = 1.0, _SIN_PI_8, _COS_PI_8
    if y[0] > 0.6681786379192989 * x[0]:
        eighths, sine, cosine = 2.0, _SQRT_HALF, _SQRT_HALF
    if y[0] > 1.496605762665489 * x[0]:
        eighths, sine, cosine = 3.0, _COS_PI_8, _SIN_PI_8
    if y[0] > 5.027339492125846 * x[0]:
        eighths, sine, cosine = 4.0, (1.0, 0.0), (0.0, 0.0)
    along = dd_add(dd_multiply(x, cosine), dd_multiply(y, sine))
    across = dd_subtract(dd_multiply(y, cosine), dd_multiply(x, sine))
    t = dd_divide(across, along)
    z = t[0] * t[0]
    # atan t = t - t^3 / 3 + t^5 / 5 - ...: the sum after t is below 3e-3 and double is enough.
    p = 1.0 / 23.0
    for k in (21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0):
        p = 1.0 / k - z * p
    angle = dd_add(dd_multiply_float(_PI_8, eighths), dd_add_float(t, -t[0] * z * p))
    return dd_scale(sign, angle)


@kernel(inline=False)
def third_kind(w: float, p: float, c: float, dn: float) -> float:
    """w / 3 R_J(c^2, dn^2, 1, p) for w^2 = (p - c^2) (p - dn^2) (p - 1), 1 <= p <= 2.

    Duplication (DLMF 19.36.1, 19.26.19); here the factor w makes of its sum of R_C a sum of arctangents
    2^n atan(w / (8^n d_n)), none beyond pi / 8.  The series to seventh degree: DLMF 19.36.2.  Error <= 4 eps.
    """
    x, y, z = c * c, dn * dn, 1.0
    root_x, root_y, root_z, root_p = abs(c), dn, 1.0, math.sqrt(p)
    mean = (x + y + z + 2.0 * p) * 0.2
    spread = 80.0 * max(max(abs(mean - x), abs(mean - y)), max(abs(mean - z), abs(mean - p)))
    arcs, doubled, quarter = 0.0, 1.0, w * (1.0 / 3.0)
    for _ in range(600):
        d = (root_p + root_x) * (root_p + root_y) * (root_p + root_z)
        arcs += doubled * _small_atan(w / d)
        shift = root_x * root_y + root_y * root_z + root_z * root_x
        x, y, z, p = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift), 0.25 * (p + shift)
        mean = 0.25 * (mean + shift)
        spread, quarter, w, doubled = 0.25 * spread, 0.25 * quarter, 0.125 * w, 2.0 * doubled
        if not spread > mean:
            break
        root_x, root_y, root_z, root_p = math.sqrt(x), math.sqrt(y), math.sqrt(z), math.sqrt(p)
    inverse = 1.0 / mean
    x, y, z = (mean - x) * inverse, (mean - y) * inverse, (mean - z) * inverse
    p = -0.5 * (x + y + z)
    xyz, p2 = x * y * z, p * p
    e2 = x * y + x * z + y * z - 3.0 * p2
    e3 = xyz + 2.0 * e2 * p + 4.0 * p * p2
    e4 = (2.0 * xyz + e2 * p + 3.0 * p * p2) * p
    e5 = xyz * p2
    e22 = e2 * e2
    series = 1.0 + (-3.0 / 14.0 * e2 + 1.0 / 6.0 * e3 + 9.0 / 88.0 * e22 - 3.0 / 22.0 * e4 - 9.0 / 52.0 * e2 * e3
                    + 3.0 / 26.0 * e5 - 1.0 / 16.0 * e2 * e22 + 3.0 / 40.0 * e3 * e3 + 3.0 / 20.0 * e2 * e4
                    + 45.0 / 272.0 * e22 * e3 - 9.0 / 68.0 * (e3 * e4 + e2 * e5))  # fmt: skip
    return 2.0 * arcs + quarter * series * inverse / math.sqrt(mean)


@kernel
def _small_atan(r: float) -> float:
    """Atan r, |r| <= sqrt 2 - 1: Chebyshev fit of atan(r) / r in r^2, error 2e-18, and one rounding."""
    z = r * r
    z2 = z * z
    a = 0.0379473290518238 - 0.0177855413361691 * z
    b = 0.0584672527408186 - 0.0503440488846491 * z
    c = 0.0769204352156341 - 0.0666293102332267 * z
    d = 0.1111111074143104 - 0.0909089670826134 * z
    e = 0.1999999999994017 - 0.1428571427918009 * z
    p = e + z2 * (d + z2 * (c + z2 * (b + z2 * a)))
    return r + r * z * (z * p - 0.3333333333333312)
