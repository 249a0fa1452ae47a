"""A body that turns about one principal axis, fixed in space, under constant torque and damping: a closed form.

As a co-simulation unit: `initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), its whole memory.
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, first_attitude, start_clocks, time_after
from ..body.fixed_axis import leaves_axis, main_axis, pull_and_decay, swing
from ..body.memory import INPUTS as INPUTS
from ..body.memory import OUTPUTS as OUTPUTS
from ..body.memory import PARAMETERS as PARAMETERS
from ..body.memory import body_of, initialize_body, is_as_planned, loads_of, needs_attitude, rotation_of
from ..body.outputs import first_outputs
from ..body.outputs import output_rates as output_rates
from ..body.outputs import outputs as outputs
from ..buffer import NOT_REACHED, places
from ..buffer_access import put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..numerics.phi_functions import relaxed
from ..rotations.quaternion import compose_quaternions
from ..rotations.rotation_vector import quaternion_from_axis_angle
from ..rotations.vec3 import dot, scale

BLOCKS, SIZE = places(CLOSED_FORM | {"axis": 3, "rate": 1, "pull": 1, "decay": 1})

_AXIS, _RATE, _PULL, _DECAY = (BLOCKS[n].start for n in ("axis", "rate", "pull", "decay"))
_MORE_AXES = 17
"""Key of `buffer.FAULTS`."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `buffer.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    axis = main_axis(q, omega, body, loads)
    cosine, sine = swing(z, axis)
    if not is_as_planned(z) and (cosine[0] != 0.0 or sine[0] != 0.0 or leaves_axis(z, axis, q, omega, body, loads)):
        return _MORE_AXES
    put_vec3_at(z, _AXIS, axis)
    z[_RATE] = dot(axis, omega)
    pull, z[_DECAY] = pull_and_decay(z, axis, q, body, loads)
    z[_PULL] = pull + cosine[0]
    start_clocks(z)
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion is not finite."""
    if not h > 0.0:
        return NOT_REACHED
    high, low = time_after(z, h)
    t = high + low
    axis, q = vec3_at(z, _AXIS), first_attitude(z)
    angle, rate = relaxed(z[_RATE], z[_PULL], z[_DECAY], t)
    if needs_attitude(z):
        q = compose_quaternions(q, quaternion_from_axis_angle(axis, angle))
    return finish_step(z, h, q, scale(rate, axis))
