"""Communication steps of `LOADED_TAYLOR` for many bodies at once, in the lanes of a vector: the bits are the same.

A lane takes one body after another, each with its own substeps. A body's numbers are in the lane's columns (`COLUMNS`),
and its series in a work space of `WORK` wide numbers. Loads are constant over the step, and no force turns with the
body. Bodies of different kinds (`kind_of`: what is decided once for all lanes) do not share a vector. Steps that lanes
cannot take, or cannot finish, are taken body by body. A series that may be used for further steps is made in lanes, and
kept and evaluated in its body's buffer, as `dense_output` does for one body. Whole runs without inputs stay in their
lanes from start to end (`loaded_runs_in_lanes`).
"""

import math
from typing import NamedTuple

from ..body import driven, lanes, shell
from ..body.lanes import MEMBER, PENDING, PIECE, STATUS
from ..body.members import Control, Driving, Members, Room, Run
from ..body.memory import MEMORY, STATE_START, body_of
from ..buffer import MAX_SUBSTEPS, OK, STEP_REJECTED, Layout, places
from ..buffer_access import matrix_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import WIDEST, lane_at, put_lane_at, wide_at, width_of
from ..compile.wide import alike, all_of, any_of, choose
from ..integrators import dense_output as dense, substeps, taylor, taylor_coefficients as series
from ..integrators.taylor_coefficients import FORCE, FORCE_RATE, RATE, TORQUE, TURN, WORK, SpaceFixedLoads, term
from ..mechanics.equations_of_motion import OMEGA, RATE_ONLY, ROTATION, WHOLE_STATE, Body
from ..mechanics.inertia import is_diagonal
from ..rotations.quaternion import invert_quaternion, rotate
from ..types import Array, Buffer, Vec3
from .loaded import LOADED_TAYLOR, REST, ROOM, begins_series, finished, go_on

_AT = Layout(LOADED_TAYLOR.BLOCKS, LOADED_TAYLOR.SIZE).at
_SERIES = _AT.validity
step = LOADED_TAYLOR.step
COLUMNS = MEMORY | {
    "damping": 3, "force_a": 3, "torque_a": 3, "torque_b": 3, "count": 1, "low": 1, "tried": 1, "has_failed": 1,
    "size": 1, "rest": 1, "is_new": 1, "member": 1, "reach": 1, "turn_order": 1, "point": 1, "begin": 1, "part": 1,
    "x": 1, "inside": ROTATION,
}  # fmt: skip
"""State and constants of a lane's body, as in a buffer; damping and loads (force_a is 0 if it has no arm); the number
of substeps taken; the low part of the time left in the communication step, and the tries in it; whether the body has
failed; the step size; the time left in the step; whether it has just begun; the body's number, -1 for none. For a
series over further steps: its largest reach, and the attitude's order. For a run whose outputs are interpolated: the
next point; the beginning of the last substep since that of the run, and its length, s; the part of it at that point,
and the state there."""
_, COLUMNS_SIZE = _COLUMNS = places(COLUMNS)
LANE = _COLUMNS.at
STATE = 0
_TRIES = 64
"""The largest number of reductions of a substep, after which a body has failed."""
SCRATCH = WIDEST * (COLUMNS_SIZE + WORK)
"""How many numbers of work space lanes need, which begins at a cache line."""
_CHOSEN = -2
"""The status of a body that is to be advanced with others of its kind."""


class Bodies(NamedTuple):
    """Bodies side by side: buffers (b, SIZE), marks (b, MARKS), see `body.lanes`, and lengths of pieces of runs, s."""

    buffers: Array
    marks: Array
    lengths: Array


Kind = tuple[int, int, float, float, bool, bool, bool]
"""How much of the state is integrated; order, tolerance and span; whether a force fixed in a acts on an arm; whether a
torque fixed in a acts; whether the inertia is diagonal. The first is 0 where lanes cannot be used."""
NO_KIND = (0, 0, 0.0, 0.0, False, False, False)


# Members and communication steps


_HERE = __name__, "LOADED_TAYLOR", True
_run_on = shell.bind(lanes.run_on, *_HERE, go_on=go_on)
_begin_next = shell.bind(
    lanes.begin_next, *_HERE, run_on=_run_on, initialize=LOADED_TAYLOR.initialize, WORK=_AT.work
)  # fmt: skip


@kernel(inline=False)
def run_members(
    control: Control, members: Members, driving: Driving, room: Room, buffers: Array, states: Array, marks: Array,
    scratch: Array,
) -> None:  # fmt: skip
    """Run members of an ensemble side by side: see `body.members`.

    buffers (b, SIZE), states (b, k), marks (b, MARKS): room for some members at a time; scratch: for all lanes.
    """
    c, s = wide_at(scratch, 0, WIDEST), wide_at(scratch, WIDEST * COLUMNS_SIZE, WIDEST)
    run, bodies, i, busy = Run(control, members, driving, room), Bodies(buffers, marks, driving.lengths), 0, 0
    for k in range(len(buffers)):
        i = _begin_next(buffers[k], states[k], marks[k], i, run)
        busy += 1 if marks[k, MEMBER] >= 0.0 else 0
    while busy > 0:
        advance(bodies, c, s)
        for k in range(len(buffers)):
            if marks[k, MEMBER] >= 0.0 and not _run_on(buffers[k], states[k], marks[k], run):
                i = _begin_next(buffers[k], states[k], marks[k], i, run)
                busy -= 1 if marks[k, MEMBER] < 0.0 else 0


@kernel
def advance(bodies: Bodies, c: Buffer, s: Buffer) -> None:
    """Advance the bodies that wait, as many side by side as are in c, and set their statuses to what `step` returns.

    c, s: lanes of `COLUMNS_SIZE` and of `WORK` numbers.
    """
    buffers, marks, _ = bodies
    for first in range(len(buffers)):
        if marks[first, STATUS] == PENDING:
            kind = kind_of(buffers[first])
            if kind[0] == 0:
                marks[first, STATUS] = step(buffers[first], _length_of(bodies, first))
                continue
            for i in range(first, len(buffers)):
                if marks[i, STATUS] == PENDING and (i == first or kind_of(buffers[i]) == kind):
                    marks[i, STATUS] = _CHOSEN
            _advance_kind(bodies, first, c, s, kind)


@kernel
def _length_of(bodies: Bodies, i: int) -> float:
    """Return the length of a body's step."""
    return bodies.lengths[int(bodies.marks[i, PIECE])]  # type: ignore[no-any-return]


@kernel(inline=False)
def kind_of(z: Buffer) -> Kind:
    """Return the kind of a body."""
    if z[_SERIES] == dense.STALE:
        return NO_KIND
    body, loads = body_of(z), driven.load_polynomial_of(z)
    n, order, fixed = driven.part_to_integrate(z, body, loads), int(z[_AT.order]), series.space_fixed_loads(body, loads)
    if driven.inputs_change(z) or n == WHOLE_STATE or not z[_AT.tolerance] < math.inf:
        n = 0
    return n, order, z[_AT.tolerance], z[_AT.span], fixed.lever_force, fixed.torque, is_diagonal(body.inertia)


@kernel(inline=False)
def _advance_kind(bodies: Bodies, first: int, c: Buffer, s: Buffer, kind: Kind) -> None:
    """Advance all bodies of a kind from the first on."""
    buffers, marks, _ = bodies
    n, order, tolerance, span, lever_force, torque, _ = kind
    fixed, method = SpaceFixedLoads(lever_force, torque, False), substeps.Method(n, order, tolerance, span)
    _try_series(bodies, first, c, s, method, fixed)
    following, busy = first, 0
    for lane in range(width_of(c)):
        following, found = _next(following, marks)
        load(buffers[first if found < 0 else found], c, lane, found)  # a lane without a body has a copy
        busy += 1 if found >= 0 else 0
    while busy > 0:
        begin_substeps(c, s, method, fixed)
        turn(c, s, method, fixed, choose_substeps(c, s, method, fixed, MAX_SUBSTEPS))
        for lane in range(width_of(c)):
            member = int(lane_at(c, LANE.member, lane))
            failed = lane_at(c, LANE.has_failed, lane) != 0.0
            if member < 0 or (lane_at(c, LANE.rest, lane) > 0.0 and not failed):
                continue
            z, h = buffers[member], _length_of(bodies, member)
            marks[member, STATUS] = _alone(z, h) if failed else _unload(z, c, lane, n, h)
            following, found = _next(following, marks)
            if found >= 0:
                load(buffers[found], c, lane, found)
            else:
                put_lane_at(c, LANE.member, lane, -1.0)
                put_lane_at(c, LANE.rest, lane, 0.0)
                busy -= 1


@kernel
def _next(i: int, marks: Array) -> tuple[int, int]:
    """Return where to search next, and the first body from i on that is `_CHOSEN`, or -1."""
    while i < len(marks):
        if marks[i, STATUS] == _CHOSEN:
            return i + 1, i
        i += 1
    return i, -1


@kernel
def _put(c: Buffer, i: int, lane: int, v: Vec3) -> None:
    for k in range(3):
        put_lane_at(c, i + k, lane, v[k])


@kernel(inline=False)
def load(z: Buffer, c: Buffer, lane: int, member: int) -> None:
    """Copy a body into a lane."""
    body, loads = body_of(z), driven.load_polynomial_of(z)
    for k in range(ROTATION):
        put_lane_at(c, STATE + k, lane, z[STATE_START + k])
    for k in range(LANE.M, LANE.damping):
        put_lane_at(c, k, lane, z[STATE_START + k])
    _put(c, LANE.damping, lane, body.damping_b)
    lever_force = series.space_fixed_loads(body, loads).lever_force
    _put(c, LANE.force_a, lane, loads.value.force_a if lever_force else (0.0, 0.0, 0.0))
    _put(c, LANE.torque_a, lane, loads.value.torque_a)
    _put(c, LANE.torque_b, lane, series.known_torques(loads, body)[0])
    for k in range(LANE.count, LANE.size):
        put_lane_at(c, k, lane, 0.0)
    put_lane_at(c, LANE.size, lane, z[driven.STEP_SIZE])
    put_lane_at(c, LANE.rest, lane, z[REST])
    put_lane_at(c, LANE.is_new, lane, 1.0)
    put_lane_at(c, LANE.member, lane, float(member))
    put_lane_at(c, LANE.point, lane, 1.0)


@kernel(inline=False)
def _unload(z: Buffer, c: Buffer, lane: int, n: int, h: float) -> int:
    """Commit a lane's step to its body's buffer, as `step` does; where it is not finite, take the step alone."""
    for k in range(ROTATION):
        z[STATE_START + k] = lane_at(c, STATE + k, lane)
    if driven.finish_steadily(z, n, h) != OK:
        return _alone(z, h)
    z[_SERIES] = dense.NONE
    z[_AT.cool_down] -= 1.0
    z[driven.STEP_SIZE] = lane_at(c, LANE.size, lane)
    z[driven.SUBSTEPS] += lane_at(c, LANE.count, lane)
    driven.keep_inputs(z, _AT.held_inputs)
    return OK


@kernel(inline=False)
def _alone(z: Buffer, h: float) -> int:
    """Advance a body by itself, from its state before a step that lanes have begun."""
    driven.restore(z)
    finished(z, STEP_REJECTED)
    return step(z, h)


# Series that may be used for further steps


@kernel(inline=False)
def _try_series(
    bodies: Bodies, first: int, c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads
) -> None:
    """Advance those bodies of a kind, from the first on, for which a series over further steps pays."""
    buffers, marks, _ = bodies
    lane, cautious = 0, dense.cautious(method)
    for i in range(first, len(buffers)):
        if marks[i, STATUS] == _CHOSEN and begins_series(buffers[i], _length_of(bodies, i), method):
            load(buffers[i], c, lane, i)
            lane += 1
        if lane == width_of(c) or (lane > 0 and i == len(buffers) - 1):
            for empty in range(lane, width_of(c)):
                load(buffers[int(lane_at(c, LANE.member, 0))], c, empty, -1)
            _make_series(buffers, c, s, cautious, fixed)
            for k in range(lane):
                member = int(lane_at(c, LANE.member, k))
                marks[member, STATUS] = _follow(buffers[member], c, k, _length_of(bodies, member), cautious, fixed)
            lane = 0


@kernel(inline=False)
def _make_series(buffers: Array, c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads) -> None:
    """Make the series of all lanes, and put them into the work spaces of their bodies."""
    series.put_factors(s, RATE, vec3_at(c, STATE + OMEGA))
    if fixed.lever_force or fixed.torque:
        _turn_loads_anew(c, s, c[LANE.is_new] > 0.0)
    series.motion_series(s, 0, method.order, 0, _bodies(c), _torques(c), fixed)
    c[LANE.reach], bound = dense.first_reach(s, method, c[LANE.size], dense.least_turn(fixed))
    c[LANE.turn_order] = float(method.order)
    if method.n != RATE_ONLY:
        q, reach = quaternion_at(c, STATE), c[LANE.reach]
        c[LANE.turn_order] = dense.attitude_series(s, FORCE_RATE, q, method.order, reach, bound)
    for lane in range(width_of(c)):
        member = int(lane_at(c, LANE.member, lane))
        if member >= 0:
            _put_terms(s, RATE, method.order, lane, buffers[member])
            if method.n != RATE_ONLY:
                _put_terms(s, TURN, int(lane_at(c, LANE.turn_order, lane)), lane, buffers[member])


@kernel
def _put_terms(s: Buffer, u: int, order: int, lane: int, z: Buffer) -> None:
    """Put the series at u of a lane into its body's work space."""
    for k in range(order + 1):
        for i in range(4):
            z[_AT.work + term(u, k) + i] = lane_at(s, term(u, k) + i, lane)
    series.end_series(z[_AT.work : _AT.work + WORK], u, order)


@kernel(inline=False)
def _follow(z: Buffer, c: Buffer, lane: int, h: float, method: substeps.Method, fixed: SpaceFixedLoads) -> int:
    """Advance a body along its series, as `follow_series` does; return `_CHOSEN` if the series is too short to pay."""
    longest, m = z[driven.STEP_SIZE], int(lane_at(c, LANE.turn_order, lane))
    dense.begin_series(z, ROOM, _SERIES, method, m, 1.0, lane_at(c, LANE.reach, lane), dense.least_turn(fixed))
    if dense.pays(z, _SERIES, h):
        substeps.count_substep(z, driven.STEP_SIZE)
        dense.follow(z, ROOM, _SERIES, method.order, lane_at(c, LANE.rest, lane))
        return finished(z, driven.finish_steadily(z, method.n, h))
    dense.give_up(z, ROOM, _SERIES, longest)
    z[REST] = lane_at(c, LANE.rest, lane)
    return _CHOSEN


# Substeps of all lanes


@kernel
def _bodies(c: Buffer) -> Body:
    return Body(
        inverse_mass=0.0, inertia=matrix_at(c, LANE.M), inertia_inverse=matrix_at(c, LANE.M_inverse),
        arm_b=vec3_at(c, LANE.arm), damping_b=vec3_at(c, LANE.damping), is_free=0.0,
    )  # fmt: skip


@kernel
def _torques(c: Buffer) -> series.Torques:
    """Return the coefficients of the constant torque in b: only the first is not zero."""
    zero = alike(c[LANE.rest], 0.0)
    return vec3_at(c, LANE.torque_b), (zero, zero, zero), (zero, zero, zero)


@kernel
def _choose_vector(condition: bool, a: Vec3, b: Vec3) -> Vec3:
    return (choose(condition, a[0], b[0]), choose(condition, a[1], b[1]), choose(condition, a[2], b[2]))


@kernel
def _turn_loads_anew(c: Buffer, s: Buffer, anew: bool) -> None:
    """Set row 0 of the loads that are fixed in a, in axes of b, in the lanes where `anew` holds."""
    q_ba = invert_quaternion(quaternion_at(c, STATE))
    series.put_factors(s, FORCE, _choose_vector(anew, rotate(q_ba, vec3_at(c, LANE.force_a)), vec3_at(s, FORCE)))
    series.put_factors(s, TORQUE, _choose_vector(anew, rotate(q_ba, vec3_at(c, LANE.torque_a)), vec3_at(s, TORQUE)))


@kernel(inline=False)
def begin_substeps(c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads) -> None:
    """Make the series of all lanes.

    When one lane begins a step, the series of the others are made again, with the same bits.
    """
    (n, order, _, _), body, torques = method, _bodies(c), _torques(c)
    m = taylor.derivatives_of_attitude(order)
    turned = fixed.lever_force or fixed.torque
    is_new, eighth = c[LANE.is_new] > 0.0, c[LANE.tried] / taylor.STEPS_OF_LOADS
    first = 0 if n == RATE_ONLY else m
    if any_of(is_new):
        series.put_factors(s, RATE, vec3_at(c, STATE + OMEGA))
        if turned:
            _turn_loads_anew(c, s, is_new)
        series.motion_series(s, 0, first, m, body, torques, fixed)
        c[LANE.is_new] = 0.0
    anew = eighth == math.ceil(eighth)
    if turned and any_of(anew):
        _turn_loads_anew(c, s, anew)
        first = 0
    series.motion_series(s, first, order, 0, body, torques, fixed)


@kernel(inline=False)
def choose_substeps(c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads, most: float) -> float:
    """Return a substep for each lane, of a size that meets the tolerance there, and set what is left after it.

    Where none meets the tolerance, or there are more than `most`, the body has failed.
    """
    body, rest, low, order = _bodies(c), c[LANE.rest], c[LANE.low], method.order
    acceleration = alike(rest, 0.0)
    if fixed.lever_force or fixed.torque:
        acceleration = taylor.space_fixed_acceleration(s, body, fixed)
    part, count, excess = _try_substeps(c, s, method, acceleration)
    for _ in range(_TRIES):
        fits = excess <= 1.0
        if all_of(fits):
            break
        c[LANE.size] = choose(fits, c[LANE.size], substeps.nearer_size(part, order, 2.0 * excess))
        c[LANE.tried] = choose(fits, c[LANE.tried], c[LANE.tried] + 1.0)
        part, count, excess = _try_substeps(c, s, method, acceleration)
    c[LANE.tried], c[LANE.count] = c[LANE.tried] + 1.0, c[LANE.count] + 1.0
    goes_on = (excess <= 1.0) & (rest < most * c[LANE.size]) & (c[LANE.tried] < most)
    c[LANE.has_failed] = choose(goes_on, 0.0, 1.0)
    nearer, is_last = substeps.nearer_size(part, order, 1.4 * excess), count == 1.0
    c[LANE.size] = choose(is_last, max(c[LANE.size], nearer), nearer)
    left = choose(is_last, 0.0, rest - part)
    c[LANE.low], c[LANE.rest] = low + ((rest - left) - part), left
    return part


@kernel
def turn(c: Buffer, s: Buffer, method: substeps.Method, fixed: SpaceFixedLoads, part: float) -> None:
    """Advance rate and attitude of all lanes by a substep."""
    taylor.turn(c, STATE, s, method, part, _bodies(c), _torques(c), fixed)


@kernel
def _try_substeps(c: Buffer, s: Buffer, method: substeps.Method, acceleration: float) -> tuple[float, float, float]:
    """Return the next substep's length, how many such are left, and its estimated error over the allowed one."""
    count: float = substeps.parts_in(c[LANE.rest], c[LANE.size])
    part = (c[LANE.rest] + c[LANE.low]) / count
    alpha_fixed = choose(count > 1.0, acceleration, 0.0)
    steps = choose(count < taylor.STEPS_OF_LOADS, count, float(taylor.STEPS_OF_LOADS))
    return part, count, taylor.estimated_excess(s, method, part, (0.0, 0.0, 0.0), alpha_fixed, steps, 0.0)
