"""What drives a scene: a table of times and values for each port, checked, from Python or from a CSV file."""

import csv
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.runs.time_grid import time_grid
from rbfmu.scene.fields import SceneError, fault, shown
from rbfmu.scene.scene import Scene

Array = NDArray[np.float64]
HOLD, LINEAR = "hold", "linear"
SIZE = 3
"""The number of components of every input."""
ROUND_OFF = 1e-9
"""The part of a communication step by which times may differ and still be the same."""


class InputTable(NamedTuple):
    """A port's values (m, 3) at times (m,), s, that increase."""

    times: Array
    values: Array


InputTables = dict[str, InputTable]


def input_tables(scene: Scene, inputs: Any, interpolate: str = HOLD) -> InputTables:
    """Return the tables of the ports given; raise SceneError with all that is wrong with them.

    inputs: a mapping from a port's name to (times, values) or to an array with a row for each communication step; or
    the path of a CSV file in FMPy's format. Rows are counted from 1, without a file's header.
    """
    if interpolate not in (HOLD, LINEAR):
        raise SceneError(fault("interpolate", interpolate, f"{HOLD!r} or {LINEAR!r}"), scene.name)
    is_file = isinstance(inputs, str | Path)
    source = f"{inputs}: " if is_file else ""
    faults: list[str] = []
    if not is_file and not isinstance(inputs, Mapping):
        expected = "a mapping from a port's name to its values, or the path of a CSV file"
        raise SceneError(fault("inputs", inputs if callable(inputs) else type(inputs).__name__, expected), scene.name)
    if not scene.inputs.ports:
        raise SceneError(f"{source}inputs are given: expected none, as the scene has no ports", scene.name)
    tables = _read(Path(inputs), scene, faults) if is_file else _from_mapping(inputs, scene, interpolate, faults)
    for port, table in tables.items():
        faults += _faults_of_times(scene, table.times, "time" if is_file else f"times of {port}", interpolate)
    if faults:
        raise SceneError([f"{source}{text}" for text in dict.fromkeys(faults)], scene.name)
    return tables


# From Python


def _from_mapping(inputs: Mapping[str, Any], scene: Scene, interpolate: str, faults: list[str]) -> InputTables:
    tables = {}
    for port, given in inputs.items():
        if port not in scene.inputs.ports:
            faults.append(f"inputs {port!r}: expected one of the scene's ports, {', '.join(scene.inputs.ports)}")
            continue
        try:
            timed = isinstance(given, tuple) and len(given) == 2
            tables[port] = _timed(*given) if timed else _row_a_step(scene, given, interpolate)
        except (TypeError, ValueError) as error:
            faults.append(f"inputs {port!r}: {error}")
            continue
        faults += _not_finite(port, tables[port].values)
    return tables


def _timed(times: Any, values: Any) -> InputTable:
    times, values = _numbers_of(times), _numbers_of(values)
    if times.ndim != 1 or not len(times) or values.shape != (len(times), SIZE):
        shapes = f"shapes {times.shape} and {values.shape}"
        raise ValueError(f"{shapes}: expected times (m,) and values (m, {SIZE}), at least one row")
    return InputTable(times, values)


def _row_a_step(scene: Scene, given: Any, interpolate: str) -> InputTable:
    values, grid = _numbers_of(given), time_grid(scene.run.start, scene.run.stop, scene.run.step)
    points, steps = len(grid), len(grid) - 1
    allowed = {points} if interpolate == LINEAR else {steps, points}
    if values.ndim != 2 or values.shape[1] != SIZE or len(values) not in allowed:
        rows = f"{points} rows, one a communication point" if interpolate == LINEAR else f"{steps} rows, one a step"
        raise ValueError(f"shape {values.shape}: expected (times, values), or {rows}, of {SIZE} numbers")
    return InputTable(grid[: len(values)], values)


def _numbers_of(given: Any) -> Array:
    if callable(given):
        raise TypeError("a function: expected (times, values), such as its values at the communication points")
    return np.asarray(given, dtype=np.float64)


def _not_finite(name: str, values: Array) -> Iterator[str]:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        yield f"{name}[{column + 1}] = {float(values[row, column])!r} in row {row + 1}: expected a finite number"


# From a file


def _read(path: Path, scene: Scene, faults: list[str]) -> InputTables:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header, *rows = [row for row in csv.reader(file, skipinitialspace=True) if row] or [[]]
    except OSError as error:
        faults.append(f"cannot be read ({error.strerror}): expected a CSV file of inputs")
        return {}
    except (UnicodeDecodeError, csv.Error) as error:
        faults.append(f"not a CSV file: {error}")
        return {}
    names = [name.strip() for name in header]
    columns = _columns(names, scene, faults)
    if not faults and not rows:
        faults.append("no rows: expected a header, and a row of numbers a time")
    if faults:
        return {}
    numbers = _numbers(names, rows, faults)
    times = numbers[:, names.index("time")]
    return {port: InputTable(times, numbers[:, places]) for port, places in columns.items()}


def _columns(names: list[str], scene: Scene, faults: list[str]) -> dict[str, list[int]]:
    """Return where each port's components stand; note what is missing, unknown or twice."""
    known = {f"{port}[{i + 1}]": port for port in scene.inputs.ports for i in range(SIZE)}
    faults += [
        f"column {name!r} stands twice: expected it once" for name in dict.fromkeys(names) if names.count(name) > 1
    ]
    for name in names:
        if name != "time" and name not in known:
            faults.append(f"column {shown(name)}: expected one of time, {', '.join(known)}")
    ports = dict.fromkeys(known[name] for name in names if name in known)
    wanted = ["time", *(name for name, port in known.items() if port in ports)]
    faults += [
        f"column {name!r} is missing: expected all of {', '.join(wanted)}" for name in wanted if name not in names
    ]
    if faults:
        return {}
    return {port: [names.index(name) for name in known if known[name] == port] for port in ports}


def _numbers(names: list[str], rows: list[list[str]], faults: list[str]) -> Array:
    """Return the file's numbers; NaN for what is none, of which the first of each column is noted."""
    table, said = np.full((len(rows), len(names)), np.nan), set[str]()
    for k, row in enumerate(rows):
        if len(row) != len(names):
            faults.append(f"row {k + 1} has {len(row)} cells: expected {len(names)}, as many as the header")
            break
        for i, cell in enumerate(map(str.strip, row)):
            with suppress(ValueError):  # `float` takes 1_0 and other scripts' digits as well, which no importer does
                table[k, i] = float(cell) if cell.isascii() and "_" not in cell else math.nan
            if not math.isfinite(table[k, i]) and names[i] not in said:
                said.add(names[i])
                faults.append(f"{names[i]} = {shown(cell)} in row {k + 1}: expected a finite number")
    return table


# Times


def _faults_of_times(scene: Scene, times: Array, name: str, interpolate: str) -> Iterator[str]:
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        yield f"{name} = {float(times[bad[0]])!r} in row {bad[0] + 1}: expected a finite number"
        return
    later = np.flatnonzero(np.diff(times) <= 0.0)
    if len(later):
        row = later[0] + 1
        before = f"a time after {float(times[row - 1])!r} s in the row before"
        yield f"{name} = {float(times[row])!r} in row {row + 1}: expected {before}"
        return
    start, stop, near = scene.run.start, scene.run.stop, ROUND_OFF * scene.run.step
    if times[0] > start + near:
        yield f"{name} = {float(times[0])!r} in row 1: expected at most {start!r} s, where the run starts"
    last, held = float(times[-1]), interpolate == HOLD
    holds_to = math.inf if len(times) == 1 else last + float(times[-1] - times[-2])
    if (holds_to if held else last) < stop - near:
        until = f"a row that holds to {stop!r} s" if held else f"at least {stop!r} s"
        yield f"{name} = {last!r} in row {len(times)}, the last: expected {until}, where the run stops"
