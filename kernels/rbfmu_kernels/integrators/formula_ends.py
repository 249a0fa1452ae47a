"""Where series of formulas end: for pulses, which no term tells of before, at corners, and beyond touches of zero."""

import math

from ..compile.decorator import kernel
from ..types import Buffer
from . import polynomials

BEYOND = 1e-7
"""How far beyond a touch a series goes on, as a part of its reach."""
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
MOST_AGAIN = 40
"""How many series on end may begin beside the corner at which the last one ended.

A series finds the zero of (t - 1)^n early, by the n-th root of round-off: for n = 4 by 1e-4 of its reach. What it ends
at is no corner yet: the first coefficient of the next one is right there, which finds the zero so much better. The
power 64, the highest that is multiplied out, comes to 1e-10 in 40 of them, and what slides along its corner to an end.
"""
LAST_HALF = polynomials.LEAST * 2.0**-63
"""The part of [0, h] to which 64 halvings of the least step of a search find a root."""
SOON_AFTER = 8.0 * polynomials.AT_CORNER
"""The part of the time that has passed after which the side after a corner is looked at: some of its round-off."""
AROUND = 100.0
"""How far such a series goes at most, in times in which its first two terms come to zero: of (t - 1)^n the zero is at n
of them. In a longer one the zero is passed by 1e-9 of it, and searched for in steps as small.
"""


@kernel(inline=False)
def risen_at(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return how far, at most h, an exponent that is this polynomial rises no further than a series may follow it."""
    begin = z[i]
    low = max(begin, min(LEAST_EXPONENT, OF_EXPONENT * begin))
    level = low + max(RISE, PART_OF_RISE * abs(low))
    size, _ = polynomials.bound_of(z, i, row, n, h)
    if begin + (size - abs(begin)) <= level or not size < math.inf:  # such an h is halved for its defect
        return h
    h = polynomials.known_until(z, i, row, n, h, polynomials.ROUGHLY)
    size, _ = polynomials.bound_of(z, i, row, n, h)
    h = polynomials.known_until(z, i, row, n, h, min(polynomials.ROUGHLY, max(1.0, 0.01 * abs(level)) / size))
    z[i] = begin - level
    root = polynomials.first_root(z, i, row, n, 0.0, h, 0.0)
    z[i] = begin
    return min(root, h)


@kernel
def begins_again(z: Buffer, i: int, row: int, begun: float, t: float) -> float:
    """Return how many series on end began at a corner with this one, negative where it begins beside it; 0 if none.

    begun: how many did by where the last one ended. At a corner the coefficients z[i], z[i + row], ... come to zero in
    a time that is round-off of t, the time that has passed.
    """
    if 0.0 < begun <= MOST_AGAIN and abs(z[i]) > max(polynomials.AT_CORNER * abs(t * z[i + row]), polynomials.NOTHING):
        return -begun
    return begun


@kernel
def at_zero(z: Buffer, i: int, row: int, t: float) -> bool:
    """Return whether a polynomial comes to zero, or came there, in a time that is round-off of t."""
    return t * z[i + row] != 0.0 and abs(z[i]) <= polynomials.AT_CORNER * abs(t * z[i + row])


@kernel
def has_no_root(z: Buffer, i: int, row: int, at_corner: bool, was_zero: bool, t: float) -> bool:
    """Return whether the root of a polynomial has no series; was_zero: whether it was where the last one ended.

    Beside a zero there are ever shorter ones, and none at all where round-off makes of it less than zero.
    """
    return (was_zero and z[i] < 0.0) or (at_corner and at_zero(z, i, row, t))


@kernel(inline=False)
def rest_roots(z: Buffer, at: int, row: int, sides: int, touching: int, to: int, t: float) -> bool:
    """Let roots count as zero beside it where a corner is; return whether any does that did not before.

    at: where the polynomials stand of so many sides and of what roots are of; to: what says of each root whether it
    counts as zero, and then, whether what it is of was zero where the last series ended.
    """
    corner, changed = False, False
    for i in range(sides):
        corner |= at_zero(z, at + i, row, t)
    for i in range(sides, sides + touching):
        root = to + i - sides
        if z[root] == 0.0 and has_no_root(z, at + i, row, corner, z[root + touching] != 0.0, t):
            z[root], changed = 1.0, True
    return changed


@kernel
def side_after(z: Buffer, i: int, row: int, n: int, begun: float, t: float) -> float:
    """Return the side to which a series leads, 0 where all is zero; begun: of `begins_again`.

    At a corner it is the one after a time that is round-off of t: -(t - 1)^2 rises for as long as that at most.
    """
    if begun > 0.0:
        later = polynomials.polynomial(z, i + row, row, n - 1, SOON_AFTER * t)
        return math.copysign(1.0, later) if later != 0.0 else polynomials.side_from(z, i, row, 1, n)
    return polynomials.side_from(z, i, row, 0, n)


@kernel
def around_corner(z: Buffer, i: int, row: int, begun: float, h: float) -> float:
    """Return how far, at most h, a series goes; begun: of `begins_again`."""
    return min(h, AROUND * abs(z[i] / z[i + row])) if begun < 0.0 and z[i + row] != 0.0 else h


@kernel
def ends_at_corner(z: Buffer, i: int, row: int, n: int, begun: float, t: float, h: float) -> bool:
    """Return whether a series is zero at its end t, to round-off; begun: of `begins_again`; h: how far it was searched.

    Of one that began at its corner the first coefficient is left out, as where its root is looked for: one 2e-16 s
    after the beginning is known to a part of h alone. What is zero all along ends nowhere.
    """
    first = 1 if begun > 0.0 else 0
    at, n = i + first * row, n - first
    return is_zero_at_end(z, at, row, n, t, h) and bool(polynomials.bound_of(z, at, row, n, t)[0] > 0.0)


@kernel(inline=False)
def is_zero_at_end(z: Buffer, i: int, row: int, n: int, t: float, h: float) -> bool:
    """Return whether a polynomial is zero at t, to round-off; h: how far its root was searched."""
    size, slope = polynomials.bound_of(z, i, row, n, t)
    at_end = abs(polynomials.polynomial(z, i, row, n, t))
    return bool(at_end <= max(polynomials.AT_CORNER * size, LAST_HALF * h * slope))
