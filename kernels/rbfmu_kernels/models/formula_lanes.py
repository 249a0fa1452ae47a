"""Members of an ensemble with formulas side by side in lanes, in templates for `formulas.make_lanes`.

Making series takes most of the time, and is the same work for all bodies: it is done for numbers of several at once.
All else, a step's size, corners, events, and what serves communication points, each has in a buffer of its own, by the
code of single runs. A lane goes on with its body's run, whatever the others' time, until that needs the next series.
"""

from collections.abc import Callable, Mapping
from typing import Any

from ..body import members as one
from ..body.members import Driving, Members, Room
from ..buffer import MAX_SUBSTEPS, OK, STEP_REJECTED
from ..compile.simd import eight_wide, four_wide, lane_at, put_lane_at, width_of
from ..types import Buffer

PENDING = -1
"""The status of a step that needs a series to go on."""
MARKS = 8
MEMBER, POINT, PIECE, REST, CREPT, TRIED, SETTLED = range(7)
"""What is known of a lane: its member, or -1; the communication point and the piece where that is; what is left of the
piece, s, and how often series crept in it and were made; whether the last one was settled."""

# What templates are bound to, see `formulas`.
_missing: Any = None
initialize = wide_constants = wide_first = wide_further = _missing
prepare = settle = begun = needs_series = follow = clear_list = reaches_over = evaluate = _missing
keep_step = end_step = start_step = go_on = run_on = next_member = put_head = put_starts = take_series = make_series = (
    run
) = _missing
INPUTS: tuple[int, ...] = ()
RATES: tuple[int, ...] = ()
RATES_2: tuple[int, ...] = ()
STATES: tuple[int, ...] = ()
NUMBER_OF_INPUTS = NUMBER_OF_SIDES = NUMBER_TOUCHING = NUMBER_OF_EVENTS = SIDES = ORDER = WORK = ROWS = ROW = 0
WIDE_ROW = 0


def put_head_in_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Give a lane all numbers of a body but its work space."""
    for i in range(WORK):
        put_lane_at(c, i, lane, z[i])


def put_starts_in_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Give a lane what changes from series to series: states, inputs, sides."""
    for i in range(len(STATES)):
        put_lane_at(c, ROWS + i, lane, z[ROWS + i])
    for i in range(NUMBER_OF_INPUTS):
        put_lane_at(c, INPUTS[i], lane, z[INPUTS[i]])
        put_lane_at(c, RATES[i], lane, z[RATES[i]])
        put_lane_at(c, RATES_2[i], lane, z[RATES_2[i]])
    for i in range(NUMBER_OF_SIDES):
        put_lane_at(c, SIDES + i, lane, z[SIDES + i])


def take_series_of_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Take a body's series, of its states and of what ends them, out of a lane."""
    for k in range(int(z[ORDER]) + 1):
        for i in range(len(STATES) + NUMBER_OF_SIDES + 2 * NUMBER_TOUCHING):
            z[ROWS + k * ROW + i] = lane_at(c, ROWS + k * WIDE_ROW + i, lane)


def make_series_of_lanes(c: Buffer, buffers: Any, marks: Any) -> None:
    """Make the series of all lanes, again where sides change: those of the others come to the same bits."""
    n = 0
    for lane in range(width_of(c)):
        z = buffers[lane]
        marks[lane, SETTLED] = 1.0
        if marks[lane, MEMBER] >= 0.0:
            n = int(z[ORDER])
            prepare(z)
            marks[lane, SETTLED] = 0.0
    for _ in range(3 * NUMBER_OF_SIDES + 1):
        for lane in range(width_of(c)):
            if marks[lane, SETTLED] == 0.0:
                put_starts(buffers[lane], c, lane)
        wide_constants(c, WORK)
        wide_first(c, WORK)
        for k in range(1, n):
            wide_further(c, WORK, k)
        all_settled = True
        for lane in range(width_of(c)):
            if marks[lane, SETTLED] == 0.0:
                take_series(buffers[lane], c, lane)
                marks[lane, SETTLED] = 1.0 if settle(buffers[lane]) else 0.0
                all_settled = all_settled and marks[lane, SETTLED] != 0.0
        if all_settled:
            break


def go_on_with_step(z: Buffer, mark: Any, h: float) -> int:
    """Go on with a step until it is done, or refused, or needs a series."""
    while not needs_series(z):
        status, mark[REST], crept = follow(z, h, mark[REST], int(mark[CREPT]))
        mark[CREPT] = crept
        if status != PENDING:
            return end_step(z, h, mark[REST], status)  # type: ignore[no-any-return]
    mark[TRIED] += 1.0
    return PENDING if mark[TRIED] <= MAX_SUBSTEPS else end_step(z, h, mark[REST], STEP_REJECTED)


def start_a_step(z: Buffer, mark: Any, h: float) -> int:
    """Begin a step, and go on with it."""
    if not h > 0.0:
        return STEP_REJECTED
    if NUMBER_OF_EVENTS:
        clear_list(z)
    if reaches_over(z, h):
        return evaluate(z, h)  # type: ignore[no-any-return]
    keep_step(z)
    mark[REST], mark[CREPT], mark[TRIED] = h, 0.0, 0.0
    return go_on(z, mark, h)  # type: ignore[no-any-return]


def run_on_with_member(
    z: Buffer, state: Any, mark: Any, status: int, control: Any, members: Members, driving: Driving, room: Room
) -> bool:
    """Go on with a run, whose step now has this status, until one is pending; return whether one is."""
    i, k, piece = int(mark[MEMBER]), int(mark[POINT]), int(mark[PIECE])
    steps = len(driving.time) - 1
    while status == OK:
        piece += 1
        if piece == one.pieces_before(driving, i, k + 1):
            k += 1
            one.record(z, i, k, steps, members)
        if k == steps or not one.drive(z, state, i, k, piece, control, members, driving, room):
            break
        status = start_step(z, mark, driving.lengths[piece])
    mark[POINT], mark[PIECE] = k, piece
    if status != PENDING:
        one.note(z, i, members)
    return status == PENDING


def begin_next_member(
    z: Buffer, state: Any, mark: Any, c: Buffer, lane: int, i: int, control: Any, members: Members, driving: Driving,
    room: Room,
) -> int:  # fmt: skip
    """Let a lane begin with the next member, from i on, that needs series; return the number of the one after it."""
    while i < len(members.values):
        one.begin(z, state, i, WORK, members, driving)  # the work space is written before it is read
        members.ends[i, 0] = initialize(z)
        mark[MEMBER], mark[POINT], mark[PIECE], status = i, 0.0, one.pieces_before(driving, i, 0) - 1, STEP_REJECTED
        if members.ends[i, 0] == 0:
            one.record(z, i, 0, len(driving.time) - 1, members)
            status = OK
        i += 1
        if run_on(z, state, mark, status, control, members, driving, room):
            put_head(z, c, lane)
            return i
    mark[MEMBER] = -1.0
    return i


def run_in_lanes(
    c: Buffer, control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any
) -> None:
    """Run all members, as many side by side as c is wide."""
    i, busy = 0, 0
    for lane in range(width_of(c)):
        i = next_member(buffers[lane], states[lane], marks[lane], c, lane, i, control, members, driving, room)
        busy += 1 if marks[lane, MEMBER] >= 0.0 else 0
    while busy > 0:
        make_series(c, buffers, marks)
        for lane in range(width_of(c)):
            z, state, mark = buffers[lane], states[lane], marks[lane]
            if mark[MEMBER] < 0.0:
                continue
            h = driving.lengths[int(mark[PIECE])]
            leads = begun(z, mark[SETTLED] != 0.0)
            status = go_on(z, mark, h) if leads else end_step(z, h, mark[REST], STEP_REJECTED)
            if not run_on(z, state, mark, status, control, members, driving, room):
                i = next_member(z, state, mark, c, lane, i, control, members, driving, room)
                busy -= 1 if mark[MEMBER] < 0.0 else 0


def run_in_four(
    control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any, scratch: Any
) -> None:
    """Run members of an ensemble, four side by side: see `body.members`.

    buffers (b, SIZE), states (b, k), marks (b, MARKS): room for as many members; scratch: for all lanes.
    """
    run(four_wide(scratch, 0), control, members, driving, room, buffers, states, marks)


def run_in_eight(
    control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any, scratch: Any
) -> None:
    """Do the same, eight side by side."""
    run(eight_wide(scratch, 0), control, members, driving, room, buffers, states, marks)


TEMPLATES: Mapping[str, Callable[..., Any]] = {
    "put_head": put_head_in_lane,
    "put_starts": put_starts_in_lane,
    "take_series": take_series_of_lane,
    "make_series": make_series_of_lanes,
    "go_on": go_on_with_step,
    "start_step": start_a_step,
    "run_on": run_on_with_member,
    "next_member": begin_next_member,
    "run": run_in_lanes,
    "run_in_four": run_in_four,
    "run_in_eight": run_in_eight,
}
"""In an order in which each is bound before those that call it."""
