"""A body on which no torque acts as a co-simulation unit: exact rotation at any time, position in closed form.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory.
"""

from typing import Any

from ._kernel import kernel
from .body_memory import (
    COMMON,
    STATE_SIZE,
    body_of,
    first_outputs,
    initialize_body,
    is_finite,
    keep_state,
    loads_of,
    matrix_at,
    put_matrix_at,
    put_rotation,
    restore_state,
    rotation_of,
    translate,
)
from .body_memory import INPUTS as INPUTS
from .body_memory import OUTPUTS as OUTPUTS
from .body_memory import PARAMETERS as PARAMETERS
from .body_memory import outputs as outputs
from .double_double import two_sum
from .dynamics import Body, Loads
from .free_rotation import FREE_ROTATION_SIZE, FreeRotation, free_rotation_at, free_rotation_setup
from .inertia import principal_axes
from .layout import NOT_REACHED, places
from .quaternion import compose_quaternions, invert_quaternion
from .rotation import invert_matrix, quaternion_from_matrix, transform
from .shapes import Vec3

BLOCKS, SIZE = places(COMMON | {"before": STATE_SIZE, "elapsed": 2, "axes": 9, "constants": FREE_ROTATION_SIZE})

_BEFORE, _ELAPSED, _AXES, _CONSTANTS = (BLOCKS[n].start for n in ("before", "elapsed", "axes", "constants"))
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_TORQUE = 11
"""Key of `layout.FAULTS`."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set up the exact motion and the outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    body, loads = body_of(z), loads_of(z)
    if _may_have_torque(body, loads):
        return _TORQUE
    M = body[1]
    (x, y, w), R_bp = principal_axes(M)
    if M[0][1] == 0.0 and M[0][2] == 0.0 and M[1][2] == 0.0:  # its own axes, not a permutation of them
        (x, y, w), R_bp = (M[0][0], M[1][1], M[2][2]), _IDENTITY
    put_matrix_at(z, _AXES, R_bp)
    q_ab, omega_b = rotation_of(z)
    q_ap = compose_quaternions(q_ab, quaternion_from_matrix(R_bp))
    constants = free_rotation_setup((x, y, w), q_ap, transform(invert_matrix(R_bp), omega_b))
    for i in range(FREE_ROTATION_SIZE):
        z[_CONSTANTS + i] = constants[i]
    z[_ELAPSED] = z[_ELAPSED + 1] = 0.0
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion is not finite or an input makes a torque."""
    body, loads = body_of(z), loads_of(z)
    if not h > 0.0 or _may_have_torque(body, loads):
        return NOT_REACHED
    keep_state(z, _BEFORE)
    t, low = two_sum(z[_ELAPSED], h)
    low += z[_ELAPSED + 1]
    R_bp = matrix_at(z, _AXES)
    q_ap, omega_p = free_rotation_at(_constants(z), t + low)
    q_ab = compose_quaternions(q_ap, invert_quaternion(quaternion_from_matrix(R_bp)))
    put_rotation(z, q_ab, transform(R_bp, omega_p))
    translate(z, h, 1.0, body, loads)
    if not is_finite(z):
        restore_state(z, _BEFORE)
        return NOT_REACHED
    z[_ELAPSED], z[_ELAPSED + 1] = t, low
    return outputs(z)


@kernel
def _may_have_torque(body: Body, loads: Loads) -> bool:
    """Whether damping, a torque, or a force with an arm acts; or one that turns, which has no closed form here."""
    _, force_a, force_b, torque_a, torque_b = loads
    arm_b, damping_b = body[3], body[4]
    lever = _any(arm_b) and _any(force_a)
    return lever or _any(force_b) or _any(torque_a) or _any(torque_b) or _any(damping_b)


@kernel
def _any(v: Vec3) -> bool:
    return v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0


@kernel
def _constants(z: Any) -> FreeRotation:
    c = z[_CONSTANTS : _CONSTANTS + FREE_ROTATION_SIZE]
    return (
        c[0],
        c[1],
        c[2],
        c[3],
        c[4],
        c[5],
        c[6],
        c[7],
        c[8],
        c[9],
        c[10],
        c[11],
        c[12],
        c[13],
        c[14],
        c[15],
        c[16],
        c[17],
        c[18],
        c[19],
        c[20],
        c[21],
        c[22],
        c[23],
        c[24],
        c[25],
        c[26],
        c[27],
        c[28],
        c[29],
        c[30],
        c[31],
        c[32],
        c[33],
        c[34],
        c[35],
        c[36],
        c[37],
        c[38],
        c[39],
        c[40],
        c[41],
        c[42],
        c[43],
        c[44],
        c[45],
        c[46],
        c[47],
    )
