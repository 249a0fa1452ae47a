"""Bodies and states that the laws are measured on, and product methods as one-step methods."""

import math
from typing import Any

import numpy as np

from rbfmu.result import Result
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.simulation import simulate
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS, OneStepMethod
from rbfmu_kernels.integrators import dop853, splitting
from rbfmu_kernels.integrators.rigid_body_state import (
    ROTATION,
    STATE_SIZE,
    put_state_attitude,
    put_state_omega,
    state_attitude,
    state_omega,
)
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS as NO_LOADS
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State, constant_loads
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia
from rbfmu_kernels.mechanics.newton_euler import kinetic_energy
from rbfmu_kernels.rotations.quaternion import angle_between
from rbfmu_kernels.types import Quaternion, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
SPHERE: Vec3 = (1.0, 1.0, 1.0)
BRICK: Vec3 = (1.0, 2.0, 3.0)
TUMBLE = State(ZERO, ZERO, (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2))
"""With BRICK, this is case a of the work-precision diagrams."""
TOP_MOMENTS: Vec3 = (1.0, 1.0, 0.3)
"""Moments of inertia about the pivot; the centre of mass is on the z axis, and m g l = 1 N m."""
WEIGHT = Loads(ZERO, (0.0, 0.0, -1.0), ZERO, ZERO, ZERO)

SPLITTINGS = {
    "Strang": OneStepMethod("Strang", splitting.strang_steps, 2, 1),
    "RKN4": OneStepMethod("RKN4", splitting.rkn4_steps, 4, 6),
    "RKN6": OneStepMethod("RKN6", splitting.rkn6_steps, 6, 11),
}


def free_body(moments: Vec3, damping_b: Vec3 = ZERO) -> Body:
    """Return a free body in principal axes."""
    M = diagonal(moments)
    return Body(1.0, M, inverse_inertia(M), ZERO, damping_b, 1.0)


def heavy_top() -> Body:
    """Return a symmetric body on a pivot, its weight 1 acting at (0, 0, 1)."""
    M = diagonal(TOP_MOMENTS)
    return Body(0.0, M, inverse_inertia(M), (0.0, 0.0, 1.0), ZERO, 0.0)


def at(q: Quaternion, omega_b: Vec3) -> State:
    """Return a state of rotation."""
    return State(ZERO, ZERO, q, omega_b)


def spin(rate: float) -> State:
    """Return the state of a body that turns about z."""
    return at(UPRIGHT, (0.0, 0.0, rate))


def angle(a: State, q: Quaternion) -> float:
    """Return the attitude's error in rad; NaN where it is not finite."""
    return angle_between(a.q_ab, q)


def turned(state: State, t: float) -> Quaternion:
    """Return the attitude of a sphere after the time t; its rate is constant."""
    (e, x, y, z), omega = state.q_ab, state.omega_b
    rate = math.hypot(*omega)
    a, s = math.cos(0.5 * rate * t), math.sin(0.5 * rate * t) / rate
    b, c, d = s * omega[0], s * omega[1], s * omega[2]
    return (
        e * a - x * b - y * c - z * d, e * b + x * a + y * d - z * c,
        e * c - x * d + y * a + z * b, e * d + x * c - y * b + z * a,
    )  # fmt: skip


def free_motion(moments: Vec3, start: State, stop: float, step: float) -> Result:
    """Return the torque-free motion by the product's model."""
    scene = Scene.from_dict({
        "body": {"mass": 1.0, "inertia": moments},
        "initial": {"attitude": {"quaternion": start.q_ab}, "omega_b": start.omega_b},
        "loads": {"gravity_a": ZERO},
        "outputs": {"quantities": ["omega_b"]},
        "run": {"stop": stop, "step": step},
    })  # fmt: skip
    return simulate(scene, planned=Plan("torque-free body", "", 3))


def damped_rate(planned: Plan, x: float) -> float:
    """Return the rate after one step of a product's model from a damped spin of 1 rad/s with h d / I = x."""
    scene = Scene.from_dict({
        "body": {"mass": 1.0, "inertia": SPHERE},
        "initial": {"omega_b": (0.0, 0.0, 1.0)},
        "loads": {"gravity_a": ZERO, "damping_b": (x, x, x)},
        "outputs": {"quantities": ["omega_b"]},
        "run": {"stop": 1.0, "step": 1.0},
    })  # fmt: skip
    return float(simulate(scene, planned=planned).omega_b[1, 2])


def rotational_energy(moments: Vec3, state: State) -> float:
    """Return omega . M omega / 2."""
    return kinetic_energy(0.0, diagonal(moments), ZERO, state.omega_b)


def top_energy(state: State) -> float:
    """Return the kinetic and potential energy of the heavy top."""
    q = state.q_ab
    return rotational_energy(TOP_MOMENTS, state) + 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])


def one_step(method: str) -> Any:
    """Return `step(state, h, body, loads)` of a reference integrator, or of DOP853 without normalisation."""
    if method == "DOP853":
        return _dop853_step
    integrator = REFERENCE_INTEGRATORS[method]
    return lambda state, h, body, loads: integrator.steps(state, h, 1, body, loads)


def _dop853_step(state: State, h: float, body: Body, loads: Loads) -> State:
    z = np.zeros(STATE_SIZE + dop853.WORK)
    put_state_attitude(z, 0, state.q_ab)
    put_state_omega(z, 0, state.omega_b)
    dop853.dop853_step(z, 0, STATE_SIZE, ROTATION, 0.0, h, body, constant_loads(loads))
    return at(state_attitude(z, STATE_SIZE), state_omega(z, STATE_SIZE))
