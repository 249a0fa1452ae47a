"""The model of a body under any of the scene's loads, by Taylor series inside a communication step.

`tolerance` is the largest estimated error of a substep, and `order` is that of the series; both come from the plan.
Inputs may change within a step: see `body.driven`.
"""

from typing import Any

from ..body.driven import DRIVEN, STEP_SIZE, finish, integrated, keep, load_polynomial_of
from ..body.memory import STATE_START, body_of
from ..body.shell import entry_functions, output_rates, outputs
from ..buffer import places
from ..compile.decorator import kernel
from ..integrators.dop853 import LONGEST_STEP
from ..integrators.taylor import taylor_advance
from ..integrators.taylor_coefficients import WORK

__all__ = ["BLOCKS", "SIZE", "initialize", "output_rates", "outputs", "step"]

_, _BEFORE = places(DRIVEN | {"order": 1})
BLOCKS, SIZE = places(DRIVEN | {"order": 1, "pad_3": -_BEFORE % 8, "work": WORK})
"""The work space begins at a cache line if the buffer does."""

_TOLERANCE, _SPAN, _ORDER, _WORK = (BLOCKS[n].start for n in ("tolerance", "span", "order", "work"))


@kernel
def _set_up(z: Any) -> int:
    z[STEP_SIZE] = LONGEST_STEP  # the series themselves say at once how much is too long
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion cannot be followed."""
    keep(z)
    body, loads = body_of(z), load_polynomial_of(z)
    n = integrated(z, body, loads)
    status = taylor_advance(
        z, STATE_START, _WORK, STEP_SIZE, n, int(z[_ORDER]), h, z[_TOLERANCE], z[_SPAN], body, loads
    )
    return finish(z, n, h, status, body, loads)


initialize, step = entry_functions(__name__, _set_up, _advance)
