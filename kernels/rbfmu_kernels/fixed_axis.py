"""A body that turns about one principal axis, fixed in space: which axis that is, and whether anything leads off it."""

from typing import Any

from ._kernel import kernel
from .body_memory import has_pivot, moves, principal_frame
from .dynamics import Body, Loads, angular_acceleration
from .quaternion import invert_quaternion, rotate
from .rigid_body import damping_torque
from .shapes import Quaternion, Vec3
from .vec3 import add, add_scaled, cross, dot, is_nonzero


@kernel
def main_axis(q: Quaternion, omega: Vec3, body: Body, loads: Loads) -> tuple[Vec3, float]:
    """The principal axis of most of the rate, or of what begins to turn a body at rest; and its moment."""
    moments, R = principal_frame(body[1])
    v = omega if is_nonzero(omega) else angular_acceleration(q, omega, body, loads)
    e = ((R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2]))
    x, y, w = abs(dot(e[0], v)), abs(dot(e[1], v)), abs(dot(e[2], v))
    k = 0 if x >= y and x >= w else (1 if y >= w else 2)
    return e[k], moments[k]


@kernel
def leaves_axis(z: Any, axis: Vec3, q: Quaternion, omega: Vec3, body: Body, loads: Loads) -> bool:
    """Whether anything turns the body about another axis, at any angle; or a force would turn a free body's path."""
    _, force_a, force_b, torque_a, _ = loads
    arm, damping_b = body[3], body[4]
    q_ba = invert_quaternion(q)
    pull = rotate(q_ba, force_a)
    start = add(omega, angular_acceleration(q, omega, body, loads))
    across = is_nonzero(cross(axis, start)) or is_nonzero(cross(axis, omega))
    across = across or is_nonzero(cross(axis, damping_torque(damping_b, axis)))
    across = across or is_nonzero(cross(axis, rotate(q_ba, torque_a)))
    across = across or (is_nonzero(cross(axis, arm)) and dot(axis, pull) != 0.0)
    across = across or (is_nonzero(cross(axis, pull)) and dot(axis, arm) != 0.0)
    return across or (is_nonzero(force_b) and moves(z) and not has_pivot(z))


@kernel
def pull_and_decay(axis: Vec3, moment: float, q: Quaternion, body: Body, loads: Loads) -> tuple[float, float]:
    """(rad/s^2, 1/s): the acceleration about the axis of a body at rest with attitude q, and what damping takes off."""
    pull = dot(axis, angular_acceleration(q, (0.0, 0.0, 0.0), body, loads))
    return pull, -dot(axis, damping_torque(body[4], axis)) / moment


@kernel
def swing_torque(axis: Vec3, q: Quaternion, body: Body, loads: Loads) -> tuple[float, float]:
    """(A, B): the torque about the axis from forces fixed in space is A cos + B sin of the angle from q."""
    pull = rotate(invert_quaternion(q), loads[1])
    across = add_scaled(pull, -dot(axis, pull), axis)
    return dot(axis, cross(body[3], across)), dot(axis, cross(body[3], cross(across, axis)))
