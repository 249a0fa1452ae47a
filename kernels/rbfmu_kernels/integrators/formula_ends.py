"""Where series of formulas end: before pulses that their terms cannot show, at corners, and beyond double zeros."""

import math

from ..compile.decorator import kernel
from ..types import Buffer
from . import polynomials

BEYOND = 1e-7
"""How far a series goes on beyond a double zero (a touch), as a part of its reach."""
FARTHER, PARTS = 8.0, 8
"""The defect of the first series, and of each that reaches FARTHER times as far as the last one, is also checked
between PARTS equal parts: a pulse such as 1/(1 + (t - 50)**20) need not show in any of its terms.
"""
LEAST_EXPONENT, RISE, PART_OF_RISE, OF_EXPONENT = -745.0, 16.0, 0.25, 1e-6
"""The exponent below which exp is zero in doubles; by how much an exponent may rise within a series: at least RISE, or
this part of its size; and the part of a large negative exponent that is only round-off.

A pulse such as exp(-((t - 50) / w)**2) is zero in doubles before and after, so that no term of a series shows that it
comes. An exponent that rises by no more than 16 shows: the terms of exp are then as large as 16**n / n!.
"""
MOST_AGAIN = 40
"""How many series in a row may begin just before the corner at which the last one was to end.

A series finds an n-fold zero, (t - 1)^n, too early by the n-th root of round-off: for n = 4 by 1e-4 of its reach. The
next series begins nearer to the zero, has accurate coefficients there, and finds it much better. For the power 64, the
highest that is multiplied out, 40 series come within 1e-10; a motion that slides along its corner is stopped by it.
"""
LAST_HALF = polynomials.LEAST * 2.0**-63
"""The part of [0, h] to which 64 bisections of the shortest step of a search find a zero."""
SOON_AFTER = 8.0 * polynomials.AT_CORNER
"""How long after a corner its side is evaluated, as a part of the time since the start: a few times round-off."""
AROUND = 100.0
"""How far a series that begins beside its corner goes at most: so many times -z[0]/z[1], where its first terms cancel.
The zero of (t - 1)^n is n of these times away. A longer series would pass its zero by 1e-9 of its length, and would
search for it in steps as small.
"""


@kernel(inline=False)
def risen_at(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return the longest step, at most h, over which an exponent (a polynomial) rises by no more than RISE allows."""
    begin = z[i]
    low = max(begin, min(LEAST_EXPONENT, OF_EXPONENT * begin))
    level = low + max(RISE, PART_OF_RISE * abs(low))
    size, _ = polynomials.bound_of(z, i, row, n, h)
    if begin + (size - abs(begin)) <= level or not size < math.inf:  # where terms overflow, the defect cuts h
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
    """Return how many series in a row, this one included, began at a corner; negative where this begins beside it.

    begun: this number at the end of the last series; 0: none. A series begins at the corner if the zero of its
    polynomial z[i], z[i + row], ... is within round-off of t, the time passed since the start.
    """
    if 0.0 < begun <= MOST_AGAIN and abs(z[i]) > max(polynomials.AT_CORNER * abs(t * z[i + row]), polynomials.NOTHING):
        return -begun
    return begun


@kernel
def at_zero(z: Buffer, i: int, row: int, t: float) -> bool:
    """Return whether a polynomial's zero is within round-off of the present time t, before or after it."""
    return t * z[i + row] != 0.0 and abs(z[i]) <= polynomials.AT_CORNER * abs(t * z[i + row])


@kernel
def has_no_root(z: Buffer, i: int, row: int, at_corner: bool, was_zero: bool, t: float) -> bool:
    """Return whether a square root or power of this polynomial has no Taylor series here.

    was_zero: whether the polynomial was zero where the last series ended. Near a zero such series are ever shorter, and
    there is none where round-off makes the polynomial negative.
    """
    return (was_zero and z[i] < 0.0) or (at_corner and at_zero(z, i, row, t))


@kernel(inline=False)
def rest_roots(z: Buffer, at: int, row: int, sides: int, touching: int, to: int, t: float) -> bool:
    """Set square roots and powers to zero at a corner where their arguments are round-off; return whether any is new.

    at: where the polynomials begin: those of so many sides, then the arguments of so many roots (`touching`). to: two
    flags for each root: whether it counts as zero, and whether its argument was zero where the last series ended.
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
    """Return a polynomial's sign just after its beginning, 0 if it stays zero; begun: the result of `begins_again`.

    At a corner the sign is taken a few round-offs of t later: until then -(t - 1)^2 may still rise towards its zero.
    """
    if begun > 0.0:
        later = polynomials.polynomial(z, i + row, row, n - 1, SOON_AFTER * t)
        return math.copysign(1.0, later) if later != 0.0 else polynomials.side_from(z, i, row, 1, n)
    return polynomials.side_from(z, i, row, 0, n)


@kernel
def around_corner(z: Buffer, i: int, row: int, begun: float, h: float) -> float:
    """Return h, cut as AROUND says if the series begins beside its corner; begun: the result of `begins_again`."""
    return min(h, AROUND * abs(z[i] / z[i + row])) if begun < 0.0 and z[i + row] != 0.0 else h


@kernel
def ends_at_corner(z: Buffer, i: int, row: int, n: int, begun: float, t: float, h: float) -> bool:
    """Return whether a polynomial is zero at the end t of a series, to round-off, but not zero throughout.

    begun: the result of `begins_again`; h: how far its zero was searched. If the series began at its corner, the first
    coefficient is left out, as in the search for the next zero: one 2e-16 s after the beginning is known only to a part
    of h.
    """
    first = 1 if begun > 0.0 else 0
    at, n = i + first * row, n - first
    return is_zero_at_end(z, at, row, n, t, h) and bool(polynomials.bound_of(z, at, row, n, t)[0] > 0.0)


@kernel(inline=False)
def is_zero_at_end(z: Buffer, i: int, row: int, n: int, t: float, h: float) -> bool:
    """Return whether a polynomial is zero at t, to round-off; h: how far its zero was searched."""
    size, slope = polynomials.bound_of(z, i, row, n, t)
    at_end = abs(polynomials.polynomial(z, i, row, n, t))
    return bool(at_end <= max(polynomials.AT_CORNER * size, LAST_HALF * h * slope))
