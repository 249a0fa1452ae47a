"""The steps of a motion by Taylor series in double-double arithmetic, by which plans are judged.

A step evaluates a list of operations once for each order, so that one compiled function is enough for all scenes. The
step size follows from the last two terms: A. Jorba & M. Zou, Experimental Mathematics 14 (2005). The recurrences are
those of `rbfmu.formulas.program`. Each number has its coefficients side by side in the work space, high parts in s[0],
low ones in s[1]. `rbfmu.planning.reference` takes step after step, and calls the functions for corners only where there
are any, as compiling them takes seconds.
"""

import math
from typing import NamedTuple

from ..compile.decorator import kernel
from ..numerics import double_double as dd
from ..types import Array, Indices
from . import formula_ends as ends, polynomials
from .formula_operations import ROOTS, SIDE, SQRT, STATE, coefficient_of, value_of

ORDER, TOLERANCE, BEYOND, AT_REST = 26, 1e-22, 1e-9, 1e-10
"""The order of series and the error of a step relative to sizes, far below the round-off of doubles. The order of least
work is 1 - ln(1e-22) / 2 there (Jorba & Zou 2005, 3.2). As parts of a series' reach: how far it goes on beyond a double
zero, and how far it goes where the argument of a square root begins at zero."""
LENGTH = ORDER + 1
CORNER_KNOWN, NEAR = 1e-17, 1e-9
"""The truncation error of a corner's number over its size, at most; and the part of the time to a corner by which
doubles may miss it."""
LARGEST, LIFT = 1e290, 2.0**60
"""The largest coefficients: beyond them products of double-double numbers overflow. And the factor of both sides of an
error's comparison, as TOLERANCE times a number that begins with e^-700 would be zero.
"""
MOST_DEFECT = 1e-11
"""The defect, evaluated in doubles, from which on a series is halved."""
FINER = 0.01
"""Beside a corner a root counts as zero over this part of the time for which plans take it as zero, so that their error
by this shows. A corner is found to an ulp of the last series' reach.
"""


class Equations(NamedTuple):
    """The equations as tables; operations are named by their rows.

    operations (n, 5): kind, three arguments (the third of a square root or power: whether it counts as zero), and
    whether it changes. states (m, 3): its operation, that of its rate, and its group. least: for each group the least
    size to which its errors are relative, negative if they are never relative to a larger one. sides (n, 3): operation,
    and how many series in a row began, and will have begun, at its corner. touching (n, 3): an argument that may come
    to zero, the root or angle of it, and whether it was zero where the last series ended at a corner. rising: arguments
    of exponentials. wanted: operations that are shown. time: the operation that is the time, or -1.
    """

    operations: Indices
    states: Indices
    least: Array
    sides: Array
    touching: Indices
    rising: Indices
    wanted: Indices
    time: int


@kernel(inline=False)
def evaluate(operations: Indices, s: Array, stride: int, with_sides: bool) -> None:
    """Set the values of all operations but numbers and leaves, which are given; stride: from one operation to the next.

    with_sides: whether sides are set as well.
    """
    for n in range(operations.shape[0]):
        kind, a, b, c = operations[n, 0], operations[n, 1], operations[n, 2], operations[n, 3]
        if kind in ROOTS and c != 0 and stride == LENGTH:
            dd.put(s, n * stride, (0.0 if kind == SQRT or s[0, b * stride] > 0.0 else math.inf, 0.0))
        elif kind > STATE and (with_sides or kind != SIDE):
            dd.put(s, n * stride, value_of(kind, n * stride, a * stride, b * stride, c * stride, s))


@kernel(inline=False)
def expand(equations: Equations, s: Array, unit: float) -> None:
    """Set the coefficients of all operations from the states' first; unit: that of time, s, a power of two."""
    operations, states = equations.operations, equations.states
    evaluate(operations, s, LENGTH, False)
    for k in range(ORDER):
        for n in range(operations.shape[0] if k > 0 else 0):
            kind, a, b, c = operations[n, 0], operations[n, 1], operations[n, 2], operations[n, 3]
            if kind > STATE and kind != SIDE and operations[n, 4] != 0:
                found = coefficient_of(kind, n * LENGTH, a * LENGTH, b * LENGTH, c * LENGTH, s, k)
                dd.put(s, n * LENGTH + k, found)
        for m in range(states.shape[0]):
            rate = dd.divide(dd.at(s, states[m, 1] * LENGTH + k), (k + 1.0, 0.0))
            dd.put(s, states[m, 0] * LENGTH + k + 1, dd.scale(unit, rate))


@kernel(inline=False)
def longest_step(equations: Equations, sizes: Array, s: Array) -> float:
    """Return the step, in units of time, whose last two terms are within the tolerance; NaN where one is not finite.

    sizes: the largest that each group of states has been.
    """
    states, least = equations.states, equations.least
    longest = math.inf
    for g in range(least.shape[0]):
        slope, bend, before, last = 0.0, 0.0, 0.0, 0.0
        for m in range(states.shape[0]):
            if states[m, 2] == g:
                i = states[m, 0] * LENGTH
                for k in range(LENGTH):
                    if not abs(s[0, i + k]) + abs(s[1, i + k]) < LARGEST:
                        return math.nan
                sizes[g] = max(sizes[g], abs(s[0, i]))
                slope, bend = max(slope, abs(s[0, i + 1])), max(bend, abs(s[0, i + 2]))
                before, last = max(before, abs(s[0, i + ORDER - 1])), max(last, abs(s[0, i + ORDER]))
        size, first, lead = max(abs(least[g]), sizes[g] if least[g] >= 0.0 else 0.0), 0, 0.0
        while size == 0.0 and lead == 0.0 and first < ORDER - 2:
            first += 1
            for m in range(states.shape[0]):
                lead = max(lead, abs(s[0, states[m, 0] * LENGTH + first]) if states[m, 2] == g else 0.0)
        for k, term in ((ORDER - 1, LIFT * before), (ORDER, LIFT * last)):
            if term > 0.0:
                reach = (LIFT * TOLERANCE * size / term) ** (1.0 / k)
                if least[g] >= 0.0:  # a state that begins at zero is soon as large as its first terms make it
                    reach = max(reach, (LIFT * TOLERANCE * slope / term) ** (1.0 / (k - 1)))
                    reach = max(reach, (LIFT * TOLERANCE * bend / term) ** (1.0 / (k - 2)))
                    reach = max(reach, (LIFT * TOLERANCE * lead / term) ** (1.0 / (k - first)))
                longest = min(longest, reach)
    return longest


@kernel(inline=False)
def rest_roots(equations: Equations, s: Array, done: float) -> bool:
    """Set square roots and powers to zero as `formula_ends.rest_roots` does, within FINER of the round-off of done."""
    operations, sides, touching = equations.operations, equations.sides, equations.touching
    corner, changed = False, False
    for i in range(sides.shape[0]):
        corner |= ends.at_zero(s[0], operations[int(sides[i, 0]), 1] * LENGTH, 1, FINER * done)
    for m in range(touching.shape[0]):
        n, at = touching[m, 1], touching[m, 0] * LENGTH
        rests = ends.has_no_root(s[0], at, 1, corner, touching[m, 2] != 0, FINER * done)
        if rests and operations[n, 0] in ROOTS and operations[n, 3] == 0:
            operations[n, 3], changed = 1, True
    return changed


@kernel(inline=False)
def turn_side(equations: Equations, s: Array, done: float) -> int:
    """Change the first side that does not agree with the series, and return which it is; -1 where all agree.

    done: the time since the start, in units.
    """
    operations, sides = equations.operations, equations.sides
    for i in range(sides.shape[0]):
        n = int(sides[i, 0])
        at = operations[n, 1] * LENGTH
        sides[i, 1] = ends.begins_again(s[0], at, 1, sides[i, 1], done)
        side = ends.side_after(s[0], at, 1, ORDER, sides[i, 1], done)
        side = 1.0 if side == 0.0 and (sides[i, 2] == 0.0 or s[0, n * LENGTH] == 0.0) else side
        if side != 0.0 and side != s[0, n * LENGTH]:
            s[0, n * LENGTH], sides[i, 2] = side, 1.0  # until `to_corner`: that it has changed already
            return i
    return -1


@kernel(inline=False)
def to_corner(equations: Equations, s: Array, longest: float, done: float) -> dd.DoubleDouble:
    """Return how far the series reach, at most `longest`, and note which numbers are at a corner there; done: time so
    far.

    The time of a corner is a double-double number, as a pulse may be as short as the round-off of a double.
    """
    operations, sides, touching, corner = equations.operations, equations.sides, equations.touching, -1
    at_corner = False
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        longest = polynomials.known_until(s[0], at, 1, ORDER, longest, polynomials.ROUGHLY)
        longest = ends.around_corner(s[0], at, 1, sides[i, 1], longest)
    for m in range(touching.shape[0]):
        for of in range(2):
            longest = polynomials.known_until(s[0], touching[m, of] * LENGTH, 1, ORDER, longest, polynomials.ROUGHLY)
    for i in equations.rising:
        longest = ends.risen_at(s[0], i * LENGTH, 1, ORDER, longest)
    reach = longest
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        root = polynomials.first_root_after(s[0], at, 1, ORDER, 1 if sides[i, 1] > 0.0 else 0, longest)
        if root < reach:
            reach, corner = root, at
    for m in range(touching.shape[0]):
        at = touching[m, 0] * LENGTH
        if operations[touching[m, 1], 0] in ROOTS and operations[touching[m, 1], 3] != 0:
            reach, corner = min(reach, ends.SOON_AFTER * FINER * done), -1
        elif polynomials.begins_at_zero(s[0], at, 1, ORDER):
            reach, corner = min(reach, AT_REST * longest), -1
        else:
            touch = polynomials.first_touch(s[0], at, 1, ORDER, 0.0, longest, 1.0, polynomials.OF_ROOTS)
            if touch < longest and touch + BEYOND * longest < reach:
                reach, corner = touch + BEYOND * longest, at
    root = reach
    if corner >= 0:
        reach = polynomials.known_until(s[0], corner, 1, ORDER, reach, CORNER_KNOWN)
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        ends_there = reach < longest and ends.ends_at_corner(s[0], at, 1, ORDER, sides[i, 1], reach, longest)
        sides[i, 2] = 1.0 - min(sides[i, 1], 0.0) if ends_there else 0.0
        at_corner = at_corner or ends_there
    for m in range(touching.shape[0]):
        is_zero = at_corner and ends.is_zero_at_end(s[0], touching[m, 0] * LENGTH, 1, ORDER, reach, longest)
        touching[m, 2] = 1 if is_zero else 0
    rest = _rest_of_root(s, corner, reach) if at_corner and corner >= 0 and reach == root else 0.0
    return dd.quick_two_sum(reach, rest)


@kernel(inline=False)
def _rest_of_root(s: Array, i: int, t: float) -> float:
    """Return the zero of a series minus t, a time close to it, by a step of Newton's method; 0 if t is not close."""
    value, slope = _value(s, i, (t, 0.0))[0], polynomials.slope_of(s[0], i, 1, ORDER, t)
    return -value / slope if abs(value) < NEAR * abs(slope * t) else 0.0


@kernel(inline=False)
def _value(s: Array, i: int, t: dd.DoubleDouble) -> dd.DoubleDouble:
    """Return the value of the series that begins at s[:, i]."""
    total = dd.at(s, i + ORDER)
    for k in range(ORDER - 1, -1, -1):
        total = dd.add(dd.multiply(t, total), dd.at(s, i + k))
    return total


@kernel(inline=False)
def _put_states(states: Indices, s: Array, at: dd.DoubleDouble, found: Array) -> None:
    """Set the states to their series at a time after the beginning, each in its operation's place."""
    for m in range(states.shape[0]):
        dd.put(found, states[m, 0], _value(s, states[m, 0] * LENGTH, at))


@kernel(inline=False)
def _defect(equations: Equations, sizes: Array, s: Array, unit: float, t: float, here: Array) -> float:
    """Return the largest relative error of a state by the defect at t: rates evaluated there minus the series' slopes.

    inf if a number with a corner is in error by more than ROUGHLY. See `models.formula_errors`.
    """
    operations, states, sides, least = equations.operations, equations.states, equations.sides, equations.least
    worst = 0.0
    _put_states(states, s, (t, 0.0), here)
    for i in range(sides.shape[0]):
        here[0, int(sides[i, 0])] = s[0, int(sides[i, 0]) * LENGTH]
    evaluate(operations, here, 1, False)
    for m in range(states.shape[0]):
        g = states[m, 2]
        slope = polynomials.slope_of(s[0], states[m, 0] * LENGTH, 1, ORDER, t)
        begun = max(abs(s[0, states[m, 0] * LENGTH + 1]) * t, abs(s[0, states[m, 0] * LENGTH + 2]) * t * t)
        size = max(abs(least[g]), max(sizes[g], begun) if least[g] >= 0.0 else 0.0)
        size = polynomials.bound_of(s[0], states[m, 0] * LENGTH, 1, ORDER, t)[0] if size == 0.0 else size
        error = abs(unit * here[0, states[m, 1]] - slope) * t
        if error > (0.0 if size > 0.0 else polynomials.NOTHING) or math.isnan(error):  # sizes may begin with e^-700
            worst = max(worst, error / size) if error < math.inf and size > 0.0 else math.inf
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1]
        error = abs(here[0, at] - polynomials.polynomial(s[0], at * LENGTH, 1, ORDER, t))
        known = polynomials.ROUGHLY * polynomials.bound_of(s[0], at * LENGTH, 1, ORDER, t)[0]
        if error > max(known, polynomials.NOTHING):
            worst = math.inf
    return worst


@kernel(inline=False)
def first_fault(equations: Equations, sizes: Array, s: Array, unit: float, t: float, here: Array, parts: int) -> float:
    """Return the first end of one of `parts` equal parts of [0, t] at which the defect is too large, or 0."""
    for k in range(1, parts + 1):
        at = t * k / parts
        if at > 0.0 and not _defect(equations, sizes, s, unit, at, here) <= MOST_DEFECT:
            return at
    return 0.0


@kernel(inline=False)
def _evaluate_at_row(operations: Indices, time: int, here: Array) -> None:
    """Set the values of all operations for a row of outputs.

    Conditions see the row's time rounded to a double, as a reader does: five times 0.1 s is not more than 0.5.
    """
    exact = here[1, time] if time >= 0 else 0.0
    if exact != 0.0:
        here[1, time] = 0.0
    evaluate(operations, here, 1, True)
    if exact != 0.0:
        here[1, time] = exact
        evaluate(operations, here, 1, False)


@kernel(inline=False)
def put_rows(
    equations: Equations, s: Array, unit: float, reach: float, now: dd.DoubleDouble, times: Array, here: Array,
    rows: Array, k: int,
) -> int:  # fmt: skip
    """Set the rows of outputs, from the k-th on, that the series from `now` reach; return the first that they do not.

    The time is the sum of the steps and not its series' value, whose round-off would decide the sign of a time near
    zero. The start is a double, so that the difference by which it is found is rounded.
    """
    states, wanted, time, start = equations.states, equations.wanted, equations.time, 0.0
    if time >= 0:
        start = dd.subtract(dd.at(s, time * LENGTH), now)[0]
    while k < times.shape[1]:
        at = dd.scale(1.0 / unit, dd.subtract(dd.at(times, k), now))
        if at[0] > reach:
            break
        _put_states(states, s, at, here)
        if time >= 0:
            dd.put(here, time, dd.add_float(dd.at(times, k), start))
        _evaluate_at_row(equations.operations, time, here)
        for m in range(wanted.shape[0]):
            rows[k, m] = here[0, wanted[m]]
        k += 1
    return k


@kernel(inline=False)
def begin_at(
    states: Indices, s: Array, unit: float, reach: dd.DoubleDouble, now: dd.DoubleDouble, here: Array
) -> dd.DoubleDouble:
    """Set the states where the next series begins, at the end of those from `now`; return the time there."""
    _put_states(states, s, reach, here)
    for m in range(states.shape[0]):
        dd.put(s, states[m, 0] * LENGTH, dd.at(here, states[m, 0]))
    return dd.add(now, dd.scale(unit, reach))
