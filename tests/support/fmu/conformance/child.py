"""Any call of FMI 2.0 or 3.0 with any argument, made in this process for another one: a crash ends this one alone.

Needs the standard library only. Reads pickled (operation, arguments) on stdin, answers (status, result, log) on stdout.
"""

import ctypes as c
import pickle
import sys

from tests.support.fmu.fmu_importer import Instance
from tests.support.fmu.fmu_importer3 import Fmu3, Instance3, imported

TYPES = {"Real": c.c_double, "Integer": c.c_int, "Boolean": c.c_int, "String": c.c_char_p}
NAMES_3 = {
    "fmi2GetReal": "fmi3GetFloat64", "fmi2SetReal": "fmi3SetFloat64", "fmi2GetInteger": "fmi3GetInt32",
    "fmi2SetInteger": "fmi3SetInt32", "fmi2GetRealOutputDerivatives": "fmi3GetOutputDerivatives",
    "fmi2DeSerializeFMUstate": "fmi3DeserializeFMUState", "fmi2CancelStep": "fmi3EnterEventMode",
    "fmi2Instantiate": "fmi3InstantiateCoSimulation", "fmi2SetupExperiment": "times of fmi3EnterInitializationMode",
}  # fmt: skip
"""Functions of FMI 3.0 by those of FMI 2.0, where more than the prefix differs."""
KINDS = {"Status": c.c_int, "Real": c.c_double, "Integer": c.c_int, "Boolean": c.c_int, "String": c.c_char_p}


class Child:
    """Instances and places for states by number."""

    def __init__(self, *folders):
        self.fmus = [imported(folder) for folder in folders]
        self.instances, self.states = {}, {}

    def instantiate(self, number, fmu, name, kind, guid, logging):
        """Whether there is an instance now; guid: None for the right one."""
        self.instances[number] = made = Instance(self.fmus[fmu], name, guid, kind, logging)
        return 0, bool(made.component.value)

    def free(self, number):
        self.instances.pop(number).free()
        return 0, None

    def free_nothing(self, fmu):
        self.fmus[fmu].lib.fmi2FreeInstance(None)
        return 0, None

    def plain(self, number, function):
        """A function of the instance alone; number: None for a null instance."""
        lib, component = self._of(number)
        return getattr(lib, function)(component), None

    def setup(self, number, tolerance, start, stop):
        lib, component = self._of(number)
        given = [(x is not None, c.c_double(x or 0.0)) for x in (tolerance, stop)]
        return lib.fmi2SetupExperiment(component, *given[0], c.c_double(start), *given[1]), None

    def step(self, number, time, size):
        lib, component = self._of(number)
        return lib.fmi2DoStep(component, c.c_double(time), c.c_double(size), 1), None

    def values(self, number, function, references, values, null):
        """A get (values: None) or set; null: 1 for null references, 2 for null values, 3 for both."""
        lib, component = self._of(number)
        kind, n = TYPES[function[7:]], len(references)
        array = (kind * n)(*values) if values is not None else (kind * n)()
        which = None if null & 1 else (c.c_uint * n)(*references)
        status = getattr(lib, function)(component, which, c.c_size_t(n), None if null & 2 else array)
        return status, list(array) if values is None and status == 0 else None

    def derivatives(self, number, function, references, orders, values):
        lib, component = self._of(number)
        n = len(references)
        array = (c.c_double * n)(*(values or [0.0] * n))
        which, of = (c.c_uint * n)(*references), (c.c_int * n)(*orders)
        status = getattr(lib, function)(component, which, c.c_size_t(n), of, array)
        return status, list(array) if values is None and status == 0 else None

    def directional(self, number, unknowns, knowns, seed):
        lib, component = self._of(number)
        n, k, result = len(unknowns), len(knowns), (c.c_double * len(unknowns))()
        which = (c.c_uint * n)(*unknowns), c.c_size_t(n), (c.c_uint * k)(*knowns), c.c_size_t(k)
        status = lib.fmi2GetDirectionalDerivative(component, *which, (c.c_double * k)(*seed), result)
        return status, list(result) if status == 0 else None

    def status(self, number, function, kind):
        lib, component = self._of(number)
        value = KINDS[function[7:-6] or "Status"]()
        status = getattr(lib, function)(component, kind, c.byref(value))
        return status, value.value if status == 0 else None

    def logging(self, number, on, categories):
        lib, component = self._of(number)
        n = len(categories)
        return lib.fmi2SetDebugLogging(component, on, c.c_size_t(n), (c.c_char_p * n)(*categories)), None

    # --- states: places hold pointers, which may be null or point to what is freed

    def get_state(self, number, place):
        lib, component = self._of(number)
        pointer = c.c_void_p(self.states.get(place))
        status = lib.fmi2GetFMUstate(component, c.byref(pointer))
        self.states[place] = pointer.value
        return status, pointer.value

    def set_state(self, number, place):
        lib, component = self._of(number)
        return lib.fmi2SetFMUstate(component, c.c_void_p(self.states.get(place))), None

    def free_state(self, number, place, keep):
        """keep: the place goes on to hold the pointer, as in a careless importer."""
        lib, component = self._of(number)
        pointer = c.c_void_p(self.states.get(place))
        status = lib.fmi2FreeFMUstate(component, c.byref(pointer))
        if not keep and status == 0:
            self.states[place] = None
        return status, pointer.value

    def release(self, number, address):
        """Free a state by its address; number: None where no instance is left to do so."""
        if number is not None:
            lib, component = self._of(number)
            lib.fmi2FreeFMUstate(component, c.byref(c.c_void_p(address)))
        return 0, None

    def clear(self):
        self.states.clear()
        return 0, None

    def size(self, number, place):
        lib, component = self._of(number)
        size = c.c_size_t()
        status = lib.fmi2SerializedFMUstateSize(component, c.c_void_p(self.states.get(place)), c.byref(size))
        return status, size.value

    def serialize(self, number, place, size):
        """What was written of `size` bytes; another one behind them must be left alone."""
        lib, component = self._of(number)
        content = c.create_string_buffer(b"\xaa" * (size + 1), size + 1)
        pointer = c.c_void_p(self.states.get(place))
        status = lib.fmi2SerializeFMUstate(component, pointer, content, c.c_size_t(size))
        assert content.raw[size] == 0xAA
        return status, content.raw[:size]

    def deserialize(self, number, place, content):
        lib, component = self._of(number)
        pointer = c.c_void_p(self.states.get(place))
        status = lib.fmi2DeSerializeFMUstate(component, content, c.c_size_t(len(content)), c.byref(pointer))
        self.states[place] = pointer.value
        return status, pointer.value

    def _of(self, number):
        if number is None:
            return self.fmus[0].lib, None
        return self.instances[number].lib, self.instances[number].component

    def answer(self, operation, *arguments):
        """(status, result, messages logged meanwhile)."""
        status, result = getattr(self, operation)(*arguments)
        messages = [message for instance in self.instances.values() for message in instance.log]
        for instance in self.instances.values():
            instance.log.clear()
        return status, result, messages


class Renamed:
    """A library of FMI 3.0 by the names of FMI 2.0."""

    def __init__(self, lib):
        self.lib = lib

    def __getattr__(self, name):
        return getattr(self.lib, NAMES_3.get(name, name.replace("fmi2", "fmi3").replace("FMUstate", "FMUState")))


class Child3(Child):
    """The same calls of FMUs of FMI 3.0 without arrays; an experiment is set up where initialisation begins."""

    def _of(self, number):
        lib, component = super()._of(number)
        return Renamed(lib), component

    def instantiate(self, number, fmu, name, kind, guid, logging):
        self.instances[number] = made = Instance3(self.fmus[fmu], name, guid, kind, logging)
        return 0, bool(made.component.value)

    def free_nothing(self, fmu):
        self.fmus[fmu].lib.fmi3FreeInstance(None)
        return 0, None

    def setup(self, number, tolerance, start, stop):
        if number is None:
            return self.plain(None, "fmi2EnterInitializationMode")
        return self.instances[number].setup(start, stop), None

    def plain(self, number, function):
        if function != "fmi2EnterInitializationMode":
            return super().plain(number, function)
        if number is not None:
            return self.instances[number].enter(), None
        lib, none = self._of(None)[0], c.c_double(0.0)
        return lib.fmi2EnterInitializationMode(None, c.c_bool(False), none, none, c.c_bool(False), none), None

    def step(self, number, time, size):
        if number is not None:
            return self.instances[number].step(time, size), None
        return self._of(None)[0].fmi2DoStep(None, c.c_double(time), c.c_double(size), True, *[None] * 4), None

    def values(self, number, function, references, values, null):
        lib, component = self._of(number)
        kind, n = c.c_bool if function.endswith("Boolean") else TYPES[function[7:]], len(references)
        array = (kind * n)(*values) if values is not None else (kind * n)()
        which = None if null & 1 else (c.c_uint * n)(*references)
        given = None if null & 2 else array
        status = getattr(lib, function)(component, which, c.c_size_t(n), given, c.c_size_t(n))
        return status, list(array) if values is None and status == 0 else None

    def derivatives(self, number, function, references, orders, values):
        lib, component = self._of(number)
        n, array = len(references), (c.c_double * len(references))()
        which, of = (c.c_uint * n)(*references), (c.c_int * n)(*orders)
        status = getattr(lib, function)(component, which, c.c_size_t(n), of, array, c.c_size_t(n))
        return status, list(array) if status == 0 else None

    def directional(self, number, unknowns, knowns, seed):
        lib, component = self._of(number)
        n, k, result = len(unknowns), len(knowns), (c.c_double * len(unknowns))()
        which = (c.c_uint * n)(*unknowns), c.c_size_t(n), (c.c_uint * k)(*knowns), c.c_size_t(k)
        given = (c.c_double * k)(*seed), c.c_size_t(k), result, c.c_size_t(n)
        status = lib.fmi2GetDirectionalDerivative(component, *which, *given)
        return status, list(result) if status == 0 else None

    def logging(self, number, on, categories):
        lib, component = self._of(number)
        n = len(categories)
        return lib.fmi2SetDebugLogging(component, c.c_bool(on), c.c_size_t(n), (c.c_char_p * n)(*categories)), None


def main(*folders):
    """Serve until stdin ends."""
    child = (Child3 if isinstance(imported(folders[0]), Fmu3) else Child)(*folders)
    stdin, stdout = sys.stdin.buffer, sys.stdout.buffer
    while True:
        try:
            request = pickle.load(stdin)
        except EOFError:
            return
        pickle.dump(child.answer(*request), stdout)
        stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
