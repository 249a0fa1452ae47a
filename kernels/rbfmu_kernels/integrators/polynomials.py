"""Polynomials in a buffer: values, first roots and least values near zero, where series end at corners."""

from ..compile.decorator import kernel
from ..types import Buffer


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
def begins_at_zero(z: Buffer, i: int, row: int, n: int) -> bool:
    """Return whether a polynomial is zero at 0, but not everywhere."""
    size = 0.0
    for k in range(1, n + 1):
        size += abs(z[i + k * row])
    return bool(z[i] == 0.0 and size > 0.0)


CLOSE, TOUCHING = 1e-4, 1e-10
"""The parts of its bound below which a polynomial's least value is looked for, and counts as zero."""


@kernel(inline=False)
def first_touch(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return the least t in (0, h] where what is not negative comes down to zero and rises again, or 2 h."""
    size, slope = bound_of(z, i, row, n, h)
    if not slope > 0.0:
        return 2.0 * h
    t, part = 0.0, 1e-3 * h
    for _ in range(100_000):
        if t >= h:
            break
        value = polynomial(z, i, row, n, t)
        if value > CLOSE * size or slope_of(z, i, row, n, t) >= 0.0:
            t += max((value - 0.5 * CLOSE * size) / slope, part * 1e-3)
            continue
        after = t + part
        if slope_of(z, i, row, n, after) < 0.0:
            t = after
            continue
        low, high = t, after
        for _ in range(50):
            middle = 0.5 * (low + high)
            if slope_of(z, i, row, n, middle) < 0.0:
                low = middle
            else:
                high = middle
        if high <= h and abs(polynomial(z, i, row, n, high)) <= TOUCHING * size:
            return high
        t = after
    return 2.0 * h


@kernel(inline=False)
def first_root(z: Buffer, i: int, row: int, n: int, h: float) -> float:
    """Return the least t in (0, h] where the polynomial z[i], z[i + row], ... of degree n is zero, or 2 h.

    It goes on by what the largest slope in [0, h] takes to come to zero, so that no root is passed over but two that
    are nearer to each other than 1e-9 h.
    """
    _, slope = bound_of(z, i, row, n, h)
    if not slope > 0.0:
        return 2.0 * h
    t, least = 0.0, 1e-9 * h
    value = polynomial(z, i, row, n, t)
    for _ in range(100_000):
        if t >= h:
            return 2.0 * h
        after = min(t + max(abs(value) / slope, least), h)
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
