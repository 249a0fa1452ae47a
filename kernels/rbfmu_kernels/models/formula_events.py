"""Events of formulas: times at which a watched number is zero. Templates that `formula_models.make_formulas` binds.

The numbers that events watch have series beside those of the states. A series ends where one of them is zero, so that
its side (its sign) changes where the next series begins.
"""

import math

from ..body import driven
from ..buffer import MOST_LISTED as MOST_LISTED
from ..integrators import formula_ends, substeps
from ..integrators.polynomials import AT_CORNER, TOUCHING, first_root, first_touch, leaves_band, polynomial
from ..types import Buffer

EVENTS = (
    "events.noted", "events.counts", "events.times", "events.times_before", "events.earliest", "events.touches",
    "events.last_touches", "events.largest", "events.away", "events.origins", "events.entries", "events.counted",
)  # fmt: skip
"""For each event: the side noted last; the count; the latest time, the one before it, and the first; the time from the
series' beginning to a touch of zero, and the time of the touch in the last series; the number's largest size so far,
and since its last zero; its side before that zero; that zero's place on the list, and whether it counted."""
TOUCH, NOT_ASKED = 0.0, 2.0
"""Kinds of a zero: the number turns back there, or crosses in a direction that is not asked for. Others are 1 or -1."""
FAR = 1e300
"""The distance from zero before the first zero: finite, as all numbers of a saved state are."""
TOUCHED = 1e-15
"""The round-off of a number at its zero, over its largest size so far and over its rate times the time."""
AT_ONCE = 1e-9
"""A touch of zero within this part of a series' step from the series' beginning counts as at its beginning.
A touch is found as a zero of the slope, which round-off moves by far less.
"""
TOGETHER = 0.01
"""Two numbers were zero at the same time if the times since their zeros differ by less than this part. It is also the
longest such time, over a series' step: an error of the last series. A number that jumps over zero has no such time."""

# What templates are bound to, see `formulas`.
OF_EVENT: tuple[int, ...] = ()
EVENT_SIDES: tuple[int, ...] = (0,)
DIRECTIONS: tuple[float, ...] = (0.0,)
NUMBER_OF_EVENTS = NOTED = COUNTS = TIMES = TIMES_BEFORE = EARLIEST = TOUCHES = LAST_TOUCHES = LARGEST = 0
AWAY = ORIGINS = ENTRIES = COUNTED = LISTED = LIST = 0
ORDER = TIME = STARTS = BEGUN = REACH = WATCHED = NUMBER_OF_SIDES = SIDES = ON = FLIPS = ROW = 0


def set_up_events(z: Buffer) -> None:
    """Set the blocks of events as they are before the run."""
    for e in range(NUMBER_OF_EVENTS):
        z[LISTED] = z[NOTED + e] = z[COUNTS + e] = z[LAST_TOUCHES + e] = z[LARGEST + e] = 0.0
        z[TIMES + e] = z[EARLIEST + e] = z[STARTS]
        z[AWAY + e] = FAR


def clear_list(z: Buffer) -> None:
    """Clear the list of events before a step."""
    for e in range(NUMBER_OF_EVENTS):
        z[LISTED], z[ENTRIES + e] = 0.0, -1.0


def size_of_event(z: Buffer, e: int, h: float) -> float:
    """Return the size to which errors of a watched number over a step h are relative."""
    at = WATCHED + EVENT_SIDES[e]
    return max(z[LARGEST + e], max(abs(z[at]), max(abs(z[at + ROW]) * h, abs(z[at + 2 * ROW]) * h * h)))


def excess_of_events(z: Buffer, h: float) -> float:
    """Return the largest estimated error of watched numbers over their sizes, so that zeros are found in time."""
    n, worst = int(z[ORDER]), 0.0
    power = substeps.power_of(h, n - 1)
    for e in range(NUMBER_OF_EVENTS):
        at = WATCHED + EVENT_SIDES[e]
        before, last = abs(z[at + (n - 1) * ROW]), abs(z[at + n * ROW])
        size = size_of_event(z, e, h)
        if size > 0.0:
            worst = max(worst, max(before, last * h) * power / size)
    return worst


def round_off_of(z: Buffer, e: int) -> float:
    """Return how far from zero round-off may take a watched number at its zero.

    Just after a corner the error of the corner's time is added: where |x| turns, x may have passed zero by as much.
    """
    at, late = WATCHED + EVENT_SIDES[e], TOUCHED * abs(z[TIME])
    for i in range(NUMBER_OF_SIDES):
        if OF_EVENT[i] < 0 and z[ON + i] > 0.0:
            late = max(late, AT_CORNER * (z[TIME] - z[STARTS]))
    return TOUCHED * max(z[LARGEST + e], abs(z[at])) + late * abs(z[at + ROW])


def turns_at_corner(z: Buffer, e: int) -> bool:
    """Return whether a watched number was zero at the corner just passed, and moves away, as |x| at the zero of x.

    By the error of the last series x may already be a little beyond its zero.
    """
    at, turns = WATCHED + EVENT_SIDES[e], False
    for i in range(WATCHED, WATCHED + NUMBER_OF_SIDES):
        if i != at and z[FLIPS + i - WATCHED] > 0.0:
            apart, both = abs(z[at] * z[i + ROW] - z[i] * z[at + ROW]), abs(z[i] * z[at + ROW])
            is_soon = bool(abs(z[i]) <= TOGETHER * z[driven.STEP_SIZE] * abs(z[i + ROW]))
            turns |= is_soon and bool(apart < TOGETHER * both) and bool(z[at] * z[at + ROW] > 0.0)
    return turns


def side_that_counts(z: Buffer, i: int) -> float:
    """Return the side of zero to which a watched number goes by more than round-off; 0 where it stays at zero."""
    n, at = int(z[ORDER]), WATCHED + i
    t = leaves_band(z, at, ROW, n, z[driven.STEP_SIZE], round_off_of(z, OF_EVENT[i]))
    return math.copysign(1.0, polynomial(z, at, ROW, n, t)) if t <= z[driven.STEP_SIZE] else 0.0


def root_of_event(z: Buffer, i: int, h: float) -> float:
    """Return the first zero in (0, h] of a watched number, after it has left the band of round-off at zero; or 2 h."""
    n, at = int(z[ORDER]), WATCHED + i
    return first_root(z, at, ROW, n, leaves_band(z, at, ROW, n, h, round_off_of(z, OF_EVENT[i])), h, 0.0)


def reach_to_touches(z: Buffer, h: float, reach: float) -> float:
    """Return the reach, cut a little beyond the first touch of zero by a watched number, and note when that is."""
    n, soon = int(z[ORDER]), AT_ONCE * h
    for e in range(NUMBER_OF_EVENTS):
        i = EVENT_SIDES[e]
        begin_at = leaves_band(z, WATCHED + i, ROW, n, reach, round_off_of(z, e))
        touch = first_touch(z, WATCHED + i, ROW, n, begin_at, reach, z[SIDES + i], TOUCHING)
        if reach < h and touch > reach:  # the zero of another number may end the series just before
            begin_at = max(begin_at, reach - soon)
            touch = first_touch(z, WATCHED + i, ROW, n, begin_at, reach + soon, z[SIDES + i], TOUCHING)
        z[TOUCHES + e] = min(touch, reach) if touch <= reach + soon else 2.0 * h
        reach = min(reach, touch + formula_ends.BEYOND * h)
    return reach


def list_event(z: Buffer, e: int, t: float, kind: float, anew: bool) -> None:
    """List a zero of event e at time t and count it, if its kind counts; not anew: correct the kind of its last zero.

    A zero beyond the end of the list is counted but not stored; the step is then refused.
    """
    entry, was, counts = int(z[ENTRIES + e]), z[COUNTED + e] != 0.0 and not anew, abs(kind) == 1.0
    if anew or (entry < 0 and counts and not was):  # else it is on an earlier step's list
        entry = int(z[LISTED])
        z[LISTED] += 1.0
        z[ENTRIES + e] = entry
    if counts and not was:
        if z[COUNTS + e] == 0.0:
            z[EARLIEST + e] = t
        z[COUNTS + e] += 1.0
        z[TIMES_BEFORE + e], z[TIMES + e] = z[TIMES + e], t
    elif was and not counts:
        z[COUNTS + e] -= 1.0
        z[TIMES + e] = z[TIMES_BEFORE + e]
    z[COUNTED + e] = 1.0 if counts else 0.0
    if 0 <= entry < MOST_LISTED:
        at = LIST + 3 * entry
        z[at], z[at + 1], z[at + 2] = e, t, kind


def note_events(z: Buffer, ended: bool) -> None:
    """Note on which side of zero each watched number is in this series, and list its zeros that are new.

    ended: whether the last series was followed to its end, where a watched number may have been zero. Round-off may
    take a number that touches zero, or crosses it slowly, to and fro. Until it is further away than round-off all this
    is one zero, whose kind follows from the sides before and after.
    """
    n, begun, reach, soon = int(z[ORDER]), z[BEGUN], z[REACH], AT_ONCE * z[driven.STEP_SIZE]
    for e in range(NUMBER_OF_EVENTS):
        at = WATCHED + EVENT_SIDES[e]
        side, before, slope = z[SIDES + EVENT_SIDES[e]], z[NOTED + e], z[at + ROW]
        least = round_off_of(z, e)
        middle, near, touch = abs(polynomial(z, at, ROW, n, 0.5 * reach)), z[AWAY + e] < least, z[LAST_TOUCHES + e]
        if before == 0.0:
            happens = 2.0 * abs(z[at]) <= TOUCHED * abs(z[TIME] * slope)  # as sin(pi*t) at t = 1
            t = leaves_band(z, at, ROW, n, reach, least)
            origin = -side if t <= reach and side * polynomial(z, at, ROW, n, -t) < 0.0 else side
        else:
            touched = 0.0 < touch <= begun + max(soon, leaves_band(z, at, ROW, n, reach, least))  # or as inputs change
            happens = side != before or touched or (ended and (abs(z[at]) <= least or turns_at_corner(z, e)))
            origin = z[ORIGINS + e] if near else before
        if happens:
            t = touch if side == before and touch > 0.0 else begun
            asked = DIRECTIONS[e] == 0.0 or DIRECTIONS[e] == side
            kind = TOUCH if side == origin else side if asked else NOT_ASKED
            list_event(z, e, t, kind, not near)
        z[AWAY + e] = middle if happens else max(z[AWAY + e], middle)
        z[NOTED + e], z[ORIGINS + e], z[LARGEST + e] = side, origin, max(z[LARGEST + e], max(abs(z[at]), middle))
        is_new = (soon if happens else 0.0) < z[TOUCHES + e] <= reach
        z[LAST_TOUCHES + e] = begun + z[TOUCHES + e] if is_new else 0.0
