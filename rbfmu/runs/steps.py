"""Runs in steps: a model's buffer from its start on, driven or not, and rows of numbers recorded after its steps.

Steps are called from Python, until the step is machine code and there are many; then a compiled loop takes many a call.
"""

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import cache
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numba import float64, int64, types

from rbfmu.exceptions import SimulationError
from rbfmu.models.model_buffer import by_block, places_of
from rbfmu.runs.inputs import Drive, undriven
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Buffer, Indices, Motion
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.compile.decorator import loop
from rbfmu_kernels.compile.tiered import Tiered, tiered
from rbfmu_kernels.mechanics.equations_of_motion import ROTATION

SAME = 1e-9
"""Times of events that differ by at most this part of a step count as the same."""
LONG = 20_000
"""The steps that a process takes from Python, about 2 us each, before the loop is compiled or loaded."""
FIRST, MOST, SOON = 64, 65_536, 0.02
"""FIRST, MOST: the most steps of the first call of the loop, and of any call. SOON: the time that a call should take,
s, as Ctrl-C and progress wait for its end. The number of steps is doubled after a shorter call, halved after others."""
Tell = Callable[[float], object] | None
"""A function, if any, that is called from time to time with the part that is done, 0 to 1."""


class Steps:
    """A run at its start: its buffer `z`, and `advance` for each communication step.

    names: the outputs that are computed, in place of the scene's; runs: how many such runs will follow, this one
    included, by which compiling may pay. If inputs change linearly and the model has no input derivatives, it gets
    their mean over each piece, and their last values at communication points.
    """

    taken_by_all = 0
    """The steps of all runs of this process."""

    def __init__(
        self, scene: Scene, plan: Plan, drive: Drive, names: Collection[str] | None = None, runs: int = 1
    ) -> None:
        self._scene, self.kernels = scene, plan.kernels
        self._time, self._lengths, self._counts = drive.time, drive.lengths, drive.counts.astype(np.int64, copy=False)
        self.count = len(self._counts) - 1
        rates = [f"{port}_rate" for port in drive.ports]
        takes_slopes, is_steady = all(rate in self.kernels.BLOCKS for rate in rates), not drive.slopes.any()
        follows = not (is_steady or takes_slopes)
        half = (0.5 * drive.lengths[:, None] if follows else 0.0) * drive.slopes
        places = self._places = self.places(drive.ports)
        self._values = drive.values + half
        self._at_points, self._last = places if follows else places[:0], self._values + half
        if takes_slopes and not is_steady:
            self._places = self.places((*drive.ports, *rates))
            self._values = np.hstack([self._values, drive.slopes])
        self.z = filled_buffer(scene, plan, names)
        self.z[places] = drive.values[0]
        initialize(scene, self.kernels, self.z)
        self._step = tiered(self.kernels.step, len(self._lengths) * runs)
        self._through = tiered(self.kernels.run_through, runs) if plan.runs_through else None  # type: ignore[arg-type]
        self.events: Events | None = None
        self.ended: float | None = None
        """The time of the event that ended the run, s."""
        self._together, self._is_over = 0, False
        Steps.taken_by_all += len(self._lengths)

    def advance(self, k: int) -> bool:
        """Take step k, counted from 1, or up to an event that ends the run; return False if a piece was refused."""
        for i in range(self._counts[k - 1], self._counts[k]):
            if len(self._places):
                self.z[self._places] = self._values[i]
            before, length = self.z.copy() if self.events and self.events.ending else None, float(self._lengths[i])
            if self._step(self.z, length) != OK:
                return False
            self.ended = self.events.take(length) if self.events else None
            if self.ended is not None and before is not None:
                return self._go_back(before, self.ended)
        if len(self._at_points):
            self.z[self._at_points] = self._last[self._counts[k] - 1]
            tiered(self.kernels.outputs)(self.z)
        return True

    def _go_back(self, before: Buffer, end: float) -> bool:
        """Take the last piece again, up to the time of an event; before: the buffer before the piece."""
        self.z[:] = before
        since, rest = before[self.kernels.BLOCKS["series.time"]]
        length = (end - since) - rest
        return length <= 0.0 or bool(self._step(self.z, length) == OK)

    @property
    def _goes_in_a_loop(self) -> bool:
        """Return whether the compiled loop can take the steps: they are alike, many, and machine code."""
        many = Steps.taken_by_all > LONG and self.count >= FIRST and not self.events and not len(self._at_points)
        if not (many and isinstance(self._step, Tiered) and self._step.is_compiled):
            return False
        # otherwise the loop would compile the step with another signature, which no other code uses
        return (_NUMBERS, float64) in self.kernels.step.overloads  # type: ignore[attr-defined]

    def take(self, k: int, at: Indices, rows: Array, most: float = math.inf) -> int:
        """Take step k, and maybe some after it; return the number of the last step taken, k - 1 if the run is over.

        rows[k] is set to the numbers of the buffer at places `at` after step k. The run is over if a step is refused,
        or after a step with which there are more than `most` substeps; such a step sets no row. A run whose outputs are
        interpolated is taken whole.
        """
        if self._is_over:
            return k - 1
        substeps, begin = self.kernels.BLOCKS.get("substeps"), perf_counter()
        if self._through:
            reached = int(self._through(self.z, self._time, at, rows, np.empty((self.count, ROTATION))))
            self._is_over = True
            if substeps and self.z[substeps][0] > most:
                rows[k:], reached = np.nan, k - 1
            return reached
        if not (self._together and self._goes_in_a_loop):
            if not self.advance(k) or (substeps and self.z[substeps][0] > most):
                self._is_over = True
                return k - 1
            rows[k] = self.z[at]
            length = max(perf_counter() - begin, 1e-9)  # s; the clock's resolution may be longer than a step
            self._together = self._together or min(FIRST, int(SOON / length)) or 1
            return k
        last = min(k - 1 + self._together, self.count)
        counted = substeps.start if substeps else -1
        pieces = _Pieces(self._lengths, self._counts, self._places, self._values, at, rows)
        taken = int(_compiled_loop()(self.kernels.step, self.z, pieces, k - 1, last, counted, most))
        self._is_over = taken < last
        self._together = min(2 * self._together, MOST) if perf_counter() - begin < SOON else self._together // 2 or 1
        return taken

    def places(self, names: Collection[str]) -> Indices:
        """Return the places of the blocks named in the buffer."""
        return places_of(self.kernels.BLOCKS, names)

    def course(
        self, names: Collection[str], progress: Callable[[Sequence[int]], Iterable[int]] | None = None,
        most: float = math.inf,
    ) -> tuple[Array, Motion]:  # fmt: skip
        """Return the times (n,), s, up to the event that ends the run, and the blocks' values (n, k) at these, by name.

        progress: wraps the numbers of steps; if it stops early, so do times and rows. most: the number of substeps
        after which a step is refused. Raises SimulationError if one is refused.
        """
        self.events = Events(self._scene, self.kernels.BLOCKS, self.z) if self._scene.events else None
        at, time, numbers, taken, reached = self.places(names), self._time, range(1, self.count + 1), 0, 0
        rows = np.empty((len(time), len(at)))
        rows[0] = self.z[at]
        for k in (self.count,) if progress is None else progress(numbers):
            reached = min(max(k, reached), self.count)
            while taken < reached and self.ended is None:
                begin, taken = taken, self.take(taken + 1, at, rows, most)
                if taken == begin:
                    raise self._refusal(taken, most)
            if self.ended is not None:
                before = self.ended <= time[taken - 1]  # the event may be at the communication point before
                time = time[:taken] if before else np.append(time[:taken], self.ended)
                break
        else:
            time = time[: reached + 1]  # progress may stop early
        return time, by_block(self.kernels.BLOCKS, names, rows[: len(time)])

    def _refusal(self, taken: int, most: float) -> SimulationError:
        """Return the error for the step after `taken` steps, which was refused or exceeds `most` substeps."""
        if (counted := substeps_counted(self.kernels, self.z)) <= most:
            return refused_step(self._scene.name, self._time[taken])
        end = float(self._time[taken + 1])
        message = f"t = {end!r} s takes {counted:.1e} substeps: expected a shorter run or slower rates"
        return SimulationError(f"{self._scene.name}: {message}")


class _Pieces(NamedTuple):
    """The pieces of a run, for the compiled loop, and the numbers that are kept after each step.

    lengths (L,): of the pieces, s; counts (n + 1,): the number of pieces before each point; places (p,), values (L, p):
    of the inputs in each piece; at (w,): the places of the numbers kept; rows (n + 1, w): where they are kept.
    """

    lengths: Array
    counts: Indices
    places: Indices
    values: Array
    at: Indices
    rows: Array


def _take_many(step: Any, z: Buffer, pieces: _Pieces, first: int, last: int, counted: int, most: float) -> int:
    """Take the steps after `first` up to `last` as `Steps.take` does; return the last one taken.

    counted: the place of the number of substeps, -1 if it is not counted.
    """
    lengths, counts, places, values, at, rows = pieces
    for k in range(first, last):
        for i in range(counts[k], counts[k + 1]):
            for j in range(len(places)):
                z[places[j]] = values[i, j]
            if step(z, lengths[i]) != 0:
                return k
        if counted >= 0 and z[counted] > most:
            return k
        for j in range(len(at)):
            rows[k + 1, j] = z[at[j]]
    return last


_NUMBERS, _TABLE, _INDICES = float64[::1], float64[:, ::1], int64[::1]
_STEP = types.FunctionType(int64(_NUMBERS, float64))


@cache
def _compiled_loop() -> Callable[..., Any]:
    """Return the loop as machine code; it calls the step of any model by its address."""
    pieces = types.NamedTuple((_NUMBERS, _INDICES, _INDICES, _TABLE, _INDICES, _TABLE), _Pieces)
    return loop(_take_many, int64(_STEP, _NUMBERS, pieces, int64, int64, int64, float64))  # type: ignore[no-any-return]


def record(run: Steps, names: Sequence[str], most: float = math.inf, progress: Tell = None) -> Motion:
    """Return the blocks named, at the start and after each step, (n + 1, k) each; NaN after the motion ends.

    most: the number of substeps after which it ends; progress: a function that is called with the part that is done.
    No event ends it.
    """
    at, before, taken = run.places(names), -1, 0
    rows = np.full((run.count + 1, len(at)), np.nan)
    rows[0] = run.z[at]
    while before < taken < run.count:
        before, taken = taken, run.take(taken + 1, at, rows, most)
        if progress is not None:
            progress(taken / run.count)
    return by_block(run.kernels.BLOCKS, names, rows)


def motion_of(scene: Scene, plan: Plan, steps: Sequence[float], names: Sequence[str]) -> Motion:
    """Return a scene's motion by a plan: the blocks named, at the start and after each of the steps, s."""
    return record(Steps(scene, plan, undriven(steps), names), names)


def substeps_counted(kernels: Model, z: Buffer) -> float:
    """Return the number of substeps since the start; 0 if the model does not count them."""
    return float(z[kernels.BLOCKS["substeps"]][0]) if "substeps" in kernels.BLOCKS else 0.0


def refused_step(name: str, begin: float) -> SimulationError:
    """Return the error for a refused step of a scene's run; begin: its first time, s."""
    return SimulationError(f"{name}: the step from t = {float(begin)!r} s was refused: not finite")


class Occurrence(NamedTuple):
    """An event that happened at `time`, s; touched: the number watched reached zero but did not change its sign."""

    name: str
    time: float
    touched: bool = False


class Events:
    """The events of a run: those that the model lists of its last step, and those taken of steps before.

    ending: the names of events that end the run.
    """

    def __init__(self, scene: Scene, blocks: dict[str, slice], z: Buffer) -> None:
        self.names, self.ending = (*scene.events,), {name for name, event in scene.events.items() if event.stop}
        self._count, self._list = z[blocks["events.listed"]], z[blocks["events.list"]].reshape(-1, 3)
        self.taken: list[Occurrence] = []
        self.ended_by = ""

    def of_last_step(self) -> list[Occurrence]:
        """Return the events of the last step, in the order of their times."""
        from rbfmu_kernels.models.formula_events import NOT_ASKED, TOUCH  # only if needed, as it loads slowly

        rows = self._list[: int(self._count[0])]
        found = [Occurrence(self.names[int(e)], float(t), kind == TOUCH) for e, t, kind in rows if kind != NOT_ASKED]
        return sorted(found, key=lambda event: event.time)

    def take(self, length: float) -> float | None:
        """Keep the events of the last step, up to one that ends the run; return its time, s, or None.

        length: of the step, s.
        """
        found = self.of_last_step()
        ends = [event for event in found if event.name in self.ending and not event.touched]
        self.taken += [event for event in found if not ends or event.time <= ends[0].time + SAME * length]
        if not ends:
            return None
        self.ended_by, end, _ = ends[0]
        return end

    def times(self, happened: list[Occurrence], touched: bool = False) -> dict[str, Array]:
        """Return the times of each event, s, by name: of those that happened, or of those that only touched."""
        wanted = [event for event in happened if event.touched == touched]
        return {name: np.array([event.time for event in wanted if event.name == name]) for name in self.names}
