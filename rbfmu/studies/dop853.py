"""The 8th-order Runge-Kutta pair DOP853 for the motion of a body, with error control inside a communication step.

Charts and laws measure it, but no plan uses it: series cost 1.7 to 12 times less at the same accuracy (`rbfmu chart`).
It is compiled and needs no further package, while SciPy's DOP853 is called from Python at each stage.
It works in its model's buffer, as 12 stages of 16 numbers are too many for tuples. States: see `equations_of_motion`.
In a plan, `tolerance` is the largest estimated error of a substep; 0 means substeps of at most `substep` s without
error control. Inputs may change within a step: see `body.driven`.
Source: E. Hairer, S. P. Norsett & G. Wanner, Solving Ordinary Differential Equations I, 2nd ed. 1993, II.5 and II.10.
"""

import math
from pathlib import Path

import numpy as np

from rbfmu.models.registry import ModelSpec
from rbfmu.runs.plan import Plan
from rbfmu.studies.one_step import OneStepMethod
from rbfmu_kernels.body.driven import DRIVEN, STEP_SIZE, finish, keep, load_polynomial_of, part_to_integrate
from rbfmu_kernels.body.memory import STATE_START, body_of, loads_of
from rbfmu_kernels.body.shell import make_model
from rbfmu_kernels.buffer import MAX_SUBSTEPS, OK, STEP_REJECTED, with_work_space
from rbfmu_kernels.buffer_access import copy_numbers, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.integrators.substeps import LONGEST_STEP, count_substep, substeps_in, tolerance_of_substep
from rbfmu_kernels.mechanics import equations_of_motion as motion
from rbfmu_kernels.mechanics.equations_of_motion import OMEGA, R_C, ROTATION, V_C, WHOLE_STATE, Body, Loads
from rbfmu_kernels.rotations.quaternion import quaternion_rate_b
from rbfmu_kernels.rotations.vec3 import dot, largest_component
from rbfmu_kernels.types import Buffer

STAGES = 12
_TABLEAU = np.loadtxt(Path(__file__).with_name("dop853.csv"), delimiter=",")
A = _TABLEAU[: STAGES + 1]
"""A[s, l]: the weight of rate l in stage s; row 12 has the weights of the result."""
C = np.sum(A, axis=1)
"""C[s]: the time of stage s as a part of the step."""
E5, E3 = _TABLEAU[STAGES + 1], A[STAGES] - _TABLEAU[STAGES + 2]
"""The weights of the rates in the two error estimates; E3 is the result's weights less those of order 3."""

_LAYOUT = with_work_space(DRIVEN, motion.STATE_SIZE * (STAGES + 1))
"""The work space has the trial state, followed by the rates of the stages."""
_AT = _LAYOUT.at
_WORK: int = _AT.work


@kernel
def _stage_rates(s: int) -> int:
    """Return the place where the rates of stage s begin."""
    return _WORK + motion.STATE_SIZE * (s + 1)


@kernel(inline=False)
def _put_rates(z: Buffer, y: int, k: int, n: int, body: Body, loads: Loads) -> None:
    """Set z[k:] to d/dt of the state z[y:]."""
    q_ab, omega_b = quaternion_at(z, y), vec3_at(z, y + OMEGA)
    put_quaternion_at(z, k, quaternion_rate_b(q_ab, omega_b))
    put_vec3_at(z, k + OMEGA, motion.angular_acceleration(q_ab, omega_b, body, loads))
    if n == WHOLE_STATE:
        put_vec3_at(z, k + R_C, vec3_at(z, y + V_C))
        put_vec3_at(z, k + V_C, motion.turning_acceleration(q_ab, body, loads))


@kernel
def _combine(z: Buffer, n: int, s: int, h: float) -> None:
    """Set the trial state to y + h sum_l A[s, l] k_l; s is a literal, so that the sum is unrolled without zeros."""
    for j in range(n):
        total = 0.0
        for l in range(s):
            if A[s, l] != 0.0:
                total += A[s, l] * z[_stage_rates(l) + j]
        z[_WORK + j] = z[STATE_START + j] + h * total


@kernel(inline=False)
def _loads_at(loads: motion.LoadPolynomial, t: float) -> Loads:
    return motion.loads_after(loads, t)


@kernel
def _stage(z: Buffer, n: int, s: int, t: float, h: float, body: Body, loads: motion.LoadPolynomial) -> None:
    """Compute the trial state and the rates of stage s > 0 (a literal), with the loads at t + c_s h."""
    _combine(z, n, s, h)
    now = _loads_at(loads, t + C[s] * h) if motion.is_changing(loads) else loads.value
    _put_rates(z, _WORK, _stage_rates(s), n, body, now)


@kernel(inline=False)
def dop853_step(z: Buffer, n: int, t: float, h: float, body: Body, loads: motion.LoadPolynomial) -> None:
    """Take a step of order 8 into the trial state, whose quaternion is not normalised; the rates of all stages remain.

    t: the time since the start of the loads' polynomial, s.
    Stable up to h d / I = 6.394 (damping) and h omega / 2 = 5.96 (attitude).
    """
    now = _loads_at(loads, t) if motion.is_changing(loads) else loads.value
    _put_rates(z, STATE_START, _stage_rates(0), n, body, now)
    _stage(z, n, 1, t, h, body, loads)
    _stage(z, n, 2, t, h, body, loads)
    _stage(z, n, 3, t, h, body, loads)
    _stage(z, n, 4, t, h, body, loads)
    _stage(z, n, 5, t, h, body, loads)
    _stage(z, n, 6, t, h, body, loads)
    _stage(z, n, 7, t, h, body, loads)
    _stage(z, n, 8, t, h, body, loads)
    _stage(z, n, 9, t, h, body, loads)
    _stage(z, n, 10, t, h, body, loads)
    _stage(z, n, 11, t, h, body, loads)
    _combine(z, n, 12, h)


@kernel(inline=False)
def _error(z: Buffer, n: int, h: float) -> float:
    """Return the estimated error of the step.

    Attitude in rad; position and velocity relative to their largest component, or to 1 if that is smaller; rates
    relative to their largest component, or as the angle in rad that their error makes over the span if that is more.
    """
    y, span = STATE_START, z[_AT.span]
    rate = max(largest_component(vec3_at(z, y + OMEGA)), largest_component(vec3_at(z, _WORK + OMEGA)), 1e-300)
    rate = rate if rate * span <= 1.0 else 1.0 / span
    position = max(largest_component(vec3_at(z, y + R_C)), 1.0)
    velocity = max(largest_component(vec3_at(z, y + V_C)), 1.0)
    five, three = 0.0, 0.0
    for j in range(n):
        e5, e3 = 0.0, 0.0
        for l in range(STAGES):
            k = z[_stage_rates(l) + j]
            e5 += E5[l] * k
            e3 += E3[l] * k
        size = 0.5 if j < OMEGA else (rate if j < R_C else (position if j < V_C else velocity))
        five += (e5 / size) * (e5 / size)
        three += (e3 / size) * (e3 / size)
    if five == 0.0:
        return 0.0
    return h * five / math.sqrt((five + 0.01 * three) * (7.0 if n == ROTATION else 13.0))


@kernel
def _accept(z: Buffer, n: int) -> None:
    """Copy the trial state to the state, with its quaternion scaled to length 1."""
    copy_numbers(z, _WORK + OMEGA, STATE_START + OMEGA, n - OMEGA)
    motion.put_unit_attitude(z, STATE_START, quaternion_at(z, _WORK))


@kernel(inline=False)
def _march(z: Buffer, n: int, h: float, body: Body, loads: motion.LoadPolynomial) -> int:
    """Advance the state by h in equal steps of at most `substep`, without error control.

    Return STEP_REJECTED, with the state unchanged, if too many steps are needed.
    """
    count = substeps_in(h, z[_AT.substep])
    for i in range(count):
        dop853_step(z, n, h / count * i, h / count, body, loads)
        _accept(z, n)
    return OK if count > 0 else STEP_REJECTED


@kernel(inline=False)
def _follow(z: Buffer, n: int, h: float, body: Body, loads: motion.LoadPolynomial) -> int:
    """Advance the state by h; the estimated error of each step is at most its share of `tolerance`.

    z[STEP_SIZE] is the step size; the number after it counts the steps tried. Each step is the time left, divided by
    the number of steps of that size that it needs, so that the last step is not shorter than the others.
    Return STEP_REJECTED if the motion is not finite or needs too many steps; the caller then restores state and size.
    """
    rest, low, steps = h, 0.0, 0  # rest + low: the time left, without round-off, so that many steps end exactly at h
    while rest > 0.0:
        steps += 1
        count = substeps_in(rest, z[STEP_SIZE])
        if count == 0 or steps >= MAX_SUBSTEPS:
            return STEP_REJECTED
        part = (rest + low) / count
        dop853_step(z, n, h - rest, part, body, loads)
        count_substep(z, STEP_SIZE)
        error = _error(z, n, part) / tolerance_of_substep(z[_AT.tolerance], z[_AT.span], part)
        if error <= 1.0:
            growth = 6.0 if error < 2.6e-7 else 0.9 / math.sqrt(math.sqrt(math.sqrt(error)))
            _accept(z, n)
            left = 0.0 if count == 1 else rest - part
            low += (rest - left) - part
            rest = left
            z[STEP_SIZE] = max(z[STEP_SIZE], part * growth) if growth >= 1.0 else part * growth
        else:
            shrink = 0.9 / math.sqrt(math.sqrt(math.sqrt(error))) if math.isfinite(error) else 0.0
            z[STEP_SIZE] = part * max(0.2, shrink)
    return OK


@kernel
def _set_up(z: Buffer) -> int:
    """Set the first step size to 0.5 / (|omega| + sqrt |alpha|) at the start: a turn of about half a radian."""
    omega = vec3_at(z, STATE_START + OMEGA)
    alpha = motion.angular_acceleration(quaternion_at(z, STATE_START), omega, body_of(z), loads_of(z))
    rate_scale = math.sqrt(dot(omega, omega)) + math.sqrt(math.sqrt(dot(alpha, alpha)))
    z[STEP_SIZE] = 0.5 / rate_scale if rate_scale > 0.0 else LONGEST_STEP
    return 0


@kernel
def _advance(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing if the motion is not finite or needs too many substeps."""
    keep(z)
    body, loads = body_of(z), load_polynomial_of(z)
    n = max(ROTATION, part_to_integrate(z, body, loads))
    status = _follow(z, n, h, body, loads) if z[_AT.tolerance] > 0.0 else _march(z, n, h, body, loads)
    return finish(z, n, h, status, body, loads)


LOADED_DOP853 = make_model("LOADED_DOP853", _LAYOUT, _set_up, _advance)


class Dop853Plan(Plan):
    """The plan of a body under loads by DOP853; planning never selects it, and no FMU contains it."""

    spec = ModelSpec("body under loads", LOADED_DOP853.name)
    kernels = LOADED_DOP853


def _steps(start: motion.State, h: float, n: int, body: Body, loads: Loads) -> motion.State:
    """Return the state of a body after n steps without error control, its quaternion not normalised."""
    z = np.zeros(LOADED_DOP853.SIZE)
    put_quaternion_at(z, STATE_START, start.q_ab)
    put_vec3_at(z, STATE_START + OMEGA, start.omega_b)
    for _ in range(n):
        dop853_step(z, ROTATION, 0.0, h, body, motion.constant_loads(loads))
        copy_numbers(z, _WORK, STATE_START, ROTATION)
    return motion.State(start.r_c, start.v_c, quaternion_at(z, STATE_START), vec3_at(z, STATE_START + OMEGA))


DOP853 = OneStepMethod("DOP853", _steps, 8, float(STAGES))
"""The method in equal steps, without error control, for attitude and rates alone."""
