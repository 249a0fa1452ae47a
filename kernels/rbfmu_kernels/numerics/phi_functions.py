"""The functions by which a damped rate dies away: no exponential of libm, nothing cancels at weak damping."""

from ..compile.decorator import kernel

_SETTLED = 64.0  # exp(-64) is nothing beside 1
_SERIES = tuple(float(n) for n in range(15, 2, -1))


@kernel
def relaxation(x: float) -> tuple[float, float]:
    """Return ((1 - exp(-x)) / x, (exp(-x) - 1 + x) / x^2), which are 1 and 1/2 at x = 0.

    x >= 0.  Relative error <= 4 eps.  Series below 1/2, then doublings of x, whose terms are all positive.
    """
    if x > _SETTLED:
        first = 1.0 / x
        return first, (1.0 - first) * first
    y, doublings = x, 0
    while y > 0.5:
        y *= 0.5
        doublings += 1
    total = 1.0
    for n in _SERIES:
        total = 1.0 - total * y / n
    second = 0.5 * total
    first = 1.0 - y * second
    for _ in range(doublings):
        second = 0.5 * second + 0.25 * first * first
        first = first * (1.0 - 0.5 * y * first)
        y *= 2.0
    return first, second


@kernel
def relaxed(rate: float, drive: float, damping_rate: float, t: float) -> tuple[float, float]:
    """Return (angle turned, rate) after the time t, where rate' = drive - damping_rate rate, damping_rate >= 0."""
    first, second = relaxation(damping_rate * t)
    gained = drive * t
    return (rate * first + gained * second) * t, rate + (gained - damping_rate * rate * t) * first
