"""Motions: what a model's buffer shows over a run, and errors between two of these."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu import arrays
from rbfmu.models.model_buffer import Buffer
from rbfmu.runs.inputs import Drive, Driven
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import ANGLE, OUTPUT, OUTPUTS
from rbfmu_kernels.rotations.quaternion import angle_between

Motion = dict[str, NDArray[np.float64]]


def start_run(scene: Scene, plan: Plan, names: Sequence[str]) -> Buffer:
    """Return the buffer of the plan's model at the start, of whose outputs only those named are computed."""
    z = filled_buffer(scene, plan, names)
    initialize(scene, plan.kernels, z)
    return z


def record_trajectory(
    kernels: Any,
    z: Buffer,
    steps: Sequence[float],
    names: Sequence[str],
    parts: int = 1,
    progress: Callable[[float], Any] | None = None,
    most: float = math.inf,
) -> Motion:
    """Return the blocks now and after each step (s), taken in equal parts; NaN from where the motion ends.

    progress: a function that is told which part of the run is done; most: the number of substeps after which it ends.
    """
    step = tiered(kernels.step, len(steps) * parts)
    return _recorded(
        kernels,
        z,
        len(steps),
        names,
        lambda k: all(
            step(z, steps[k - 1] / parts) == OK and substeps_counted(kernels, z) <= most for _ in range(parts)
        ),
        progress,
    )


def record_driven(
    scene: Scene, plan: Plan, drive: Drive, names: Sequence[str], most: float = math.inf
) -> tuple[Motion, float]:
    """Return the blocks at the communication points of a run under inputs, NaN from where it ends, and its substeps.

    most: the number of substeps after which it ends.
    """
    driven = Driven(scene, plan, drive, names)

    def advance(k: int) -> bool:
        return driven.advance(k) and substeps_counted(plan.kernels, driven.z) <= most

    motion = _recorded(plan.kernels, driven.z, len(drive.time) - 1, names, advance)
    return motion, substeps_counted(plan.kernels, driven.z)


def _recorded(
    kernels: Any,
    z: Buffer,
    count: int,
    names: Sequence[str],
    advance: Callable[[int], bool],
    progress: Callable[[float], Any] | None = None,
) -> Motion:
    blocks = {name: z[kernels.BLOCKS[name]] for name in names}
    motion = {name: np.full((count + 1, len(block)), np.nan) for name, block in blocks.items()}
    for k in range(count + 1):
        if k and not advance(k):
            break
        for name, block in blocks.items():
            motion[name][k] = block
        if progress is not None:
            progress(k / count)
    return motion


def substeps_counted(kernels: Any, z: Buffer) -> float:
    """Return the number of substeps since the start; 0 where the model counts none."""
    return float(z[kernels.BLOCKS["substeps"]][0]) if "substeps" in kernels.BLOCKS else 0.0


__all__ = ["attitude_error", "largest_error", "relative_error"]

Array = NDArray[np.float64]
FEW = 20_000
"""The number of rows up to which the array function is not worth its compilation."""
FLOORS: Mapping[str, float] = {row.name: row.floor for row in OUTPUTS if row.floor}
"""The least size, m or m/s, that an error is relative to, by the quantity's name."""


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
        if OUTPUT[name].error == ANGLE:
            errors = attitude_error(a[name], b[name])
        else:
            errors = relative_error(a[name], b[name], floors.get(name, 0.0))
        largest = float(np.max(errors))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst
