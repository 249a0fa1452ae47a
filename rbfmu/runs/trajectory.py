"""Runs of a model, of which blocks of its buffer are kept."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.runs.model_buffer import Buffer, filled_buffer, initialize
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import active_flags

Motion = dict[str, NDArray[np.float64]]


def start_run(scene: Scene, plan: Plan, names: Sequence[str]) -> Buffer:
    """Return the buffer of the plan's model at the start, of whose outputs only those named are computed."""
    kernels, z = plan.kernels, filled_buffer(scene, plan)
    if "active" in kernels.BLOCKS:
        z[kernels.BLOCKS["active"]] = active_flags(names)
    initialize(scene, kernels, z)
    return z


def record_trajectory(
    kernels: Any,
    z: Buffer,
    steps: Sequence[float],
    names: Sequence[str],
    parts: int = 1,
    progress: Callable[[float], Any] | None = None,
) -> Motion:
    """Return the blocks now and after each step (s), taken in equal parts; NaN from where the motion ends.

    progress: a function that is told which part of the run is done.
    """
    blocks = {name: z[kernels.BLOCKS[name]] for name in names}
    motion = {name: np.full((len(steps) + 1, len(block)), np.nan) for name, block in blocks.items()}
    step = tiered(kernels.step)
    for k, h in enumerate((0.0, *steps)):
        if k and any(step(z, h / parts) != OK for _ in range(parts)):
            break
        for name, block in blocks.items():
            motion[name][k] = block
        if progress is not None:
            progress(k / len(steps))
    return motion


def substeps_counted(kernels: Any, z: Buffer) -> float:
    """Return the number of substeps since the start; 0 where the model counts none."""
    return float(z[kernels.BLOCKS["substeps"]][0]) if "substeps" in kernels.BLOCKS else 0.0
