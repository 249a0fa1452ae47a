"""The points in time at which a scene communicates."""

import math

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene import Scene

Array = NDArray[np.float64]


def time_grid(start: float, stop: float, step: float) -> Array:
    """start, start + step, ... stop: the points that FMPy visits, to the bit."""
    steps = math.ceil((stop - start) / step * (1.0 - 1e-9))
    grid: Array = start + np.arange(steps + 1, dtype=np.float64) * step
    if not math.isclose(grid[-1], stop):
        grid[-1] = stop
    return grid


def thinned_grid(scene: Scene, most: int) -> Array:
    """The scene's grid, of which every so many points where there are more steps than `most`; always the last."""
    grid = time_grid(scene.run.start, scene.run.stop, scene.run.step)
    stride = math.ceil((len(grid) - 1) / most)
    return grid if stride == 1 else np.append(grid[:-1:stride], grid[-1])
