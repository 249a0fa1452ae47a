"""Exact torque-free motion of one rigid body: any inertia, any time, any state.

In axes (p, r, s), r that of the middle moment and s the one about which the body precesses, with signs that make
m_p, m_s >= 0, the angular momentum is m = (A_p cn u, A_r sn u, A_s dn u), u = u_0 + lambda t
(Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30, 2008, section 2).  Corrections to that paper: amplitudes
and modulus come from sums of terms of one sign, never from G^2 - 2 T I_r, and the axis of dn is chosen by the sign of
that difference, so that k <= 1 (P. Leroy, "On an article by Celledoni et al.", Principia).

The attitude is q = q_0 S^-1 P(m_0)^-1 Z(psi) P(m) S: S takes the body's axes to (p, r, s), P(m) turns m onto z by the
shortest way, Z turns about z by psi.  With kappa = I_s (I_r - I_p) / (I_p (I_s - I_r)), rho = (A_p / A_s)^2 and
kappa rho = k^2, psi is a rate times t plus an integral of the third kind whose characteristic, -min(kappa, rho), is in
[-1, 0]: no cancellation for any inertia, no pole.  What grows with t is in double-double: the error does not grow.
"""

import math

from ._free_rotation_setup import FREE_ROTATION_SIZE as FREE_ROTATION_SIZE
from ._free_rotation_setup import SEPARATRIX, STEADY, FreeRotation, steady_setup, tumbling_setup
from ._kernel import kernel
from ._precession import precession
from ._scaling import power_of_two_for, round_to_integer
from .double_double import PI, DoubleDouble, dd_add, two_product, two_sum
from .elementary import sincos
from .elliptic import jacobi_from_phase, jacobi_low_parts
from .quaternion import compose_quaternions
from .shapes import Quaternion, Vec3


_LAST_TURN = 1e28
_LAST_X = 0.4334246564202994  # u = 600 on the separatrix: from there on the body rests at the middle axis, to 1e-260


@kernel(inline=False)
def free_rotation_setup(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3) -> FreeRotation:
    """The constants of a body's torque-free motion, for `free_rotation_at`: a flat tuple of FREE_ROTATION_SIZE floats.

    moments: principal, any unit, any order; q_0: body to inertial axes; omega_b_0: rad/s, body components.
    One zero moment (a slender beam, the others equal) is the limit of a thin rod: the rate about it stays constant.
    NaN where there is no motion: a negative moment, a zero moment beside unequal ones, a non-finite argument.
    """
    i_1, i_2, i_3 = moments
    w_1, w_2, w_3 = omega_b_0
    valid = 0.0 <= i_1 < math.inf and 0.0 <= i_2 < math.inf and 0.0 <= i_3 < math.inf
    scale = power_of_two_for(max(max(i_1, i_2), i_3))
    i_1, i_2, i_3 = scale * i_1, scale * i_2, scale * i_3
    scale = power_of_two_for(max(max(abs(q_0[0]), abs(q_0[1])), max(abs(q_0[2]), abs(q_0[3]))))
    q = (scale * q_0[0], scale * q_0[1], scale * q_0[2], scale * q_0[3])
    scale = power_of_two_for(max(max(abs(w_1), abs(w_2)), abs(w_3)))
    w_1, w_2, w_3 = scale * w_1, scale * w_2, scale * w_3
    unit = 1.0 / scale if valid else math.nan
    steady_1 = i_2 == i_3 or w_2 == 0.0 or w_3 == 0.0
    steady_2 = i_3 == i_1 or w_3 == 0.0 or w_1 == 0.0
    steady_3 = i_1 == i_2 or w_1 == 0.0 or w_2 == 0.0
    if steady_1 and steady_2 and steady_3:
        return steady_setup(q, (w_1, w_2, w_3), unit)
    return tumbling_setup((i_1, i_2, i_3), q, (w_1, w_2, w_3), unit)


@kernel(inline=False)
def free_rotation_at(setup: FreeRotation, t: float) -> tuple[Quaternion, Vec3]:
    """(q_ab, omega_ab_b) at time t after the state of `setup`, continuous in t, q of unit length.

    t: s, of either sign.  Error of the attitude's angle: about 1 eps, <= 10 eps; near the separatrix 100 eps;
    of omega the same, relative to |omega|; where |omega t| > 1e15, 1e-31 |omega t| more.
    """
    kind, unit, rate_1, rate_2, nu_1, nu_2, x_1, x_2, turn_1, turn_2, psi_0 = setup[0:11]
    mu_p, mu_r, mu_s, w_p, w_r, w_s = setup[11:17]
    q_0 = setup[17:21]
    axis_p, axis_r, axis_s = setup[21:24]
    t *= unit
    t = t if abs(rate_1 * t) < _LAST_TURN else math.nan
    # psi / (4 pi), whole turns dropped as they arise
    psi = _without_turns(rate_1, rate_2, t)
    if kind == STEADY:
        s, c = _sincos_half_turns(2.0 * psi[0], 2.0 * psi[1])
        turned = (c, s * mu_p, s * mu_r, s * mu_s)
    else:
        # The phase x / pi of the polhode = half turns done + a rest in [-1/2, 1/2].
        high, low = two_product(nu_1, t)
        low += nu_2 * t
        done, more = 0.0, 0.0
        if kind == SEPARATRIX:
            high, low = dd_add((high, low), (x_1, x_2))
            high = _LAST_X if high > _LAST_X else (-_LAST_X if high < -_LAST_X else high)
        else:
            done = round_to_integer(high)
            high, low = dd_add(two_sum(high - done, low), (x_1, x_2))
            more = round_to_integer(high)
            high -= more
        sin_x, cos_x = _sincos_half_turns(high, low)
        if cos_x < 0.0:
            more += math.copysign(1.0, sin_x)
            sin_x, cos_x = -sin_x, -cos_x
        sn, cn, dn = jacobi_from_phase(sin_x, cos_x, setup[24:38])
        psi = dd_add(psi, dd_add(_without_turns(turn_1, turn_2, done), _without_turns(turn_1, turn_2, more)))
        s, c = _sincos_half_turns_plus(psi, 0.5 * (precession(sn, cn, dn, setup[38:43]) - psi_0))
        flip = 1.0 if _is_even(done) == _is_even(more) else -1.0
        w_p2, w_r2, w_s2, kc2_1, kc2_2 = setup[43:48]
        sn_2, cn_2, dn_2 = jacobi_low_parts(sn, cn, dn, (kc2_1, kc2_2))
        w_p = flip * (w_p * cn + (w_p * cn_2 + w_p2 * cn))
        w_r = flip * (w_r * sn + (w_r * sn_2 + w_r2 * sn))
        w_s = w_s * dn + (w_s * dn_2 + w_s2 * dn)
        mu_p, mu_r, mu_s = flip * mu_p * cn, flip * mu_r * sn, mu_s * dn
        # Z P with P = (1 + mu_s, mu_r, -mu_p, 0) / sqrt(2 (1 + mu_s)); the length is made 1 at the end.
        z = 1.0 + mu_s
        turned = (c * z, c * mu_r + s * mu_p, s * mu_r - c * mu_p, s * z)
    e, x_p, x_r, x_s = compose_quaternions(q_0, turned)
    length = math.sqrt(e * e + x_p * x_p + x_r * x_r + x_s * x_s)
    inverse = 1.0 / (length if length != 0.0 else math.nan)
    x_p = math.copysign(inverse, axis_p) * x_p
    x_r = math.copysign(inverse, axis_r) * x_r
    x_s = math.copysign(inverse, axis_s) * x_s
    first_p, first_r = abs(axis_p) == 1.0, abs(axis_r) == 1.0
    second_p, second_r = abs(axis_p) == 2.0, abs(axis_r) == 2.0
    third_p, third_r = abs(axis_p) == 3.0, abs(axis_r) == 3.0
    return (
        (
            inverse * e,
            x_p if first_p else (x_r if first_r else x_s),
            x_p if second_p else (x_r if second_r else x_s),
            x_p if third_p else (x_r if third_r else x_s),
        ),
        (
            w_p if first_p else (w_r if first_r else w_s),
            w_p if second_p else (w_r if second_r else w_s),
            w_p if third_p else (w_r if third_r else w_s),
        ),
    )


@kernel
def free_rotation(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3, t: float) -> tuple[Quaternion, Vec3]:
    """(q_ab, omega_ab_b) at time t of a body that moves without torque from q_0, omega_b_0: exact.

    moments: (3) principal, any unit; q_0: (4); omega_b_0: (3) rad/s, body components; t: s, of either sign.
    Error and singularities: see `free_rotation_at`, `free_rotation_setup`, which serve many t of one body.
    """
    return free_rotation_at(free_rotation_setup(moments, q_0, omega_b_0), t)


@kernel
def _is_even(n: float) -> bool:
    half = 0.5 * n
    return round_to_integer(half) == half


@kernel
def _without_turns(a_1: float, a_2: float, t: float) -> DoubleDouble:
    """(a_1 + a_2) t less an integer, within [-1, 1]."""
    high, low = two_product(a_1, t)
    low += a_2 * t
    high, low = two_sum(high - round_to_integer(high), low)
    return (high - round_to_integer(high), low)


@kernel
def _sincos_half_turns(high: float, low: float) -> tuple[float, float]:
    """(sin, cos) of pi (high + low), low small."""
    angle, rest = two_product(PI[0], high)
    rest += PI[0] * low + PI[1] * high
    s, c = sincos(angle)
    return (s + c * rest, c - s * rest)


@kernel
def _sincos_half_turns_plus(turns: DoubleDouble, angle: float) -> tuple[float, float]:
    """(sin, cos) of 2 pi turns + angle."""
    high, low = two_product(2.0 * PI[0], turns[0])
    high, rest = two_sum(high, angle)
    rest += low + 2.0 * (PI[0] * turns[1] + PI[1] * turns[0])
    s, c = sincos(high)
    return (s + c * rest, c - s * rest)
