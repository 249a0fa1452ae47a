"""Events of formulas: when what they watch comes to zero, in templates that `formula_models.make_formulas` binds.

A series of the motion has the numbers that events watch beside its states, and ends where one of them comes to zero, so
that it changes side where the next series begins.
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
"""Of each event: the side that was noted last; how often it happened, when at last, before that, and first; how long
after a series' begin it touches zero, and when it did in the last series; the largest that it has been, how far it went
since it came to zero, from which side that was, where this stands on the list and whether it counted."""
TOUCH, NOT_ASKED = 0.0, 2.0
"""What is watched comes to zero and goes back, or goes on in a direction that is not asked for; else 1 or -1."""
FAR = 1e300
"""How far what has not come to zero yet counts as away: finite, as all numbers of a saved state are."""
TOUCHED = 1e-15
"""The part which round-off makes of what touches zero, over the largest that it has been and what it is by the time."""
AT_ONCE = 1e-9
"""How far apart, as a part of a series' step, a touch of zero and where the series begins may be and still be one time.
A touch is found as a zero of the slope, which round-off moves by far less.
"""
TOGETHER = 0.01
"""The part by which two times since zeros differ where they are one, and how long that is at most, over a series' step:
what the series before was off. What jumps over zero was there at no time."""

# What templates are bound to, see `formulas`.
OF_EVENT: tuple[int, ...] = ()
EVENT_SIDES: tuple[int, ...] = (0,)
DIRECTIONS: tuple[float, ...] = (0.0,)
NUMBER_OF_EVENTS = NOTED = COUNTS = TIMES = TIMES_BEFORE = EARLIEST = TOUCHES = LAST_TOUCHES = LARGEST = 0
AWAY = ORIGINS = ENTRIES = COUNTED = LISTED = LIST = 0
ORDER = TIME = STARTS = BEGUN = REACH = WATCHED = NUMBER_OF_SIDES = SIDES = ON = FLIPS = ROW = 0


def set_up_events(z: Buffer) -> None:
    """Set what is known of events before the run."""
    for e in range(NUMBER_OF_EVENTS):
        z[LISTED] = z[NOTED + e] = z[COUNTS + e] = z[LAST_TOUCHES + e] = z[LARGEST + e] = 0.0
        z[TIMES + e] = z[EARLIEST + e] = z[STARTS]
        z[AWAY + e] = FAR


def clear_list(z: Buffer) -> None:
    """Begin the list of another step."""
    for e in range(NUMBER_OF_EVENTS):
        z[LISTED], z[ENTRIES + e] = 0.0, -1.0


def size_of_event(z: Buffer, e: int, h: float) -> float:
    """Return what errors of what an event watches over a step h are relative to."""
    at = WATCHED + EVENT_SIDES[e]
    return max(z[LARGEST + e], max(abs(z[at]), max(abs(z[at + ROW]) * h, abs(z[at + 2 * ROW]) * h * h)))


def excess_of_events(z: Buffer, h: float) -> float:
    """Return the estimated error of what events watch over its size, so that it comes to zero when its series does."""
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
    """Return how far from zero round-off may take what an event watches where it is zero.

    At a corner that is what it is by the time to which the corner is found: where |x| turns, x is passed by so much.
    """
    at, late = WATCHED + EVENT_SIDES[e], TOUCHED * abs(z[TIME])
    for i in range(NUMBER_OF_SIDES):
        if OF_EVENT[i] < 0 and z[ON + i] > 0.0:
            late = max(late, AT_CORNER * (z[TIME] - z[STARTS]))
    return TOUCHED * max(z[LARGEST + e], abs(z[at])) + late * abs(z[at + ROW])


def turns_at_corner(z: Buffer, e: int) -> bool:
    """Return whether what an event watches was zero at a corner that has just been passed, and goes away from zero.

    As |x| does, where the series before was off by so much that x has changed its sign already.
    """
    at, turns = WATCHED + EVENT_SIDES[e], False
    for i in range(WATCHED, WATCHED + NUMBER_OF_SIDES):
        if i != at and z[FLIPS + i - WATCHED] > 0.0:
            apart, both = abs(z[at] * z[i + ROW] - z[i] * z[at + ROW]), abs(z[i] * z[at + ROW])
            is_soon = bool(abs(z[i]) <= TOGETHER * z[driven.STEP_SIZE] * abs(z[i + ROW]))
            turns |= is_soon and bool(apart < TOGETHER * both) and bool(z[at] * z[at + ROW] > 0.0)
    return turns


def side_that_counts(z: Buffer, i: int) -> float:
    """Return the side of zero to which what an event watches goes, further than round-off; 0 where it stays."""
    n, at = int(z[ORDER]), WATCHED + i
    t = leaves_band(z, at, ROW, n, z[driven.STEP_SIZE], round_off_of(z, OF_EVENT[i]))
    return math.copysign(1.0, polynomial(z, at, ROW, n, t)) if t <= z[driven.STEP_SIZE] else 0.0


def root_of_event(z: Buffer, i: int, h: float) -> float:
    """Return the first root in (0, h] of what an event watches, beyond where round-off may have it at zero; or 2 h."""
    n, at = int(z[ORDER]), WATCHED + i
    return first_root(z, at, ROW, n, leaves_band(z, at, ROW, n, h, round_off_of(z, OF_EVENT[i])), h, 0.0)


def reach_to_touches(z: Buffer, h: float, reach: float) -> float:
    """Return how far series reach, a little beyond the first touch, and keep when that is."""
    n, soon = int(z[ORDER]), AT_ONCE * h
    for e in range(NUMBER_OF_EVENTS):
        i = EVENT_SIDES[e]
        begin_at = leaves_band(z, WATCHED + i, ROW, n, reach, round_off_of(z, e))
        touch = first_touch(z, WATCHED + i, ROW, n, begin_at, reach, z[SIDES + i], TOUCHING)
        if reach < h and touch > reach:  # a root of something else may end the series just before
            begin_at = max(begin_at, reach - soon)
            touch = first_touch(z, WATCHED + i, ROW, n, begin_at, reach + soon, z[SIDES + i], TOUCHING)
        z[TOUCHES + e] = min(touch, reach) if touch <= reach + soon else 2.0 * h
        reach = min(reach, touch + formula_ends.BEYOND * h)
    return reach


def list_event(z: Buffer, e: int, t: float, kind: float, anew: bool) -> None:
    """Put an event on the step's list and count it; anew: or else the last one of e turns out to be of this kind.

    Its number on the list may be beyond the end, which refuses the step.
    """
    entry, was, counts = int(z[ENTRIES + e]), z[COUNTED + e] != 0.0 and not anew, abs(kind) == 1.0
    if anew or (entry < 0 and counts and not was):  # else it stands on an earlier step's list
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
    """Note on which side of zero the series leads what each event watches, and list what is new.

    A series ends where that comes to zero, so that it changes side where the next one begins; ended: whether the last
    one did not end before. Round-off may take what touches zero, or crosses it slowly, to and fro: as long as it is no
    further away than that, all this is one event, of which the sides before and after tell the kind.
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
