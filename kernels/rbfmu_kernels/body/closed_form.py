"""Common to models with a closed form: a clock in double-double, the path of the centre of mass, the end of a step."""

from ..buffer import STEP_REJECTED, places
from ..buffer_access import pair_at, put_pair_at, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import linear_acceleration
from ..numerics.double_double import DoubleDouble, two_sum
from ..rotations.vec3 import ZERO, add_scaled, cross, is_nonzero
from ..types import Buffer, Quaternion, Vec3
from . import memory, outputs

CLOSED_FORM = memory.COMMON | {"elapsed": 2, "q_0": 4, "r_0": 3, "v_0": 3, "a_c": 3, "since_a_c": 2}
"""The blocks of all bodies, then: the time since the start, s, and the attitude there; position and velocity of the
centre of mass when its acceleration last changed; the acceleration since then; and the time since then, s."""
_AT = places(CLOSED_FORM).at


@kernel
def start_clocks(z: Buffer) -> int:
    """Set the clocks at the start of a run; return 0, as every `set_up` of a model does."""
    put_pair_at(z, _AT.elapsed, (0.0, 0.0))
    put_pair_at(z, _AT.since_a_c, (0.0, 0.0))
    put_quaternion_at(z, _AT.q_0, memory.rotation_of(z).q_ab)
    r_c, v_c = memory.centre_of(z)
    put_vec3_at(z, _AT.r_0, r_c)
    put_vec3_at(z, _AT.v_0, v_c)
    put_vec3_at(z, _AT.a_c, ZERO)
    return 0


@kernel
def first_attitude(z: Buffer) -> Quaternion:
    """Return the unit quaternion q_ab at the start."""
    return quaternion_at(z, _AT.q_0)


@kernel
def time_after(z: Buffer, h: float) -> DoubleDouble:
    """Return the time since the start, s, after a step h."""
    return later(z, _AT.elapsed, h)


@kernel
def later(z: Buffer, clock: int, h: float) -> DoubleDouble:
    """Return the time, s, that the clock at z[clock] shows after a step h."""
    high, low = pair_at(z, clock)
    t, rest = two_sum(high, h)
    return t, rest + low


@kernel
def has_turning_torque(z: Buffer) -> bool:
    """Return whether damping, torque_b, a force with an arm, or an unknown load acts: torques that are not fixed in a.

    Unknown loads are those that models with a closed form do not know.
    """
    body, loads = memory.body_of(z), memory.loads_of(z)
    lever = is_nonzero(body.arm_b) and is_nonzero(loads.force_a)
    lever = lever or is_nonzero(cross(body.arm_b, loads.force_b))
    return lever or is_nonzero(loads.torque_b) or is_nonzero(body.damping_b) or memory.has_unknown_load(z)


@kernel
def has_torque(z: Buffer) -> bool:
    """Return whether damping, a torque, a force with an arm, or an unknown load acts."""
    return has_turning_torque(z) or is_nonzero(memory.loads_of(z).torque_a)


@kernel
def is_driven(z: Buffer) -> bool:
    """Return whether a torque acts, or a force that turns with the body while an output shows the path."""
    return has_torque(z) or (is_nonzero(memory.loads_of(z).force_b) and memory.needs_translation(z))


@kernel(inline=False)
def finish_step(z: Buffer, h: float, q: Quaternion, omega: Vec3) -> int:
    """Set attitude and rate, move the centre of mass, refresh outputs; or return STEP_REJECTED and change nothing."""
    moves = memory.needs_translation(z) and not memory.has_pivot(z)
    if not is_finite_rotation(q, omega) or (moves and not _moved(z, h)):
        return STEP_REJECTED
    return commit_step(z, h, q, omega)


@kernel
def is_finite_rotation(q: Quaternion, omega: Vec3) -> bool:
    """Return whether an attitude and a rate are finite."""
    rest = (0.0 * q[0] + 0.0 * q[1]) + (0.0 * q[2] + 0.0 * q[3])
    return rest + (0.0 * omega[0] + (0.0 * omega[1] + 0.0 * omega[2])) == 0.0


@kernel
def is_finite_path(r: Vec3, v: Vec3) -> bool:
    """Return whether a position and a velocity are finite."""
    return 0.0 * r[0] + 0.0 * r[1] + 0.0 * r[2] + 0.0 * v[0] + 0.0 * v[1] + 0.0 * v[2] == 0.0


@kernel
def commit_step(z: Buffer, h: float, q: Quaternion, omega: Vec3) -> int:
    """Set attitude and rate after a step h, and refresh the outputs."""
    memory.put_rotation(z, q, omega)
    put_pair_at(z, _AT.elapsed, time_after(z, h))
    return outputs.outputs(z)


@kernel
def _moved(z: Buffer, h: float) -> bool:
    """Move the centre of mass if it stays finite; return whether it did.

    The acceleration is that at the first attitude: a force fixed in b keeps the direction in a that it has there.
    """
    since, low, r_0, v_0 = 0.0, 0.0, vec3_at(z, _AT.r_0), vec3_at(z, _AT.v_0)
    a = linear_acceleration(first_attitude(z), memory.body_of(z), memory.loads_of(z))
    if a == vec3_at(z, _AT.a_c):
        since, low = later(z, _AT.since_a_c, h)
    else:
        since, (r_0, v_0) = h, memory.centre_of(z)
    t = since + low
    r, v = add_scaled(add_scaled(r_0, t, v_0), 0.5 * t * t, a), add_scaled(v_0, t, a)
    if not is_finite_path(r, v):
        return False
    memory.put_centre(z, r, v)
    put_pair_at(z, _AT.since_a_c, (since, low))
    put_vec3_at(z, _AT.r_0, r_0)
    put_vec3_at(z, _AT.v_0, v_0)
    put_vec3_at(z, _AT.a_c, a)
    return True
