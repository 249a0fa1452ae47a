"""Exact torque-free motion of one rigid body: any inertia, any time, any state.

In axes (p, r, s), r that of the middle moment and s the one about which the body precesses, with signs that make
m_p, m_s >= 0, the angular momentum is m = (A_p cn u, A_r sn u, A_s dn u), u = u_0 + lambda t
(Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30, 2008, section 2).  Corrections to that paper: amplitudes
and modulus come from sums of terms of one sign, never from G^2 - 2 T I_r, and the axis of dn is chosen by the sign of
that difference, so that k <= 1 (P. Leroy, "On an article by Celledoni et al.", Principia).

With kappa = I_s (I_r - I_p) / (I_p (I_s - I_r)) and rho = (A_p / A_s)^2, kappa rho = k^2, all is a sum of terms of one
sign, for any inertia: nothing cancels, nothing has a pole.

The attitude is q = q_0 S^-1 Q(u_0)^-1 Z(psi) Q(u) S: S takes the body's axes to (p, r, s), Z turns about the angular
momentum, steadily, Q is periodic in u (see free_rotation_series.py).  What grows with t is double-double, the rest is
bounded: the error does not grow.
"""

import math

from ..compile.decorator import kernel
from ..numerics.agm import jacobi_low_parts
from ..numerics.double_double import DoubleDouble, Vector, dd_add, dd_scale, dd_scale_vector, dd_vector, two_sum
from ..numerics.elementary import sincos_half_turns
from ..numerics.scaling import power_of_two_for
from ..rotations.quaternion import square_of
from ..types import Quaternion, Vec3
from .free_rotation_series import SEPARATRIX, STEADY, jacobi_of, place_of, turn_of
from .free_rotation_series import Place as Place
from .free_rotation_setup import FREE_ROTATION_SIZE as FREE_ROTATION_SIZE
from .free_rotation_setup import FreeRotation as FreeRotation
from .free_rotation_setup import in_body_axes as in_body_axes
from .free_rotation_setup import steady_setup, tumbling_setup
from .uniform_rotation import power_for, without_turns

COLUMNS = 19
"""Where in a `FreeRotation` the 16 numbers of its columns begin: what 1, i_p, i_r, i_s are after q_0, in body axes."""
_LAST_TURN = 1e28  # of psi / (4 pi): double-double has no digit left there
_LAST_X = 0.4334246564202994  # u = 600 on the separatrix: from there on the body rests at the middle axis, to 1e-260


@kernel(inline=False)
def free_rotation_setup(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3) -> FreeRotation:
    """The constants of a body's torque-free motion, for `free_rotation_at`: a flat tuple of FREE_ROTATION_SIZE floats.

    moments: principal, any unit, any order; q_0: body to inertial axes; omega_b_0: rad/s, body components.
    One zero moment (a slender beam, the others equal) is the limit of a thin rod: the rate about it stays constant.
    NaN where there is no motion: a negative moment, a zero moment beside unequal ones, a non-finite argument.
    """
    return free_rotation_of(dd_vector(moments), q_0, dd_vector(omega_b_0))


@kernel
def free_rotation_of(moments: Vector, q_0: Quaternion, omega_b_0: Vector) -> FreeRotation:
    """`free_rotation_setup` of numbers known to more digits."""
    (i_1, _), (i_2, _), (i_3, _) = moments
    valid = 0.0 <= i_1 < math.inf and 0.0 <= i_2 < math.inf and 0.0 <= i_3 < math.inf
    scale = power_for(moments) if valid else math.nan
    j_1, j_2, j_3 = dd_scale_vector(scale, moments)
    scale = power_of_two_for(max(max(abs(q_0[0]), abs(q_0[1])), max(abs(q_0[2]), abs(q_0[3]))))
    q = (scale * q_0[0], scale * q_0[1], scale * q_0[2], scale * q_0[3])
    scale = power_for(omega_b_0)
    omega = dd_scale_vector(scale, omega_b_0)
    (w_1, _), (w_2, _), (w_3, _) = omega
    unit = 1.0 / scale if valid else math.nan
    steady_1 = j_2 == j_3 or w_2 == 0.0 or w_3 == 0.0
    steady_2 = j_3 == j_1 or w_3 == 0.0 or w_1 == 0.0
    steady_3 = j_1 == j_2 or w_1 == 0.0 or w_2 == 0.0
    if steady_1 and steady_2 and steady_3:
        return steady_setup(q, omega, unit)
    return tumbling_setup((j_1, j_2, j_3), q, omega, unit)


@kernel(inline=False)
def free_rotation_at(setup: FreeRotation, t: float) -> tuple[Quaternion, Vec3]:
    """(q_ab, omega_ab_b) at time t after the state of `setup`; q_ab of unit length and without jumps of sign.

    t: s, of either sign.  Error for exact inputs, of the attitude's angle and of omega relative to |omega|: 1 eps, at
    most 5 eps, for any body, state and time; beyond |omega t| = 1e14 plus 3e-31 |omega t|, and NaN beyond some 1e29.
    Of omega 30 eps where a moment is above the sum of the others, as no body's is, and flips are far faster than omega.
    """
    time = scaled_time(setup, (t, 0.0))
    place = place_at(setup, time)
    return (attitude_at(setup, time, place), in_body_axes(rates_at(setup, place), setup[35], setup[36]))


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
def scaled_time(setup: FreeRotation, t: DoubleDouble) -> DoubleDouble:
    """t in the unit of the constants; NaN where no digit is left."""
    high, low = dd_scale(setup[1], t)
    return (high if abs(setup[2] * high) < _LAST_TURN else math.nan, low)


@kernel
def place_at(setup: FreeRotation, t: DoubleDouble) -> Place:
    """Where on the polhode the body is at the scaled time t."""
    if setup[0] == SEPARATRIX:
        phase = two_sum(2.0 * setup[4] * t[0], 2.0 * (setup[5] * t[0] + setup[4] * t[1]))
        high, low = dd_add(phase, (setup[6], setup[7]))
        high = math.copysign(_LAST_X, high) if abs(high) > _LAST_X else high
    else:
        high, low = without_turns((setup[4], setup[5]), t)
        high, low = dd_add((2.0 * high, 2.0 * low), (setup[6], setup[7]))
    return place_of(setup[0], (high, low), (setup[16], setup[17]))


@kernel
def attitude_at(setup: FreeRotation, t: DoubleDouble, place: Place) -> Quaternion:
    """q_ab at the scaled time t."""
    high, low = without_turns((setup[2], setup[3]), t)
    if setup[0] == STEADY:
        s, e = sincos_half_turns(2.0 * high, 2.0 * low)
        p, r, s = s * setup[37], s * setup[38], s * setup[39]
    else:
        e, p, r, s = turn_of(setup[0], place, (2.0 * high, 2.0 * low), setup[18], setup[37:62])
    q_0 = (e * setup[19] + p * setup[23]) + (r * setup[27] + s * setup[31])
    q_1 = (e * setup[20] + p * setup[24]) + (r * setup[28] + s * setup[32])
    q_2 = (e * setup[21] + p * setup[25]) + (r * setup[29] + s * setup[33])
    q_3 = (e * setup[22] + p * setup[26]) + (r * setup[30] + s * setup[34])
    square = square_of((q_0, q_1, q_2, q_3))
    inverse = 1.0 / math.sqrt(square if square != 0.0 else math.nan)
    return (inverse * q_0, inverse * q_1, inverse * q_2, inverse * q_3)


@kernel
def rates_at(setup: FreeRotation, place: Place) -> Vec3:
    """The rates about p, r, s with their body axes' signs."""
    if setup[0] == STEADY:
        return setup[8:11]  # type: ignore[no-any-return]
    sn, cn, dn = jacobi_of(setup[0], place, setup[37:62])
    sn_2, cn_2, dn_2 = jacobi_low_parts(sn, cn, dn, (setup[14], setup[15]))
    w_p, w_r, w_s = setup[8:11]
    return (
        w_p * cn + (w_p * cn_2 + setup[11] * cn),
        w_r * sn + (w_r * sn_2 + setup[12] * sn),
        w_s * dn + (w_s * dn_2 + setup[13] * dn),
    )
