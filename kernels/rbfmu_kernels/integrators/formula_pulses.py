"""Pulses, which no term of a series of formulas tells of before: where it ends for them, and is looked at inside."""

import math

from ..compile.decorator import kernel
from ..types import Buffer
from .polynomials import ROUGHLY, bound_of, first_root, known_until

FARTHER, PARTS = 8.0, 8
"""The first series, and each that reaches so many times as far as the last one, has its defect looked at between so
many parts as well: no term of it need tell of a pulse such as 1/(1 + (t - 50)**20).
"""
LEAST_EXPONENT, RISE, PART_OF_RISE, OF_EXPONENT = -745.0, 16.0, 0.25, 1e-6
"""The exponent below which an exponential is zero in doubles; how far one may rise in a series, at least and as a part;
and the part of itself to which a large negative one may, of which round-off is left.

A pulse such as exp(-((t - 50) / w)**2) is nothing before and after, and no term of a series tells that it comes. What
rises by 16 within a series is seen by its terms: 16**n / n! and more of them.
"""


@kernel(inline=False)
def risen_at(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return how far, at most h, an exponent that is this polynomial rises no further than a series may follow it."""
    begin = z[i]
    low = max(begin, min(LEAST_EXPONENT, OF_EXPONENT * begin))
    level = low + max(RISE, PART_OF_RISE * abs(low))
    size, _ = bound_of(z, i, row, n, h)
    if begin + (size - abs(begin)) <= level or not size < math.inf:  # such an h is halved for its defect
        return h
    h = known_until(z, i, row, n, h, ROUGHLY)
    size, _ = bound_of(z, i, row, n, h)
    h = known_until(z, i, row, n, h, min(ROUGHLY, max(1.0, 0.01 * abs(level)) / size))
    z[i] = begin - level
    root = first_root(z, i, row, n, 0.0, h)
    z[i] = begin
    return min(root, h)
