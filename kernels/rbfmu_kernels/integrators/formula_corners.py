"""Whether a series begins at a corner, where the first coefficient of what has sides is round-off, or beside it."""

from ..compile.decorator import kernel
from ..types import Buffer
from .polynomials import AT_CORNER, NOTHING

MOST_AGAIN = 40
"""How many series on end may begin beside the corner at which the last one ended.

A series finds the zero of (t - 1)^n early, by the n-th root of round-off: for n = 4 by 1e-4 of its reach. What it ends
at is no corner yet: the first coefficient of the next one is right there, which finds the zero so much better. The
power 64, the highest that is multiplied out, comes to 1e-10 in 40 of them, and what slides along its corner to an end.
"""


@kernel
def begins_again(z: Buffer, i: int, row: int, begun: float, t: float) -> float:
    """Return how many series on end began at a corner with this one, negative where it begins beside it; 0 if none.

    begun: how many did by where the last one ended. At a corner the coefficients z[i], z[i + row], ... come to zero in
    a time that is round-off of t, the time that has passed.
    """
    if 0.0 < begun <= MOST_AGAIN and abs(z[i]) > max(AT_CORNER * abs(t * z[i + row]), NOTHING):
        return -begun
    return begun
