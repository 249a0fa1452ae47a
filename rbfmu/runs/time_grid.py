"""The points in time at which a scene communicates."""

import math

import numpy as np

from rbfmu.scene.scene import Scene
from rbfmu.types import Array


def time_grid(start: float, stop: float, step: float) -> Array:
    """Return start, start + step, ... stop, which the last point may miss by round-off.

    These are to the bit the points that FMPy visits, except at times as large as a Unix clock's, where FMPy ends a run
    within 1e-9 of the time itself.
    """
    grid: Array = start + np.arange(_count(start, stop, step) + 1, dtype=np.float64) * step
    if not abs(grid[-1] - stop) <= _round_off(start, stop):
        grid[-1] = stop
    return grid


def last_time(stop: float, step: float) -> float:
    """Return stop and an importer's round-off, a tenth of a step at most: what is later is past the scene's stop."""
    return stop + min(1e-9 * max(step, abs(stop)), 0.1 * step)


def steps_until(start: float, step: float, time: float) -> int:
    """Return how many communication steps end by a time, which may be short of an end by an importer's round-off."""
    slack = min(_round_off(start, time), 0.1 * step)
    return math.floor(min((time - start + slack) / step, 2.0**62))


def communication_steps(scene: Scene) -> int:
    """Return the number of communication steps of the run."""
    return _count(scene.run.start, scene.run.stop, scene.run.step)


def thinned_steps(scene: Scene, most: int) -> list[float]:
    """Return the lengths of the scene's steps, s, or of several together where there are more than `most`."""
    grid = time_grid(scene.run.start, scene.run.stop, scene.run.step)
    stride = math.ceil((len(grid) - 1) / most)
    steps: list[float] = np.diff(grid if stride == 1 else np.append(grid[:-1:stride], grid[-1])).tolist()
    return steps


def _count(start: float, stop: float, step: float) -> int:
    return max(math.ceil((stop - start - _round_off(start, stop)) / step), 1)


def _round_off(start: float, stop: float) -> float:
    """Return the round-off of a sum of steps, and of times as large as these, s."""
    return 1e-9 * (stop - start) + math.ulp(start) + math.ulp(stop)
