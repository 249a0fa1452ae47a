"""The 8th-order Runge-Kutta pair DOP853 for the motion of a body, with error control inside a communication step.

Works in a piece of a model's buffer: 12 stages of 16 numbers are too many for tuples. States: see `rigid_body_state`.
"""

import math
from typing import Any

from ..buffer import MAX_SUBSTEPS, OK, STEP_REJECTED
from ..buffer_access import copy_numbers
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import (
    Body,
    LoadPolynomial,
    Loads,
    angular_acceleration,
    is_changing,
    loads_after,
    turning_acceleration,
)
from ..rotations.quaternion import quaternion_rate_b
from ..rotations.vec3 import dot, largest_component
from .dop853_tableau import E3, E5, STAGES, A, C
from .rigid_body_state import (
    OMEGA,
    R_C,
    ROTATION,
    STATE_SIZE,
    V_C,
    WHOLE_STATE,
    put_state_attitude,
    put_state_omega,
    put_state_position,
    put_state_velocity,
    put_unit_attitude,
    state_attitude,
    state_omega,
    state_position,
    state_velocity,
)
from .substeps import count_substep, substeps_in, tolerance_of_substep

LONGEST_STEP = 1e30
"""s: the step size of a body at rest without loads."""
WORK = STATE_SIZE * (STAGES + 1)
"""Size of the work space: a trial state, then the stages' rates."""


@kernel
def _stage_rates(w: int, s: int) -> int:
    """Return where the rates of stage s begin in the work space z[w:]."""
    return w + STATE_SIZE * (s + 1)


@kernel(inline=False)
def _rates(z: Any, y: int, k: int, n: int, body: Body, loads: Loads) -> None:
    """Set z[k:] to d/dt of the state z[y:]."""
    q_ab, omega_b = state_attitude(z, y), state_omega(z, y)
    put_state_attitude(z, k, quaternion_rate_b(q_ab, omega_b))
    put_state_omega(z, k, angular_acceleration(q_ab, omega_b, body, loads))
    if n == WHOLE_STATE:
        put_state_position(z, k, state_velocity(z, y))
        put_state_velocity(z, k, turning_acceleration(q_ab, body, loads))


@kernel
def _combine(z: Any, y: int, w: int, n: int, s: int, h: float) -> None:
    """Set the trial state z[w:] to z[y:] + h sum_l A[s, l] k_l; s is a literal: the sum unrolls and zeros vanish."""
    for j in range(n):
        total = 0.0
        for l in range(s):
            if A[s, l] != 0.0:
                total += A[s, l] * z[_stage_rates(w, l) + j]
        z[w + j] = z[y + j] + h * total


@kernel(inline=False)
def _stage_loads(loads: LoadPolynomial, t: float) -> Loads:
    return loads_after(loads, t)


@kernel
def _stage(
    z: Any, y: int, w: int, n: int, s: int, t: float, h: float, body: Body, loads: LoadPolynomial, changing: bool
) -> None:
    """Compute stage s (a literal): its trial state and rates, with the loads at t + c_s h."""
    _combine(z, y, w, n, s, h)
    now = _stage_loads(loads, t + C[s] * h) if changing else loads.value
    _rates(z, w, _stage_rates(w, s), n, body, now)


@kernel(inline=False)
def dop853_step(z: Any, y: int, w: int, n: int, t: float, h: float, body: Body, loads: LoadPolynomial) -> None:
    """Step with order 8 from the state z[y:] to the trial state z[w:], not normalised; the stages' rates stay.

    t: time since the polynomial's beginning.  Stable to h d / I = 6.394 (damping) and h omega / 2 = 5.96 (attitude).
    """
    changing = is_changing(loads)
    _rates(z, y, _stage_rates(w, 0), n, body, _stage_loads(loads, t) if changing else loads.value)
    _stage(z, y, w, n, 1, t, h, body, loads, changing)
    _stage(z, y, w, n, 2, t, h, body, loads, changing)
    _stage(z, y, w, n, 3, t, h, body, loads, changing)
    _stage(z, y, w, n, 4, t, h, body, loads, changing)
    _stage(z, y, w, n, 5, t, h, body, loads, changing)
    _stage(z, y, w, n, 6, t, h, body, loads, changing)
    _stage(z, y, w, n, 7, t, h, body, loads, changing)
    _stage(z, y, w, n, 8, t, h, body, loads, changing)
    _stage(z, y, w, n, 9, t, h, body, loads, changing)
    _stage(z, y, w, n, 10, t, h, body, loads, changing)
    _stage(z, y, w, n, 11, t, h, body, loads, changing)
    _combine(z, y, w, n, 12, h)


@kernel(inline=False)
def _error(z: Any, y: int, w: int, n: int, h: float, span: float) -> float:
    """Estimate the step's error: attitude in rad, the rest relative to the size of its vector (at least 1 for r, v)."""
    rate = max(largest_component(state_omega(z, y)), largest_component(state_omega(z, w)), 1e-300)
    rate = rate if rate * span <= 1.0 else 1.0 / span
    position = max(largest_component(state_position(z, y)), 1.0)
    velocity = max(largest_component(state_velocity(z, y)), 1.0)
    five, three = 0.0, 0.0
    for j in range(n):
        e5, e3 = 0.0, 0.0
        for l in range(STAGES):
            k = z[_stage_rates(w, l) + j]
            e5 += E5[l] * k
            e3 += E3[l] * k
        size = 0.5 if j < OMEGA else (rate if j < R_C else (position if j < V_C else velocity))
        five += (e5 / size) * (e5 / size)
        three += (e3 / size) * (e3 / size)
    if five == 0.0:
        return 0.0
    return h * five / math.sqrt((five + 0.01 * three) * (7.0 if n == ROTATION else 13.0))


@kernel
def first_step(z: Any, y: int, body: Body, loads: Loads) -> float:
    """Return a step size to begin with: half a radian at the rate and acceleration of the state z[y:]."""
    omega = state_omega(z, y)
    alpha = angular_acceleration(state_attitude(z, y), omega, body, loads)
    rate_scale = math.sqrt(dot(omega, omega)) + math.sqrt(math.sqrt(dot(alpha, alpha)))
    return 0.5 / rate_scale if rate_scale > 0.0 else LONGEST_STEP


@kernel(inline=False)
def dop853_march(z: Any, y: int, w: int, n: int, h: float, substep: float, body: Body, loads: LoadPolynomial) -> int:
    """Advance the state z[y:] by h in equal steps of at most `substep`, without error control.

    STEP_REJECTED where that needs too many; the state is then unchanged.
    """
    count = substeps_in(h, substep)
    if count == 0:
        return STEP_REJECTED
    for i in range(count):
        dop853_step(z, y, w, n, h / count * i, h / count, body, loads)
        _accept(z, y, w, n)
    return OK


@kernel(inline=False)
def dop853_advance(
    z: Any,
    y: int,
    w: int,
    size: int,
    n: int,
    h: float,
    tolerance: float,
    span: float,
    body: Body,
    loads: LoadPolynomial,
) -> int:
    """Advance the state z[y:] by h, each step's estimated error at most `tolerance`; span: see `body.memory.SETTINGS`.

    z[size] keeps the step size, and next to it stands the count of the steps tried.

    Equal parts reach h: each step is the rest divided by the number of steps that the kept size would need.
    STEP_REJECTED where the motion is not finite or needs too many steps; the caller then restores state and size.
    """
    rest, low, steps = h, 0.0, 0  # rest + low: the time left, so that a thousand steps end where h does
    while rest > 0.0:
        steps += 1
        count = substeps_in(rest, z[size])
        if count == 0 or steps >= MAX_SUBSTEPS:
            return STEP_REJECTED
        part = (rest + low) / count
        dop853_step(z, y, w, n, h - rest, part, body, loads)
        count_substep(z, size)
        error = _error(z, y, w, n, part, span) / tolerance_of_substep(tolerance, span, part)
        if error <= 1.0:
            growth = 6.0 if error < 2.6e-7 else 0.9 / math.sqrt(math.sqrt(math.sqrt(error)))
            _accept(z, y, w, n)
            left = 0.0 if count == 1 else rest - part
            low += (rest - left) - part
            rest = left
            z[size] = max(z[size], part * growth) if growth >= 1.0 else part * growth
        else:
            shrink = 0.9 / math.sqrt(math.sqrt(math.sqrt(error))) if math.isfinite(error) else 0.0
            z[size] = part * max(0.2, shrink)
    return OK


@kernel
def _accept(z: Any, y: int, w: int, n: int) -> None:
    """Take the trial state as the state, its quaternion scaled to length 1."""
    copy_numbers(z, w + OMEGA, y + OMEGA, n - OMEGA)
    put_unit_attitude(z, y, state_attitude(z, w))
