"""A free body that turns at a constant rate as a co-simulation unit: a sphere, or a spin about a principal axis.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory.
"""

from typing import Any

from ._kernel import kernel
from ._principal import keeps_its_rate
from ._turns import turned, turning_about
from .body_memory import INPUTS as INPUTS
from .body_memory import OUTPUTS as OUTPUTS
from .body_memory import PARAMETERS as PARAMETERS
from .body_memory import (
    initialize_body,
    is_as_planned,
    put_quaternion_at,
    quaternion_at,
    rotation_of,
)
from .body_outputs import first_outputs
from .body_outputs import output_rates as output_rates
from .body_outputs import outputs as outputs
from .closed_form import (
    CLOSED_FORM,
    TURNING,
    finish_step,
    goes_on_free,
    has_torque,
    put_turning_at,
    start_clocks,
    time_after,
    turning_at,
)
from .double_double import dd_vector
from .layout import NOT_REACHED, places
from .quaternion import compose_quaternions

BLOCKS, SIZE = places(CLOSED_FORM | {"q_0": 4, "turning": TURNING})

_Q_0, _TURNING = BLOCKS["q_0"].start, BLOCKS["turning"].start
_UNSTEADY = 15
"""Key of `layout.FAULTS`."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    q, omega = rotation_of(z)
    steady = keeps_its_rate(z, omega) and not has_torque(z)
    if not steady and not is_as_planned(z):
        return _UNSTEADY
    put_quaternion_at(z, _Q_0, q)
    put_turning_at(z, _TURNING, turning_about(dd_vector(omega)))
    start_clocks(z)
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion is not finite or an input makes a torque."""
    if not goes_on_free(z, h):
        return NOT_REACHED
    t = time_after(z, h)
    q = compose_quaternions(quaternion_at(z, _Q_0), turned(turning_at(z, _TURNING), t))
    return finish_step(z, h, q, rotation_of(z)[1])
