"""A small FMI 2.0 importer on ctypes: raw statuses, log messages with their categories.

Needs the standard library only: cases that may crash run it in a process of their own (see fmu_cases.py).
"""

import ctypes as c
import sys
from pathlib import Path
from xml.etree import ElementTree

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
LAST_SUCCESSFUL_TIME, TERMINATED = 2, 3

_LOGGER = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
_ALLOCATE = c.CFUNCTYPE(c.c_void_p, c.c_size_t, c.c_size_t)
_FREE = c.CFUNCTYPE(None, c.c_void_p)


class _Callbacks(c.Structure):
    _fields_ = [
        ("logger", _LOGGER), ("allocate", _ALLOCATE), ("free", _FREE), ("finished", c.c_void_p),
        ("environment", c.c_void_p),
    ]  # fmt: skip


class Fmu:
    """An unzipped FMU: its library, and the value references of its variables by causality and name."""

    def __init__(self, folder):
        self.folder = Path(folder)
        root = ElementTree.parse(self.folder / "modelDescription.xml").getroot()
        self.guid, interface = root.get("guid"), root.find("CoSimulation")
        identifier = interface.get("modelIdentifier")
        self.lib = c.CDLL(str(self.folder / "binaries" / "linux64" / f"{identifier}.so"))
        self.lib.fmi2Instantiate.restype = c.c_void_p
        self.references, self.by_causality = {}, {"parameter": [], "input": [], "output": []}
        for variable in root.find("ModelVariables"):
            name, reference = variable.get("name"), int(variable.get("valueReference"))
            self.references[name] = reference
            if variable.find("Real") is not None:
                self.by_causality[variable.get("causality")].append(name)

    def instance(self, name="it", **options):
        return Instance(self, name, **options)

    def started(self, values=(), name="it"):
        """An instance ready to step."""
        instance = self.instance(name)
        instance.start(values)
        return instance


class Memory:
    """What an FMU takes through the importer's callbacks: `sizes` by address; nothing above `most` bytes in all."""

    def __init__(self, most=1 << 30):
        self.sizes, self.most, self._kept = {}, most, {}
        self.functions = _ALLOCATE(self._allocate), _FREE(self._free)

    def _allocate(self, count, size):
        if sum(self.sizes.values()) + count * size > self.most:
            return None
        block = c.create_string_buffer(b"\xff" * (count * size), count * size)  # not zero: nobody may rely on it
        self._kept[c.addressof(block)] = block
        self.sizes[c.addressof(block)] = count * size
        return c.addressof(block)

    def _free(self, address):
        del self.sizes[address], self._kept[address]


class Instance:
    """Calls return the FMI status unless they say what else; `log` collects (status, category, message).

    guid, kind (1: co-simulation), logging: arguments of fmi2Instantiate; memory: a `Memory`, else none is offered.
    """

    PREFIX, STATE, DESERIALIZE = "fmi2", "FMUstate", "DeSerializeFMUstate"

    def __init__(self, fmu, name, guid=None, kind=1, logging=1, memory=None):
        self.fmu, self.lib, self.log = fmu, fmu.lib, []
        self._logger = _LOGGER(self._keep)
        self.memory = memory
        self._callbacks = _Callbacks(self._logger, *(self.memory.functions if self.memory else ()))
        uri = (fmu.folder / "resources").as_uri()
        arguments = (guid or fmu.guid).encode(), uri.encode(), c.byref(self._callbacks)
        self.component = c.c_void_p(self.lib.fmi2Instantiate(name and name.encode(), kind, *arguments, 0, logging))

    def _keep(self, environment, who, *message):
        c.pythonapi.PyErr_Clear()  # of a slave of pythonfmu's: Python 3.14 tells of it where a callback returns
        self.log.append(message)

    def function(self, name):
        """The library's function, in the version's spelling."""
        return getattr(self.lib, f"{self.PREFIX}{name}")

    def setup(self, start=0.0, stop=None, tolerance=None):
        times = c.c_double(start), int(stop is not None), c.c_double(stop or 0.0)
        return self.lib.fmi2SetupExperiment(
            self.component, int(tolerance is not None), c.c_double(tolerance or 0.0), *times
        )

    def enter(self):
        return self.lib.fmi2EnterInitializationMode(self.component)

    def exit(self):
        return self.function("ExitInitializationMode")(self.component)

    def start(self, values=()):
        assert self.component.value
        assert self.setup() == OK
        assert self.enter() == OK
        assert not values or self.set(values) == OK
        assert self.exit() == OK, self.log

    def terminate(self):
        return self.function("Terminate")(self.component)

    def reset(self):
        return self.function("Reset")(self.component)

    def free(self):
        self.function("FreeInstance")(self.component)

    def step(self, time, size):
        return self.lib.fmi2DoStep(self.component, c.c_double(time), c.c_double(size), 1)

    def steps(self, count, size=0.01, first=0):
        """Outputs after each of some steps, which must all be fine."""
        rows = []
        for k in range(first, first + count):
            assert self.step(k * size, size) == OK
            rows.append(self.outputs())
        return rows

    def set_debug_logging(self, on, *categories):
        names = (c.c_char_p * len(categories))(*(name.encode() for name in categories))
        return self.lib.fmi2SetDebugLogging(self.component, on, c.c_size_t(len(categories)), names)

    def set(self, values):
        """Reals by name, in one call."""
        return self.set_references([self.fmu.references[name] for name in values], list(values.values()))

    def set_references(self, references, values):
        n = len(references)
        which, what = (c.c_uint * n)(*references), (c.c_double * n)(*values)
        return self.lib.fmi2SetReal(self.component, which, c.c_size_t(n), what)

    def get(self, *names):
        """Values of Reals by name."""
        status, values = self.get_references([self.fmu.references[name] for name in names])
        assert status == OK, self.log
        return values

    def get_references(self, references):
        """(status, values)."""
        n, values = len(references), (c.c_double * len(references))()
        status = self.lib.fmi2GetReal(self.component, (c.c_uint * n)(*references), c.c_size_t(n), values)
        return status, list(values)

    def set_rates(self, values, order=1):
        """Derivatives of inputs by name, all of one order."""
        n = len(values)
        which = (c.c_uint * n)(*(self.fmu.references[name] for name in values))
        what = (c.c_int * n)(*[order] * n), (c.c_double * n)(*values.values())
        return self.lib.fmi2SetRealInputDerivatives(self.component, which, c.c_size_t(n), *what)

    def get_rates(self, *names, order=1):
        """(status, derivatives of outputs)."""
        n, values = len(names), (c.c_double * len(names))()
        which = (c.c_uint * n)(*(self.fmu.references[name] for name in names))
        orders = (c.c_int * n)(*[order] * n)
        status = self.lib.fmi2GetRealOutputDerivatives(self.component, which, c.c_size_t(n), orders, values)
        return status, list(values)

    def derivative(self, unknowns, knowns, seed):
        """(status, sensitivity) of variables by value reference."""
        n, k, result = len(unknowns), len(knowns), (c.c_double * len(unknowns))()
        which = (c.c_uint * n)(*unknowns), c.c_size_t(n), (c.c_uint * k)(*knowns), c.c_size_t(k)
        given = (c.c_double * len(seed))(*seed)
        return self.lib.fmi2GetDirectionalDerivative(self.component, *which, given, result), list(result)

    def outputs(self):
        return self.get(*self.fmu.by_causality["output"])

    def status(self):
        """The Integer output `status`."""
        code, value = self.get_integer(self.fmu.references["status"])
        assert code == OK
        return value

    def get_integer(self, reference):
        """(status, value)."""
        value = c.c_int(-1)
        status = self.lib.fmi2GetInteger(self.component, (c.c_uint * 1)(reference), c.c_size_t(1), c.byref(value))
        return status, value.value

    def last_time(self):
        """fmi2LastSuccessfulTime."""
        value = c.c_double()
        assert self.lib.fmi2GetRealStatus(self.component, LAST_SUCCESSFUL_TIME, c.byref(value)) == OK
        return value.value

    def terminated(self):
        """fmi2Terminated."""
        value = c.c_int()
        assert self.lib.fmi2GetBooleanStatus(self.component, TERMINATED, c.byref(value)) == OK
        return bool(value.value)

    def state(self):
        """An FMU state."""
        code, state = self.new_state()
        assert code == OK
        return state

    def new_state(self):
        """(status, state)."""
        state = c.c_void_p()
        return self.function(f"Get{self.STATE}")(self.component, c.byref(state)), state

    def state_into(self, state):
        """What becomes of a state's pointer where the state is to be overwritten."""
        given = c.c_void_p(state.value)
        assert self.function(f"Get{self.STATE}")(self.component, c.byref(given)) == OK
        return given

    def restore(self, state):
        return self.function(f"Set{self.STATE}")(self.component, state)

    def free_state(self, state):
        return self.function(f"Free{self.STATE}")(self.component, c.byref(c.c_void_p(state.value)))

    def serialized(self, state):
        """The state's bytes."""
        size = c.c_size_t()
        assert self.function(f"Serialized{self.STATE}Size")(self.component, state, c.byref(size)) == OK
        content = c.create_string_buffer(size.value)
        assert self.function(f"Serialize{self.STATE}")(self.component, state, content, size) == OK
        return content.raw

    def deserialized(self, content):
        """(status, state)."""
        state = c.c_void_p()
        size = c.c_size_t(len(content))
        status = self.function(self.DESERIALIZE)(self.component, content, size, c.byref(state))
        return status, state


def without(*modules):
    """Make modules impossible to import in this process."""
    for name in modules:
        assert name not in sys.modules
        sys.modules[name] = None
