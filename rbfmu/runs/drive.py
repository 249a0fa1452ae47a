"""A run's inputs as pieces of its communication steps, over each of which every input is steady or changes evenly."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.runs.input_tables import LINEAR, ROUND_OFF, SIZE, InputTable, InputTables
from rbfmu.runs.model_buffer import Buffer, Model
from rbfmu.runs.time_grid import time_grid
from rbfmu.scene.scene import Scene
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.tiered import tiered

Array = NDArray[np.float64]


class PortPieces(NamedTuple):
    """A port's values at the begin of each piece, and how fast they change in it."""

    values: Array
    slopes: Array


class Drive(NamedTuple):
    """The pieces of a run: their lengths (s), how many end at or before each communication point, each port's inputs.

    Communication steps are cut where a table has a row inside them, so that its values act from their own times on.
    """

    time: Array
    lengths: Array
    counts: NDArray[np.intp]
    ports: dict[str, PortPieces]

    @property
    def is_steady(self) -> bool:
        """Return whether no input changes within a piece."""
        return not any(port.slopes.any() for port in self.ports.values())


def drive_of(scene: Scene, tables: InputTables, interpolate: str, parts: int = 1) -> Drive:
    """Return the pieces of a scene's run under its inputs, each cut into equal parts."""
    time, linear = time_grid(scene.run.start, scene.run.stop, scene.run.step), interpolate == LINEAR
    near = ROUND_OFF * scene.run.step
    points = _points(time, [table.times for table in tables.values()], near)
    if parts > 1:
        cuts = np.arange(parts) / parts
        points = np.append((points[:-1, None] + cuts * np.diff(points)[:, None]).ravel(), points[-1])
    pieces = _linear if linear else _held
    ports = {port: pieces(table, points, near) for port, table in tables.items()}
    return Drive(time, np.diff(points), np.searchsorted(points, time), ports)


def _points(time: Array, tables: list[Array], near: float) -> Array:
    """Return all times at which a piece begins or ends; a row next to a communication point counts as at it."""
    if not tables:
        return time
    rows = np.unique(np.concatenate(tables))
    rows = rows[(rows > time[0]) & (rows < time[-1])]
    after = np.searchsorted(time, rows)
    apart = np.minimum(time[after] - rows, rows - time[after - 1]) > near
    rows = rows[apart]
    rows = rows[np.diff(rows, prepend=-np.inf) > near]
    return np.union1d(time, rows)


def _held(table: InputTable, points: Array, near: float) -> PortPieces:
    begun = np.maximum(np.searchsorted(table.times, points[:-1] + near, side="right") - 1, 0)
    return PortPieces(table.values[begun], np.zeros((len(begun), SIZE)))


def _linear(table: InputTable, points: Array, near: float) -> PortPieces:
    begins = np.column_stack([np.interp(points, table.times, column) for column in table.values.T])
    ends = begins.copy()
    # Rows that lie at one point are a jump there: the piece before ends at the first, that after begins at the last.
    first = np.searchsorted(table.times, points - near)
    last = np.searchsorted(table.times, points + near, side="right") - 1
    jumps = last > first
    ends[jumps], begins[jumps] = table.values[first[jumps]], table.values[last[jumps]]
    slopes = (ends[1:] - begins[:-1]) / np.diff(points)[:, None]
    return PortPieces(begins[:-1], slopes)


class Driven:
    """A model's buffer that is driven: `start` before `initialize`, then `advance` for each communication step.

    A model that takes no input derivatives gets the mean of each piece, and the last value at a communication point.
    """

    def __init__(self, drive: Drive, kernels: Model, z: Buffer) -> None:
        self._z, self._step, self._outputs = z, tiered(kernels.step, len(drive.lengths)), tiered(kernels.outputs)
        self._lengths, self._counts = drive.lengths, drive.counts
        takes_slopes = all(f"{port}_rate" in kernels.BLOCKS for port in drive.ports)
        follows = not drive.is_steady and not takes_slopes
        half = 0.5 * drive.lengths[:, None] if follows else 0.0
        first = {port: pieces.values[:1] for port, pieces in drive.ports.items()}
        values = {port: pieces.values + half * pieces.slopes for port, pieces in drive.ports.items()}
        last = {port: values[port] + half * pieces.slopes for port, pieces in drive.ports.items() if follows}
        slopes = {f"{port}_rate": pieces.slopes for port, pieces in drive.ports.items() if takes_slopes}
        self._first, self._values = _Rows(kernels, z, first), _Rows(kernels, z, values)
        self._slopes = _Rows(kernels, z, {} if drive.is_steady else slopes)
        self._last = _Rows(kernels, z, last)

    def start(self) -> None:
        """Set the inputs at the run's start."""
        self._first.put(0)

    def advance(self, k: int) -> bool:
        """Take the pieces from communication point k - 1 to k; return whether none was refused."""
        for i in range(self._counts[k - 1], self._counts[k]):
            self._values.put(i)
            self._slopes.put(i)
            if self._step(self._z, self._lengths[i]) != OK:
                return False
        if self._last.names:
            self._last.put(self._counts[k] - 1)
            self._outputs(self._z)
        return True


class _Rows:
    """A row of numbers for each piece, and the stretch of the buffer that it goes to; between blocks it is zero."""

    def __init__(self, kernels: Model, z: Buffer, blocks: dict[str, Array]) -> None:
        self.names = tuple(blocks)
        places = [kernels.BLOCKS[name] for name in blocks]
        first, end = min((p.start for p in places), default=0), max((p.stop for p in places), default=0)
        self._rows = np.zeros((max(map(len, blocks.values()), default=0), end - first))
        for place, values in zip(places, blocks.values(), strict=True):
            self._rows[:, place.start - first : place.stop - first] = values
        self._stretch = z[first:end]

    def put(self, i: int) -> None:
        """Set the inputs of piece i."""
        if self.names:
            self._stretch[:] = self._rows[i]
