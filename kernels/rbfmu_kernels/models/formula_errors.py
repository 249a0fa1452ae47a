"""How far series of formulas are in error, in templates that `formula_models.make_formulas` binds.

What the last two terms tell (A. Jorba & M. Zou, Experimental Mathematics 14, 2005) does not hold beside branch points
that lie close to a real corner, as sqrt(x**2 + e**2) has at x = -ie and ie: the terms that come of these have only the
size e**2, by which a series may look converged far beyond them. It then goes on as if x had kept its side. Its defect
tells: by how much its slopes differ from the rates of its states (W. H. Enright, Journal of Computational and Applied
Mathematics 125, 2000), and what it has of events and corners from what they are there.
"""

import math
from typing import Any

from ..buffer_access import copy_numbers
from ..integrators import formula_ends, substeps
from ..integrators.polynomials import NOTHING, ROUGHLY, bound_of, polynomial, slope_of
from ..types import Buffer
from .formula_events import excess_of_events, size_of_event

MOST_DEFECT, OF_DOUBLES, OF_TERMS = 10.0, 2.0**-50, 1e-9
"""The excess of a series' defect with which it is made shorter; and the least error that is asked for there: less is
round-off, of which a shorter series has as much. What an event watches may be 1e6 times less than its terms, as
norm(position) - 6.9e6 of an orbit is, and has their round-off. Less than OF_TERMS is therefore not asked for of it, or
series got ever shorter, to where that is zero by chance. A corner that hides in an event is far more.
"""

# What templates are bound to, see `formulas`.
_missing: Any = None
constants = first = _missing
_places: tuple[int, ...] = ()
INPUTS = RATES = RATES_2 = STATES = FIRSTS = ENDS = OF_EVENT = _places
LEASTS: tuple[float, ...] = ()
RELATIVE: tuple[bool, ...] = ()
ORDER = TOLERANCE = SPAN = SIZES = NUMBER_OF_INPUTS = NUMBER_OF_EVENTS = NUMBER_OF_SIDES = WATCHED = 0
SPARE = WORK = ROWS = ROW = 0


def size_of_group(z: Buffer, g: int, h: float) -> float:
    """Return what errors of a group of states over a step h are relative to."""
    slope, bend = 0.0, 0.0
    for i in range(FIRSTS[g], ENDS[g]):
        slope = max(slope, abs(z[ROWS + ROW + i]))
        bend = max(bend, abs(z[ROWS + 2 * ROW + i]))
    size = max(max(z[SIZES + g], LEASTS[g]), max(slope * h, bend * h * h) if RELATIVE[g] else 0.0)
    if size == 0.0 and RELATIVE[g]:  # what begins at zero with its first slopes, as under a torque sin(t)**2 from rest
        for i in range(FIRSTS[g], ENDS[g]):
            size = max(size, bound_of(z, ROWS + i, ROW, int(z[ORDER]), h)[0])
    return size


def excess_of(z: Buffer, h: float) -> float:
    """Return the estimated error of a step h over that which is allowed."""
    n = int(z[ORDER])
    power, worst = substeps.power_of(h, n - 1), 0.0
    for g in range(len(FIRSTS)):
        before, last = 0.0, 0.0
        for i in range(FIRSTS[g], ENDS[g]):
            before = max(before, abs(z[ROWS + (n - 1) * ROW + i]))
            last = max(last, abs(z[ROWS + n * ROW + i]))
        error, size = max(before, last * h) * power, size_of_group(z, g, h)
        if error > 0.0:
            worst = max(worst, error / size if size > 0.0 else math.inf)
        elif math.isnan(error):
            return math.inf
    if NUMBER_OF_EVENTS:
        worst = max(worst, excess_of_events(z, h))
    return worst / substeps.tolerance_of_substep(z[TOLERANCE], z[SPAN], h)


def excess_of_defect(z: Buffer, t: float) -> float:
    """Return the error that the defect at a time t of the series tells of, over that which is allowed.

    The first term that is left out, c t^(n + 1), has the defect (n + 1) c t^n. What has corners must be known as well
    as `reach_to_corner` takes it to be.
    """
    n, inputs = int(z[ORDER]), SPARE + 2 * ROW
    anew, worst = inputs + NUMBER_OF_INPUTS, 0.0
    copy_numbers(z, ROWS, SPARE, 2 * ROW)
    for i in range(NUMBER_OF_INPUTS):
        z[inputs + i] = z[INPUTS[i]]
        z[INPUTS[i]] += t * z[RATES[i]] + 0.5 * t * t * z[RATES_2[i]]
    for i in range(len(STATES)):
        z[ROWS + i] = polynomial(z, ROWS + i, ROW, n, t)
    constants(z, WORK)
    first(z, WORK)
    copy_numbers(z, ROWS + ROW, anew, len(STATES))
    copy_numbers(z, WATCHED, anew + len(STATES), NUMBER_OF_SIDES)
    copy_numbers(z, SPARE, ROWS, 2 * ROW)
    for i in range(NUMBER_OF_INPUTS):
        z[INPUTS[i]] = z[inputs + i]
    for g in range(len(FIRSTS)):
        size = size_of_group(z, g, t)
        for i in range(FIRSTS[g], ENDS[g]):
            defect = abs(z[anew + i] - slope_of(z, ROWS + i, ROW, n, t))
            if defect != 0.0:
                worst = max(worst, defect * t / ((n + 1) * size)) if defect < math.inf and size > 0.0 else math.inf
    allowed = max(substeps.tolerance_of_substep(z[TOLERANCE], z[SPAN], t), OF_DOUBLES)
    for i in range(NUMBER_OF_SIDES):
        at = WATCHED + i
        apart = abs(z[anew + len(STATES) + i] - polynomial(z, at, ROW, n, t))
        if apart > 0.0 and OF_EVENT[i] >= 0:
            worst = max(worst, apart / size_of_event(z, OF_EVENT[i], t) * (allowed / max(allowed, OF_TERMS)))
        elif apart > NOTHING:
            worst = max(worst, apart / bound_of(z, at, ROW, n, t)[0] * (allowed / ROUGHLY))
    return worst / allowed


def first_fault_inside(z: Buffer, t: float) -> float:
    """Return the first of some times before t at which the series has not the rates of its states; 0 where it has.

    What is nearly nothing at first, and at the end again, as a pulse is, no term of a series need tell.
    """
    for k in range(1, formula_ends.PARTS):
        at = t * k / formula_ends.PARTS
        if at > 0.0 and excess_of_defect(z, at) > MOST_DEFECT:
            return at
    return 0.0
