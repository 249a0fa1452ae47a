"""Models of a body under any of the scene's loads, and of one with two equal moments under those without damping.

`LOADED_TAYLOR`: by Taylor series inside a communication step. The plan sets `tolerance` and `span` (see
`body.memory.SETTINGS`), the `order` of the series, and the `substep` that is tried first unless it is 0.
Inputs may change within a step: see `body.driven`. While they are held and steps are short, a series is evaluated for
many steps: see `integrators.dense_output`.

`LOADED_SPLITTING`: two equal moments under loads that depend on the attitude alone, such as those of heavy tops, by
splitting: the loads' impulses between exact flows of the free body.
"""

import math

from ..body import driven, lanes, memory, outputs, shell
from ..buffer import NO_TOP, OK, RESONANT, STEP_REJECTED, places, with_work_space
from ..buffer_access import copy_numbers, pair_at, put_pair_at
from ..compile.decorator import kernel
from ..integrators import dense_output as dense, interpolation, splitting, taylor, taylor_coefficients as series
from ..integrators.substeps import LONGEST_STEP, Method, Room, substeps_in
from ..mechanics.equations_of_motion import ROTATION, WHOLE_STATE
from ..rotations.vec3 import is_nonzero
from ..types import Array, Buffer, Indices

ORDERS = range(4, series.MAX_ORDER + 1, 2)
_KEPT = {"kept_before": dense.SERIES_SIZE, "held_inputs": driven.NUMBER_OF_INPUTS}
_LOADED_TAYLOR_LAYOUT = with_work_space(driven.DRIVEN | {"order": 1} | dense.SERIES_BLOCKS | _KEPT, series.WORK)
_AT = _LOADED_TAYLOR_LAYOUT.at
_SERIES = _AT.validity
"""The place of the series' blocks."""
REST = _AT.since
"""The place of the time left in a communication step, s, of a body in lanes without a series: `since` is unused."""
ROOM = Room(state=_AT.q, work=_AT.work, size=driven.STEP_SIZE)


@kernel
def _set_up_loaded_taylor(z: Buffer) -> int:
    z[driven.STEP_SIZE] = LONGEST_STEP  # the first series cuts it if it is too long
    if z[_AT.substep] > 0.0:  # if it is the whole step, no series over several steps is tried
        z[driven.STEP_SIZE] = z[_AT.substep]
    z[_SERIES], z[_AT.cool_down] = dense.NONE, 0.0
    driven.keep_inputs(z, _AT.held_inputs)
    return 0


@kernel
def _advance_loaded_taylor(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion cannot be followed."""
    return advance_by_series(z, h) if stands(z, h) else _advance_by_new_series(z, h)


@kernel(inline=False)
def go_on(z: Buffer, h: float) -> int:
    """Advance by h along the present series; return PENDING where it is not valid over the step."""
    return advance_by_series(z, h) if stands(z, h) else lanes.PENDING


@kernel
def advance_by_series(z: Buffer, h: float) -> int:
    """Advance by h along the present series."""
    driven.keep(z)
    since = pair_at(z, _AT.since)
    dense.follow(z, ROOM, _SERIES, int(z[_AT.order]), h)
    status = driven.finish_steadily(z, int(z[_AT.extent]), h)
    if status != OK:
        put_pair_at(z, _AT.since, since)
    return status


@kernel(inline=False)
def _advance_by_new_series(z: Buffer, h: float) -> int:
    """Advance by h by new series, or by substeps."""
    keep_all(z)
    body, loads = memory.body_of(z), driven.load_polynomial_of(z)
    method, rest = Method(driven.part_to_integrate(z, body, loads), int(z[_AT.order]), z[_AT.tolerance], z[_AT.span]), h
    if is_series_tried(z, h):
        rest = dense.follow_series(z, ROOM, _SERIES, method, h, body, loads)
    status = OK
    if rest > 0.0:
        z[_SERIES] = dense.NONE
        z[_AT.cool_down] -= 1.0
        status = taylor.taylor_advance(z, ROOM, method, rest, body, loads)
    return finished(z, driven.finish(z, method.n, h, status, body, loads))


@kernel(inline=False)
def run_through(z: Buffer, time: Array, at: Indices, rows: Array, states: Array) -> int:
    """Run over all times after the first, s, with substeps of their own; return the number of the last point reached.

    Outputs between two substeps are interpolated: see `integrators.interpolation`. at (K,): places of the numbers that
    are kept; rows (n + 1, K) or (1, K): these at each point, or at the last; states (n, ROTATION): work space. Inputs
    are constant. Where a force turns with the body, substeps end at all points.
    """
    body, loads, points = memory.body_of(z), driven.load_polynomial_of(z), len(states)
    method = Method(driven.part_to_integrate(z, body, loads), int(z[_AT.order]), z[_AT.tolerance], z[_AT.span])
    at_once = 1 if method.n == WHOLE_STATE else points
    interpolation.begin_points(states)
    for k in range(0, points, at_once):
        part, end = interpolation.Points(time[k : k + at_once + 1], states[k : k + at_once]), k + at_once
        taylor.taylor_advance(z, ROOM, method, time[end] - time[k], body, loads, part)
        reached = show(z, method.n, time, at, rows, states, k, end)
        if reached < end:
            return reached
    return points


@kernel(inline=False)
def show(z: Buffer, n: int, time: Array, at: Indices, rows: Array, states: Array, first: int, end: int) -> int:
    """Refresh and keep the outputs at the points after `first` up to `end`; return the last one with a finite state."""
    every, moves = len(rows) > 1, memory.needs_translation(z)
    for k in range(first, end):
        for i in range(ROTATION):
            z[memory.STATE_START + i] = states[k, i]
        if moves:
            driven.translate_steadily(z, n, time[k + 1] - time[k])
        if not memory.is_finite(z):
            return k
        outputs.outputs(z)
        if every or k + 1 == len(states):
            for j in range(len(at)):
                rows[k + 1 if every else 0, j] = z[at[j]]
    return end


@kernel
def keep_all(z: Buffer) -> None:
    """Keep the numbers that `finished` restores where a step is rejected."""
    driven.keep(z)
    copy_numbers(z, _SERIES, _AT.kept_before, dense.SERIES_SIZE)


@kernel
def finished(z: Buffer, status: int) -> int:
    """Return the status of a step for which a series was made; if rejected, restore the one before, which is stale."""
    if status == OK:
        driven.keep_inputs(z, _AT.held_inputs)
        return OK
    copy_numbers(z, _AT.kept_before, _SERIES, dense.SERIES_SIZE)
    if z[_SERIES] == dense.VALID:
        z[_SERIES] = dense.STALE
    return status


@kernel
def stands(z: Buffer, h: float) -> bool:
    """Return whether the present series is valid over the step."""
    return bool(dense.reaches_over(z, _SERIES, h) and driven.holds_inputs(z, _AT.held_inputs))


@kernel
def is_series_tried(z: Buffer, h: float) -> bool:
    """Return whether to try a series: whether one is likely to reach over further steps like this one."""
    steady = driven.holds_inputs(z, _AT.held_inputs) and z[_AT.tolerance] < math.inf
    return bool(steady and z[_AT.cool_down] <= 0.0 and h * dense.LEAST_REACH <= z[driven.STEP_SIZE])


@kernel(inline=False)
def begins_series(z: Buffer, h: float, method: Method) -> bool:
    """Begin a step: go to the end of the present series; return whether a new one from there on may pay."""
    keep_all(z)
    is_tried, rest = is_series_tried(z, h), h
    if is_tried and z[_SERIES] == dense.VALID:
        rest -= dense.follow_to_end(z, ROOM, _SERIES, method.order)
    elif is_tried:
        q, omega = memory.rotation_of(z)
        is_tried = dense.may_pay(method, q, omega, memory.body_of(z), memory.loads_of(z), h)
        if not is_tried:
            dense.give_up(z, ROOM, _SERIES, z[driven.STEP_SIZE])
    z[REST] = rest
    return is_tried


def _lanes() -> shell.Lanes:
    from .loaded_runs_in_lanes import LANES  # slow to import

    return LANES


LOADED_TAYLOR = shell.make_model(
    "LOADED_TAYLOR", _LOADED_TAYLOR_LAYOUT, _set_up_loaded_taylor, _advance_loaded_taylor, ORDERS=ORDERS, lanes=_lanes,
    run_through=run_through,
)  # fmt: skip


SPLITTING_ORDERS = (2, 4, 6)
_SPLITTING_LAYOUT = places(memory.COMMON | {"order": 1})
_SPLITTING = _SPLITTING_LAYOUT.at


@kernel
def _set_up_loaded_splitting(z: Buffer) -> int:
    body = memory.body_of(z)
    if not splitting.is_symmetric_top(body.inertia) or is_nonzero(body.damping_b) or memory.has_unknown_load(z):
        return NO_TOP
    if z[_SPLITTING.substep] > 0.5 * splitting.resonant_step(body.inertia, memory.motion_of(z).omega_b):
        return RESONANT
    return 0


@kernel
def _advance_loaded_splitting(z: Buffer, h: float) -> int:
    """Advance by h at constant inputs; reject the step and change nothing where the result is not finite."""
    n = substeps_in(h, z[_SPLITTING.substep])
    if n == 0:
        return STEP_REJECTED
    part = h / n
    body, loads, motion, order = memory.body_of(z), memory.loads_of(z), memory.motion_of(z), z[_SPLITTING.order]
    if order == 2.0:
        motion = splitting.strang_steps(motion, part, n, body, loads)
    elif order == 4.0:
        motion = splitting.rkn4_steps(motion, part, n, body, loads)
    else:
        motion = splitting.rkn6_steps(motion, part, n, body, loads)
    return shell.commit_motion(z, motion)


LOADED_SPLITTING = shell.make_model(
    "LOADED_SPLITTING", _SPLITTING_LAYOUT, _set_up_loaded_splitting, _advance_loaded_splitting, ORDERS=SPLITTING_ORDERS
)
