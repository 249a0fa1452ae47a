"""Run a scene by its plan."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import SimulationError as SimulationError
from rbfmu.result import Result
from rbfmu.runs.inputs import HOLD, Drive, Driven, drive_of, input_tables
from rbfmu.runs.plan import Plan
from rbfmu.scene.consistency import doubts_after, warn
from rbfmu.scene.scene import Scene, of_scene_or_path

Array = NDArray[np.float64]


@of_scene_or_path
def plan(
    scene: Scene,
    full: bool = False,
    progress: Callable[[float], Any] | None = None,
    *,
    inputs: Any = None,
    interpolate: str = HOLD,
) -> Plan:
    """Choose model, method and step for a scene, or that of a scene file; full: to integrate all degrees of freedom.

    progress: a function that is told from time to time which part of the motion that judges plans is known.
    inputs, interpolate: see `simulate`; error and cost are then those of the run that they drive. Raises SceneError
    where the accuracy asked cannot be met.
    """
    tables = None if inputs is None else input_tables(scene, inputs, interpolate)
    return _planned(scene, full, progress, None if tables is None else partial(drive_of, scene, tables, interpolate))


def _planned(
    scene: Scene,
    full: bool = False,
    progress: Callable[[float], Any] | None = None,
    driven: Callable[[int], Drive] | None = None,
) -> Plan:
    from rbfmu.planning import plan as planned  # a run whose plan is known does without

    return planned(scene, full, progress, driven=driven)


@of_scene_or_path
def simulate(
    scene: Scene,
    *,
    inputs: Any = None,
    interpolate: str = HOLD,
    planned: Plan | None = None,
    progress: Callable[[Sequence[int]], Any] | None = None,
) -> Result:
    """Run a scene, or that of a scene file: its FMU's bits at the same communication steps and inputs.

    inputs: what drives the ports, which are at zero without it: a mapping from a port's name to `(times (m,), values
    (m, 3))` or to an array (n, 3) with a row for each communication step, or the path of a CSV file in FMPy's format
    (`time`, then FMU variables such as `torque_b[1]`). Ports that are not named stay at zero.
    interpolate: "hold", a value from its time on, or "linear" between times. Communication steps are cut where a time
    lies inside. Of linear inputs a model that takes no input derivatives sees the mean over each step.
    planned: a plan, used as it is; without one, a plan that meets the accuracy under the inputs given.
    progress: wraps the sequence of step numbers, e.g. a progress bar. Raises SceneError, SimulationError.
    """
    tables = {} if inputs is None else input_tables(scene, inputs, interpolate)
    driven = partial(drive_of, scene, tables, interpolate)
    planned = planned or _planned(scene, driven=driven if tables else None)
    drive = driven(1)
    run, time = Driven(scene, planned, drive), drive.time
    blocks = {name: planned.kernels.BLOCKS[name] for name in scene.outputs.quantities}
    first, end = min(block.start for block in blocks.values()), max(block.stop for block in blocks.values())
    outputs = run.z[first:end]
    rows = np.empty((len(time), len(outputs)))
    rows[0] = outputs
    numbers = range(1, len(time))
    for k in numbers if progress is None else progress(numbers):
        if not run.advance(k):
            raise refused_step(scene, time[k - 1])
        rows[k] = outputs
    result = Result(time, {name: _quantity(rows, block, first) for name, block in blocks.items()})
    warn(scene, doubts_after(scene, result.quantities), stacklevel=4)
    return result


def refused_step(scene: Scene, begin: float) -> SimulationError:
    """Return the error for a step of a run that was refused; begin: s."""
    return SimulationError(f"{scene.name}: the step from t = {float(begin)!r} s was refused: not finite")


def _quantity(rows: Array, block: slice, first: int) -> Array:
    values = rows[:, block.start - first : block.stop - first].copy()
    return values[:, 0] if values.shape[1] == 1 else values
