"""The motion of a scene by Taylor series in double-double arithmetic, by which plans are judged.

Far more accurate than what it judges and independent of the communication step: steps of its own, the series evaluated
wherever an output is asked for. The step is chosen by the last two terms: A. Jorba & M. Zou, Experimental Mathematics
14 (2005). It walks a list of operations for each order, so that one compiled function serves every scene. The
recurrences are those of `rbfmu.formulas.program`; a number of the work space has its coefficients side by side, high
parts in s[0], low ones in s[1].
"""

import math
from typing import NamedTuple

from ..compile.decorator import kernel
from ..numerics import double_double as dd
from ..types import Array, Indices
from . import polynomials
from .formula_ends import FARTHER, around_corner, begins_again, ends_at_corner, risen_at, side_after
from .formula_operations import SIDE, STATE, coefficient_of, value_of

ORDER, TOLERANCE, BEYOND, AT_REST = 26, 1e-22, 1e-9, 1e-10
"""The order of series, and the error of a step, relative to sizes: far below what doubles have. The order of least work
there is 1 - ln(1e-22) / 2 (Jorba & Zou 2005, 3.2). How far beyond a touch a series ends, and how far it goes from where
the number under a root begins at zero: parts of its reach."""
LENGTH = ORDER + 1
ENOUGH, STEADY = 0.15, 2.1
"""In a hurry a motion is given up after a fifth of the steps where these have done less than this part of the run, and
have not grown longer: they have done less than so many times what the first half of them did."""
SHORTER, MOST_SHORTENED = 2.0**-40, 10
"""By how much, and how often, the unit of time is made shorter where coefficients leave the range of doubles."""
CORNER_KNOWN = 1e-17
"""The part of its size to which what has a corner is known there."""
MOST_DEFECT, MOST_HALVED, FAR_PARTS, PARTS = 1e-11, 60, 64, 16
"""The defect within a series, which is known in doubles, with which it is halved, and how often at most; and the parts
of one that goes far, and of others, between which it is looked at: more than of what is judged.
"""
FINEST, MOST_STALLED = 2.0**-52, 500
"""How many series on end may reach no farther than this part of the time since the start, which doubles tell as one: 13
where a force grows from 1e-300, ever more where a motion ends in a pole."""
NOWHERE, SLIDES = -2, math.inf


class Equations(NamedTuple):
    """What is walked, in rows.

    operations (n, 5): kind, what it is of, and whether it changes. states (m, 3): which operation it is and that of its
    rate, and its group. least: of each group, the least size that its errors are relative to, negative where that alone
    counts. sides (n, 3): operation, whether a series began and ends at its corner. touching (n, 2): what may come down
    to zero, and the root or angle of it. rising: what exponentials are of. wanted: operations. time: that which is the
    time, or -1.
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
    """Set the values of all operations but numbers and leaves, which stand there; stride: from one to the next.

    with_sides: whether those are set as well.
    """
    for n in range(operations.shape[0]):
        kind, a, b, c = operations[n, 0], operations[n, 1], operations[n, 2], operations[n, 3]
        if kind > STATE and (with_sides or kind != SIDE):
            dd.put(s, n * stride, value_of(kind, n * stride, a * stride, b * stride, c * stride, s))


@kernel(inline=False)
def _expand(equations: Equations, s: Array, unit: float) -> None:
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
def _longest(equations: Equations, sizes: Array, s: Array) -> float:
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
                    if not abs(s[0, i + k]) < math.inf:
                        return math.nan
                sizes[g] = max(sizes[g], abs(s[0, i]))
                slope, bend = max(slope, abs(s[0, i + 1])), max(bend, abs(s[0, i + 2]))
                before, last = max(before, abs(s[0, i + ORDER - 1])), max(last, abs(s[0, i + ORDER]))
        size, first, lead = max(abs(least[g]), sizes[g] if least[g] >= 0.0 else 0.0), 0, 0.0
        while size == 0.0 and lead == 0.0 and first < ORDER - 2:
            first += 1
            for m in range(states.shape[0]):
                lead = max(lead, abs(s[0, states[m, 0] * LENGTH + first]) if states[m, 2] == g else 0.0)
        for k, term in ((ORDER - 1, before), (ORDER, last)):
            if term > 0.0:
                reach = (TOLERANCE * size / term) ** (1.0 / k)
                if least[g] >= 0.0:  # a state that begins at zero is soon as large as its first terms make it
                    reach = max(reach, (TOLERANCE * slope / term) ** (1.0 / (k - 1)))
                    reach = max(reach, (TOLERANCE * bend / term) ** (1.0 / (k - 2)))
                    reach = max(reach, (TOLERANCE * lead / term) ** (1.0 / (k - first)))
                longest = min(longest, reach)
    return longest


@kernel(inline=False)
def _settled(equations: Equations, s: Array, unit: float, done: float, again: bool) -> bool:
    """Expand until all sides are those to which the series lead; return whether there are any such.

    done: the time that has passed, in units; again: whether the series is the same in another unit.
    """
    operations, sides = equations.operations, equations.sides
    for i in range(0 if again else sides.shape[0]):
        sides[i, 1], sides[i, 2] = sides[i, 2], 0.0
    last = 0
    for _ in range(3 * sides.shape[0] + 1):
        _expand(equations, s, unit)
        changed = False
        for i in range(sides.shape[0]):
            n = int(sides[i, 0])
            at = operations[n, 1] * LENGTH
            sides[i, 1] = begins_again(s[0], at, 1, sides[i, 1], done)
            side = side_after(s[0], at, 1, ORDER, sides[i, 1], done)
            side = 1.0 if side == 0.0 and (sides[i, 2] == 0.0 or s[0, n * LENGTH] == 0.0) else side
            if side != 0.0 and side != s[0, n * LENGTH]:
                s[0, n * LENGTH], sides[i, 2] = side, 1.0  # which says until `_to_corner` that it has turned already
                changed, last = True, i
                break
        if not changed:
            return True
    sides[last, 1] = SLIDES
    return False


@kernel(inline=False)
def _to_corner(equations: Equations, s: Array, longest: float) -> float:
    """Return how far the series reach, at most `longest`, and note at whose corner they end."""
    operations, sides, touching, corner = equations.operations, equations.sides, equations.touching, -1
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        longest = polynomials.known_until(s[0], at, 1, ORDER, longest, polynomials.ROUGHLY)
        longest = around_corner(s[0], at, 1, sides[i, 1], longest)
    for m in range(touching.shape[0]):
        for of in range(2):
            longest = polynomials.known_until(s[0], touching[m, of] * LENGTH, 1, ORDER, longest, polynomials.ROUGHLY)
    for i in equations.rising:
        longest = risen_at(s[0], i * LENGTH, 1, ORDER, longest)
    reach = longest
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        root = polynomials.first_root_after(s[0], at, 1, ORDER, 1 if sides[i, 1] > 0.0 else 0, longest)
        if root < reach:
            reach, corner = root, at
    for m in range(touching.shape[0]):
        at = touching[m, 0] * LENGTH
        if polynomials.begins_at_zero(s[0], at, 1, ORDER):
            reach, corner = min(reach, AT_REST * longest), -1
        else:
            touch = polynomials.first_touch(s[0], at, 1, ORDER, 0.0, longest, 1.0, polynomials.OF_ROOTS)
            if touch < longest and touch + BEYOND * longest < reach:
                reach, corner = touch + BEYOND * longest, at
    if corner >= 0:
        reach = polynomials.known_until(s[0], corner, 1, ORDER, reach, CORNER_KNOWN)
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1] * LENGTH
        ends_there = reach < longest and ends_at_corner(s[0], at, 1, ORDER, sides[i, 1], reach, longest)
        sides[i, 2] = 1.0 - min(sides[i, 1], 0.0) if ends_there else 0.0
    return reach


@kernel(inline=False)
def _put_states(states: Indices, s: Array, at: dd.DoubleDouble, found: Array) -> None:
    """Set the states at a time after the series' beginning, in the places of the operations."""
    for m in range(states.shape[0]):
        i = states[m, 0] * LENGTH
        total = dd.at(s, i + ORDER)
        for k in range(ORDER - 1, -1, -1):
            total = dd.add(dd.multiply(at, total), dd.at(s, i + k))
        dd.put(found, states[m, 0], total)


@kernel(inline=False)
def _defect(equations: Equations, sizes: Array, s: Array, unit: float, t: float, here: Array) -> float:
    """Return by how much rates at a time of the series, made anew, differ from its slopes, as errors over sizes.

    So what sides rest on, which must be known to ROUGHLY. See `models.formula_errors`.
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
        if error > 0.0 or math.isnan(error):
            worst = max(worst, error / size) if error < math.inf and size > 0.0 else math.inf
    for i in range(sides.shape[0]):
        at = operations[int(sides[i, 0]), 1]
        error = abs(here[0, at] - polynomials.polynomial(s[0], at * LENGTH, 1, ORDER, t))
        known = polynomials.ROUGHLY * polynomials.bound_of(s[0], at * LENGTH, 1, ORDER, t)[0]
        if error > max(known, polynomials.NOTHING):
            worst = math.inf
    return worst


@kernel(inline=False)
def _first_fault(equations: Equations, sizes: Array, s: Array, unit: float, t: float, here: Array, parts: int) -> float:
    """Return the first end of so many equal parts of [0, t] at which the defect is too large, or 0."""
    for k in range(1, parts + 1):
        at = t * k / parts
        if at > 0.0 and not _defect(equations, sizes, s, unit, at, here) <= MOST_DEFECT:
            return at
    return 0.0


@kernel(inline=False)
def _evaluate_at_row(operations: Indices, time: int, here: Array) -> None:
    """Set the values of all operations where a row is shown.

    Whoever reads its time reads a double, as conditions do here: five times 0.1 s is not more than 0.5.
    """
    exact = here[1, time] if time >= 0 else 0.0
    if exact != 0.0:
        here[1, time] = 0.0
    evaluate(operations, here, 1, True)
    if exact != 0.0:
        here[1, time] = exact
        evaluate(operations, here, 1, False)


@kernel(inline=False)
def formula_motion(
    equations: Equations, times: Array, rows: Array, most: int, s: Array, here: Array, sizes: Array, in_a_hurry: bool
) -> tuple[int, float]:
    """Set rows of what is wanted at increasing times (s, pairs) after the start; return the steps, and how far the
    last of them went: those after half of `most`.

    The steps are -1 beyond `most`, and NOWHERE with the time where numbers are not finite or slide along a corner; in a
    hurry -1 after a fifth of them as well, where these did too little, and the later ones no more than those before.

    here: (2, n) values at the start, of numbers and leaves; s: room for their series, (2, n LENGTH); sizes: one for
    each group.
    """
    operations, states, sides, wanted = equations.operations, equations.states, equations.sides, equations.wanted
    now, steps, k, end, stalled = (times[0, 0], times[1, 0]), 0, 0, times.shape[1], 0
    step, half, span, tenth, shortened = 0.0, now[0], times[0, end - 1] - times[0, 0], 0.0, 0
    usual = 2.0 ** math.floor(math.log2(span)) if span > 0.0 else 1.0  # in which the motion's terms are no denormals
    unit = usual
    sides[:, 1:] = 0.0
    for n in range(operations.shape[0]):
        dd.put(s, n * LENGTH, dd.at(here, n))
    while k < end:
        if not _settled(equations, s, unit, now[0] / unit, shortened > 0 and sides.shape[0] > 0):
            return NOWHERE, now[0]
        longest = min(_longest(equations, sizes, s), 2.0 * span / unit)
        if math.isnan(longest) and shortened < MOST_SHORTENED:
            unit, step, shortened = SHORTER * unit, step / SHORTER, shortened + 1
            continue
        last, step, longest = step, longest, _to_corner(equations, s, longest)
        for _ in range(MOST_HALVED):
            before = longest - 2.0 * BEYOND * step
            parts = FAR_PARTS if step > FARTHER * last else PARTS
            fault = _first_fault(equations, sizes, s, unit, before, here, parts)
            if fault == 0.0:
                break
            step = 0.5 * fault
            longest = _to_corner(equations, s, step)
        steps += 1
        done = now[0] - times[0, 0]
        stalled = stalled + 1 if unit * longest < FINEST * done else 0
        if not longest > 0.0 or stalled > MOST_STALLED:
            return NOWHERE, now[0]
        half = now[0] if steps == most // 2 else half
        tenth = done if steps == most // 10 else tenth
        if steps > most or (in_a_hurry and steps == most // 5 and done < min(ENOUGH * span, STEADY * tenth)):
            return -1, now[0] - half
        while k < end:
            at = dd.scale(1.0 / unit, dd.subtract(dd.at(times, k), now))
            if at[0] > longest:
                break
            _put_states(states, s, at, here)
            _evaluate_at_row(operations, equations.time, here)
            for m in range(wanted.shape[0]):
                rows[k, m] = here[0, wanted[m]]
            k += 1
        if k < end:
            _put_states(states, s, (longest, 0.0), here)
            now = dd.add(now, dd.scale(unit, (longest, 0.0)))
            for m in range(states.shape[0]):
                dd.put(s, states[m, 0] * LENGTH, dd.at(here, states[m, 0]))
            if sides.shape[0] > 0:  # a root beside its corner is over soon
                unit, step, shortened = usual, step * (unit / usual), 0
    return steps, now[0] - half
