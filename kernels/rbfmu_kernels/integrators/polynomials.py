"""Polynomials in a buffer: values, first roots and least values near zero, where series end at corners."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import exponential, logarithm
from ..types import Buffer
from .substeps import power_of


@kernel
def polynomial(z: Buffer, i: int, row: int, n: int, t: float) -> float:
    """Return the polynomial z[i], z[i + row], ... of degree n at t."""
    total = z[i + n * row]
    for k in range(n - 1, -1, -1):
        total = total * t + z[i + k * row]
    return total


@kernel
def slope_of(z: Buffer, i: int, row: int, n: int, t: float) -> float:
    """Return the polynomial's derivative at t."""
    total = 0.0
    for k in range(n, 0, -1):
        total = total * t + k * z[i + k * row]
    return total


@kernel
def bound_of(z: Buffer, i: int, row: int, n: int, h: float) -> tuple[float, float]:
    """Return the largest that the polynomial, and its derivative, can be in [0, h]."""
    size, slope, power = abs(z[i]), 0.0, 1.0
    for k in range(1, n + 1):
        slope += k * abs(z[i + k * row]) * power
        power *= h
        size += abs(z[i + k * row]) * power
    return size, slope


@kernel
def bend_of(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return the largest that the polynomial's second derivative can be in [0, h]."""
    bend, power = 0.0, 1.0
    for k in range(2, n + 1):
        bend += k * (k - 1) * abs(z[i + k * row]) * power
        power *= h
    return bend


@kernel
def away(value: float, slope: float, bend: float) -> float:
    """Return how far what has this value > 0 and slope stays above zero, as its second derivative is at most `bend`.

    The root of value + slope d - bend d^2 / 2, without cancellation: beside a double root steps shrink with the
    distance, and beside a simple one they are Newton's.
    """
    root = math.sqrt(slope * slope + 2.0 * bend * value)
    if slope >= 0.0:
        return (slope + root) / bend if bend > 0.0 else math.inf
    return 2.0 * value / (root - slope)


ROUGHLY = 1e-4
"""The part of its size to which what has corners must be known, so that none is passed over.

It bounds how far the search goes, not how well a corner is found: a root is bisected to the last bit of its time.
"""


NOTHING = 1e-290
"""What is less has too few digits for its terms to tell how well it is known."""


@kernel(inline=False)
def known_until(z: Buffer, i: int, row: int, n: int, h: float, part: float) -> float:
    """Return how far, at most h, a series cut at degree n leaves out no more than a part of its size.

    Where its last coefficients are no numbers, as beside the zero of a root, it is until the first two may cancel.
    """
    if 0.0 < abs(z[i + row]) < math.inf and not abs(z[i + (n - 1) * row]) < math.inf:
        return min(h, abs(z[i] / z[i + row]))
    for _ in range(100):
        size, _ = bound_of(z, i, row, n, h)
        last = power_of(h, n - 1) * max(abs(z[i + (n - 1) * row]), abs(z[i + n * row]) * h)
        if not last > max(part * size, NOTHING):
            break
        h *= 0.8
    return h


@kernel
def last_terms(z: Buffer, i: int, row: int, n: int, t: float) -> float:
    """Return the sizes of the last two terms together."""
    return power_of(t, n - 1) * (abs(z[i + (n - 1) * row]) + abs(z[i + n * row]) * t)


@kernel
def begins_at_zero(z: Buffer, i: int, row: int, n: int) -> bool:
    """Return whether a polynomial is zero at 0, but not everywhere."""
    size = 0.0
    for k in range(1, n + 1):
        size += abs(z[i + k * row])
    return bool(z[i] == 0.0 and size > 0.0)


AT_CORNER = 1e-13
"""The size, relative to its terms, below which a number at a series' end is at its corner, whose side rates rest on."""


@kernel
def side_from(z: Buffer, i: int, row: int, first: int, n: int) -> float:
    """Return the sign of the first coefficient that is not zero, from the one of degree `first` on; 0 if all are."""
    for k in range(first, n + 1):
        if z[i + k * row] != 0.0:
            return math.copysign(1.0, z[i + k * row])
    return 0.0


CLOSE, TOUCHING, OF_ROOTS = 1e-4, 1e-10, 1e-7
"""The parts of its bound below which a polynomial's least value is looked for, and counts as zero; and that of roots.

Where a root is taken of it, digits that the root has lost are lost by what comes of it, and by the polynomial in turn.

CLOSE has to be above the others, or what counts as zero is passed by. Of 400 polynomials of degree 20 any from 1e-8 to
0.1 finds the same; a search takes 25 values at 1e-8, 38 at 1e-4, and 150 at 1e-2. TOUCHING and what a series leaves out
(LEFT_OUT) find the same touches of two formulas from 1e-16 to 1e-6; what stays above zero by less than TOUCHING is told
as a touch too. A body thrown up against drag, norm(v) v, is planned to 1e-9 with OF_ROOTS from 1e-14 to 9e-5; where it
turns at 1e-5 of the largest speed, from 1e-8 on for a third less.
"""
LEFT_OUT = 100.0
"""How much more than its last two terms what a polynomial leaves out may be: a least value below is zero as well.

What passes zero a little above loses nothing by it: a series ends there, and the next one goes on.
"""


@kernel(inline=False)
def leaves_band(z: Buffer, i: int, row: int, n: int, h: float, band: float) -> float:
    """Return about the least t in [0, h] where a polynomial is further from zero than a band, or 2 h."""
    t = 0.0
    while abs(polynomial(z, i, row, n, t)) <= band:
        if t >= h:
            return 2.0 * h
        t = min(max(1.3 * t, 1e-12 * h), h)
    return t


LEAST, MOST_STEPS = 1e-9, 100_000
"""The part of [0, h] that a search goes on by at least, and how often it does."""


@kernel(inline=False)
def first_touch(z: Buffer, i: int, row: int, n: int, start: float, h: float, side: float, near: float) -> float:
    """Return the least t in (start, h] where what has this sign (1, -1) comes to zero and goes back, or 2 h.

    near: the part of its bound that counts as zero.
    """
    size, slope = bound_of(z, i, row, n, h)
    if not slope > 0.0:
        return 2.0 * h
    t, part, bend, side = start, 1e-3 * h, bend_of(z, i, row, n, h) / size, side / size
    for _ in range(MOST_STEPS):
        if t >= h:
            break
        value, slope = side * polynomial(z, i, row, n, t), side * slope_of(z, i, row, n, t)
        if value > CLOSE:
            t += max(away(value - 0.5 * CLOSE, slope, bend), LEAST * h)
            continue
        if slope >= 0.0:  # it does not fall before its slope can have come to zero
            t += max(slope / bend if bend > 0.0 else h, 1e-3 * part)
            continue
        low, high = t, t + part
        if side * slope_of(z, i, row, n, high) < 0.0:
            t = high
            continue
        for _ in range(50):
            middle = 0.5 * (low + high)
            if side * slope_of(z, i, row, n, middle) < 0.0:
                low = middle
            else:
                high = middle
        left_out = last_terms(z, i, row, n, high) / size
        if high <= h and abs(side * polynomial(z, i, row, n, high)) <= max(near, LEFT_OUT * left_out):
            return high
        t += part
    return 2.0 * h


SOON = 10
"""How many steps a search takes by what bends it most in [0, h], which finds simple roots, before it looks closer."""


@kernel(inline=False)
def without_roots(z: Buffer, i: int, row: int, n: int, t: float) -> float:
    """Return how far after t a polynomial that is not zero there has no root, as its derivatives there tell.

    With s = min_k |p / p_k|^(1/k) / 2, where p_k = p^(k)(t) / k!, the terms p_k s^k come to less than (1/2 + 1/4 + ...)
    of p. Beside a root that is n-fold this is its distance over 2 n, where a bound of p'' in [0, h] falls to nothing.
    """
    value, step, chosen = abs(polynomial(z, i, row, n, t)), math.inf, 1.0
    for k in range(1, n + 1):
        chosen *= (n - k + 1) / k  # of n things k, and in turn of j things
        binomial, term = chosen, chosen * z[i + n * row]
        for j in range(n - 1, k - 1, -1):
            binomial *= (j + 1 - k) / (j + 1)
            term = term * t + binomial * z[i + j * row]
        if 0.0 < abs(term) < math.inf and value / abs(term) < math.inf:
            step = min(step, exponential(logarithm(value / abs(term)) / k))
    return 0.5 * step


@kernel(inline=False)
def first_root(z: Buffer, i: int, row: int, n: int, start: float, h: float, noise: float) -> float:
    """Return the least t in (start, h] where the polynomial z[i], z[i + row], ... of degree n is zero, or 2 h.

    noise: the part of its terms that counts as zero beside a multiple root, where it ends before the root, by what the
    series leaves out as well.

    It goes on by what the largest second derivative in [0, h] takes to come to zero, so that no root is passed over but
    two that are nearer to each other than 1e-9 h. Where the sign changes, 64 halvings find the last bit of t.
    """
    size, slope = bound_of(z, i, row, n, h)
    if not slope > 0.0:
        return 2.0 * h
    t, bend = start, bend_of(z, i, row, n, h) / size
    value = polynomial(z, i, row, n, t)
    for k in range(MOST_STEPS):
        if t >= h:
            return 2.0 * h
        side = (1.0 if value > 0.0 else -1.0) / size
        step = away(side * value, side * slope_of(z, i, row, n, t), bend)
        if k >= SOON:
            if noise > 0.0 and abs(value) <= noise * bound_of(z, i, row, n, t)[0] + LEFT_OUT * last_terms(
                z, i, row, n, t
            ):
                return t
            step = max(step, without_roots(z, i, row, n, t))
        after = min(t + max(step, LEAST * h), h)
        there = polynomial(z, i, row, n, after)
        if there == 0.0 or (there > 0.0) != (value > 0.0):
            break
        t, value = after, there
    low, high = t, after
    for _ in range(64):
        middle = 0.5 * (low + high)
        if (polynomial(z, i, row, n, middle) > 0.0) == (value > 0.0):
            low = middle
        else:
            high = middle
    return high


CORNER_NOISE = 4e-15
"""The part of its terms that is round-off of a polynomial: it moves the zero of (t - 1)^3 by 2e-5 of its reach.

A series that ends before its corner leaves it to the next one; one that ends beyond has passed it on the old side.
"""


@kernel
def first_root_after(z: Buffer, i: int, row: int, n: int, first: int, h: float) -> float:
    """Return the least root in (0, h], or 2 h; coefficients before `first` count as zero.

    A root at 0 is left out however many there are: of t^3, which begins at a corner, 64 halvings find one at 1e-28.
    """
    while first < n and z[i + first * row] == 0.0:
        first += 1
    return first_root(z, i + first * row, row, n - first, 0.0, h, CORNER_NOISE)
