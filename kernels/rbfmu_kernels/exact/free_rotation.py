"""Exact torque-free motion of one rigid body: any inertia, any time, any state.

In principal axes (p, r, s) the angular momentum is m = (A_p cn u, A_r sn u, A_s dn u), u = u_0 + lambda t
(Celledoni, Fasso, Saefstroem & Zanna, SIAM J. Sci. Comput. 30, 2008, section 2): r is the axis of the middle moment, s
the axis about which the body precesses, and their signs make m_p, m_s >= 0.  Corrections to that paper: amplitudes
and modulus come from sums of terms of one sign, never from G^2 - 2 T I_r, and the axis of dn is chosen by the sign of
that difference, so that k <= 1 (P. Leroy, "On an article by Celledoni et al.", Principia).

With kappa = I_s (I_r - I_p) / (I_p (I_s - I_r)) and rho = (A_p / A_s)^2, kappa rho = k^2, each number is a sum of terms
of one sign, for any inertia: nothing cancels, and nothing has a pole.

The attitude is q = q_0 S^-1 Q(u_0)^-1 Z(psi) Q(u) S. S takes the body's axes to (p, r, s), Z is a steady turn about the
angular momentum, and Q is periodic in u (see free_rotation_series.py).  Numbers that grow with t are double-double, the
others are bounded: the error does not grow.
"""

import math
from typing import NamedTuple

from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import WIDEST, lane_at, put_lane_at, wide_at, width_of
from ..compile.wide import choose
from ..numerics import double_double as dd, elementary, elliptic
from ..numerics.double_double import DoubleDouble, Vector, two_sum
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, largest_of, scale_quaternion, square_of
from ..rotations.vec3 import scale
from ..types import Array, Buffer, FreeRotationNumbers, Quaternion, Vec3
from . import free_rotation_setup as constants, uniform_rotation
from .free_rotation_series import NEAR, SEPARATRIX, STEADY, TUMBLING, jacobi_of, place_of, read_steady, turn_of
from .free_rotation_setup import FreeRotation, in_body_axes, read_free_rotation

__all__ = ["free_rotation", "free_rotation_at", "free_rotation_setup"]

_LAST_TURN = 1e28  # psi / (4 pi) from which on double-double has no digit left
_LAST_X = 0.4334246564202994  # x at u = 600 on the separatrix: from there on the rate is along r alone, to 1e-260


@kernel(inline=False)
def free_rotation_setup(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3) -> FreeRotationNumbers:
    """Return the constants of a body's torque-free motion, for `free_rotation_at`, as a tuple of floats.

    moments: principal, any unit, any order; q_0: body to inertial axes; omega_b_0: rad/s, body components.
    One zero moment (a slender beam, the others equal) is the limit of a thin rod: the rate about it stays constant.
    NaN where there is no motion: a negative moment, a zero moment beside unequal ones, a non-finite argument.
    """
    motion = free_rotation_of(dd.vector(moments), q_0, dd.vector(omega_b_0))
    return constants.flatten_free_rotation(motion)  # type: ignore[no-any-return]


@kernel
def free_rotation_of(moments: Vector, q_0: Quaternion, omega_b_0: Vector) -> FreeRotation:
    """Return the constants of `free_rotation_setup`, from moments and a rate in double-double."""
    (i_1, _), (i_2, _), (i_3, _) = moments
    valid = 0.0 <= i_1 < math.inf and 0.0 <= i_2 < math.inf and 0.0 <= i_3 < math.inf
    (j_1, j_2, j_3), q, omega, unit = scaled_for_setup(moments, q_0, omega_b_0)
    none = (math.nan, math.nan)
    j_1, j_2, j_3 = dd.choose(valid, j_1, none), dd.choose(valid, j_2, none), dd.choose(valid, j_3, none)
    unit = unit if valid else math.nan
    (w_1, _), (w_2, _), (w_3, _) = omega
    steady_1 = j_2 == j_3 or w_2 == 0.0 or w_3 == 0.0
    steady_2 = j_3 == j_1 or w_3 == 0.0 or w_1 == 0.0
    steady_3 = j_1 == j_2 or w_1 == 0.0 or w_2 == 0.0
    if steady_1 and steady_2 and steady_3:
        return constants.steady_setup(q, omega, unit)
    return constants.tumbling_setup((j_1, j_2, j_3), q, omega, unit)


@kernel
def scaled_for_setup(moments: Vector, q_0: Quaternion, omega_b_0: Vector) -> tuple[Vector, Quaternion, Vector, float]:
    """Return moments, attitude and rate scaled by powers of two to about 1, and the inverse of the rate's factor."""
    q, up = scale_quaternion(elementary.power_of_two_for(largest_of(q_0)), q_0), uniform_rotation.power_for(omega_b_0)
    return dd.scale_vector(uniform_rotation.power_for(moments), moments), q, dd.scale_vector(up, omega_b_0), 1.0 / up


@kernel(inline=False)
def free_rotation_at(setup: FreeRotationNumbers, t: float) -> tuple[Quaternion, Vec3]:
    """Return (q_ab, omega_ab_b) at time t after the state of `setup`; q_ab of unit length and without jumps of sign.

    t: s, of either sign.  Error for exact inputs, of the attitude's angle in rad and of omega relative to |omega|:
    1 eps, at most 6 eps, for any body and state to |omega t| = 1e9, and away from the separatrix to 1e13. Beyond that
    5e-29 |omega t| is added; within 1e-3 of the separatrix, where differences in double-double lose up to 8 digits,
    5e-26 |omega t|. NaN beyond |omega t| of some 1e29.
    If a moment is above the sum of the others, as no body's is, and flips are far faster than omega, the error of omega
    is up to 30 eps of the largest |omega| in a flip.
    """
    motion = read_free_rotation(setup)
    time = scaled_time(motion, (t, 0.0))
    place = place_at(motion, time)
    return free_attitude_at(motion, time, place), free_rate_at(motion, place)


@kernel
def free_rotation(moments: Vec3, q_0: Quaternion, omega_b_0: Vec3, t: float) -> tuple[Quaternion, Vec3]:
    """Return (q_ab, omega_ab_b) at time t of a body that moves without torque from q_0 and omega_b_0, in closed form.

    Units: moments any, principal; omega_b_0 in rad/s; t in s, of either sign.
    Frames: the axes of b are the principal ones; omega_b_0 in b, q_0 from b to a.
    Error <= 1 eps, at most 6 eps, to |omega t| = 1e9 and mostly to 1e13: in rad from the exact attitude at t, and of
    omega relative to |omega|; see `free_rotation_at`.
    Singular: where no motion exists, which gives NaN; see `free_rotation_setup`. For many times of one body, call that
    once and `free_rotation_at` for each time.  Source: Celledoni, Fasso, Saefstroem & Zanna 2008.
    """
    return free_rotation_at(free_rotation_setup(moments, q_0, omega_b_0), t)


@kernel
def free_rotation_is_singular(moments: Vec3) -> bool:
    """Return whether no motion exists: a moment is negative or infinite, or 0 while the others differ."""
    a, b, c = moments
    refused = a < 0.0 or b < 0.0 or c < 0.0 or a == math.inf or b == math.inf or c == math.inf
    return refused or (a == 0.0 and b != c) or (b == 0.0 and c != a) or (c == 0.0 and a != b)


@kernel
def with_axes_turned(motion: FreeRotation, q: Quaternion) -> FreeRotation:
    """Return the motion with q appended to its attitude, q_ab o q; its rates are in the same axes as before."""
    a, b, c, d = motion.columns
    columns = (
        compose_quaternions(a, q), compose_quaternions(b, q), compose_quaternions(c, q), compose_quaternions(d, q),
    )  # fmt: skip
    return FreeRotation(
        kind=motion.kind, unit=motion.unit, precession=motion.precession, phase_rate=motion.phase_rate,
        phase=motion.phase, rates=motion.rates, rates_low=motion.rates_low, kc_squared=motion.kc_squared,
        width=motion.width, shift=motion.shift, columns=columns, p=motion.p, r=motion.r, series=motion.series,
    )  # fmt: skip


@kernel
def scaled_time(motion: FreeRotation, t: DoubleDouble) -> DoubleDouble:
    """Return the time t, s, in the unit of the constants; NaN where no digit of the attitude is left."""
    high, low = dd.scale(motion.unit, t)
    return (choose(abs(motion.precession[0] * high) < _LAST_TURN, high, math.nan), low)


@kernel
def place_at(motion: FreeRotation, t: DoubleDouble) -> elliptic.Place:
    """Return where on the polhode the body is at the scaled time t."""
    if motion.kind == SEPARATRIX:
        rate, low_rate = motion.phase_rate
        phase = two_sum(2.0 * rate * t[0], 2.0 * (low_rate * t[0] + rate * t[1]))
        high, low = dd.add(phase, motion.phase)
        high = choose(abs(high) > _LAST_X, math.copysign(_LAST_X, high), high)
    else:
        high, low = uniform_rotation.without_turns(motion.phase_rate, t)
        high, low = dd.add((2.0 * high, 2.0 * low), motion.phase)
    return place_of(motion.kind, (high, low), motion.width)


@kernel
def free_attitude_at(motion: FreeRotation, t: DoubleDouble, place: elliptic.Place) -> Quaternion:
    """Return q_ab at the scaled time t."""
    high, low = uniform_rotation.without_turns(motion.precession, t)
    if motion.kind == STEADY:
        s, e = elementary.sincos_half_turns(2.0 * high, 2.0 * low)
        p, r, s = scale(s, read_steady(motion.series).axis)
    else:
        e, p, r, s = turn_of(motion.kind, place, (2.0 * high, 2.0 * low), motion.shift, motion.series)
    of_1, of_p, of_r, of_s = motion.columns
    first = add_scaled_quaternion(scale_quaternion(e, of_1), p, of_p)
    second = add_scaled_quaternion(scale_quaternion(r, of_r), s, of_s)
    q = add_scaled_quaternion(first, 1.0, second)
    square = square_of(q)
    return scale_quaternion(1.0 / math.sqrt(choose(square != 0.0, square, math.nan)), q)


@kernel
def free_rate_at(motion: FreeRotation, place: elliptic.Place) -> Vec3:
    """Return omega_ab_b at a place on the polhode."""
    (w_p, w_r, w_s), (low_p, low_r, low_s) = motion.rates, motion.rates_low
    if motion.kind != STEADY:
        sn, cn, dn = jacobi_of(motion.kind, place, motion.series)
        sn_2, cn_2, dn_2 = elliptic.jacobi_low_parts(sn, cn, dn, motion.kc_squared)
        w_p = w_p * cn + (w_p * cn_2 + low_p * cn)
        w_r = w_r * sn + (w_r * sn_2 + low_r * sn)
        w_s = w_s * dn + (w_s * dn_2 + low_s * dn)
    return in_body_axes((w_p, w_r, w_s), motion.p, motion.r)


_MOMENTS, _Q, _OMEGA, _TIME, _BODY, _RESULT = 0, 3, 7, 10, 11, 12
_ROWS = 20
SCRATCH = 2 * WIDEST * _ROWS
"""How many numbers the work space has, which begins at a cache line: a vector of bodies for each of two kinds."""
_ALONE = -1.0
_MARGIN = 1e-3
"""How far kc^2 must be from the limit between kinds: far more than its round-off in plain doubles."""
_LEAST_KC_SQUARED = 1e-6
"""Below this, near the separatrix, kc^2 in plain doubles has too few digits to decide the kind."""
_LEAST, _LARGEST = 1e-60, 1e60
"""Bounds of moments and rates: products of five of them, as in `_kind_of`, stay between 1e-300 and 1e300."""


class Bodies(NamedTuple):
    """Moments (m, 3), and attitudes (m, 4) and rates (m, 3) at the start, of m bodies: see `free_rotation`."""

    moments: Array
    q_0: Array
    omega_b_0: Array


class Motions(NamedTuple):
    """Times (m, n), or (1, n) of all bodies, and the attitudes (m, n, 4) and rates (m, n, 3) then."""

    t: Array
    q: Array
    omega: Array


@kernel(inline=False)
def free_rotations(
    moments: Array, q_0: Array, omega_b_0: Array, t: Array, scratch: Array, q: Array, omega: Array
) -> bool:
    """Set q (m, n, 4) and omega (m, n, 3) to the motions of m bodies at n times, several bodies side by side.

    moments (m, 3), q_0 (m, 4), omega_b_0 (m, 3): see `free_rotation`. t: s, (m, n), or (1, n) for all bodies. scratch:
    `SCRATCH` numbers. Returns whether any body has singular moments (see `free_rotation_is_singular`).
    """
    bodies, found = Bodies(moments, q_0, omega_b_0), Motions(t, q, omega)
    return in_lanes(bodies, found, wide_at(scratch, 0, WIDEST), wide_at(scratch, WIDEST * _ROWS, WIDEST))


@kernel
def in_lanes(bodies: Bodies, found: Motions, tumbling: Buffer, near: Buffer) -> bool:
    """Do the work of `free_rotations`; tumbling, near: lanes for bodies of these kinds. Others are done one by one."""
    tumblers, nearers, singular = 0, 0, False
    for i in range(len(bodies.moments)):
        moments = vec3_at(bodies.moments[i], 0)
        kind = _kind_of(moments, vec3_at(bodies.omega_b_0[i], 0))
        if kind == TUMBLING:
            tumblers = _join(tumbling, tumblers, i, bodies, found)
        elif kind == NEAR:
            nearers = _join(near, nearers, i, bodies, found)
        else:
            singular |= free_rotation_is_singular(moments)
            _alone(i, bodies, found)
    if tumblers > 0:
        _together(tumbling, tumblers, bodies, found)
    if nearers > 0:
        _together(near, nearers, bodies, found)
    return singular


@kernel
def _join(c: Buffer, count: int, body: int, bodies: Bodies, found: Motions) -> int:
    """Put a body into the next lane, and do all lanes once they are full; return how many bodies then wait."""
    _load(c, count, body, bodies)
    if count + 1 < width_of(c):
        return count + 1
    _together(c, count + 1, bodies, found)
    return 0


@kernel
def _kind_of(moments: Vec3, omega: Vec3) -> float:
    """Return the kind of a motion, or `_ALONE` where plain doubles leave doubt about it.

    d, kappa and kc^2 are those of `polhode_axes`, `kappa_of` and `tumbling_setup`, in plain doubles.
    """
    (a, b, c), (x, y, z) = moments, omega
    for moment in moments:
        if not _LEAST < moment < _LARGEST:
            return _ALONE
    for rate in omega:
        if not _LEAST < abs(rate) < _LARGEST:
            return _ALONE
    if a > b:
        a, b, x, y = b, a, y, x
    if b > c:
        b, c, y, z = c, b, z, y
    if a > b:
        a, b, x, y = b, a, y, x
    if a == b or b == c:
        return _ALONE
    d = z * z * c * (c - b) - x * x * a * (b - a)
    if d < 0.0:
        a, c, x, z, d = c, a, z, x, -d
    kappa = c * (b - a) / (a * (c - b))
    kc_squared = d * c / (abs(c - b) * (c * c * z * z + b * b * y * y * kappa / (1.0 + kappa)))
    if kc_squared > elliptic.NEAREST_KC * elliptic.NEAREST_KC + _MARGIN:
        return TUMBLING
    return NEAR if _LEAST_KC_SQUARED < kc_squared < elliptic.NEAREST_KC * elliptic.NEAREST_KC - _MARGIN else _ALONE


@kernel
def _load(c: Buffer, lane: int, body: int, bodies: Bodies) -> None:
    for k in range(3):
        put_lane_at(c, _MOMENTS + k, lane, bodies.moments[body, k])
        put_lane_at(c, _OMEGA + k, lane, bodies.omega_b_0[body, k])
    for k in range(4):
        put_lane_at(c, _Q + k, lane, bodies.q_0[body, k])
    put_lane_at(c, _BODY, lane, float(body))


@kernel(inline=False)
def _alone(body: int, bodies: Bodies, found: Motions) -> None:
    moments, omega = vec3_at(bodies.moments[body], 0), vec3_at(bodies.omega_b_0[body], 0)
    setup = free_rotation_setup(moments, quaternion_at(bodies.q_0[body], 0), omega)
    t = found.t[body % len(found.t)]
    for k in range(len(t)):
        attitude, rate = free_rotation_at(setup, t[k])
        put_quaternion_at(found.q[body, k], 0, attitude)
        put_vec3_at(found.omega[body, k], 0, rate)


@kernel(inline=False)
def _together(c: Buffer, count: int, bodies: Bodies, found: Motions) -> None:
    """Set the motions of the bodies in the first `count` lanes; the other lanes compute a copy of the first."""
    for lane in range(count, width_of(c)):
        _load(c, lane, int(lane_at(c, _BODY, 0)), bodies)
    attitude: Quaternion = quaternion_at(c, _Q)
    start, rates = dd.vector(vec3_at(c, _MOMENTS)), dd.vector(vec3_at(c, _OMEGA))
    scaled, attitude, rates, unit = scaled_for_setup(start, attitude, rates)
    motion = constants.tumbling_setup(scaled, attitude, rates, unit)
    for k in range(found.t.shape[1]):
        for lane in range(width_of(c)):
            put_lane_at(c, _TIME, lane, found.t[int(lane_at(c, _BODY, lane)) % len(found.t), k])
        time = scaled_time(motion, (c[_TIME], 0.0))
        place = place_at(motion, time)
        put_quaternion_at(c, _RESULT, free_attitude_at(motion, time, place))
        put_vec3_at(c, _RESULT + 4, free_rate_at(motion, place))
        for lane in range(count):
            body = int(lane_at(c, _BODY, lane))
            for j in range(4):
                found.q[body, k, j] = lane_at(c, _RESULT + j, lane)
            for j in range(3):
                found.omega[body, k, j] = lane_at(c, _RESULT + 4 + j, lane)
