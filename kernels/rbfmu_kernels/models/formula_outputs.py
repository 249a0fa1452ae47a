"""Outputs of one's own over a closed form, functions of its motion and of the time: templates, see `formulas`."""

from typing import Any

from ..buffer import OK, STEP_REJECTED
from ..buffer_access import copy_numbers, pair_at, put_pair_at
from ..numerics import double_double as dd
from ..types import Buffer

# What templates are bound to, see `formulas`.
_missing: Any = None
values = loads = begin = advance = refresh = _missing
SHOWN: tuple[float, ...] = ()
TIME = STARTS = ACTIVE = KEPT = MEMORY = MEMORY_SIZE = 0


def initialize_over(z: Buffer) -> int:
    """Set up the closed form, which also shows what own outputs read, then these."""
    loads(z)
    for i in range(len(SHOWN)):
        z[ACTIVE + i] = max(z[ACTIVE + i], SHOWN[i])
    put_pair_at(z, TIME, (z[STARTS], 0.0))
    return begin(z) or values(z)  # type: ignore[no-any-return]


def step_over(z: Buffer, h: float) -> int:
    """Advance the closed form by h; reject the step and change nothing where an output is not finite."""
    copy_numbers(z, MEMORY, KEPT, MEMORY_SIZE)
    if advance(z, h) == OK:
        put_pair_at(z, TIME, dd.add_float(pair_at(z, TIME), h))
        if values(z) == 0:
            return OK
    copy_numbers(z, KEPT, MEMORY, MEMORY_SIZE)
    return STEP_REJECTED


def outputs_over(z: Buffer) -> int:
    """Refresh the outputs."""
    return refresh(z) or values(z)  # type: ignore[no-any-return]
