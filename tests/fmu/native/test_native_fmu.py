"""The native FMU has the kernels' bits; all its memory is the importer's, and can be saved and checked."""

import math

import fmpy
import numpy as np
import pytest

from rbfmu_kernels.body import outputs as body_outputs
from rbfmu_kernels.quantities import OUTPUT
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED, assert_same_before_and_after_a_restore
from tests.support.fmu.fmu_importer import ERROR, OK, Memory
from tests.support.fmu.fmus import (  # noqa: F401
    SCENES,
    Kernels,
    built,
    each_version,
    native,
    run_case,
    scene,
    signal,
    started,
    unzipped,
)

H = 0.01
OWN = ["brick", "driven", "pendulum", "prescribed"]
SHIPPED = sorted(path.stem for path in SCENES.glob("*.toml"))


@pytest.mark.parametrize("name", [*OWN[1:], *some_of(SHIPPED, 1)])
def test_fmu_is_the_kernels_over_10000_steps_before_and_after_a_restore(name):
    inputs, size = signal(name, 10_000), scene(name).run.step
    instance, kernels = native(name).started(), Kernels(name)
    assert_same_before_and_after_a_restore(instance, kernels, inputs, size, 6000)
    instance.free()


# --- derivatives with respect to time


RATES = {"force_a[2]": 30.0, "torque_b[1]": 2.0, "torque_b[3]": -1.0}


def test_inputs_follow_their_derivatives_over_one_step_and_stay_where_that_ends():
    instance, kernels = started(LOADED), Kernels("driven", LOADED)
    blocks = kernels.unit.BLOCKS
    for k in range(100):
        for order, suffix in ((1, "_rate"), (2, "_rate_2")):
            values = {name: rate * math.sin(k) for name, rate in RATES.items()}
            assert instance.set_rates(values, order) == OK
            for name, value in values.items():
                block, index = name.rstrip("]").split("[")
                kernels.z[blocks[block + suffix].start + int(index) - 1] = value
        assert instance.step(k * H, H) == OK
        kernels.step(H)
        assert instance.outputs() == kernels.outputs()
        expected = [kernels.z[kernels.places[name]] for name in RATES]
        assert instance.get(*RATES) == expected
    before = instance.get(*RATES)
    instance.steps(1, first=100)
    assert instance.get(*RATES) == before  # derivatives count for one step


@pytest.mark.thorough
def test_a_ramp_of_an_input_is_exact_and_held_steps_are_not():
    """Angular momentum is what the torque adds: torque t^2 / 2; a round-off of the sum, and half a step too little."""
    rates = {"torque_a[1]": 1.0, "torque_a[2]": -2.0}
    exact, held = started(name="torqued"), started(name="torqued")
    for k in range(100):
        assert exact.set_rates(rates) == OK
        assert held.set({name: rate * k * H for name, rate in rates.items()}) == OK
        exact.steps(1, first=k)
        held.steps(1, first=k)
    momentum = [f"angular_momentum_a[{i}]" for i in (1, 2)]
    scale = 0.5 * np.array([1.0, -2.0])
    assert np.allclose(exact.get(*momentum), scale, rtol=1e-9, atol=0.0)
    assert np.allclose(held.get(*momentum), scale * 0.99, rtol=1e-9, atol=0.0)


def test_derivatives_that_there_are_not_are_errors():
    instance = started(LOADED)
    for rates, order in (({"torque_b[1]": 1.0}, 3), ({"torque_b[1]": 1.0}, 0), ({"mass": 1.0}, 1),
                         ({"rpy[1]": 1.0}, 1), ({"torque_b[1]": math.nan}, 1)):  # fmt: skip
        assert instance.set_rates(rates, order) == ERROR, (rates, order)
    assert "torque_b[1]" in instance.log[-1][2].decode()
    assert instance.get_rates("torque_b[1]")[0] == ERROR
    assert instance.steps(5) == started(LOADED).steps(5)
    assert instance.terminate() == OK
    assert instance.set_rates({"torque_b[1]": 1.0}) == ERROR


@pytest.mark.parametrize("name", OWN)
def test_derivatives_are_served_where_the_description_says_so(name):
    said = fmpy.read_model_description(str(built(name, "native"))).coSimulation
    instance = started(name=name)
    inputs, outputs = (instance.fmu.by_causality[causality] for causality in ("input", "output"))
    served = bool(inputs) and instance.set_rates(dict.fromkeys(inputs, 0.5)) == OK
    assert served == said.canInterpolateInputs
    assert (instance.get_rates(*outputs)[0] == OK) == (said.maxOutputDerivativeOrder == 1)


def test_outputs_have_first_derivatives():
    fmu = native("driven")
    instance, kernels = fmu.started(LOADED), Kernels("driven", LOADED)
    names = fmu.by_causality["output"]
    for k in range(10):
        kernels.unit.outputs(kernels.z)
        body_outputs.output_rates(kernels.z)
        expected = np.concatenate([kernels.z[kernels.unit.BLOCKS[f"d_{name}"]] for name in OUTPUT])
        assert instance.get_rates(*names) == (OK, expected.tolist())
        inputs = {"torque_b[1]": math.sin(k)}
        assert instance.set(inputs) == OK
        kernels.set(inputs)
        instance.steps(1, first=k)
        kernels.step(H)
    assert instance.get_rates(names[0], order=2)[0] == ERROR
    assert fmu.instance().get_rates(names[0])[0] == ERROR  # before initialisation


# --- memory


def test_all_memory_is_the_importers_and_comes_back():
    memory = Memory()
    instance = native().instance(memory=memory)
    instance.start(LOADED)
    assert len(memory.sizes) == 1
    states = [instance.state() for _ in range(5)]
    instance.deserialized(instance.serialized(states[0]))
    assert len(memory.sizes) == 7
    assert instance.free_state(states[2]) == OK
    assert len(memory.sizes) == 6
    assert instance.steps(5) == started(LOADED).steps(5)
    memory.most = 0
    assert instance.new_state()[0] == ERROR
    assert "no memory" in instance.log[-1][2].decode()
    instance.free()
    assert memory.sizes == {}


def test_a_thousand_lives_leave_nothing_behind():
    assert run_case("cycles", unzipped("driven", "native"))[0] < 1.0


# Saved states


@pytest.mark.usefixtures("each_version")
def test_a_state_is_overwritten_where_its_pointer_is_given():
    instance = started(LOADED)
    state = instance.state()
    instance.steps(3)
    same = instance.state_into(state)
    assert same.value == state.value
    expected = instance.steps(5, first=3)
    assert instance.restore(state) == OK
    assert instance.steps(5, first=3) == expected


def test_only_the_instances_own_live_states_are_taken():
    instance, other = started(LOADED), started(LOADED)
    foreign, freed = other.state(), instance.state()
    assert instance.free_state(freed) == OK  # a copy of the pointer stays
    expected = instance.outputs()
    for state in (foreign, freed, type(freed)(8), type(freed)(2**63)):
        assert instance.restore(state) == ERROR
        assert "no saved state of this instance" in instance.log[-1][2].decode()
        assert instance.free_state(state) == ERROR
        assert instance.lib.fmi2SerializeFMUstate(instance.component, state, b"", 0) == ERROR
    assert instance.restore(type(freed)(None)) == ERROR
    assert instance.free_state(type(freed)(None)) == OK  # FMI: ignored
    assert instance.outputs() == expected
    assert other.restore(foreign) == OK
