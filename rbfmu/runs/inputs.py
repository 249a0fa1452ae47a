"""What drives a run: tables of times and values, from Python or a CSV file, which cut communication steps to pieces."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu.arrays.from_kernel import no_numbers
from rbfmu.csv_table import read_columns
from rbfmu.scene.scene import Scene, warn
from rbfmu.scene.section import SceneError, as_toml, fault
from rbfmu.types import Array, ArrayLike, Indices
from rbfmu_kernels.quantities import elements

HOLD, LINEAR = "hold", "linear"
NEAR = 1e-9
"""Times count as the same if they differ by at most this part of a communication step. At large times, also if they
differ by round-off: times of a grid and of a table, computed in different ways, differ by a unit or two there."""


class InputTable(NamedTuple):
    """A port's values (m, n) at increasing times (m,), s; n: 3, or 1 for a scalar port of the scene's own."""

    times: Array
    values: Array


InputTables = dict[str, InputTable]
Given = ArrayLike | tuple[ArrayLike, ArrayLike]
Inputs = Mapping[str, Given] | str | Path
"""What drives a run, as a user gives it: see `input_tables`."""


def _time_tolerance(scene: Scene) -> float:
    """Return the largest difference, s, between times that count as the same."""
    step, round_off = scene.run.step, math.ulp(scene.run.start) + math.ulp(scene.run.stop)
    return max(NEAR * step, min(round_off, 0.1 * step))


def size_of(scene: Scene, port: str) -> int:
    """Return how many numbers a port has."""
    return scene.inputs.own[port].size if port in scene.inputs.own else 3


def input_tables(scene: Scene, inputs: Inputs | None, interpolate: str = HOLD, *, told: bool = False) -> InputTables:
    """Return the tables of the given ports, none without inputs. Raises SceneError with all that is wrong with them.

    inputs: a mapping from a port's name to (times, values), or to an array with a row for each communication step; or
    the path of a CSV file in FMPy's format. Messages count rows from 1, without a file's header. told: give no
    doubts, as they are known.
    """
    if interpolate not in (HOLD, LINEAR):
        raise SceneError(fault("interpolate", interpolate, f"{HOLD!r} or {LINEAR!r}"), scene.name)
    if inputs is None:
        return {}
    source = f"{inputs}: " if isinstance(inputs, str | Path) else ""
    faults: list[str] = []
    if not isinstance(inputs, str | Path | Mapping):
        expected = "a mapping from a port's name to its values, or the path of a CSV file"
        raise SceneError(fault("inputs", inputs if callable(inputs) else type(inputs).__name__, expected), scene.name)
    if not scene.inputs.ports:
        raise SceneError(f"{source}inputs are given: expected none, as the scene has no ports", scene.name)
    if isinstance(inputs, Mapping):
        tables = _from_mapping(inputs, scene, interpolate, faults)
    else:
        tables = _read(Path(inputs), scene, faults)
    times = {"time" if source else f"times of {port}": table.times for port, table in tables.items()}
    for name, column in times.items():
        faults += _faults_of_times(scene, column, name, interpolate)
    if faults:
        raise SceneError([f"{source}{text}" for text in faults], scene.name)
    if interpolate == HOLD and not told:
        warn(scene, _doubts_of_ends(scene, tables))
    return tables


def with_times(scene: Scene, inputs: Inputs | None, interpolate: str = HOLD) -> Inputs | None:
    """Return inputs in which arrays with a row for each communication step of the scene are given their times."""
    rows = {port: x for port, x in inputs.items() if not isinstance(x, tuple)} if isinstance(inputs, Mapping) else {}
    return {**inputs, **input_tables(scene, rows, interpolate)} if rows and isinstance(inputs, Mapping) else inputs


# From Python


def _from_mapping(inputs: Mapping[str, Given], scene: Scene, interpolate: str, faults: list[str]) -> InputTables:
    tables = {}
    for port, given in inputs.items():
        if port not in scene.inputs.ports:
            faults.append(f"inputs {port!r}: expected one of the scene's ports, {', '.join(scene.inputs.ports)}")
            continue
        try:
            size = size_of(scene, port)
            if isinstance(given, tuple) and len(given) == 2:
                tables[port] = _table_of_pair(given, size)
            else:
                tables[port] = _table_by_steps(scene, given, interpolate, size)
        except (TypeError, ValueError) as error:
            faults.append(f"inputs {port!r}: {error}")
            continue
        faults += _not_finite(port, tables[port].values)
    return tables


def _table_of_pair(given: tuple[ArrayLike, ArrayLike], size: int) -> InputTable:
    times, values = _numbers_of(given[0], "times"), _rows_of(given[1], size)
    if times.ndim != 1 or not len(times) or values.shape != (len(times), size):
        shapes = f"shapes {times.shape} and {values.shape}"
        raise ValueError(f"{shapes}: expected times (m,) and values (m, {size}), at least one row")
    return InputTable(times, values)


def _table_by_steps(scene: Scene, given: ArrayLike, interpolate: str, size: int) -> InputTable:
    values, grid = _rows_of(given, size), scene.run.grid()
    points, steps = len(grid), len(grid) - 1
    allowed = {points} if interpolate == LINEAR else {steps, points}
    if values.ndim != 2 or values.shape[1] != size or len(values) not in allowed:
        rows = f"{points} rows, one a communication point" if interpolate == LINEAR else f"{steps} rows, one a step"
        raise ValueError(f"shape {values.shape}: expected (times, values), or {rows}, of {size} numbers")
    return InputTable(grid[: len(values)], values)


def _rows_of(given: ArrayLike, size: int) -> Array:
    """Return the values as rows (m, n), also those of a scalar, which may be given as (m,)."""
    values = _numbers_of(given)
    return values[:, None] if size == 1 and values.ndim == 1 else values


def _numbers_of(given: ArrayLike, name: str = "values") -> Array:
    if callable(given):
        raise TypeError("a function: expected (times, values), such as its values at the communication points")
    if wrong := no_numbers(given):  # NumPy would read dates as nanoseconds, and drop masks and imaginary parts
        raise ValueError(f"{name} {wrong}: expected (times, values), or a row of numbers for each step")
    return np.asarray(given, dtype=np.float64)


def _not_finite(name: str, values: Array) -> Iterator[str]:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        yield f"{name}[{column + 1}] = {float(values[row, column])!r} in row {row + 1}: expected a finite number"


# From a file


def _read(path: Path, scene: Scene, faults: list[str]) -> InputTables:
    known = {name: port for port in scene.inputs.ports for name in elements(port, size_of(scene, port))}
    try:
        flat = read_columns(path, "a finite number", math.isfinite, faults_of_names=partial(_faults_of_names, known))
    except OSError as error:
        faults.append(f"cannot be read ({error.strerror}): expected a CSV file of inputs")
        return {}
    except SceneError as error:
        faults += error.faults
        return {}
    if not len(flat["time"]):
        faults.append("no rows: expected a header, and a row of numbers a time")
        return {}
    ports = dict.fromkeys(known[name] for name in flat if name != "time")
    columns = {port: [flat[name] for name in known if known[name] == port] for port in ports}
    return {port: InputTable(flat["time"], np.stack(own, axis=1)) for port, own in columns.items()}


def _faults_of_names(known: Mapping[str, str], names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each wrong column and its message; known: the ports by the names of their columns."""
    for name in names:
        if name not in known and name != "time":
            yield name, f"column {as_toml(name)}: expected one of time, {', '.join(known)}"
    given = {known[name] for name in names if name in known}
    wanted = [name for name, port in known.items() if port in given]
    for name in wanted:
        if name not in names:
            yield name, f"column {name!r} is missing: expected all of time, {', '.join(wanted)}"


# Their times


def _faults_of_times(scene: Scene, times: Array, name: str, interpolate: str) -> Iterator[str]:
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        yield f"{name} = {float(times[bad[0]])!r} in row {bad[0] + 1}: expected a finite number"
        return
    later = np.flatnonzero(np.diff(times) < 0.0 if interpolate == LINEAR else np.diff(times) <= 0.0)
    if len(later):
        row = later[0] + 1
        before = f"a time after {float(times[row - 1])!r} s in the row before"
        yield f"{name} = {float(times[row])!r} in row {row + 1}: expected {before}"
        return
    start, stop, near = scene.run.start, min(scene.run.stop, scene.run.end), _time_tolerance(scene)
    if times[0] > start + near:
        yield f"{name} = {float(times[0])!r} in row 1: expected at most {start!r} s, where the run starts"
    if interpolate == LINEAR and times[-1] < stop - near:
        before = f"{name} = {float(times[-1])!r} in row {len(times)}, the last"
        yield f"{before}: expected at least {stop:.12g} s, as the run stops at {stop!r} s"


def _doubts_of_ends(scene: Scene, tables: InputTables) -> Iterator[str]:
    """Yield the doubt that tables may have been cut short, if a last row is held for longer than the one before it.

    The text is the same for a file and for the data read from it, so that the warning is given only once.
    """
    stop, held = min(scene.run.stop, scene.run.end), dict[float, list[str]]()
    for port, (times, _) in tables.items():
        left = stop - float(times[-1])
        if len(times) > 1 and left > times[-1] - times[-2] + _time_tolerance(scene):
            held.setdefault(left, []).append(port)
    for left, ports in held.items():
        message = f"the last inputs of {', '.join(ports)} are held for {left:.6g} s, to the end of the run"
        yield f"{message}; was the table cut short?"


class Drive(NamedTuple):
    """The pieces of a run under inputs.

    time (n + 1,): communication points, s; lengths (p,): of pieces, s; counts (n + 1,): how many pieces end at or
    before each point; ports: how many of the k columns each driven port has; values (p, k): at the beginning of each
    piece; slopes (p, k): 1/s; at_row (p, k): 1 where the port's table has a row, else 0. Communication steps are cut
    where a table has a row inside them, so that its values act from their own times on.
    """

    time: Array
    lengths: Array
    counts: Indices
    ports: dict[str, int]
    values: Array
    slopes: Array
    at_row: Array


def undriven(steps: Sequence[float], parts: int = 1) -> Drive:
    """Return the pieces of a run of these steps, s, without inputs; parts: into how many equal parts each is cut."""
    whole, counts = np.array(steps), np.arange(len(steps) + 1) * parts
    time, lengths = np.concatenate(([0.0], whole)).cumsum(), (whole / parts).repeat(parts)
    return Drive(time, lengths, counts, {}, *np.empty((3, len(lengths), 0)))


def drive_of(scene: Scene, tables: InputTables, interpolate: str, parts: int = 1, time: Array | None = None) -> Drive:
    """Return the pieces of a scene's run under tables; parts: into how many equal parts each is cut; time: its grid."""
    time = scene.run.grid() if time is None else time
    near = _time_tolerance(scene)
    points = _points(time, [table.times for table in tables.values()], near)
    if parts > 1:
        cuts = np.arange(parts) / parts
        points = np.append((points[:-1, None] + cuts * np.diff(points)[:, None]).ravel(), points[-1])
    pieces = _linear_pieces if interpolate == LINEAR else _held_pieces
    ports = {port: table.values.shape[1] for port, table in tables.items()}
    values, slopes, at_row = np.empty((3, len(points) - 1, sum(ports.values())))
    first = 0
    for port, table in tables.items():
        own = slice(first, first + ports[port])
        values[:, own], slopes[:, own], at_row[:, own] = pieces(table, points, near)
        first = own.stop
    counts = np.arange(len(time)) if points is time else np.searchsorted(points, time)  # which takes longer
    return Drive(time, np.diff(points), counts, ports, values, slopes, at_row)


def _points(time: Array, tables: list[Array], near: float) -> Array:
    """Return all times at which a piece begins or ends; rows within `near` of a communication point count as at it."""
    if not tables:
        return time
    rows = np.unique(np.concatenate(tables))
    rows = rows[(rows > time[0]) & (rows < time[-1])]
    after = np.searchsorted(time, rows)
    rows = rows[np.minimum(time[after] - rows, rows - time[after - 1]) > near]
    rows = rows[np.diff(rows, prepend=-np.inf) > near]
    return np.union1d(time, rows)


def _held_pieces(table: InputTable, points: Array, near: float) -> tuple[Any, ...]:
    row = np.maximum(np.searchsorted(table.times, points[:-1] + near, side="right") - 1, 0)
    return table.values[row], 0.0, np.diff(row, prepend=-1)[:, None] > 0


def _linear_pieces(table: InputTable, points: Array, near: float) -> tuple[Any, ...]:
    begins = np.column_stack([np.interp(points, table.times, column) for column in table.values.T])
    ends = begins.copy()
    # Several rows at one point are a jump: the piece before it ends at the first row, the one after begins at the last.
    first = np.searchsorted(table.times, points - near)
    last = np.searchsorted(table.times, points + near, side="right") - 1
    jumps = last > first
    ends[jumps], begins[jumps] = table.values[first[jumps]], table.values[last[jumps]]
    slopes = (ends[1:] - begins[:-1]) / np.diff(points)[:, None]
    return begins[:-1], slopes, (last >= first)[:-1, None]
