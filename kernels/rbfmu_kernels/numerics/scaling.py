"""Powers of two that bring a number into range, and rounding to integers: exact, portable, no libm."""

import math

from ..compile.decorator import kernel
from ..compile.wide import choose

_STEPS = (2.0**512, 2.0**256, 2.0**128, 2.0**64)


@kernel
def power_of_two_for(x: float) -> float:
    """Return a power of two with 2^-64 <= |power x| < 2^64.

    It is 2^-114 for the least subnormal numbers, and 1 for 0 and NaN.
    """
    size, power = abs(x), 1.0
    for step in _STEPS:
        inverse = 1.0 / step
        change = choose(size >= step, inverse, 1.0)
        size, power = size * change, power * change
        change = choose((size > 0.0) & (size < inverse), step, 1.0)
        size, power = size * change, power * change
    return power


@kernel
def round_to_integer(x: float) -> float:
    """Return the nearest integer (ties to even)."""
    shift = math.copysign(4503599627370496.0, x)  # 2^52
    return choose(abs(x) < 4503599627370496.0, (x + shift) - shift, x)
