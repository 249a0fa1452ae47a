"""How far series of formulas are in error, in templates that `formula_models.make_formulas` binds.

The estimate from the last two terms (A. Jorba & M. Zou, Experimental Mathematics 14, 2005) fails near branch points
close to the real axis, as sqrt(x**2 + e**2) has at x = -ie and ie: their terms have only the size e**2, so that a
series may look converged far beyond them. It then goes on as if x had not changed its sign. The defect shows this: the
difference of the series' slopes from the rates of its states (W. H. Enright, Journal of Computational and Applied
Mathematics 125, 2000), and of the series of watched numbers from their values there.
"""

import math
from typing import Any

from ..buffer_access import copy_numbers
from ..integrators import formula_ends, substeps
from ..integrators.polynomials import NOTHING, ROUGHLY, bound_of, polynomial, slope_of
from ..types import Buffer
from .formula_events import excess_of_events, size_of_event

MOST_DEFECT, OF_DOUBLES, OF_TERMS = 10.0, 2.0**-50, 1e-9
"""A series is cut where its defect is more than MOST_DEFECT times the allowed error. At least OF_DOUBLES is allowed:
a smaller defect is round-off, which a shorter series has too. A watched number may be 1e6 times smaller than its terms,
but has their round-off, as norm(position) - 6.9e6 of an orbit: for it at least OF_TERMS is allowed, as otherwise series
would be cut to nothing. The defect of an overlooked corner is far larger.
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
    """Return the size to which errors of a group of states over a step h are relative."""
    slope, bend = 0.0, 0.0
    for i in range(FIRSTS[g], ENDS[g]):
        slope = max(slope, abs(z[ROWS + ROW + i]))
        bend = max(bend, abs(z[ROWS + 2 * ROW + i]))
    size = max(max(z[SIZES + g], LEASTS[g]), max(slope * h, bend * h * h) if RELATIVE[g] else 0.0)
    if size == 0.0 and RELATIVE[g]:  # its first derivatives are zero too, as from rest under a torque sin(t)**2
        for i in range(FIRSTS[g], ENDS[g]):
            size = max(size, bound_of(z, ROWS + i, ROW, int(z[ORDER]), h)[0])
    return size


def excess_of(z: Buffer, h: float) -> float:
    """Return the estimated error of a step h over the allowed one."""
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
    """Return the error of the series at t, estimated from its defect there, over the allowed one.

    The first term that is left out, c t^(n + 1), has the defect (n + 1) c t^n. Numbers with corners must be as accurate
    as `reach_to_corner` assumes.
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
    """Return the first of some times before t at which the defect of the series is too large; 0 if there is none.

    A pulse that is nearly zero at the series' beginning and end need not show in its terms.
    """
    for k in range(1, formula_ends.PARTS):
        at = t * k / formula_ends.PARTS
        if at > 0.0 and excess_of_defect(z, at) > MOST_DEFECT:
            return at
    return 0.0
