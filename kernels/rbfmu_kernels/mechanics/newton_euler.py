"""Newton-Euler equations of one rigid body, momentum and energy."""

import math

from ..compile.decorator import kernel
from ..rotations.matrix import transform
from ..rotations.vec3 import add, cross, dot, scale, subtract
from ..types import Matrix, Vec3
from .inertia import add_scaled_matrix, diagonal, inverse_inertia, point_inertia

__all__ = [
    "angular_momentum", "angular_momentum_o", "damping_torque", "euler_equation", "gyroscopic_torque",
    "inverse_newton_euler_c", "inverse_newton_euler_o", "kinetic_energy", "linear_momentum", "newton_euler_c",
    "newton_euler_o", "relative_acceleration",
]  # fmt: skip


@kernel
def angular_momentum(M_c: Matrix, omega: Vec3) -> Vec3:
    """Return h = M omega, about the point that the inertia is about.

    Units: M_c in kg m^2, omega in rad/s; h in kg m^2/s.  Frames: all in one frame.
    Error <= 1.5 eps |M| |omega|.  Singular: nowhere.  Source: E&G (7.44).
    """
    return transform(M_c, omega)


@kernel
def kinetic_energy(mass: float, M_c: Matrix, v_c: Vec3, omega: Vec3) -> float:
    """Return T = m v_c.v_c / 2 + omega.M_c omega / 2, with v_c of the centre of mass.

    Units: mass in kg, M_c in kg m^2, v_c in m/s, omega in rad/s; T in J.
    Frames: M_c and omega in one frame, v_c in any.
    Error <= 3.5 eps (m |v_c|^2 + |M_c| |omega|^2) / 2, in principal axes 2.5 eps T.  Singular: nowhere.
    Source: E&G 8.2.
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
    Error <= 2 eps (|M_c| |omega| + m |r_oc| |v_c|).  Singular: nowhere.
    Source: E&G 7.2; lecture, "Angular momentum".
    """
    return add(angular_momentum(M_c, omega), cross(r_oc, linear_momentum(mass, v_c)))


@kernel
def gyroscopic_torque(M: Matrix, omega: Vec3) -> Vec3:
    """Return omega x (M omega), N m, computed from M minus I times the median of M's diagonal.

    So nothing cancels in principal axes, and the torque is exactly 0 for a ball and about a symmetric body's own axis.
    """
    a, b, c = M[0][0], M[1][1], M[2][2]
    middle = max(min(a, b), min(max(a, b), c))
    rest = add_scaled_matrix(M, -1.0, diagonal((middle, middle, middle)))
    return cross(omega, transform(rest, omega))


@kernel
def euler_equation(M_c: Matrix, omega: Vec3, torque_c: Vec3) -> Vec3:
    """Return alpha of T_c = M_c alpha + omega x (M_c omega).

    About a point o of the body that is fixed in space it holds as well: give M_o and torque_o.
    Units: M_c in kg m^2, omega in rad/s, torque_c in N m; alpha in rad/s^2.
    Frames: all in one frame, commonly b, in which M_c is constant.
    Error <= 7 eps |M_c^-1| (|T_c| + |M_c| |omega|^2) times the condition, in principal axes 3.5 eps.
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
    inverse = 1.0 / mass if mass != 0.0 else math.inf  # in Python as in compiled code
    return scale(inverse, force), euler_equation(M_c, omega, torque_c)


@kernel
def newton_euler_o(mass: float, M_o: Matrix, r_oc: Vec3, omega: Vec3, force: Vec3, torque_o: Vec3) -> tuple[Vec3, Vec3]:
    """Return (a_o, alpha) about a point o of the body, with r_oc from o to the centre of mass.

    F = m (a_o + alpha x r_oc + omega x (omega x r_oc)) ; T_o = M_o alpha + omega x (M_o omega) + m r_oc x a_o.
    Units: mass in kg, M_o in kg m^2, r_oc in m, omega in rad/s, force in N, torque_o in N m;
    a_o in m/s^2, alpha in rad/s^2.
    Frames: all in one frame.
    Error: that of `newton_euler_c`, but where m r_oc^2 is above the moments about c, digits are lost: the error of
    alpha is 2 eps m r_oc^2 / moment.  Singular: where `newton_euler_c` is.  Source: E&G (7.66), (7.67).
    """
    M_c = add_scaled_matrix(M_o, -1.0, point_inertia(mass, r_oc))
    a_c, alpha = newton_euler_c(mass, M_c, omega, force, subtract(torque_o, cross(r_oc, force)))
    return subtract(a_c, relative_acceleration(omega, alpha, r_oc)), alpha


@kernel
def inverse_newton_euler_c(mass: float, M_c: Matrix, omega: Vec3, a_c: Vec3, alpha: Vec3) -> tuple[Vec3, Vec3]:
    """Return (force, torque_c): F = m a_c, T_c = M_c alpha + omega x (M_c omega), about the centre of mass.

    Units: mass in kg, M_c in kg m^2, omega in rad/s, a_c in m/s^2, alpha in rad/s^2; force in N, torque_c in N m.
    Frames: all in one frame.
    Error <= 2 eps, of m |a_c| and of |M_c| (|alpha| + |omega|^2).  Singular: nowhere.  Source: E&G (7.52), (7.53).
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
    Error <= 3.5 eps, of m (|a_o| + |r_oc| (|alpha| + |omega|^2)) and of
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
