"""Runs of a model, of which blocks of its buffer are kept."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.runs.drive import Drive, Driven
from rbfmu.runs.model_buffer import Buffer, filled_buffer, initialize
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import active_flags

Motion = dict[str, NDArray[np.float64]]


def start_run(scene: Scene, plan: Plan, names: Sequence[str]) -> Buffer:
    """Return the buffer of the plan's model at the start, of whose outputs only those named are computed."""
    z = _filled(scene, plan, names)
    initialize(scene, plan.kernels, z)
    return z


def _filled(scene: Scene, plan: Plan, names: Sequence[str]) -> Buffer:
    kernels, z = plan.kernels, filled_buffer(scene, plan)
    if "active" in kernels.BLOCKS:
        z[kernels.BLOCKS["active"]] = active_flags(names)
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
    z = _filled(scene, plan, names)
    driven = Driven(drive, plan.kernels, z)
    driven.start()
    initialize(scene, plan.kernels, z)

    def advance(k: int) -> bool:
        return driven.advance(k) and substeps_counted(plan.kernels, z) <= most

    motion = _recorded(plan.kernels, z, len(drive.time) - 1, names, advance)
    return motion, substeps_counted(plan.kernels, z)


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
