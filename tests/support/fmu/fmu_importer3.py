"""The same small importer for FMI 3.0, by the same names: an element of an array has the name of FMI 2.0's variable.

Needs the standard library only, as fmu_importer.py.
"""

import ctypes as c
from pathlib import Path
from xml.etree import ElementTree

from tests.support.fmu.fmu_importer import OK, Fmu, Instance

LOGGER = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)
UPDATE = c.CFUNCTYPE(
    None, c.c_void_p, c.c_double, c.c_bool, c.c_bool, c.c_bool, c.c_bool, c.POINTER(c.c_bool), c.POINTER(c.c_double)
)


class Fmu3(Fmu):
    """An unzipped FMU; `references` and `places` in its array by the name of an element, `sizes` by value reference."""

    def __init__(self, folder):
        self.folder = Path(folder)
        root = ElementTree.parse(self.folder / "modelDescription.xml").getroot()
        self.guid, interface = root.get("instantiationToken"), root.find("CoSimulation")
        identifier = interface.get("modelIdentifier")
        self.lib = c.CDLL(str(self.folder / "binaries" / "x86_64-linux" / f"{identifier}.so"))
        for kind in ("CoSimulation", "ModelExchange", "ScheduledExecution"):
            getattr(self.lib, f"fmi3Instantiate{kind}").restype = c.c_void_p
        self.references, self.places, self.sizes = {}, {}, {}
        self.by_causality = {"parameter": [], "input": [], "output": [], "independent": []}
        for variable in root.find("ModelVariables"):
            reference = int(variable.get("valueReference"))
            elements = element_names(variable.get("name"), [int(d.get("start")) for d in variable.iter("Dimension")])
            self.sizes[reference] = len(elements)
            for name in dict.fromkeys(elements):
                self.references[name] = reference
                self.places[name] = [k for k, other in enumerate(elements) if other == name]
                if variable.tag == "Float64":
                    self.by_causality[variable.get("causality")].append(name)

    def instance(self, name="it", **options):
        return Instance3(self, name, **options)


def imported(folder):
    """An unzipped FMU of either version."""
    root = ElementTree.parse(Path(folder) / "modelDescription.xml").getroot()
    return (Fmu3 if root.get("fmiVersion").startswith("3") else Fmu)(folder)


def element_names(name, dimensions):
    """The names of FMI 2.0; of a symmetric matrix that of the upper triangle stands in both places."""
    if not dimensions:
        return [name]
    if len(dimensions) == 1:
        return [f"{name}[{i}]" for i in range(1, dimensions[0] + 1)]
    n, m = dimensions
    pairs = [sorted((i, j)) for i in range(1, n + 1) for j in range(1, m + 1)]
    return [f"{name}[{i},{j}]" for i, j in pairs]


class Instance3(Instance):
    """Calls return the FMI status; updates: called in intermediate updates, which are about `intermediate`."""

    PREFIX, STATE, DESERIALIZE = "fmi3", "FMUState", "DeserializeFMUState"

    def __init__(self, fmu, name, guid=None, kind=1, logging=1, updates=None, intermediate=(), early=False, events=0):
        self.fmu, self.lib, self.log, self.times, self.tolerance = fmu, fmu.lib, [], (0.0, 0, 0.0), (0, 0.0)
        self._logger = LOGGER(lambda environment, *message: self.log.append(message))
        self._update = UPDATE(updates) if updates else UPDATE()
        first = name and name.encode(), (guid or fmu.guid).encode(), b"", c.c_bool(False), c.c_bool(logging)
        if kind == 1:
            which = sorted({fmu.references.get(one, one) for one in intermediate})
            asked = (c.c_uint * len(which))(*which), c.c_size_t(len(which))
            arguments = c.c_bool(events), c.c_bool(early), *asked, None, self._logger, self._update
            made = self.lib.fmi3InstantiateCoSimulation(*first, *arguments)
        else:
            made = self.lib.fmi3InstantiateModelExchange(*first, None, self._logger)
        self.component = c.c_void_p(made)

    def setup(self, start=0.0, stop=None, tolerance=None):
        """Of FMI 2.0: here a part of `enter`."""
        self.times = start, stop is not None, stop or 0.0
        self.tolerance = tolerance is not None, tolerance or 0.0
        return OK

    def enter(self):
        start, has_stop, stop = self.times
        times = c.c_double(start), c.c_bool(has_stop), c.c_double(stop)
        tolerance = c.c_bool(self.tolerance[0]), c.c_double(self.tolerance[1])
        return self.lib.fmi3EnterInitializationMode(self.component, *tolerance, *times)

    def step(self, time, size):
        """The status; `answer` is what else is said: event, terminate, early return, time reached."""
        said = c.c_bool(True), c.c_bool(True), c.c_bool(True), c.c_double(-1.0)
        times = c.c_double(time), c.c_double(size), c.c_bool(True)
        status = self.lib.fmi3DoStep(self.component, *times, *map(c.byref, said))
        self.answer = tuple(one.value for one in said)
        return status

    def set_debug_logging(self, on, *categories):
        names = (c.c_char_p * len(categories))(*(name.encode() for name in categories))
        return self.lib.fmi3SetDebugLogging(self.component, c.c_bool(on), c.c_size_t(len(categories)), names)

    def _needed(self, names):
        """The value references of some elements, each once."""
        return list(dict.fromkeys(self.fmu.references[name] for name in names))

    def _picked(self, names, references, values):
        """The values of some elements, of those of all elements of these value references."""
        first = dict(zip(references, self._starts(references), strict=True))
        return [values[first[self.fmu.references[name]] + self.fmu.places[name][0]] for name in names]

    def _starts(self, references):
        starts, total = [], 0
        for reference in references:
            starts.append(total)
            total += self.fmu.sizes.get(reference, 1)
        return starts

    def set(self, values):
        """Floats by name, in one call: the other elements of an array keep their values."""
        before = [x for one in self._needed(values) for x in self.get_references([one], quietly=True)[1]]
        return self.set_all(values, before)

    def set_all(self, values, before=None):
        """The same without reading first, which intermediate updates do not allow; other elements become 0."""
        references = self._needed(values)
        start = dict(zip(references, self._starts(references), strict=True))
        complete = before or [0.0] * sum(self.fmu.sizes[r] for r in references)
        for name, value in values.items():
            for k in self.fmu.places[name]:
                complete[start[self.fmu.references[name]] + k] = value
        return self.set_references(references, complete)

    def set_references(self, references, values):
        n, m = len(references), len(values)
        which, what = (c.c_uint * n)(*references), (c.c_double * m)(*values)
        return self.lib.fmi3SetFloat64(self.component, which, c.c_size_t(n), what, c.c_size_t(m))

    def get(self, *names):
        references = self._needed(names)
        status, values = self.get_references(references)
        assert status == OK, self.log
        return self._picked(names, references, values)

    def get_references(self, references, quietly=False):
        n, m = len(references), sum(self.fmu.sizes.get(r, 1) for r in references)
        which, values, said = (c.c_uint * n)(*references), (c.c_double * m)(), len(self.log)
        status = self.lib.fmi3GetFloat64(self.component, which, c.c_size_t(n), values, c.c_size_t(m))
        if quietly:
            del self.log[said:]
        return status, list(values)

    def get_rates(self, *names, order=1):
        references = self._needed(names)
        n, m = len(references), sum(self.fmu.sizes[r] for r in references)
        which, orders, values = (c.c_uint * n)(*references), (c.c_int * n)(*[order] * n), (c.c_double * m)()
        status = self.lib.fmi3GetOutputDerivatives(self.component, which, c.c_size_t(n), orders, values, c.c_size_t(m))
        return status, self._picked(names, references, list(values))

    def derivative(self, unknowns, knowns, seed, adjoint=False):
        """(status, sensitivity) of variables by value reference; a directional or an adjoint derivative."""
        function = self.lib.fmi3GetAdjointDerivative if adjoint else self.lib.fmi3GetDirectionalDerivative
        m = sum(self.fmu.sizes.get(r, 1) for r in (knowns if adjoint else unknowns))
        result, which = (c.c_double * m)(), []
        for references in (unknowns, knowns):
            which += [(c.c_uint * len(references))(*references), c.c_size_t(len(references))]
        given = (c.c_double * len(seed))(*seed), c.c_size_t(len(seed))
        return function(self.component, *which, *given, result, c.c_size_t(m)), list(result)

    def get_integer(self, reference):
        value, one = c.c_int(-1), c.c_size_t(1)
        status = self.lib.fmi3GetInt32(self.component, (c.c_uint * 1)(reference), one, c.byref(value), one)
        return status, value.value

    def last_time(self):
        """The independent variable."""
        return self.get("time")[0]

    def terminated(self):
        """What the last step said."""
        return self.answer[1]
