"""The points in time at which a scene communicates."""

import math

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene import Scene

Array = NDArray[np.float64]


def time_grid(start: float, stop: float, step: float) -> Array:
    """start, start + step, ... stop: the points that FMPy visits, to the bit."""
    grid: Array = start + np.arange(_count(stop - start, step) + 1, dtype=np.float64) * step
    if not math.isclose(grid[-1], stop):
        grid[-1] = stop
    return grid


def communication_steps(scene: Scene) -> int:
    """How many the run has."""
    return _count(scene.run.stop - scene.run.start, scene.run.step)


def thinned_steps(scene: Scene, most: int) -> list[float]:
    """The lengths of the scene's steps, s; of several at once where there are more than `most`."""
    grid = time_grid(scene.run.start, scene.run.stop, scene.run.step)
    stride = math.ceil((len(grid) - 1) / most)
    steps: list[float] = np.diff(grid if stride == 1 else np.append(grid[:-1:stride], grid[-1])).tolist()
    return steps


def _count(span: float, step: float) -> int:
    return math.ceil(span / step * (1.0 - 1e-9))
