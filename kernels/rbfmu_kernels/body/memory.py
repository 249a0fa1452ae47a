"""Common to all models of a body: the layout of their buffers, their start, their state and their loads.

A model's buffer begins with these blocks; the blocks of its method follow. For the state see
`equations_of_motion`.
"""

import math

from .. import quantities
from ..buffer import BEAM_TURNS, NEGATIVE, NO_ATTITUDE, NO_MASS, NOT_FINITE, TWO_ZERO_MOMENTS, places
from ..buffer_access import are_finite, matrix_at, put_matrix_at, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import STATE_BLOCKS, STATE_SIZE, Body, Centre, Loads, Rotation, State
from ..mechanics.inertia import INERTIA_TOLERANCE, check_inertia, inverse_inertia, parallel_axis, principal_axes, trace
from ..rotations.quaternion import normalize, rotate
from ..rotations.vec3 import ZERO, add, cross, dot, is_nonzero, scale
from ..types import Buffer, Matrix, Quaternion, Vec3

INPUTS = {load.name: load.size for load in quantities.LOADS if load.port}
PARAMETERS = {getattr(row, "block", row.name): row.size for row in quantities.IN_BUFFER_ORDER}
OUTPUTS = {row.name: row.size for row in quantities.OUTPUTS}
SETTINGS = {
    "pivot": 1, "tolerance": 1, "span": 1, "substep": 1, "skip_model_checks": 1,
    "ports": len(INPUTS), "active": len(OUTPUTS) + len(quantities.NEEDS),
}  # fmt: skip
"""span: s; 0 if `tolerance` is for each substep. Otherwise the tolerance is for all substeps of a run of that length
together, and an error of the rate counts as the angle by which it turns the body in that time. skip_model_checks: 1 if
a plan has checked that the model is right for the parameters' values, so that the model need not check it. ports: 1 for
each input that may act. active: 1 for each output that is computed and for each need of the outputs, see
`quantities.active_flags`."""
OUTPUT_RATES = {f"d_{name}": size for name, size in OUTPUTS.items()}
"""Time derivatives of the outputs, refreshed by `output_rates` alone."""
MEMORY = STATE_BLOCKS | {"inverse_mass": 1, "M": 9, "M_inverse": 9, "arm": 3}
COMMON = INPUTS | PARAMETERS | SETTINGS | OUTPUTS | OUTPUT_RATES | MEMORY
LAYOUT = places(COMMON)
BLOCKS = LAYOUT.blocks
AT = LAYOUT.at

_INPUT = places(INPUTS).at
INPUTS_START, _CONSTANTS = (BLOCKS[f"{known}{next(iter(INPUTS))}"].start for known in ("", "constant_"))
"""Where inputs and known loads begin. Both are in the same order; an input adds to the known load of its name."""
_END = BLOCKS[next(reversed(PARAMETERS))].stop
_NOT_NEGATIVE = tuple((BLOCKS[load.block].start, BLOCKS[load.block].stop) for load in quantities.BOUNDED)
STATE_START = AT.q
"""Where the state begins: see `equations_of_motion`."""


@kernel(inline=False)
def initialize_body(z: Buffer) -> int:
    """Check the parameters and set the state; return 0 or a key of `buffer.FAULTS`."""
    fault = _fault_of_parameters(z)
    if fault != 0:
        return fault
    mass, r_oc, pivot = z[AT.mass], vec3_at(z, AT.r_oc_b), z[AT.pivot] != 0.0
    M_c = inertia_of(z)
    M = parallel_axis(M_c, mass, r_oc) if pivot else M_c
    q = normalize(quaternion_at(z, AT.quaternion_0))
    omega = vec3_at(z, AT.omega_b_0)
    (low, middle, _), axes = principal_axes(M)
    if middle <= INERTIA_TOLERANCE * trace(M):
        return TWO_ZERO_MOMENTS
    beam_rate = axes[0][0] * omega[0] + axes[1][0] * omega[1] + axes[2][0] * omega[2]
    if low <= INERTIA_TOLERANCE * trace(M) and abs(beam_rate) > INERTIA_TOLERANCE * math.sqrt(dot(omega, omega)):
        return BEAM_TURNS
    put_matrix_at(z, AT.M, M)
    put_matrix_at(z, AT.M_inverse, inverse_inertia(M))
    z[AT.inverse_mass] = 0.0 if pivot else 1.0 / mass
    put_vec3_at(z, AT.arm, r_oc if pivot else scale(-1.0, r_oc))
    position, velocity = vec3_at(z, AT.position_0), vec3_at(z, AT.velocity_0)
    v_c = add(velocity, rotate(q, cross(omega, r_oc)))
    put_rotation(z, q, omega)
    put_vec3_at(z, AT.r_c, add(position, rotate(q, r_oc)))
    put_vec3_at(z, AT.v_c, ZERO if pivot else v_c)
    return 0


@kernel(inline=False)
def _fault_of_parameters(z: Buffer) -> int:
    if not are_finite(z, 0, _END):
        return NOT_FINITE
    if not z[AT.mass] > 0.0:
        return NO_MASS
    for k in range(len(_NOT_NEGATIVE)):
        first, end = _NOT_NEGATIVE[k]
        for i in range(first, end):
            if z[i] < 0.0:
                return NEGATIVE + k
    q = quaternion_at(z, AT.quaternion_0)
    if not (q[0] != 0.0 or q[1] != 0.0 or q[2] != 0.0 or q[3] != 0.0):
        return NO_ATTITUDE
    fault = check_inertia(inertia_of(z))
    return 0 if fault == 0.0 else int(fault) + 1


@kernel
def inertia_of(z: Buffer) -> Matrix:
    """Return the inertia matrix, kg m^2, whose elements (11, 22, 33, 12, 13, 23) are in the block."""
    xx, yy, zz = vec3_at(z, AT.inertia)
    xy, xz, yz = vec3_at(z, AT.inertia + 3)
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))


@kernel
def rotation_of(z: Buffer) -> Rotation:
    """Return the state's attitude and rate."""
    return Rotation(quaternion_at(z, STATE_START), vec3_at(z, AT.omega))


@kernel
def put_rotation(z: Buffer, q: Quaternion, omega: Vec3) -> None:
    """Set attitude and body rate of the state."""
    put_quaternion_at(z, STATE_START, q)
    put_vec3_at(z, AT.omega, omega)


@kernel
def centre_of(z: Buffer) -> Centre:
    """Return the state's centre of mass."""
    return Centre(vec3_at(z, AT.r_c), vec3_at(z, AT.v_c))


@kernel
def put_centre(z: Buffer, r_c: Vec3, v_c: Vec3) -> None:
    """Set position and velocity of the centre of mass."""
    put_vec3_at(z, AT.r_c, r_c)
    put_vec3_at(z, AT.v_c, v_c)


@kernel
def motion_of(z: Buffer) -> State:
    """Return the state as `equations_of_motion.State`."""
    return State(vec3_at(z, AT.r_c), vec3_at(z, AT.v_c), quaternion_at(z, STATE_START), vec3_at(z, AT.omega))


@kernel
def is_finite(z: Buffer) -> bool:
    """Return whether every number of the state is finite."""
    return are_finite(z, STATE_START, STATE_START + STATE_SIZE)


@kernel
def has_pivot(z: Buffer) -> bool:
    """Return whether o is fixed in space."""
    return bool(z[AT.pivot] != 0.0)


@kernel
def body_of(z: Buffer) -> Body:
    """Return the constants of the equations of motion; see `equations_of_motion.Body`."""
    free = 1.0 if z[AT.pivot] == 0.0 else 0.0
    return Body(
        inverse_mass=z[AT.inverse_mass], inertia=matrix_at(z, AT.M), inertia_inverse=matrix_at(z, AT.M_inverse),
        arm_b=vec3_at(z, AT.arm), damping_b=vec3_at(z, AT.damping_b), is_free=free,
    )  # fmt: skip


@kernel
def loads_at(numbers: Buffer, i: int, pivot: bool) -> Loads:
    """Return the loads from numbers[i] on, in the order of a buffer's inputs; no forces if o is a pivot."""
    force_a, force_b = vec3_at(numbers, i + _INPUT.force_a), vec3_at(numbers, i + _INPUT.force_b)
    if pivot:
        force_a = force_b = ZERO
    torque_a, torque_b = vec3_at(numbers, i + _INPUT.torque_a), vec3_at(numbers, i + _INPUT.torque_b)
    return Loads(ZERO, force_a, force_b, torque_a, torque_b)


@kernel
def loads_of(z: Buffer) -> Loads:
    """Return the sum of known and supplied loads; see `equations_of_motion.Loads`."""
    pivot, gravity_a = has_pivot(z), vec3_at(z, AT.gravity_a)
    known, supplied = loads_at(z, _CONSTANTS, pivot), loads_at(z, INPUTS_START, pivot)
    force_a = scale(z[AT.mass], gravity_a) if pivot else add(known.force_a, supplied.force_a)
    force_b, torque_a = add(known.force_b, supplied.force_b), add(known.torque_a, supplied.torque_a)
    return Loads(gravity_a, force_a, force_b, torque_a, add(known.torque_b, supplied.torque_b))


PORTS = places(dict.fromkeys(INPUTS, 1), AT.ports).at
"""The place of each port's flag in the buffer."""
SHOWN = places(dict.fromkeys(OUTPUTS, 1), AT.active).at
"""The place of each output's flag in the buffer."""
_TRANSLATION, _PATH, _ATTITUDE, _RATE, _LEVER_RATE, _LOADS_NOW, _BODY_AXES, _SPHERE_RATE = (
    AT.active + len(OUTPUTS) + i for i in range(len(quantities.NEEDS))
)
_UNKNOWN = tuple(
    (BLOCKS[name].start, BLOCKS[name].stop)
    for load in quantities.LOADS
    if not load.in_closed_forms
    for name in ((load.block, load.name) if load.port else (load.block,))
) or ((0, 0),)
"""The first place of each load that models with a closed form do not know, and the place after its last."""


@kernel
def is_set(z: Buffer, flag: int) -> bool:
    """Return whether an input may act, or an output is computed; flag: one of PORTS or of SHOWN."""
    return bool(z[flag] != 0.0)


@kernel
def has_unknown_load(z: Buffer) -> bool:
    """Return whether a load acts that models with a closed form do not know."""
    for k in range(len(_UNKNOWN)):
        first, end = _UNKNOWN[k]
        for i in range(first, end):
            if z[i] != 0.0:
                return True
    return False


@kernel
def skips_model_checks(z: Buffer) -> bool:
    """Return whether a plan has already checked that the model is right; see `SETTINGS`."""
    return bool(z[AT.skip_model_checks] != 0.0)


@kernel
def needs_translation(z: Buffer) -> bool:
    """Return whether an output needs the position or velocity."""
    return bool(z[_TRANSLATION] != 0.0)


@kernel
def shows_loads(z: Buffer) -> bool:
    """Return whether an output changes as soon as a load does."""
    return bool(z[_LOADS_NOW] != 0.0)


@kernel
def shows_rates(z: Buffer) -> bool:
    """Return whether an output is computed from the body's rate, be it only the velocity of a point."""
    return bool(z[_RATE] != 0.0 or z[_LEVER_RATE] != 0.0)


@kernel
def needs_attitude(z: Buffer) -> bool:
    """Return whether an output needs the attitude: itself, for a point off the centre of mass, or a turning force."""
    return bool(z[_ATTITUDE] != 0.0 or _shows_turning_path(z))


@kernel
def _shows_turning_path(z: Buffer) -> bool:
    body_force = is_nonzero(vec3_at(z, AT.constant_force_b)) or is_nonzero(vec3_at(z, AT.force_b))
    beside = body_force or is_set(z, PORTS.force_b) or is_nonzero(vec3_at(z, AT.r_oc_b))
    return bool(beside and not has_pivot(z) and z[_PATH] != 0.0)


@kernel
def shows_more_than_momentum(z: Buffer, is_sphere: bool) -> bool:
    """Return whether an output needs the attitude besides the angular momentum in a; a sphere's omega_a does not."""
    return bool(z[_BODY_AXES] != 0.0 or (z[_SPHERE_RATE] != 0.0 and not is_sphere) or _shows_turning_path(z))


@kernel
def needs_rate(z: Buffer) -> bool:
    """Return whether an output needs the body's rate."""
    return bool(needs_attitude(z) or z[_RATE] != 0.0)
