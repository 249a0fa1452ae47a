"""A body that turns about one principal axis, fixed in space: which axis, whether anything leads off it, what turns it.

The swing by forces fixed in space is double-double, as an exact motion is as good as the numbers that it begins with.
"""

import math

from ..buffer_access import quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import Body, Loads, angular_acceleration
from ..mechanics.newton_euler import damping_torque
from ..numerics import double_double as dd
from ..numerics.elementary import power_of_two_for
from ..rotations.matrix import invert_matrix, transform
from ..rotations.quaternion import invert_quaternion, largest_of, rotate, scale_quaternion
from ..rotations.vec3 import add, cross, dot, is_nonzero, norm, scale
from ..types import Buffer, Quaternion, Vec3
from . import memory
from .principal import is_sphere, principal_frame

_PARALLEL = 8.0 * 2.0**-52
"""The part of a vector's length that lies across an axis by round-off."""


@kernel
def main_axis(z: Buffer) -> Vec3:
    """Return the principal axis of most of the rate, or of what begins to turn a body at rest.

    In equilibrium it is the axis about which the arm would swing. A sphere's axis may be oblique, as each is principal.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    v = omega if is_nonzero(omega) else angular_acceleration(q, omega, body, loads)
    if _may_be_oblique(body, loads) and is_nonzero(v):
        return scale(1.0 / norm(v), v)
    moments, R = principal_frame(body.inertia)
    e = invert_matrix(R)  # its rows are the axes
    x, y, w = abs(dot(e[0], v)), abs(dot(e[1], v)), abs(dot(e[2], v))
    if not is_nonzero(v):
        x, y = _clearance(moments[0], e[0], body.arm_b), _clearance(moments[1], e[1], body.arm_b)
        w = _clearance(moments[2], e[2], body.arm_b)
    k = 0 if x >= y and x >= w else (1 if y >= w else 2)
    return e[k]


@kernel
def _may_be_oblique(body: Body, loads: Loads) -> bool:
    """Return whether the body is a sphere that no force with an arm swings: round-off across its axis stays small."""
    return is_sphere(body.inertia) and not (is_nonzero(body.arm_b) and is_nonzero(loads.force_a))


@kernel
def _clearance(moment: float, axis: Vec3, arm: Vec3) -> float:
    """Return minus the arm's length along an axis, greatest where the arm lies across; -inf for one without inertia."""
    return -abs(dot(axis, arm)) if moment > 0.0 else -math.inf


@kernel
def leaves_axis(z: Buffer, axis: Vec3) -> bool:
    """Return whether anything, at any angle, turns the body about another axis, or a turning force bends its path.

    Loads that models with a closed form do not know count as well.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    arm, q_ba = body.arm_b, invert_quaternion(q)
    force = rotate(q_ba, loads.force_a)
    start = add(omega, angular_acceleration(q, omega, body, loads))
    slack = _PARALLEL if _may_be_oblique(body, loads) else 0.0
    across = _is_across(axis, start, slack) or _is_across(axis, omega, slack)
    across = across or _is_across(axis, damping_torque(body.damping_b, axis), slack)
    across = across or _is_across(axis, rotate(q_ba, loads.torque_a), slack)
    across = across or (is_nonzero(cross(axis, arm)) and dot(axis, force) != 0.0)
    across = across or (is_nonzero(cross(axis, force)) and dot(axis, arm) != 0.0)
    return across or turns_path(z, axis) or memory.has_unknown_load(z)


@kernel
def turns_path(z: Buffer, axis: Vec3) -> bool:
    """Return whether a force that turns about an axis with the body bends its path, and an output shows it.

    The axis may have any length, and is zero where the body does not turn. A force along the axis does not turn.
    """
    return memory.needs_translation(z) and _is_across(axis, memory.loads_of(z).force_b, _PARALLEL)


@kernel
def _is_across(axis: Vec3, v: Vec3, slack: float) -> bool:
    """Return whether more than a part of v lies across an axis of any size."""
    return norm(cross(axis, v)) > slack * norm(axis) * norm(v)


@kernel(inline=False)
def swing(z: Buffer, axis: Vec3) -> tuple[dd.DoubleDouble, dd.DoubleDouble]:
    """Return (A, B), rad/s2: forces fixed in space accelerate the angle from quaternion_0 by A cos + B sin of it."""
    arm, loads = memory.body_of(z).arm_b, memory.loads_of(z)
    q, moment = quaternion_at(z, memory.AT.quaternion_0), _moment(z, axis)
    q = scale_quaternion(power_of_two_for(largest_of(q)), q)
    force, mass = (loads.gravity_a, z[memory.AT.mass]) if memory.has_pivot(z) else (loads.force_a, 1.0)
    lever = cross(axis, arm)
    unit = dd.multiply(moment, dd.add(dd.two_product(q[0], q[0]), dd.dot_of_floats(q[1:], q[1:])))
    a, b = _turned_dot(q, lever, force), _turned_dot(q, cross(axis, lever), force)
    return dd.divide(dd.multiply_float(a, mass), unit), dd.divide(dd.multiply_float(b, mass), unit)


@kernel
def drive_and_damping_rate(z: Buffer, axis: Vec3) -> tuple[float, float]:
    """Return (P, d), rad/s2 and 1/s: torques, forces that turn with the body, and damping add P - d rate."""
    q_ba, body, loads = invert_quaternion(memory.rotation_of(z).q_ab), memory.body_of(z), memory.loads_of(z)
    torque = add(rotate(q_ba, loads.torque_a), add(loads.torque_b, cross(body.arm_b, loads.force_b)))
    moment = _moment(z, axis)[0]
    return dot(axis, torque) / moment, -dot(axis, damping_torque(body.damping_b, axis)) / moment


@kernel
def _moment(z: Buffer, axis: Vec3) -> dd.DoubleDouble:
    """Return the moment about the axis, through the centre of mass or the pivot."""
    moment = dd.dot_of_floats(axis, transform(memory.inertia_of(z), axis))
    if memory.has_pivot(z):
        lever = cross(axis, vec3_at(z, memory.AT.r_oc_b))
        moment = dd.add(moment, dd.multiply_float(dd.dot_of_floats(lever, lever), z[memory.AT.mass]))
    return moment


@kernel
def _triple(a: Vec3, b: Vec3, c: Vec3) -> dd.DoubleDouble:
    """Return the product a . (b x c)."""
    x = dd.subtract(dd.two_product(b[1], c[2]), dd.two_product(b[2], c[1]))
    y = dd.subtract(dd.two_product(b[2], c[0]), dd.two_product(b[0], c[2]))
    w = dd.subtract(dd.two_product(b[0], c[1]), dd.two_product(b[1], c[0]))
    return dd.add(dd.add(dd.multiply_float(x, a[0]), dd.multiply_float(y, a[1])), dd.multiply_float(w, a[2]))


@kernel
def _turned_dot(q_ab: Quaternion, v_b: Vec3, u_a: Vec3) -> dd.DoubleDouble:
    """Return |q|^2 u . R(q) v."""
    e = q_ab[1:]
    square = dd.subtract(dd.two_product(q_ab[0], q_ab[0]), dd.dot_of_floats(e, e))
    along = dd.multiply(dd.dot_of_floats(u_a, e), dd.dot_of_floats(e, v_b))
    about = dd.multiply_float(_triple(u_a, e, v_b), q_ab[0])
    return dd.add(dd.multiply(square, dd.dot_of_floats(u_a, v_b)), dd.scale(2.0, dd.add(along, about)))
