"""A stateful test of FMI 2.0's calls: rules make them, right and wrong, and compare the answers with the model's."""

import math

from hypothesis import strategies as st
from hypothesis.stateful import initialize, precondition, rule

from rbfmu_fmu.python.call_rules import INSTANTIATED, STEPPING
from tests.support.fmu.conformance.calls import INQUIRIES, some, some_live
from tests.support.fmu.conformance.model import Model
from tests.support.fmu.conformance.states import SavedStates
from tests.support.fmu.fmu_importer import ERROR, OK

OTHER_TYPES = [f"fmi2{verb}{kind}" for kind in ("Integer", "Boolean", "String") for verb in ("Get", "Set")]
SET_RATES, GET_RATES = "fmi2SetRealInputDerivatives", "fmi2GetRealOutputDerivatives"
PLAIN = {
    "fmi2EnterInitializationMode": "enter", "fmi2ExitInitializationMode": "exit", "fmi2Terminate": "terminate",
    "fmi2Reset": "reset",
}  # fmt: skip
"""Functions of an instance alone, and what they are in the model."""
CATEGORIES = [b"logStatusDiscard", b"logStatusError", b"logAll"]
NO_INSTANCE = [
    *[(function, "plain", function) for function in PLAIN],
    ("fmi2SetupExperiment", "setup", None, 0.0, None),
    ("fmi2DoStep", "step", 0.0, 0.1),
    ("fmi2GetReal", "values", "fmi2GetReal", [0], None, 0),
    ("fmi2SetReal", "values", "fmi2SetReal", [0], [1.0], 0),
    ("fmi2GetDirectionalDerivative", "directional", [0], [0], [1.0]),
    ("fmi2SetDebugLogging", "logging", True, []),
    ("fmi2GetRealStatus", "status", "fmi2GetRealStatus", 2),
    ("fmi2GetFMUstate", "get_state", 9),
    ("fmi2SetFMUstate", "set_state", 9),
    ("fmi2FreeFMUstate", "free_state", 9, False),
    ("fmi2SerializedFMUstateSize", "size", 9),
    ("fmi2SerializeFMUstate", "serialize", 9, 99),
    ("fmi2DeSerializeFMUstate", "deserialize", 9, b"x"),
]
"""(function, operation, arguments)."""

nice = st.floats(-10.0, 10.0)
odd = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 0.0, -0.0, 5e-324, -1.0])
numbers = st.one_of(nice, nice, nice, odd)
sizes = st.floats(1e-3, 0.1)
odd_sizes = st.sampled_from([0.0, -0.0, -0.01, math.nan, math.inf, -math.inf, 1e300, 5e-324, 1e-12])
fmus = st.sampled_from([0, 0, 1])
starts = st.sampled_from([0.0, 0.0, 0.0, 99.9, -7.0])
"""The scenes' runs end at 100 s: then `status` is 2."""
references = st.one_of(st.integers(0, 70), st.sampled_from([-1, -2, -3, 2**31 - 1, 2**31, 2**32 - 1, 10**6]))
"""Negative: counted from one past the variable `status`."""
orders = st.sampled_from([1, 1, 1, 1, 2, 2, 0, -1, 3, 2**31 - 1, -(2**31)])


class CallMachine(SavedStates):
    """Makes any call in any phase, right and wrong."""

    model = Model
    no_instance = NO_INSTANCE

    # --- life

    @initialize(fmu=fmus, logging=st.booleans(), start=starts)
    def first(self, fmu, logging, start):
        self.instantiate(fmu, logging, start)

    @rule(fmu=fmus, logging=st.booleans(), start=st.none() | starts)
    def instantiate(self, fmu, logging, start):
        if len(self.live) < 3:
            self.made += 1
            self.check("fmi2Instantiate", (OK, True), "instantiate", self.made, fmu, f"i{self.made}", 1, None, logging)
            self.live[self.made] = self.model(self.facts[fmu])
            if start is not None:
                self.begin(self.made, self.live[self.made], start)

    def begin(self, number, model, start=0.0):
        """The right way to the first step."""
        if model.now.phase != INSTANTIATED:
            self.plain("fmi2Reset", number, model)
        self.check("fmi2SetupExperiment", model.setup(start, None), "setup", number, None, start, None)
        self.plain("fmi2EnterInitializationMode", number, model)
        self.plain("fmi2ExitInitializationMode", number, model)

    def plain(self, function, number, model):
        self.check(function, getattr(model, PLAIN[function])(), "plain", number, function)

    @precondition(some_live)
    @rule(pick=some, function=st.sampled_from(list(PLAIN)))
    def change_mode(self, pick, function):
        self.plain(function, *self.one(pick))

    @precondition(some_live)
    @rule(pick=some, tolerance=st.none() | numbers, start=st.just(0.0) | numbers, stop=st.none() | numbers)
    def setup(self, pick, tolerance, start, stop):
        number, model = self.one(pick)
        self.check("fmi2SetupExperiment", model.setup(start, stop), "setup", number, tolerance, start, stop)

    @precondition(lambda self: len(self.live) > 1)
    @rule(pick=some)
    def free(self, pick):
        number, model = self.one(pick)
        self.compare(number, model)
        self.check("fmi2FreeInstance", (OK, None), "free", number)
        del self.live[number]
        if self.native:  # its states go with it; pythonfmu's live on
            self.addresses = {a: found for a, found in self.addresses.items() if found[0] is not model}

    # --- values

    @precondition(some_live)
    @rule(pick=some, values=st.lists(nice, min_size=12, max_size=12), wild=st.none() | st.tuples(some, odd))
    def set_inputs(self, pick, values, wild):
        number, model = self.one(pick)
        which = model.facts.inputs
        if wild:
            values[wild[0] % len(which)] = wild[1]
        self.set_reals(number, model, which, values[: len(which)])

    @precondition(some_live)
    @rule(pick=some, pairs=st.lists(st.tuples(references, numbers), max_size=4))
    def set_any(self, pick, pairs):
        number, model = self.one(pick)
        which = self.right([r for r, _ in pairs], model)
        self.set_reals(number, model, which, [v for _, v in pairs], null=0 if pairs else 3)

    @precondition(some_live)
    @rule(pick=some, which=some, factor=st.floats(0.9, 1.1) | odd, anew=st.booleans())
    def set_parameter(self, pick, which, factor, anew):
        """To about its start value: mostly allowed, before the first step."""
        number, model = self.one(pick)
        if anew:
            self.plain("fmi2Reset", number, model)
        reference = model.facts.parameters[which % len(model.facts.parameters)]
        start = float(model.facts.start[model.facts.offsets[reference]])
        self.set_reals(number, model, [reference], [start * factor])
        if anew:
            self.begin(number, model) if which % 2 else self.plain("fmi2EnterInitializationMode", number, model)

    def set_reals(self, number, model, which, values, null=0):
        self.check("fmi2SetReal", model.set_real(which, values), "values", number, "fmi2SetReal", which, values, null)

    @precondition(some_live)
    @rule(pick=some, which=st.lists(references, max_size=4))
    def get_any(self, pick, which):
        number, model = self.one(pick)
        self.get_reals(number, model, self.right(which, model) or model.facts.outputs)
        self.get_reals(number, model, [], null=3)

    @precondition(some_live)
    @rule(pick=some, some_of=st.lists(st.tuples(references, orders, numbers), max_size=3))
    def derivatives(self, pick, some_of):
        number, model = self.one(pick)
        which = self.right([r for r, _, _ in some_of], model)
        of, values = [order for _, order, _ in some_of], [value for *_, value in some_of]
        self.set_rates(number, model, which, of, values)
        expected = model.get_derivatives(which, of)
        self.check(GET_RATES, expected, "derivatives", number, GET_RATES, which, of, None)

    def set_rates(self, number, model, which, of, values):
        expected = model.set_derivatives(which, of, values)
        self.check(SET_RATES, expected, "derivatives", number, SET_RATES, which, of, values)

    @precondition(some_live)
    @rule(pick=some, unknowns=st.lists(some, max_size=4), knowns=st.lists(st.tuples(some, numbers), max_size=3),
          wild=st.none() | references)  # fmt: skip
    def directional(self, pick, unknowns, knowns, wild):
        """Of outputs by inputs, but for one of them."""
        number, model = self.one(pick)
        outputs, inputs = model.facts.outputs, model.facts.inputs
        unknowns = [outputs[k % len(outputs)] for k in unknowns]
        which = [inputs[k % len(inputs)] for k, _ in knowns] if inputs else []
        if wild is not None:
            (unknowns if wild % 2 else which).extend(self.right([wild], model))
        seed = [x for _, x in knowns][: len(which)] + [1.0] * (len(which) - len(knowns))
        expected = model.directional(unknowns, which, seed)
        self.check("fmi2GetDirectionalDerivative", expected, "directional", number, unknowns, which, seed)

    # --- steps

    @precondition(some_live)
    @rule(pick=some, count=st.integers(1, 4), size=sizes, ready=st.sampled_from([True, True, False]),
          rate=st.none() | st.tuples(some, st.integers(1, 2), nice))  # fmt: skip
    def steps(self, pick, count, size, ready, rate):
        """As an importer makes them: each from where the last one ended. rate: of an input, counts for the first."""
        number, model = self.one(pick)
        if ready and model.now.phase != STEPPING:
            self.begin(number, model)
        if rate:
            among = model.facts.inputs
            self.set_rates(number, model, [among[rate[0] % len(among)]], [rate[1]], [rate[2]])
        for _ in range(count):
            self.step(number, model, model.now.time, size)
        self.compare(number, model)

    @precondition(some_live)
    @rule(pick=some, size=sizes | odd_sizes, time=st.none() | numbers, late=st.sampled_from([0.0, 1e-13, 1e-3]))
    def any_step(self, pick, size, time, late):
        number, model = self.one(pick)
        self.step(number, model, model.now.time + late if time is None else time, size)
        self.compare(number, model)

    def step(self, number, model, time, size):
        self.check("fmi2DoStep", lambda: model.step(time, size), "step", number, time, size)

    # --- what a rigid body has no use for, and what is no call at all

    @precondition(some_live)
    @rule(pick=some, what=st.integers(0, 6), which=st.lists(references, max_size=2), on=st.booleans(),
          function=st.sampled_from(OTHER_TYPES), inquiry=st.sampled_from(INQUIRIES))  # fmt: skip
    def seldom(self, pick, what, which, on, function, inquiry):
        number, model = self.one(pick)
        which = self.right(which, model)
        if what == 0:
            self.check("fmi2CancelStep", (ERROR, None), "plain", number, "fmi2CancelStep")
        elif what < 3 and self.inquiries:
            kind, wanted = inquiry
            asked = f"fmi2Get{'' if kind == 'Status' else kind}Status"
            self.check(asked, model.inquiry(kind, wanted), "status", number, asked, wanted)
        elif what == 3:
            self.log_what(number, model, on, len(which))
        elif what < 6:
            values = ([b"text" if function.endswith("String") else 1] * len(which)) if "Set" in function else None
            expected = model.get_integer(which) if function == "fmi2GetInteger" else model.no_such(which, values)
            self.check(function, expected, "values", number, function, which, values, 0 if which else 3)
        elif self.native:
            self.with_nulls(number, model, function, on)

    def log_what(self, number, model, on, which):
        categories = [[], CATEGORIES[:1], CATEGORIES[1:], [b"no category"]][which + on]
        wrong = self.native and which + on == 3  # pythonfmu takes any
        expected = model.refused if wrong else (OK, None)
        self.check("fmi2SetDebugLogging", expected, "logging", number, on, categories)

    def with_nulls(self, number, model, function, on):
        """Null pointers for three values, no instance, a wrong one: undefined by FMI, refused by the native FMU."""
        function, of = function[:7] + "Real" if on else function, model.facts.inputs[:1]
        values = [None if function.endswith("String") else 1] if "Set" in function else None
        for null in (1, 2, 3):
            self.check(function, model.refused, "values", number, function, of, values, null)
        for arguments in ((None, 1, None), ("it", 0, None), ("it", 1, "{no guid}"), ("it", 7, None)):
            self.check("fmi2Instantiate", (OK, False), "instantiate", 0, 0, *arguments, True, errors=1)
        self.check("fmi2FreeInstance", (OK, None), "free_nothing", 0)
        for name, operation, *arguments in self.no_instance:
            self.check(f"{name} of no instance", (ERROR, None), operation, None, *arguments, errors=0, result=False)

    def teardown(self):
        if self.process.process is None:  # it has crashed
            return
        for number, model in self.live.items():
            self.compare(number, model)
        if not self.native:
            for address in self.addresses:
                self.process.ask("release", next(iter(self.live), None), address)
        for number in self.live:
            self.process.ask("free", number)
        self.process.ask("clear")
