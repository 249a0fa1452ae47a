"""Intermediate updates of FMI 3.0: the importer changes inputs within a step, and may end it early."""

from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest

from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED
from tests.support.fmu.fmu_importer import DISCARD, ERROR, OK
from tests.support.fmu.fmus import built, native, opened, started, unzipped

H = 0.01
TORQUES = [f"torque_a[{i}]" for i in (1, 2, 3)]
KINDS = ["fmi3", "fmi3_scalars"]


class Importer:
    """An instance whose inputs follow `course`, a function of the time that returns values by name."""

    def __init__(self, name, course, kind="fmi3", asks_for=None, early=False, when=None):
        self.course, self.when, self.calls, self.read = course, when, [], []
        names = opened(name, kind).by_causality
        asked = names["input"] + names["output"] if asks_for is None else asks_for
        options = {"updates": self.update, "intermediate": asked, "early": early}
        self.instance = opened(name, kind).instance(**options)

    def update(self, environment, time, may_set, may_get, finished, can_return, wanted, until):
        self.calls.append((time, may_set, may_get, finished, can_return))
        if may_set:
            values = self.course(time)
            assert not values or self.instance.set_all(values) == OK
        if may_get:
            self.read.append(self.instance.outputs())
        if self.when is not None and can_return:
            wanted[0], until[0] = True, self.when


def quadratic(time):
    return dict(zip(TORQUES, (1.0 + time, -2.0 * time, 3.0 * time * time), strict=True))


def constant(time):
    return LOADED


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_inputs_that_are_parabolas_are_exact(kind):
    """Angular momentum is what the torque adds: t + t^2 / 2, -t^2, t^3; held, it is a hundredth of that off."""
    importer = Importer("torqued", quadratic, kind)
    importer.instance.start(quadratic(0.0))
    importer.instance.steps(100)
    momentum = importer.instance.get(*(f"angular_momentum_a[{i}]" for i in (1, 2, 3)))
    assert np.allclose(momentum, [1.5, -1.0, 1.0], rtol=1e-9, atol=0.0)
    assert importer.instance.get(*TORQUES) == list(quadratic(1.0).values())


@pytest.mark.thorough
def test_they_are_the_input_derivatives_of_fmi_2_to_the_bit():
    importer, older = Importer("torqued", quadratic), started(quadratic(0.0), "torqued")
    importer.instance.start(quadratic(0.0))
    end = np.array(list(quadratic(0.0).values()))
    for k in range(20):
        begin, (middle, end) = end, (np.array(list(quadratic(k * H + t).values())) for t in (0.5 * H, H))
        half, whole = middle - begin, end - begin
        assert older.set(dict(zip(TORQUES, begin.tolist(), strict=True))) == OK
        assert older.set_rates(dict(zip(TORQUES, ((4.0 * half - whole) / H).tolist(), strict=True))) == OK
        assert older.set_rates(dict(zip(TORQUES, (4.0 * (whole - 2.0 * half) / H / H).tolist(), strict=True)), 2) == OK
        assert older.step(k * H, H) == OK
        assert older.set(dict(zip(TORQUES, end.tolist(), strict=True))) == OK
        assert importer.instance.steps(1, first=k) == [older.outputs()]


@pytest.mark.parametrize("course", [constant, lambda time: {}])
@pytest.mark.parametrize("kind", KINDS)
def test_inputs_that_stay_give_the_bits_of_a_step_without_updates(kind, course):
    importer = Importer("driven", course, kind)
    importer.instance.start(LOADED)
    assert importer.instance.steps(20) == started(LOADED).steps(20)


def test_the_middle_and_the_end_are_asked_for_and_outputs_are_those_of_the_end():
    importer = Importer("driven", constant)
    importer.instance.start(LOADED)
    assert importer.instance.step(0.0, H) == OK
    assert importer.instance.answer == (False, False, False, H)
    asked = [(0.5 * H, True, False, False, False), (H, True, False, False, False), (H, False, True, True, False)]
    assert importer.calls == asked
    assert importer.read == [importer.instance.outputs()]


@pytest.mark.thorough
@pytest.mark.parametrize(("when", "early"), [(0.0, True), (0.3 * H, True), (0.5 * H, True), (H, False)])
def test_a_step_ends_when_the_importer_wants(when, early):
    importer = Importer("torqued", quadratic, early=True, when=when)
    importer.instance.start(quadratic(0.0))
    assert importer.instance.step(0.0, H) == OK
    assert importer.instance.answer == (False, False, early, when)
    assert importer.instance.last_time() == when
    assert importer.instance.status() == 0
    momentum = importer.instance.get("angular_momentum_a[1]")[0]
    assert momentum == pytest.approx(when + when * when / 2.0, rel=1e-9, abs=0.0)
    importer.when = None
    assert importer.instance.step(when, H) == OK
    assert importer.instance.answer == (False, False, False, when + H)


def test_a_step_that_is_refused_did_not_return_early():
    importer = Importer("torqued", quadratic, early=True, when=0.5 * H)
    importer.instance.start(quadratic(0.0))
    assert importer.instance.step(0.0, H) == OK
    assert importer.instance.answer == (False, False, True, 0.5 * H)
    assert importer.instance.terminate() == OK
    assert importer.instance.step(0.5 * H, H) == ERROR
    assert importer.instance.answer == (False, False, False, 0.5 * H)


def test_nobody_returns_early_who_did_not_say_so():
    importer = Importer("driven", constant, early=False, when=0.3 * H)
    importer.instance.start(LOADED)
    importer.when = None
    assert importer.instance.steps(3) == started(LOADED).steps(3)
    assert not any(can_return for *_, can_return in importer.calls)


@pytest.mark.parametrize("when", [-H, 2.0 * H, float("nan"), float("inf")])
def test_a_return_at_a_time_outside_of_the_step_is_an_error(when):
    importer = Importer("driven", constant, early=True, when=when)
    importer.instance.start(LOADED)
    outputs = importer.instance.outputs()
    assert importer.instance.step(0.0, H) == ERROR
    assert b"at a time outside of it" in importer.instance.log[-1][-1]
    assert (importer.instance.outputs(), importer.instance.last_time()) == (outputs, 0.0)
    importer.when = None
    importer.instance.reset()
    importer.instance.start(LOADED)
    assert importer.instance.steps(3) == started(LOADED).steps(3)


def test_a_discarded_step_leaves_inputs_and_motion_as_they_were():
    importer = Importer("driven", lambda time: LOADED | {"force_b[2]": 1e300})
    importer.instance.start(LOADED)
    outputs = importer.instance.outputs()
    assert importer.instance.step(0.0, H) == DISCARD
    assert importer.instance.answer == (False, True, False, 0.0)
    assert importer.instance.get(*LOADED) == list(LOADED.values())
    assert (importer.instance.outputs(), importer.instance.status()) == (outputs, 1)
    importer.course = constant
    assert importer.instance.steps(5) == started(LOADED).steps(5)


FORBIDDEN = {
    "free": lambda i: i.free() or ERROR,
    "reset": lambda i: i.reset(),
    "step": lambda i: i.step(0.0, H),
    "terminate": lambda i: i.terminate(),
    "enter": lambda i: i.enter(),
    "exit": lambda i: i.exit(),
    "save": lambda i: i.new_state()[0],
    "restore": lambda i: i.restore(i.saved),
    "status": lambda i: i.get_integer(i.fmu.references["status"])[0],
    "parameter": lambda i: i.set({"mass": 3.0}),
    "another input": lambda i: i.set({"force_a[1]": 3.0}),
    "output": lambda i: i.get_references([i.fmu.references["position[1]"]])[0],
    "logging": lambda i: i.set_debug_logging(0),
    "derivative": lambda i: i.derivative([i.fmu.references["alpha_b[1]"]], [], [])[0],
}


@pytest.mark.parametrize("call", FORBIDDEN)
def test_in_an_update_no_other_call_is_allowed(call):
    """Before the step is finished: inputs that the importer has named may be set, nothing else be done."""
    statuses = []

    def update(environment, time, may_set, *rest):
        if may_set:
            statuses.append(FORBIDDEN[call](instance))

    named = [f"torque_b[{k}]" for k in (1, 2, 3)]
    instance = opened("driven", "fmi3").instance(updates=update, intermediate=named)
    instance.start(LOADED)
    instance.saved = instance.state()
    assert instance.step(0.0, H) == OK
    assert statuses == [ERROR, ERROR]
    assert len(instance.log) >= 2
    assert instance.outputs() == started(LOADED).steps(1)[0]


@pytest.mark.parametrize("asked", ["mass", "time", 99999])
def test_what_takes_no_part_in_updates_cannot_be_named_for_them(asked):
    instance = opened("driven", "fmi3").instance(updates=lambda *arguments: None, intermediate=[asked])
    assert not instance.component.value
    assert b"is no input or output for intermediate updates" in instance.log[-1][-1]


def test_the_status_can_be_read_after_the_step():
    found = []

    def update(environment, time, may_set, may_get, *rest):
        found.append(instance.get_integer(instance.fmu.references["status"]) if may_get else may_set)

    instance = opened("driven", "fmi3").instance(updates=update, intermediate=["status"])
    instance.start(LOADED)
    assert instance.step(0.0, H) == OK
    assert found == [True, True, (OK, 0)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", some_of(["brick", "driven", "prescribed"], 1))
def test_the_description_says_so(name, kind):
    root = ElementTree.parse(unzipped(name, kind) / "modelDescription.xml").getroot()
    served, said = bool(native(name).by_causality["input"]), root.find("CoSimulation").attrib
    marked = {v.get("causality") for v in root.find("ModelVariables") if v.get("intermediateUpdate") == "true"}
    assert ("providesIntermediateUpdate" in said) == served
    assert ("canReturnEarlyAfterIntermediateUpdate" in said) == served
    assert marked == ({"input", "output"} if served else set())
    calls = []
    instance = opened(name, kind).instance(updates=lambda *arguments: calls.append(1))
    instance.start()
    instance.steps(1)
    assert bool(calls) == served


def test_fmpy_makes_the_calls():
    """By its own loop over an FMU, in an importer of one's own."""
    path = str(built("torqued", "fmi3"))
    model = fmpy.read_model_description(path)
    torque = next(v.valueReference for v in model.modelVariables if v.name == "torque_a")
    momentum = next(v.valueReference for v in model.modelVariables if v.name == "angular_momentum_a")

    def update(environment, time, may_set, *rest):
        if may_set:
            unit.setFloat64([torque], list(quadratic(time).values()))

    unit = fmpy.fmi3.FMU3Slave(guid=model.guid, unzipDirectory=fmpy.extract(path), instanceName="it",
                               modelIdentifier=model.coSimulation.modelIdentifier)  # fmt: skip
    unit.instantiate(intermediateUpdate=update, requiredIntermediateVariables=[torque])
    unit.enterInitializationMode(startTime=0.0)
    unit.setFloat64([torque], list(quadratic(0.0).values()))
    unit.exitInitializationMode()
    for k in range(100):
        unit.doStep(k * H, H)
    assert np.allclose(unit.getFloat64([momentum], 3), [1.5, -1.0, 1.0], rtol=1e-9, atol=0.0)
    unit.terminate()
    unit.freeInstance()
