"""Members of an ensemble in compiled code: what each begins with, what drives its ports, and what is kept of it."""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..compile.decorator import kernel
from ..types import Array, Buffer, Indices

Control = Callable[[float, Array, Array, Array, Array], None]
"""A controller: of the time and the outputs it sets its state and the inputs; it may be given noise."""


class Members(NamedTuple):
    """What members have in common, and what they have of their own.

    base (SIZE,): what a buffer holds before a member's values (m, p) are put to places (p,). kept (K,): places of the
    outputs. rows (m, n + 1, K) or (m, 1, K): outputs at each point, or the last. ends (m, 2): what `initialize`
    returned, or -1 - the place among the ports of an input that is not finite; and the number of steps done. noted (m,
    E): what stands at the places after (E,) when a member's run is over.
    """

    base: Array
    places: Indices
    values: Array
    kept: Indices
    rows: Array
    ends: Indices
    after: Indices
    noted: Array


class Driving(NamedTuple):
    """What drives their ports: tables, and a controller after these.

    ports (P,): their places. rates (P or 0,): those of their derivatives. time (n + 1,): the communication points, s.
    lengths (L,): s, of pieces of the run in which inputs are held, or linear with slopes (L, P); given (L, P): those of
    tables, NaN where there are none. counts (1 or m, n + 1): how many pieces lie before each point. start (k,): state
    of the controller. noise (m, n, q).
    """

    ports: Indices
    rates: Indices
    time: Array
    lengths: Array
    counts: Indices
    given: Array
    slopes: Array
    start: Array
    noise: Array


class Room(NamedTuple):
    """Room for what a controller takes of one member at a time: outputs (K,), inputs (P,)."""

    outputs: Array
    inputs: Array


class Run(NamedTuple):
    """A run of an ensemble: what drives its members and what is kept of them."""

    control: Control
    members: Members
    driving: Driving
    room: Room


@kernel
def pieces_before(driving: Driving, i: int, k: int) -> int:
    """Return how many pieces lie before point k of a member's run."""
    return driving.counts[min(i, len(driving.counts) - 1), k]  # type: ignore[no-any-return]


@kernel
def begin(z: Buffer, state: Array, i: int, size: int, run: Run) -> None:
    """Fill a buffer, so many numbers, with what a member has before `initialize`; and its controller's state."""
    members, driving = run.members, run.driving
    for j in range(size):
        z[j] = members.base[j]
    for j in range(len(members.places)):
        z[members.places[j]] = members.values[i, j]
    first = pieces_before(driving, i, 0)
    for j in range(len(driving.ports)):
        if not math.isnan(driving.given[first, j]):
            z[driving.ports[j]] = driving.given[first, j]
    for j in range(len(driving.start)):
        state[j] = driving.start[j]
    members.ends[i, 1] = 0


@kernel
def record(z: Buffer, i: int, k: int, run: Run) -> None:
    """Keep a member's outputs at point k, of which the last is that after all steps."""
    members = run.members
    points = members.rows.shape[1]
    members.ends[i, 1] = k
    if points > 1 or k == len(run.driving.time) - 1:
        for j in range(len(members.kept)):
            members.rows[i, k if points > 1 else 0, j] = z[members.kept[j]]


@kernel
def note(z: Buffer, i: int, run: Run) -> None:
    """Note what stands in a buffer when a member's run is over."""
    members = run.members
    for j in range(len(members.after)):
        members.noted[i, j] = z[members.after[j]]


@kernel
def drive(z: Buffer, state: Array, i: int, k: int, piece: int, run: Run) -> bool:
    """Set a member's ports for a piece of the step after point k; return whether what they are given is finite."""
    control, members, driving, room = run
    ports, inputs, at_point = driving.ports, room.inputs, piece == pieces_before(driving, i, k)
    for j in range(len(ports)):
        inputs[j] = driving.given[piece, j]
        if math.isnan(inputs[j]):  # goes on as the last step has left it
            inputs[j] = z[ports[j]]
    if len(ports) > 0 and at_point:
        for j in range(len(members.kept)):
            room.outputs[j] = z[members.kept[j]]
        control(driving.time[k], room.outputs, state, inputs, driving.noise[i, k])
    for j in range(len(ports) - 1, -1, -1):
        z[ports[j]] = inputs[j]
        if len(driving.rates) > 0:
            z[driving.rates[j]] = driving.slopes[piece, j]
        if not math.isfinite(inputs[j]):
            members.ends[i, 0] = -1 - j
    return bool(members.ends[i, 0] == 0)
