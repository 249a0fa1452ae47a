"""A body under any of the scene's loads as a co-simulation unit: DOP853 inside a communication step.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory. `step` commits all
of a communication step or nothing. `tolerance` is the largest estimated error of a substep, 0 for substeps of at most
`substep` without error control (`rbfmu.fitting` chooses). Inputs may change within a step: see `body.driven`.
"""

from typing import Any

from ..body.driven import DRIVEN, STEP_SIZE, finish, integrated, keep, load_polynomial_of
from ..body.memory import INPUTS as INPUTS
from ..body.memory import OUTPUTS as OUTPUTS
from ..body.memory import PARAMETERS as PARAMETERS
from ..body.memory import STATE, body_of, initialize_body, loads_of
from ..body.outputs import first_outputs
from ..body.outputs import output_rates as output_rates
from ..body.outputs import outputs as outputs
from ..buffer import NOT_REACHED, places
from ..compile.decorator import kernel
from ..integrators.dop853 import WORK, dop853_advance, dop853_march, first_step
from ..integrators.rigid_body_state import ROTATION

_, _BEFORE = places(DRIVEN)
BLOCKS, SIZE = places(DRIVEN | {"pad_3": -_BEFORE % 8, "work": WORK})
"""The work space begins with a cache line where the buffer does."""

_TOLERANCE, _SPAN, _SUBSTEP, _WORK = (BLOCKS[n].start for n in ("tolerance", "span", "substep", "work"))


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `buffer.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    z[STEP_SIZE] = first_step(z, STATE, body_of(z), loads_of(z))
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion cannot be followed."""
    if not h > 0.0:
        return NOT_REACHED
    keep(z)
    body, loads = body_of(z), load_polynomial_of(z)
    n = max(ROTATION, integrated(z, body, loads))
    if z[_TOLERANCE] > 0.0:
        status = dop853_advance(z, STATE, _WORK, STEP_SIZE, n, h, z[_TOLERANCE], z[_SPAN], body, loads)
    else:
        status = dop853_march(z, STATE, _WORK, n, h, z[_SUBSTEP], body, loads)
    return finish(z, n, h, status, body, loads)
