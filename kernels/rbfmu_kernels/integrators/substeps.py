"""How a communication step is divided into substeps. Their size is kept in a buffer, and next to it their count."""

import math
from typing import NamedTuple

from ..buffer import MAX_SUBSTEPS
from ..buffer_access import vec3_at
from ..compile.decorator import kernel
from ..compile.wide import any_of, choose
from ..mechanics.equations_of_motion import RATE_ONLY
from ..rotations.vec3 import ZERO, add, dot, largest_component, scale
from ..types import Buffer, Vec3
from .taylor_coefficients import FORCE, RATE, TORQUE, term

ROUND_OFF = 2.0**-52
LONGEST_STEP = 1e30
"""s: the step size of a body at rest without loads."""


class Method(NamedTuple):
    """What is integrated, and how accurately: n, how much of a state (`equations_of_motion`); order, of the series.

    tolerance: the largest estimated error of a substep; or, where span is not 0, of all substeps of a run of `span` s
    together, where an error of the rate counts as the angle that it turns the body by in that time; see
    `body.memory.SETTINGS`.
    """

    n: int
    order: int
    tolerance: float
    span: float


class Room(NamedTuple):
    """The places in a buffer of the state, of the work space, and of the step size, beside which is the count."""

    state: int
    work: int
    size: int


@kernel
def substeps_in(h: float, longest: float) -> int:
    """Return the least number of equal parts of h, each at most `longest`; 0 if that is too many, or not a number.

    Parts may be longer by 1e-9 of themselves, so that round-off in the importer's clock does not add one.
    """
    if not h < MAX_SUBSTEPS * longest:
        return 0
    return parts_in(h, longest)


@kernel
def parts_in(h: float, longest: float) -> int:
    """Return the number that `substeps_in` does, without its check."""
    return max(math.ceil(h / longest * (1.0 - 1e-9)), 1)


@kernel
def tolerance_of_substep(tolerance: float, span: float, part: float) -> float:
    """Return the allowed error of a substep `part`: its share of the tolerance of `span` s, or all of it if span is 0.

    At worst errors of substeps add up, so that shares in proportion to time keep the run's error (error per unit step).
    No share is below 2^-52: a substep in double precision loses about that, and shorter ones would only be more.
    """
    return tolerance if span == 0.0 else max(tolerance * part / span, ROUND_OFF)


@kernel
def nearer_size(h: float, order: int, excess: float) -> float:
    """Return the step whose error is that of h over `excess`: about h excess^(-1 / order), but without a power.

    The Pade approximant of the power agrees with it to second order near 1, where step sizes settle. Far from there,
    where it flattens, a step changes by a factor of about 2 at most, as an estimate from so far away is inaccurate.
    """
    near = h * ((order + 1.0) + (order - 1.0) * excess) / ((order - 1.0) + (order + 1.0) * excess)
    near = choose(excess < 1e-4, choose(excess < 1e-8, 2.0 * h, 1.3 * h), near)
    return choose(excess < 1e4, near, 0.5 * h)


@kernel
def count_substep(z: Buffer, size: int) -> None:
    """Add one to the count that is kept next to the step size at z[size]."""
    z[size + 1] += 1.0


@kernel
def power_of(x: float, n: int) -> float:
    """Return x^n."""
    total = 1.0
    while n > 0:
        total = total * x if n & 1 == 1 else total
        x, n = x * x, n >> 1
    return total


@kernel
def last_terms(s: Buffer, u: int, order: int, h: float) -> float:
    """Return the larger of the last two terms of the series at u, over h^(order - 1)."""
    last, before = vec3_at(s, term(u, order)), vec3_at(s, term(u, order - 1))
    return max(largest_component(before), h * largest_component(last))


@kernel
def size_of(v: Vec3) -> float:
    """Return the sum of the components' absolute values."""
    return abs(v[0]) + abs(v[1]) + abs(v[2])


@kernel(inline=False)
def truncation(s: Buffer, method: Method, h: float, alpha_fixed: float, steps: float) -> tuple[float, float]:
    """Return the last two terms of a step h relative to the rate, and the square of the largest rate.

    The truncation error of a series is about its last term; two are used, as every other one may vanish by symmetry
    (A. Jorba & M. Zou, Experimental Mathematics 14, 2005).
    alpha_fixed: the angular acceleration by loads that turn in b, whose last terms count for the `steps` that they act.
    """
    n, order, _, span = method
    square, power = 0.0, 1.0
    at_end = ZERO
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
        lasting = steps * h
        acting = off * alpha_fixed * lasting * max(0.5 * lasting, choose(rate > 0.0, 1.0 / slow, math.inf))
        last = choose(off > 0.0, max(last, acting), last)
    return last, square


@kernel
def _relative_end(s: Buffer, u: int, order: int, h: float, power: float) -> float:
    """Return the last two terms of a load's series relative to the load."""
    size = size_of(vec3_at(s, u))
    return choose(size > 0.0, last_terms(s, u, order, h) * power / choose(size > 0.0, size, 1.0), 0.0)
