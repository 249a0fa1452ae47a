"""Measured motion: outputs of a scene at any times, with gaps, and residuals of a run."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rbfmu import arrays, csv_table
from rbfmu.arrays.from_kernel import no_numbers
from rbfmu.ensembles.variables import output_rows
from rbfmu.result import Result, arrays_of_npz, by_quantity, incomplete, quaternion_lengths
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.quantities import OUTPUT

if TYPE_CHECKING:
    from pandas import DataFrame

GAPS = ("", "nan", "na", "-")
QUATERNION = "quaternion"
Data: TypeAlias = "str | Path | Result | Mapping[str, ArrayLike] | DataFrame"


@dataclass(frozen=True)
class Measured:
    """Outputs (times, k) by name at increasing times, s; NaN is a gap, in a quaternion always a whole row."""

    time: Array
    values: Mapping[str, Array]

    @property
    def count(self) -> int:
        """Return how many numbers were measured; a quaternion counts as three."""
        return sum(int(np.isfinite(rows[:, :3]).sum()) for rows in self.values.values())

    def until(self, end: float) -> "Measured":
        """Return what was measured up to a time."""
        n = int(np.searchsorted(self.time, end, side="right"))
        return Measured(self.time[:n], {name: rows[:n] for name, rows in self.values.items()})


def read_measured(scene: Scene, data: Data) -> Measured:
    """Return data as measured outputs of a scene.

    data: the path of a CSV file with a column `time` and columns by the FMU's names, as importers also write it, empty
    at gaps; the path of an `.npz` with arrays by output, or of an `.aem`, as written by `Result.save`; a `Result`; a
    `DataFrame` of pandas with such columns, whose index may be the time; or a mapping from `time` and names of outputs
    to arrays. In rows without a quaternion, the attitude is computed from roll, pitch and yaw, if these are given.
    Raises ValueError.
    """
    where = str(Path(data)) if isinstance(data, str | Path) else "data"
    if isinstance(data, str | Path):
        data = _read(scene, Path(data))
    try:
        if hasattr(data, "iloc"):
            data = _of_a_table(scene, data)
        return _checked(scene, {"time": data.time, **data.quantities} if isinstance(data, Result) else data)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _read(scene: Scene, path: Path) -> Result | Mapping[str, ArrayLike]:
    if path.suffix == ".csv":
        return _outputs(scene, _columns(path, faults_of_names=lambda names: _faults_of_names(scene, names)))
    if path.suffix == ".npz":  # may have the scene's own outputs, and gaps
        wanted = ("time", *OUTPUT, *scene.outputs.own)
        return {name: rows for name, rows in arrays_of_npz(path).items() if name in wanted}
    return Result.load(path)


def _of_a_table(scene: Scene, table: Any) -> Mapping[str, ArrayLike]:
    table = table.reset_index() if table.index.name == "time" else table
    columns = {str(name): np.asarray(column) for name, column in table.items()}
    for _, fault in _faults_of_names(scene, [*columns]):
        raise ValueError(fault)
    return _outputs(scene, columns)


def _outputs(scene: Scene, columns: Mapping[str, Array]) -> Mapping[str, ArrayLike]:
    """Return columns by an FMU's names as arrays by output, without those of `_of_an_fmu`."""
    return {name: rows for name, rows in by_quantity(columns).items() if name not in _of_an_fmu(scene)}


def _checked(scene: Scene, known: Mapping[str, ArrayLike]) -> Measured:
    if not isinstance(known, Mapping) or "time" not in known:
        raise ValueError("expected a file, a Result, a DataFrame, or a mapping with time and outputs by name")
    rows = {**OUTPUT, **output_rows(scene)}
    columns = {name: _numbers(name, known[name]) for name in ("time", *known)}  # time may be a coordinate of a Dataset
    time, values = columns.pop("time"), dict[str, Array]()
    if time.ndim != 1 or len(time) < 2:
        raise ValueError("time: expected at least two finite times (s) that increase")
    steps = np.diff(time)
    if bad := np.flatnonzero(~(np.isfinite(steps) & (steps > 0.0))).tolist():
        first, then = time[bad[0] : bad[0] + 2].tolist()
        where = f"time = {then!r} in row {bad[0] + 2}, after {first!r}"
        raise ValueError(f"{where}: expected finite times (s) that increase")
    if time[0] < scene.run.start:
        raise ValueError(f"time = {float(time[0])!r} in row 1: expected at least run.start = {scene.run.start!r}")
    for name, value in columns.items():
        if name not in rows:
            raise ValueError(f"{name!r}: expected outputs among {', '.join(rows)}")
        values[name] = value[:, None] if value.ndim == 1 else value
        if values[name].shape != (expected := (len(time), rows[name].size)):
            raise ValueError(f"{name} has shape {value.shape}: expected {expected}")
        if beyond := np.argwhere(np.isinf(values[name])).tolist():
            where = f"{name} = {float(values[name][tuple(beyond[0])])!r} in row {beyond[0][0] + 1}"
            raise ValueError(f"{where}: expected finite numbers, or NaN for a gap")
    if "rpy" in values:
        by_angles = arrays.quaternion_from_euler("ZYX", values.pop("rpy")[:, ::-1])
        given = values.get(QUATERNION, np.full_like(by_angles, np.nan))
        values[QUATERNION] = np.where(np.isfinite(given).all(axis=1, keepdims=True), given, by_angles)
    if QUATERNION in values:
        values[QUATERNION] = _unit(values[QUATERNION])
    found = Measured(time, values)
    if not found.count:
        raise ValueError("expected at least one measured output")
    return found


def _numbers(name: str, value: ArrayLike) -> Array:
    """Return a copy as floats, NaN where it has None."""
    try:
        array = np.asanyarray(value)  # keeps a mask
        if array.dtype == object:
            return array.astype(np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected an array of numbers") from None
    if wrong := no_numbers(array):
        raise ValueError(f"{name} {wrong}")
    return np.array(array, dtype=np.float64)


def _unit(rows: Array) -> Array:
    """Return unit quaternions; a row with a NaN is a gap."""
    rows[~np.isfinite(rows).all(axis=1)] = np.nan
    return np.asarray(rows / quaternion_lengths(rows)[:, None])


def _of_an_fmu(scene: Scene) -> list[str]:
    """Return FMU variables that importers write but that are no outputs of a scene: status, events, own states."""
    events = [f"{name}_{what}" for name in scene.events for what in ("count", "time")]
    return ["status", *events, *scene.states]


def _faults_of_names(scene: Scene, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    shown = (*OUTPUT, *scene.outputs.own)
    for name in names:
        if name.partition("[")[0] not in ("time", *shown, *_of_an_fmu(scene)):
            yield name, f"column {name!r}: expected outputs among {', '.join(shown)}"
    yield from incomplete(names)


def _columns(path: Path, **which: Any) -> dict[str, Array]:
    try:
        return csv_table.read_columns(path, "a number, or nothing for a gap", gaps=GAPS, **which)
    except SceneError as error:  # a fault of the file, not of the scene
        raise ValueError(str(error)) from None


def sigma_of(text: str) -> float | dict[str, float]:
    """Return a number, or the numbers of a CSV file by output, in one row under their names. Raises ValueError."""
    try:
        return float(text)
    except ValueError:
        path = Path(text)
    if not path.exists():
        raise ValueError(f"sigma = {text!r}: expected a number, or a CSV file of these")
    columns = _columns(path, needed="")
    if any(len(rows) != 1 for rows in columns.values()):
        raise ValueError(f"{path}: expected a row of outputs' names and a row of their standard deviations")
    return {name: float(rows[0]) for name, rows in columns.items()}


# Residuals of a run


def residuals(name: str, run: Array, data: Array, slopes: Array) -> tuple[Array, Array]:
    """Return residuals (times, k), measured less run, and their derivatives (times, k, numbers).

    slopes: the derivatives of the run, of an attitude as rotation vectors in b. The residual of an attitude is twice
    the vector part of the rotation from run to data, in b: its rotation vector, rad, if it is small. Quaternions may
    have either sign.
    """
    if name != QUATERNION:
        return data - run, -slopes
    turn = arrays.attitude_error(run, data)
    return 2.0 * turn[:, 1:], -(turn[:, 0, None, None] * np.eye(3) - arrays.skew(turn[:, 1:])) @ slopes
