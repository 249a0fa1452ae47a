"""Runs members of an ensemble side by side: each has a buffer, and advances until it needs work that is done in lanes.

These functions are templates, see `shell.bind`: a model's own functions are their globals. A member waits until the
model's code for lanes does the next piece of its work, for several buffers at once.
"""

from typing import Any

from ..buffer import OK, STEP_REJECTED
from ..types import Array, Buffer
from . import members as one, shell

MARKS = 8
MEMBER, POINT, PIECE, STATUS = range(4)
"""The marks of a buffer: its member, or -1; the communication point and the piece of the run that it has reached; and
the status of the step, which is `PENDING` while it waits."""
PENDING = -1

_missing: Any = None
initialize: shell.Entry = _missing
go_on: shell.Step = _missing
"""Advances a buffer by a step h > 0, s, or as far as it can without lanes; returns a status."""
WORK = 0
"""How many numbers a buffer has before its work space, which needs no copy: it is written before it is read."""


def run_on(z: Buffer, state: Array, mark: Array, run: one.Run) -> bool:
    """Continue a run until a step is pending or the run is over; return whether a step is pending."""
    i, k, piece, status = int(mark[MEMBER]), int(mark[POINT]), int(mark[PIECE]), int(mark[STATUS])
    driving = run.driving
    while status == OK:
        piece += 1
        if piece == one.pieces_before(driving, i, k + 1):
            k += 1
            one.record(z, i, k, run)
        if k == len(driving.time) - 1 or not one.drive(z, state, i, k, piece, run):
            break
        h = driving.lengths[piece]
        status = go_on(z, h) if h > 0.0 else STEP_REJECTED
    mark[POINT], mark[PIECE], mark[STATUS] = k, piece, status
    if status != PENDING:
        one.note(z, i, run)
    return status == PENDING


def begin_next(z: Buffer, state: Array, mark: Array, i: int, run: one.Run) -> int:
    """Begin members in a buffer, from number i on, until one has to wait; return the number of the member after it.

    Members before it have run to their ends, or could not begin. If none has to wait, the buffer's member is -1.
    """
    members = run.members
    while i < len(members.values):
        one.begin(z, state, i, WORK, run)
        members.ends[i, 0] = initialize(z)
        mark[MEMBER], mark[POINT], mark[PIECE] = i, 0.0, one.pieces_before(run.driving, i, 0) - 1
        mark[STATUS] = STEP_REJECTED
        if members.ends[i, 0] == 0:
            one.record(z, i, 0, run)
            mark[STATUS] = OK
        i += 1
        if run_on(z, state, mark, run):
            return i
    mark[MEMBER] = -1.0
    return i
