"""Series of a motion under steady loads that are evaluated at all communication points within their reach.

Series follow one another in steps of their own, whatever the communication steps are, and an output is an evaluation.
The body rate's series is that of `taylor_coefficients`. The attitude's begins at q_ab itself, as dq/dt = q o (0, omega)
/ 2 is linear, and is made to the order at which its terms are small enough.

The series are in a piece of a model's buffer, see `taylor_coefficients`; `SERIES_BLOCKS` is kept from step to step. For
states see `equations_of_motion`.
"""

import math

from ..buffer import MAX_SUBSTEPS, places
from ..buffer_access import copy_numbers, pair_at, put_pair_at, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.simd import Lanes, add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from ..compile.wide import alike, all_of, any_of, choose
from ..mechanics import equations_of_motion as motion
from ..mechanics.equations_of_motion import OMEGA, R_C, RATE_ONLY, ROTATION, V_C, WHOLE_STATE, Body, LoadPolynomial
from ..numerics import double_double as dd
from ..rotations.quaternion import largest_of, scale_quaternion, square_of
from ..rotations.vec3 import add, add_scaled, largest_component, norm, scale, subtract
from ..types import Buffer, Quaternion, Vec3
from . import substeps, taylor_coefficients as series
from .substeps import Method, Room
from .taylor_coefficients import ACCELERATION, FORCE_RATE, PER, RATE, ROW, ROWS, TURN, WORK, SpaceFixedLoads, term

_HALF, _THIRD = ROW // 2, ROW * 25
_NEAR = 1e-8
"""How near to 1 x must be for sqrt(x) = (1 + x) / 2 to round-off."""


@kernel
def _put_turn(s: Buffer, products: int, k: int, q: Quaternion) -> None:
    """Store the k-th coefficient of the attitude, and its products q o i, q o j, q o k."""
    a, b, c, d = q
    row = term(products, k)
    put_lanes(s, term(TURN, k), lanes(a, b, c, d))
    put_lanes(s, row, lanes(-b, a, d, -c))
    put_lanes(s, row + _HALF, lanes(-c, -d, a, b))
    put_lanes(s, row + _THIRD, lanes(-d, c, -b, a))


@kernel
def _turn_product(s: Buffer, products: int, j: int, i: int) -> Lanes:
    """Return q_j o (0, omega_i) of coefficients."""
    row = term(products, j)
    x, y, z = vec3_at(s, term(RATE, i & ROWS))
    along_i = multiply_lanes(lanes_at(s, row), lanes(x, x, x, x))
    along_j = multiply_lanes(lanes_at(s, row + _HALF), lanes(y, y, y, y))
    along_k = multiply_lanes(lanes_at(s, row + _THIRD), lanes(z, z, z, z))
    return add_lanes(add_lanes(along_i, along_j), along_k)


@kernel
def _turn_rate(s: Buffer, products: int, k: int) -> Quaternion:
    """Return the k-th coefficient of q o (0, omega); the newest term is added last, so that no sum waits for it."""
    even = odd = lanes(0.0, 0.0, 0.0, 0.0)
    for j in range(0, k - 1, 2):
        even = add_lanes(even, _turn_product(s, products, j, k - j))
        odd = add_lanes(odd, _turn_product(s, products, j + 1, k - j - 1))
    if k & 1 == 1:
        even = add_lanes(even, _turn_product(s, products, k - 1, 1))
    return numbers(add_lanes(add_lanes(even, odd), _turn_product(s, products, k, 0)))


@kernel
def turning_of(omega: Vec3, alpha: Vec3) -> float:
    """Return how fast a motion of this rate and angular acceleration turns, rad/s."""
    return norm(omega) + math.sqrt(norm(alpha))


@kernel
def likely_reach(s: Buffer, order: int, longest: float) -> float:
    """Return an upper bound of the reach of series of this order in a turning motion, at most `longest`."""
    turning = turning_of(vec3_at(s, RATE), vec3_at(s, term(RATE, 1)))
    reach = order / choose(turning > 0.0, turning, 1.0)
    return choose((turning > 0.0) & (reach < longest), reach, longest)


@kernel
def last_terms_of_attitude(s: Buffer, order: int, h: float) -> float:
    """Return the larger of the attitude's last two terms at h, over h^(order - 1)."""
    last, before = quaternion_at(s, term(TURN, order)), quaternion_at(s, term(TURN, order - 1))
    return max(largest_of(before), h * largest_of(last))


@kernel(inline=False)
def attitude_series(s: Buffer, products: int, q: Quaternion, order: int, reach: float, bound: float) -> float:
    """Set the attitude's coefficients from q on, to at most `order`, and return the last one's order.

    It is cut where its last two terms at `reach` are at most `bound`, in all lanes. products: room in s for two series.
    """
    _put_turn(s, products, 0, q)
    power, last = alike(reach, 1.0), alike(reach, float(order))
    were_small = reach < -math.inf
    for k in range(order):
        q = scale_quaternion(0.5 * PER[k], _turn_rate(s, products, k))
        _put_turn(s, products, k + 1, q)
        power *= reach
        small = largest_of(q) * power <= bound
        if 2 * k >= order and any_of(small & were_small):
            last = choose(small & were_small & (last == order), k + 1.0, last)
            if all_of(last < order):
                break
        were_small = small
    return last


@kernel
def _value(s: Buffer, u: int, order: int, t: float) -> Lanes:
    """Return a series at t, by four sums that do not wait for one another."""
    t_2 = t * t
    t_4 = t_2 * t_2
    once, twice, steps = lanes(t, t, t, t), lanes(t_2, t_2, t_2, t_2), lanes(t_4, t_4, t_4, t_4)
    a = b = c = d = lanes(0.0, 0.0, 0.0, 0.0)
    for i in range((order - 1) // series.AT_ONCE, -1, -1):
        k = term(u, series.AT_ONCE * i)
        a = add_lanes(multiply_lanes(a, steps), lanes_at(s, k + ROW))
        b = add_lanes(multiply_lanes(b, steps), lanes_at(s, k + 2 * ROW))
        c = add_lanes(multiply_lanes(c, steps), lanes_at(s, k + 3 * ROW))
        d = add_lanes(multiply_lanes(d, steps), lanes_at(s, k + 4 * ROW))
    a, c = add_lanes(a, multiply_lanes(b, once)), add_lanes(c, multiply_lanes(d, once))
    a = add_lanes(a, multiply_lanes(c, twice))
    return numbers(add_lanes(lanes_at(s, u), multiply_lanes(a, once)))


@kernel
def rate_at(s: Buffer, w: int, order: int, t: float) -> Vec3:
    """Return omega_ab_b at t from the series that begin at s[w]."""
    return _value(s, w + RATE, order, t)[:3]


@kernel
def attitude_at(s: Buffer, w: int, order: int, t: float) -> Quaternion:
    """Return q_ab at t, of unit length, from the series that begin at s[w]."""
    q = _value(s, w + TURN, order, t)
    over = square_of(q) - 1.0
    return scale_quaternion(1.0 - 0.5 * over if abs(over) < _NEAR else 1.0 / math.sqrt(1.0 + over), q)


SERIES_BLOCKS = {
    "validity": 1, "reach": 1, "since": 2, "extent": 1, "turn_order": 1, "cool_down": 1, "start": ROTATION, "path": 6,
}  # fmt: skip
"""NONE, VALID, or STALE; the reach of the series, and the time since its beginning, s; how much of a state it has; the
order of the attitude; steps until a series is tried again; attitude and rate at its beginning; velocity and
displacement that a force which turns with the body has added since then."""
_LAYOUT = places(SERIES_BLOCKS)
SERIES_SIZE = _LAYOUT.size
KEPT = _LAYOUT.at
"""The place of each of these blocks, counted from the first."""
NONE, VALID, STALE = 0.0, 1.0, 2.0
"""The coefficients of a stale series have been overwritten: it is made again before it is used."""
LEAST_REACH = 1.5
"""The least number of communication steps that a series must reach over: for fewer, substeps cost less.

Evaluated anywhere within its reach a series needs the attitude up to full order, while the two-point formula of a
substep needs three eighths of it (`taylor.derivatives_of_attitude`).
"""
COOL_DOWN_STEPS = 16.0
"""The number of steps from a series that was too short to the next try, so that such series cost little."""
_CAUTION = 1.0 / 64.0
"""The part of a whole run's tolerance that series may use: no pilot run has seen how inputs will magnify errors.

It costs little: 64^(1/12) = 1.4, so that a series of order 12 reaches 0.7 times as far.
"""
_SMALL_TURNS = 8.0
"""Turns below 1 / _SMALL_TURNS rad keep relative accuracy where loads turn in b; larger ones keep absolute accuracy.

Near an equilibrium the torque of such loads turns errors of the attitude into errors of the rate, which count relative
to a motion that is itself small. Without this a pendulum at 1e-4 rad/s, at a tolerance of 1e-12, was off by 252 times
that.
"""
_TRIES = 256
"""Enough reductions to get from the longest step down to any step."""
_CLOCK = 1.0 + 1e-9
"""As in `substeps_in`: round-off in the importer's clock must not end a series one step early."""


@kernel
def reaches_over(z: Buffer, i: int, h: float) -> bool:
    """Return whether the series kept from z[i] on is valid over a step h."""
    return bool(z[i] == VALID and z[i + KEPT.since] + h <= _CLOCK * z[i + KEPT.reach])


@kernel
def clock_after(z: Buffer, i: int, h: float) -> dd.DoubleDouble:
    """Return the time since the series' beginning after a step h, s."""
    return dd.add_float(pair_at(z, i + KEPT.since), h)


@kernel
def begin_clock(z: Buffer, i: int, n: int, m: int, reach: float) -> None:
    """Set that a series begins now; n: how much of a state it has, m: the order of the attitude."""
    z[i], z[i + KEPT.reach], z[i + KEPT.extent], z[i + KEPT.turn_order] = VALID, reach, float(n), float(m)
    put_pair_at(z, i + KEPT.since, (0.0, 0.0))


@kernel
def pass_time(z: Buffer, i: int, h: float) -> float:
    """Add a step h to the time since the series' beginning, and return it."""
    since = clock_after(z, i, h)
    put_pair_at(z, i + KEPT.since, since)
    return since[0]


@kernel
def follow(z: Buffer, room: Room, i: int, order: int, h: float) -> None:
    """Advance the state by h along the series in the work space."""
    _put_motion(z, room, i, order, h, pass_time(z, i, h))


@kernel
def _put_motion(z: Buffer, room: Room, i: int, order: int, h: float, t: float) -> None:
    """Set the state to the series at t; h: the time since the state before."""
    n, (y, w, _) = int(z[i + KEPT.extent]), room
    put_vec3_at(z, y + OMEGA, rate_at(z, w, order, t))
    if n != RATE_ONLY:
        put_quaternion_at(z, y, attitude_at(z, w, int(z[i + KEPT.turn_order]), t))
    if n == WHOLE_STATE:
        _put_path(z, y, w, i, h, t)


@kernel(inline=False)
def _put_path(z: Buffer, y: int, w: int, i: int, h: float, t: float) -> None:
    """Advance position and velocity by h, with what a force that turns with the body has added since the last step."""
    order = int(z[i + KEPT.turn_order]) - 1
    speed = scale(t, _value(z, w + series.SPEED, order, t)[:3])
    path = scale(t * t, _value(z, w + series.PATH, order, t)[:3])
    speed_0, path_0, v = vec3_at(z, i + KEPT.path), vec3_at(z, i + KEPT.path + 3), vec3_at(z, y + V_C)
    put_vec3_at(z, i + KEPT.path, speed)
    put_vec3_at(z, i + KEPT.path + 3, path)
    way = subtract(subtract(path, path_0), scale(h, speed_0))
    put_vec3_at(z, y + R_C, add(vec3_at(z, y + R_C), add_scaled(way, h, v)))
    put_vec3_at(z, y + V_C, add(v, subtract(speed, speed_0)))


@kernel
def follow_to_end(z: Buffer, room: Room, i: int, order: int) -> float:
    """Advance the state to the end of the series in the work space; return the time that this takes."""
    (high, low), reach = pair_at(z, i + KEPT.since), z[i + KEPT.reach]
    part: float = (reach - high) - low
    _put_motion(z, room, i, order, part, reach)
    return part


@kernel
def cautious(method: Method) -> Method:
    """Return the method for series that may be used in further steps, whose inputs are not known yet."""
    n, order, tolerance, span = method
    return Method(n, order, _CAUTION * tolerance if span != 0.0 else tolerance, span)


@kernel
def follow_series(z: Buffer, room: Room, i: int, method: Method, h: float, body: Body, loads: LoadPolynomial) -> float:
    """Advance the state by h along series; return the rest of h where the next series would be too short to pay.

    i: where `SERIES_BLOCKS` begin. The loads are constant, and those that a valid series was made with.
    """
    y, _, size = room
    method, rest, longest, again, stands = cautious(method), h, z[size], bool(z[i] == STALE), bool(z[i] == VALID)
    for _ in range(int(MAX_SUBSTEPS)):
        if not stands:
            is_first = z[i] == NONE  # else the next one is likely to reach as far
            if is_first and not may_pay(method, quaternion_at(z, y), vec3_at(z, y + OMEGA), body, loads.value, h):
                break
            _make(z, room, i + KEPT.start if again else y, i, method, body, loads, again)
            if not again:
                if not pays(z, i, h):
                    break
                longest = z[size]
                substeps.count_substep(z, size)
        if reaches_over(z, i, rest):
            follow(z, room, i, method.order, rest)
            return 0.0
        rest -= follow_to_end(z, room, i, method.order)
        again = stands = False
    give_up(z, room, i, longest)
    return rest


@kernel
def may_pay(method: Method, q: Quaternion, omega: Vec3, body: Body, loads: motion.Loads, h: float) -> bool:
    """Return whether a series may reach over enough steps h to pay: as `likely_reach`, before it is made."""
    turning = turning_of(omega, motion.angular_acceleration(q, omega, body, loads))
    return bool(method.n == RATE_ONLY or method.order >= LEAST_REACH * h * turning)


@kernel
def pays(z: Buffer, i: int, h: float) -> bool:
    """Return whether a series that was made reaches over enough steps h to pay."""
    return bool(z[i + KEPT.reach] >= LEAST_REACH * h)


@kernel
def give_up(z: Buffer, room: Room, i: int, longest: float) -> None:
    """Drop the series, and try none for some steps; longest: the step size before the series that was too short."""
    z[i], z[i + KEPT.cool_down], z[room.size] = NONE, COOL_DOWN_STEPS, longest


@kernel
def _make(
    z: Buffer, room: Room, y: int, i: int, method: Method, body: Body, loads: LoadPolynomial, again: bool
) -> None:
    """Make the series of the motion from the state z[y:] on; again: to the order and reach that are kept."""
    (n, order, _, _), (_, w, size) = method, room
    s, q, m = z[w : w + WORK], quaternion_at(z, y), int(z[i + KEPT.turn_order]) if again else order
    fixed = series.space_fixed_loads(body, loads)
    series.put_factors(s, RATE, vec3_at(z, y + OMEGA))
    if fixed.lever_force or fixed.torque:
        series.turned_loads(s, q, loads, fixed)
    series.motion_series(s, 0, order, 0, body, series.known_torques(loads, body), fixed)
    series.end_series(s, RATE, order)
    least, reach, bound, speed = least_turn(fixed), z[i + KEPT.reach], -1.0, 1.0
    if not again:
        reach, bound = first_reach(s, method, z[size], least)
    if n != RATE_ONLY:
        m = int(attitude_series(s, FORCE_RATE, q, m, reach, -1.0 if n == WHOLE_STATE else bound))
        series.end_series(s, TURN, m)
    if n == WHOLE_STATE:
        series.acceleration_series(s, m, body.inverse_mass, loads)
        series.path_series(s, m)
        speed = max(largest_component(vec3_at(z, y + V_C)), 1.0)
    z[i] = VALID
    if not again:
        begin_series(z, room, i, method, m, speed, reach, least)


@kernel
def least_turn(fixed: SpaceFixedLoads) -> float:
    """Return the least turn, rad, to which errors of the attitude are relative: 1, or 0 if a load depends on it."""
    return 0.0 if fixed.lever_force or fixed.torque else 1.0


@kernel
def first_reach(s: Buffer, method: Method, longest: float, least: float) -> tuple[float, float]:
    """Return the reach of the rate's series, which limits the attitude's, and the bound of the attitude's last terms.

    longest: the step size; least: see `least_turn`.
    """
    n, order, tolerance, span = method
    reach = longest if n == RATE_ONLY else likely_reach(s, order, longest)
    reach, _ = reach_within(s, method, 0, 1.0, reach, least)
    _, square = substeps.truncation(s, method, reach, 0.0, 1)
    turn = _turn_counted(square, reach, least)
    return reach, 0.5 * turn * substeps.tolerance_of_substep(tolerance, span, reach)


@kernel
def begin_series(
    z: Buffer, room: Room, i: int, method: Method, m: int, speed: float, reach: float, least: float
) -> None:
    """Note that the series in the work space begins at the state, and set the likely step size of the next one.

    m: the attitude's order; speed: the centre's, m/s, at least 1; reach, least: see `first_reach`.
    """
    y, w, size = room
    copy_numbers(z, y, i + KEPT.start, ROTATION)
    reach, z[size] = reach_within(z[w : w + WORK], method, m, speed, reach, least)
    begin_clock(z, i, method.n, m, reach)
    for k in range(6):
        z[i + KEPT.path + k] = 0.0


@kernel
def _turn_counted(square: float, h: float, least: float) -> float:
    """Return the turn, rad, from `least` to 1, to which attitude errors are relative; square: (largest rate)^2."""
    turn = _SMALL_TURNS * math.sqrt(square) * h
    return max(choose(turn > 1.0, 1.0, turn), least)


@kernel(inline=False)
def reach_within(s: Buffer, method: Method, m: int, speed: float, reach: float, least: float) -> tuple[float, float]:
    """Return a reach, at most the given one, at which the estimated error is allowed, and the next step size.

    m: the attitude's order, 0 while it is not known; least: see `least_turn`.
    """
    excess = _excess(s, method, m, speed, reach, least)
    for _ in range(_TRIES):
        fits = excess <= 1.0
        if all_of(fits):
            break
        reach = choose(fits, reach, substeps.nearer_size(reach, method.order, 1.4 * excess))
        excess = _excess(s, method, m, speed, reach, least)
    return reach, substeps.nearer_size(reach, method.order, 1.4 * excess)


@kernel(inline=False)
def _excess(s: Buffer, method: Method, m: int, speed: float, h: float, least: float) -> float:
    """Return the estimated error at h over the allowed one."""
    n, (last, square) = method.n, substeps.truncation(s, method, h, 0.0, 1)
    if m > 0 and n != RATE_ONLY:
        power, turn = substeps.power_of(h, m - 1), _turn_counted(square, h, least)
        of_attitude = 2.0 * power * last_terms_of_attitude(s, m, h) / choose(turn > 0.0, turn, 1.0)
        last = choose(turn > 0.0, max(last, of_attitude), last)  # else the body is at rest, and all terms are zero
        if n == WHOLE_STATE:
            last = max(last, power * substeps.last_terms(s, ACCELERATION, m - 1, h) / speed)
    return last / substeps.tolerance_of_substep(method.tolerance, method.span, h)
