"""A body under any of the scene's loads as a co-simulation unit: DOP853 with error control inside a communication step.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory. `step` commits all
of a communication step or nothing. The scene's accuracy sets the tolerance, by way of a pilot run (`rbfmu.planning`).
"""

from typing import Any

from ._kernel import kernel
from .body_memory import (
    COMMON,
    STATE,
    STATE_SIZE,
    body_of,
    first_outputs,
    has_pivot,
    initialize_body,
    is_finite,
    keep_state,
    loads_of,
    restore_state,
    translate,
)
from .body_memory import INPUTS as INPUTS
from .body_memory import OUTPUTS as OUTPUTS
from .body_memory import PARAMETERS as PARAMETERS
from .body_memory import outputs as outputs
from .dop853 import ROTATION, TURNING, WORK, dop853_advance, first_step
from .layout import NOT_REACHED, places

BLOCKS, SIZE = places(
    COMMON | {"before": STATE_SIZE, "step_size": 1, "substeps": 1, "step_size_before": 1, "work": WORK}
)

_TOLERANCE, _BEFORE, _WORK = (BLOCKS[n].start for n in ("tolerance", "before", "work"))
_STEP_SIZE, _SIZE_BEFORE = BLOCKS["step_size"].start, BLOCKS["step_size_before"].start


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    z[_STEP_SIZE] = first_step(z, STATE, body_of(z), loads_of(z))
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h with the inputs held; NOT_REACHED (and nothing changed) where the motion cannot be followed."""
    if not h > 0.0:
        return NOT_REACHED
    keep_state(z, _BEFORE)
    z[_SIZE_BEFORE] = z[_STEP_SIZE]
    body, loads = body_of(z), loads_of(z)
    f = loads[2]
    turning = not has_pivot(z) and (f[0] != 0.0 or f[1] != 0.0 or f[2] != 0.0)
    n = TURNING if turning else ROTATION
    status = dop853_advance(z, STATE, _WORK, _STEP_SIZE, n, h, z[_TOLERANCE], body, loads)
    translate(z, h, 0.0 if turning else 1.0, body, loads)
    if status != 0 or not is_finite(z):
        restore_state(z, _BEFORE)
        z[_STEP_SIZE] = z[_SIZE_BEFORE]
        return NOT_REACHED
    return outputs(z)
