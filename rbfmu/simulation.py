"""Run a scene by its plan: `simulate` all of it, or step a `Simulator` by hand."""

import hashlib
import json
import math
import struct
from collections.abc import Callable, Iterable, Sequence
from numbers import Real
from typing import Any
from zlib import crc32

import numpy as np

from rbfmu.exceptions import SimulationError as SimulationError
from rbfmu.result import Result, Row
from rbfmu.runs.inputs import HOLD, Drive, Inputs, InputTables, drive_of, input_tables, size_of
from rbfmu.runs.motion import doubts_of_sizes
from rbfmu.runs.plan import Plan, checked_plan, start_run, with_parameters
from rbfmu.runs.steps import SAME, Events, Occurrence, Steps
from rbfmu.scene.scene import Scene, doubts_after, of_scene_or_path, warn
from rbfmu.scene.section import as_toml, fault
from rbfmu.types import Array, Buffer
from rbfmu_kernels.buffer import OK, PAST_STOP
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import BY_NAME, OUTPUTS, Output

__all__ = ["Simulator", "compiled_step", "plan", "simulate"]

Wrap = Callable[[Sequence[int]], Iterable[int]]
"""A function that wraps a sequence of step numbers."""


@of_scene_or_path
def plan(
    scene: Scene,
    full: bool = False,
    progress: Callable[[float], object] | None = None,
    *,
    inputs: "Inputs | None" = None,  # as text, which `help` does not write out
    interpolate: str = HOLD,
) -> Plan:
    """Choose model, method and settings for a scene or a scene file; full: to integrate all degrees of freedom.

    progress: a function that is called from time to time with the part of the reference motion that is computed.
    inputs, interpolate: see `simulate`; error and cost are then those of the run with these inputs. Raises SceneError
    if the accuracy asked cannot be met.
    """
    return _plan(scene, input_tables(scene, inputs, interpolate), interpolate, full, progress)


def _plan(
    scene: Scene, tables: InputTables, interpolate: str, full: bool = False,
    progress: Callable[[float], object] | None = None,
) -> Plan:  # fmt: skip
    from rbfmu.planning.select import plan as planned  # not needed if the plan is given

    driven = (lambda parts: drive_of(scene, tables, interpolate, parts)) if tables else None
    return planned(scene, full, progress, driven=driven)


@of_scene_or_path
def simulate(
    scene: Scene,
    inputs: "Inputs | None" = None,  # as text, which `help` does not write out
    interpolate: str = HOLD,
    *,
    planned: Plan | None = None,
    progress: Wrap | None = None,
) -> Result:
    """Run a scene or a scene file; its FMU gives the same bits at the same communication steps and inputs.

    inputs: what drives the ports: a mapping from a port's name to `(times (m,), values (m, 3))` or to an array (n, 3)
    with a row for each communication step, and if linear one for the end, or the path of a CSV file in FMPy's format
    (`time`, then `torque_b[1]` and so on). Ports that are not named stay at zero, those of your own at their start.
    interpolate: "hold" (each value from its time on) or "linear" between times. Communication steps are cut at times
    inside them. A model without input derivatives uses the mean of linear inputs over each step.
    planned: a plan whose model and method are used unchanged; without it, a plan is made that meets the accuracy with
    the given inputs. One that is `interpolated` is refused with ports.
    progress: wraps the sequence of step numbers, such as a progress bar; if it stops early, the run ends there. Raises
    SceneError, SimulationError.
    """
    if progress is not None and not callable(progress):
        expected = "a function that wraps step numbers, as rbfmu.progress_bar(name) is"
        raise TypeError(fault("progress", progress, expected))
    tables = input_tables(scene, inputs, interpolate)
    planned = checked_plan(planned) or _plan(scene, tables, interpolate)
    result = run_of(scene, planned, drive_of(scene, tables, interpolate), progress)
    warn(scene, (*doubts_after(scene, result.quantities), *doubts_of_sizes(scene, result.quantities)))
    return result


def run_of(scene: Scene, planned: Plan, drive: Drive | None = None, progress: Wrap | None = None) -> Result:
    """Return a scene's run by a plan, without inputs if no drive is given; there are no warnings."""
    planned = planned.of_scene(scene)
    run = Steps(scene, planned, drive or drive_of(scene, {}, HOLD))
    time, shown = run.course(scene.outputs.names, progress)
    quantities = {name: (rows[:, 0] if rows.shape[1] == 1 else rows).copy() for name, rows in shown.items()}
    happened = [run.events.times(run.events.taken, touched) for touched in (False, True)] if run.events else ()
    return Result(time, quantities, planned.formulas.own_rows if planned.formulas else {}, *happened)


_UNKNOWN = -1
"""The number of communication steps is not known after a step of another length; finding it costs half a step."""
_PORT, _NUMBER = struct.Struct("3d"), struct.Struct("d")
_Input = tuple[struct.Struct, int, tuple[float, ...]]
_Before = list[_Input]
"""Earlier inputs: the format, the place and the numbers of each."""
_WITHOUT_PLACES = frozenset((set, frozenset, dict))
"""Types whose numbers have no order."""


class Simulator:
    """One instance of a scene, like its FMU: `step`, read quantities by name, `save`, `restore`, `reset`.

    scene: a rbfmu.Scene or the path of a scene file; parameters: values by the FMU's names (`mass=2.0`,
    `omega_b_0=[0, 0, 1]`), of parameters that the scene lists in `inputs.parameters`, as the plan does not depend on
    these. Every quantity that the scene asks for is an attribute: a float, or a new array. Only one thread at a time
    may use an object; several objects can run in parallel. Raises SceneError.
    """

    __slots__ = (  # without these, `sim.torque_b = ...` would silently have no effect
        "__weakref__", "_bytes", "_clock", "_count", "_end", "_events", "_h", "_identity", "_last", "_last_time",
        "_no_reports", "_old_reports", "_ports", "_quantities", "_reports", "_scalars", "_start", "_step", "_z", "plan",
        "scene", "time",
    )  # fmt: skip

    def __init__(self, /, scene: Any, **parameters: Any) -> None:
        own, planned = of_scene_or_path(lambda scene: (scene, plan(scene)), "Simulator")(scene)
        self._set_up(own, *_start_with(own, planned, parameters))

    def _set_up(self, scene: Scene, planned: Plan, z: Buffer) -> None:
        self.scene, self.plan, self._z = scene, planned, z
        kernels, run = planned.kernels, scene.run
        blocks = kernels.BLOCKS
        self._bytes, self._step = self._z.data.cast("B"), tiered(kernels.step)
        self._ports = {name: 8 * blocks[name].start for name in self.scene.inputs.ports}
        self._scalars = {name for name, port in self.scene.inputs.own.items() if port.size == 1}
        self._quantities = {name: self._z[blocks[name]] for name in self.scene.outputs.names}
        self._identity = _identity(self.scene, self.plan)
        self._start, self._h, self._last_time = run.start, run.step, run.last_time
        self._last, self._end = run.count, run.end
        self.time, self._count = run.start, 0
        self._events = Events(self.scene, blocks, self._z) if self.scene.events else None
        self._no_reports = (math.nan,) * len(self.scene.events)
        self._old_reports = self._reports = self._no_reports
        """When `step_to_event` reported each event, s: before the last step, and at its end; NaN if it did not."""
        self._clock = struct.Struct(f"dq{2 * len(self._no_reports)}d")
        """The time, the number of the scene's communication steps until then, and the times of reported events."""

    @property
    def events(self) -> dict[str, Array]:
        """Return the times of the last step's events by name, s.

        An event at the end of a step counts for the next step, except if `step_to_event` stopped at it: then it is
        listed at once, and not again.
        """
        if self._events is None:
            return {}
        listed = [Occurrence(n, t) for n, t in zip(self.scene.events, self._reports, strict=True) if math.isfinite(t)]
        return self._events.times(listed or self._new_events(self._events))

    def _new_events(self, events: Events) -> list[Occurrence]:
        """Return the events of the last step, except those that were reported before it."""
        known = dict(zip(events.names, self._old_reports, strict=True))
        until = {name: t + SAME * (self.time - t) for name, t in known.items()}
        return [event for event in events.of_last_step() if not event.time <= until[event.name]]  # NaN bounds nothing

    def step_to_event(self, /, h: float | None = None, **ports: Any) -> tuple[str, ...]:
        """Step as `step` does, but not beyond the first event; return the names of the events at that time."""
        before, time, count, reports, earlier = self._z.copy(), self.time, self._count, self._reports, self._old_reports
        self.step(h, **ports)
        happened = [event for event in self._new_events(self._events) if not event.touched] if self._events else []
        if not happened:
            return ()
        first = happened[0].time
        at_once = {event.name: event.time for event in happened if event.time <= first + SAME * (self.time - time)}
        self._z[:] = before
        self.time, self._count, self._reports, self._old_reports = time, count, reports, earlier
        if first > time:
            self.step(first - time, **ports)
        else:
            self.hold(**ports)
        self._reports = tuple(at_once.get(name, math.nan) for name in self.scene.events)
        return tuple(at_once)

    def __getattr__(self, name: str) -> Any:
        """Return an output of your own. Raises AttributeError for other names, and for quantities not asked for."""
        known = {} if name in self.__slots__ else self._quantities  # a slot is missing before set-up and in a copy
        if name not in known:
            whose = f"{self.scene.name}; it has {', '.join(known)}" if known else "it"
            raise AttributeError(f"no quantity {name!r} is asked for by {whose}")
        values = known[name]
        return values.copy() if len(values) > 1 else float(values[0])

    def buffer(self) -> Array:
        """Return a copy of the model's buffer; `plan.kernels.BLOCKS` has the slice of each block, by name."""
        return self._z.copy()

    def __repr__(self) -> str:
        return f"Simulator({self.scene.name!r}: {self.plan.model}, t = {self.time!r} s)"

    @property
    def status(self) -> int:
        """Return 0, or 2 past the scene's `stop`, where its accuracy is no longer promised: the FMU's `status`."""
        return PAST_STOP if self.time > self._last_time else OK

    def step(self, /, h: float | None = None, **ports: Any) -> None:
        """Step by h, s (by default to the scene's next communication point), with inputs that are held over the step.

        ports: three finite numbers each, one for a scalar of your own; inputs that are not given keep their last value.
        Raises ValueError for a wrong input, TypeError if h is no number, SimulationError if the step is refused: then
        nothing has changed, not even an input.
        """
        if h is None:
            count = 1 + (self._count if self._count >= 0 else self.scene.run.steps_until(self.time))
            end = self._start + count * self._h
            if count == self._last and self.time < self._end < end:  # the last step is shorter
                count, end = _UNKNOWN, self._end
            length = end - self.time
        else:
            length = h if type(h) is float else _seconds(h)
            count, end = _UNKNOWN, self.time + length
        before = self._put(ports) if ports else ()
        try:
            if self.time < end < math.inf and self._step(self._z, length) == OK:
                self.time, self._count = end, count
                self._old_reports, self._reports = self._reports, self._no_reports
                return
        except KeyboardInterrupt:  # compiled code runs to its end, but its result is lost
            self.time, self._count = math.nan, 0
            raise
        self._put_back(before)
        no_size = "it is too small for this time" if length > 0.0 else "the step size must be positive"
        why = "no finite motion, or none that the accuracy allows" if end > self.time else no_size
        why = "an interrupt came within the step before: `restore` goes on" if math.isnan(self.time) else why
        raise SimulationError(f"{self.scene.name}: the step from t = {self.time} s by {length} s was refused: {why}")

    def hold(self, /, **ports: Any) -> None:
        """Set inputs without a step; outputs show them after the next. Raises ValueError for a wrong one; sets none."""
        self._put(ports)

    def _put(self, ports: dict[str, Any]) -> _Before:
        """Set inputs; return their earlier values."""
        before: _Before = []
        data = self._bytes
        try:
            for name, value in ports.items():
                if name in self._scalars:
                    self._put_scalar(before, self._ports[name], value)
                    continue
                if type(value) in _WITHOUT_PLACES:
                    raise TypeError
                x, y, z = value.tolist() if type(value) is np.ndarray else value
                if not math.isfinite(x + y + z):
                    raise ValueError
                place = self._ports[name]
                before.append((_PORT, place, _PORT.unpack_from(data, place)))
                _PORT.pack_into(data, place, x, y, z)
        except (KeyError, TypeError, ValueError, OverflowError, struct.error):
            self._put_back(before)
            raise self._wrong_input(ports) from None
        return before

    def _put_scalar(self, before: _Before, place: int, value: Any) -> None:
        x = _seconds(value)
        if not math.isfinite(x):
            raise ValueError
        before.append((_NUMBER, place, _NUMBER.unpack_from(self._bytes, place)))
        _NUMBER.pack_into(self._bytes, place, x)

    def _put_back(self, before: Iterable[_Input]) -> None:
        for form, place, values in before:
            form.pack_into(self._bytes, place, *values)

    def _wrong_input(self, ports: dict[str, Any]) -> ValueError:
        """Return the error that names the first wrong input."""
        for name, value in ports.items():
            if name not in self._ports:
                known = f"one of {', '.join(self._ports)}" if self._ports else "none: there are no ports"
                return ValueError(f"input {name!r}: expected {known}")
            numbers, own = np.asarray(value, dtype=object), self.scene.inputs.own
            unit = own[name].unit or "1" if name in own else BY_NAME[name].unit
            if size_of(self.scene, name) == 1:
                return ValueError(fault(name, value, f"a finite number ({unit})"))
            if numbers.shape != (3,) or not all(issubclass(type(x), Real) and abs(x) < math.inf for x in numbers):
                shape = f", of shape (3,) and not {numbers.shape}" if numbers.ndim > 1 else ""
                return ValueError(f"{name} = {as_toml(value)}: expected 3 finite numbers ({unit}){shape}")
        return ValueError(f"inputs {as_toml(ports)}: expected numbers whose sum is finite")

    def reset(self, /, **parameters: Any) -> None:
        """Start again with the scene's values and given parameters; inputs are as at first. Raises SceneError."""
        planned, z = _start_with(self.scene, self.plan, parameters)
        if planned is not self.plan:
            self._set_up(self.scene, planned, z)
        self._z[:] = z
        self.time, self._count = self._start, 0
        self._old_reports = self._reports = self._no_reports

    def values(self) -> dict[str, Any]:
        """Return the time and all quantities at this time; `Result.of_rows` makes a result of such rows."""
        own = self.plan.formulas.own_rows if self.plan.formulas else {}
        return Row({"time": self.time} | {name: getattr(self, name) for name in self._quantities}, own)

    def __reduce__(self) -> tuple[Callable[..., "Simulator"], tuple[Scene, Plan, bytes]]:
        """Return a function and arguments that make a copy in the same state, for `pickle` and `copy`."""
        return _in_state, (self.scene, self.plan, self.save())

    def __deepcopy__(self, memo: object) -> "Simulator":
        return _in_state(self.scene, self.plan, self.save())

    def save(self) -> bytes:
        """Return the whole state, for `restore` of this or another simulator of the scene."""
        content = self._clock.pack(self.time, self._count, *self._old_reports, *self._reports) + self._bytes.tobytes()
        return self._identity + _checksum(content) + content

    def restore(self, state: bytes) -> None:
        """Go back to a saved state. Raises ValueError, with nothing changed, if it is no state of the scene.

        Raises TypeError if `state` is not bytes.
        """
        if not isinstance(state, bytes | bytearray | memoryview):
            raise TypeError(fault("state", state, "the bytes that `save` returned"))
        content = state[len(state) - self._clock.size - self._bytes.nbytes :]
        head = self._identity + _checksum(content)  # with damaged numbers a step could end the process
        if state[: -len(content)] != head:
            raise ValueError(f"these {len(state)} bytes are no state of {self.scene.name} under its plan")
        self.time, self._count, *times = self._clock.unpack_from(content)
        self._old_reports, self._reports = tuple(times[: len(self._no_reports)]), tuple(times[len(self._no_reports) :])
        self._bytes[:] = content[self._clock.size :]


def _start_with(scene: Scene, planned: Plan, parameters: dict[str, Any]) -> tuple[Plan, Buffer]:
    """Return the plan, with other kernels if formulas need numbers that are zero in the scene, and the buffer."""
    changed = with_parameters(scene, planned, parameters)
    planned = planned.of_scene(changed)
    return planned, start_run(changed, planned)


def simulator_of(scene: Scene, planned: Plan) -> Simulator:
    """Return a simulator of a plan, without warnings about the scene."""
    simulator = Simulator.__new__(Simulator)
    simulator._set_up(scene, *_start_with(scene, planned, {}))
    return simulator


def _in_state(scene: Scene, planned: Plan, state: bytes) -> Simulator:
    """Return a new simulator in a saved state, without planning again."""
    simulator = simulator_of(scene, planned)
    simulator.restore(state)
    return simulator


def _seconds(h: Any) -> float:
    """Return a step as a Python float, as the time would get the precision of another type."""
    try:
        if isinstance(h, bool | np.bool_):
            raise TypeError
        return math.ldexp(h, 0)  # unlike float(), it refuses text
    except (TypeError, OverflowError):
        raise TypeError(fault("h", h, "a number (s); inputs are given by name")) from None


def _reader(row: Output) -> property:
    """Return the attribute of a quantity."""
    name, is_number = row.name, row.size == 1

    def read(self: Simulator) -> Any:
        try:
            values = self._quantities[name]
        except KeyError:
            raise AttributeError(name) from None  # Python then calls `__getattr__`, which has the message
        return float(values[0]) if is_number else values.copy()

    return property(read, doc=f"{row.meaning}, {row.unit}")


for _row in OUTPUTS:
    setattr(Simulator, _row.name, _reader(_row))


@of_scene_or_path
def compiled_step(scene: Scene, planned: Plan | None = None) -> tuple[Callable[[Array, float], int], Array]:
    """Return the compiled `step(buffer, h) -> status` of a scene and a started buffer, for loops under `@njit`.

    status is 0, or 1 for a step that was refused, with nothing changed. The slices of inputs and quantities in the
    buffer are in `planned.kernels.BLOCKS`, such as `BLOCKS["torque_b"]`. Raises SceneError, ValueError.
    """
    planned = (checked_plan(planned, stepped=True) or plan(scene)).of_scene(scene)
    return planned.kernels.step, start_run(scene, planned)


def _checksum(content: bytes) -> bytes:
    return crc32(content).to_bytes(4, "big")


def _identity(scene: Scene, planned: Plan) -> bytes:
    """Return bytes that identify the states of a scene under a plan."""
    layout = {name: (block.start, block.stop) for name, block in planned.kernels.BLOCKS.items()}
    text = json.dumps([scene.to_dict(), planned.to_dict(), layout], sort_keys=True)
    return b"rbfmu" + hashlib.sha256(text.encode()).digest()
