"""Whole runs of `LOADED_TAYLOR` for many bodies at once, whose outputs are interpolated: see `loaded.run_through`.

A body stays in its lane from start to end. After each substep the states at all points inside it are set, for all lanes
together; the outputs follow at the end of the run, body by body.
"""

from ..body import members as one, shell
from ..body.members import Control, Driving, Members, Room, Run
from ..buffer import MAX_SUBSTEPS
from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at
from ..compile.decorator import kernel
from ..compile.simd import WIDEST, lane_at, put_lane_at, wide_at, width_of
from ..integrators import interpolation, substeps, taylor
from ..integrators.taylor_coefficients import SpaceFixedLoads
from ..mechanics.equations_of_motion import OMEGA, ROTATION
from ..types import Array, Buffer
from . import loaded, loaded_taylor_lanes as lanes
from .loaded_taylor_lanes import COLUMNS_SIZE, LANE, NO_KIND, STATE, Kind

_initialize, _WORK = loaded.LOADED_TAYLOR.initialize, loaded.ROOM.work
PATIENCE = 3
"""Lanes that are free are loaded when all are, or after one in PATIENCE of the substeps since they were loaded.

Lanes that begin together turn their loads anew in the same substeps, and begin no series while others go on: up to a
fifth less work, while a lane that waits for members of other rates costs up to a tenth."""
_WAITING, _IN_A_LANE = -1, -2
"""In place of the steps done: a member that has not begun, and one that has not ended."""


@kernel(inline=False)
def run_members_through(
    control: Control, members: Members, driving: Driving, room: Room, buffers: Array, states: Array, scratch: Array
) -> None:
    """Run members of an ensemble side by side over all points: see `loaded.run_through`.

    Steps done are negative of members that have to run alone: lanes cannot run them, or found no substep that meets the
    tolerance. buffers: at least one for each lane.
    """
    c, s = wide_at(scratch, 0, WIDEST), wide_at(scratch, WIDEST * COLUMNS_SIZE, WIDEST)
    for i in range(len(members.ends)):
        members.ends[i, 1] = _WAITING
    while _run_kind(buffers, states[0], c, s, Run(control, members, driving, room)):
        pass


@kernel(inline=False)
def _run_kind(buffers: Array, state: Array, c: Buffer, s: Buffer, run: Run) -> bool:
    """Run all members of the kind of the first one that waits and that lanes can run; return whether there is one."""
    members, time, states = run.members, run.driving.time, run.room.states
    i, kind, busy, taken, waited, end = 0, NO_KIND, 0, 0, 0, len(time) - 1
    for lane in range(WIDEST):
        i, kind = _load_next(buffers, state, c, lane, i, kind, run)
        busy += 1 if lane_at(c, LANE.member, lane) >= 0.0 else 0
    n, order, tolerance, span, lever_force, torque, _ = kind
    fixed, method = SpaceFixedLoads(lever_force, torque, False), substeps.Method(n, order, tolerance, span)
    while busy > 0:
        lanes.begin_substeps(c, s, method, fixed)
        _take_substeps(c, s, method, fixed, time, states)
        for lane in range(WIDEST):
            member = int(lane_at(c, LANE.member, lane))
            failed = lane_at(c, LANE.has_failed, lane) != 0.0
            if member < 0 or (lane_at(c, LANE.rest, lane) > 0.0 and not failed):
                continue
            if not failed:
                _put_state(c, STATE, lane, states[lane], end - 1)
                z, rows, own = buffers[lane], members.rows[member], states[lane]
                members.ends[member, 1] = loaded.show(z, n, time, members.kept, rows, own, 0, end)
            put_lane_at(c, LANE.member, lane, -1.0)
            put_lane_at(c, LANE.rest, lane, 0.0)
            busy -= 1
        taken, waited = taken + 1, waited + 1 if busy < WIDEST else 0
        if busy == 0 or PATIENCE * waited > taken:
            taken, waited = 0, 0
            for lane in range(WIDEST):
                if lane_at(c, LANE.member, lane) < 0.0:
                    i, kind = _load_next(buffers, state, c, lane, i, kind, run)
                    busy += 1 if lane_at(c, LANE.member, lane) >= 0.0 else 0
    return kind[0] != 0


@kernel(inline=False)
def _load_next(buffers: Array, state: Array, c: Buffer, lane: int, i: int, kind: Kind, run: Run) -> tuple[int, Kind]:
    """Load the next member of the kind, from number i on, into a lane; return the number of the member after it.

    The first one that lanes can run decides the kind.
    """
    z, members, time = buffers[lane], run.members, run.driving.time
    while i < len(members.values):
        i += 1
        if members.ends[i - 1, 1] != _WAITING:
            continue
        one.begin(z, state, i - 1, _WORK, run)
        members.ends[i - 1, 0] = _initialize(z)
        if members.ends[i - 1, 0] != 0:
            continue
        one.record(z, i - 1, 0, run)
        own, members.ends[i - 1, 1] = lanes.kind_of(z), _WAITING
        if kind[0] == 0:
            kind = own
        if own[0] != 0 and own == kind:
            members.ends[i - 1, 1] = _IN_A_LANE
            z[loaded.REST] = time[len(time) - 1] - time[0]
            lanes.load(z, c, lane, i - 1)
            interpolation.begin_points(run.room.states[lane])
            return i, kind
    lanes.load(buffers[0], c, lane, -1)  # a lane without a body has a copy
    put_lane_at(c, LANE.rest, lane, 0.0)
    return i, kind


@kernel(inline=False)
def _take_substeps(
    c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads, time: Array, states: Array
) -> None:
    """Take a substep in each lane, and set the states (lanes, n, ROTATION) at the points inside it."""
    m, q_0 = taylor.derivatives_of_attitude(method.order), quaternion_at(c, STATE)
    c[LANE.begin] = ((time[len(time) - 1] - time[0]) - c[LANE.rest]) - c[LANE.low]
    part = lanes.choose_substeps(c, s, method, fixed, MAX_SUBSTEPS * (len(time) - 1))
    c[LANE.part] = part
    passing = _set_places(c, time)
    if passing:
        interpolation.keep_beginning(s, m)
    lanes.turn(c, s, method, fixed, part)
    while passing:
        inside = interpolation.motion_inside(s, method, m, part, c[LANE.x], q_0, quaternion_at(c, STATE))
        put_quaternion_at(c, LANE.inside, inside.q_ab)
        put_vec3_at(c, LANE.inside + OMEGA, inside.omega_b)
        for lane in range(width_of(c)):
            if lane_at(c, LANE.x, lane) >= 0.0:
                point = lane_at(c, LANE.point, lane)
                _put_state(c, LANE.inside, lane, states[lane], int(point) - 1)
                put_lane_at(c, LANE.point, lane, point + 1.0)
        passing = _set_places(c, time)


@kernel
def _put_state(c: Buffer, i: int, lane: int, states: Array, k: int) -> None:
    """Set row k of the states to what a lane has from column i on."""
    for j in range(ROTATION):
        states[k, j] = lane_at(c, i + j, lane)


@kernel
def _set_places(c: Buffer, time: Array) -> bool:
    """Set the part of its substep at which each lane has its next point, -1 for none; return whether any has one."""
    found = False
    for lane in range(width_of(c)):
        x, k = -1.0, int(lane_at(c, LANE.point, lane))
        if lane_at(c, LANE.member, lane) >= 0.0 and lane_at(c, LANE.has_failed, lane) == 0.0:
            begin, is_last = lane_at(c, LANE.begin, lane), lane_at(c, LANE.rest, lane) == 0.0
            x = interpolation.place_of(time, k, begin, lane_at(c, LANE.part, lane), is_last)
        put_lane_at(c, LANE.x, lane, x)
        found = found or x >= 0.0
    return found


LANES = shell.Lanes(lanes.run_members, lanes.SCRATCH, run_members_through)
