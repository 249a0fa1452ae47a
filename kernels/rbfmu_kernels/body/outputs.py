"""The outputs of a body's model and their time derivatives, from its state and the inputs now set."""

from ..buffer import NOT_FINITE
from ..buffer_access import are_finite, matrix_at, put_quaternion_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics import rigid_body
from ..mechanics.equations_of_motion import Body, Loads, angular_acceleration, angular_jerk, linear_acceleration
from ..rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from ..rotations.matrix import transform
from ..rotations.quaternion import quaternion_rate_b, rotate
from ..rotations.vec3 import add, cross, dot, scale, subtract
from ..types import Buffer, Quaternion, Vec3
from . import memory

_MASS, _M, _R_OC, _POSITION_0 = memory.LAYOUT.starts("mass", "M", "r_oc_b", "position_0")
_POSITION, _VELOCITY, _ACCELERATION = memory.LAYOUT.starts("position", "velocity", "acceleration")
_Q, _RPY, _OMEGA_B, _OMEGA_A = memory.LAYOUT.starts("quaternion", "rpy", "omega_b", "omega_a")
_ALPHA, _MOMENTUM, _ENERGY = memory.LAYOUT.starts("alpha_b", "angular_momentum_a", "kinetic_energy")
_D_POSITION, _D_VELOCITY, _D_ACCELERATION = memory.LAYOUT.starts("d_position", "d_velocity", "d_acceleration")
_D_Q, _D_RPY, _D_OMEGA_B, _D_OMEGA_A = memory.LAYOUT.starts("d_quaternion", "d_rpy", "d_omega_b", "d_omega_a")
_D_ALPHA, _D_MOMENTUM, _D_ENERGY = memory.LAYOUT.starts("d_alpha_b", "d_angular_momentum_a", "d_kinetic_energy")
_SHOWS_Q, _SHOWS_RPY, _SHOWS_OMEGA_A = (memory.ACTIVE[n] for n in ("quaternion", "rpy", "omega_a"))
_SHOWS_MOMENTUM, _SHOWS_ENERGY = (memory.ACTIVE[n] for n in ("angular_momentum_a", "kinetic_energy"))
_FIRST, _END = memory.BLOCKS[next(iter(memory.OUTPUTS))].start, memory.BLOCKS[next(reversed(memory.OUTPUTS))].stop


@kernel(inline=False)
def outputs(z: Buffer) -> int:
    """Refresh the active outputs from the state and the inputs now set."""
    q, omega = memory.rotation_of(z)
    if memory.needs_translation(z):
        _put_translation(z, q, omega)
    if memory.shows_loads(z):
        _put_accelerations(z, q, omega)
    if memory.is_set(z, _SHOWS_Q):
        put_quaternion_at(z, _Q, q)
    if memory.is_set(z, _SHOWS_RPY):
        yaw, pitch, roll = euler_from_quaternion(ZYX, q)
        put_vec3_at(z, _RPY, (roll, pitch, yaw))
    put_vec3_at(z, _OMEGA_B, omega)
    if memory.is_set(z, _SHOWS_OMEGA_A):
        put_vec3_at(z, _OMEGA_A, rotate(q, omega))
    if memory.is_set(z, _SHOWS_MOMENTUM):
        put_vec3_at(z, _MOMENTUM, rotate(q, rigid_body.angular_momentum(matrix_at(z, _M), omega)))
    if memory.is_set(z, _SHOWS_ENERGY):
        mass = 0.0 if memory.has_pivot(z) else z[_MASS]
        z[_ENERGY] = rigid_body.kinetic_energy(mass, matrix_at(z, _M), memory.centre_of(z).v_c, omega)
    return 0


@kernel
def _put_translation(z: Buffer, q: Quaternion, omega: Vec3) -> None:
    """Set position and velocity of o."""
    r_oc = vec3_at(z, _R_OC)
    if memory.has_pivot(z):
        put_vec3_at(z, _POSITION, vec3_at(z, _POSITION_0))
        put_vec3_at(z, _VELOCITY, (0.0, 0.0, 0.0))
    else:
        put_vec3_at(z, _POSITION, subtract(memory.centre_of(z).r_c, rotate(q, r_oc)))
        put_vec3_at(z, _VELOCITY, subtract(memory.centre_of(z).v_c, rotate(q, cross(omega, r_oc))))


@kernel
def _put_accelerations(z: Buffer, q: Quaternion, omega: Vec3) -> None:
    """Set alpha_b and the acceleration of o."""
    alpha, acceleration = accelerations(q, omega, memory.body_of(z), memory.loads_of(z), vec3_at(z, _R_OC))
    put_vec3_at(z, _ALPHA, alpha)
    put_vec3_at(z, _ACCELERATION, acceleration)


@kernel
def accelerations(q: Quaternion, omega: Vec3, body: Body, loads: Loads, r_oc: Vec3) -> tuple[Vec3, Vec3]:
    """Return (alpha_b, acceleration of o in a) of a body under loads; with a pivot o stays."""
    alpha = angular_acceleration(q, omega, body, loads)
    relative = rigid_body.relative_acceleration(omega, alpha, r_oc)
    a_o = subtract(linear_acceleration(q, body, loads), rotate(q, relative))
    return alpha, ((0.0, 0.0, 0.0) if body.is_free == 0.0 else a_o)


@kernel(inline=False)
def output_rates(z: Buffer) -> int:
    """Set the outputs' time derivatives at constant inputs: the blocks `d_<output>`.

    Those of rpy are not finite at its pole.
    """
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    _put_translation(z, q, omega)
    _put_accelerations(z, q, omega)
    M, alpha = body.inertia, vec3_at(z, _ALPHA)
    alpha_rate = angular_jerk(q, omega, alpha, body, loads)
    torque = add(transform(M, alpha), rigid_body.gyroscopic_torque(M, omega))
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    d_yaw, d_pitch, d_roll = euler_rate_b(ZYX, (yaw, pitch, roll), omega)
    put_quaternion_at(z, _D_Q, quaternion_rate_b(q, omega))
    put_vec3_at(z, _D_RPY, (d_roll, d_pitch, d_yaw))
    put_vec3_at(z, _D_OMEGA_B, alpha)
    put_vec3_at(z, _D_OMEGA_A, rotate(q, alpha))
    put_vec3_at(z, _D_ALPHA, alpha_rate)
    put_vec3_at(z, _D_MOMENTUM, rotate(q, torque))
    a_c, v_c = linear_acceleration(q, body, loads), memory.centre_of(z).v_c
    z[_D_ENERGY] = dot(omega, torque) + (0.0 if memory.has_pivot(z) else z[_MASS] * dot(v_c, a_c))
    put_vec3_at(z, _D_POSITION, vec3_at(z, _VELOCITY))
    put_vec3_at(z, _D_VELOCITY, vec3_at(z, _ACCELERATION))
    r_oc = vec3_at(z, _R_OC)
    relative = rigid_body.relative_jerk(omega, alpha, alpha_rate, r_oc)
    jerk = rotate(q, subtract(cross(omega, scale(body.inverse_mass, loads.force_b)), relative))
    put_vec3_at(z, _D_ACCELERATION, (0.0, 0.0, 0.0) if memory.has_pivot(z) else jerk)
    return 0


@kernel(inline=False)
def first_outputs(z: Buffer) -> int:
    """Set the outputs at the start; return 0, or a key of `buffer.FAULTS` where the parameters overflow them."""
    outputs(z)
    return 0 if are_finite(z, _FIRST, _END) else NOT_FINITE


_INPUTS = memory.BLOCKS[next(iter(memory.INPUTS))].start
_AT_REST = (0.0, 0.0, 0.0)


@kernel(inline=False)
def feedthrough(z: Buffer, change: Buffer) -> int:
    """Set how much each output changes at once when the inputs change; z stays as it is.

    change: numbers in the places that they have in z, up to the outputs' end: the inputs' are those of the change, the
    outputs' must be 0 and are set. It is the derivative of `outputs` along the inputs' change, in closed form.
    """
    loads = memory.loads_at(change, _INPUTS, memory.has_pivot(z))
    alpha, acceleration = accelerations(
        memory.rotation_of(z).q_ab, _AT_REST, memory.body_of(z), loads, vec3_at(z, _R_OC)
    )
    put_vec3_at(change, _ALPHA, alpha)
    put_vec3_at(change, _ACCELERATION, acceleration)
    return 0
