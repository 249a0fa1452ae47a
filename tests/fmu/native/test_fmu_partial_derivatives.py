"""Directional and adjoint derivatives of outputs by inputs, of native FMUs of both versions of FMI."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest

from tests.support.fmu.beside_kernels import LOADED
from tests.support.fmu.fmu_importer import ERROR, OK
from tests.support.fmu.fmus import NATIVE, opened, unzipped

FMI3 = ["fmi3", "fmi3_scalars"]


def variables(instance, causality):
    """Value references, each once."""
    return list(dict.fromkeys(instance.fmu.references[name] for name in instance.fmu.by_causality[causality]))


def jacobian(instance):
    """Of all outputs by all inputs, by directional derivatives; a column an input."""
    unknowns, knowns = variables(instance, "output"), variables(instance, "input")
    count = len(instance.fmu.by_causality["input"])
    columns = [instance.derivative(unknowns, knowns, row.tolist()) for row in np.eye(count)]
    assert {status for status, _ in columns} == {OK}
    return np.array([column for _, column in columns]).T


def differences(instance):
    """The same of the outputs themselves, which are linear in the inputs: a change of any size will do."""
    inputs = instance.fmu.by_causality["input"]
    now, before, columns = instance.get(*inputs), np.array(instance.outputs()), []
    for name, value in zip(inputs, now, strict=True):
        assert instance.set({name: value + 1.0}) == OK
        columns.append(np.array(instance.outputs()) - before)
        assert instance.set({name: value}) == OK
    return np.array(columns).T


@pytest.mark.parametrize("kind", NATIVE)
@pytest.mark.parametrize("name", ["driven", "pendulum", "prescribed", "torqued"])
def test_directional_derivatives_are_the_outputs_differences(name, kind):
    instance = opened(name, kind).instance()
    assert instance.setup() == instance.enter() == OK
    np.testing.assert_allclose(jacobian(instance), differences(instance), rtol=1e-12, atol=1e-12)
    assert instance.exit() == OK
    instance.steps(7)
    before = instance.outputs()
    J = jacobian(instance)
    np.testing.assert_allclose(J, differences(instance), rtol=1e-12, atol=1e-12)
    assert np.any(J != 0.0)
    assert instance.outputs() == before
    assert instance.terminate() == OK
    assert np.array_equal(jacobian(instance), J)


def test_both_versions_give_the_same_bits():
    found = [jacobian(opened("driven", kind).started(LOADED)) for kind in NATIVE]
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])


@pytest.mark.parametrize("kind", NATIVE)
def test_only_what_follows_inputs_at_once_has_a_derivative(kind):
    """As dependencies in modelDescription.xml say: those of all others are empty."""
    instance = opened("driven", kind).started(LOADED)
    names, J = instance.fmu.by_causality["output"], jacobian(instance)
    following = {name.split("[")[0] for name, row in zip(names, J, strict=True) if np.any(row != 0.0)}
    assert following == {"acceleration", "alpha_b"}


@pytest.mark.parametrize("kind", NATIVE)
def test_a_direction_may_be_any_and_name_an_input_twice(kind):
    instance = opened("driven", kind).started(LOADED)
    unknowns, knowns = variables(instance, "output"), variables(instance, "input")
    count = len(instance.fmu.by_causality["input"])
    seed = [math.sin(k) for k in range(count)]
    status, found = instance.derivative(unknowns, knowns, seed)
    assert status == OK
    np.testing.assert_allclose(found, jacobian(instance) @ seed, rtol=1e-13, atol=1e-13)
    assert instance.derivative(unknowns, knowns + knowns, [0.5 * x for x in seed] * 2) == (OK, found)
    assert instance.derivative([], [], []) == (OK, [])
    assert instance.derivative(unknowns, [], []) == (OK, [0.0] * len(found))


@pytest.mark.parametrize("kind", FMI3)
@pytest.mark.parametrize("name", ["driven", "pendulum", "prescribed"])
def test_adjoint_derivatives_are_those_of_the_same_jacobian(name, kind):
    instance = opened(name, kind).started()
    instance.steps(3)
    J = jacobian(instance)
    unknowns, knowns = variables(instance, "output"), variables(instance, "input")
    weights = [math.cos(k) for k in range(len(J))]
    status, found = instance.derivative(unknowns, knowns, weights, adjoint=True)
    assert status == OK
    np.testing.assert_allclose(found, weights @ J, rtol=1e-13, atol=1e-13)
    for k, row in enumerate(J):
        assert instance.derivative(unknowns, knowns, np.eye(len(J))[k].tolist(), adjoint=True) == (OK, row.tolist())


@pytest.mark.parametrize("kind", NATIVE)
def test_derivatives_that_there_are_not_are_errors(kind):
    instance = opened("driven", kind).instance()
    output, known = (instance.fmu.references[name] for name in ("acceleration[1]", "force_a[1]"))
    parameter = instance.fmu.references["mass"]
    size = 1 if kind != "fmi3" else 3
    assert instance.derivative([output], [known], [1.0] * size)[0] == ERROR  # before initialisation
    assert "outputs have no values" in instance.log[-1][-1].decode()
    instance.start()
    for unknowns, knowns, seed in (
        ([output], [parameter], [1.0]), ([known], [known], [1.0] * size), ([output], [output], [1.0] * size),
        ([output], [99999], [1.0]), ([99999], [known], [1.0] * size), ([output], [known], [math.nan] * size),
    ):  # fmt: skip
        said = len(instance.log)
        assert instance.derivative(unknowns, knowns, seed)[0] == ERROR
        assert len(instance.log) == said + 1
    if kind == "fmi3":
        assert instance.derivative([output], [known], [1.0])[0] == ERROR
        assert instance.log[-1][-1] == b"fmi3GetDirectionalDerivative: 1 values: expected 3"
    assert instance.derivative([output], [known], [1.0] * size)[0] == OK


@pytest.mark.parametrize("kind", NATIVE)
def test_the_description_says_so(kind):
    said = ElementTree.parse(unzipped("driven", kind) / "modelDescription.xml").getroot().find("CoSimulation").attrib
    names = ["providesDirectionalDerivative"]
    if kind in FMI3:
        names = ["providesDirectionalDerivatives", "providesAdjointDerivatives"]
    assert [said.get(name) for name in names] == ["true"] * len(names)
