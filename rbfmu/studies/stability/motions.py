"""The bodies and motions on which laws are measured, their references with 40 digits, and errors, also as maps."""

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu import arrays
from rbfmu.runs.motion import largest_error
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.simulation import SimulationError, simulate
from rbfmu.studies import dop853, one_step, reference_methods, tables_of
from rbfmu.studies.chart.cases import CASES
from rbfmu.studies.stability import Finding, finding
from rbfmu.types import Array
from rbfmu_kernels import Quaternion, Vec3, diagonal, inverse_inertia, quaternion_from_rotvec, scale
from rbfmu_kernels.mechanics.equations_of_motion import Body, State

ZERO: Vec3 = (0.0, 0.0, 0.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
SPHERE: Vec3 = (1.0, 1.0, 1.0)
TUMBLING, FLIPPING, HEAVY_TOP = CASES["a"], CASES["b"], CASES["c"]
"""Motions of the charts: a tumbling brick, the same brick about its middle axis, a fast top with m g l = 1 N m."""
BRICK = TUMBLING.moments


def free_body(moments: Vec3, damping_b: Vec3 = ZERO) -> Body:
    """Return a free body in principal axes."""
    M = diagonal(moments)
    return Body(1.0, M, inverse_inertia(M), ZERO, damping_b, 1.0)


def at(q: Quaternion, omega_b: Vec3) -> State:
    """Return a state with this attitude and rate, at rest at the origin."""
    return State(ZERO, ZERO, q, omega_b)


def spin(rate: float) -> State:
    """Return the state of a body that turns about z, rad/s."""
    return at(UPRIGHT, (0.0, 0.0, rate))


def attitude_after(state: State, t: float) -> Quaternion:
    """Return the attitude after t s at the constant rate of the state; the initial attitude is upright."""
    return quaternion_from_rotvec(scale(t, state.omega_b))


def free_rates(omega_b: Vec3, times: Array) -> Array:
    """Return the exact rates (n, 3) of the free brick, rad/s, at times (n) in s."""
    return np.asarray(arrays.free_rotation(BRICK, UPRIGHT, omega_b, times)[1])


def scene_of(start: State, asked: Sequence[str], stop: float, step: float, changes: Mapping[str, Any]) -> Scene:
    """Return the scene of a brick of 1 kg without weight; asked: its outputs; changes: as for `Scene.replace`."""
    initial = {"initial.attitude": {"quaternion": list(start.q_ab)}, "initial.omega_b": list(start.omega_b)}
    shown = {"outputs.quantities": list(asked), "run.stop": stop, "run.step": step}
    return TUMBLING.scene.replace({**initial, **shown, **changes})


REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by tests/support/references/stability_references.py."""
POINTS = 10
"""The number of points at which a motion is compared."""
QUANTITIES = ("quaternion", "omega_b", "position", "velocity", "omega_a", "angular_momentum_a", "kinetic_energy")
STATE = QUANTITIES[:4]


def _motion(tables: dict[str, Any]) -> Scene:
    run = tables["run"] | {"step": tables["run"]["stop"] / POINTS, "accuracy": 1e-9}
    return Scene.from_dict({"outputs": {"quantities": list(QUANTITIES)}} | tables | {"run": run})


MOTIONS = {key: _motion(tables) for key, tables in tables_of("stability/motions.toml").items()}
"""The motions on which laws 13 and 14 are measured."""


@cache
def references() -> dict[str, Any]:
    """Return the content of the file of references."""
    return json.loads(REFERENCES.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def truth(key: str) -> dict[str, Array]:
    """Return the true quantities of a motion at its communication points, without the start."""
    return {name: np.array(references()["motions"][key][name]) for name in QUANTITIES}


def error_of(found: Mapping[str, Array], true: Mapping[str, Array]) -> float:
    """Return the largest error: attitude in rad, others relative to the largest norm (at least 1 m, 1 m/s).

    A quaternion whose length is not 1 counts as an error of the attitude.
    """
    rows = {name: values.reshape(len(values), -1) for name, values in found.items()}
    return largest_error(rows, true, rows)


def attitude_error(q: Array, true_q: Array) -> float:
    """Return the largest error of attitudes (n, 4), rad."""
    return error_of({"quaternion": q}, {"quaternion": true_q})


def error_of_model(key: str, planned: Plan, parts: int = 1) -> float:
    """Return the error of a motion that `simulate` computes; infinite if the model refuses it.

    parts: the number of communication steps from one known point to the next.
    """
    scene = MOTIONS[key].replace({"run.step": MOTIONS[key].run.step / parts})
    try:
        result = simulate(scene, planned=planned)
    except (SceneError, SimulationError):
        return math.inf
    return error_of({name: values[parts::parts] for name, values in result.quantities.items()}, truth(key))


PRESCRIBED: list[list[Any]] = tables_of("stability/models.toml")["prescribed"]
"""For each step: its length in s, and omega_b with its first and second derivative at the start of the step."""


def prescribed_error() -> float:
    """Return the largest attitude error in rad after the steps of `PRESCRIBED`, under prescribed rates."""
    scene = Scene.from_dict({"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}})
    planned = Plan("prescribed rates", "", 4)
    kernels, z = planned.kernels, start_run(scene, planned)
    found: list[Array] = []
    for h, omega, rate, rate_2 in PRESCRIBED:
        for name, value in (("omega_b", omega), ("omega_b_rate", rate), ("omega_b_rate_2", rate_2)):
            z[kernels.BLOCKS[name]] = value
        found.append(np.full(4, np.nan) if kernels.step(z, h) else z[kernels.BLOCKS["quaternion"]].copy())
    return attitude_error(np.array(found), np.array(references()["prescribed"]))


# Maps over the step and the body's shape: each cell says whether a method is right, wrong or not finite


VERDICTS = RIGHT, WRONG, NOT_FINITE, REFUSED = "right", "wrong", "not finite", "refused with a message"
LARGEST_ERROR = 0.1
"""The largest error in rad over a run that still counts as right."""
TURN, LONG_TURN, CHECKS = 100.0, 1000.0, 20
"""In a run the body turns by TURN rad, or by LONG_TURN rad with steps above 1 rad; CHECKS points are compared."""
CHECK_TIMES = sorted({turn * (k + 1) / CHECKS for turn in (TURN, LONG_TURN) for k in range(CHECKS)})
_START = at((0.8, 0.4, -0.4, 0.2), (0.1, 0.2, 0.96875))
"""The initial state: a rotation at about 1 rad/s, mostly about the axis of the least moment."""
ACCURACY = 1e-9
"""The accuracy in rad that is asked of rbfmu, and so the bound of its error in each cell of a map."""

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
    """Return three moments of inertia; the least is `ratio` times the largest: from a rod (0) to a sphere (1)."""
    return 1.0, 1.0 - 0.5 * ratio * (1.0 - ratio), ratio


def ratios_of_moments(quick: bool) -> list[float]:
    """Return the ratios of moments of a map, from a rod to a sphere."""
    return [round(float(x), 6) for x in np.geomspace(0.01, 1.0, 13)][:: 6 if quick else 1]


def steps_of_a_turn(h: float) -> tuple[float, int]:
    """Return the angle in rad that a run turns by, and its number of steps of at most h rad, a multiple of CHECKS."""
    turn = TURN if h <= 1.0 else LONG_TURN
    return turn, CHECKS * math.ceil(turn / (CHECKS * h) * (1.0 - 1e-12))


def grid(quick: bool) -> tuple[list[float], list[float]]:
    """Return the steps (h omega, rad) and the ratios of moments of a map."""
    sizes = (steps_of_a_turn(h) for h in np.geomspace(0.01, 10.0, 4 if quick else 25).tolist())
    return [turn / n for turn, n in sizes], ratios_of_moments(quick)


def map_scene(ratio: float, turn: float = TURN, n: int = CHECKS, ports: tuple[str, ...] = ()) -> Scene:
    """Return the scene of a free body in a map; with ports, planning cannot use the exact models."""
    changes = {"body.inertia": moments(ratio), "run.accuracy": ACCURACY, "inputs.ports": list(ports)}
    return scene_of(_START, ["quaternion"], turn, turn / n, changes)


def _verdict(ratio: float, turn: float, attitudes: Array) -> Verdict:
    """Return the verdict on quaternions (CHECKS, 4) at the points that are compared."""
    rows = dict(zip(CHECK_TIMES, references()["maps"][repr(ratio)], strict=True))
    error = attitude_error(attitudes, np.array([rows[turn * (k + 1) / CHECKS] for k in range(CHECKS)]))
    return (RIGHT if error <= LARGEST_ERROR else WRONG if error < math.inf else NOT_FINITE), error


def verdict_of_steps(method: one_step.OneStepMethod, h: float, ratio: float) -> Verdict:
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
    "rbfmu DOP853": partial(_with_port, dop853.Dop853Plan("body under loads", "", 7, tolerance=1e-14)),
    "rbfmu Taylor 16": partial(_with_port, Plan("body under loads, by series", "", 7, tolerance=1e-14, order=16)),
}
METHODS = {name: partial(verdict_of_steps, method) for name, method in reference_methods.ALL_INTEGRATORS.items()} | OURS
"""The functions that return a verdict for (h, ratio), by the method's name."""
QUICK_METHODS = ("semi-implicit Euler", "RK4, quaternion", *OURS)


def verdicts(name: str, judge: Callable[[float, float], Verdict], quick: bool) -> list[Row]:
    """Return the rows of one map."""
    steps, ratios = grid(quick)
    return [Row(name, h, ratio, *judge(h, ratio)) for ratio in ratios for h in steps]


def findings_of_maps(rows: Iterable[Row]) -> list[Finding]:
    """Return the findings, one per cell: the error of rbfmu is within the accuracy asked (infinite: it refused)."""
    where = "h omega {:.3g}, moments {:g}".format
    return [
        finding("map", error, ACCURACY, place=where(h, ratio), name=name)
        for name, h, ratio, _, error in rows if name in OURS
    ]  # fmt: skip
