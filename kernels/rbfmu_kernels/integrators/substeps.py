"""A communication step divided into substeps; their size is kept in a buffer, and next to it their count."""

import math
from typing import Any

from ..buffer import MAX_SUBSTEPS
from ..buffer_access import pair_at, put_pair_at
from ..compile.decorator import kernel
from ..compile.wide import choose

ROUND_OFF = 2.0**-52


@kernel
def substeps_in(h: float, longest: float) -> int:
    """Return the least number of equal parts of h, each at most `longest`; 0 where that is too many or no number.

    A part may be longer by 1e-9 of itself, so that round-off in the importer's clock adds none.
    """
    if not h < MAX_SUBSTEPS * longest:
        return 0
    return parts_in(h, longest)


@kernel
def parts_in(h: float, longest: float) -> int:
    """Return the same where it is known to be a number that is not too large."""
    return max(math.ceil(h / longest * (1.0 - 1e-9)), 1)


@kernel
def tolerance_of_substep(tolerance: float, span: float, part: float) -> float:
    """Return the largest error of a substep `part`: its share of a run of `span` s, or all of it where that is 0.

    No share is below 2^-52: a substep in double precision loses about that.
    """
    return tolerance if span == 0.0 else max(tolerance * part / span, ROUND_OFF)


@kernel
def nearer_size(h: float, order: int, excess: float) -> float:
    """Return the step whose error is that of h over `excess`: about h excess^(-1 / order), without a root."""
    near = h * ((order + 1.0) + (order - 1.0) * excess) / ((order - 1.0) + (order + 1.0) * excess)
    near = choose(excess < 1e-4, choose(excess < 1e-8, 2.0 * h, 1.3 * h), near)
    return choose(excess < 1e4, near, 0.5 * h)


@kernel
def count_substep(z: Any, size: int) -> None:
    """Add one to the count that is kept next to the step size at z[size]."""
    h, count = pair_at(z, size)
    put_pair_at(z, size, (h, count + 1.0))
