"""Where a method is right, wrong or not finite: maps over the step and the body's shape, against 40-digit truth."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.simulation import SimulationError, simulate
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu.studies.one_step import OneStepMethod
from rbfmu.studies.reference_methods import ALL_INTEGRATORS
from rbfmu.studies.stability.findings import AT_MOST, Finding
from rbfmu.studies.stability.motions import at, attitude_error, free_body, references, scene_of
from rbfmu.types import Array
from rbfmu_kernels.types import Vec3

VERDICTS = RIGHT, WRONG, NOT_FINITE, REFUSED = "right", "wrong", "not finite", "refused with a message"
LARGEST_ERROR = 0.1
"""The largest error in rad over a run with which a motion still counts as right."""
TURN, LONG_TURN, CHECKS = 100.0, 1000.0, 20
"""A run turns by TURN rad, or by LONG_TURN rad with steps above one radian, and is compared at CHECKS points."""
CHECK_TIMES = sorted({turn * (k + 1) / CHECKS for turn in (TURN, LONG_TURN) for k in range(CHECKS)})
_START = at((0.8, 0.4, -0.4, 0.2), (0.1, 0.2, 0.96875))
"""The initial state: a rotation at about 1 rad/s, mostly about the axis of the least moment."""
ACCURACY = 1e-9
"""The accuracy in rad that is asked of the product, which bounds its error in each cell of a map."""

Verdict = tuple[str, float]
"""One of VERDICTS, and the largest error in rad."""


class Row(NamedTuple):
    """A cell of a map; error: the largest, in rad."""

    method: str
    h_omega: float
    moment_ratio: float
    verdict: str
    error: float


def moments(ratio: float) -> Vec3:
    """Return the moments of a body whose least one is `ratio` times the largest: from a rod to a sphere."""
    return 1.0, 1.0 - 0.5 * ratio * (1.0 - ratio), ratio


def ratios_of_moments(quick: bool) -> list[float]:
    """Return ratios of moments from a rod to a sphere."""
    return [round(float(x), 6) for x in np.geomspace(0.01, 1.0, 13)][:: 6 if quick else 1]


def steps_of_a_turn(h: float) -> tuple[float, int]:
    """Return the turn of a run with steps of at most h omega, and their number, a multiple of CHECKS."""
    turn = TURN if h <= 1.0 else LONG_TURN
    return turn, CHECKS * math.ceil(turn / (CHECKS * h) * (1.0 - 1e-12))


def grid(quick: bool) -> tuple[list[float], list[float]]:
    """Return steps (h omega) and ratios of moments."""
    sizes = (steps_of_a_turn(h) for h in np.geomspace(0.01, 10.0, 4 if quick else 25).tolist())
    return [turn / n for turn, n in sizes], ratios_of_moments(quick)


def map_scene(ratio: float, turn: float = TURN, n: int = CHECKS, ports: tuple[str, ...] = ()) -> Scene:
    """Return the free body of a map; a port rules out the exact models."""
    more = {"run.accuracy": ACCURACY, "inputs.ports": list(ports)}
    return scene_of({"inertia": moments(ratio)}, _START, ["quaternion"], turn, turn / n, **more)


def _verdict(ratio: float, turn: float, attitudes: Array) -> Verdict:
    """Return the verdict on quaternions of shape (CHECKS, 4)."""
    if not np.all(np.isfinite(attitudes)):
        return NOT_FINITE, math.inf
    rows = dict(zip(CHECK_TIMES, references()["maps"][repr(ratio)], strict=True))
    error = attitude_error(attitudes, [rows[turn * (k + 1) / CHECKS] for k in range(CHECKS)])
    return (RIGHT if error <= LARGEST_ERROR else WRONG), error


def verdict_of_steps(method: OneStepMethod, h: float, ratio: float) -> Verdict:
    """Return the verdict on a one-step method with a fixed step."""
    turn, n = steps_of_a_turn(h)
    path = method.path(_START, turn / n, [n // CHECKS] * CHECKS, free_body(moments(ratio)))
    return _verdict(ratio, turn, np.array([method.state_of(y).q_ab for y in path]))


def verdict_of_product(ports: tuple[str, ...], planned: Plan | None, h: float, ratio: float) -> Verdict:
    """Return the verdict on `simulate` with h as communication step, and with the given plan or its own."""
    turn, n = steps_of_a_turn(h)
    try:
        result = simulate(map_scene(ratio, turn, n, ports), planned=planned)
    except (SceneError, SimulationError):
        return REFUSED, math.inf
    return _verdict(ratio, turn, result.quaternion[n // CHECKS :: n // CHECKS])


_with_port = partial(verdict_of_product, ("torque_b",))
OURS: dict[str, Callable[[float, float], Verdict]] = {
    "rbfmu planned": partial(verdict_of_product, (), None),
    "rbfmu, a port": partial(_with_port, None),
    "rbfmu DOP853": partial(_with_port, Dop853Plan("body under loads", "", 7, tolerance=1e-14)),
    "rbfmu Taylor 16": partial(_with_port, Plan("body under loads, by series", "", 7, tolerance=1e-14, order=16)),
}
METHODS = {name: partial(verdict_of_steps, method) for name, method in ALL_INTEGRATORS.items()} | OURS
"""The functions that return a verdict for (h, ratio), by the method's name."""
QUICK_METHODS = ("semi-implicit Euler", "RK4, quaternion", *OURS)


def verdicts(name: str, judge: Callable[[float, float], Verdict], quick: bool) -> list[Row]:
    """Return the rows of one map."""
    steps, ratios = grid(quick)
    return [Row(name, h, ratio, *judge(h, ratio)) for ratio in ratios for h in steps]


def findings_of_maps(rows: Iterable[Row]) -> list[Finding]:
    """Return the findings: in each cell the product reaches the accuracy asked and refuses nothing."""
    where = "h omega {:.3g}, moments {:g}".format
    return [
        Finding(15, f"{name}: attitude error, rad", ACCURACY, error, 0.0, AT_MOST, where(h, ratio))
        for name, h, ratio, _, error in rows if name in OURS
    ]  # fmt: skip
