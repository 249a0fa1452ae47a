"""Pilot runs: a plan tried on its scene before it is used, and the runs that judge it."""

import math
from typing import Any

import numpy as np

from rbfmu.models import Plan
from rbfmu.scene import Scene
from rbfmu.times import thinned_grid
from rbfmu.unit import filled_buffer, initialize
from rbfmu_kernels.layout import FINE

MOST_POINTS = 20_000
"""Communication steps up to which a pilot run has the scene's own; a longer run takes several at once."""
ROUND_OFF = 2.0**-52
_JUDGED = ("quaternion", "omega_b", "position", "velocity")

Motion = dict[str, Any]


def communication_steps(scene: Scene) -> int:
    """How many the run has."""
    run = scene.run
    return math.ceil((run.stop - run.start) / run.step * (1.0 - 1e-9))


def references(scene: Scene, tight: Plan) -> list[Motion]:
    """What pilot runs are judged by: two that start a round-off away to either side, as a chaotic motion magnifies it.

    In half steps, so that they share neither steps nor round-off with what they judge.
    """
    return [pilot_run(scene, tight, side)[0] for side in (1.0, -1.0)]


def pilot_run(scene: Scene, trial: Plan, side: float = 0.0) -> tuple[Motion, float]:
    """The motion on the scene's grid (every so many points of a long one), ports at zero, and the substeps it took.

    side: where not 0, the start is shaken and each communication step cut in two.  NaN from where the motion ends.
    """
    unit = trial.unit
    parts, z = 2 if side else 1, _begun(scene, trial, side)
    steps, lengths = communication_steps(scene), np.diff(thinned_grid(scene, MOST_POINTS)).tolist()
    blocks = {n: z[unit.BLOCKS[n]] for n in _JUDGED}
    motion = {n: np.full((len(lengths) + 1, len(b)), np.nan) for n, b in blocks.items()}
    for k, h in enumerate((0.0, *lengths)):
        if k and any(unit.step(z, h / parts) != FINE for _ in range(parts)):
            break
        for n, block in blocks.items():
            motion[n][k] = block
    if math.isfinite(trial.substep):
        return motion, substeps_taken(scene, trial.substep)
    return motion, max(float(z[unit.BLOCKS["substeps"]][0]), float(steps))


def whole_run(scene: Scene, trial: Plan) -> Motion:
    """The motion's begin and end, all in one communication step."""
    unit, z = trial.unit, _begun(scene, trial, 0.0)
    motion = {n: [z[unit.BLOCKS[n]].copy()] for n in _JUDGED}
    fine = unit.step(z, scene.run.stop - scene.run.start) == FINE
    for n, points in motion.items():
        points.append(z[unit.BLOCKS[n]] if fine else points[0] + math.nan)
    return {n: np.array(points) for n, points in motion.items()}


def _begun(scene: Scene, trial: Plan, side: float) -> Any:
    unit, z = trial.unit, filled_buffer(scene, trial)
    _shake(unit, z, side * ROUND_OFF)
    z[unit.BLOCKS["unwanted"]] = [float(name not in _JUDGED) for name in unit.OUTPUTS]
    initialize(scene, unit, z)
    return z


def substeps_taken(scene: Scene, substep: float) -> float:
    """Over the run, where each is at most `substep`."""
    return communication_steps(scene) * math.ceil(scene.run.step / substep * (1.0 - 1e-9))


def _shake(unit: Any, z: Any, part: float) -> None:
    """Inertia, attitude and rates at the start changed by `part` of themselves."""
    z[unit.BLOCKS["inertia"]] *= 1.0 + part * np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    z[unit.BLOCKS["quaternion_0"]] += part * np.array([0.0, 1.0, -1.0, 1.0])
    z[unit.BLOCKS["omega_b_0"]] *= 1.0 + part * np.array([1.0, -1.0, 1.0])
