"""What FMUs of every kind do alike: by pythonfmu and native, of FMI 2.0 and 3.0; a refusal is fatal in the first."""

import math
from itertools import product

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from rbfmu.simulation import simulate
from rbfmu_fmu import verify
from rbfmu_fmu.demo import ROUND_OFF
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED
from tests.support.fmu.fmu_importer import DISCARD, ERROR, FATAL, OK
from tests.support.fmu.fmus import ALL_PORTS, NATIVE, Kernels, built, opened, run_case, scene, unzipped

H = 0.01
REFUSALS = {"python": FATAL, "native": ERROR, "fmi3": ERROR}
"""By kind: what answers a call that is wrong."""
OWN = ["brick", "driven", "pendulum", "prescribed"]
SCALARS_LATER = [pytest.param(kind, marks=pytest.mark.thorough) for kind in ("fmi3", "fmi3_scalars")]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["python", *NATIVE])
@pytest.mark.parametrize("name", some_of(OWN, 2))
def test_verify_finds_no_difference(name, kind):
    found = verify(built(name, kind))
    assert found.passed, found


@pytest.mark.parametrize("kind", ["python", "native", *SCALARS_LATER])
@pytest.mark.parametrize("name", ["class", *some_of([*OWN, "two_ports", "default"], 1)])
def test_fmpy_validates(name, kind):
    assert validate_fmu(str(built(name, kind))) == []


def test_fmpy_gets_the_bits_of_simulate_at_the_same_communication_step():
    run, columns = scene("brick").run, simulate(scene("brick")).columns()
    for kind in REFUSALS:
        path = str(built("brick", kind))
        recorded = fmpy.simulate_fmu(path, stop_time=run.stop, output_interval=run.step, validate=kind != "python")
        assert len(recorded) == len(columns["time"]) == 301
        for name, values in columns.items():
            array, _, place = name.partition("[")
            found = recorded[array][:, int(place[:-1]) - 1] if place and kind == "fmi3" else recorded[name]
            assert np.max(np.abs(found - values)) <= ROUND_OFF, (kind, name)


def test_threads_compute_the_same_bits():
    for kind in ("python", "native"):
        assert run_case("threads", unzipped("driven", kind))[0] == [True] * 16


def test_outputs_follow_parameters_in_initialisation_and_inputs_at_any_time():
    values = {"position_0[1]": 7.0, "gravity_a[3]": -1.0, "mass": 5.0, "inertia[1,1]": 1.5, "inertia[2,3]": 0.1,
              "omega_b_0[2]": 0.7, "torque_b[2]": 3.0}  # fmt: skip
    for kind, refusal in REFUSALS.items():
        instance = opened("driven", kind).instance()
        assert instance.setup() == instance.enter() == OK
        assert instance.outputs() == Kernels("driven").outputs()
        assert instance.set(values) == OK
        kernels = Kernels("driven", values)
        assert instance.get(*values) == list(values.values())
        assert instance.outputs() == kernels.outputs()
        assert instance.exit() == OK
        assert instance.outputs() == kernels.outputs()
        for _ in range(3):
            kernels.step(H)
        instance.steps(3)
        assert instance.set(LOADED) == OK
        kernels.set(LOADED)
        assert instance.terminate() == OK
        assert instance.step(0.03, H) == refusal
        for late in (LOADED, dict.fromkeys(instance.fmu.by_causality["input"], 0.0)):
            assert instance.set(late) == refusal
        assert instance.outputs() == kernels.outputs()


def test_a_state_holds_pending_inputs_status_time_and_phase():
    for kind, refusal in REFUSALS.items():
        fmu = opened("driven", kind)

        def said(one, kind=kind):
            of_time = {
                "python": list,
                "native": lambda: [one.last_time(), one.terminated()],
                "fmi3": lambda: [one.last_time()],
            }[kind]()  # pythonfmu and a step of FMI 3.0 tell the rest
            return [one.status(), *of_time, one.outputs(), one.get(*LOADED), one.steps(10, first=3)]

        instance = fmu.started(LOADED)
        instance.steps(3)
        assert instance.step(0.03, 1e300) == DISCARD
        assert instance.set({"torque_b[1]": 5.0}) == OK  # not yet in the outputs
        saved = instance.serialized(instance.state())
        assert (instance.status(), instance.last_time(), instance.terminated()) == (1, 0.03, True)
        expected = said(instance)
        for other in (fmu.instance(), fmu.started(), instance):  # also one that never was initialised
            code, state = other.deserialized(saved)
            assert code == other.restore(state) == OK
            assert other.serialized(other.state()) == saved
            assert said(other) == expected
            assert other.set({"mass": 3.0}) == refusal  # it is stepping
            assert other.free_state(state) == OK


def test_a_state_of_the_initialisation_goes_on_initialising():
    for kind in REFUSALS:
        instance = opened("driven", kind).instance()
        assert instance.setup() == instance.enter() == OK
        assert instance.set({"mass": 3.0}) == OK
        state = instance.state()
        assert instance.exit() == OK
        expected = instance.steps(3)
        assert instance.restore(state) == OK
        assert instance.set({"mass": 4.0}) == OK
        assert instance.set({"mass": 3.0}) == OK
        assert instance.exit() == OK
        assert instance.steps(3) == expected


def test_a_refused_step_changes_nothing_but_the_status():
    sizes = 0.0, -0.0, -0.01, math.nan, math.inf, -math.inf, 1e300, 1e-300
    for (kind, refusal), size in product(REFUSALS.items(), sizes):
        instance, other = (opened("driven", kind).started(LOADED) for _ in range(2))
        instance.steps(3)
        outputs, discarded = instance.outputs(), kind == "python" or size == 1e300
        assert instance.step(0.03, size) == (DISCARD if discarded else refusal)
        assert (instance.status(), instance.last_time(), instance.outputs()) == (1, 0.03, outputs)
        assert instance.terminated() == discarded
        assert instance.steps(5, first=3) == other.steps(8)[3:]
        assert instance.status() == 0
        assert kind == "python" or not instance.terminated()


def test_a_step_that_leaves_the_range_of_numbers_never_happened():
    """Also one that fails after many good substeps; an importer that asks learns where it stands, and need not loop."""
    for port, place, kind in product(ALL_PORTS, (1, 3), REFUSALS):
        input_ = f"{port}[{place}]"
        instance, other = (opened("driven", kind).started(LOADED) for _ in range(2))
        instance.steps(3)
        expected = other.steps(13)[3:]
        usual = instance.get(input_)[0]
        assert instance.set({input_: 1e300}) == OK
        for size in (H, 10.0):
            assert instance.step(0.03, size) == DISCARD
            assert (instance.status(), instance.terminated(), instance.last_time()) == (1, True, 0.03)
            assert "no finite motion" in instance.log[-1][-1].decode()
        assert instance.set({input_: usual}) == OK
        assert instance.steps(10, first=3) == expected


def test_refused_parameters_can_be_put_right():
    for kind, refusal in REFUSALS.items():
        instance, right = opened("driven", kind).instance(), opened("driven", kind).started({"mass": 3.0})
        assert instance.setup() == instance.enter() == OK
        for wrong in (-1.0, 0.0, -0.0):
            assert instance.set({"mass": wrong}) == OK
            assert instance.exit() == refusal
            assert f": mass = {wrong}: expected" in str(instance.log[-1])
            assert instance.get_references([instance.fmu.references["rpy[1]"]])[0] == refusal  # nor are there outputs
        assert instance.set({"mass": 3.0}) == OK
        assert instance.exit() == OK
        assert instance.steps(5) == right.steps(5)


def test_a_set_that_is_refused_sets_nothing():
    for kind, refusal in REFUSALS.items():
        instance = opened("driven", kind).started(LOADED)
        for wrong in ({"force_a[1]": 9.0, "mass": 9.0}, {"force_a[1]": 9.0, "torque_b[1]": math.nan}):
            assert instance.set(wrong) == refusal
            assert instance.get(*LOADED) == list(LOADED.values())
        assert instance.set_references([instance.fmu.references["force_a[1]"], 9999], [9.0, 9.0]) == refusal
        assert instance.get(*LOADED) == list(LOADED.values())
        before = instance.outputs()
        assert instance.set_references([], []) == OK
        assert instance.get_references([]) == (OK, [])
        assert instance.outputs() == before
