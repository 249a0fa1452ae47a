"""Motions: what a model's buffer shows over a run, and errors between two of these.

Errors are counted as a scene's `accuracy` counts them: of the attitude as an angle, rad; of all else relative to the
largest size in the run, as a quantity that passes through zero has no error relative to itself there.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.runs.inputs import Driven
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Buffer, Motion
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import ANGLE, OUTPUT, OUTPUTS
from rbfmu_kernels.rotations.quaternion import angle_between

FEW = 20_000
"""The number of rows up to which the array function is not worth its compilation."""
FLOORS: Mapping[str, float] = {row.name: row.floor for row in OUTPUTS if row.floor}
"""The least size, m or m/s, that an error is relative to, by the quantity's name."""


class Steps:
    """A run without inputs, at its start: its buffer `z`, and `advance` by each of the steps (s), in equal parts."""

    def __init__(
        self, scene: Scene, plan: Plan, steps: Sequence[float], names: Collection[str], parts: int = 1
    ) -> None:
        self.kernels, self.z, self.count = plan.kernels, start_run(scene, plan, names), len(steps)
        self._lengths, self._parts, self._step = steps, parts, tiered(plan.kernels.step, len(steps) * parts)

    def advance(self, k: int) -> bool:
        """Take step k, counted from 1; return whether none of its parts was refused."""
        h = self._lengths[k - 1] / self._parts
        return all(self._step(self.z, h) == OK for _ in range(self._parts))


def record(
    run: Steps | Driven, names: Sequence[str], most: float = math.inf, progress: Callable[[float], Any] | None = None
) -> Motion:
    """Return the blocks named now and after each step; NaN from where the motion ends.

    most: the number of substeps after which it ends; progress: a function that is told which part of the run is done.
    """
    blocks = {name: run.z[run.kernels.BLOCKS[name]] for name in names}
    motion = {name: np.full((run.count + 1, len(block)), np.nan) for name, block in blocks.items()}
    for k in range(run.count + 1):
        if k and not (run.advance(k) and substeps_counted(run.kernels, run.z) <= most):
            break
        for name, block in blocks.items():
            motion[name][k] = block
        if progress is not None:
            progress(k / run.count)
    return motion


def substeps_counted(kernels: Model, z: Buffer) -> float:
    """Return the number of substeps since the start; 0 where the model counts none."""
    return float(z[kernels.BLOCKS["substeps"]][0]) if "substeps" in kernels.BLOCKS else 0.0


# Errors between two motions


def attitude_error(a: Array, b: Array) -> Array:
    """Return the angles, rad, between attitudes: unit quaternions (..., 4)."""
    if np.ndim(a) != 2 or np.shape(a) != np.shape(b) or len(a) > FEW:
        return arrays.angle_between(a, b)  # type: ignore[no-any-return]
    angle = tiered(angle_between)
    return np.array([angle(tuple(p), tuple(q)) for p, q in zip(a, b, strict=True)])


def relative_error(a: Array, b: Array, floor: float) -> Array:
    """Return |a - b| over rows of (n, 3), relative to the largest |b| of the run, at least `floor`."""
    return sizes(a - b, max(largest_size(b), floor) or 1.0)


def largest_size(rows: Array) -> float:
    """Return the largest length of a row, without overflow."""
    unit = float(np.max(np.abs(rows), initial=0.0))
    return unit * float(np.max(sizes(rows, unit))) if 0.0 < unit < math.inf else unit


def sizes(rows: Array, unit: float) -> Array:
    """Return the lengths of rows, in units of one."""
    lengths: Array = np.linalg.norm(rows / unit, axis=-1)
    return lengths


def largest_error(
    a: Mapping[str, Array], b: Mapping[str, Array], names: Iterable[str], floors: Mapping[str, float] = FLOORS
) -> float:
    """Return the largest error of a run in the quantities named; infinite where one is not finite.

    floors: the least size that an error is relative to, by the quantity's name and in its unit.
    """
    worst = 0.0
    for name in names:
        if name in OUTPUT and OUTPUT[name].error == ANGLE:
            errors = attitude_error(a[name], b[name])
        else:
            errors = relative_error(a[name], b[name], floors.get(name, 0.0))
        largest = float(np.max(errors))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst
