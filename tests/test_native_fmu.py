"""The native FMU computes what the kernels compute, to the bit; all its memory is the importer's."""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from fmu_importer import ERROR, OK, Memory
from fmus import SCENES, Kernels, built, native, run_case, scene, signal, started, unzipped
from test_python_fmu import LOADED, both_step

from rbfmu.simulation import simulate
from rbfmu_fmu import verify

H = 0.01
OWN = ["brick", "driven", "pendulum", "prescribed"]
SHIPPED = sorted(path.stem for path in SCENES.glob("*.toml"))


@pytest.mark.parametrize("name", [*OWN[1:], *SHIPPED])
def test_fmu_is_the_kernels_over_10000_steps_before_and_after_a_restore(name):
    inputs, size = signal(name, 10_000), scene(name).run.step
    instance, kernels = native(name).started(), Kernels(name)
    assert instance.outputs() == kernels.outputs()
    assert both_step(instance, kernels, inputs, 0, 6000, size) == 0.0
    state, z = instance.state(), kernels.z.copy()
    assert both_step(instance, kernels, inputs, 6000, 4000, size) == 0.0
    end = instance.outputs()
    assert instance.restore(state) == OK
    kernels.z[:] = z
    assert both_step(instance, kernels, inputs, 6000, 4000, size) == 0.0
    assert instance.outputs() == end
    instance.free()


@pytest.mark.parametrize("name", OWN)
def test_verify_finds_no_difference(name):
    found = verify(built(name, "native"))
    assert found.passed, found


@pytest.mark.parametrize("name", [*OWN, "two_ports", "default", "class"])
def test_fmpy_validates(name):
    assert validate_fmu(str(built(name, "native"))) == []


def test_fmu_is_simulate_to_the_bit_at_the_same_communication_step():
    run = scene("brick").run
    recorded = fmpy.simulate_fmu(str(built("brick", "native")), stop_time=run.stop, output_interval=run.step)
    for name, values in simulate(scene("brick")).columns().items():
        assert np.array_equal(recorded[name], values), name


def test_threads_compute_the_same_bits():
    assert run_case("threads", unzipped("driven", "native"))[0] == [True] * 16


def test_outputs_follow_parameters_in_initialisation_and_inputs_at_any_time():
    instance = native().instance()
    assert instance.setup() == instance.enter() == OK
    values = {"position_0[1]": 7.0, "gravity_a[3]": -1.0, "mass": 5.0, "inertia[1,1]": 1.5, "torque_b[2]": 3.0}
    assert instance.outputs() == Kernels("driven").outputs()
    assert instance.set(values) == OK
    kernels = Kernels("driven", values)
    assert instance.outputs() == kernels.outputs()
    assert instance.exit() == OK
    for _ in range(3):
        kernels.step(H)
    instance.steps(3)
    assert instance.set(LOADED) == OK
    kernels.set(LOADED)
    assert instance.terminate() == OK
    assert instance.outputs() == kernels.outputs()


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


def test_ten_thousand_lives_leave_nothing_behind():
    assert run_case("cycles", unzipped("driven", "native"))[0] < 1.0
