"""A communication step divided into substeps."""

import math

from ..buffer import MOST_SUBSTEPS
from ..compile.decorator import kernel

ROUND_OFF = 2.0**-52


@kernel
def substeps_in(h: float, longest: float) -> int:
    """The least number of equal parts of h, each at most `longest`; 0 where that is too many or no number.

    A part may be longer by 1e-9 of itself, so that round-off in the importer's clock adds none.
    """
    if not h < MOST_SUBSTEPS * longest:
        return 0
    return max(math.ceil(h / longest * (1.0 - 1e-9)), 1)


@kernel
def tolerance_of_substep(tolerance: float, span: float, part: float) -> float:
    """The largest estimated error of a substep `part`: its share of a run of `span` s, or, where that is 0, all of it.

    No share is below 2^-52: a substep in double precision loses about that.
    """
    return tolerance if span == 0.0 else max(tolerance * part / span, ROUND_OFF)
