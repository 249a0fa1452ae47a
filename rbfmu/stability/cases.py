"""Bodies and states that the laws are measured on, and product methods as one-step methods."""

from typing import Any

import numpy as np

from rbfmu.contestants import CONTESTANTS, Contestant, compiled_loop
from rbfmu_kernels import dop853, kicked_top
from rbfmu_kernels._kernel import kernel
from rbfmu_kernels.dynamics import Body, Loads, State, steady
from rbfmu_kernels.free_rotation import free_rotation
from rbfmu_kernels.inertia import diagonal, inverse_inertia
from rbfmu_kernels.quaternion import angle_between
from rbfmu_kernels.rigid_body import kinetic_energy
from rbfmu_kernels.shapes import Quaternion, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
NO_LOADS: Loads = (ZERO, ZERO, ZERO, ZERO, ZERO)
SPHERE: Vec3 = (1.0, 1.0, 1.0)
BRICK: Vec3 = (1.0, 2.0, 3.0)
TUMBLE: State = (ZERO, ZERO, (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2))
"""With BRICK: case a of the work-precision diagrams."""
TOP_MOMENTS: Vec3 = (1.0, 1.0, 0.3)
"""About the pivot; with m g l = 1 along z."""
WEIGHT: Loads = (ZERO, (0.0, 0.0, -1.0), ZERO, ZERO, ZERO)

KICKS = {
    "Strang": Contestant("Strang", kicked_top.strang_steps, 2, 1),
    "RKN4": Contestant("RKN4", kicked_top.rkn4_steps, 4, 6),
    "RKN6": Contestant("RKN6", kicked_top.rkn6_steps, 6, 11),
}


def free_body(moments: Vec3, damping_b: Vec3 = ZERO) -> Body:
    """A body that floats, in principal axes."""
    M = diagonal(moments)
    return 1.0, M, inverse_inertia(M), ZERO, damping_b, 1.0


def heavy_top() -> Body:
    """A symmetric body on a pivot, its weight 1 acting at (0, 0, 1)."""
    M = diagonal(TOP_MOMENTS)
    return 0.0, M, inverse_inertia(M), (0.0, 0.0, 1.0), ZERO, 0.0


def at(q: Quaternion, omega_b: Vec3) -> State:
    """A state of rotation."""
    return ZERO, ZERO, q, omega_b


def spin(rate: float) -> State:
    """Turning about z."""
    return at(UPRIGHT, (0.0, 0.0, rate))


def angle(a: State, q: Quaternion) -> float:
    """The attitude's error in rad; NaN where it is not finite."""
    return angle_between(a[2], q)


def exact(moments: Vec3, state: State, t: float) -> State:
    """The torque-free motion."""
    return at(*free_rotation(moments, state[2], state[3], t))


@kernel(inline=False)
def exact_step(state: State, h: float, body: Body, loads: Loads) -> State:
    """The exact torque-free motion in principal axes, set up anew at each step."""
    M = body[1]
    q, omega = free_rotation((M[0][0], M[1][1], M[2][2]), state[2], state[3], h)
    return state[0], state[1], q, omega


def rotational_energy(moments: Vec3, state: State) -> float:
    """omega . M omega / 2."""
    return kinetic_energy(0.0, diagonal(moments), ZERO, state[3])


def top_energy(state: State) -> float:
    """Of the heavy top: kinetic, and the height of its centre of mass."""
    q = state[2]
    return rotational_energy(TOP_MOMENTS, state) + 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])


def one_step(method: str) -> Any:
    """`step(state, h, body, loads)` of a contestant or of the product's 8th-order Runge-Kutta pair, not normalised."""
    if method == "DOP853":
        return _dop853_step
    contestant = CONTESTANTS[method]
    return lambda state, h, body, loads: contestant.steps(state, h, 1, body, loads)


def _dop853_step(state: State, h: float, body: Body, loads: Loads) -> State:
    z = np.zeros(dop853.STATE + dop853.WORK)
    z[0:4], z[4:7] = state[2], state[3]
    dop853.dop853_step(z, 0, dop853.STATE, dop853.ROTATION, 0.0, h, body, steady(loads))
    after = z[dop853.STATE :].tolist()
    return at(tuple(after[0:4]), tuple(after[4:7]))


EXACT_STEPS = Contestant("exact steps", compiled_loop(exact_step), 0, 0)
"""The product's torque-free motion used as a one-step method."""
