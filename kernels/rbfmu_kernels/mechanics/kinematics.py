"""Velocities and accelerations: angular velocities of composed rotations, vectors and points in a moving frame."""

from ..compile.decorator import kernel
from ..rotations import vec3
from ..rotations.matrix import transform
from ..types import Matrix, Vec3


@kernel
def compose_omega(omega_ab_a: Vec3, R_ab: Matrix, omega_bc_b: Vec3) -> Vec3:
    """omega_ac_a = omega_ab_a + R_ab omega_bc_b.

    rad/s.  Error <= 1.3 eps (|omega_ab| + |omega_bc|).  E&G 6.8.
    """
    return vec3.add(omega_ab_a, transform(R_ab, omega_bc_b))


@kernel
def vector_rate(R_ab: Matrix, omega_ab_b: Vec3, u_b: Vec3, du_b: Vec3) -> Vec3:
    """d/dt u^a = R_ab (d/dt u^b + omega_ab_b x u^b).

    omega_ab_b: rad/s; u_b: any unit; du_b: that unit per s, as seen from b.
    Error <= 2 eps (|du| + |omega| |u|).  E&G 6.8.6.
    """
    return transform(R_ab, vec3.add(du_b, vec3.cross(omega_ab_b, u_b)))


@kernel
def point_velocity(v_o: Vec3, omega: Vec3, r: Vec3, dr: Vec3) -> Vec3:
    """v_p = v_o + omega x r + dr/dt, all in one frame.

    v_o: m/s, of o; omega: rad/s; r = r_op: m; dr: m/s, as seen from the body (0 for a point fixed in it).
    Error <= 1 eps of the sum of the terms' sizes.  E&G 6.12.
    """
    return vec3.add(vec3.add(v_o, dr), vec3.cross(omega, r))


@kernel
def point_acceleration(a_o: Vec3, omega: Vec3, alpha: Vec3, r: Vec3, dr: Vec3, ddr: Vec3) -> Vec3:
    """a_p = a_o + ddr + 2 omega x dr + alpha x r + omega x (omega x r), all in one frame.

    a_o: m/s2, of o; omega: rad/s; alpha: rad/s2; r = r_op: m; dr, ddr: as seen from the body.
    The terms: transport, relative, Coriolis, Euler, centripetal.  Error <= 1.5 eps of the sum of
    the terms' sizes.  E&G 6.12.
    """
    coriolis_and_centripetal = vec3.cross(omega, vec3.add_scaled(vec3.cross(omega, r), 2.0, dr))
    return vec3.add(vec3.add(vec3.add(a_o, ddr), vec3.cross(alpha, r)), coriolis_and_centripetal)
