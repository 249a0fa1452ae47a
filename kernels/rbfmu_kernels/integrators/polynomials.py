"""Polynomials in a buffer: their values, first zeros and double zeros, at which series of formulas end."""

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
    """Return upper bounds of the absolute values of the polynomial and of its derivative in [0, h]."""
    size, slope, power = abs(z[i]), 0.0, 1.0
    for k in range(1, n + 1):
        slope += k * abs(z[i + k * row]) * power
        power *= h
        size += abs(z[i + k * row]) * power
    return size, slope


@kernel
def bend_of(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return an upper bound of the absolute value of the polynomial's second derivative in [0, h]."""
    bend, power = 0.0, 1.0
    for k in range(2, n + 1):
        bend += k * (k - 1) * abs(z[i + k * row]) * power
        power *= h
    return bend


@kernel
def away(value: float, slope: float, bend: float) -> float:
    """Return a distance over which a function with this value > 0 and slope stays positive.

    bend: a bound of its second derivative. The distance d is the positive zero of value + slope d - bend d^2 / 2,
    computed without cancellation. Near a simple zero this is Newton's step; near a double zero steps shrink with the
    distance.
    """
    root = math.sqrt(slope * slope + 2.0 * bend * value)
    if slope >= 0.0:
        return (slope + root) / bend if bend > 0.0 else math.inf
    return 2.0 * value / (root - slope)


ROUGHLY = 1e-4
"""The truncation error of a corner's polynomial, over its size, up to which it is searched, so that no zero is missed.

It limits how far the search goes, not how accurately a corner is found: its time is bisected to the last bit.
"""


NOTHING = 1e-290
"""Numbers below this are too near the end of the range of doubles for their terms to estimate an error."""


@kernel(inline=False)
def known_until(z: Buffer, i: int, row: int, n: int, h: float, part: float) -> float:
    """Return the longest step, at most h, over which the truncation error of degree n is at most this part of the size.

    Where the last coefficients overflow, as beside the zero of a square root, it is the time at which the first two
    terms may cancel.
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
    """Return the sum of the absolute values of the last two terms at t."""
    return power_of(t, n - 1) * (abs(z[i + (n - 1) * row]) + abs(z[i + n * row]) * t)


@kernel
def begins_at_zero(z: Buffer, i: int, row: int, n: int) -> bool:
    """Return whether a polynomial is zero at its beginning, but not everywhere."""
    size = 0.0
    for k in range(1, n + 1):
        size += abs(z[i + k * row])
    return bool(z[i] == 0.0 and size > 0.0)


AT_CORNER = 1e-13
"""The value of a polynomial, relative to its terms, below which it counts as zero at a series' end: at its corner."""


@kernel
def side_from(z: Buffer, i: int, row: int, first: int, n: int) -> float:
    """Return the sign of the first coefficient that is not zero, from the one of degree `first` on; 0 if all are."""
    for k in range(first, n + 1):
        if z[i + k * row] != 0.0:
            return math.copysign(1.0, z[i + k * row])
    return 0.0


CLOSE, TOUCHING, OF_ROOTS = 1e-4, 1e-10, 1e-7
"""Parts of a polynomial's bound: below CLOSE its minimum is searched for; below TOUCHING a minimum counts as a double
zero; below OF_ROOTS one does whose square root or power is taken.

The last is larger, as a square root loses half of its argument's digits, and the motion that it drives loses them too.
CLOSE must be above the others, or the search passes by what counts as zero. For 400 polynomials of degree 20 every
value from 1e-8 to 0.1 finds the same; a search takes 25 evaluations at 1e-8, 38 at 1e-4 and 150 at 1e-2. With TOUCHING
from 1e-16 to 1e-6, and with LEFT_OUT, the same double zeros of two formulas are found; a minimum above zero by less
than TOUCHING counts as one too. A body thrown up against drag, norm(v) v, is planned to 1e-9 with OF_ROOTS from 1e-14
to 9e-5; where it turns at 1e-5 of its largest speed, values from 1e-8 on make the plan a third cheaper.
"""
LEFT_OUT = 100.0
"""The truncation error over the last two terms, at most: a minimum that is smaller counts as a double zero as well.

A minimum that is really a little above zero loses nothing by it: the series ends there, and the next one goes on.
"""


@kernel(inline=False)
def leaves_band(z: Buffer, i: int, row: int, n: int, h: float, band: float) -> float:
    """Return roughly the first t in [0, h] at which the absolute value of a polynomial exceeds `band`, or 2 h."""
    t = 0.0
    while abs(polynomial(z, i, row, n, t)) <= band:
        if t >= h:
            return 2.0 * h
        t = min(max(1.3 * t, 1e-12 * h), h)
    return t


LEAST, MOST_STEPS = 1e-9, 100_000
"""The shortest step of a search, as a part of [0, h], and the largest number of steps."""


@kernel(inline=False)
def first_touch(z: Buffer, i: int, row: int, n: int, start: float, h: float, side: float, near: float) -> float:
    """Return the first double zero in (start, h], or 2 h: where a polynomial of this sign (1, -1) touches zero.

    near: the part of the polynomial's bound in [0, h] below which its minimum counts as zero.
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
        if slope >= 0.0:  # it cannot fall before its slope has reached zero
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
"""The steps of a search by the bound of p'' in [0, h], enough for simple zeros, before it uses all derivatives."""


@kernel(inline=False)
def without_roots(z: Buffer, i: int, row: int, n: int, t: float) -> float:
    """Return a step after t over which a polynomial p, not zero at t, has no zero, from all its derivatives at t.

    With s = min_k |p / p_k|^(1/k) / 2, where p_k = p^(k)(t) / k!, the terms p_k s^k add up to less than |p| (1/2 + 1/4
    + ...). Near an n-fold zero s is its distance over 2 n, while a step by the bound of p'' in [0, h] would shrink to
    nothing.
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
    """Return the first zero in (start, h] of the polynomial z[i], z[i + row], ... of degree n, or 2 h.

    noise: near a multiple zero, values below this part of the sum of terms, and below the truncation error, count as
    zero; the search then ends before the true zero. 0: never.

    Each step is one over which the polynomial cannot reach zero, by its value, its slope and a bound of its second
    derivative: only two zeros closer together than 1e-9 h can be missed. 64 bisections find t to the last bit.
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
"""The round-off of a polynomial, over the sum of its terms' sizes: it moves the zero of (t - 1)^3 by 2e-5 of its reach.

So the search ends early: the next series finds the corner from nearer by, while one that ended beyond the corner would
have passed it on the wrong side.
"""


@kernel
def first_root_after(z: Buffer, i: int, row: int, n: int, first: int, h: float) -> float:
    """Return the first zero in (0, h], or 2 h; coefficients before `first` count as zero.

    Zeros at 0 are divided out, whatever their multiplicity: else the bisection for t^3 would find one at 1e-28.
    """
    while first < n and z[i + first * row] == 0.0:
        first += 1
    return first_root(z, i + first * row, row, n - first, 0.0, h, CORNER_NOISE)
