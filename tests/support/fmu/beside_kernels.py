"""An FMU of any kind and the kernels by hand, step by step with the same inputs."""

from tests.support.fmu.fmu_importer import OK

LOADED = {"force_a[1]": 2.0, "force_b[2]": -1.0, "torque_a[3]": 0.5, "torque_b[1]": 0.7}


def both_step(instance, kernels, inputs, first, steps, size):
    """Largest difference of any output after any step."""
    largest = 0.0
    for k in range(first, first + steps):
        if inputs[k]:
            assert instance.set(inputs[k]) == OK
            kernels.set(inputs[k])
        assert instance.step(k * size, size) == OK
        kernels.step(size)
        largest = max(largest, *(abs(a - b) for a, b in zip(instance.outputs(), kernels.outputs(), strict=True)))
    return largest


def assert_same_before_and_after_a_restore(instance, kernels, inputs, size, first):
    """Step both over all inputs, go back to the state after `first` of them, and step again; returns that state."""
    rest = len(inputs) - first
    assert instance.outputs() == kernels.outputs()
    assert both_step(instance, kernels, inputs, 0, first, size) == 0.0
    state, z = instance.state(), kernels.z.copy()
    assert both_step(instance, kernels, inputs, first, rest, size) == 0.0
    end = instance.outputs()
    assert instance.restore(state) == OK
    kernels.z[:] = z
    assert both_step(instance, kernels, inputs, first, rest, size) == 0.0
    assert instance.outputs() == end
    return state
