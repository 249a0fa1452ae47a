"""Sets up the constants of a free body's motion (notation: free_rotation.py); double-double where time multiplies."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from ..compile.decorator import kernel
from ..compile.wide import all_of, choose
from ..numerics.double_double import (
    DoubleDouble,
    Vector,
    dd_add,
    dd_choose,
    dd_divide,
    dd_equal,
    dd_less,
    dd_multiply,
    dd_scale,
    dd_sqrt,
)
from ..numerics.jacobi_theta import NEAREST_KC
from ..numerics.scaling import power_of_two_for
from ..records import record
from ..rotations.quaternion import compose_quaternions, invert_quaternion
from ..types import _SHAPES, Quaternion, Vec3
from .free_rotation_series import (
    NEAR,
    SEPARATRIX,
    STEADY,
    TUMBLING,
    Series,
    SteadyTurn,
    flatten_near,
    flatten_steady,
    flatten_tumbling,
    place_of,
    turn_of,
)
from .free_rotation_series_setup import near_series_of, series_of
from .polhode import dd_at, gap, kappa_of, polhode_axes, symmetric_polhode, triaxial_polhode
from .uniform_rotation import turning_about

Columns = tuple[Quaternion, Quaternion, Quaternion, Quaternion]


class FreeRotation(NamedTuple):
    """The constants of one motion.

    kind: TUMBLING, STEADY, NEAR the separatrix or on it (SEPARATRIX). unit: the unit of all rates, 1/s.
    precession: the rate of psi / (4 pi). phase_rate and phase: rate and start of the polhode's phase in half turns, the
    rate halved. rates and rates_low: the largest about p, r, s, with their body axes' signs, and their low parts.
    kc_squared: of the complementary modulus. width and shift: what `place_near` and `turn_of` need NEAR the separatrix.
    columns: what 1, i_p, i_r, i_s are after q_0, in body axes. p and r: the numbers 1, 2, 3 of these body axes.
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
if TYPE_CHECKING:
    FreeRotationNumbers = Any  # mypy has no tuple of 62 floats short of writing it out
else:
    FreeRotationNumbers = tuple[(float,) * FREE_ROTATION_SIZE]
_SHAPES[FreeRotationNumbers] = (FREE_ROTATION_SIZE,)

_LEAST_KC = 1e-300
_NONE: DoubleDouble = (0.0, 0.0)


@kernel(inline=False)
def steady_setup(q_0: Quaternion, omega: Vector, unit: float) -> FreeRotation:
    """Set up a constant rate: about a principal axis, across a symmetric body's axis, about any axis of a sphere."""
    (x, _), (y, _), (w, _) = omega
    axis, rate = turning_about(omega)
    return FreeRotation(
        kind=STEADY,
        unit=unit,
        precession=rate,
        phase_rate=_NONE,
        phase=_NONE,
        rates=(unit * x, unit * y, unit * w),
        rates_low=(0.0, 0.0, 0.0),
        kc_squared=(1.0, 0.0),
        width=_NONE,
        shift=0.0,
        columns=_columns(q_0, (1.0, 1.0, 1.0), 1.0, 2.0),
        p=1.0,
        r=2.0,
        series=flatten_steady(SteadyTurn(axis)),
    )


@kernel(inline=False)
def tumbling_setup(moments: Vector, q_0: Quaternion, omega: Vector, unit: float) -> FreeRotation:
    """Set up any other motion.

    moments and omega are scaled to about 1; `unit` undoes the scaling of omega.
    """
    p, r, s, distance, distance_unit = polhode_axes(moments, omega)
    i_p, i_r, i_s = dd_at(moments, p), dd_at(moments, r), dd_at(moments, s)
    w_p, w_r, w_s = dd_at(omega, p), dd_at(omega, r), dd_at(omega, s)
    exists = (i_p[0] > 0.0) & (i_r[0] > 0.0) & ((i_s[0] > 0.0) | dd_equal(i_p, i_r))
    nothing = (math.nan, math.nan)
    i_p, i_r = dd_choose(exists, i_p, nothing), dd_choose(exists, i_r, nothing)
    i_s, unit = dd_choose(exists, i_s, nothing), choose(exists, unit, math.nan)
    sign = choose(dd_less(i_p, i_s), 1.0, -1.0)
    sign_p = math.copysign(1.0, w_p[0])
    sign_s = math.copysign(1.0, w_s[0])
    sign_r = sign_p * sign_s * choose((r - p == 1.0) | (r - p == -2.0), 1.0, -1.0)
    w_p, w_r, w_s = dd_scale(sign_p, w_p), dd_scale(sign_r, w_r), dd_scale(sign_s, w_s)
    m_s = dd_multiply(i_s, w_s)

    kappa, one_kappa = kappa_of(i_p, i_r, i_s)
    root_kappa = dd_sqrt(one_kappa)
    # m_p and m_r, which may both be tiny, scaled by a power of two.
    up = power_of_two_for(max(w_p[0], abs(w_r[0])))
    m_p_up, m_r_up = dd_multiply(i_p, dd_scale(up, w_p)), dd_multiply(i_r, dd_scale(up, w_r))
    m_r2_up = dd_divide(dd_multiply(m_r_up, m_r_up), one_kappa)
    a_p2_up = dd_add(dd_multiply(m_p_up, m_p_up), m_r2_up)
    a_p_up = dd_sqrt(a_p2_up)
    am_s, am_c = dd_scale(math.copysign(1.0, m_r_up[0]), m_r_up), dd_multiply(root_kappa, m_p_up)
    down = 1.0 / up
    a_p, a_p2 = dd_scale(down, a_p_up), dd_scale(down, dd_scale(down, a_p2_up))
    a_r = dd_scale(sign, dd_multiply(root_kappa, a_p))

    if all_of(dd_equal(i_p, i_r)):
        polhode = symmetric_polhode(i_r, i_s, w_s, m_s, a_p2, am_s, am_c)
        kc: DoubleDouble = (1.0, 0.0)
        kc2 = kc
    else:
        a_s2 = dd_add(dd_multiply(m_s, m_s), dd_multiply(kappa, dd_scale(down, dd_scale(down, m_r2_up))))
        kc2 = dd_divide(dd_multiply(distance, i_s), dd_multiply(gap(i_s, i_r), a_s2))
        kc = dd_scale(distance_unit, dd_sqrt(kc2))
        kc2 = dd_scale(distance_unit, dd_scale(distance_unit, kc2))
        above = kc[0] - 1.0 + kc[1] > 0.0
        kc, kc2 = dd_choose(above, (1.0, 0.0), kc), dd_choose(above, (1.0, 0.0), kc2)
        kc = dd_choose(kc[0] <= _LEAST_KC, (_LEAST_KC, 0.0), kc)
        polhode = triaxial_polhode((i_p, i_r, i_s), kappa, one_kappa, a_p2, a_s2, kc, am_s, am_c)
    a_s, g, rate_s, rate, nu, x, half_turn, k2, agm = polhode

    kind, width, shift = TUMBLING, (0.0, 0.0), 0.0
    half_turn = dd_scale(sign, half_turn)
    if all_of(kc[0] >= NEAREST_KC):
        series = flatten_tumbling(series_of(kappa[0], a_p[0] / (a_s[0] + g), k2, kc[0], sign))
        rate = dd_add(rate, dd_multiply(half_turn, nu))
    else:
        kind = NEAR
        near, width, shift = near_series_of(dd_sqrt(kappa), kc, agm, sign)
        series = flatten_near(near)
        if all_of(kc[0] > _LEAST_KC):
            rate = dd_add(rate, dd_multiply(half_turn, nu))
        else:
            kind, shift = SEPARATRIX, 0.0
    x = dd_scale(sign * math.copysign(1.0, m_r_up[0]), x)
    rate_p = dd_divide(dd_scale(unit * sign_p, a_p), i_p)
    rate_r = dd_divide(dd_scale(unit * sign_r, a_r), i_r)
    rate_s = dd_scale(unit * sign_s, rate_s)
    q = (q_0[0], sign_p * _at(q_0, p), sign_r * _at(q_0, r), sign_s * _at(q_0, s))
    start = turn_of(kind, place_of(kind, x, width), (0.0, 0.0), shift, series)
    q = compose_quaternions(q, invert_quaternion(start))
    return FreeRotation(
        kind=kind,
        unit=unit,
        precession=rate,
        phase_rate=(0.5 * nu[0], 0.5 * nu[1]),
        phase=x,
        rates=(rate_p[0], rate_r[0], rate_s[0]),
        rates_low=(rate_p[1], rate_r[1], rate_s[1]),
        kc_squared=kc2,
        width=width,
        shift=shift,
        columns=_columns(q, (sign_p, sign_r, sign_s), p + 1.0, r + 1.0),
        p=p + 1.0,
        r=r + 1.0,
        series=series,
    )


@kernel
def _at(q: Quaternion, k: float) -> float:
    """Return the component of a quaternion's vector part of number k, 0, 1 or 2."""
    return choose(k == 0.0, q[1], choose(k == 1.0, q[2], q[3]))


@kernel(inline=False)
def _columns(q: Quaternion, signs: Vec3, p: float, r: float) -> Columns:
    """Return what 1, i_p, i_r, i_s are after q, in body axes."""
    (a, x, y, z), (on_p, on_r, on_s) = q, signs
    return (
        (a, *in_body_axes((on_p * x, on_r * y, on_s * z), p, r)),
        (-x, *in_body_axes((on_p * a, on_r * z, -on_s * y), p, r)),
        (-y, *in_body_axes((-on_p * z, on_r * a, on_s * x), p, r)),
        (-z, *in_body_axes((on_p * y, -on_r * x, on_s * a), p, r)),
    )


@kernel
def in_body_axes(v: Vec3, p: float, r: float) -> Vec3:
    """Return v, given along p, r and s, in body axes; p, r: the numbers 1, 2, 3 of the body axes."""
    return (
        choose(p == 1.0, v[0], choose(r == 1.0, v[1], v[2])),
        choose(p == 2.0, v[0], choose(r == 2.0, v[1], v[2])),
        choose(p == 3.0, v[0], choose(r == 3.0, v[1], v[2])),
    )
