"""Communication steps of `loaded_taylor` for many bodies at once, in the lanes of a vector: the bits are the same.

A lane takes one body after another. Bodies that differ in what is decided once for all lanes (`_kind`) do not share a
vector; those of a step that lanes do not know are taken alone.
"""

import math
from typing import Any

from ..body.driven import STEP_SIZE, finish_steadily, keep, keep_inputs, load_polynomial_of, part_to_integrate
from ..body.members import Driving, Members, Room, begin, drive, note, pieces_before, record
from ..body.memory import STATE_START, body_of
from ..buffer import OK, STEP_REJECTED, Layout
from ..compile.decorator import kernel
from ..compile.simd import eight_wide, four_wide, lane_at, put_lane_at, width_of
from ..integrators import rigid_body_state as state
from ..integrators import taylor_lanes as lanes
from ..integrators.dense_output import COOL_DOWN, COOL_DOWN_STEPS, LEAST_REACH, NONE, turning_of
from ..integrators.rigid_body_state import ROTATION, WHOLE_STATE
from ..integrators.substeps import Method
from ..integrators.taylor_coefficients import WORK, SpaceFixedLoads, known_torques, space_fixed_loads
from ..mechanics.equations_of_motion import angular_acceleration
from ..rotations.vec3 import is_nonzero
from ..types import Buffer, Matrix, Vec3
from .loaded import LOADED_TAYLOR, is_series_tried

_LAYOUT = Layout(LOADED_TAYLOR.BLOCKS, LOADED_TAYLOR.SIZE)
_TOLERANCE, _SPAN, _ORDER, _WORK = _LAYOUT.starts("tolerance", "span", "order", "work")
_SERIES, _HELD = _LAYOUT.starts("validity", "held_inputs")
initialize, step = LOADED_TAYLOR.initialize, LOADED_TAYLOR.step
WIDEST = 8
SCRATCH = WIDEST * (lanes.COLUMNS_SIZE + WORK)
"""The numbers of work space that lanes need, at a cache line."""
IN_STEP = True
"""All are driven in pieces of equal length, as they go on together."""
_PENDING = -1
"""The status of a body that is still to be advanced."""
_SURELY = 0.95
"""The part of the least reach that pays: where a series is likely to fall short of it, none is tried, lanes serve."""

Kind = tuple[int, int, float, float, bool, bool, bool]
"""How much of the state is integrated, the order, tolerance and span, whether a force fixed in a acts on an arm and a
torque fixed in a acts, whether the inertia is diagonal. The first is 0 where lanes do not serve."""


@kernel(inline=False)
def run_in_four(
    control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any, scratch: Any
) -> None:
    """Run members of an ensemble, four side by side: see `body.members`. The pieces of all are equally long.

    buffers (b, SIZE), states (b, k), marks (b, 1 or more): room for some members at a time; scratch: for all lanes.
    """
    c, s = four_wide(scratch, 0), four_wide(scratch, 4 * lanes.COLUMNS_SIZE)
    _run(control, members, driving, room, buffers, states, marks, c, s)


@kernel(inline=False)
def run_in_eight(
    control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any, scratch: Any
) -> None:
    """Do the same, eight side by side."""
    c, s = eight_wide(scratch, 0), eight_wide(scratch, 8 * lanes.COLUMNS_SIZE)
    _run(control, members, driving, room, buffers, states, marks, c, s)


@kernel
def _run(
    control: Any, members: Members, driving: Driving, room: Room, buffers: Any, states: Any, marks: Any, c: Buffer,
    s: Buffer,
) -> None:  # fmt: skip
    statuses, steps = marks[:, 0], len(driving.time) - 1
    for first in range(0, len(members.values), len(buffers)):
        count = min(len(buffers), len(members.values) - first)
        for i in range(count):
            begin(buffers[i], states[i], first + i, _WORK, members, driving)
            statuses[i] = members.ends[first + i, 0] = initialize(buffers[i])  # the work space is written first
            if statuses[i] == OK:
                record(buffers[i], first + i, 0, steps, members)
        for k in range(steps):
            before = pieces_before(driving, first, 0)
            for piece in range(pieces_before(driving, first, k), pieces_before(driving, first, k + 1)):
                for i in range(count):
                    own = pieces_before(driving, first + i, 0) + piece - before
                    z, state = buffers[i], states[i]
                    if statuses[i] == OK and not drive(z, state, first + i, k, own, control, members, driving, room):
                        statuses[i] = STEP_REJECTED
                advance(buffers[:count], driving.lengths[piece], c, s, statuses[:count])
            for i in range(count):
                if statuses[i] == OK:
                    record(buffers[i], first + i, k + 1, steps, members)
        for i in range(count):
            note(buffers[i], first + i, members)


@kernel
def advance(buffers: Any, h: float, c: Buffer, s: Buffer, statuses: Any) -> None:
    """Advance models' buffers (n, SIZE) by h, as many side by side as are in c.

    c, s: lanes of `COLUMNS_SIZE` and of `WORK` numbers. statuses (n,): in, OK where a buffer is to be advanced; out,
    what `step` returns of those.
    """
    for i in range(len(buffers)):
        if statuses[i] == OK:
            statuses[i] = _PENDING
    for i in range(len(buffers)):
        if statuses[i] == _PENDING:
            kind = _kind(buffers[i], h)
            if kind[0] == 0:
                statuses[i] = step(buffers[i], h)
            else:
                _advance_kind(buffers, i, h, c, s, statuses, kind)


@kernel(inline=False)
def _kind(z: Buffer, h: float) -> Kind:
    body, loads = body_of(z), load_polynomial_of(z)
    n, order, fixed = part_to_integrate(z, body, loads), int(z[_ORDER]), space_fixed_loads(body, loads)
    served = z[_SERIES] != NONE or is_series_tried(z, h)
    if served and z[_SERIES] == NONE:
        q, omega = state.attitude(z, STATE_START), state.omega(z, STATE_START)
        alpha = angular_acceleration(q, omega, body, loads.value)
        served = n != ROTATION or not order < _SURELY * LEAST_REACH * h * turning_of(omega, alpha)
    if served or fixed.changing or n == WHOLE_STATE or not (h > 0.0 and z[_TOLERANCE] < math.inf):
        n = 0
    M = body.inertia
    diagonal = not is_nonzero((M[0][1], M[0][2], M[1][2]))
    return n, order, z[_TOLERANCE], z[_SPAN], fixed.lever_force, fixed.torque, diagonal


@kernel(inline=False)
def goes_in_lanes(z: Buffer, h: float) -> bool:
    """Return whether a step of a started buffer goes in lanes; else one series may serve it, as `step` finds out."""
    return _kind(z, h)[0] != 0


@kernel(inline=False)
def _advance_kind(buffers: Any, first: int, h: float, c: Buffer, s: Buffer, statuses: Any, kind: Kind) -> None:
    """Advance all bodies of a kind from the first on."""
    n, order, tolerance, span, lever_force, torque, _ = kind
    fixed, method = SpaceFixedLoads(lever_force, torque, False), Method(n, order, tolerance, span)
    following, busy = first, 0
    for lane in range(width_of(c)):
        following, found = _next(buffers, following, h, statuses, kind)
        _load(buffers[first if found < 0 else found], c, lane, h, found)  # a lane without a body has a copy
        busy += 1 if found >= 0 else 0
    while busy > 0:
        lanes.begin_substeps(c, s, method, fixed)
        lanes.take_substeps(c, s, method, fixed)
        for lane in range(width_of(c)):
            member = int(lane_at(c, lanes.MEMBER, lane))
            failed = lane_at(c, lanes.HAS_FAILED, lane) != 0.0
            if member < 0 or (lane_at(c, lanes.REST, lane) > 0.0 and not failed):
                continue
            z = buffers[member]
            statuses[member] = step(z, h) if failed else _unload(z, c, lane, n, h)
            following, found = _next(buffers, following, h, statuses, kind)
            if found >= 0:
                _load(buffers[found], c, lane, h, found)
            else:
                put_lane_at(c, lanes.MEMBER, lane, -1.0)
                put_lane_at(c, lanes.REST, lane, 0.0)
                busy -= 1


@kernel
def _next(buffers: Any, i: int, h: float, statuses: Any, kind: Kind) -> tuple[int, int]:
    """Return where to look next, and the next body of a kind from i on, or -1."""
    while i < len(buffers):
        if statuses[i] == _PENDING and _kind(buffers[i], h) == kind:
            return i + 1, i
        i += 1
    return i, -1


@kernel
def _put(c: Buffer, i: int, lane: int, v: Vec3) -> None:
    for k in range(3):
        put_lane_at(c, i + k, lane, v[k])


@kernel
def _put_rows(c: Buffer, i: int, lane: int, M: Matrix) -> None:
    for k in range(3):
        _put(c, i + 3 * k, lane, M[k])


@kernel(inline=False)
def _load(z: Buffer, c: Buffer, lane: int, h: float, member: int) -> None:
    """Let a lane begin with a body."""
    body, loads = body_of(z), load_polynomial_of(z)
    for k in range(ROTATION):
        put_lane_at(c, lanes.STATE + k, lane, z[STATE_START + k])
    _put_rows(c, lanes.INERTIA, lane, body.inertia)
    _put_rows(c, lanes.INVERSE, lane, body.inertia_inverse)
    _put(c, lanes.ARM, lane, body.arm_b)
    _put(c, lanes.DAMPING, lane, body.damping_b)
    lever_force = space_fixed_loads(body, loads).lever_force
    _put(c, lanes.FORCE_A, lane, loads.value.force_a if lever_force else (0.0, 0.0, 0.0))
    _put(c, lanes.TORQUE_A, lane, loads.value.torque_a)
    _put(c, lanes.TORQUE_B, lane, known_torques(loads, body)[0])
    put_lane_at(c, lanes.SIZE, lane, z[STEP_SIZE])
    put_lane_at(c, lanes.REST, lane, h)
    put_lane_at(c, lanes.LOW, lane, 0.0)
    put_lane_at(c, lanes.TRIED, lane, 0.0)
    put_lane_at(c, lanes.COUNT, lane, 0.0)
    put_lane_at(c, lanes.IS_NEW, lane, 1.0)
    put_lane_at(c, lanes.MEMBER, lane, float(member))


@kernel(inline=False)
def _unload(z: Buffer, c: Buffer, lane: int, n: int, h: float) -> int:
    """Commit what a lane has made of a body, as `step` does; it is taken alone where that is not finite."""
    keep(z)
    for k in range(ROTATION):
        z[STATE_START + k] = lane_at(c, lanes.STATE + k, lane)
    if finish_steadily(z, n, h) != OK:
        return step(z, h)
    if is_series_tried(z, h):
        z[_SERIES + COOL_DOWN] = COOL_DOWN_STEPS
    z[_SERIES] = NONE
    z[_SERIES + COOL_DOWN] -= 1.0
    z[STEP_SIZE] = lane_at(c, lanes.SIZE, lane)
    z[STEP_SIZE + 1] += lane_at(c, lanes.COUNT, lane)
    keep_inputs(z, _HELD)
    return OK
