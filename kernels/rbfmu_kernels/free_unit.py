"""A body on which no torque acts as a co-simulation unit: exact rotation at any time, position in closed form.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory.
"""

from typing import Any

from ._kernel import kernel
from .body_memory import INPUTS as INPUTS
from .body_memory import OUTPUTS as OUTPUTS
from .body_memory import PARAMETERS as PARAMETERS
from .body_memory import (
    body_of,
    initialize_body,
    is_as_planned,
    loads_of,
    matrix_at,
    principal_frame,
    put_matrix_at,
    put_rotation,
    rotation_of,
    turns,
)
from .body_outputs import first_outputs
from .body_outputs import output_rates as output_rates
from .body_outputs import outputs as outputs
from .closed_form import CLOSED_FORM, finish_step, goes_on_free, has_torque, start_clocks, time_after
from .free_rotation import FREE_ROTATION_SIZE, FreeRotation, free_rates_at, free_rotation_at, free_rotation_setup
from .layout import NOT_REACHED, places
from .quaternion import compose_quaternions, invert_quaternion
from .rotation import invert_matrix, quaternion_from_matrix, transform

BLOCKS, SIZE = places(CLOSED_FORM | {"axes": 9, "constants": FREE_ROTATION_SIZE})

_AXES, _CONSTANTS = BLOCKS["axes"].start, BLOCKS["constants"].start
_TORQUE = 11
"""Key of `layout.FAULTS`."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set up the exact motion and the outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    body = body_of(z)
    if has_torque(z, body, loads_of(z)) and not is_as_planned(z):
        return _TORQUE
    moments, R_bp = principal_frame(body[1])
    put_matrix_at(z, _AXES, R_bp)
    q_ab, omega_b = rotation_of(z)
    q_ap = compose_quaternions(q_ab, quaternion_from_matrix(R_bp))
    constants = free_rotation_setup(moments, q_ap, transform(invert_matrix(R_bp), omega_b))
    for i in range(FREE_ROTATION_SIZE):
        z[_CONSTANTS + i] = constants[i]
    start_clocks(z)
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion is not finite or an input makes a torque."""
    body, loads = body_of(z), loads_of(z)
    if not goes_on_free(z, h, body, loads):
        return NOT_REACHED
    t = time_after(z, h)
    R_bp = matrix_at(z, _AXES)
    if turns(z):
        q_ap, omega_p = free_rotation_at(_constants(z), t)
        q_ab = compose_quaternions(q_ap, invert_quaternion(quaternion_from_matrix(R_bp)))
        put_rotation(z, q_ab, transform(R_bp, omega_p))
    else:
        put_rotation(z, rotation_of(z)[0], transform(R_bp, free_rates_at(_constants(z), t)))
    return finish_step(z, h, body, loads)


@kernel
def _constants(z: Any) -> FreeRotation:
    c = z[_CONSTANTS : _CONSTANTS + FREE_ROTATION_SIZE]
    return (
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11],
        c[12], c[13], c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23],
        c[24], c[25], c[26], c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34], c[35],
        c[36], c[37], c[38], c[39], c[40], c[41], c[42], c[43], c[44], c[45], c[46], c[47],
    )  # fmt: skip
