"""Equations of motion of one body, free or turning about a pivot, under known and supplied loads."""

from ..compile.decorator import kernel
from ..rotations.matrix import transform
from ..rotations.quaternion import invert_quaternion, quaternion_rate_b, rotate
from ..rotations.vec3 import add, add_scaled, cross, is_nonzero, scale, subtract
from ..types import Matrix, Quaternion, Vec3
from .newton_euler import damping_torque, gyroscopic_torque

State = tuple[Vec3, Vec3, Quaternion, Vec3]
"""Position and velocity of the centre of mass (in a), q_ab, omega_ab_b."""
Rates = State
Body = tuple[float, Matrix, Matrix, Vec3, Vec3, float]
"""1/mass (0 with a pivot: o does not move), M and its inverse about c (about o with a pivot), arm, damping_b.

arm: from the point that M is about to where `arm_force` acts: -r_oc_b, free; r_oc_b with a pivot.
The last number is 1 for a free body, 0 with a pivot.
"""
Loads = tuple[Vec3, Vec3, Vec3, Vec3, Vec3]
"""gravity_a, arm_force_a, arm_force_b, torque_a, torque_b.

arm_force: the forces at o, free; with a pivot the weight, which acts at c (the pivot takes the forces at o).
"""
Course = tuple[Loads, Loads, Loads]
"""Loads, their first and their second time derivatives at the beginning of a step."""
NO_LOADS: Loads = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@kernel
def angular_acceleration(q_ab: Quaternion, omega_b: Vec3, body: Body, loads: Loads) -> Vec3:
    """alpha_b of Euler's equation about c (free) or o (pivot)."""
    _, M, M_inverse, arm, damping_b, _ = body
    _, arm_force_a, arm_force_b, torque_a, torque_b = loads
    torque = add(add(torque_b, cross(arm, arm_force_b)), damping_torque(damping_b, omega_b))
    if is_nonzero(arm_force_a) or is_nonzero(torque_a):  # most bodies have none, and turning them is half the cost
        q_ba = invert_quaternion(q_ab)
        torque = add(torque, add(rotate(q_ba, torque_a), cross(arm, rotate(q_ba, arm_force_a))))
    return transform(M_inverse, subtract(torque, gyroscopic_torque(M, omega_b)))


@kernel
def angular_jerk(q_ab: Quaternion, omega_b: Vec3, alpha_b: Vec3, body: Body, loads: Loads) -> Vec3:
    """d alpha_b / dt as seen in b, rad/s^3, of loads that are constant, each in its own frame."""
    _, M, M_inverse, arm, damping_b, _ = body
    _, arm_force_a, _, torque_a, _ = loads
    q_ba = invert_quaternion(q_ab)
    torque_rate = cross(rotate(q_ba, torque_a), omega_b)  # a vector fixed in a changes by -omega x itself
    torque_rate = add(torque_rate, cross(arm, cross(rotate(q_ba, arm_force_a), omega_b)))
    torque_rate = add(torque_rate, damping_torque(damping_b, alpha_b))
    gyroscopic = add(cross(alpha_b, transform(M, omega_b)), cross(omega_b, transform(M, alpha_b)))
    return transform(M_inverse, subtract(torque_rate, gyroscopic))


@kernel
def _acts(loads: Loads) -> bool:
    gravity_a, arm_force_a, arm_force_b, torque_a, torque_b = loads
    force = is_nonzero(gravity_a) or is_nonzero(arm_force_a) or is_nonzero(arm_force_b)
    return force or is_nonzero(torque_a) or is_nonzero(torque_b)


@kernel
def is_changing(course: Course) -> bool:
    """Whether the loads do not stay as they are."""
    return _acts(course[1]) or _acts(course[2])


@kernel
def _after(course: Course, i: int, t: float) -> Vec3:
    return add_scaled(add_scaled(course[0][i], t, course[1][i]), 0.5 * t * t, course[2][i])


@kernel
def loads_after(course: Course, t: float) -> Loads:
    """The loads a time t after the step's begin."""
    return _after(course, 0, t), _after(course, 1, t), _after(course, 2, t), _after(course, 3, t), _after(course, 4, t)


@kernel
def course_after(course: Course, t: float) -> Course:
    """The course of the loads from a time t on."""
    return loads_after(course, t), loads_after((course[1], course[2], NO_LOADS), t), course[2]


@kernel
def steady(loads: Loads) -> Course:
    """The course of loads that stay as they are."""
    return loads, NO_LOADS, NO_LOADS


@kernel
def turning_acceleration(q_ab: Quaternion, body: Body, loads: Loads) -> Vec3:
    """The part of a_c, in a, from the force at o that turns with the body."""
    return scale(body[0], rotate(q_ab, loads[2]))


@kernel
def steady_acceleration(body: Body, loads: Loads) -> Vec3:
    """The part of a_c, in a, that does not turn with the body: gravity and `arm_force_a`; zero with a pivot."""
    return add_scaled(scale(body[5], loads[0]), body[0], loads[1])


@kernel
def linear_acceleration(q_ab: Quaternion, body: Body, loads: Loads) -> Vec3:
    """a_c in a: gravity and the forces at o; zero with a pivot, where c follows from the attitude."""
    return add(steady_acceleration(body, loads), turning_acceleration(q_ab, body, loads))


@kernel(inline=False)
def state_rates(state: State, body: Body, loads: Loads) -> Rates:
    """d/dt of the state."""
    _, v_c, q_ab, omega_b = state
    return (
        v_c,
        linear_acceleration(q_ab, body, loads),
        quaternion_rate_b(q_ab, omega_b),
        angular_acceleration(q_ab, omega_b, body, loads),
    )
