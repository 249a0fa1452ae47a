"""Run a scene by its plan and hold the result."""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.exceptions import SimulationError as SimulationError
from rbfmu.runs.model_buffer import filled_buffer, initialize, output_block
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import time_grid
from rbfmu.scene.argument import of_scene_or_path
from rbfmu.scene.plausibility import doubts_after, warn
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import OUTPUT, TIME

Array = NDArray[np.float64]
CHUNK = 1024
"""Rows that a CSV's writer holds as text."""


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


class Result:
    """A simulated scene: `.time` (n,) in s, and one (n,) or (n, k) array per quantity by attribute."""

    def __init__(self, time: Array, quantities: dict[str, Array]) -> None:
        self.time = time
        self.quantities = quantities

    def __getattr__(self, name: str) -> Array:
        try:
            return self.__dict__["quantities"][name]  # type: ignore[no-any-return]
        except KeyError:
            known = ", ".join(self.__dict__.get("quantities", ()))
            raise AttributeError(f"no quantity {name!r} in this result; it has time, {known}") from None

    def __repr__(self) -> str:
        return f"Result({len(self.time)} points, {', '.join(self.quantities)})"

    def columns(self) -> dict[str, Array]:
        """Return flat columns by FMU variable name: time, quaternion[1], ..."""
        columns = {"time": self.time}
        for name, values in self.quantities.items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}[{i + 1}]": values[:, i] for i in range(values.shape[1])}
        return columns

    @property
    def units(self) -> dict[str, str]:
        """Return the SI units of time and of each quantity."""
        return {"time": TIME.unit} | {name: OUTPUT[name].unit for name in self.quantities}

    def save(self, path: str | Path) -> None:
        """Write `.csv` (FMU variable names, every digit) or `.npz` (arrays by quantity).

        A CSV's units stand in a second file beside it: those of `run.csv` in `run.units.csv`, a line a column with
        name, unit and meaning, so that the first keeps one header and serves as an FMU's input in FMPy.
        """
        path = Path(path)
        if path.suffix == ".npz":
            np.savez(path, time=self.time, **self.quantities)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            self._write_csv(path)
            self._write_units(path.with_suffix(".units.csv"))
        else:
            raise ValueError(f"cannot save to {str(path)!r}: the name must end in .csv or .npz")

    def _write_csv(self, path: Path) -> None:
        columns = self.columns()
        with path.open("w") as file:
            file.write(",".join(f'"{name}"' for name in columns) + "\n")
            for first in range(0, len(self.time), CHUNK):
                rows = zip(*(c[first : first + CHUNK].tolist() for c in columns.values()), strict=True)
                file.writelines(",".join(map(repr, row)) + "\n" for row in rows)

    def _write_units(self, path: Path) -> None:
        known = {"time": TIME} | OUTPUT
        with path.open("w", newline="") as file:
            table = csv.writer(file, quoting=csv.QUOTE_ALL, lineterminator="\n")
            table.writerow(("name", "unit", "meaning"))
            rows = ((name, known[name.split("[")[0]]) for name in self.columns())
            table.writerows((name, row.unit, row.meaning) for name, row in rows)


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
