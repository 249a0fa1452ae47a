"""Euler parameters (unit quaternions), scalar first: q_ab = (eta, eps) of R_ab."""

import math

from . import vec3
from ._kernel import kernel
from .shapes import Quaternion, Vec3

_HUGE, _TINY = 2.0**500, 2.0**-500
_UP, _DOWN = 2.0**600, 2.0**-600


@kernel
def compose_quaternions(q_ab: Quaternion, q_bc: Quaternion) -> Quaternion:
    """q_ac of R_ac = R_ab R_bc.

    q_ab, q_bc: Euler parameters, scalar first.  Error <= 2 eps |q_ab| |q_bc|.  E&G (6.190).
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
    """q_ba = (eta, -eps).

    q_ab: unit; otherwise this is the conjugate, not the inverse.  Exact.
    """
    return (q_ab[0], -q_ab[1], -q_ab[2], -q_ab[3])


@kernel
def normalize(q: Quaternion) -> Quaternion:
    """q / |q|.

    q: any length; scaled by a power of two before squaring where it is beyond 2^+-500.
    The zero quaternion gives NaN.  Error <= 2 eps.
    """
    a, b, c, d = q
    largest = max(max(abs(a), abs(b)), max(abs(c), abs(d)))
    s = _DOWN if largest > _HUGE else (_UP if largest < _TINY else 1.0)
    a, b, c, d = s * a, s * b, s * c, s * d
    length = math.sqrt((a * a + b * b) + (c * c + d * d))
    length = length if length != 0.0 else math.nan
    return (a / length, b / length, c / length, d / length)


@kernel
def rotate(q_ab: Quaternion, v_b: Vec3) -> Vec3:
    """v_a = R(q_ab) v_b = v + 2 eta (eps x v) + 2 eps x (eps x v).

    q_ab: unit (not normalised here); v_b: any unit.  Error <= 3 eps |v|.  E&G (6.163).
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    t = vec3.scale(2.0, vec3.cross(eps, v_b))
    return vec3.add(v_b, vec3.add_scaled(vec3.cross(eps, t), q_ab[0], t))


@kernel
def quaternion_rate_a(q_ab: Quaternion, omega_ab_a: Vec3) -> Quaternion:
    """dq/dt: deta = -eps . omega / 2, deps = (eta I - skew(eps)) omega / 2.

    q_ab: unit; omega_ab_a: rad/s in a.  Error <= 2 eps |omega|.  E&G (6.281).
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    half = vec3.scale(0.5, omega_ab_a)
    x, y, z = vec3.add_scaled(vec3.cross(half, eps), q_ab[0], half)
    return (-vec3.dot(eps, half), x, y, z)


@kernel
def quaternion_rate_b(q_ab: Quaternion, omega_ab_b: Vec3) -> Quaternion:
    """dq/dt: deta = -eps . omega / 2, deps = (eta I + skew(eps)) omega / 2.

    q_ab: unit; omega_ab_b: rad/s in b.  Error <= 2 eps |omega|.  E&G (6.282).
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    half = vec3.scale(0.5, omega_ab_b)
    x, y, z = vec3.add_scaled(vec3.cross(eps, half), q_ab[0], half)
    return (-vec3.dot(eps, half), x, y, z)


@kernel
def omega_a_from_quaternion_rate(q_ab: Quaternion, dq: Quaternion) -> Vec3:
    """omega_ab_a = 2 (eta deps - deta eps + eps x deps).

    q_ab: unit; dq: its derivative, 1/s.  Error <= 4 eps |dq|.
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    deps = (dq[1], dq[2], dq[3])
    along = vec3.add_scaled(vec3.scale(q_ab[0], deps), -dq[0], eps)
    return vec3.scale(2.0, vec3.add(along, vec3.cross(eps, deps)))


@kernel
def omega_b_from_quaternion_rate(q_ab: Quaternion, dq: Quaternion) -> Vec3:
    """omega_ab_b = 2 (eta deps - deta eps - eps x deps).

    q_ab: unit; dq: its derivative, 1/s.  Error <= 4 eps |dq|.
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    deps = (dq[1], dq[2], dq[3])
    along = vec3.add_scaled(vec3.scale(q_ab[0], deps), -dq[0], eps)
    return vec3.scale(2.0, vec3.subtract(along, vec3.cross(eps, deps)))
