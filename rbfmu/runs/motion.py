"""Motions: runs of a model, driven or not, what its buffer shows over one, and errors between two of these.

Errors are counted as a scene's `accuracy` counts them: of the attitude as an angle, rad; of all else relative to the
largest size in the run, as a quantity that passes through zero has no error relative to itself there.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rbfmu import arrays
from rbfmu.exceptions import SimulationError
from rbfmu.models.question import Question
from rbfmu.runs.inputs import Drive
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Buffer, Motion
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.buffer_access import quaternion_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE
from rbfmu_kernels.quantities import ANGLE, DISSIPATIVE, FORCES, OUTPUT, OUTPUTS, TORQUES
from rbfmu_kernels.rotations.quaternion import angle_between

SAME = 1e-9
"""The part of a step by which times may differ and still be those of one event, or of two at once."""
FLOORS: Mapping[str, float] = {row.name: row.floor for row in OUTPUTS if row.floor}
"""The least size, m or m/s, that an error is relative to, by the quantity's name."""
NOISE = 64.0 * 2.0**-52
"""The part of a quantity's largest term below which it is that of a body at rest, whatever cancels in the quantity."""


class Steps:
    """A run without inputs, at its start: its buffer `z`, and `advance` by each of the steps (s), in equal parts.

    runs: how many such ones are known to come, this one among them.
    """

    def __init__(
        self, scene: Scene, plan: Plan, steps: Sequence[float], names: Collection[str], parts: int = 1, runs: int = 1
    ) -> None:
        self.kernels, self.z, self.count = plan.kernels, start_run(scene, plan, names), len(steps)
        self._lengths, self._parts = steps, parts
        self._step = tiered(plan.kernels.step, len(steps) * parts * runs)

    def advance(self, k: int) -> bool:
        """Take step k, counted from 1; return whether none of its parts was refused."""
        h, parts = self._lengths[k - 1] / self._parts, 0
        while parts < self._parts and self._step(self.z, h) == OK:
            parts += 1
        return parts == self._parts


class Driven:
    """A run that inputs drive, at its start: its buffer `z`, and `advance` for each communication step.

    A model that takes no input derivatives gets the mean of each piece, and the last value at a communication point.
    """

    def __init__(self, scene: Scene, plan: Plan, drive: Drive, names: Collection[str] | None = None) -> None:
        kernels = self.kernels = plan.kernels
        first = {port: pieces.values[0] for port, pieces in drive.ports.items()}
        z = self.z = start_run(scene, plan, names, first)
        self.count, self._lengths, self._counts = len(drive.time) - 1, drive.lengths, drive.counts
        self._step, self._outputs = tiered(kernels.step, len(drive.lengths)), tiered(kernels.outputs)
        takes_slopes = all(f"{port}_rate" in kernels.BLOCKS for port in drive.ports)
        follows = not drive.is_steady and not takes_slopes
        half = 0.5 * drive.lengths[:, None] if follows else 0.0
        values = {port: pieces.values + half * pieces.slopes for port, pieces in drive.ports.items()}
        last = {port: values[port] + half * pieces.slopes for port, pieces in drive.ports.items() if follows}
        if takes_slopes and not drive.is_steady:
            values |= {f"{port}_rate": pieces.slopes for port, pieces in drive.ports.items()}
        self._inputs, self._last = (
            [(z[kernels.BLOCKS[name]], rows) for name, rows in of.items()] for of in (values, last)
        )
        self.events = Events(scene, plan, z) if scene.events else None
        self.ended: float | None = None
        """The time of the event that ended the run, s."""
        self._name, self._time = scene.name, drive.time

    def course(
        self, names: Collection[str], progress: Callable[[Sequence[int]], Iterable[int]] | None = None,
        most: float = math.inf,
    ) -> tuple[Array, dict[str, Array]]:  # fmt: skip
        """Return the times (n,) up to the event that ends the run, and the rows of blocks at these by name, (n, k).

        most: the number of substeps after which a step is refused. Raises SimulationError where one is.
        """
        places, time = [np.r_[self.kernels.BLOCKS[name]] for name in names], self._time
        at, numbers = np.concatenate(places), range(1, len(time))
        rows = np.empty((len(time), len(at)))
        rows[0] = self.z[at]
        for k in numbers if progress is None else progress(numbers):
            if not self.advance(k):
                raise refused_step(self._name, time[k - 1])
            if most < math.inf and (taken := substeps_counted(self.kernels, self.z)) > most:
                said = f"t = {float(time[k])!r} s takes {taken:.1e} substeps: expected a shorter run or slower rates"
                raise SimulationError(f"{self._name}: {said}")
            rows[k] = self.z[at]
            if self.ended is not None:
                before = self.ended <= time[k - 1]  # the event may be at the communication point before
                time = time[:k] if before else np.append(time[:k], self.ended)
                break
        ends = np.cumsum([len(place) for place in places])[:-1]
        return time, dict(zip(names, np.split(rows[: len(time)], ends, axis=1), strict=True))

    def advance(self, k: int) -> bool:
        """Take the pieces from communication point k - 1 to k; return whether none was refused."""
        for i in range(self._counts[k - 1], self._counts[k]):
            for block, rows in self._inputs:
                block[:] = rows[i]
            before = self.z.copy() if self.events and self.events.ending else None
            if self._step(self.z, self._lengths[i]) != OK:
                return False
            self.ended = self.events.take(self._lengths[i]) if self.events else None
            if self.ended is not None and before is not None:
                return self._go_back(before, self.ended)
        if self._last:
            for block, rows in self._last:
                block[:] = rows[self._counts[k] - 1]
            self._outputs(self.z)
        return True

    def _go_back(self, before: Buffer, end: float) -> bool:
        """Take the last piece anew, up to an event."""
        self.z[:] = before
        since, rest = before[self.kernels.BLOCKS["series.time"]]
        length = (end - since) - rest
        return length <= 0.0 or bool(self._step(self.z, length) == OK)


def refused_step(name: str, begin: float) -> SimulationError:
    """Return the error for a step of a scene's run that was refused; begin: s."""
    return SimulationError(f"{name}: the step from t = {float(begin)!r} s was refused: not finite")


class Happened(NamedTuple):
    """An event that happened; touched: what is watched came to zero and went back."""

    name: str
    time: float
    touched: bool


class Events:
    """What a model lists of its last step, and what was taken of the steps before; ending: events that end the run."""

    def __init__(self, scene: Scene, plan: Plan, z: Buffer) -> None:
        blocks = plan.kernels.BLOCKS
        self.names, self.ending = (*scene.events,), {name for name, event in scene.events.items() if event.stop}
        self._count, self._list = z[blocks["events.listed"]], z[blocks["events.list"]].reshape(-1, 3)
        self.taken: list[Happened] = []
        self.ended_by = ""

    def of_last_step(self) -> list[Happened]:
        """Return what happened in the last step, in its order."""
        from rbfmu_kernels.models.formula_events import NOT_ASKED, TOUCH  # what has none starts sooner

        rows = self._list[: int(self._count[0])]
        found = [Happened(self.names[int(e)], float(t), kind == TOUCH) for e, t, kind in rows if kind != NOT_ASKED]
        return sorted(found, key=lambda event: event.time)

    def take(self, length: float) -> float | None:
        """Keep what happened in the last step, s, up to what ends the run; return the time of that, or None."""
        found = self.of_last_step()
        ends = [event for event in found if event.name in self.ending and not event.touched]
        self.taken += [event for event in found if not ends or event.time <= ends[0].time + SAME * length]
        if not ends:
            return None
        self.ended_by, end, _ = ends[0]
        return end

    def times(self, happened: list[Happened], touched: bool = False) -> dict[str, Array]:
        """Return the times of each event, s, that happened, or only touched."""
        wanted = {name: [one.time for one in happened if one[::2] == (name, touched)] for name in self.names}
        return {name: np.array(times) for name, times in wanted.items()}


def record(
    run: Steps | Driven, names: Sequence[str], most: float = math.inf, progress: Callable[[float], object] | None = None
) -> Motion:
    """Return the blocks named now and after each step; NaN from where the motion ends.

    most: the number of substeps after which it ends; progress: a function that is told which part of the run is done.
    """
    blocks, taken = {name: run.z[run.kernels.BLOCKS[name]] for name in names}, _substeps_of(run.kernels, run.z)
    motion = {name: np.full((run.count + 1, len(block)), np.nan) for name, block in blocks.items()}
    shown = [(motion[name], block) for name, block in blocks.items()]
    for k in range(run.count + 1):
        if k and not (run.advance(k) and taken[0] <= most):
            break
        for rows, block in shown:
            rows[k] = block
        if progress is not None:
            progress(k / run.count)
    return motion


def motion_of(scene: Scene, plan: Plan, steps: Sequence[float], names: Sequence[str]) -> Motion:
    """Return the motion that a plan makes of a scene, at its start and after each step, s."""
    return record(Steps(scene, plan, steps, names), names)


def substeps_counted(kernels: Model, z: Buffer) -> float:
    """Return the number of substeps since the start; 0 where the model counts none."""
    return float(_substeps_of(kernels, z)[0])


def _substeps_of(kernels: Model, z: Buffer) -> Array:
    return np.asarray(z[kernels.BLOCKS["substeps"]]) if "substeps" in kernels.BLOCKS else np.zeros(1)


# Errors between two motions


def attitude_error(a: Array, b: Array) -> Array:
    """Return the angles, rad, between attitudes: unit quaternions (..., 4)."""
    if np.ndim(a) != 2 or np.shape(a) != np.shape(b):
        return arrays.angle_between(a, b)  # type: ignore[no-any-return]
    angles = np.empty(len(a))
    tiered(_put_angles)(*(np.ascontiguousarray(q, np.float64).ravel() for q in (a, b)), angles)
    return angles


@kernel(inline=False)
def _put_angles(a: Buffer, b: Buffer, angles: Buffer) -> None:
    for i in range(len(angles)):
        angles[i] = angle_between(quaternion_at(a, 4 * i), quaternion_at(b, 4 * i))


def relative_error(a: Array, b: Array, floor: float) -> Array:
    """Return |a - b| over rows of (n, 3), relative to the largest |b| of the run, at least `floor`."""
    return sizes(a - b, max(largest_size(b), floor) or 1.0)


def largest_size(rows: Array) -> float:
    """Return the largest length of a row, without overflow."""
    unit = float(np.max(np.abs(rows), initial=0.0))
    return unit * float(np.max(sizes(rows, unit))) if 0.0 < unit < math.inf else unit


def sizes(rows: Array, unit: float) -> Array:
    """Return the lengths of rows, in units of one."""
    return np.asarray(np.linalg.norm(rows / unit, axis=-1))


def largest_error(
    a: Mapping[str, Array], b: Mapping[str, Array], names: Iterable[str], floors: Mapping[str, float] = FLOORS,
    absolute: bool = False,
) -> float:  # fmt: skip
    """Return the largest error of a run in the quantities named; infinite where one is not finite.

    floors: the least size that an error is relative to, by the quantity's name and in its unit; absolute: whether
    positions and velocities count relative to 1 m and 1 m/s, as something varies that they grow with.
    """
    worst = 0.0
    for name in names:
        if name in OUTPUT and OUTPUT[name].error == ANGLE:
            largest = float(np.max(attitude_error(a[name], b[name])))
        elif absolute and name in FLOORS:
            largest = largest_size(a[name] - b[name])
        else:
            largest = float(np.max(relative_error(a[name], b[name], floors.get(name, 0.0))))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst


# Sizes that errors are relative to


def least_sizes(asked: Question, motion: Motion) -> dict[str, float]:
    """Return the least size that errors are relative to, by name.

    A quantity that is zero but for round-off of its terms has no size of its own: errors are relative to these terms.
    """
    resting = {name: size for name, (size, part) in _parts(asked, motion).items() if part <= NOISE}
    return {**FLOORS, **resting}


def lost_to_cancellation(asked: Question, motion: Motion) -> float:
    """Return a bound of what round-off of terms that cancel makes of the motion's quantities, relative to these."""
    return max((NOISE / part for _, part in _parts(asked, motion).values() if part > NOISE), default=0.0)


def _parts(asked: Question, motion: Motion) -> dict[str, tuple[float, float]]:
    """Return each quantity's natural size, and its largest as a part of it; of an energy, the part of the rate."""
    found: dict[str, tuple[float, float]] = {}
    for name, size in natural_sizes(asked, motion).items():
        if name in motion and size > 0.0:
            part = largest_size(motion[name]) / size
            found[name] = size, math.sqrt(part) if OUTPUT[name].unit == "J" else part
    return found


def natural_sizes(asked: Question, motion: Motion) -> dict[str, float]:
    """Return the size of each quantity that the scene's loads and rates make where they are not in balance."""
    body, size = asked.body, asked.scene.loads.sizes
    force = body.mass * size["gravity_a"] if body.pivot else sum(size[name] for name in sorted(FORCES))
    arm, (low, middle, high) = math.hypot(*body.r_oc_b), asked.start.principal_axes[0].tolist()
    least = low if low > INERTIA_TOLERANCE * high else middle
    torque = sum(size[name] for name in sorted(TORQUES - DISSIPATIVE))
    angular = (torque + arm * force) / least
    turning = largest_size(motion.get("omega_b", np.array(asked.scene.initial.omega_b)))
    rate = math.sqrt(angular) + turning
    angular += turning * turning
    linear = size["gravity_a"] + force / body.mass
    speed = 0.0 if body.pivot else linear * asked.span
    by_unit = {
        "rad/s": rate, "rad/s2": angular, "kg m2/s": high * rate, "m/s2": arm * angular + linear,
        "J": high * rate * rate + body.mass * speed * speed,
    }  # fmt: skip
    return {row.name: by_unit[row.unit] for row in OUTPUTS if row.unit in by_unit}
