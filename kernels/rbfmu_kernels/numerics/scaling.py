"""Powers of two that bring a number into range, and rounding to integers: exact, portable, no libm."""

import math

from ..compile.decorator import kernel

_STEPS = (2.0**512, 2.0**256, 2.0**128, 2.0**64)


@kernel
def power_of_two_for(x: float) -> float:
    """Return a power of two with 2^-64 <= |power x| < 2^64.

    It is 2^-114 for the least subnormal numbers, and 1 for 0 and NaN.
    """
    size, power = abs(x), 1.0
    for step in _STEPS:
        inverse = 1.0 / step
        if size >= step:
            size *= inverse
            power *= inverse
        if 0.0 < size < inverse:
            size *= step
            power *= step
    return power


@kernel
def round_to_integer(x: float) -> float:
    """Return the nearest integer (ties to even)."""
    shift = math.copysign(4503599627370496.0, x)  # 2^52
    return (x + shift) - shift if abs(x) < 4503599627370496.0 else x
