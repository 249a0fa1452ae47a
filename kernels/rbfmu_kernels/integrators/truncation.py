"""What a series that ends leaves out, by its last two terms: A. Jorba & M. Zou, Experimental Mathematics 14 (2005)."""

import math
from typing import Any

from ..buffer_access import vec3_at
from ..compile.decorator import kernel
from ..compile.wide import any_of, choose
from ..rotations.vec3 import add, dot, largest_component, scale
from ..types import Vec3
from .rigid_body_state import RATE_ONLY
from .taylor_coefficients import FORCE, RATE, TORQUE, term


@kernel
def power_of(x: float, n: int) -> float:
    """Return x^n."""
    total = 1.0
    while n > 0:
        total = total * x if n & 1 == 1 else total
        x, n = x * x, n >> 1
    return total


@kernel
def last_terms(s: Any, u: int, order: int, h: float) -> float:
    """Return the larger of the last two terms of the series at u, per h^(order - 1)."""
    last, before = vec3_at(s, term(u, order)), vec3_at(s, term(u, order - 1))
    return max(largest_component(before), h * largest_component(last))


@kernel
def size_of(v: Vec3) -> float:
    """Return the sum of the components' sizes."""
    return abs(v[0]) + abs(v[1]) + abs(v[2])


@kernel(inline=False)
def truncation(
    s: Any, order: int, h: float, alpha_fixed: float, kept: float, n: int, span: float
) -> tuple[float, float]:
    """Return for a step of h the last two terms relative to the rate, and the square of the largest rate.

    alpha_fixed: the angular acceleration by loads that turn in b, whose last terms count as they act for `kept` steps.
    span: how long an error of the rate goes on to turn the body, s; see `body.memory.SETTINGS`.
    """
    square, power = 0.0, 1.0
    at_end = (0.0, 0.0, 0.0)
    for k in range(4):
        part = scale(power, vec3_at(s, term(RATE, k)))
        at_end = add(at_end, part)
        square = max(square, max(dot(part, part), dot(at_end, at_end)))
        power *= h
    power = power_of(h, order - 1)
    last = last_terms(s, RATE, order, h) * power
    rate = math.sqrt(square)
    turned, slow = last * span, choose(rate > 0.0, rate, 1.0)
    last = choose(rate > 0.0, last / slow, 0.0)
    if n == RATE_ONLY:
        return last, square
    last = max(last, turned)
    if any_of(alpha_fixed > 0.0):
        off = _relative_end(s, FORCE, order, h, power) + _relative_end(s, TORQUE, order, h, power)
        span = kept * h
        acting = off * alpha_fixed * span * max(0.5 * span, choose(rate > 0.0, 1.0 / slow, math.inf))
        last = choose(off > 0.0, max(last, acting), last)
    return last, square


@kernel
def _relative_end(s: Any, u: int, order: int, h: float, power: float) -> float:
    """Return the last two terms of a load's series relative to the load."""
    size = size_of(vec3_at(s, u))
    return choose(size > 0.0, last_terms(s, u, order, h) * power / choose(size > 0.0, size, 1.0), 0.0)
