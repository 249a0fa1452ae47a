"""How far two plans of one scene lie apart, in the quantities that the scene asks for."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.measures import attitude_error, relative_error
from rbfmu.models import Plan
from rbfmu.scene import Scene
from rbfmu.times import thinned_grid
from rbfmu.unit import filled_buffer, initialize
from rbfmu_kernels.layout import FINE

Array = NDArray[np.float64]
Motion = dict[str, Array]

MOST_POINTS = 4000
GOLDEN = 0.6180339887498949
"""Where a step is cut in two, so that a motion whose period is the step does not look like rest."""
_FLOORS = {"position": 1.0, "velocity": 1.0}


@dataclass(frozen=True)
class Times:
    """The steps from one point of a comparison to the next, s."""

    steps: tuple[float, ...]

    @classmethod
    def of(cls, scene: Scene, parts: tuple[float, ...] = (GOLDEN, 1.0 - GOLDEN)) -> "Times":
        """The scene's communication steps (several at once where there are too many), each cut into parts."""
        lengths = np.diff(thinned_grid(scene, MOST_POINTS)).tolist()
        return cls(tuple(part * h for h in lengths for part in parts))


def watched(scene: Scene) -> tuple[str, ...]:
    """Blocks that show every quantity asked for; roll, pitch and yaw count as the attitude that they describe."""
    return tuple(dict.fromkeys("quaternion" if q == "rpy" else q for q in scene.outputs.quantities))


def motion(scene: Scene, plan: Plan, times: Times, names: tuple[str, ...]) -> tuple[Motion, float]:
    """Blocks of the plan's unit over the run, its ports at zero, and the substeps counted, where they are.

    NaN from where the motion cannot be followed.
    """
    unit, z = plan.unit, filled_buffer(scene, plan)
    if "unwanted" in unit.BLOCKS:
        z[unit.BLOCKS["unwanted"]] = [float(name not in names) for name in unit.OUTPUTS]
    initialize(scene, unit, z)
    blocks: dict[str, Any] = {n: z[unit.BLOCKS[n]] for n in names}
    found = {n: np.full((len(times.steps) + 1, len(block)), np.nan) for n, block in blocks.items()}
    for k, h in enumerate((0.0, *times.steps)):
        if k and unit.step(z, h) != FINE:
            break
        for n, block in blocks.items():
            found[n][k] = block
    return found, float(z[unit.BLOCKS["substeps"]][0]) if "substeps" in unit.BLOCKS else 0.0


def largest_difference(a: Motion, b: Motion, names: tuple[str, ...]) -> float:
    """As `accuracy` counts: attitude in rad, all else relative to its largest size in b; infinite where not finite."""
    worst = 0.0
    for name in names:
        if name == "quaternion":
            errors = attitude_error(a[name], b[name])
        else:
            errors = relative_error(a[name], b[name], _FLOORS.get(name, 0.0))
        largest = float(np.max(errors))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst
