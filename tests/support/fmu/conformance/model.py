"""What an FMU must answer to any call: by the rules of calls, and by direct calls of the kernels for the motion.

The rules are the product's own table, which test_call_rules.py compares with the standard's.

`native` is what the C layer promises. `python` is what pythonfmu 0.7.0 lets a slave say: an error is fmi2Fatal, and
calls that it answers by itself (status inquiries, what it does not support, null or freed states) are its own.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rbfmu_fmu.description import describe
from rbfmu_fmu.native.headers import slopes_header
from rbfmu_fmu.python.call_rules import CALLS, INITIALIZING, INSTANTIATED, SETTABLE, STEPPING, TERMINATED
from rbfmu_kernels.buffer import OK as STEP_OK, PAST_STOP, STEP_REJECTED
from tests.support.fmu.fmu_importer import DISCARD, ERROR, FATAL, LAST_SUCCESSFUL_TIME, OK, TERMINATED as IS_TERMINATED

REFUSED = {"python": FATAL, "native": ERROR, "fmi3_scalars": ERROR}

IN_C = {"sqrt": math.sqrt, "fabs": abs, "moved": lambda by, x: x if by != 0.0 else 0.0}
"""What the generated C of derivatives calls."""


class Facts:
    """One FMU: its kernels and what the importer can know of it."""

    def __init__(self, scene, plan, kind):
        self.description, self.unit, self.kind = describe(scene, plan), plan.kernels, kind
        self.native, self.refused = kind != "python", REFUSED[kind]
        variables = self.description.variables
        self.reals = len(variables)
        self.status = self.reals + (kind == "fmi3_scalars")  # after the time
        self.offsets = np.array([v.offset for v in variables])
        self.causality = [v.causality for v in variables]
        self.inputs, self.parameters, self.outputs = (
            [r for r, c in enumerate(self.causality) if c == wanted] for wanted in ("input", "parameter", "output")
        )
        self.start = np.array(self.description.start_buffer)
        lines = slopes_header(self.description).splitlines()
        made = (line.split("double ")[-1].strip() for line in lines if line.startswith("    ") and "=" in line)
        self.changes = "\n".join(made)


@dataclass
class Snapshot:
    """All that a saved state holds; of pythonfmu's FMU: the first four."""

    z: np.ndarray
    phase: int = INSTANTIATED
    status: int = STEP_OK
    stale: bool = True
    time: float = 0.0
    stop: float = math.inf
    discarded: bool = False

    def copy(self):
        return replace(self, z=self.z.copy())


class Model:
    """One instance. Calls return (status, result) as the FMU must."""

    def __init__(self, facts):
        self.facts, self.native, self.refused = facts, facts.native, (facts.refused, None)
        self.last, self.ended = math.nan, False  # python: pythonfmu's own
        self.saved = {}  # native: states of this instance by their address
        self.reset()

    def _allowed(self, call):
        return self.now.phase in CALLS[call].phases

    # --- life

    def reset(self):
        self.now = Snapshot(self.facts.start.copy(), time=self.facts.description.scene.run.start)
        return OK, None

    def setup(self, start, stop):
        if not math.isfinite(start):
            return self.refused
        if self.native:
            if not self._allowed("set_up_experiment") or (stop is not None and not stop >= start):
                return self.refused
            self.now.stop = math.inf if stop is None else stop
        self.now.time = start  # python: where the importer stands
        return OK, None

    def enter(self):
        if not self._allowed("enter_initialization"):
            return self.refused
        self.now.phase = INITIALIZING
        return OK, None

    def exit(self):
        if not self._allowed("exit_initialization") or not self._initialized():
            return self.refused
        self.now.phase = STEPPING
        return OK, None

    def terminate(self):
        if self.native and not self._allowed("terminate"):
            return self.refused
        if self.now.phase == STEPPING:
            self._fresh()
        self.now.phase = TERMINATED
        return OK, None

    def _initialized(self):
        z = self.now.z.copy()
        held = [v for v in self.facts.description.variables if v.pinned]
        if any(z[v.offset] != self.facts.start[v.offset] for v in held) or self.facts.unit.initialize(z):
            return False
        self.now.z[:] = z
        self.now.stale = False
        return True

    # --- values

    def get_real(self, references):
        if any(r >= self.facts.reals for r in references):
            return self.refused
        if any(self.facts.causality[r] == "output" for r in references) and not self._fresh():
            return self.refused
        return OK, self.now.z[self.facts.offsets[references]].tolist() if references else []

    def _fresh(self):
        if not self._allowed("get_outputs"):
            return False
        if self.now.stale and self.now.phase == INITIALIZING:
            return self._initialized()
        if self.now.stale and self.now.phase == TERMINATED:
            return False  # nothing was initialised
        if self.now.stale:
            self.facts.unit.outputs(self.now.z)
            self.now.stale = False
        return True

    def set_real(self, references, values):
        known = all(r < self.facts.reals for r in references)
        if not known or not np.isfinite(values).all() or not all(map(self._settable, references)):
            return self.refused
        for r, value in zip(references, values, strict=True):
            self.now.z[self.facts.offsets[r]] = value
        self.now.stale |= bool(references)
        return OK, None

    def _settable(self, reference):
        return self.now.phase in SETTABLE[self.facts.causality[reference]]

    def get_integer(self, references):
        if any(r != self.facts.status for r in references):
            return self.refused
        return OK, [self.now.status] * len(references)

    def no_such(self, references, values):
        """Types without variables, and Integers to set."""
        return self.refused if references else (OK, [] if values is None else None)

    def set_derivatives(self, references, orders, values):
        if not self.native:
            return ERROR, None
        places = self._rates(references, orders, self.facts.inputs)
        if not self._allowed("set_input_derivatives") or places is None or not np.isfinite(values).all():
            return self.refused
        self.now.z[places] = values
        return OK, None

    def get_derivatives(self, references, orders):
        if not self.native:
            return ERROR, None
        places = self._rates(references, orders, self.facts.outputs)
        if places is None or (references and not self._fresh()):
            return self.refused
        if references:
            self.facts.unit.output_rates(self.now.z)
        return OK, self.now.z[places].tolist()

    def directional(self, unknowns, knowns, seed):
        if not self.native:
            return ERROR, None
        sources = [*self.facts.inputs, *(self.facts.parameters if self.now.phase == INITIALIZING else ())]
        among = all(r in self.facts.outputs for r in unknowns) and all(r in sources for r in knowns)
        if not among or not np.isfinite(seed).all() or not self._fresh():
            return self.refused
        change = np.zeros_like(self.now.z)
        for r, x in zip(knowns, seed, strict=True):
            change[self.facts.offsets[r]] += x
        self.facts.unit.feedthrough(self.now.z, change)
        if self.now.phase == INITIALIZING:
            with np.errstate(all="ignore"):  # as the FMU's code, which divides by zero and goes beyond all numbers
                exec(self.facts.changes, {**IN_C, "z": self.now.z, "change": change})
        found = [float(change[self.facts.offsets[r]]) for r in unknowns]
        return (OK, found) if np.isfinite(found).all() else self.refused

    def _rates(self, references, orders, among):
        """Places of derivatives, or None where one of them is not provided."""
        places = []
        for r, order in zip(references, orders, strict=True):
            rates = self.facts.description.variables[r].rates if r in among else ()
            if not 1 <= order <= len(rates):
                return None
            places.append(rates[order - 1])
        return np.array(places, dtype=int)

    # --- steps

    def step(self, time, size):
        now, end = self.now, time + size
        if not self._allowed("do_step"):
            return self.refused
        if self._impossible(time, size):
            return self._not_taken(self.facts.refused if self.native else DISCARD, time)
        z = now.z.copy()
        if self.facts.unit.step(z, size):
            return self._not_taken(DISCARD, time)
        now.z[:], now.time, self.last = z, end, end
        now.status = PAST_STOP if end > self.facts.description.scene.run.last_time else STEP_OK
        now.stale = now.discarded = False
        return OK, None

    def _impossible(self, time, size):
        end = time + size
        if not (size > 0.0 and time < end < math.inf):  # nor one that is too small for the clock
            return True
        clock = 1e-9 * max(size, abs(time), abs(self.now.time))
        late = abs(time - self.now.time) > clock or end > self.now.stop + clock
        return self.native and late

    def _not_taken(self, status, time):
        self.now.status, self.now.discarded = STEP_REJECTED, status == DISCARD
        self.last, self.ended = time, True
        return status, None

    def inquiry(self, kind, wanted):
        if kind == "Real" and wanted == LAST_SUCCESSFUL_TIME:
            return OK, self.now.time if self.native else self.last
        if kind == "Boolean" and wanted == IS_TERMINATED:
            return OK, int(self.now.discarded if self.native else self.ended)
        return (DISCARD if self.native or kind != "Status" else ERROR), None

    # --- saved states

    def restore(self, snapshot):
        if self.native:
            self.now = snapshot.copy()
        else:
            z, phase, status, stale = snapshot.z.copy(), snapshot.phase, snapshot.status, snapshot.stale
            self.now = replace(self.now, z=z, phase=phase, status=status, stale=stale)
        return OK, None
