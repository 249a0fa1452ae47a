"""Run a scene by its plan."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import SimulationError as SimulationError
from rbfmu.result import Result
from rbfmu.runs.model_buffer import filled_buffer, initialize, output_block
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import time_grid
from rbfmu.scene.argument import of_scene_or_path
from rbfmu.scene.plausibility import doubts_after, warn
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered

Array = NDArray[np.float64]


@of_scene_or_path
def plan(scene: Scene, full: bool = False, progress: Callable[[float], Any] | None = None) -> Plan:
    """Choose model, method and step for a scene, or that of a scene file; full: to integrate all degrees of freedom.

    progress: a function that is told from time to time which part of the motion that judges plans is known.
    Raises SceneError where the accuracy asked cannot be met.
    """
    return _planned(scene, full, progress)


def _planned(scene: Scene, full: bool = False, progress: Callable[[float], Any] | None = None) -> Plan:
    from rbfmu.planning import plan as planned  # a run whose plan is known does without

    return planned(scene, full, progress)


@of_scene_or_path
def simulate(
    scene: Scene, *, planned: Plan | None = None, progress: Callable[[Sequence[int]], Any] | None = None
) -> Result:
    """Run a scene, or that of a scene file, with its ports at zero: its FMU's bits at the same communication step.

    progress: wraps the sequence of step numbers, e.g. a progress bar. Raises SceneError, SimulationError.
    """
    planned = planned or _planned(scene)
    kernels, z = planned.kernels, filled_buffer(scene, planned)
    initialize(scene, kernels, z)
    time = time_grid(scene.run.start, scene.run.stop, scene.run.step)
    block = output_block(scene, kernels)
    outputs = z[block]
    rows = np.empty((len(time), len(outputs)))
    rows[0] = outputs
    step, numbers = tiered(kernels.step), range(1, len(time))
    for k in numbers if progress is None else progress(numbers):
        if step(z, time[k] - time[k - 1]) != OK:
            raise SimulationError(f"{scene.name}: the step from t = {float(time[k - 1])!r} s was refused: not finite")
        rows[k] = outputs
    result = Result(time, {n: _quantity(rows, kernels.BLOCKS[n], block.start) for n in scene.outputs.quantities})
    warn(scene, doubts_after(scene, result.quantities), stacklevel=4)
    return result


def _quantity(rows: Array, block: slice, first: int) -> Array:
    values = rows[:, block.start - first : block.stop - first].copy()
    return values[:, 0] if values.shape[1] == 1 else values
