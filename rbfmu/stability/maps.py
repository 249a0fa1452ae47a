"""Where a method is right, wrong or not finite: maps over the step and the body's shape, against the exact motion."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rbfmu._free_rotation import free_rotation
from rbfmu.arrays import angle_between
from rbfmu.contestants import CONTESTANTS, TORQUE_FREE_CONTESTANTS, Contestant
from rbfmu.scene import Scene, SceneError
from rbfmu.simulation import SimulationError, simulate
from rbfmu.stability.cases import EXACT_STEPS, NO_LOADS, at, free_body
from rbfmu_kernels.quaternion import normalize
from rbfmu_kernels.shapes import Vec3

RIGHT, WRONG, NOT_FINITE, REFUSED = 0, 1, 2, 3
VERDICTS = ("right", "wrong", "not finite", "refused with a message")
LARGEST_ERROR = 0.1
"""rad, over the whole run: above it a motion is wrong."""
TURN, LEAST_STEPS, CHECKS = 100.0, 100, 20
"""A run turns by this many rad, in at least so many steps, and is compared at so many points or more."""
START = at(normalize((0.9, 0.3, -0.2, 0.1)), (0.1, 0.2, math.sqrt(0.95)))
"""Turning at 1 rad/s, mostly about the axis of the least moment."""
ACCURACY = 1e-6
"""Asked of the product."""


def moments(ratio: float) -> Vec3:
    """Of a body whose least moment is `ratio` times the largest: from a rod to a sphere."""
    return 1.0, 1.0 - 0.5 * ratio * (1.0 - ratio), ratio


def _steps(h: float) -> int:
    return CHECKS * math.ceil(max(TURN / h, LEAST_STEPS) / CHECKS)


def _verdict(ratio: float, time: Any, attitudes: Any) -> int:
    """Of unit quaternions (n, 4) at times (n,)."""
    if not np.all(np.isfinite(attitudes)):
        return NOT_FINITE
    truth, _ = free_rotation(moments(ratio), START[2], START[3], time)
    return RIGHT if float(np.max(angle_between(attitudes, truth))) <= LARGEST_ERROR else WRONG


def verdict_of_steps(method: Contestant, h: float, ratio: float) -> int:
    """Of a one-step method at fixed step."""
    n, body = _steps(h), free_body(moments(ratio))
    y, attitudes = method.start(START), []
    for _ in range(CHECKS):
        y = method.steps(y, h, n // CHECKS, body, NO_LOADS)
        attitudes.append(method.state_of(y)[2])
    return _verdict(ratio, np.arange(1, CHECKS + 1) * (n // CHECKS) * h, np.array(attitudes))


def verdict_of_product(ports: tuple[str, ...], h: float, ratio: float) -> int:
    """Of `simulate` by its own plan, h the communication step; a port rules out the exact model."""
    scene = {
        "body": {"mass": 1.0, "inertia": moments(ratio)},
        "initial": {"attitude": {"quaternion": START[2]}, "omega_b": START[3]},
        "loads": {"gravity_a": (0.0, 0.0, 0.0)},
        "inputs": {"ports": ports},
        "outputs": {"quantities": ["quaternion"]},
        "run": {"stop": _steps(h) * h, "step": h, "accuracy": ACCURACY},
    }
    try:
        result = simulate(Scene.from_dict(scene))
    except (SceneError, SimulationError):
        return REFUSED
    return _verdict(ratio, result.time, result.quaternion)


def _of_steps(method: Contestant) -> Callable[[float, float], int]:
    return lambda h, ratio: verdict_of_steps(method, h, ratio)


OURS = ("rbfmu: exact steps", "rbfmu: simulate", "rbfmu: simulate, a port")
METHODS: dict[str, Callable[[float, float], int]] = {
    **{name: _of_steps(method) for name, method in (CONTESTANTS | TORQUE_FREE_CONTESTANTS).items()},
    OURS[0]: _of_steps(EXACT_STEPS),
    OURS[1]: lambda h, ratio: verdict_of_product((), h, ratio),
    OURS[2]: lambda h, ratio: verdict_of_product(("torque_b",), h, ratio),
}
"""By name: what gives a verdict for (h, ratio)."""
QUICK_METHODS = ("semi-implicit Euler", "RK4, quaternion", *OURS)

Row = tuple[str, float, float, str]
"""method, h omega, ratio, verdict."""


def grid(quick: bool) -> tuple[list[float], list[float]]:
    """Steps (h omega) and ratios of moments."""
    return np.geomspace(0.01, 10.0, 4 if quick else 25).tolist(), np.geomspace(0.01, 1.0, 3 if quick else 13).tolist()


def verdicts(name: str, quick: bool) -> list[Row]:
    """Rows (method, h omega, ratio, verdict) of one map."""
    steps, ratios = grid(quick)
    return [(name, h, ratio, VERDICTS[METHODS[name](h, ratio)]) for ratio in ratios for h in steps]
