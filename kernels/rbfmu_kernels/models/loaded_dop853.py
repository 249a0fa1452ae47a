"""The model of a body under any of the scene's loads, by DOP853 inside a communication step.

`tolerance` is the largest estimated error of a substep, or 0 for substeps of at most `substep` without error control.
Inputs may change within a step: see `body.driven`.
"""

from typing import Any

from ..body.driven import DRIVEN, STEP_SIZE, finish, integrated, keep, load_polynomial_of
from ..body.memory import STATE_START, body_of, loads_of
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import places
from ..compile.decorator import kernel
from ..integrators.dop853 import WORK, dop853_advance, dop853_march, first_step
from ..integrators.rigid_body_state import ROTATION

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

_, _BEFORE = places(DRIVEN)
BLOCKS, SIZE = places(DRIVEN | {"pad_3": -_BEFORE % 8, "work": WORK})
"""The work space begins at a cache line if the buffer does."""

_TOLERANCE, _SPAN, _SUBSTEP, _WORK = (BLOCKS[n].start for n in ("tolerance", "span", "substep", "work"))


@kernel
def _set_up(z: Any) -> int:
    z[STEP_SIZE] = first_step(z, STATE_START, body_of(z), loads_of(z))
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion cannot be followed."""
    keep(z)
    body, loads = body_of(z), load_polynomial_of(z)
    n = max(ROTATION, integrated(z, body, loads))
    if z[_TOLERANCE] > 0.0:
        status = dop853_advance(z, STATE_START, _WORK, STEP_SIZE, n, h, z[_TOLERANCE], z[_SPAN], body, loads)
    else:
        status = dop853_march(z, STATE_START, _WORK, n, h, z[_SUBSTEP], body, loads)
    return finish(z, n, h, status, body, loads)


initialize, step = entry_functions(__name__, _set_up, _advance)
