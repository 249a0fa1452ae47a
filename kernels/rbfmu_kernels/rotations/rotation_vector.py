"""Three numbers for a rotation: rotation vectors u = k theta, and what has a tangent in place of the angle.

That are Gibbs (Rodrigues) parameters g = k tan(theta / 2), and modified ones (MRP) sigma = k tan(theta / 4). Besides
these, pairs (k, theta) of axis and angle.
"""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import atan2, scale_for_squares, sincos
from ..types import Matrix, Quaternion, Vec3
from . import vec3
from .matrix import matrix_from_quaternion, quaternion_from_matrix
from .quaternion import normalize, square_of

__all__ = [
    "axis_angle_from_matrix", "axis_angle_from_quaternion", "gibbs_from_quaternion", "gibbs_is_singular",
    "gibbs_rate_a", "gibbs_rate_b", "matrix_from_axis_angle", "matrix_from_rotvec", "mrp_from_quaternion",
    "mrp_is_singular", "mrp_rate_a", "mrp_rate_b", "mrp_shadow", "quaternion_from_axis_angle",
    "quaternion_from_gibbs", "quaternion_from_mrp", "quaternion_from_rotvec", "rotvec_from_matrix",
    "rotvec_from_quaternion", "rotvec_rate_a", "rotvec_rate_b", "rotvec_rate_is_singular",
]  # fmt: skip


@kernel
def quaternion_from_rotvec(u: Vec3) -> Quaternion:
    """Return q_ab = (cos(|u| / 2), u sin(|u| / 2) / |u|) of a rotation vector of any size to 1e150.

    Units: u in rad; q_ab is dimensionless.  Frames: u is the same in a and b; q_ab takes coordinates in b to a.
    Error <= 1.5 eps to |u| = pi, then eps |u| / 2.  Singular: nowhere.  Source: E&G 6.7.
    """
    angle = math.sqrt(vec3.dot(u, u))
    s, c = sincos(0.5 * angle)
    x, y, z = vec3.scale(s / angle if angle > 0.0 else 0.5, u)
    return (c, x, y, z)


@kernel
def rotvec_from_quaternion(q_ab: Quaternion) -> Vec3:
    """Return u = eps 2 atan2(|eps|, |eta|) / |eps| with the sign of eta, |u| <= pi.

    Units: u in rad; q_ab has either sign and any length from 1e-150 to 1e150.  Frames: u is the same in a and b.
    Error <= 2 eps |u|.  Singular: at half a turn u is one of two; the zero quaternion gives NaN.
    Source: E&G 6.7, solved for the angle.
    """
    eta = abs(q_ab[0])
    eps = (q_ab[1], q_ab[2], q_ab[3])
    s = scale_for_squares(max(eta, max(max(abs(eps[0]), abs(eps[1])), abs(eps[2]))))
    eta, eps = s * eta, vec3.scale(math.copysign(s, q_ab[0]), eps)
    length = math.sqrt(vec3.dot(eps, eps))
    tiny = 1.0 / eta if eta > 0.0 else math.nan
    per_length = atan2(length, eta) / length if length > 0.0 else tiny
    return vec3.scale(2.0 * per_length, eps)


@kernel
def matrix_from_rotvec(u: Vec3) -> Matrix:
    """Return R_ab = exp(skew(u)), by way of `quaternion_from_rotvec`.

    Units: u in rad; R_ab is dimensionless.  Frames: u is the same in a and b; R_ab takes coordinates in b to a.
    Error <= 3 eps to |u| = pi, then eps |u|.  Singular: nowhere.  Source: E&G 6.6, 6.7.
    """
    return matrix_from_quaternion(quaternion_from_rotvec(u))


@kernel
def rotvec_from_matrix(R_ab: Matrix) -> Vec3:
    """Return the rotation vector u of R_ab, |u| <= pi, through the quaternion, so that no angle loses digits.

    Units: u in rad; R_ab is a rotation to round-off.  Frames: u is the same in a and b.
    Error <= 2.5 eps |u|.  Singular: at half a turn u is one of two; where det R_ab <= 0, as of a reflection, NaN.
    Source: E&G 6.6, 6.7.
    """
    return rotvec_from_quaternion(quaternion_from_matrix(R_ab))


@kernel
def quaternion_from_axis_angle(k: Vec3, theta: float) -> Quaternion:
    """Return q_ab = (cos(theta / 2), k sin(theta / 2) / |k|).

    Units: theta in rad; k has any length from 1e-150 to 1e150.  Frames: k is the same in a and b; q_ab takes
    coordinates in b to a.
    Error <= 1 eps for a unit k, else 2 eps.  Singular: a k of no such length, as zero, has no direction and gives NaN.
    Source: E&G 6.7.
    """
    square = vec3.dot(k, k)
    per_length = math.nan if axis_is_singular(k) else 1.0 / math.sqrt(square)
    return _turned(k, 1.0 if abs(square - 1.0) <= _UNIT else per_length, theta)


_UNIT = 4.0 * 2.0**-52
"""What round-off makes of the square of a unit vector: such a vector is taken as it is, to the bit."""


@kernel
def axis_is_singular(k: Vec3) -> bool:
    """Return whether k has no direction: it is zero, or its square leaves the range of numbers."""
    square = vec3.dot(k, k)
    return square < 1e-300 or square > 1e300


@kernel
def quaternion_about(k: Vec3, theta: float) -> Quaternion:
    """Return q_ab = (cos(theta / 2), k sin(theta / 2)) of a unit k, whose length is not looked at."""
    return _turned(k, 1.0, theta)


@kernel
def _turned(k: Vec3, per_length: float, theta: float) -> Quaternion:
    """Return (cos(theta / 2), k per_length sin(theta / 2))."""
    s, c = sincos(0.5 * theta)
    x, y, z = vec3.scale(per_length * s, k)
    return (c, x, y, z)


@kernel
def matrix_from_axis_angle(k: Vec3, theta: float) -> Matrix:
    """Return R_ab = cos(theta) I + sin(theta) skew(k) + (1 - cos(theta)) k k^T, with k / |k| in place of k.

    Units: theta in rad; k has any length from 1e-150 to 1e150.  Frames: k is the same in a and b; R_ab takes
    coordinates in b to a.
    Error <= 2.5 eps for a unit k, else 4 eps.
    Singular: a k of no such length, as zero, has no direction and gives NaN.  Source: E&G 6.6.
    """
    return matrix_from_quaternion(quaternion_from_axis_angle(k, theta))


@kernel
def axis_angle_from_quaternion(q_ab: Quaternion) -> tuple[Vec3, float]:
    """Return (k, theta) with theta in [0, pi].

    Units: theta in rad; q_ab has either sign and any length from 1e-150 to 1e150.  Frames: k is the same in a and b.
    Error <= 2 eps in k and relative in theta.
    Singular: where nothing turns k is (1, 0, 0); at half a turn it is one of two.  Source: E&G 6.7.
    """
    eps = (q_ab[1], q_ab[2], q_ab[3])
    s = scale_for_squares(max(max(abs(eps[0]), abs(eps[1])), abs(eps[2])))
    eps = vec3.scale(s, eps)
    length = math.sqrt(vec3.dot(eps, eps))
    signed = math.copysign(length, q_ab[0])
    x, y, z = vec3.scale(1.0 / signed if length != 0.0 else 0.0, eps)
    return ((x if length != 0.0 else 1.0, y, z), 2.0 * atan2(length / s, abs(q_ab[0])))


@kernel
def axis_angle_from_matrix(R_ab: Matrix) -> tuple[Vec3, float]:
    """Return (k, theta) of R_ab with theta in [0, pi].

    Units: theta in rad; R_ab is a rotation to round-off.  Frames: k is the same in a and b.
    Error <= 3 eps in k and relative in theta.
    Singular: where nothing turns k is (1, 0, 0); at half a turn it is one of two; where det R_ab <= 0, as of a
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
    """Return (1 - h cot h) / (4 h^2) for h^2 <= 1/4, by a minimax polynomial to 2^-51."""
    low = 0.08333333333333363 + hh * (0.005555555555501095 + hh * 0.0005291005314961205)
    high = 5.2910007920860135e-05 + hh * (
        5.34487944815658e-06 + hh * (5.389144953373273e-07 + hh * 6.043161256145148e-08)
    )
    return low + (hh * hh * hh) * high


@kernel
def rotvec_rate_a(u: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return du/dt = J_l(u)^-1 omega_ab_a.

    Units: u in rad, omega_ab_a and the result in rad/s.  Frames: omega_ab_a in a; u is the same in a and b.
    Error <= 3 eps |omega| to |u| = pi.
    Singular: at |u| = 2 pi n, n >= 1; |du/dt| grows as 1 / (2 pi - |u|).  Source: E&G 6.9.
    """
    return _rate(u, -0.5, omega_ab_a)


@kernel
def rotvec_rate_b(u: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return du/dt = J_r(u)^-1 omega_ab_b.

    Units: u in rad, omega_ab_b and the result in rad/s.  Frames: omega_ab_b in b; u is the same in a and b.
    Error <= 3 eps |omega| to |u| = pi.
    Singular: at |u| = 2 pi n, n >= 1; |du/dt| grows as 1 / (2 pi - |u|).  Source: E&G 6.9, with J_r(u) = J_l(-u).
    """
    return _rate(u, 0.5, omega_ab_b)


@kernel
def rotvec_rate_is_singular(u: Vec3) -> bool:
    """Return whether u is within round-off of a full turn: |sin(|u| / 2)| < 2 eps |u|."""
    angle = math.sqrt(vec3.dot(u, u))
    s, _ = sincos(0.5 * angle)
    return angle > 1.0 and abs(s) < 2.0 * 2.0**-52 * angle


@kernel
def gibbs_from_quaternion(q_ab: Quaternion) -> Vec3:
    """Return g = eps / eta = k tan(theta / 2).

    Units: dimensionless; q_ab has either sign and any length.  Frames: g is the same in a and b.
    Error <= 0.5 eps |g|.
    Singular: within round-off of half a turn, |eta| < 4 eps |q_ab|, g has no digits left and is NaN.  Source: E&G 6.7.
    """
    eta = math.nan if gibbs_is_singular(q_ab) else q_ab[0]
    return (q_ab[1] / eta, q_ab[2] / eta, q_ab[3] / eta)


@kernel
def gibbs_is_singular(q_ab: Quaternion) -> bool:
    """Return whether a rotation is half a turn within round-off, |eta| < 4 eps |q_ab|; or q_ab is zero."""
    eta = abs(q_ab[0])
    largest = max(eta, vec3.largest_component((q_ab[1], q_ab[2], q_ab[3])))
    s = scale_for_squares(largest)
    length = math.sqrt(square_of((s * q_ab[0], s * q_ab[1], s * q_ab[2], s * q_ab[3])))
    return s * eta < 4.0 * 2.0**-52 * length or largest == 0.0


@kernel
def quaternion_from_gibbs(g: Vec3) -> Quaternion:
    """Return q_ab = (1, g) / sqrt(1 + |g|^2), with eta > 0.

    Units: dimensionless.  Frames: g is the same in a and b; q_ab takes coordinates in b to a.
    Error <= 1.2 eps.  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.7.
    """
    return normalize((1.0, g[0], g[1], g[2]))


@kernel
def gibbs_rate_a(g: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return dg/dt = (I - skew(g) + g g^T) omega / 2.

    Units: g is dimensionless, omega_ab_a in rad/s, the result in 1/s.  Frames: omega_ab_a in a; g is the same in a
    and b.
    Error <= 1 eps |omega| (1 + |g|^2).  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.9.
    """
    return _gibbs_rate(g, vec3.cross(omega_ab_a, g), omega_ab_a)


@kernel
def gibbs_rate_b(g: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return dg/dt = (I + skew(g) + g g^T) omega / 2.

    Units: g is dimensionless, omega_ab_b in rad/s, the result in 1/s.  Frames: omega_ab_b in b; g is the same in a
    and b.
    Error <= 1 eps |omega| (1 + |g|^2).  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.9.
    """
    return _gibbs_rate(g, vec3.cross(g, omega_ab_b), omega_ab_b)


@kernel
def _gibbs_rate(g: Vec3, turned: Vec3, omega: Vec3) -> Vec3:
    half = vec3.scale(0.5, vec3.add(omega, turned))
    return vec3.add_scaled(half, 0.5 * vec3.dot(g, omega), g)


@kernel
def mrp_from_quaternion(q_ab: Quaternion) -> Vec3:
    """Return sigma = eps / (|q_ab| + |eta|) with the sign of eta, |sigma| <= 1; `mrp_shadow` has the other set.

    Units: dimensionless; q_ab has either sign and any length from 1e-150 to 1e150.  Frames: sigma is the same in a
    and b.
    Error <= 1.5 eps |sigma|.  Singular: at half a turn sigma is one of two; the zero quaternion gives NaN.
    Source: H. Schaub, J. L. Junkins, Analytical Mechanics of Space Systems, 3.6.
    """
    eta = abs(q_ab[0])
    eps = (q_ab[1], q_ab[2], q_ab[3])
    s = scale_for_squares(max(eta, vec3.largest_component(eps)))
    eta, eps = s * eta, vec3.scale(math.copysign(s, q_ab[0]), eps)
    total = math.sqrt(square_of((eta, eps[0], eps[1], eps[2]))) + eta
    total = total if total > 0.0 else math.nan
    return (eps[0] / total, eps[1] / total, eps[2] / total)


@kernel
def quaternion_from_mrp(sigma: Vec3) -> Quaternion:
    """Return q_ab = (1 - |sigma|^2, 2 sigma) / (1 + |sigma|^2); eta < 0 where |sigma| > 1, as of a shadow set.

    Units: dimensionless; |sigma| is up to 1e150.  Frames: sigma is the same in a and b; q_ab takes coordinates in b
    to a.
    Error <= 1.5 eps.  Singular: nowhere; a full turn has no finite sigma.  Source: Schaub and Junkins 3.6.
    """
    square = vec3.dot(sigma, sigma)
    s = 1.0 / (1.0 + square)
    x, y, z = vec3.scale(2.0 * s, sigma)
    return (s * (1.0 - square), x, y, z)


@kernel
def mrp_shadow(sigma: Vec3) -> Vec3:
    """Return -sigma / |sigma|^2, the shadow set: the same rotation, turned the other way round.

    In a motion whose sigma passes |sigma| = 1, it goes on from the shadow, so that |sigma| stays below 1.
    Units: dimensionless.  Frames: sigma and the result are the same in a and b.
    Error <= 2 eps of the result's length.
    Singular: of no rotation, |sigma| < 1e-300, the shadow is a full turn and gives NaN.
    Source: Schaub and Junkins 3.6.
    """
    s = scale_for_squares(vec3.largest_component(sigma))
    v = vec3.scale(s, sigma)
    factor = math.nan if mrp_is_singular(sigma) else -s / vec3.dot(v, v)
    return vec3.scale(factor, v)


@kernel
def mrp_is_singular(sigma: Vec3) -> bool:
    """Return whether sigma has no shadow set: it is zero, or the shadow would leave the range of numbers."""
    return vec3.largest_component(sigma) < 1e-300


@kernel
def mrp_rate_a(sigma: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return dsigma/dt = ((1 - |sigma|^2) I - 2 skew(sigma) + 2 sigma sigma^T) omega / 4.

    Units: sigma is dimensionless, omega_ab_a in rad/s, the result in 1/s.  Frames: omega_ab_a in a; sigma is the same
    in a and b.
    Error <= 1 eps |omega| (1 + |sigma|^2).  Singular: nowhere; a full turn has no finite sigma.
    Source: Schaub and Junkins 3.6.
    """
    return _mrp_rate(sigma, vec3.cross(omega_ab_a, sigma), omega_ab_a)


@kernel
def mrp_rate_b(sigma: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return dsigma/dt = ((1 - |sigma|^2) I + 2 skew(sigma) + 2 sigma sigma^T) omega / 4.

    Units: sigma is dimensionless, omega_ab_b in rad/s, the result in 1/s.  Frames: omega_ab_b in b; sigma is the same
    in a and b.
    Error <= 1 eps |omega| (1 + |sigma|^2).  Singular: nowhere; a full turn has no finite sigma.
    Source: Schaub and Junkins 3.6.
    """
    return _mrp_rate(sigma, vec3.cross(sigma, omega_ab_b), omega_ab_b)


@kernel
def _mrp_rate(sigma: Vec3, turned: Vec3, omega: Vec3) -> Vec3:
    along = vec3.scale(0.25 * (1.0 - vec3.dot(sigma, sigma)), omega)
    return vec3.add(along, vec3.scale(0.5, vec3.add_scaled(turned, vec3.dot(sigma, omega), sigma)))
