"""Read back the files that results are saved to, and CSV files that importers of FMUs write."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rbfmu.results.result import check_shape
from rbfmu_kernels.quantities import OUTPUT, indices

Array = NDArray[np.float64]


def read_result(path: Path) -> tuple[Array, dict[str, Array]]:
    """Return time (n,) and the arrays by quantity of a .csv or .npz. Raises ValueError."""
    if path.suffix == ".npz":
        columns = _npz(path)
    elif path.suffix == ".csv":
        columns = _csv(path)
    else:
        raise ValueError(f"{str(path)!r}: expected a name that ends in .csv or .npz")
    if "time" not in columns:
        raise ValueError(f"{path}: time is missing: expected the result of a run")
    quantities = {name: columns[name] for name in OUTPUT if name in columns}
    for name, values in {"time": columns["time"], **quantities}.items():
        _check(path, name, values, len(columns["time"]))
    time = columns["time"]
    if np.any(np.diff(time) <= 0.0):
        row = int(np.argmax(np.diff(time) <= 0.0)) + 1
        raise ValueError(f"{path}: time = {float(time[row])!r} in row {row + 1}: expected times that increase")
    return time, quantities


def _npz(path: Path) -> dict[str, Array]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: np.asarray(file[name], dtype=np.float64) for name in file.files}
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path}: cannot be read as arrays of NumPy ({error}): expected the result of a run") from None


def _csv(path: Path) -> dict[str, Array]:
    with path.open(encoding="utf-8", newline="") as file:
        names = next(csv.reader(file), [])
        try:
            rows = np.loadtxt(file, delimiter=",", ndmin=2, dtype=np.float64)
        except ValueError as error:
            raise ValueError(f"{path}: {error}: expected numbers") from None
    if rows.shape[1] != len(names):
        raise ValueError(f"{path}: expected a row of {len(names)} numbers for each time, not {rows.shape[1]}")
    flat = {name.strip(): rows[:, k] for k, name in enumerate(names)}
    columns = {"time": flat["time"]} if "time" in flat else {}
    for row in OUTPUT.values():
        wanted = [row.name + index for index in indices(row)]
        if missing := [name for name in wanted if name not in flat]:
            if len(missing) < len(wanted):
                raise ValueError(f"{path}: {missing[0]} is missing: expected all of {', '.join(wanted)}")
            continue
        columns[row.name] = np.stack([flat[name] for name in wanted], axis=1) if row.size > 1 else flat[row.name]
    return columns


def _check(path: Path, name: str, values: Array, points: int) -> None:
    try:
        check_shape(name, values, points)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if bad := np.argwhere(~np.isfinite(values)).tolist():
        raise ValueError(f"{path}: {name} = {float(values[tuple(bad[0])])!r} in row {bad[0][0] + 1}: expected numbers")
