"""Rotation vectors u = axis x angle, and axis-angle pairs (k, theta)."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import atan2, scale_for_squares, sincos
from ..types import Matrix, Quaternion, Vec3
from . import vec3
from .matrix import matrix_from_quaternion, quaternion_from_matrix
from .quaternion import largest_of

__all__ = [
    "axis_angle_from_matrix", "axis_angle_from_quaternion", "matrix_from_axis_angle", "matrix_from_rotvec",
    "quaternion_from_axis_angle", "quaternion_from_rotvec", "rotvec_from_matrix", "rotvec_from_quaternion",
    "rotvec_rate_a", "rotvec_rate_b", "rotvec_rate_is_singular",
]  # fmt: skip


@kernel
def quaternion_from_rotvec(u: Vec3) -> Quaternion:
    """Return q_ab = (cos(|u| / 2), u sin(|u| / 2) / |u|) of a rotation vector.

    Units: u in rad; q_ab is dimensionless.  Frames: u is the same in a and b; q_ab takes coordinates in b to a.
    Error <= 2 eps to |u| = pi, then 1.2 eps |u|; beyond 2e15 (1, 0, 0, 0), beyond 1.3e154 NaN.  Singular: nowhere.
    Source: E&G 6.7.
    """
    angle = math.sqrt(vec3.dot(u, u))
    s, c = sincos(0.5 * angle)
    x, y, z = vec3.scale(s / angle if angle > 0.0 else 0.5, u)
    return (c, x, y, z)


@kernel
def rotvec_from_quaternion(q_ab: Quaternion) -> Vec3:
    """Return u = eps 2 atan2(|eps|, |eta|) / |eps| with the sign of eta, |u| <= pi.

    Units: u in rad; q_ab has either sign and any length from 1e-150 to 1e150.  Frames: u is the same in a and b.
    Error <= 2.5 eps |u|.  Singular: at half a turn u is one of two; the zero quaternion gives NaN.
    Source: E&G 6.7, solved for the angle.
    """
    s = scale_for_squares(largest_of(q_ab))
    eta, eps = s * abs(q_ab[0]), vec3.scale(math.copysign(s, q_ab[0]), q_ab[1:])
    length = math.sqrt(vec3.dot(eps, eps))
    tiny = 1.0 / eta if 0.0 < eta < math.inf else math.nan
    per_length = atan2(length, eta) / length if length > 0.0 and eta < math.inf else tiny
    return vec3.scale(2.0 * per_length, eps)


@kernel
def matrix_from_rotvec(u: Vec3) -> Matrix:
    """Return R_ab = exp(skew(u)), by `quaternion_from_rotvec`.

    Units: u in rad; R_ab is dimensionless.  Frames: u is the same in a and b; R_ab takes coordinates in b to a.
    Error <= 4 eps to |u| = pi, then 2.5 eps |u|.  Singular: nowhere.  Source: E&G 6.6, 6.7.
    """
    return matrix_from_quaternion(quaternion_from_rotvec(u))


@kernel
def rotvec_from_matrix(R_ab: Matrix) -> Vec3:
    """Return the rotation vector u of R_ab, |u| <= pi, by the quaternion, so that no angle loses digits.

    Units: u in rad; R_ab is a rotation to round-off.  Frames: u is the same in a and b.
    Error <= 4 eps |u|.  Singular: at half a turn u is one of two; where det R_ab <= 0, as for a reflection, NaN.
    Source: E&G 6.6, 6.7.
    """
    return rotvec_from_quaternion(quaternion_from_matrix(R_ab))


@kernel
def quaternion_from_axis_angle(k: Vec3, theta: float) -> Quaternion:
    """Return q_ab = (cos(theta / 2), k sin(theta / 2) / |k|).

    Units: theta in rad; k has any length from 1e-150 to 1e150.  Frames: k is the same in a and b; q_ab takes
    coordinates in b to a.
    Error <= 1 eps for a unit k, which is used unchanged, else 3 eps; for theta beyond 4e5 that of `sincos`.
    Singular: a k of another length, such as zero, has no direction and gives NaN.  Source: E&G 6.7.
    """
    square = vec3.dot(k, k)
    per_length = math.nan if axis_is_singular(k) else 1.0 / math.sqrt(square)
    return _turned(k, 1.0 if abs(square - 1.0) <= _UNIT else per_length, theta)


_UNIT = 4.0 * 2.0**-52
"""How far from 1 round-off may move the square of a unit vector; such a vector is used unchanged."""


@kernel
def axis_is_singular(k: Vec3) -> bool:
    """Return whether k has no direction: it is zero, or its square leaves the range of numbers."""
    square = vec3.dot(k, k)
    return square < 1e-300 or square > 1e300


@kernel
def quaternion_about(k: Vec3, theta: float) -> Quaternion:
    """Return q_ab = (cos(theta / 2), k sin(theta / 2)) for a unit k, whose length is not checked."""
    return _turned(k, 1.0, theta)


@kernel
def _turned(k: Vec3, per_length: float, theta: float) -> Quaternion:
    """Return (cos(theta / 2), k per_length sin(theta / 2))."""
    s, c = sincos(0.5 * theta)
    return (c, *vec3.scale(per_length * s, k))


@kernel
def matrix_from_axis_angle(k: Vec3, theta: float) -> Matrix:
    """Return R_ab = cos(theta) I + sin(theta) skew(k) + (1 - cos(theta)) k k^T, with k / |k| in place of k.

    Units: theta in rad; k has any length from 1e-150 to 1e150.  Frames: k is the same in a and b; R_ab takes
    coordinates in b to a.
    Error <= 3 eps for a unit k, else 5 eps; for theta beyond 4e5 that of `sincos`.
    Singular: a k of another length, such as zero, has no direction and gives NaN.  Source: E&G 6.6.
    """
    return matrix_from_quaternion(quaternion_from_axis_angle(k, theta))


@kernel
def axis_angle_from_quaternion(q_ab: Quaternion) -> tuple[Vec3, float]:
    """Return (k, theta) with theta in [0, pi].

    Units: theta in rad; q_ab has either sign and any length from 1e-150 to 1e150.  Frames: k is the same in a and b.
    Error <= 2.5 eps in k, and relative in theta.
    Singular: without rotation k is (1, 0, 0); at half a turn it is one of two; the zero quaternion gives NaN.
    Source: E&G 6.7.
    """
    s = scale_for_squares(vec3.largest_component(q_ab[1:]))
    eps = vec3.scale(s, q_ab[1:])
    length = math.sqrt(vec3.dot(eps, eps))
    signed = math.copysign(length, q_ab[0])
    x, y, z = vec3.scale(1.0 / signed if length != 0.0 else 0.0, eps)
    eta = abs(q_ab[0])
    one = math.nan if (length == 0.0 and eta == 0.0) or eta == math.inf else 1.0
    short = eta < 1.0  # then eps, and length / s, may be subnormal
    angle = 2.0 * atan2(length if short else length / s, s * eta if short else eta)
    return ((x if length != 0.0 else one, one * y, one * z), one * angle)


@kernel
def axis_angle_from_matrix(R_ab: Matrix) -> tuple[Vec3, float]:
    """Return (k, theta) of R_ab with theta in [0, pi].

    Units: theta in rad; R_ab is a rotation to round-off.  Frames: k is the same in a and b.
    Error <= 4.5 eps in k, and relative in theta.
    Singular: without rotation k is (1, 0, 0); at half a turn it is one of two; where det R_ab <= 0, as for a
    reflection, NaN.  Source: E&G 6.6.
    """
    return axis_angle_from_quaternion(quaternion_from_matrix(R_ab))


@kernel
def _rate(u: Vec3, side: float, omega: Vec3) -> Vec3:
    """Return omega + side u x omega + c u x (u x omega), with c = (1 - h cot h) / |u|^2 and h = |u| / 2."""
    square = vec3.dot(u, u)
    h = 0.5 * math.sqrt(square)
    s, c = sincos(h)
    small = h < 0.5
    z = 0.0 if small else 4.0 * h * h
    large_c = (1.0 - h * (c / s)) / z if z > 0.0 and s != 0.0 else z * math.inf
    coefficient = _series(0.25 * square) if small else large_c
    turned = vec3.cross(u, omega)
    return vec3.add_scaled(vec3.add_scaled(omega, side, turned), coefficient, vec3.cross(u, turned))


@kernel
def _series(hh: float) -> float:
    """Return (1 - h cot h) / (4 h^2) for h^2 <= 1/4, by a minimax polynomial with an error of 2^-51."""
    low = 0.08333333333333363 + hh * (0.005555555555501095 + hh * 0.0005291005314961205)
    high = 5.2910007920860135e-05 + hh * (
        5.34487944815658e-06 + hh * (5.389144953373273e-07 + hh * 6.043161256145148e-08)
    )
    return low + (hh * hh * hh) * high


@kernel
def rotvec_rate_a(u: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return du/dt = J_l(u)^-1 omega_ab_a.

    That is omega - u x omega / 2 + c u x (u x omega), with c = (1 - h cot h) / |u|^2 and h = |u| / 2. Where the axis
    stays, omega lies along u, and du/dt is omega.
    Units: u in rad, omega_ab_a and the result in rad/s.  Frames: omega_ab_a in a; u is the same in a and b.
    Error <= 4 eps |omega| to |u| = pi.
    Singular: at |u| = 2 pi n, n >= 1; |du/dt| grows as 1 / (2 pi - |u|).  Source: E&G 6.9.
    """
    return _rate(u, -0.5, omega_ab_a)


@kernel
def rotvec_rate_b(u: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return du/dt = J_r(u)^-1 omega_ab_b.

    That is omega + u x omega / 2 + c u x (u x omega), with c = (1 - h cot h) / |u|^2 and h = |u| / 2. Where the axis
    stays, omega lies along u, and du/dt is omega.
    Units: u in rad, omega_ab_b and the result in rad/s.  Frames: omega_ab_b in b; u is the same in a and b.
    Error <= 4 eps |omega| to |u| = pi.
    Singular: at |u| = 2 pi n, n >= 1; |du/dt| grows as 1 / (2 pi - |u|).  Source: E&G 6.9, with J_r(u) = J_l(-u).
    """
    return _rate(u, 0.5, omega_ab_b)


@kernel
def rotvec_rate_is_singular(u: Vec3) -> bool:
    """Return whether u is within round-off of a full turn: |sin(|u| / 2)| < 2 eps |u|."""
    angle = math.sqrt(vec3.dot(u, u))
    s, _ = sincos(0.5 * angle)
    return angle > 1.0 and abs(s) < 2.0 * 2.0**-52 * angle
