"""Newton-Euler equations of one rigid body, momentum and energy."""

from ..compile.decorator import kernel
from ..rotations.matrix import transform
from ..rotations.vec3 import add, cross, dot, scale, subtract
from ..types import Matrix, Vec3
from .inertia import add_scaled_matrix, diagonal, inverse_inertia, point_inertia


@kernel
def angular_momentum(M_c: Matrix, omega: Vec3) -> Vec3:
    """h = M omega, about the point that M is about.

    M_c: kg m^2, omega: rad/s, one frame; h in kg m^2/s.  Error <= 1.2 eps |M| |omega|.  E&G (7.44).
    """
    return transform(M_c, omega)


@kernel
def kinetic_energy(mass: float, M_c: Matrix, v_c: Vec3, omega: Vec3) -> float:
    """T = m v_c.v_c / 2 + omega.M_c omega / 2.

    v_c: m/s, of the centre of mass; M_c and omega in one frame, v_c in any; T in J.  Error <= 1.7 eps T.  E&G 8.2.
    """
    return 0.5 * mass * dot(v_c, v_c) + 0.5 * dot(omega, transform(M_c, omega))


@kernel
def linear_momentum(mass: float, v_c: Vec3) -> Vec3:
    """p = m v_c.

    mass: kg; v_c: m/s, of the centre of mass; p in kg m/s.  Error <= 0.5 eps |p|.  E&G 7.2; lecture.
    """
    return scale(mass, v_c)


@kernel
def angular_momentum_o(mass: float, M_c: Matrix, r_oc: Vec3, v_c: Vec3, omega: Vec3) -> Vec3:
    """h_o = M_c omega + m r_oc x v_c, about a point o that is fixed in inertial space.

    mass: kg; M_c: kg m^2; r_oc: m, from o to the centre of mass; v_c: m/s, inertial; omega: rad/s; all in one frame;
    h_o in kg m^2/s.  Error <= 1.2 eps (|M_c| |omega| + m |r_oc| |v_c|).  E&G 7.2; lecture.
    """
    return add(angular_momentum(M_c, omega), cross(r_oc, linear_momentum(mass, v_c)))


@kernel
def gyroscopic_torque(M: Matrix, omega: Vec3) -> Vec3:
    """omega x (M omega), N m: of M less a multiple of I, the median of its diagonal.

    So nothing cancels with principal axes, and a ball or a symmetric body's own axis has exactly none.
    """
    a, b, c = M[0][0], M[1][1], M[2][2]
    middle = max(min(a, b), min(max(a, b), c))
    rest = add_scaled_matrix(M, -1.0, diagonal((middle, middle, middle)))
    return cross(omega, transform(rest, omega))


@kernel
def euler_equation(M_c: Matrix, omega: Vec3, torque_c: Vec3) -> Vec3:
    """alpha of T_c = M_c alpha + omega x (M_c omega).

    Body components; kg m^2, rad/s, N m, rad/s^2.  A zero principal moment (slender beam): alpha about its axis is 0.
    Error in eps |M_c^-1| (|T_c| + |M_c| |omega|^2): 1.5 in principal axes, 1.2 times the condition of M_c in others.
    E&G (7.53).
    """
    return transform(inverse_inertia(M_c), subtract(torque_c, gyroscopic_torque(M_c, omega)))


@kernel
def newton_euler_c(mass: float, M_c: Matrix, omega: Vec3, force: Vec3, torque_c: Vec3) -> tuple[Vec3, Vec3]:
    """(a_c, alpha) of F = m a_c, T_c = M_c alpha + omega x (M_c omega), about the centre of mass.

    All in one frame, SI.  E&G (7.52), (7.53).
    """
    return scale(1.0 / mass, force), euler_equation(M_c, omega, torque_c)


@kernel
def newton_euler_o(mass: float, M_o: Matrix, r_oc: Vec3, omega: Vec3, force: Vec3, torque_o: Vec3) -> tuple[Vec3, Vec3]:
    """(a_o, alpha) about a point o of the body, r_oc from o to the centre of mass.

    F = m (a_o + alpha x r_oc + omega x (omega x r_oc)) ; T_o = M_o alpha + omega x (M_o omega) + m r_oc x a_o.
    All in one frame, SI.  Loses digits where m r_oc^2 is above the moments
    about c: alpha has an error of 0.1 eps m r_oc^2 / moment.  E&G (7.66), (7.67).
    """
    M_c = add_scaled_matrix(M_o, -1.0, point_inertia(mass, r_oc))
    a_c, alpha = newton_euler_c(mass, M_c, omega, force, subtract(torque_o, cross(r_oc, force)))
    return subtract(a_c, relative_acceleration(omega, alpha, r_oc)), alpha


@kernel
def inverse_newton_euler_c(mass: float, M_c: Matrix, omega: Vec3, a_c: Vec3, alpha: Vec3) -> tuple[Vec3, Vec3]:
    """(force, torque_c): F = m a_c, T_c = M_c alpha + omega x (M_c omega), about the centre of mass.

    mass: kg; M_c: kg m^2; omega: rad/s; a_c: m/s^2; alpha: rad/s^2; all in one frame; N, N m.  Singular: nowhere.
    Error <= 1 eps, of m |a_c| and of |M_c| (|alpha| + |omega|^2).  E&G (7.52), (7.53).
    """
    return scale(mass, a_c), add(transform(M_c, alpha), gyroscopic_torque(M_c, omega))


@kernel
def inverse_newton_euler_o(
    mass: float, M_o: Matrix, r_oc: Vec3, omega: Vec3, a_o: Vec3, alpha: Vec3
) -> tuple[Vec3, Vec3]:
    """(force, torque_o) about a point o of the body, r_oc from o to the centre of mass.

    F = m (a_o + alpha x r_oc + omega x (omega x r_oc)) ; T_o = M_o alpha + omega x (M_o omega) + m r_oc x a_o.
    mass: kg; M_o: kg m^2; r_oc: m; omega: rad/s; a_o: m/s^2; alpha: rad/s^2; all in one frame; N, N m.
    Singular: nowhere.  Error <= 1.8 eps, of m (|a_o| + |r_oc| (|alpha| + |omega|^2)) and of
    |M_o| (|alpha| + |omega|^2) + m |r_oc| |a_o|.  E&G (7.66), (7.67).
    """
    a_c = add(a_o, relative_acceleration(omega, alpha, r_oc))
    force, torque = inverse_newton_euler_c(mass, M_o, omega, a_c, alpha)
    return force, add(torque, cross(r_oc, scale(mass, a_o)))


@kernel
def relative_acceleration(omega: Vec3, alpha: Vec3, r: Vec3) -> Vec3:
    """alpha x r + omega x (omega x r): acceleration of a body point at r relative to the origin of r."""
    return add(cross(alpha, r), cross(omega, cross(omega, r)))


@kernel
def relative_jerk(omega: Vec3, alpha: Vec3, alpha_rate: Vec3, r: Vec3) -> Vec3:
    """d/dt of `relative_acceleration`, in a, of a point fixed in the body.

    alpha_rate: d alpha / dt as seen in b; all in one frame, rad/s, rad/s^2, rad/s^3, m; m/s^3.
    """
    turning = add(cross(alpha_rate, r), add(cross(alpha, cross(omega, r)), cross(omega, cross(alpha, r))))
    return add(turning, cross(omega, relative_acceleration(omega, alpha, r)))


@kernel
def damping_torque(damping_b: Vec3, omega_b: Vec3) -> Vec3:
    """-damping_b * omega_b, per axis; damping_b: N m s/rad."""
    return (-damping_b[0] * omega_b[0], -damping_b[1] * omega_b[1], -damping_b[2] * omega_b[2])
