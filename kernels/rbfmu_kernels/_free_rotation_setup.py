"""The constants of a free body's motion (see free_rotation.py): those that multiply time in double-double."""

import math
from typing import TYPE_CHECKING

from ._kernel import kernel
from ._precession import precession, weight_of_integral
from ._scaling import power_of_two_for
from .double_double import (
    PI,
    DoubleDouble,
    dd_add,
    dd_add_float,
    dd_divide,
    dd_multiply,
    dd_multiply_float,
    dd_negate,
    dd_scale,
    dd_sqrt,
    dd_subtract,
    two_product,
    two_sum,
)
from .elliptic import climb_scale, scale_levels
from .quaternion import compose_quaternions
from .shapes import Quaternion, Vec3

FREE_ROTATION_SIZE = 48
if TYPE_CHECKING:
    FreeRotation = tuple[float, ...]
else:
    FreeRotation = tuple[(float,) * FREE_ROTATION_SIZE]

TUMBLING, STEADY, SEPARATRIX = 0.0, 1.0, 2.0
_LEAST_KC = 1e-300
_LAST_U = 600.0  # beyond it a body on the separatrix has come to rest at the middle axis, to 1e-260


@kernel(inline=False)
def steady_setup(moments: Vec3, q_0: Quaternion, omega: Vec3, unit: float) -> FreeRotation:
    """A constant rate: about a principal axis, across a symmetric body's axis, about any axis of a sphere."""
    x, y, z = omega
    rate = dd_sqrt(dd_add(dd_add(two_product(x, x), two_product(y, y)), two_product(z, z)))
    inverse = 1.0 / rate[0] if rate[0] != 0.0 else 1.0
    unit_q = q_0 if min(min(moments[0], moments[1]), moments[2]) >= 0.0 else (math.nan, math.nan, math.nan, math.nan)
    return (
        STEADY, unit, rate[0], rate[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        inverse * x, inverse * y, inverse * z, unit * x, unit * y, unit * z, *unit_q,
        0.0, 1.0, 1.0, 1.0, 1.0,
        1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0,
        0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


@kernel(inline=False)
def tumbling_setup(moments: Vec3, q_0: Quaternion, omega: Vec3, unit: float) -> FreeRotation:
    """Any other motion. moments and omega scaled to about 1, time in units that undo the scaling of omega."""
    p, r, s, difference = _axes(moments, omega)
    i_p, i_r, i_s = moments[p], moments[r], moments[s]
    valid = i_p > 0.0 and i_r > 0.0 and (i_s > 0.0 or (i_s == 0.0 and i_p == i_r))
    i_p, i_r = (i_p if valid else 1.0), (i_r if valid else 1.0)
    sign_p = -1.0 if omega[p] < 0.0 else 1.0
    sign_s = -1.0 if omega[s] < 0.0 else 1.0
    sign_r = sign_p * sign_s * (1.0 if (p + 1) % 3 == r else -1.0)
    w_p, w_r, w_s = abs(omega[p]), sign_r * omega[r], abs(omega[s])
    sign = 1.0 if i_s > i_p else -1.0
    s_r, s_p, r_p = _distance(i_s, i_r), _distance(i_s, i_p), _distance(i_r, i_p)
    m_s, m_r = two_product(i_s, w_s), two_product(i_r, w_r)

    symmetric = i_r == i_p
    divisor = dd_multiply_float(s_r, i_p)
    kappa = dd_divide(dd_multiply_float(r_p, i_s), divisor if divisor[0] != 0.0 else (1.0, 0.0))
    one_kappa = dd_add_float(kappa, 1.0)
    root_kappa = dd_sqrt(one_kappa)
    # A_p and the initial sn, cn, which may be tiny: from rates scaled on their own.
    up = power_of_two_for(max(w_p, abs(w_r)))
    m_p_up, m_r_up = two_product(i_p, up * w_p), two_product(i_r, up * w_r)
    a_p_up = dd_sqrt(
        dd_add(dd_multiply(m_p_up, m_p_up), dd_divide(dd_multiply(m_r_up, m_r_up), one_kappa))
    )
    a_p = dd_scale(1.0 / up, a_p_up)
    a_s = m_s
    if not symmetric:
        other = dd_divide(dd_multiply(dd_multiply(m_r, m_r), kappa), one_kappa)
        a_s = dd_sqrt(dd_add(dd_multiply(m_s, m_s), other))
    g = dd_sqrt(dd_add(dd_multiply(a_p, a_p), dd_multiply(a_s, a_s)))
    rate_s: DoubleDouble = (w_s, 0.0)
    rho: DoubleDouble = (1.0, 0.0)
    if not symmetric:
        rate_s = dd_divide(a_s, (i_s, 0.0))
        root_rho = dd_divide(a_p, a_s)
        rho = dd_multiply(root_rho, root_rho)
    one_rho = dd_add_float(rho, 1.0)
    root_rho = dd_sqrt(one_rho)
    lam = dd_multiply(rate_s, dd_sqrt(dd_divide(dd_multiply(s_r, s_p), two_product(i_p, i_r))))
    kc: DoubleDouble = (1.0, 0.0)
    if not symmetric:
        kc = dd_divide(dd_sqrt(dd_divide(difference[0], dd_multiply_float(s_r, i_s))), rate_s)
        kc = dd_scale(difference[1], kc)
        kc = kc if kc[0] < 1.0 else (1.0, 0.0)
    kind = TUMBLING
    if kc[0] < _LEAST_KC:
        kind, kc = SEPARATRIX, (_LEAST_KC, 0.0)

    sn = dd_scale(sign, dd_divide(m_r_up, dd_multiply(root_kappa, a_p_up)))
    cn = dd_divide(m_p_up, a_p_up)
    dn: DoubleDouble = (1.0, 0.0)
    if not symmetric:
        dn = dd_divide(m_s, a_s)
    first = kappa[0] <= rho[0]
    n = kappa if first else rho
    agm, x, total = climb_scale(kc, n, sn, cn, dn)
    nu = dd_multiply(lam, agm)
    rate = dd_divide(g, (i_p if first else i_s, 0.0))
    # Half a turn of the polhode: 2 S (Pi - K) - pi or 2 S (K - Pi).
    turn = dd_multiply(dd_multiply(dd_multiply(root_kappa, root_rho), n), total)
    turn = dd_multiply(dd_divide(turn, dd_multiply(agm, dd_add_float(n, 1.0))), dd_scale(0.5, PI))
    turn = dd_scale(sign, dd_negate(dd_add(turn, PI)) if first else turn)
    if kind == SEPARATRIX:
        turn = dd_divide(dd_subtract(dd_divide(g, (i_r, 0.0)), rate), nu)

    weight = weight_of_integral(n[0], sign, kappa[0], rho[0])
    constants = (n[0], sign, weight, root_kappa[0], kappa[0], rho[0], root_rho[0])
    psi_0 = precession(sn[0], cn[0], dn[0], constants)
    z = 1.0 + dd_divide(m_s, g)[0]
    inverse_g = 1.0 / g[0]
    turned = (z, -inverse_g * m_r[0], inverse_g * i_p * w_p, 0.0)
    q = compose_quaternions((q_0[0], sign_p * q_0[p + 1], sign_r * q_0[r + 1], sign_s * q_0[s + 1]), turned)
    nan = 0.0 if valid else math.nan
    a_p_1, a_r_1 = a_p[0], sign * root_kappa[0] * a_p[0]
    return (
        kind, unit, rate[0] + nan, rate[1], nu[0], nu[1], x[0], x[1], turn[0], turn[1], _LAST_U * agm[0], psi_0,
        inverse_g * a_p_1, inverse_g * a_r_1, inverse_g * a_s[0], unit * sign_p * a_p_1 / i_p, unit * sign_r * a_r_1 / i_r, unit * sign_s * rate_s[0],
        *q, float(p), float(r), sign_p, sign_r, sign_s,
        *scale_levels(kc[0]), *constants,
    )  # fmt: skip


@kernel
def _distance(a: float, b: float) -> DoubleDouble:
    """|a - b| exactly."""
    return two_sum(a, -b) if a >= b else two_sum(b, -a)


@kernel(inline=False)
def _axes(moments: Vec3, omega: Vec3) -> tuple[int, int, int, tuple[DoubleDouble, float]]:
    """Axes p, r, s, and the distance from the separatrix |w_hi^2 I_hi (I_hi - I_r) - w_lo^2 I_lo (I_r - I_lo)|.

    The distance as (d, scale): scale^2 d, so that it may be as small as 1e-600.
    """
    a, b, c = moments
    lo = 0 if a <= b and a <= c else (1 if b <= c else 2)
    hi = 2 if c >= a and c >= b else (1 if b >= a else 0)
    lo = 0 if lo == hi else lo
    r = 3 - lo - hi
    scale = power_of_two_for(max(abs(omega[lo]), abs(omega[hi])))
    w_lo, w_hi = scale * omega[lo], scale * omega[hi]
    upper = dd_multiply(dd_multiply_float(two_product(w_hi, w_hi), moments[hi]), _distance(moments[hi], moments[r]))
    lower = dd_multiply(dd_multiply_float(two_product(w_lo, w_lo), moments[lo]), _distance(moments[r], moments[lo]))
    d = dd_subtract(upper, lower)
    p, s = lo, hi
    if d[0] < 0.0:
        p, s = hi, lo
        d = dd_negate(d)
    if moments[s] == moments[r]:
        p, s = s, p
    return (p, r, s, (d, 1.0 / scale))
