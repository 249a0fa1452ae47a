"""Members of an ensemble in compiled code: how they start, the inputs at their ports, and the outputs that are kept."""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..compile.decorator import kernel
from ..types import Array, Buffer, Indices

Control = Callable[[float, Array, Array, Array, Array], None]
"""A controller f(t, outputs, state, inputs, noise): it sets its state and the inputs from time, outputs and noise."""


class Members(NamedTuple):
    """Members of an ensemble: the numbers that they share, and those of each.

    base (SIZE,): a filled buffer. places (p,), values (m, p): where a member's own numbers are put in it, and these
    numbers. kept (K,): places of the outputs. rows (m, n + 1, K) or (m, 1, K): outputs at each point, or at the last.
    ends (m, 2): the value that `initialize` returned, or -1 - j if the j-th port's input is not finite; and the number
    of steps done. noted (m, E): the numbers at the places `after` (E,) at the end of a member's run.
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
    """The inputs at members' ports: from tables, then from a controller.

    ports (P,): their places. rates (P or 0,): places of their time derivatives. time (n + 1,): the communication
    points, s. lengths (L,): of the pieces of the run, s, in which inputs are held, or linear with slopes (L, P).
    given (L, P): inputs from tables at the beginning of each piece, NaN where no table gives one. counts (1 or m,
    n + 1): how many pieces lie before each point. start (k,): the controller's state at the start. noise (m, n, q): the
    controller's noise at each point but the last.
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
    """Work space: outputs (K,), inputs (P,) for the controller, of one member; states (lanes or 1, n, ROTATION).

    n: the number of points of runs whose outputs are interpolated, otherwise 0.
    """

    outputs: Array
    inputs: Array
    states: Array


class Run(NamedTuple):
    """A run of an ensemble: its controller, its members, their inputs, and work space."""

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
    """Set the first `size` numbers of a buffer to a member's before `initialize`, and its controller's state."""
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
    """Note that k steps are done, and keep the outputs at this point if there is a row for it."""
    members = run.members
    points = members.rows.shape[1]
    members.ends[i, 1] = k
    if points > 1 or k == len(run.driving.time) - 1:
        for j in range(len(members.kept)):
            members.rows[i, k if points > 1 else 0, j] = z[members.kept[j]]


@kernel
def note(z: Buffer, i: int, run: Run) -> None:
    """Copy the numbers that are noted at the end of a member's run from its buffer."""
    members = run.members
    for j in range(len(members.after)):
        members.noted[i, j] = z[members.after[j]]


@kernel
def drive(z: Buffer, state: Array, i: int, k: int, piece: int, run: Run) -> bool:
    """Set a member's ports for a piece of the step after point k; return whether all inputs are finite.

    The controller is called for the first piece only, at the point itself.
    """
    control, members, driving, room = run
    ports, inputs, at_point = driving.ports, room.inputs, piece == pieces_before(driving, i, k)
    for j in range(len(ports)):
        inputs[j] = driving.given[piece, j]
        if math.isnan(inputs[j]):  # no table gives it: it keeps its value after the last step
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
