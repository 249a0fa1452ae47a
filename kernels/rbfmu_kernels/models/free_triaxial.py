"""A body on which no torque acts as a co-simulation unit: exact rotation at any time, position in closed form.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory.
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, goes_on_free, is_driven, start_clocks, time_after
from ..body.memory import INPUTS as INPUTS
from ..body.memory import OUTPUTS as OUTPUTS
from ..body.memory import PARAMETERS as PARAMETERS
from ..body.memory import initialize_body, is_as_planned, needs_attitude, put_rotation, rotation_of, shows_rates
from ..body.outputs import first_outputs
from ..body.outputs import output_rates as body_output_rates
from ..body.outputs import outputs as outputs
from ..body.principal import exact_frame, rates_along, rounded
from ..buffer import FINE, NOT_REACHED, places
from ..buffer_access import matrix_at, put_matrix_at, put_quaternion_at, quaternion_at
from ..compile.decorator import kernel
from ..exact.free_rotation import (
    COLUMNS,
    FREE_ROTATION_SIZE,
    FreeRotation,
    Place,
    attitude_at,
    free_rotation_of,
    in_body_axes,
    place_at,
    rates_at,
    scaled_time,
)
from ..rotations.matrix import invert_matrix, quaternion_from_matrix, transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion
from ..types import Vec3

FREE = CLOSED_FORM | {"axes": 9, "place": 4, "moved": 1, "constants": FREE_ROTATION_SIZE}
"""Besides, after a step: where on the polhode the body is, and 1."""
BLOCKS, SIZE = places(FREE)

_M, _AXES, _PLACE, _MOVED, _CONSTANTS = (BLOCKS[n].start for n in ("M", "axes", "place", "moved", "constants"))
_TORQUE = 11
"""Key of `buffer.FAULTS`."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set up the exact motion and the outputs; returns 0 or a key of `buffer.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    if is_driven(z) and not is_as_planned(z):
        return _TORQUE
    set_up(z)
    return first_outputs(z)


@kernel(inline=False)
def set_up(z: Any) -> None:
    """The exact motion's constants and the clocks."""
    moments, axes = exact_frame(z)
    R_bp = invert_matrix(rounded(axes))
    put_matrix_at(z, _AXES, R_bp)
    q_ab, omega_b = rotation_of(z)
    q_bp = quaternion_from_matrix(R_bp)
    q_ap = compose_quaternions(q_ab, q_bp)
    constants = free_rotation_of(moments, q_ap, rates_along(axes, omega_b))
    for i in range(FREE_ROTATION_SIZE):
        z[_CONSTANTS + i] = constants[i]
    for i in range(_CONSTANTS + COLUMNS, _CONSTANTS + COLUMNS + 16, 4):
        put_quaternion_at(z, i, compose_quaternions(quaternion_at(z, i), invert_quaternion(q_bp)))
    start_clocks(z)
    z[_MOVED] = 0.0


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion is not finite or an input makes a torque."""
    if not goes_on_free(z, h):
        return NOT_REACHED
    constants = constants_of(z)
    t = scaled_time(constants, time_after(z, h))
    place = place_at(constants, t)
    q = attitude_at(constants, t, place) if needs_attitude(z) else rotation_of(z)[0]
    status = finish_step(z, h, q, shown_rates(z, place))
    if status == FINE:
        keep_place(z, place)
    return status


@kernel
def shown_rates(z: Any, place: Place) -> Vec3:
    """omega_ab_b at a place on the polhode, where an output needs it."""
    return _rates(z, place) if shows_rates(z) else rotation_of(z)[1]


@kernel
def keep_place(z: Any, place: Place) -> None:
    """Where on the polhode the body is after a step."""
    put_quaternion_at(z, _PLACE, place)
    z[_MOVED] = 1.0


@kernel(inline=False)
def output_rates(z: Any) -> int:
    """Set the outputs' time derivatives, inputs held; first the rate, which may be that of a step before."""
    if z[_MOVED] != 0.0:
        put_rotation(z, rotation_of(z)[0], _rates(z, quaternion_at(z, _PLACE)))
    return body_output_rates(z)


@kernel(inline=False)
def _rates(z: Any, place: Place) -> Vec3:
    """omega_ab_b at a place on the polhode."""
    v = in_body_axes(rates_at(constants_of(z), place), z[_CONSTANTS + COLUMNS + 16], z[_CONSTANTS + COLUMNS + 17])
    return transform(matrix_at(z, _AXES), v)


@kernel
def constants_of(z: Any) -> FreeRotation:
    """What `set_up` has set up."""
    c = z[_CONSTANTS : _CONSTANTS + FREE_ROTATION_SIZE]
    return (
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11],
        c[12], c[13], c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23],
        c[24], c[25], c[26], c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34], c[35],
        c[36], c[37], c[38], c[39], c[40], c[41], c[42], c[43], c[44], c[45], c[46], c[47],
        c[48], c[49], c[50], c[51], c[52], c[53], c[54], c[55], c[56], c[57], c[58], c[59],
        c[60], c[61],
    )  # fmt: skip
