"""Gibbs (Rodrigues) parameters g = k tan(theta / 2), and modified ones (MRP) sigma = k tan(theta / 4)."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import scale_for_squares
from ..types import Quaternion, Vec3
from . import vec3
from .quaternion import largest_of, normalize, scale_quaternion, square_of

__all__ = [
    "gibbs_from_quaternion", "gibbs_is_singular", "gibbs_rate_a", "gibbs_rate_b", "mrp_from_quaternion",
    "mrp_is_singular", "mrp_rate_a", "mrp_rate_b", "mrp_shadow", "quaternion_from_gibbs", "quaternion_from_mrp",
]  # fmt: skip


@kernel
def gibbs_from_quaternion(q_ab: Quaternion) -> Vec3:
    """Return g = eps / eta = k tan(theta / 2).

    Units: dimensionless; q_ab has either sign and any length.  Frames: g is the same in a and b.
    Error <= 0.5 eps |g|.
    Singular: within round-off of half a turn, |eta| < 4 eps |q_ab|, g has no digits left and is NaN.  Source: E&G 6.7.
    """
    eta = math.nan if gibbs_is_singular(q_ab) or q_ab[0] == 0.0 else q_ab[0]  # eta = 0: beside NaN or all zeros
    eta = eta if abs(eta) < math.inf else math.nan
    return (q_ab[1] / eta, q_ab[2] / eta, q_ab[3] / eta)


@kernel
def gibbs_is_singular(q_ab: Quaternion) -> bool:
    """Return whether a rotation is half a turn within round-off, |eta| < 4 eps |q_ab|."""
    s = scale_for_squares(largest_of(q_ab))
    length = math.sqrt(square_of(scale_quaternion(s, q_ab)))
    return s * abs(q_ab[0]) < 4.0 * 2.0**-52 * length


@kernel
def quaternion_from_gibbs(g: Vec3) -> Quaternion:
    """Return q_ab = (1, g) / sqrt(1 + |g|^2), with eta > 0.

    Units: dimensionless.  Frames: g is the same in a and b; q_ab takes coordinates in b to a.
    Error <= 1.8 eps.  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.7.
    """
    return normalize((1.0, g[0], g[1], g[2]))


@kernel
def gibbs_rate_a(g: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return dg/dt = (I - skew(g) + g g^T) omega / 2.

    Units: g is dimensionless, omega_ab_a in rad/s, the result in 1/s.  Frames: omega_ab_a in a; g is the same in a
    and b.
    Error <= 1.5 eps |omega| (1 + |g|^2).  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.9.
    """
    return _gibbs_rate(g, vec3.cross(omega_ab_a, g), omega_ab_a)


@kernel
def gibbs_rate_b(g: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return dg/dt = (I + skew(g) + g g^T) omega / 2.

    Units: g is dimensionless, omega_ab_b in rad/s, the result in 1/s.  Frames: omega_ab_b in b; g is the same in a
    and b.
    Error <= 1.5 eps |omega| (1 + |g|^2).  Singular: nowhere; half a turn has no finite g.  Source: E&G 6.9.
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
    Error <= 2.3 eps |sigma|.  Singular: at half a turn sigma is one of two; the zero quaternion gives NaN.
    Source: H. Schaub, J. L. Junkins, Analytical Mechanics of Space Systems, 3.6.
    """
    s = scale_for_squares(largest_of(q_ab))
    eta, eps = s * abs(q_ab[0]), vec3.scale(math.copysign(s, q_ab[0]), q_ab[1:])
    total = math.sqrt(square_of((eta, *eps))) + eta
    total = total if 0.0 < total < math.inf else math.nan
    return (eps[0] / total, eps[1] / total, eps[2] / total)


@kernel
def quaternion_from_mrp(sigma: Vec3) -> Quaternion:
    """Return q_ab = (1 - |sigma|^2, 2 sigma) / (1 + |sigma|^2); eta < 0 where |sigma| > 1, as of a shadow set.

    Units: dimensionless; |sigma| is up to 1e150.  Frames: sigma is the same in a and b; q_ab takes coordinates in b
    to a.
    Error <= 2.4 eps.  Singular: nowhere; a full turn has no finite sigma.  Source: Schaub and Junkins 3.6.
    """
    square = vec3.dot(sigma, sigma)
    s = 1.0 / (1.0 + square)
    return (s * (1.0 - square), *vec3.scale(2.0 * s, sigma))


@kernel
def mrp_shadow(sigma: Vec3) -> Vec3:
    """Return -sigma / |sigma|^2, the shadow set: the same rotation, turned the other way round.

    A motion whose sigma passes |sigma| = 1 is continued from the shadow, so that |sigma| stays below 1.
    Units: dimensionless.  Frames: sigma and the result are the same in a and b.
    Error <= 2.5 eps of the result's length.
    Singular: for no rotation, |sigma| < 1e-300, the shadow is a full turn and gives NaN.
    Source: Schaub and Junkins 3.6.
    """
    s = scale_for_squares(vec3.largest_component(sigma))
    v = vec3.scale(s, sigma)
    factor = math.nan if mrp_is_singular(sigma) else -1.0 / vec3.dot(v, v)
    return vec3.scale(s, vec3.scale(factor, v))


@kernel
def mrp_is_singular(sigma: Vec3) -> bool:
    """Return whether sigma has no shadow set: it is zero, or the shadow would leave the range of numbers."""
    return vec3.largest_component(sigma) < 1e-300


@kernel
def mrp_rate_a(sigma: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return dsigma/dt = ((1 - |sigma|^2) I - 2 skew(sigma) + 2 sigma sigma^T) omega / 4.

    Units: sigma is dimensionless, omega_ab_a in rad/s, the result in 1/s.  Frames: omega_ab_a in a; sigma is the same
    in a and b.
    Error <= 2 eps |omega| (1 + |sigma|^2).  Singular: nowhere; a full turn has no finite sigma.
    Source: Schaub and Junkins 3.6.
    """
    return _mrp_rate(sigma, vec3.cross(omega_ab_a, sigma), omega_ab_a)


@kernel
def mrp_rate_b(sigma: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return dsigma/dt = ((1 - |sigma|^2) I + 2 skew(sigma) + 2 sigma sigma^T) omega / 4.

    Units: sigma is dimensionless, omega_ab_b in rad/s, the result in 1/s.  Frames: omega_ab_b in b; sigma is the same
    in a and b.
    Error <= 2 eps |omega| (1 + |sigma|^2).  Singular: nowhere; a full turn has no finite sigma.
    Source: Schaub and Junkins 3.6.
    """
    return _mrp_rate(sigma, vec3.cross(sigma, omega_ab_b), omega_ab_b)


@kernel
def _mrp_rate(sigma: Vec3, turned: Vec3, omega: Vec3) -> Vec3:
    along = vec3.scale(0.25 * (1.0 - vec3.dot(sigma, sigma)), omega)
    return vec3.add(along, vec3.scale(0.5, vec3.add_scaled(turned, vec3.dot(sigma, omega), sigma)))
