"""Homogeneous transforms; twists, wrenches and inertia as six components and 6x6 matrices.

A twist is (omega, v), a wrench (torque, force): their scalar product is the power.
"""

from ..compile.decorator import kernel
from ..rotations.matrix import compose_matrices, invert_matrix, transform
from ..rotations.vec3 import ZERO, add, cross, scale, skew, subtract
from ..types import Matrix, Matrix6, Transform, Vec3, Vec6
from .inertia import parallel_axis

__all__ = [
    "spatial_inertia", "transform_compose", "transform_from_matrix", "transform_invert", "transform_point",
    "twist_at", "wrench_at",
]  # fmt: skip


@kernel
def transform_from_matrix(R_ab: Matrix, r_ab_a: Vec3) -> Transform:
    """Return the homogeneous transform T_ab = [R_ab, r_ab_a; 0, 1].

    Units: R_ab is dimensionless, r_ab_a and the last column of T_ab in m.  Frames: r_ab_a, in a, goes from the origin
    of a to that of b; T_ab takes coordinates of a point in b to a.
    Exact for every argument.  Singular: nowhere.  Source: E&G 6.4.
    """
    a, b, c = R_ab[0], R_ab[1], R_ab[2]
    return (
        (a[0], a[1], a[2], r_ab_a[0]),
        (b[0], b[1], b[2], r_ab_a[1]),
        (c[0], c[1], c[2], r_ab_a[2]),
        (0.0, 0.0, 0.0, 1.0),
    )


@kernel
def _parts(T: Transform) -> tuple[Matrix, Vec3]:
    """Return rotation and translation; the last row is not read."""
    a, b, c = T[0], T[1], T[2]
    return (a[:3], b[:3], c[:3]), (a[3], b[3], c[3])


@kernel
def transform_compose(T_ab: Transform, T_bc: Transform) -> Transform:
    """Return T_ac = T_ab T_bc, with the last row (0, 0, 0, 1).

    The last rows of T_ab and T_bc are not read.
    Units: rotations are dimensionless, last columns in m.  Frames: T_ab takes points from b to a, T_bc from c to b.
    Error <= 2 eps of R_ac, and of r_ac 2 eps (|r_ab| + |r_bc|).  Singular: nowhere.  Source: E&G 6.4.
    """
    (R_ab, _), (R_bc, r_bc_b) = _parts(T_ab), _parts(T_bc)
    return transform_from_matrix(compose_matrices(R_ab, R_bc), transform_point(T_ab, r_bc_b))


@kernel
def transform_invert(T_ab: Transform) -> Transform:
    """Return T_ba = [R_ab^T, -R_ab^T r_ab_a; 0, 1], for a rotation R_ab.

    The last row of T_ab is not read.
    Units: rotations are dimensionless, last columns in m.  Frames: T_ab takes points from b to a, T_ba from a to b.
    Error <= 1.5 eps |r_ab|; R_ba is exact.  Singular: nowhere.  Source: E&G 6.4.
    """
    R_ab, r_ab_a = _parts(T_ab)
    R_ba = invert_matrix(R_ab)
    return transform_from_matrix(R_ba, scale(-1.0, transform(R_ba, r_ab_a)))


@kernel
def transform_point(T_ab: Transform, p_b: Vec3) -> Vec3:
    """Return p_a = r_ab_a + R_ab p_b, the coordinates in a of a point.

    The last row of T_ab is not read.
    Units: m.  Frames: p_b from the origin of b, in b; the result from the origin of a, in a.
    Error <= 2 eps (|r_ab| + |p_b|).  Singular: nowhere.  Source: E&G 6.4.
    """
    R_ab, r_ab_a = _parts(T_ab)
    return add(r_ab_a, transform(R_ab, p_b))


@kernel
def twist_at(twist_o: Vec6, r_op: Vec3) -> Vec6:
    """Return the twist (omega, v_p) at a point p of the body from that at o: v_p = v_o + omega x r_op.

    Units: omega in rad/s, v in m/s, r_op in m.  Frames: all in one frame; r_op from o to p.
    Error <= 1.5 eps (|v_o| + |omega| |r_op|) of v_p; omega is unchanged.  Singular: nowhere.
    Source: K. M. Lynch, F. C. Park, Modern Robotics, 3.3.
    """
    omega, v_o = twist_o[:3], twist_o[3:]
    return (omega[0], omega[1], omega[2], *add(v_o, cross(omega, r_op)))


@kernel
def wrench_at(wrench_o: Vec6, r_op: Vec3) -> Vec6:
    """Return the wrench (torque_p, force) about a point p from that about o: torque_p = torque_o - r_op x force.

    Units: torque in N m, force in N, r_op in m.  Frames: all in one frame; r_op from o to p.
    Error <= 1.5 eps (|torque_o| + |r_op| |force|) of torque_p; the force is unchanged.  Singular: nowhere.
    Source: Lynch and Park 3.4.
    """
    torque, force = wrench_o[:3], wrench_o[3:]
    return (*subtract(torque, cross(r_op, force)), force[0], force[1], force[2])


@kernel
def spatial_inertia(mass: float, M_c: Matrix, r_oc: Vec3) -> Matrix6:
    """Return M = [M_o, m skew(r_oc); -m skew(r_oc), m I] of Newton-Euler about o as one system.

    (T_o, F) = M (alpha, a_o) + b, where b = (omega x (M_o omega), m omega x (omega x r_oc)) is the result of
    `inverse_newton_euler_o` for zero accelerations. With the twist V = (omega, v_o), M V is (h_o, p), about the
    point in space where o is at the moment, and V . M V / 2 is the kinetic energy.
    Units: mass in kg, M_c in kg m^2, r_oc in m; blocks in kg m^2, kg m and kg.
    Frames: all in one frame; r_oc from o to the centre of mass.
    Error <= 2 eps, of M_o relative to |M_c| + m |r_oc|^2, of the other blocks to m |r_oc| and m.  Singular: nowhere.
    Source: E&G (7.66), (7.67).
    """
    M_o, S = parallel_axis(M_c, mass, r_oc), skew(scale(mass, r_oc))
    return (
        (*M_o[0], *S[0]),
        (*M_o[1], *S[1]),
        (*M_o[2], *S[2]),
        (*subtract(ZERO, S[0]), mass, 0.0, 0.0),
        (*subtract(ZERO, S[1]), 0.0, mass, 0.0),
        (*subtract(ZERO, S[2]), 0.0, 0.0, mass),
    )
