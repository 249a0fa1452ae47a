"""Velocities and accelerations: angular velocities of composed rotations, vectors and points in a moving frame."""

from ..compile.decorator import kernel
from ..rotations.matrix import transform
from ..rotations.vec3 import add, add_scaled, cross
from ..types import Matrix, Vec3

__all__ = ["compose_omega", "point_acceleration", "point_velocity", "vector_rate"]


@kernel
def compose_omega(omega_ab_a: Vec3, R_ab: Matrix, omega_bc_b: Vec3) -> Vec3:
    """Return omega_ac_a = omega_ab_a + R_ab omega_bc_b.

    Units: rad/s.  Frames: omega_ab_a and the result in a, omega_bc_b in b.
    Error <= 2 eps (|omega_ab| + |omega_bc|).  Singular: nowhere.  Source: E&G 6.8.
    """
    return add(omega_ab_a, transform(R_ab, omega_bc_b))


@kernel
def vector_rate(R_ab: Matrix, omega_ab_b: Vec3, u_b: Vec3, du_b: Vec3) -> Vec3:
    """Return du_a/dt = R_ab (du_b/dt + omega_ab_b x u_b).

    Units: u_b any; du_b and the result that unit per s; omega_ab_b in rad/s.
    Frames: u_b, its rate du_b as seen from b, and omega_ab_b in b; the result in a.
    Error <= 3 eps (|du| + |omega| |u|).  Singular: nowhere.  Source: E&G 6.8.6.
    """
    return transform(R_ab, add(du_b, cross(omega_ab_b, u_b)))


@kernel
def point_velocity(v_o: Vec3, omega: Vec3, r: Vec3, dr: Vec3) -> Vec3:
    """Return v_p = v_o + omega x r + dr/dt of a point p, with r from o to p.

    Units: v_o and dr in m/s, omega in rad/s, r in m; the result in m/s.
    Frames: all in one frame; dr is as seen from the body, 0 for a point fixed in it.
    Error <= 1.5 eps (|v_o| + |dr| + |omega| |r|).  Singular: nowhere.  Source: E&G 6.12.
    """
    return add(add(v_o, dr), cross(omega, r))


@kernel
def point_acceleration(a_o: Vec3, omega: Vec3, alpha: Vec3, r: Vec3, dr: Vec3, ddr: Vec3) -> Vec3:
    """Return a_p = a_o + ddr + 2 omega x dr + alpha x r + omega x (omega x r) of a point p, with r from o to p.

    The terms are the transport, relative, Coriolis, Euler and centripetal acceleration.
    Units: a_o and ddr in m/s^2, omega in rad/s, alpha in rad/s^2, r in m, dr in m/s; the result in m/s^2.
    Frames: all in one frame; dr and ddr are as seen from the body.
    Error <= 3 eps (|a_o| + |ddr| + |alpha| |r| + 2 |omega| |dr| + |omega|^2 |r|).  Singular: nowhere.
    Source: E&G 6.12.
    """
    coriolis_and_centripetal = cross(omega, add_scaled(cross(omega, r), 2.0, dr))
    return add(add(add(a_o, ddr), cross(alpha, r)), coriolis_and_centripetal)
