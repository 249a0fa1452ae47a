"""Exact torque-free motion of one rigid body: any inertia, any time, any state.

In axes (p, r, s), r that of the middle moment and s the one about which the body precesses, with signs that make
m_p, m_s >= 0, the angular momentum is m = (A_p cn u, A_r sn u, A_s dn u), u = u_0 + lambda t
(Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30, 2008, section 2).  Corrections to that paper: amplitudes
and modulus come from sums of terms of one sign, never from G^2 - 2 T I_r, and the axis of dn is chosen by the sign of
that difference, so that k <= 1 (P. Leroy, "On an article by Celledoni et al.", Principia).

The attitude is q = q_0 S^-1 P(m_0)^-1 Z(psi) P(m) S: S takes the body's axes to (p, r, s), P(m) turns m onto z by the
shortest way, Z turns about z by psi (see _precession.py).  With kappa = I_s (I_r - I_p) / (I_p (I_s - I_r)) and
rho = (A_p / A_s)^2, kappa rho = k^2, all is a sum of terms of one sign, for any inertia: nothing cancels, nothing has a
pole.  What grows with t is double-double, the rest is bounded: the error does not grow.
"""

import math

from ._free_rotation_setup import FREE_ROTATION_SIZE as FREE_ROTATION_SIZE
from ._free_rotation_setup import SEPARATRIX, STEADY, steady_setup, tumbling_setup
from ._free_rotation_setup import FreeRotation as FreeRotation
from ._kernel import kernel
from ._precession import precession
from ._scaling import power_of_two_for, round_to_integer
from ._turns import sincos_half_turns, turned, without_turns
from .double_double import PI, DoubleDouble, dd_add, two_product, two_sum
from .elementary import sincos
from .elliptic import jacobi_from_phase, jacobi_low_parts
from .quaternion import compose_quaternions
from .shapes import Quaternion, Vec3

_LAST_TURN = 1e28  # of psi / (4 pi): double-double has no digit left there
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
    scale = power_of_two_for(max(max(i_1, i_2), i_3)) if valid else math.nan
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
    """(q_ab, omega_ab_b) at time t after the state of `setup`; q_ab of unit length and without jumps of sign.

    t: s, of either sign.  Error for exact inputs, of the attitude's angle and of omega relative to |omega|: 1 eps, at
    most 5 eps, for any body, state and time; beyond |omega t| = 1e14 plus 3e-31 |omega t|, and NaN beyond some 1e29.
    """
    axis_p, axis_r, axis_s = setup[21:24]
    scaled = setup[1] * t
    scaled = scaled if abs(setup[2] * scaled) < _LAST_TURN else math.nan
    turned, omega = _steady(setup, scaled) if setup[0] == STEADY else _tumble(setup, scaled)
    e, x_p, x_r, x_s = compose_quaternions(setup[17:21], turned)
    length = math.sqrt(e * e + x_p * x_p + x_r * x_r + x_s * x_s)
    inverse = 1.0 / (length if length != 0.0 else math.nan)
    x_p = math.copysign(inverse, axis_p) * x_p
    x_r = math.copysign(inverse, axis_r) * x_r
    x_s = math.copysign(inverse, axis_s) * x_s
    x_1, x_2, x_3 = _in_body_axes((x_p, x_r, x_s), abs(axis_p), abs(axis_r))
    return ((inverse * e, x_1, x_2, x_3), _in_body_axes(omega, abs(axis_p), abs(axis_r)))


@kernel(inline=False)
def free_rates_at(setup: FreeRotation, t: float) -> Vec3:
    """omega_ab_b of `free_rotation_at`, alone."""
    scaled = setup[1] * t
    scaled = scaled if abs(setup[2] * scaled) < _LAST_TURN else math.nan
    if setup[0] == STEADY:
        return setup[14:17]  # type: ignore[no-any-return]
    done, more, sin_x, cos_x = _phase(setup, scaled)
    sn, cn, dn = jacobi_from_phase(sin_x, cos_x, setup[24:38])
    flip = 1.0 if _is_even(done) == _is_even(more) else -1.0
    return _in_body_axes(_rates(setup, flip, sn, cn, dn), abs(setup[21]), abs(setup[22]))


@kernel
def free_rotation(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3, t: float) -> tuple[Quaternion, Vec3]:
    """(q_ab, omega_ab_b) at time t of a body that moves without torque from q_0, omega_b_0: exact.

    moments: (3) principal, any unit; q_0: (4); omega_b_0: (3) rad/s, body components; t: s, of either sign.
    Error and singularities: see `free_rotation_at`, `free_rotation_setup`, which serve many t of one body.
    """
    return free_rotation_at(free_rotation_setup(moments, q_0, omega_b_0), t)


@kernel
def free_rotation_is_singular(moments: Vec3) -> bool:
    """Whether no motion exists: a moment is negative or infinite, or 0 while the others differ."""
    a, b, c = moments
    refused = a < 0.0 or b < 0.0 or c < 0.0 or a == math.inf or b == math.inf or c == math.inf
    return refused or (a == 0.0 and b != c) or (b == 0.0 and c != a) or (c == 0.0 and a != b)


@kernel
def _steady(setup: FreeRotation, t: float) -> tuple[Quaternion, Vec3]:
    """The turn about the constant rate's axis, and the rate."""
    return turned((setup[11:14], (setup[2], setup[3])), t), setup[14:17]


@kernel
def _phase(setup: FreeRotation, t: float) -> tuple[float, float, float, float]:
    """Of the phase x / pi of the polhode: half turns done, those that the start adds, (sin, cos) of the rest."""
    x_0 = (setup[6], setup[7])
    high, low = two_product(setup[4], t)
    low += setup[5] * t
    done, more = 0.0, 0.0
    if setup[0] == SEPARATRIX:
        high, low = dd_add((high, low), x_0)
        high = _LAST_X if high > _LAST_X else (-_LAST_X if high < -_LAST_X else high)
    else:
        done = round_to_integer(high)
        high, low = dd_add(two_sum(high - done, low), x_0)
        more = round_to_integer(high)
        high -= more
    sin_x, cos_x = sincos_half_turns((high, low))
    if cos_x < 0.0:
        more += math.copysign(1.0, sin_x)
        sin_x, cos_x = -sin_x, -cos_x
    return done, more, sin_x, cos_x


@kernel
def _rates(setup: FreeRotation, flip: float, sn: float, cn: float, dn: float) -> Vec3:
    """The rates about p, r, s with their body axes' signs."""
    sn_2, cn_2, dn_2 = jacobi_low_parts(sn, cn, dn, (setup[46], setup[47]))
    w_p, w_r, w_s = setup[14:17]
    return (
        flip * (w_p * cn + (w_p * cn_2 + setup[43] * cn)),
        flip * (w_r * sn + (w_r * sn_2 + setup[44] * sn)),
        w_s * dn + (w_s * dn_2 + setup[45] * dn),
    )


@kernel
def _tumble(setup: FreeRotation, t: float) -> tuple[Quaternion, Vec3]:
    """Z(psi) P(m), of any length, and the rates about p, r, s with their body axes' signs."""
    half_turn, psi_0 = (setup[8], setup[9]), setup[10]
    mu_p, mu_r, mu_s = setup[11:14]
    done, more, sin_x, cos_x = _phase(setup, t)
    sn, cn, dn = jacobi_from_phase(sin_x, cos_x, setup[24:38])
    # psi / (4 pi), whole turns dropped as they arise
    psi = dd_add(without_turns(half_turn, done), without_turns(half_turn, more))
    psi = dd_add(without_turns((setup[2], setup[3]), t), psi)
    s, c = _sincos_turns_plus(psi, 0.5 * (precession(sn, cn, dn, setup[38:43]) - psi_0))
    flip = 1.0 if _is_even(done) == _is_even(more) else -1.0
    # P = (1 + mu_s, mu_r, -mu_p, 0) / sqrt(2 (1 + mu_s)), mu = m / |m|
    mu_p, mu_r, z = flip * mu_p * cn, flip * mu_r * sn, 1.0 + mu_s * dn
    return ((c * z, c * mu_r + s * mu_p, s * mu_r - c * mu_p, s * z), _rates(setup, flip, sn, cn, dn))


@kernel
def _in_body_axes(v: Vec3, p: float, r: float) -> Vec3:
    """V given along p, r and s; p, r: the numbers 1, 2, 3 of the body axes."""
    return (
        v[0] if p == 1.0 else (v[1] if r == 1.0 else v[2]),
        v[0] if p == 2.0 else (v[1] if r == 2.0 else v[2]),
        v[0] if p == 3.0 else (v[1] if r == 3.0 else v[2]),
    )


@kernel
def _is_even(n: float) -> bool:
    half = 0.5 * n
    return round_to_integer(half) == half


@kernel
def _sincos_turns_plus(turns: DoubleDouble, angle: float) -> tuple[float, float]:
    """(sin, cos) of 2 pi turns + angle."""
    high, low = two_product(2.0 * PI[0], turns[0])
    high, rest = two_sum(high, angle)
    rest += low + 2.0 * (PI[0] * turns[1] + PI[1] * turns[0])
    s, c = sincos(high)
    return (s + c * rest, c - s * rest)
