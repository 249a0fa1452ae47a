"""Kinematics, momentum and energy of one rigid body, its Newton-Euler equations, and these in six components.

Six components are twists (omega, v) and wrenches (torque, force), whose scalar product is the power; they have inertia
as a 6x6 matrix, and homogeneous transforms take points from frame to frame.
"""

from ..compile.decorator import kernel
from ..rotations.matrix import compose_matrices, invert_matrix, transform
from ..rotations.vec3 import add, add_scaled, cross, dot, scale, skew, subtract
from ..types import Matrix, Matrix6, Transform, Vec3, Vec6
from .inertia import add_scaled_matrix, diagonal, inverse_inertia, parallel_axis, point_inertia

__all__ = [
    "angular_momentum", "angular_momentum_o", "compose_omega", "damping_torque", "euler_equation", "gyroscopic_torque",
    "inverse_newton_euler_c", "inverse_newton_euler_o", "kinetic_energy", "linear_momentum", "newton_euler_c",
    "newton_euler_o", "point_acceleration", "point_velocity", "relative_acceleration", "spatial_inertia",
    "transform_compose", "transform_from_matrix", "transform_invert", "transform_point", "twist_at", "vector_rate",
    "wrench_at",
]  # fmt: skip


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
    Error <= 2 eps (|du| + |omega| |u|).  Singular: nowhere.  Source: E&G 6.8.6.
    """
    return transform(R_ab, add(du_b, cross(omega_ab_b, u_b)))


@kernel
def point_velocity(v_o: Vec3, omega: Vec3, r: Vec3, dr: Vec3) -> Vec3:
    """Return v_p = v_o + omega x r + dr/dt of a point p, with r from o to p.

    Units: v_o and dr in m/s, omega in rad/s, r in m; the result in m/s.
    Frames: all in one frame; dr is as seen from the body, 0 for a point fixed in it.
    Error <= 1.5 eps of the sum of the terms' sizes.  Singular: nowhere.  Source: E&G 6.12.
    """
    return add(add(v_o, dr), cross(omega, r))


@kernel
def point_acceleration(a_o: Vec3, omega: Vec3, alpha: Vec3, r: Vec3, dr: Vec3, ddr: Vec3) -> Vec3:
    """Return a_p = a_o + ddr + 2 omega x dr + alpha x r + omega x (omega x r) of a point p, with r from o to p.

    The terms are the transport, relative, Coriolis, Euler and centripetal acceleration.
    Units: a_o and ddr in m/s^2, omega in rad/s, alpha in rad/s^2, r in m, dr in m/s; the result in m/s^2.
    Frames: all in one frame; dr and ddr are as seen from the body.
    Error <= 3 eps of the sum of the terms' sizes.  Singular: nowhere.  Source: E&G 6.12.
    """
    coriolis_and_centripetal = cross(omega, add_scaled(cross(omega, r), 2.0, dr))
    return add(add(add(a_o, ddr), cross(alpha, r)), coriolis_and_centripetal)


# Momentum and energy; Newton-Euler equations


@kernel
def angular_momentum(M_c: Matrix, omega: Vec3) -> Vec3:
    """Return h = M omega, about the point that the inertia is about.

    Units: M_c in kg m^2, omega in rad/s; h in kg m^2/s.  Frames: all in one frame.
    Error <= 1.2 eps |M| |omega|.  Singular: nowhere.  Source: E&G (7.44).
    """
    return transform(M_c, omega)


@kernel
def kinetic_energy(mass: float, M_c: Matrix, v_c: Vec3, omega: Vec3) -> float:
    """Return T = m v_c.v_c / 2 + omega.M_c omega / 2, with v_c of the centre of mass.

    Units: mass in kg, M_c in kg m^2, v_c in m/s, omega in rad/s; T in J.
    Frames: M_c and omega in one frame, v_c in any.
    Error <= 1.7 eps T.  Singular: nowhere.  Source: E&G 8.2.
    """
    return 0.5 * mass * dot(v_c, v_c) + 0.5 * dot(omega, transform(M_c, omega))


@kernel
def linear_momentum(mass: float, v_c: Vec3) -> Vec3:
    """Return p = m v_c, with v_c of the centre of mass.

    Units: mass in kg, v_c in m/s; p in kg m/s.  Frames: v_c and p in one frame.
    Error <= 0.5 eps |p|.  Singular: nowhere.  Source: E&G 7.2; lecture, "Newton-Euler equation of motion II".
    """
    return scale(mass, v_c)


@kernel
def angular_momentum_o(mass: float, M_c: Matrix, r_oc: Vec3, v_c: Vec3, omega: Vec3) -> Vec3:
    """Return h_o = M_c omega + m r_oc x v_c, about a point o that is fixed in inertial space.

    Units: mass in kg, M_c in kg m^2, r_oc in m, v_c in m/s, omega in rad/s; h_o in kg m^2/s.
    Frames: all in one frame; r_oc from o to the centre of mass, v_c its inertial velocity.
    Error <= 1.2 eps (|M_c| |omega| + m |r_oc| |v_c|).  Singular: nowhere.
    Source: E&G 7.2; lecture, "Angular momentum".
    """
    return add(angular_momentum(M_c, omega), cross(r_oc, linear_momentum(mass, v_c)))


@kernel
def gyroscopic_torque(M: Matrix, omega: Vec3) -> Vec3:
    """Return omega x (M omega), N m, computed with M less a multiple of I, the median of its diagonal.

    So nothing cancels with principal axes, and a ball or a symmetric body's own axis has exactly none.
    """
    a, b, c = M[0][0], M[1][1], M[2][2]
    middle = max(min(a, b), min(max(a, b), c))
    rest = add_scaled_matrix(M, -1.0, diagonal((middle, middle, middle)))
    return cross(omega, transform(rest, omega))


@kernel
def euler_equation(M_c: Matrix, omega: Vec3, torque_c: Vec3) -> Vec3:
    """Return alpha of T_c = M_c alpha + omega x (M_c omega).

    About a point o of the body that is fixed in space it holds as well: give M_o and torque_o.
    Units: M_c in kg m^2, omega in rad/s, torque_c in N m; alpha in rad/s^2.  Frames: all in body axes.
    Error in eps |M_c^-1| (|T_c| + |M_c| |omega|^2): 1.5 in principal axes, 1.2 times the condition of M_c in others.
    Singular: about the axis of a zero principal moment (slender beam) alpha is 0; two zero moments give NaN.
    Source: E&G (7.53).
    """
    return transform(inverse_inertia(M_c), subtract(torque_c, gyroscopic_torque(M_c, omega)))


@kernel
def newton_euler_c(mass: float, M_c: Matrix, omega: Vec3, force: Vec3, torque_c: Vec3) -> tuple[Vec3, Vec3]:
    """Return (a_c, alpha) of F = m a_c, T_c = M_c alpha + omega x (M_c omega), about the centre of mass.

    Units: mass in kg, M_c in kg m^2, omega in rad/s, force in N, torque_c in N m; a_c in m/s^2, alpha in rad/s^2.
    Frames: all in one frame.
    Error <= 1 eps of |a_c|, of alpha that of `euler_equation`.  Singular: at mass 0, and where `euler_equation` is.
    Source: E&G (7.52), (7.53).
    """
    return scale(1.0 / mass, force), euler_equation(M_c, omega, torque_c)


@kernel
def newton_euler_o(mass: float, M_o: Matrix, r_oc: Vec3, omega: Vec3, force: Vec3, torque_o: Vec3) -> tuple[Vec3, Vec3]:
    """Return (a_o, alpha) about a point o of the body, with r_oc from o to the centre of mass.

    F = m (a_o + alpha x r_oc + omega x (omega x r_oc)) ; T_o = M_o alpha + omega x (M_o omega) + m r_oc x a_o.
    Units: mass in kg, M_o in kg m^2, r_oc in m, omega in rad/s, force in N, torque_o in N m;
    a_o in m/s^2, alpha in rad/s^2.
    Frames: all in one frame.
    Error as of `newton_euler_c`, but digits are lost where m r_oc^2 is above the moments about c: of alpha 0.1 eps
    m r_oc^2 / moment.  Singular: where `newton_euler_c` is.  Source: E&G (7.66), (7.67).
    """
    M_c = add_scaled_matrix(M_o, -1.0, point_inertia(mass, r_oc))
    a_c, alpha = newton_euler_c(mass, M_c, omega, force, subtract(torque_o, cross(r_oc, force)))
    return subtract(a_c, relative_acceleration(omega, alpha, r_oc)), alpha


@kernel
def inverse_newton_euler_c(mass: float, M_c: Matrix, omega: Vec3, a_c: Vec3, alpha: Vec3) -> tuple[Vec3, Vec3]:
    """Return (force, torque_c): F = m a_c, T_c = M_c alpha + omega x (M_c omega), about the centre of mass.

    Units: mass in kg, M_c in kg m^2, omega in rad/s, a_c in m/s^2, alpha in rad/s^2; force in N, torque_c in N m.
    Frames: all in one frame.
    Error <= 1 eps, of m |a_c| and of |M_c| (|alpha| + |omega|^2).  Singular: nowhere.  Source: E&G (7.52), (7.53).
    """
    return scale(mass, a_c), add(transform(M_c, alpha), gyroscopic_torque(M_c, omega))


@kernel
def inverse_newton_euler_o(
    mass: float, M_o: Matrix, r_oc: Vec3, omega: Vec3, a_o: Vec3, alpha: Vec3
) -> tuple[Vec3, Vec3]:
    """Return (force, torque_o) about a point o of the body, with r_oc from o to the centre of mass.

    F = m (a_o + alpha x r_oc + omega x (omega x r_oc)) ; T_o = M_o alpha + omega x (M_o omega) + m r_oc x a_o.
    Units: mass in kg, M_o in kg m^2, r_oc in m, omega in rad/s, a_o in m/s^2, alpha in rad/s^2;
    force in N, torque_o in N m.
    Frames: all in one frame.
    Error <= 1.8 eps, of m (|a_o| + |r_oc| (|alpha| + |omega|^2)) and of
    |M_o| (|alpha| + |omega|^2) + m |r_oc| |a_o|.  Singular: nowhere.  Source: E&G (7.66), (7.67).
    """
    a_c = add(a_o, relative_acceleration(omega, alpha, r_oc))
    force, torque = inverse_newton_euler_c(mass, M_o, omega, a_c, alpha)
    return force, add(torque, cross(r_oc, scale(mass, a_o)))


@kernel
def relative_acceleration(omega: Vec3, alpha: Vec3, r: Vec3) -> Vec3:
    """Return alpha x r + omega x (omega x r), m/s^2.

    It is the acceleration of a body point at r relative to the origin of r.
    """
    return add(cross(alpha, r), cross(omega, cross(omega, r)))


@kernel
def relative_jerk(omega: Vec3, alpha: Vec3, alpha_rate: Vec3, r: Vec3) -> Vec3:
    """Return d/dt of `relative_acceleration`, in a, of a point fixed in the body, m/s^3.

    alpha_rate is d alpha / dt as seen in b, rad/s^3; all in one frame.
    """
    turning = add(cross(alpha_rate, r), add(cross(alpha, cross(omega, r)), cross(omega, cross(alpha, r))))
    return add(turning, cross(omega, relative_acceleration(omega, alpha, r)))


@kernel
def damping_torque(damping_b: Vec3, omega_b: Vec3) -> Vec3:
    """Return -damping_b * omega_b for each axis; damping_b is in N m s/rad."""
    return (-damping_b[0] * omega_b[0], -damping_b[1] * omega_b[1], -damping_b[2] * omega_b[2])


# Six components


@kernel
def transform_from_matrix(R_ab: Matrix, r_ab_a: Vec3) -> Transform:
    """Return the homogeneous transform T_ab = [R_ab, r_ab_a; 0, 1].

    Units: R_ab is dimensionless, r_ab_a and the last column of T_ab in m.  Frames: r_ab_a, in a, goes from the origin
    of a to that of b; T_ab takes coordinates of a point in b to a.
    Exact for every argument.  Singular: nowhere.  Source: E&G 6.4.
    """
    (a, b, c), (x, y, z) = R_ab, r_ab_a
    return ((a[0], a[1], a[2], x), (b[0], b[1], b[2], y), (c[0], c[1], c[2], z), (0.0, 0.0, 0.0, 1.0))


@kernel
def _parts(T: Transform) -> tuple[Matrix, Vec3]:
    """Return rotation and translation; the last row is not looked at."""
    a, b, c = T[0], T[1], T[2]
    return ((a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])), (a[3], b[3], c[3])


@kernel
def transform_compose(T_ab: Transform, T_bc: Transform) -> Transform:
    """Return T_ac = T_ab T_bc, with the last row (0, 0, 0, 1).

    Units: rotations are dimensionless, last columns in m.  Frames: T_ab takes points from b to a, T_bc from c to b.
    Error <= 2 eps of R_ac, and of r_ac by |r_ab| + |r_bc|.  Singular: nowhere.  Source: E&G 6.4.
    """
    (R_ab, _), (R_bc, r_bc_b) = _parts(T_ab), _parts(T_bc)
    return transform_from_matrix(compose_matrices(R_ab, R_bc), transform_point(T_ab, r_bc_b))


@kernel
def transform_invert(T_ab: Transform) -> Transform:
    """Return T_ba = [R_ab^T, -R_ab^T r_ab_a; 0, 1], for a rotation R_ab.

    Units: rotations are dimensionless, last columns in m.  Frames: T_ab takes points from b to a, T_ba from a to b.
    Error <= 1.5 eps |r_ab|; R_ba is exact.  Singular: nowhere.  Source: E&G 6.4.
    """
    R_ab, r_ab_a = _parts(T_ab)
    R_ba = invert_matrix(R_ab)
    return transform_from_matrix(R_ba, scale(-1.0, transform(R_ba, r_ab_a)))


@kernel
def transform_point(T_ab: Transform, p_b: Vec3) -> Vec3:
    """Return p_a = r_ab_a + R_ab p_b, the coordinates in a of a point.

    Units: m.  Frames: p_b from the origin of b, in b; the result from the origin of a, in a.
    Error <= 2 eps (|r_ab| + |p_b|).  Singular: nowhere.  Source: E&G 6.4.
    """
    R_ab, r_ab_a = _parts(T_ab)
    return add(r_ab_a, transform(R_ab, p_b))


@kernel
def _pair(first: Vec3, second: Vec3) -> Vec6:
    return (first[0], first[1], first[2], second[0], second[1], second[2])


@kernel
def twist_at(twist_o: Vec6, r_op: Vec3) -> Vec6:
    """Return the twist (omega, v_p) at a point p of the body, with v_p = v_o + omega x r_op, of that at o.

    Units: omega in rad/s, v in m/s, r_op in m.  Frames: all in one frame; r_op from o to p.
    Error <= 1.5 eps (|v_o| + |omega| |r_op|) of v_p; omega stays.  Singular: nowhere.
    Source: K. M. Lynch, F. C. Park, Modern Robotics, 3.3.
    """
    omega, v_o = (twist_o[0], twist_o[1], twist_o[2]), (twist_o[3], twist_o[4], twist_o[5])
    return _pair(omega, add(v_o, cross(omega, r_op)))


@kernel
def wrench_at(wrench_o: Vec6, r_op: Vec3) -> Vec6:
    """Return the wrench (torque_p, force) about a point p, with torque_p = torque_o - r_op x force, of that about o.

    Units: torque in N m, force in N, r_op in m.  Frames: all in one frame; r_op from o to p.
    Error <= 1.5 eps (|torque_o| + |r_op| |force|) of torque_p; the force stays.  Singular: nowhere.
    Source: Lynch and Park 3.4.
    """
    torque, force = (wrench_o[0], wrench_o[1], wrench_o[2]), (wrench_o[3], wrench_o[4], wrench_o[5])
    return _pair(subtract(torque, cross(r_op, force)), force)


@kernel
def spatial_inertia(mass: float, M_c: Matrix, r_oc: Vec3) -> Matrix6:
    """Return M = [M_o, m skew(r_oc); -m skew(r_oc), m I] of Newton-Euler about o as one system.

    (T_o, F) = M (alpha, a_o) + b, where b = (omega x (M_o omega), m omega x (omega x r_oc)) is what
    `inverse_newton_euler_o` gives of zero accelerations. With the twist V = (omega, v_o), M V is (h_o, p), about a
    point in space where o is at the moment, and V . M V / 2 the kinetic energy.
    Units: mass in kg, M_c in kg m^2, r_oc in m; blocks in kg m^2, kg m and kg.
    Frames: all in one frame; r_oc from o to the centre of mass.
    Error <= 2 eps, of M_o by |M_c| + m |r_oc|^2, of others by m |r_oc| and m.  Singular: nowhere.
    Source: E&G (7.66), (7.67).
    """
    M_o, S = parallel_axis(M_c, mass, r_oc), skew(scale(mass, r_oc))
    zero = (0.0, 0.0, 0.0)
    return (
        _pair(M_o[0], S[0]),
        _pair(M_o[1], S[1]),
        _pair(M_o[2], S[2]),
        _pair(subtract(zero, S[0]), (mass, 0.0, 0.0)),
        _pair(subtract(zero, S[1]), (0.0, mass, 0.0)),
        _pair(subtract(zero, S[2]), (0.0, 0.0, mass)),
    )
