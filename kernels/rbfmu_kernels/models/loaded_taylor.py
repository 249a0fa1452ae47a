"""The model of a body under any of the scene's loads, by Taylor series inside a communication step.

`tolerance` is the largest estimated error of a substep, and `order` is that of the series; both come from the plan.
Inputs may change within a step: see `body.driven`. While they hold, and steps are short, a series serves many of them:
see `integrators.dense_output`.
"""

import math
from typing import Any

from ..body.driven import (
    DRIVEN,
    NUMBER_OF_INPUTS,
    STEP_SIZE,
    finish,
    finish_steadily,
    holds_inputs,
    integrated,
    keep,
    keep_inputs,
    load_polynomial_of,
)
from ..body.memory import STATE_START, body_of
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import OK, places
from ..buffer_access import copy_numbers, pair_at, put_pair_at
from ..compile.decorator import kernel
from ..integrators.dense_output import (
    ALIVE,
    BURIED,
    KEPT,
    KEPT_SIZE,
    LEAST_REACH,
    NONE,
    SINCE,
    WAIT,
    extent_of,
    follow,
    follow_series,
    reaches_over,
)
from ..integrators.dop853 import LONGEST_STEP
from ..integrators.taylor import taylor_advance
from ..integrators.taylor_coefficients import MAX_ORDER, WORK

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

ORDERS = range(4, MAX_ORDER + 1, 2)
_DENSE = KEPT | {"kept_before": KEPT_SIZE, "held_inputs": NUMBER_OF_INPUTS}
_, _BEFORE = places(DRIVEN | {"order": 1} | _DENSE)
BLOCKS, SIZE = places(DRIVEN | {"order": 1} | _DENSE | {"pad_3": -_BEFORE % 8, "work": WORK})
"""The work space begins at a cache line if the buffer does."""

_TOLERANCE, _SPAN, _ORDER, _WORK = (BLOCKS[n].start for n in ("tolerance", "span", "order", "work"))
_SERIES, _SERIES_BEFORE, _HELD = (BLOCKS[n].start for n in (next(iter(KEPT)), "kept_before", "held_inputs"))


@kernel
def _set_up(z: Any) -> int:
    z[STEP_SIZE] = LONGEST_STEP  # the series themselves say at once how much is too long
    z[_SERIES], z[_SERIES + WAIT] = NONE, 0.0
    keep_inputs(z, _HELD)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion cannot be followed."""
    if not (reaches_over(z, _SERIES, h) and holds_inputs(z, _HELD)):
        return _advance_by_new_series(z, h)
    keep(z)
    since = pair_at(z, _SERIES + SINCE)
    follow(z, STATE_START, _WORK, _SERIES, int(z[_ORDER]), h)
    status = finish_steadily(z, extent_of(z, _SERIES), h)
    if status != OK:
        put_pair_at(z, _SERIES + SINCE, since)
    return status


@kernel(inline=False)
def _advance_by_new_series(z: Any, h: float) -> int:
    """Advance by h where a new series has to be made."""
    keep(z)
    copy_numbers(z, _SERIES, _SERIES_BEFORE, KEPT_SIZE)
    body, loads = body_of(z), load_polynomial_of(z)
    n, order, rest = integrated(z, body, loads), int(z[_ORDER]), h
    if is_series_tried(z, h):
        rest = follow_series(
            z, STATE_START, _WORK, _SERIES, STEP_SIZE, n, order, h, z[_TOLERANCE], z[_SPAN], body, loads
        )
    status = OK
    if rest > 0.0:
        z[_SERIES] = NONE
        z[_SERIES + WAIT] -= 1.0
        status = taylor_advance(z, STATE_START, _WORK, STEP_SIZE, n, order, rest, z[_TOLERANCE], z[_SPAN], body, loads)
    status = finish(z, n, h, status, body, loads)
    if status == OK:
        keep_inputs(z, _HELD)
        return OK
    copy_numbers(z, _SERIES_BEFORE, _SERIES, KEPT_SIZE)
    if z[_SERIES] == ALIVE:
        z[_SERIES] = BURIED
    return status


@kernel
def is_series_tried(z: Any, h: float) -> bool:
    """Return whether a series that serves further steps like this one is likely enough for one to be made."""
    steady = holds_inputs(z, _HELD) and z[_TOLERANCE] < math.inf
    return bool(steady and z[_SERIES + WAIT] <= 0.0 and h * LEAST_REACH <= z[STEP_SIZE])


initialize, step = entry_functions(__name__, _set_up, _advance)
