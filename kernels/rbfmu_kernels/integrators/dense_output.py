"""A motion under steady loads whose series, once begun, serves as many communication steps as it reaches over.

Series follow one another in steps of their own, whatever the communication steps are: an output is an evaluation.

Works in a piece of a model's buffer, see `taylor_coefficients`; what is kept: `KEPT`; states: see `rigid_body_state`.
"""

import math
from typing import Any

from ..buffer import MAX_SUBSTEPS, places
from ..buffer_access import copy_numbers, pair_at, put_pair_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import Body, LoadPolynomial
from ..numerics.double_double import DoubleDouble, dd_add_float
from ..rotations.vec3 import add, add_scaled, largest_component, scale, subtract
from .dense_series import attitude_at, attitude_series, end_series, last_terms_of_attitude, likely_reach, rate_at
from .rigid_body_state import (
    RATE_ONLY,
    ROTATION,
    WHOLE_STATE,
    put_state_attitude,
    put_state_omega,
    put_state_position,
    put_state_velocity,
    state_attitude,
    state_omega,
    state_position,
    state_velocity,
)
from .substeps import count_substep, nearer_size, tolerance_of_substep
from .taylor_coefficients import (
    ACCELERATION,
    FORCE_RATE,
    PER,
    RATE,
    WORK,
    acceleration_series,
    known_torques,
    motion_series,
    put_factors,
    space_fixed_loads,
    term,
    turned_loads,
)
from .truncation import last_terms, power_of, truncation

KEPT = {"is_alive": 1, "reach": 1, "since": 2, "extent": 1, "turn_order": 1, "wait": 1, "start": ROTATION, "path": 6}
"""NONE, ALIVE, or BURIED; how far the series reaches, and how far it has served, s; how much of a state it serves; the
order of the attitude; steps until a series is tried again; attitude and rate where it began; velocity and way that a
force which turns with the body has added since then."""
_PLACES, KEPT_SIZE = places(KEPT)
_REACH, SINCE, _EXTENT, _TURN_ORDER, WAIT, _START, _PATH = (
    _PLACES[n].start for n in ("reach", "since", "extent", "turn_order", "wait", "start", "path")
)
NONE, ALIVE, BURIED = 0.0, 1.0, 2.0
"""A buried series has its work space overwritten, and is made again before it goes on."""
LEAST_REACH = 1.5
"""Communication steps that a series has to reach over at least: below, a substep a step costs less."""
PATIENCE = 16.0
"""The steps after a series that did not until another is tried."""
_CAUTION = 1.0 / 64.0
"""The part of a whole run's tolerance that series use up: no pilot run has seen how inputs magnify errors."""
_SMALL_TURNS = 8.0
"""Turns below the inverse of it, rad, of which an attitude keeps relative accuracy where loads turn in b.

Their torque, which may cancel at rest, turns errors of the attitude into errors of the rate: near an equilibrium these
count relative to a motion as small. Larger turns keep absolute accuracy, as attitudes are asked for.
"""
_TRIES = 256
"""From the longest step down to any."""
_CLOCK = 1.0 + 1e-9


@kernel
def reaches_over(z: Any, i: int, h: float) -> bool:
    """Return whether the series that is kept from z[i] on stands ready for a step h."""
    return bool(z[i] == ALIVE and z[i + SINCE] + h <= _CLOCK * z[i + _REACH])


@kernel
def turn_order_of(z: Any, i: int) -> int:
    """Return the order of the attitude."""
    return int(z[i + _TURN_ORDER])


@kernel
def extent_of(z: Any, i: int) -> int:
    """Return how much of a state the series serves."""
    return int(z[i + _EXTENT])


@kernel
def clock_after(z: Any, i: int, h: float) -> DoubleDouble:
    """Return how far the series has served after a step h, s."""
    return dd_add_float(pair_at(z, i + SINCE), h)


@kernel
def begin_clock(z: Any, i: int, n: int, m: int, reach: float) -> None:
    """Let a series begin now; n: how much of a state it serves, m: the order of the attitude."""
    z[i], z[i + _REACH], z[i + _EXTENT], z[i + _TURN_ORDER] = ALIVE, reach, float(n), float(m)
    put_pair_at(z, i + SINCE, (0.0, 0.0))


@kernel
def follow(z: Any, y: int, w: int, i: int, order: int, h: float) -> None:
    """Advance the state z[y:] by h along the series in z[w:]."""
    since = clock_after(z, i, h)
    put_pair_at(z, i + SINCE, since)
    _put_motion(z, y, w, i, order, h, since[0])


@kernel
def _put_motion(z: Any, y: int, w: int, i: int, order: int, h: float, t: float) -> None:
    """Set the state z[y:] to that at t of the series, h after the one before."""
    n = extent_of(z, i)
    put_state_omega(z, y, rate_at(z, w, order, t))
    if n != RATE_ONLY:
        put_state_attitude(z, y, attitude_at(z, w, turn_order_of(z, i), t))
    if n == WHOLE_STATE:
        _put_path(z, y, w, i, h, t)


@kernel(inline=False)
def _put_path(z: Any, y: int, w: int, i: int, h: float, t: float) -> None:
    """Add to velocity and position what the turning force has added to them since the last step, and h times v."""
    speed, path = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(turn_order_of(z, i) - 1, -1, -1):
        gain = scale(PER[k], vec3_at(z, w + term(ACCELERATION, k)))
        speed = add_scaled(gain, t, speed)
        path = add_scaled(scale(PER[k + 1], gain), t, path)
    speed, path = scale(t, speed), scale(t * t, path)
    speed_0, path_0, v = vec3_at(z, i + _PATH), vec3_at(z, i + _PATH + 3), state_velocity(z, y)
    put_vec3_at(z, i + _PATH, speed)
    put_vec3_at(z, i + _PATH + 3, path)
    way = subtract(subtract(path, path_0), scale(h, speed_0))
    put_state_position(z, y, add(state_position(z, y), add_scaled(way, h, v)))
    put_state_velocity(z, y, add(v, subtract(speed, speed_0)))


@kernel
def follow_series(
    z: Any,
    y: int,
    w: int,
    i: int,
    size: int,
    n: int,
    order: int,
    h: float,
    tolerance: float,
    span: float,
    body: Body,
    loads: LoadPolynomial,
) -> float:
    """Advance the state z[y:] by h along series; return what is left of h where the next one does not reach far enough.

    As `taylor.taylor_advance`, but for i, where `KEPT` begins; the loads are steady, and those of the series, if any.
    """  # fmt: skip
    tolerance = tolerance if span == 0.0 else _CAUTION * tolerance
    rest, longest = h, z[size]
    again, stands = bool(z[i] == BURIED), bool(z[i] == ALIVE)
    for _ in range(int(MAX_SUBSTEPS)):
        if not stands:
            _make(z, i + _START if again else y, w, i, size, n, order, tolerance, span, body, loads, again)
            if not again:
                if not z[i + _REACH] >= LEAST_REACH * h:
                    break
                longest = z[size]
                count_substep(z, size)
        if reaches_over(z, i, rest):
            follow(z, y, w, i, order, rest)
            return 0.0
        (high, low), reach = pair_at(z, i + SINCE), z[i + _REACH]
        part = (reach - high) - low
        _put_motion(z, y, w, i, order, part, reach)
        rest -= part
        again = stands = False
    z[i], z[i + WAIT], z[size] = NONE, PATIENCE, longest
    return rest


@kernel
def _make(
    z: Any,
    y: int,
    w: int,
    i: int,
    size: int,
    n: int,
    order: int,
    tolerance: float,
    span: float,
    body: Body,
    loads: LoadPolynomial,
    again: bool,
) -> None:
    """Make the series of the motion from the state z[y:] on; again: to the order and reach that are kept."""
    s, q, m = z[w : w + WORK], state_attitude(z, y), turn_order_of(z, i) if again else order
    fixed = space_fixed_loads(body, loads)
    put_factors(s, RATE, state_omega(z, y))
    if fixed.lever_force or fixed.torque:
        turned_loads(s, q, loads, fixed)
    motion_series(s, 0, order, 0, body, known_torques(loads, body), fixed)
    end_series(s, RATE, order)
    least = 0.0 if fixed.lever_force or fixed.torque else 1.0
    reach, speed, exact = z[i + _REACH], 1.0, again or n == WHOLE_STATE
    if not again:
        reach = z[size] if n == RATE_ONLY else likely_reach(s, order, z[size])
        reach, _ = reach_within(s, n, order, 0, speed, reach, tolerance, span, least)
    if n != RATE_ONLY:
        _, square = truncation(s, order, reach, 0.0, 1, n, span)
        turn = _turn_counted(square, reach, least)
        bound = -1.0 if exact else 0.5 * turn * tolerance_of_substep(tolerance, span, reach)
        m = attitude_series(s, FORCE_RATE, q, m, reach, bound)
    if n == WHOLE_STATE:
        acceleration_series(s, m, body.inverse_mass, loads)
        speed = max(largest_component(state_velocity(z, y)), 1.0)
    if again:
        z[i] = ALIVE
        return
    copy_numbers(z, y, i + _START, ROTATION)
    reach, z[size] = reach_within(s, n, order, m, speed, reach, tolerance, span, least)
    begin_clock(z, i, n, m, reach)
    for k in range(6):
        z[i + _PATH + k] = 0.0


@kernel
def _turn_counted(square: float, h: float, least: float) -> float:
    """Return the turn that errors of the attitude are relative to, 1 at most; square: of the largest rate."""
    return max(min(_SMALL_TURNS * math.sqrt(square) * h, 1.0), least)


@kernel(inline=False)
def reach_within(
    s: Any, n: int, order: int, m: int, speed: float, reach: float, tolerance: float, span: float, least: float
) -> tuple[float, float]:
    """Return a reach, at most that given, at which the estimated error is within the tolerance's share, and the next.

    m: the attitude's order, 0 while it is not known; least: the turn, rad, of which it loses digits at most, 1 where no
    load depends on the attitude, else 0.
    """
    excess = _excess(s, n, order, m, speed, reach, tolerance, span, least)
    for _ in range(_TRIES):
        if excess <= 1.0:
            break
        reach = nearer_size(reach, order, 1.4 * excess)
        excess = _excess(s, n, order, m, speed, reach, tolerance, span, least)
    return reach, nearer_size(reach, order, 1.4 * excess)


@kernel(inline=False)
def _excess(
    s: Any, n: int, order: int, m: int, speed: float, h: float, tolerance: float, span: float, least: float
) -> float:
    """Return the estimated error at h over that which is allowed."""
    last, square = truncation(s, order, h, 0.0, 1, n, span)
    if m > 0 and n != RATE_ONLY:
        power, turn = power_of(h, m - 1), _turn_counted(square, h, least)
        if turn > 0.0:  # else the body is at rest, and all terms are zero
            last = max(last, 2.0 * power * last_terms_of_attitude(s, m, h) / turn)
        if n == WHOLE_STATE:
            last = max(last, power * last_terms(s, ACCELERATION, m - 1, h) / speed)
    return last / tolerance_of_substep(tolerance, span, h)
