"""The outputs of a body's model and their time derivatives, from its state and the inputs now set."""

from ..buffer import NO_OUTPUTS
from ..buffer_access import are_finite, matrix_at, put_quaternion_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics import newton_euler
from ..mechanics.equations_of_motion import Loads, angular_acceleration, angular_jerk, linear_acceleration
from ..rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from ..rotations.matrix import transform
from ..rotations.quaternion import quaternion_rate_b, rotate
from ..rotations.vec3 import ZERO, add, cross, dot, scale, subtract
from ..types import Buffer, Quaternion, Vec3
from . import memory
from .memory import AT, SHOWN

_FIRST, _END = memory.BLOCKS[next(iter(memory.OUTPUTS))].start, memory.BLOCKS[next(reversed(memory.OUTPUTS))].stop


@kernel(inline=False)
def outputs(z: Buffer) -> int:
    """Refresh the active outputs from the state and the inputs now set."""
    q, omega = memory.rotation_of(z)
    if memory.needs_translation(z):
        _put_translation(z, q, omega)
    if memory.shows_loads(z):
        _put_accelerations(z, z, q, omega, memory.loads_of(z))
    if memory.is_set(z, SHOWN.quaternion):
        put_quaternion_at(z, AT.quaternion, q)
    if memory.is_set(z, SHOWN.rpy):
        yaw, pitch, roll = euler_from_quaternion(ZYX, q)
        put_vec3_at(z, AT.rpy, (roll, pitch, yaw))
    put_vec3_at(z, AT.omega_b, omega)
    if memory.is_set(z, SHOWN.omega_a):
        put_vec3_at(z, AT.omega_a, rotate(q, omega))
    if memory.is_set(z, SHOWN.angular_momentum_a):
        put_vec3_at(z, AT.angular_momentum_a, rotate(q, newton_euler.angular_momentum(matrix_at(z, AT.M), omega)))
    if memory.is_set(z, SHOWN.kinetic_energy):
        mass = 0.0 if memory.has_pivot(z) else z[AT.mass]
        z[AT.kinetic_energy] = newton_euler.kinetic_energy(mass, matrix_at(z, AT.M), memory.centre_of(z).v_c, omega)
    return 0


@kernel
def _put_translation(z: Buffer, q: Quaternion, omega: Vec3) -> None:
    """Set position and velocity of o."""
    r_oc = vec3_at(z, AT.r_oc_b)
    if memory.has_pivot(z):
        put_vec3_at(z, AT.position, vec3_at(z, AT.position_0))
        put_vec3_at(z, AT.velocity, ZERO)
    else:
        put_vec3_at(z, AT.position, subtract(memory.centre_of(z).r_c, rotate(q, r_oc)))
        put_vec3_at(z, AT.velocity, subtract(memory.centre_of(z).v_c, rotate(q, cross(omega, r_oc))))


@kernel
def _put_accelerations(to: Buffer, z: Buffer, q: Quaternion, omega: Vec3, loads: Loads) -> None:
    """Set alpha_b and the acceleration of o in a of a body under loads; with a pivot o stays."""
    body = memory.body_of(z)
    alpha = angular_acceleration(q, omega, body, loads)
    relative = newton_euler.relative_acceleration(omega, alpha, vec3_at(z, AT.r_oc_b))
    a_o = subtract(linear_acceleration(q, body, loads), rotate(q, relative))
    put_vec3_at(to, AT.alpha_b, alpha)
    put_vec3_at(to, AT.acceleration, ZERO if body.is_free == 0.0 else a_o)


@kernel(inline=False)
def output_rates(z: Buffer) -> int:
    """Set the outputs' time derivatives at constant inputs: the blocks `d_<output>`.

    Those of rpy are not finite at its pole.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    _put_translation(z, q, omega)
    _put_accelerations(z, z, q, omega, loads)
    M, alpha = body.inertia, vec3_at(z, AT.alpha_b)
    alpha_rate = angular_jerk(q, omega, alpha, body, loads)
    torque = add(transform(M, alpha), newton_euler.gyroscopic_torque(M, omega))
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    d_yaw, d_pitch, d_roll = euler_rate_b(ZYX, (yaw, pitch, roll), omega)
    put_quaternion_at(z, AT.d_quaternion, quaternion_rate_b(q, omega))
    put_vec3_at(z, AT.d_rpy, (d_roll, d_pitch, d_yaw))
    put_vec3_at(z, AT.d_omega_b, alpha)
    put_vec3_at(z, AT.d_omega_a, rotate(q, alpha))
    put_vec3_at(z, AT.d_alpha_b, alpha_rate)
    put_vec3_at(z, AT.d_angular_momentum_a, rotate(q, torque))
    a_c, v_c = linear_acceleration(q, body, loads), memory.centre_of(z).v_c
    z[AT.d_kinetic_energy] = dot(omega, torque) + (0.0 if memory.has_pivot(z) else z[AT.mass] * dot(v_c, a_c))
    put_vec3_at(z, AT.d_position, vec3_at(z, AT.velocity))
    put_vec3_at(z, AT.d_velocity, vec3_at(z, AT.acceleration))
    relative = newton_euler.relative_jerk(omega, alpha, alpha_rate, vec3_at(z, AT.r_oc_b))
    jerk = rotate(q, subtract(cross(omega, scale(body.inverse_mass, loads.force_b)), relative))
    put_vec3_at(z, AT.d_acceleration, ZERO if memory.has_pivot(z) else jerk)
    return 0


@kernel(inline=False)
def first_outputs(z: Buffer) -> int:
    """Set the outputs at the start; return 0, or a key of `buffer.FAULTS` where one is not finite."""
    outputs(z)
    return 0 if are_finite(z, _FIRST, _END) else NO_OUTPUTS


@kernel(inline=False)
def feedthrough(z: Buffer, change: Buffer) -> int:
    """Set how much each output changes as soon as the inputs change; z is not changed.

    change: the same places as in z, up to the end of the outputs. Its inputs are the change of the inputs; its outputs
    must be 0, and are set to the derivative of `outputs` in the direction of that change, in closed form.
    """
    loads = memory.loads_at(change, memory.INPUTS_START, memory.has_pivot(z))
    _put_accelerations(change, z, memory.rotation_of(z).q_ab, ZERO, loads)
    return 0
