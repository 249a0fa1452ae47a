"""The pythonfmu slave, which is bundled into every pythonfmu FMU together with its model.

It uses pythonfmu's interface; what depends on pythonfmu's internals is in `pythonfmu_traps`.
"""

import ctypes
import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from . import pythonfmu_traps as traps
from .call_rules import CALLS, INITIALIZING, INSTANTIATED, SETTABLE, STEPPING, TERMINATED, refusal, set_refusal
from .slave_access import HELD, TO_VARY, Access, Entries, tell

OK, STEP_REJECTED, PAST_STOP = range(3)

_INFINITY = math.inf
_MAY_STEP, _MAY_SET_INPUTS = CALLS["do_step"].phases, SETTABLE["input"]
_LIVE: "weakref.WeakValueDictionary[type, Slave]" = weakref.WeakValueDictionary()
"""The instances by their classes; the FMU's script makes a class for each."""


class Slave(Fmi2Slave):  # type: ignore[misc]
    """One instance. A saved state has all its memory: `_buffer`, phase, status, and whether outputs are stale."""

    access: Access  # set by the FMU's script

    def __init__(self, **kwargs: Any) -> None:
        self._gil = traps.HeldGil()
        super().__init__(**kwargs)
        access = self.access
        self.modelName = access.description["identifier"]
        self._buffer = ctypes.create_string_buffer(access.start, len(access.start))
        self._z = memoryview(self._buffer).cast("B").cast("d")
        self._inputs, self._outputs = access.inputs, access.outputs
        inputs, self._first_input = access.input_struct
        outputs, self._first_output = access.output_struct
        self._pack_inputs, self._unpack_outputs = inputs.pack_into, outputs.unpack_from
        self._phase, self._status, self._stale = INSTANTIATED, OK, True
        _LIVE[type(self)] = self
        self._logger = kwargs["logger"]
        traps.forget_resources(kwargs["resources"])
        traps.release_at_exit(self._logger)
        traps.drop_messages_without_category(self._logger, self.instance_name)
        try:
            self._bind(access.entries())
        except BaseException as error:
            tell(f"[{self.instance_name}] cannot start: {error!r}")
            raise

    def _bind(self, entries: Entries) -> None:
        self._where: object = ctypes.addressof(self._buffer)
        if entries.on_array:
            import numpy

            self._where = numpy.frombuffer(memoryview(self._buffer))
        self._initialize, self._step_by, self._outputs_of = entries.initialize, entries.step, entries.outputs

    # --- values

    def get_real(self, references: list[int]) -> list[float]:
        """Return values; outputs account for inputs set after the last step. Reading all outputs at once is fastest."""
        try:
            if references == self._outputs:
                if self._stale:
                    self._refresh()
                return [*self._unpack_outputs(self._buffer, self._first_output)]
            self._known(references)
            if self._stale and not self.access.settable.issuperset(references):
                self._refresh()
            offsets = self.access.offsets
            return [self._z[offsets[r]] for r in references]
        except BaseException as error:
            raise self._survivable("fmi2GetReal", error) from None

    def set_real(self, references: list[int], values: list[float]) -> None:
        """Set variables to finite values; if one of them may not be set in this phase, set none and raise."""
        try:
            if not math.isfinite(sum(values)):
                self._refuse_not_finite(references, values)
            if references == self._inputs and self._phase in _MAY_SET_INPUTS:
                self._pack_inputs(self._buffer, self._first_input, *values)
            else:
                self._known(references)
                for r in references:
                    self._settable(r)
                for r, value in zip(references, values, strict=True):
                    self._z[self.access.offsets[r]] = value
            self._stale = self._stale or bool(references)
        except BaseException as error:
            raise self._survivable("fmi2SetReal", error) from None

    def get_integer(self, references: list[int]) -> list[int]:
        """Return the values of Integer variables: `status`, and the counts of events."""
        try:
            status, counts = len(self.access.offsets), self.access.counts
            for r in references:
                if not status <= r <= status + len(counts):
                    raise ValueError(f"{self.access.name_of(traps.reference_given(r))} is no Integer variable")
            return [self._status if r == status else int(self._z[counts[r - status - 1]]) for r in references]
        except BaseException as error:
            raise self._survivable("fmi2GetInteger", error) from None

    def _known(self, references: list[int]) -> None:
        if references and not (min(references) >= 0 and max(references) < len(self.access.offsets)):
            wrong = next(r for r in references if not 0 <= r < len(self.access.offsets))
            raise ValueError(f"{self.access.name_of(traps.reference_given(wrong))} is no Real variable")

    def _settable(self, reference: int) -> None:
        causality = self.access.causality[reference]
        if self._phase not in SETTABLE[causality]:
            raise ValueError(set_refusal(causality, self.access.names[reference], self._phase))

    def _refuse_not_finite(self, references: list[int], values: list[float]) -> None:
        self._known(references)
        for r, value in zip(references, values, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"{self.access.names[r]} = {value!r}: expected a finite number")

    def _refresh(self) -> None:
        self._allow("get_outputs")
        if self._phase == INITIALIZING:
            self._initialize_or_refuse()
        elif self._phase == TERMINATED:
            raise RuntimeError("outputs have no values: initialisation has not ended, or inputs give no finite ones")
        elif self._outputs_of(self._where):
            raise ValueError("with these inputs an output is not finite")
        self._stale = False

    # --- life: `setup_experiment` and `terminate` are harmless in any phase, and to refuse them would be fmi2Fatal

    def _allow(self, call: str) -> None:
        if self._phase not in CALLS[call].phases:
            raise RuntimeError(refusal(call, self._phase))

    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """Set the start time, if the model has one. A tolerance only causes a warning: the scene gives the accuracy."""
        if not math.isfinite(start_time):
            error = ValueError(f"start time = {start_time!r}: expected a finite number")
            raise self._survivable("fmi2SetupExperiment", error)
        if (place := self.access.description["start_place"]) >= 0 and self._phase in SETTABLE["parameter"]:
            self._z[place] = start_time
        if tolerance not in (None, self.access.accuracy):
            text = f"tolerance = {tolerance!r} has no effect: the accuracy is the scene's, {self.access.accuracy!r}"
            self._tell(f"fmi2SetupExperiment: {text}", Fmi2Status.warning)

    def enter_initialization_mode(self) -> None:
        """Begin initialisation, during which parameters and inputs can still be set."""
        try:
            self._allow("enter_initialization")
            self._phase = INITIALIZING
        except BaseException as error:
            raise self._survivable("fmi2EnterInitializationMode", error) from None

    def exit_initialization_mode(self) -> None:
        """Check every parameter, and set the state and the first outputs."""
        try:
            self._allow("exit_initialization")
            self._initialize_or_refuse()
            self._phase, self._stale = STEPPING, False
            self._gil.hold()
        except BaseException as error:
            raise self._survivable("fmi2ExitInitializationMode", error) from None

    def _initialize_or_refuse(self) -> None:
        for name, offset, planned, block in self.access.pinned:
            if self._z[offset] != planned:
                raise ValueError(HELD % (name, self._z[offset], planned, block))
        fault = self._initialize(self._where)
        if fault:
            raise ValueError(self._said_of(*self.access.description["faults"][str(fault)]))

    def _said_of(self, block: str, expected: str) -> str:
        """Return a fault in words, with the values of its block, or of the changed parameters if that is CHANGED."""
        variables, changed = self.access.description["variables"], self.access.description["changed"]
        found = [v for v in variables if v["block"] == block]
        if block == changed:
            parameters = (v for v in variables if v["causality"] == "parameter")
            found = [v for v in parameters if self._z[v["offset"]] != v["start"]]
        if block == changed and found:
            expected += "; " + TO_VARY % '", "'.join(dict.fromkeys(v["block"] for v in found))
        values = ", ".join(f"{v['name']} = {self._z[v['offset']]!r}" for v in found)
        return f"{values or block.strip(changed) or 'parameters'}: {expected}"

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Take a step and return True; or return False (fmi2Discard), with nothing changed but `status`."""
        try:
            if self._phase not in _MAY_STEP:  # faster than _allow
                raise RuntimeError(refusal("do_step", self._phase))
            end = current_time + step_size
            if not (step_size > 0.0 and -_INFINITY < end < _INFINITY):
                return self._discard(current_time, step_size, "the step size must be positive, and all times finite")
            if not end > current_time:
                return self._discard(current_time, step_size, "the step is too small for this time")
            if self._step_by(self._where, step_size):
                return self._discard(current_time, step_size, "no finite motion, or none that the accuracy allows")
            self._stale = False
            self._status = PAST_STOP if end > self.access.last_time else OK
            return True
        except BaseException as error:
            raise self._survivable("fmi2DoStep", error) from None

    def _discard(self, current_time: float, step_size: float, reason: str) -> bool:
        self._status = STEP_REJECTED
        self._tell(f"step from t = {current_time!r} by {step_size!r} s refused: {reason}", Fmi2Status.discard)
        return False

    def terminate(self) -> None:
        """End stepping; values can still be read, and those of outputs if initialisation had ended.

        If outputs are not finite, only reading them is refused. An exception here would be fmi2Fatal, which later ends
        the process.
        """
        if self._stale and self._phase == STEPPING:
            self._stale = bool(self._outputs_of(self._where))
        self._phase = TERMINATED
        self._gil.release()

    def _survivable(self, call: str, error: BaseException) -> BaseException:
        """Log an error that is about to be raised, prepare the library for it, and return it."""
        traps.keep_after_exception(self)
        traps.drop_messages_without_category(self._logger, self.instance_name)
        self._tell(f"{call}: {error}", Fmi2Status.fatal)
        return error

    def _tell(self, text: str, status: Fmi2Status) -> None:
        self.log(text, status)  # the status gives a category; without it NULL is passed, which ends some importers
        tell(f"[{self.instance_name}] {text}")  # FMPy shows logs only when debugging

    def __del__(self) -> None:
        self._gil.release()

    # --- saved states

    def _get_fmu_state(self) -> bytes:
        content = bytes([self._phase, self._status, self._stale]) + self._buffer.raw
        return self.access.state_head(content) + content

    def _set_fmu_state(self, state: bytes) -> None:
        try:
            content = self.access.state_content(state)
            self._phase, self._status, stale = content[:3]
            self._stale = bool(stale)
            memoryview(self._buffer).cast("B")[:] = content[3:]
        except BaseException as error:
            raise self._survivable("fmi2SetFMUstate", error) from None

    @classmethod
    def _fmu_state_from_bytes(cls, data: bytes) -> bytes:
        try:
            cls.access.state_content(data)
        except ValueError as error:
            raise _LIVE[cls]._survivable("fmi2DeSerializeFMUstate", error) from None
        return data

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state


def _refusal_of(call: str, kind: str) -> Callable[..., list[object]]:
    def refuse(self: Slave, references: list[int], values: Sequence[object] = ()) -> list[object]:
        """Refuse any value reference: no variable has this type, or none of this type can be set."""
        if references:
            name = self.access.name_of(traps.reference_given(references[0]))
            raise self._survivable(call, ValueError(f"{name} is no {kind}"))
        return []

    return refuse


Slave.set_integer = _refusal_of("fmi2SetInteger", "Integer variable that can be set")
for _kind in ("Boolean", "String"):
    for _way in ("Get", "Set"):
        setattr(Slave, f"{_way}_{_kind}".lower(), _refusal_of(f"fmi2{_way}{_kind}", f"{_kind} variable"))
