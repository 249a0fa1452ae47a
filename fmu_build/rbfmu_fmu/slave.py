"""The pythonfmu slave, bundled into every FMU beside its unit. Imports neither rbfmu nor, where it can, Numba.

pythonfmu 0.7.0 reports an exception as fmi2Fatal and a `do_step` that returns False as fmi2Discard with
fmi2Terminated; there is no third way to refuse. Where a comment says "pythonfmu", it names a trap of that version.
"""

import ctypes
import json
import math
import os
import struct
import sys
import threading
import weakref

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

INSTANTIATED, INITIALIZING, STEPPING, TERMINATED = range(4)
PHASES = "before initialisation", "in initialisation", "while stepping", "after termination"
FINE, NOT_REACHED, PAST_STOP = range(3)

_increment = ctypes.pythonapi.Py_IncRef
_increment.argtypes, _increment.restype = [ctypes.py_object], None
_INFINITY = math.inf


class Access:
    """How value references reach the unit's buffer: made once, shared by an FMU's instances."""

    def __init__(self, description, identity):
        self.description = description
        self.identity = identity.encode()
        self.names = [v["name"] for v in description["variables"]]
        self.offsets = [v["offset"] for v in description["variables"]]
        self.causality = [v["causality"] for v in description["variables"]]
        self.inputs = [r for r, c in enumerate(self.causality) if c == "input"]
        self.outputs = [r for r, c in enumerate(self.causality) if c == "output"]
        self.output_pieces = _pieces([self.offsets[r] for r in self.outputs])
        self.start = struct.pack(f"{len(description['start_buffer'])}d", *description["start_buffer"])
        self.last_time = description["stop"] + 1e-9 * max(description["step"], abs(description["stop"]))
        self._entries = None

    def entries(self, resources):
        """The unit's three entry functions on a buffer: compiled ahead of time, else by Numba here and now."""
        if self._entries is None:
            self._entries = _compiled_entries(resources) or _numba_entries(self.description["unit"])
        return self._entries

    def input_struct(self):
        """Packs all inputs at once; bytes between ports belong to loads that are no ports, and stay zero."""
        layout, end = "", None
        for first, stop in _pieces([self.offsets[r] for r in self.inputs]):
            layout += f"{8 * (first - (first if end is None else end))}x{stop - first}d"
            end = stop
        return struct.Struct("=" + layout), 8 * (self.offsets[self.inputs[0]] if self.inputs else 0)


def _pieces(offsets):
    """Runs of consecutive offsets as (first, stop)."""
    pieces = []
    for offset in offsets:
        if pieces and pieces[-1][1] == offset:
            pieces[-1][1] += 1
        else:
            pieces.append([offset, offset + 1])
    return [tuple(p) for p in pieces]


def _compiled_entries(resources):
    """Load the shipped object file for this platform; None where there is none (or no loader for it)."""
    if os.environ.get("RBFMU_COMPILE") == "1":
        return None
    try:
        import llvmlite.binding as llvm

        parts = llvm.get_process_triple().split("-")
        path = os.path.join(resources, __package__, f"unit-{parts[0]}-{parts[2]}.o")
        if not os.path.exists(path):
            return None
        llvm.initialize_native_target() if hasattr(llvm, "initialize_native_target") else None
        llvm.initialize_native_asmprinter()
        target = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine()
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)
        engine.add_object_file(llvm.object_file.ObjectFileRef.from_path(path))
        engine.finalize_object()
    except (ImportError, RuntimeError, OSError, AttributeError) as error:
        print(f"rbfmu: shipped kernels do not load here ({error}); compiling them anew", file=sys.stderr)
        return None
    _KEPT.append(engine)  # owns the code
    pointer = ctypes.c_void_p
    one = ctypes.PYFUNCTYPE(ctypes.c_int64, pointer)
    step = ctypes.PYFUNCTYPE(ctypes.c_int64, pointer, ctypes.c_double)
    address = engine.get_function_address
    return one(address("initialize")), step(address("step")), one(address("outputs")), False


_KEPT = []
_LIVE = weakref.WeakSet()


def _numba_entries(unit):
    import importlib

    module = importlib.import_module(f".{unit}", __package__)
    return module.initialize, module.step, module.outputs, True


class Slave(Fmi2Slave):
    """One instance. All its memory is `_buffer`, its phase and its status: what a saved state holds."""

    access = None  # set by the FMU's script

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        access = self.access
        self.modelName = access.description["identifier"]
        resources = kwargs["resources"]
        while sys.path.count(resources) > 1:  # pythonfmu adds it once more for each instance
            sys.path.remove(resources)
        self._buffer = ctypes.create_string_buffer(access.start, len(access.start))
        self._z = memoryview(self._buffer).cast("B").cast("d")
        self._output_views = [self._z[first:stop] for first, stop in access.output_pieces]
        self._inputs, self._outputs = access.inputs, access.outputs
        inputs, self._first_input = access.input_struct()
        self._pack_inputs = inputs.pack_into
        self._phase, self._status, self._stale = INSTANTIATED, FINE, False
        self._gil = None
        _LIVE.add(self)
        if self.instance_name != "dummyInstance":
            try:
                self._bind(*access.entries(resources))
            except BaseException as error:
                print(f"[{self.instance_name}] cannot start: {error!r}", file=sys.stderr, flush=True)
                raise

    def _bind(self, initialize, step, outputs, wants_array):
        if wants_array:
            import numpy

            z = numpy.frombuffer(self._buffer)
        else:
            z = ctypes.addressof(self._buffer)
        self._initialize, self._outputs_of, self._step_by = initialize, outputs, step
        self._where = z

    # --- values

    def get_real(self, references):
        """All outputs at once take a short way; outputs follow inputs set since the step."""
        try:
            if self._stale:
                self._refresh()
            if references == self._outputs:
                values = []
                for view in self._output_views:
                    values += view.tolist()
                return values
            self._known(references)
            offsets = self.access.offsets
            return [self._z[offsets[r]] for r in references]
        except BaseException as error:
            raise self._survivable("fmi2GetReal", error) from None

    def set_real(self, references, values):
        """Inputs at any time, parameters and initial values before the end of initialisation; finite only."""
        try:
            if not math.isfinite(sum(values)):
                self._refuse_not_finite(references, values)
            if references == self._inputs and self._phase != TERMINATED:
                self._pack_inputs(self._buffer, self._first_input, *values)
            else:
                self._known(references)
                for r in references:
                    self._settable(r)
                for r, value in zip(references, values):
                    self._z[self.access.offsets[r]] = value
            self._stale = self._phase != INSTANTIATED
        except BaseException as error:
            raise self._survivable("fmi2SetReal", error) from None

    def get_integer(self, references):
        """`status` is the one Integer."""
        try:
            for r in references:
                if r != len(self.access.offsets):
                    raise ValueError(f"value reference {r} is no Integer variable")
            return [self._status] * len(references)
        except BaseException as error:
            raise self._survivable("fmi2GetInteger", error) from None

    def set_integer(self, references, values):
        """There is no Integer to set."""
        self._none_of("Integer variable that can be set", "fmi2SetInteger", references)

    def get_boolean(self, references):
        """There is none."""
        return self._none_of("Boolean variable", "fmi2GetBoolean", references)

    def set_boolean(self, references, values):
        """There is none."""
        self._none_of("Boolean variable", "fmi2SetBoolean", references)

    def get_string(self, references):
        """There is none."""
        return self._none_of("String variable", "fmi2GetString", references)

    def set_string(self, references, values):
        """There is none."""
        self._none_of("String variable", "fmi2SetString", references)

    def _none_of(self, kind, call, references):
        if references:
            raise self._survivable(call, ValueError(f"value reference {references[0]} is no {kind}"))
        return []

    def _known(self, references):
        if references and not (min(references) >= 0 and max(references) < len(self.access.offsets)):
            wrong = next(r for r in references if not 0 <= r < len(self.access.offsets))
            raise ValueError(f"value reference {wrong} is no Real variable")

    def _settable(self, reference):
        causality = self.access.causality[reference]
        if causality == "output" or self._phase == TERMINATED or (causality == "parameter" and self._phase == STEPPING):
            raise ValueError(f"{causality} {self.access.names[reference]} cannot be set {PHASES[self._phase]}")

    def _refuse_not_finite(self, references, values):
        self._known(references)
        for r, value in zip(references, values):
            if not math.isfinite(value):
                raise ValueError(f"{self.access.names[r]} = {value!r}: expected a finite number")

    def _refresh(self):
        if self._phase == INITIALIZING:
            self._initialize_or_refuse()
        else:
            self._outputs_of(self._where)
        self._stale = False

    # --- life

    def setup_experiment(self, start_time, stop_time, tolerance):
        """Times are the importer's; the accuracy is the scene's."""

    def enter_initialization_mode(self):
        """Parameters and inputs can still be set."""
        if self._phase != INSTANTIATED:
            error = RuntimeError(f"initialisation cannot begin {PHASES[self._phase]}")
            raise self._survivable("fmi2EnterInitializationMode", error)
        self._phase, self._stale = INITIALIZING, True

    def exit_initialization_mode(self):
        """Check every parameter, set the state and the first outputs."""
        try:
            if self._phase != INITIALIZING:
                raise RuntimeError(f"initialisation cannot end {PHASES[self._phase]}")
            self._initialize_or_refuse()
            self._phase, self._stale = STEPPING, False
            self._hold_gil()
        except BaseException as error:
            raise self._survivable("fmi2ExitInitializationMode", error) from None

    def _initialize_or_refuse(self):
        fault = self._initialize(self._where)
        if fault:
            block, expected = self.access.description["faults"][str(fault)]
            variables = self.access.description["variables"]
            found = [(v["name"], self._z[v["offset"]]) for v in variables if v["block"] == block]
            values = ", ".join(f"{name} = {value!r}" for name, value in found)
            raise ValueError(f"{values or block}: {expected}")

    def do_step(self, current_time, step_size):
        """All of a step or, with False (fmi2Discard), nothing of it."""
        try:
            if self._phase != STEPPING:
                raise RuntimeError(f"no step can be taken {PHASES[self._phase]}")
            if not 0.0 < step_size < _INFINITY:
                return self._discard(current_time, step_size, "the step size must be positive and finite")
            if self._step_by(self._where, step_size):
                return self._discard(current_time, step_size, "the motion leaves the range of numbers")
            self._stale = False
            self._status = PAST_STOP if current_time + step_size > self.access.last_time else FINE
            return True
        except BaseException as error:
            raise self._survivable("fmi2DoStep", error) from None

    def _discard(self, current_time, step_size, reason):
        self._status = NOT_REACHED
        text = f"step from t = {current_time!r} by {step_size!r} s refused: {reason}"
        self._tell(text, Fmi2Status.discard)
        return False

    def terminate(self):
        """No more steps; values can still be read."""
        self._phase = TERMINATED
        self._release_gil()

    def _survivable(self, call, error):
        """Log an error and keep alive what pythonfmu will release twice: after an exception, and when freed."""
        self._tell(f"{call}: {error}", Fmi2Status.fatal)
        _increment(type(self))
        _increment(self)
        _increment(self.log_queue)
        return error

    def _tell(self, text, status):
        self.log(text, status)  # with a category: pythonfmu passes none as NULL, which aborts some importers
        print(f"[{self.instance_name}] {text}", file=sys.stderr, flush=True)  # FMPy shows logs when debugging only

    # --- a host without Python: pythonfmu makes and destroys a thread state in each call (15 us)

    def _hold_gil(self):
        if os.environ.get("RBFMU_HOLD_GIL") == "1" and self._gil is None:
            ctypes.pythonapi.PyGILState_Ensure()
            self._gil = threading.get_ident()

    def _release_gil(self):
        if self._gil is not None and self._gil == threading.get_ident():
            self._gil = None
            ctypes.pythonapi.PyGILState_Release(ctypes.c_int(0))

    __del__ = _release_gil

    # --- saved states: identity of the FMU, phase, status, stale, buffer

    def _get_fmu_state(self):
        return self.access.identity + bytes([self._phase, self._status, self._stale]) + self._buffer.raw

    def _set_fmu_state(self, state):
        try:
            self._fmu_state_from_bytes(state)
            head = len(self.access.identity)
            self._phase, self._status, stale = state[head : head + 3]
            self._stale = bool(stale)
            memoryview(self._buffer).cast("B")[:] = state[head + 3 :]
        except BaseException as error:
            raise self._survivable("fmi2SetFMUstate", error) from None

    @classmethod
    def _fmu_state_from_bytes(cls, data):
        identity = cls.access.identity
        phase, status, stale = (*data[len(identity) : len(identity) + 3], 9, 9, 9)[:3]
        size = len(identity) + 3 + len(cls.access.start)
        if (
            len(data) == size
            and data.startswith(identity)
            and phase <= TERMINATED
            and status <= PAST_STOP
            and stale <= 1
        ):
            return data
        for instance in _LIVE:  # pythonfmu calls the class, and releases an instance that is not named here
            _increment(instance)
            _increment(instance.log_queue)
        _increment(cls)
        text = f"these {len(data)} bytes are no state of this FMU"
        print(f"rbfmu: {text}", file=sys.stderr, flush=True)
        raise ValueError(text)

    @staticmethod
    def _fmu_state_to_bytes(state):
        return state


def load_description(path):
    """The description that the builder wrote."""
    with open(path, encoding="utf-8") as file:
        return json.load(file)
