"""Models of formulas for loads, states and outputs: Taylor series of all that outputs depend on, in steps of their own.

These functions are templates: `formula_models` binds them to one scene's generated kernels (`constants`, `first`,
`further`, `values`) and to the places of its numbers. While inputs are held, one series is evaluated at all
communication points within its reach: as far as its last two terms are within the tolerance (A. Jorba & M. Zou,
Experimental Mathematics 14, 2005), for the attitude in rad; for other states relative to their largest value so far, or
to the size that their first terms give them, as a state may begin at zero.
"""

import math
from typing import Any

from ..body import driven, memory, outputs
from ..body.lanes import PENDING
from ..buffer import MAX_SUBSTEPS, MOST_LISTED, OK, STEP_REJECTED
from ..buffer_access import copy_numbers, pair_at, put_pair_at, put_quaternion_at, quaternion_at
from ..compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, put_lanes
from ..integrators import formula_ends, polynomials
from ..integrators.substeps import count_substep, tolerance_of_substep
from ..numerics import double_double as dd, elementary
from ..rotations.quaternion import normalize
from ..types import Buffer
from .formula_errors import MOST_DEFECT, excess_of, excess_of_defect, first_fault_inside
from .formula_events import clear_list, note_events, reach_to_touches, root_of_event, set_up_events, side_that_counts
from .formula_variations import corner_at_end, put_errors_at, reach_of_errors, shift_of_corner, vary_series

ORDERS = range(6, 31, 2)
SERIES = {
    "series.stands": 1, "series.reach": 1, "series.since": 2, "series.begun": 2,
    "series.rest": 1, "series.crept": 1, "series.tried": 1,
}  # fmt: skip
"""Whether there is a valid series; its reach, and how far it has been used, s; the time at which it began; the time
left in the communication step, s; the number of its series that were very short, and of all its series."""
CORNERS = ("series.sides", "series.on", "series.next_on", "series.flips")
"""For each number whose sign the coefficients depend on (in abs, min, max, where, a table's rows): its side, 1 or -1;
how many series in a row ended at its corner before this one (negative where this one begins beside it, see
`formula_ends`), and with this one; and how often its side changed while the series was made.

A series ends where such a number passes zero. The side after it is the sign of the first derivative that is not zero.
Where both sides lead back to zero, the motion would slide along the corner, and is refused. Where a motion begins at a
corner and both sides lead away, it takes side 1, as formulas do at zero: with where(x >= 0, 1, -1) as its rate x rises.
"""
AT_REST = 1e-8
"""The length of a series that begins where the argument of a square root is zero, as a part of its reach.

Beyond a double zero of its argument a square root only changes its sign: the series goes on by `BEYOND` of its reach,
and the next one begins with the positive root. A root that begins at zero is taken as zero in its first series. The
errors of both are the squares of these parts. At a corner, as of max(x, 0)**1.5, a root also counts as zero where
round-off has moved it from there (`formula_ends.rest_roots`); a series beside it reaches 0.8 of the time to its zero.
"""
CREEPING, MOST_CREPT = 1e-7, 20_000
"""A communication step is refused after MOST_CREPT series that each reach over less than the part CREEPING of it."""
JUMP = 1e-9
"""The relative change up to which an input counts as unchanged: a linear input arrives with some round-off."""
SHORTER, OF_ROUND_OFF = 40, 1.0 / 16.0
"""The largest number of halvings of a series for its defect, and the largest part of the defect that a halving may
leave. It leaves at most 2^-7 of a truncation error, but half of round-off, for which the series is not cut.
"""
NEAR = 0.2
"""The estimate of a step from its error is repeated until it changes the step by at most this part."""

# What templates are bound to. For each group of states: its columns in a row of coefficients, the least size that its
# errors are relative to, and whether they are relative to its largest value so far. For inputs: the places of their
# numbers and rates, at least one each, as an empty tuple has no type.
_missing: Any = None
constants = first = further = values = _missing
_places: tuple[int, ...] = ()
RELATIVE: tuple[bool, ...] = ()
INPUTS = RATES = RATES_2 = STATES = FIRSTS = ENDS = OF_EVENT = _places
ORDER = TOLERANCE = SPAN = TIME = STARTS = LONGEST = SIZES = HELD = STANDS = REACH = SINCE = BEGUN = 0
NUMBER_OF_INPUTS = NUMBER_TOUCHING = NUMBER_RISING = NUMBER_OF_SIDES = WATCHED = SIDES = ON = NEXT = FLIPS = 0
NUMBER_OF_EVENTS = LISTED = NUMBER_OF_ERRORS = BOUNDED = REST = CREPT = TRIED = RESTING = 0
KEPT = MEMORY = MEMORY_SIZE = LAST = WORK = ROWS = ROW = OWN = OWN_STARTS = OWN_SIZE = ATTITUDE = 0


def set_up_formulas(z: Buffer) -> int:
    """Set states, time and outputs of your own."""
    copy_numbers(z, OWN_STARTS, OWN, OWN_SIZE)
    put_pair_at(z, TIME, (z[STARTS], 0.0))
    z[STANDS], z[REACH], z[driven.STEP_SIZE] = 0.0, 0.0, z[LONGEST]
    put_pair_at(z, SINCE, (0.0, 0.0))
    for g in range(len(FIRSTS)):
        z[SIZES + g] = 0.0
    for i in range(NUMBER_OF_SIDES):
        z[SIDES + i], z[NEXT + i] = 0.0 if OF_EVENT[i] >= 0 else 1.0, 0.0
    if NUMBER_OF_EVENTS:
        set_up_events(z)
    return values(z)  # type: ignore[no-any-return]


def reach_of_truth(z: Buffer, h: float) -> tuple[float, float]:
    """Return a step, at most h, at whose end the defect of the series is small, and the reach of the series."""
    far = z[REACH] == 0.0 or h > formula_ends.FARTHER * z[driven.STEP_SIZE]
    step, reach, before = h, reach_to_corner(z, h), 0.0
    for _ in range(SHORTER):
        t = reach - 2.0 * formula_ends.BEYOND * step  # as a series goes on beyond a double zero
        excess = excess_of_defect(z, t) if t > 0.0 else 0.0
        inside = first_fault_inside(z, t) if far and excess <= MOST_DEFECT else 0.0
        if excess <= MOST_DEFECT and inside == 0.0:
            if before == 0.0 or excess <= OF_ROUND_OFF * before:
                return step, reach
            break
        before = excess_of_defect(z, inside) if inside > 0.0 else excess
        step = 0.5 * (inside if inside > 0.0 else reach)
        reach = reach_to_corner(z, step)
    return h, reach_to_corner(z, h)


def settle_sides(z: Buffer) -> bool:
    """Return whether all sides agree with the series; else change one of them, for which the series is made again."""
    if formula_ends.rest_roots(z, WATCHED, ROW, NUMBER_OF_SIDES, NUMBER_TOUCHING, RESTING, z[TIME] - z[STARTS]):
        return False
    for i in range(NUMBER_OF_SIDES):
        if OF_EVENT[i] >= 0:
            side = side_that_counts(z, i)
        else:
            since = z[TIME] - z[STARTS]
            z[ON + i] = formula_ends.begins_again(z, WATCHED + i, ROW, z[ON + i], since)
            side = formula_ends.side_after(z, WATCHED + i, ROW, int(z[ORDER]), z[ON + i], since)
            side = 1.0 if side == 0.0 and z[FLIPS + i] == 0.0 else side  # a number that stays zero has side 1
        side = 1.0 if side == 0.0 and z[SIDES + i] == 0.0 else side
        if side != 0.0 and side != z[SIDES + i]:
            z[SIDES + i] = side
            z[FLIPS + i] += 1.0
            return False
    return True


def reach_to_corner(z: Buffer, h: float) -> float:
    """Return how far the series reach, at most h, and note which numbers are at their corners there.

    The number that has a corner is no state, so that its own truncation error must be small up to there as well. So
    must that of a square root near its zero: its coefficients lose digits with each order, which no state need show.
    """
    n, corner, at_corner = int(z[ORDER]), -1, False
    for i in range(WATCHED, WATCHED + NUMBER_OF_SIDES + 2 * NUMBER_TOUCHING):
        h = polynomials.known_until(z, i, ROW, n, h, polynomials.ROUGHLY)
    for i in range(NUMBER_OF_SIDES):
        h = formula_ends.around_corner(z, WATCHED + i, ROW, z[ON + i], h)
    rising = WATCHED + NUMBER_OF_SIDES + 2 * NUMBER_TOUCHING
    for i in range(rising, rising + NUMBER_RISING):
        h = formula_ends.risen_at(z, i, ROW, n, h)
    reach = h
    for i in range(NUMBER_OF_SIDES):
        at = WATCHED + i
        if OF_EVENT[i] >= 0:
            root = root_of_event(z, i, h)
        else:
            root = polynomials.first_root_after(z, at, ROW, n, 1 if z[ON + i] > 0.0 else 0, h)
        if root < reach:
            reach, corner = root, at
    for i in range(WATCHED + NUMBER_OF_SIDES, WATCHED + NUMBER_OF_SIDES + NUMBER_TOUCHING):
        if z[RESTING + i - WATCHED - NUMBER_OF_SIDES] != 0.0:
            reach, corner = min(reach, formula_ends.SOON_AFTER * (z[TIME] - z[STARTS])), -1
        elif polynomials.begins_at_zero(z, i, ROW, n):
            reach, corner = min(reach, AT_REST * h), -1
        else:
            touch = polynomials.first_touch(z, i, ROW, n, 0.0, h, 1.0, polynomials.OF_ROOTS)
            if touch < h and touch + formula_ends.BEYOND * h < reach:
                reach, corner = touch + formula_ends.BEYOND * h, i
    if corner >= 0:  # where it is not known well enough, the next series finds it from nearer by
        reach = polynomials.known_until(z, corner, ROW, n, reach, tolerance_of_substep(z[TOLERANCE], z[SPAN], h))
    if NUMBER_OF_EVENTS:
        reach = reach_to_touches(z, h, reach)
    for i in range(NUMBER_OF_SIDES):
        ends_there = reach < h and formula_ends.ends_at_corner(z, WATCHED + i, ROW, n, z[ON + i], reach, h)
        z[NEXT + i] = 1.0 - min(z[ON + i], 0.0) if ends_there else 0.0
        at_corner = at_corner or ends_there
    for i in range(NUMBER_TOUCHING):
        is_zero = at_corner and formula_ends.is_zero_at_end(z, WATCHED + NUMBER_OF_SIDES + i, ROW, n, reach, h)
        z[RESTING + NUMBER_TOUCHING + i] = 1.0 if is_zero else 0.0
    return reach


def prepare_series(z: Buffer) -> None:
    """Set the first coefficients of the series from the present states, and which corners and roots it begins at."""
    ended = z[SINCE] >= z[REACH]
    if NUMBER_OF_ERRORS and ended:
        shift_of_corner(z)
    for i in range(len(STATES)):
        z[ROWS + i] = z[STATES[i]]
    for g in range(len(FIRSTS)):
        if RELATIVE[g]:
            for i in range(FIRSTS[g], ENDS[g]):
                z[SIZES + g] = max(z[SIZES + g], abs(z[ROWS + i]))
    for i in range(NUMBER_OF_SIDES):
        z[ON + i], z[FLIPS + i] = z[NEXT + i] if ended else 0.0, 0.0
    for i in range(NUMBER_TOUCHING):
        z[RESTING + i], z[RESTING + NUMBER_TOUCHING + i] = 0.0, z[RESTING + NUMBER_TOUCHING + i] if ended else 0.0


def make_series(z: Buffer) -> bool:
    """Make the series, again after each change of a side; return whether all sides agree with it in the end."""
    for _ in range(3 * NUMBER_OF_SIDES + NUMBER_TOUCHING + 1):
        constants(z, WORK)
        first(z, WORK)
        for k in range(1, int(z[ORDER])):
            further(z, WORK, k)
        if settle_sides(z):
            return True
    return False


def begin_to_serve(z: Buffer, settled: bool) -> bool:
    """Set the reach of the series that was made; return whether the motion can follow it."""
    n, ended = int(z[ORDER]), z[SINCE] >= z[REACH]
    h, longest = z[driven.STEP_SIZE], z[LONGEST]
    for _ in range(200):
        excess = excess_of(z, h)
        ratio = 0.1
        if excess > 0.0:
            ratio = elementary.exponential(-elementary.logarithm(excess) / n) if excess < math.inf else 1e-3
        elif excess == 0.0:
            ratio = longest / h
        h = min(h * ratio, longest)
        if abs(ratio - 1.0) <= NEAR or h == longest:
            break
    if NUMBER_OF_ERRORS:
        vary_series(z, ended)
        h = reach_of_errors(z, h) if z[BOUNDED] != 0.0 else h
    z[driven.STEP_SIZE], z[REACH] = reach_of_truth(z, h)
    z[STANDS] = 1.0
    put_pair_at(z, SINCE, (0.0, 0.0))
    put_pair_at(z, BEGUN, pair_at(z, TIME))
    count_substep(z, driven.STEP_SIZE)
    if settled and NUMBER_OF_EVENTS:
        note_events(z, ended)
    return settled and z[REACH] > 0.0


def put_states_at(z: Buffer, t: float) -> None:
    """Set the states to the series at t. Even and odd powers are summed apart, so neither sum waits for the other."""
    square = t * t
    n, once, twice = int(z[ORDER]), lanes(t, t, t, t), lanes(square, square, square, square)
    for i in range(0, len(STATES), 4):
        even, odd = lanes_at(z, ROWS + n * ROW + i), lanes_at(z, ROWS + (n - 1) * ROW + i)
        for k in range(n - 2, 0, -2):
            even = add_lanes(multiply_lanes(even, twice), lanes_at(z, ROWS + k * ROW + i))
            odd = add_lanes(multiply_lanes(odd, twice), lanes_at(z, ROWS + (k - 1) * ROW + i))
        even = add_lanes(multiply_lanes(even, twice), lanes_at(z, ROWS + i))
        put_lanes(z, LAST, add_lanes(even, multiply_lanes(odd, once)))
        for j in range(i, min(i + 4, len(STATES))):
            z[STATES[j]] = z[LAST + j - i]
    if NUMBER_OF_ERRORS:
        put_errors_at(z, t)
    if ATTITUDE:
        put_quaternion_at(z, memory.STATE_START, normalize(quaternion_at(z, memory.STATE_START)))


def holds_inputs(z: Buffer) -> bool:
    """Return whether the inputs are those of the series, and constant over the step."""
    same = True
    for i in range(NUMBER_OF_INPUTS):
        same &= bool(z[INPUTS[i]] == z[HELD + i]) & bool(z[RATES[i]] == 0.0) & bool(z[RATES_2[i]] == 0.0)
    return same


def inputs_jump(z: Buffer) -> bool:
    """Return whether an input differs from the one that was kept by more than round-off of a linear change."""
    jump = False
    for i in range(NUMBER_OF_INPUTS):
        now, before = z[INPUTS[i]], z[HELD + i]
        jump |= bool(abs(now - before) > JUMP * max(abs(now), abs(before)))
    return jump


def keep_inputs(z: Buffer) -> None:
    """Keep the inputs, for `holds_inputs`."""
    for i in range(NUMBER_OF_INPUTS):
        z[HELD + i] = z[INPUTS[i]]


def change_inputs(z: Buffer, h: float) -> None:
    """Advance the inputs, quadratic in time, and their rates by h."""
    for i in range(NUMBER_OF_INPUTS):
        z[INPUTS[i]] += h * z[RATES[i]] + 0.5 * h * h * z[RATES_2[i]]
        z[RATES[i]] += h * z[RATES_2[i]]


def reaches_over(z: Buffer, h: float) -> bool:
    """Return whether the present series is valid over a whole step h."""
    serves = bool(z[STANDS] != 0.0 and z[SINCE] + h <= z[REACH] and holds_inputs(z))
    return serves and not end_together(z, z[SINCE] + h)


def end_together(z: Buffer, t: float) -> bool:
    """Return whether errors vary and t is, to round-off, at or after the series' end, where errors jump at a corner."""
    passed = z[BEGUN] + z[REACH] - z[STARTS]
    return NUMBER_OF_ERRORS != 0 and bool(t >= z[REACH] - polynomials.AT_CORNER * passed)


def evaluate_at_end(z: Buffer, h: float) -> int:
    """Advance by h along the present series, valid over h; reject the step, with nothing changed, if not finite."""
    if NUMBER_OF_EVENTS:
        clear_list(z)
    since, time = pair_at(z, SINCE), pair_at(z, TIME)
    put_pair_at(z, SINCE, dd.add_float(since, h))
    put_states_at(z, z[SINCE])
    put_pair_at(z, TIME, dd.add_float(time, h))  # from its own series it would have more round-off
    if memory.is_finite(z) and values(z) == 0:
        return outputs.outputs(z)
    put_pair_at(z, SINCE, since)
    put_pair_at(z, TIME, time)
    put_states_at(z, since[0])
    return STEP_REJECTED


def advance_formulas(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion cannot be followed."""
    if reaches_over(z, h):
        return evaluate_at_end(z, h)
    status = begin_step(z, h)
    while status == PENDING:
        prepare_series(z)
        status = go_on_by_series(z, h, make_series(z))
    return status


def begin_step(z: Buffer, h: float) -> int:
    """Begin a step h and advance as far as the present series reaches; return a status, PENDING for the next series."""
    if NUMBER_OF_EVENTS:
        clear_list(z)
    keep_before_step(z)
    z[REST], z[CREPT], z[TRIED] = h, 0.0, 0.0
    return go_on_with_step(z, h)


def go_on_by_series(z: Buffer, h: float, settled: bool) -> int:
    """Continue a step with the series just made; settled: what `make_series` returned; return as `begin_step` does."""
    return go_on_with_step(z, h) if begin_to_serve(z, settled) else end_of_step(z, h, STEP_REJECTED)


def go_on_with_step(z: Buffer, h: float) -> int:
    """Continue a step until it is done, is refused, or needs the next series; return as `begin_step` does."""
    while z[STANDS] != 0.0 and z[SINCE] < z[REACH]:
        status = follow_series(z, h)
        if status != PENDING:
            return end_of_step(z, h, status)
    z[TRIED] += 1.0
    return PENDING if z[TRIED] <= MAX_SUBSTEPS else end_of_step(z, h, STEP_REJECTED)


def keep_before_step(z: Buffer) -> None:
    """Store what a refused step must restore; a series that was made with other inputs is no longer valid.

    If inputs jump, a number may have left its corner: its side is then the sign of its value.
    """
    copy_numbers(z, MEMORY, KEPT, MEMORY_SIZE)
    if not holds_inputs(z):
        z[STANDS] = 0.0
        if inputs_jump(z):
            for i in range(NUMBER_OF_SIDES):
                z[NEXT + i] = 0.0
        keep_inputs(z)


def follow_series(z: Buffer, h: float) -> int:
    """Follow the present series to the end of a step h, or as far as it reaches; return as `begin_step` does."""
    since = pair_at(z, SINCE)
    left = (z[REACH] - since[0]) - since[1]
    # errors jump at a corner with the inputs of this step, before those of the next
    jumps = end_together(z, since[0] + z[REST]) and corner_at_end(z) >= 0
    if z[REST] <= left * (1.0 + 1e-9) and not jumps:
        put_pair_at(z, SINCE, dd.add_float(since, z[REST]))
        put_states_at(z, z[SINCE])
        return OK
    put_states_at(z, z[REACH])
    put_pair_at(z, SINCE, (z[REACH], 0.0))
    change_inputs(z, left)
    put_pair_at(z, TIME, dd.add_float(pair_at(z, BEGUN), z[REACH]))
    z[STANDS] = 0.0
    z[REST] = max(z[REST] - left, 0.0)
    z[CREPT] += 1.0 if z[REACH] < CREEPING * h else 0.0
    too_many = NUMBER_OF_EVENTS > 0 and z[LISTED] > MOST_LISTED
    return STEP_REJECTED if z[CREPT] > MOST_CREPT or too_many else PENDING


def end_of_step(z: Buffer, h: float, status: int) -> int:
    """Set outputs and time at the end of a step; reject it, with nothing changed, where a number is not finite."""
    put_pair_at(z, TIME, dd.add_float(pair_at(z, KEPT + (TIME - MEMORY)), h))
    if status == OK:
        change_inputs(z, z[REST])
        hold = holds_inputs(z)
        for i in range(NUMBER_OF_INPUTS):
            z[RATES[i]] = z[RATES_2[i]] = 0.0
        if memory.is_finite(z) and values(z) == 0:
            if not hold:  # the series contains their changes, even if their values are the same again
                z[STANDS] = 0.0
                keep_inputs(z)
            return outputs.outputs(z)
    for i in range(NUMBER_OF_INPUTS):  # those at the step's beginning, which are not in the copy below
        z[INPUTS[i]] = z[HELD + i]
    copy_numbers(z, KEPT, MEMORY, MEMORY_SIZE)
    z[STANDS] = 0.0
    return STEP_REJECTED


def outputs_now(z: Buffer) -> int:
    """Refresh the outputs after inputs were set."""
    return values(z) or outputs.outputs(z)
