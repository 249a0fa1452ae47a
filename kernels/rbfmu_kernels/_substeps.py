"""A communication step divided into substeps."""

import math

from ._kernel import kernel
from .layout import MOST_SUBSTEPS


@kernel
def substeps_in(h: float, longest: float) -> int:
    """The least number of equal parts of h, each at most `longest`; 0 where that is too many or no number.

    A part may be longer by 1e-9 of itself, so that round-off in the importer's clock adds none.
    """
    if not h < MOST_SUBSTEPS * longest:
        return 0
    return max(math.ceil(h / longest * (1.0 - 1e-9)), 1)
