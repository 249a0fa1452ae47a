"""Euler parameters (unit quaternions), scalar first: q_ab = (eta, eps) of R_ab; the error of an attitude."""

import math

from ..compile.decorator import kernel
from ..compile.wide import choose
from ..numerics.elementary import atan2, scale_for_squares, sincos
from ..types import Quaternion, Vec3
from . import vec3

__all__ = [
    "add_scaled_quaternion", "angle_between", "attitude_error", "attitude_error_rate", "compose_quaternions",
    "invert_quaternion", "normalize", "omega_a_from_quaternion_rate", "omega_b_from_quaternion_rate",
    "quaternion_rate_a", "quaternion_rate_b", "rotate", "slerp",
]  # fmt: skip


@kernel
def compose_quaternions(q_ab: Quaternion, q_bc: Quaternion) -> Quaternion:
    """Return q_ac of R_ac = R_ab R_bc, the product of quaternions of any lengths.

    Units: dimensionless.  Frames: q_ab takes coordinates in b to a, q_bc those in c to b.
    Error <= 2 eps |q_ab| |q_bc|, of unit ones 1.2 eps.  Singular: nowhere.  Source: E&G 6.7.
    """
    a0, a1, a2, a3 = q_ab
    b0, b1, b2, b3 = q_bc
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@kernel
def invert_quaternion(q_ab: Quaternion) -> Quaternion:
    """Return q_ba = (eta, -eps); if q_ab is not unit, this is the conjugate and not the inverse.

    Units: dimensionless.  Frames: q_ab takes coordinates in b to a, the result those in a to b.
    Exact for every q_ab.  Singular: nowhere.  Source: E&G 6.7.
    """
    return (q_ab[0], -q_ab[1], -q_ab[2], -q_ab[3])


@kernel
def add_scaled_quaternion(p: Quaternion, s: float, q: Quaternion) -> Quaternion:
    """Return p + s q."""
    return (p[0] + s * q[0], p[1] + s * q[1], p[2] + s * q[2], p[3] + s * q[3])


@kernel
def scale_quaternion(s: float, q: Quaternion) -> Quaternion:
    """Return s q."""
    return (s * q[0], s * q[1], s * q[2], s * q[3])


@kernel
def largest_of(q: Quaternion) -> float:
    """Return the largest absolute value of a component."""
    return max(max(abs(q[0]), abs(q[1])), max(abs(q[2]), abs(q[3])))


@kernel
def normalize(q: Quaternion) -> Quaternion:
    """Return the unit quaternion q / |q|; q may have any length.

    Where |q| is beyond 2^+-500, it is scaled by a power of two before squaring.
    Units: any; the result is dimensionless.  Frames: those of q.
    Error <= 1.8 eps.  Singular: at the zero quaternion, which gives NaN.  Source: lecture, "Euler parameters".
    """
    q = scale_quaternion(scale_for_squares(largest_of(q)), q)
    length = math.sqrt(square_of(q))
    length = length if length != 0.0 else math.nan
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


@kernel
def square_of(q: Quaternion) -> float:
    """Return |q|^2."""
    return (q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3])


@kernel
def rotate(q_ab: Quaternion, v_b: Vec3) -> Vec3:
    """Return v_a = R(q_ab) v_b.

    With u = (eta v + eps x v) / |q|^2 it is v + 2 eps x u up to a quarter turn, so that a small turn has a small error;
    beyond it is (eps . v) eps / |q|^2 + eta u + eps x u (that is q v q*), where no error is doubled.
    Units: v_b any, the result alike; q_ab may have any length from 1e-150 to 1e150.  Frames: v_b in b, the result in a.
    Error <= 5 eps |v|.  Singular: at the zero quaternion, which gives NaN, as does one whose square overflows.
    Source: E&G 6.7.
    """
    eta, eps = q_ab[0], q_ab[1:]
    square = square_of(q_ab)
    s = 1.0 / choose((square > 0.0) & (square < math.inf), square, math.nan)
    u = vec3.scale(s, vec3.add(vec3.scale(eta, v_b), vec3.cross(eps, v_b)))
    x, y, z = vec3.add_scaled(vec3.scale(s * vec3.dot(eps, v_b), eps), eta, u)
    near = eta * eta > 0.5 * square
    start = (choose(near, v_b[0], x), choose(near, v_b[1], y), choose(near, v_b[2], z))
    return vec3.add_scaled(start, choose(near, 2.0, 1.0), vec3.cross(eps, u))


@kernel
def _sum_and_difference(q0: Quaternion, q1: Quaternion) -> tuple[Quaternion, float, float]:
    """Return q1 - q0, |q1 - q0| and |q1 + q0|.

    The lengths are 2 sin and 2 cos of half the angle between two unit quaternions as 4-vectors.
    """
    difference, total = add_scaled_quaternion(q1, -1.0, q0), add_scaled_quaternion(q1, 1.0, q0)
    return (difference, math.sqrt(square_of(difference)), math.sqrt(square_of(total)))


@kernel
def slerp(q0: Quaternion, q1: Quaternion, s: float) -> Quaternion:
    """Return the attitude at s on the way from q0 (s = 0) to q1 or -q1 (s = 1) at constant rate along the shorter arc.

    With p the end nearer to s, D the difference of the other end and p, t the distance from p in s and w the angle, it
    is p cos(t w) + (D + p |D|^2 / 2) sin(t w) / sin w: nothing cancels at any angle, and the ends are exact.
    s outside [0, 1] extrapolates. Quaternions that are not unit, such as zero, give no attitude: `normalize` them.
    Units: dimensionless; q0 and q1 are unit.  Frames: q0, q1 and the result are between the same two frames.
    Error <= 5 eps in [0, 1], beyond it 4 eps (1 + |s|).
    Singular: at half a turn from q0 to q1, where one of two arcs is taken.  Source: Shoemake 1985, rearranged.
    """
    dot = (q0[0] * q1[0] + q0[1] * q1[1]) + (q0[2] * q1[2] + q0[3] * q1[3])
    from_end = s > 0.5
    t = 1.0 - s if from_end else s
    end = scale_quaternion(-1.0 if dot < 0.0 else 1.0, q1)
    start = scale_quaternion(1.0, q0)  # a tuple like `end`, even if q0 is an array
    p = end if from_end else start
    step, difference, total = _sum_and_difference(p, start if from_end else end)
    sine, cosine = sincos(2.0 * t * atan2(difference, total))
    product = difference * total
    g = 2.0 * sine / (product if product > 0.0 else 1.0)
    g = g if product > 0.0 else t
    f = cosine + g * (0.5 * (difference * difference))
    return add_scaled_quaternion(scale_quaternion(f, p), g, step)


@kernel
def angle_between(q0: Quaternion, q1: Quaternion) -> float:
    """Return the angle of the rotation from q0 to q1, in [0, pi]: 4 atan2(|q1 - q0|, |q1 + q0|), whatever the signs.

    Quaternions of different lengths give a wrong angle, and zero gives half a turn: `normalize` them.
    Units: rad; q0 and q1 are unit, of any signs.  Frames: q0 and q1 are between the same two frames.
    Error <= 3.5 eps relative, from 1e-7 on.  Singular: nowhere.  Source: W. Kahan, How Futile are Mindless Assessments
    of Roundoff in Floating-Point Computation?, 12, "Mangled Angles".
    """
    _, difference, total = _sum_and_difference(q0, q1)
    swap = difference > total
    return 4.0 * atan2(total if swap else difference, difference if swap else total)


@kernel
def quaternion_rate_a(q_ab: Quaternion, omega_ab_a: Vec3) -> Quaternion:
    """Return dq_ab/dt: deta = -eps . omega / 2, deps = (eta I - skew(eps)) omega / 2.

    Units: omega_ab_a in rad/s, the result in 1/s; q_ab is unit.  Frames: omega_ab_a in a.
    Error <= 0.75 eps |omega|.  Singular: nowhere.  Source: E&G 6.9.
    """
    half = vec3.scale(0.5, omega_ab_a)
    return _rate(q_ab, half, vec3.cross(half, q_ab[1:]))


@kernel
def quaternion_rate_b(q_ab: Quaternion, omega_ab_b: Vec3) -> Quaternion:
    """Return dq_ab/dt: deta = -eps . omega / 2, deps = (eta I + skew(eps)) omega / 2.

    Units: omega_ab_b in rad/s, the result in 1/s; q_ab is unit.  Frames: omega_ab_b in b.
    Error <= 0.75 eps |omega|.  Singular: nowhere.  Source: E&G 6.9.
    """
    half = vec3.scale(0.5, omega_ab_b)
    return _rate(q_ab, half, vec3.cross(q_ab[1:], half))


@kernel
def _rate(q: Quaternion, half: Vec3, turned: Vec3) -> Quaternion:
    """Return (-eps . half, eta half + turned)."""
    return (-vec3.dot(q[1:], half), *vec3.add_scaled(turned, q[0], half))


@kernel
def omega_a_from_quaternion_rate(q_ab: Quaternion, dq: Quaternion) -> Vec3:
    """Return omega_ab_a = 2 (eta deps - deta eps + eps x deps), with dq = dq_ab/dt.

    Units: dq in 1/s, the result in rad/s; q_ab is unit.  Frames: the result in a.
    Error <= 3 eps |dq|.  Singular: nowhere.  Source: E&G 6.9, solved for omega_ab_a.
    """
    return _omega(q_ab, dq, 1.0)


@kernel
def omega_b_from_quaternion_rate(q_ab: Quaternion, dq: Quaternion) -> Vec3:
    """Return omega_ab_b = 2 (eta deps - deta eps - eps x deps), with dq = dq_ab/dt.

    Units: dq in 1/s, the result in rad/s; q_ab is unit.  Frames: the result in b.
    Error <= 3 eps |dq|.  Singular: nowhere.  Source: E&G 6.9, solved for omega_ab_b.
    """
    return _omega(q_ab, dq, -1.0)


@kernel
def _omega(q: Quaternion, dq: Quaternion, side: float) -> Vec3:
    """Return 2 (eta deps - deta eps + side eps x deps)."""
    eps, deps = q[1:], dq[1:]
    along = vec3.add_scaled(vec3.scale(q[0], deps), -dq[0], eps)
    return vec3.scale(2.0, vec3.add_scaled(along, side, vec3.cross(eps, deps)))


@kernel
def attitude_error(q_ad: Quaternion, q_ab: Quaternion) -> Quaternion:
    """Return q_db of R_db = R_ad^T R_ab with eta >= 0: how b is turned from d, the shorter way round.

    Units: dimensionless; q_ad and q_ab are unit, of either sign.  Frames: q_ad takes coordinates in the desired frame
    d to a, q_ab those in b to a, the result those in b to d; eps is the same in d and b.
    Error <= 1.2 eps.  Singular: at half a turn q_db is one of two.  Source: E&G 6.9, "Attitude deviation".
    """
    q_db = compose_quaternions(invert_quaternion(q_ad), q_ab)
    return scale_quaternion(-1.0 if q_db[0] < 0.0 else 1.0, q_db)


@kernel
def attitude_error_rate(q_db: Quaternion, omega_ad_d: Vec3, omega_ab_b: Vec3) -> tuple[Quaternion, Vec3]:
    """Return (dq_db/dt, omega_db_b) of an attitude error, with omega_db_b = omega_ab_b - R_db^T omega_ad_d.

    Where eps of q_db and omega_db_b are zero, b is at d and stays there. If d is at rest, the torque
    -k eps - c omega_db_b, with k, c > 0, turns b to d.
    Units: omega_ad_d, omega_ab_b and omega_db_b in rad/s, dq_db in 1/s; q_db is unit.
    Frames: omega_ad_d, the rate of the desired frame, in d; omega_ab_b and omega_db_b in b.
    Error <= 6 eps (|omega_ad| + |omega_ab|), of either.  Singular: nowhere.
    Source: E&G 6.9, "Attitude deviation", in b.
    """
    omega_db_b = vec3.subtract(omega_ab_b, rotate(invert_quaternion(q_db), omega_ad_d))
    return quaternion_rate_b(q_db, omega_db_b), omega_db_b
