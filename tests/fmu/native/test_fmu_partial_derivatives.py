"""Directional and adjoint derivatives of outputs by inputs and, at the start, by parameters, of native FMUs."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from rbfmu.planning.select import plan
from rbfmu_fmu.description import describe
from rbfmu_fmu.model_description import depends_initially_on
from rbfmu_kernels.compile.tiered import tiered
from tests.support.fmu.beside_kernels import LOADED
from tests.support.fmu.conformance.model import IN_C, Facts
from tests.support.fmu.fmu_importer import ERROR, OK, Fmu
from tests.support.fmu.fmus import NATIVE, opened, scene, unzipped, unzipped_at

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


@pytest.mark.thorough
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


OTHER_STARTS = {"quaternion_0[2]": -1.7, "omega_b_0[3]": 2.5}


def by_parameters(instance, size=1e-5):
    """(names of parameters, derivatives, differences of outputs of instances that begin with them)."""
    names, found, expected = instance.fmu.by_causality["parameter"], [], []
    unknowns = variables(instance, "output")
    for name in names:
        status, column = instance.derivative(unknowns, [instance.fmu.references[name]], [1.0])
        assert status == OK
        found.append(column)
        after, before = (begun(instance.fmu, {name: instance.get(name)[0] + x}).outputs() for x in (size, -size))
        expected.append((np.array(after) - before) / (2.0 * size))
    return names, np.array(found).T, np.array(expected).T


def begun(fmu, starts=None):
    """An instance in Initialization Mode, at other starts."""
    instance = fmu.instance()
    assert instance.setup() == instance.enter() == OK
    known = {n: x for n, x in OTHER_STARTS.items() if n in fmu.references} | (starts or {})
    assert instance.set(known) == OK
    return instance


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["driven", "pendulum", "prescribed"])
def test_at_the_start_there_are_derivatives_by_parameters(name):
    """Also by an attitude that is normalised, an inertia, and what stands beside the centre of mass."""
    instance = begun(opened(name, "native"))
    names, found, expected = by_parameters(instance)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)
    assert np.any(found != 0.0, axis=0).all() or name != "driven"
    pair = [n for n in names if n.startswith("quaternion_0")][1:3]
    knowns = [instance.fmu.references[n] for n in pair]
    status, apart = instance.derivative(variables(instance, "output"), knowns, [1.0, -1.0])
    first, second = (found[:, names.index(n)] for n in pair)
    assert status == OK
    np.testing.assert_allclose(apart, first - second, rtol=1e-12, atol=1e-12)
    described = describe(scene(name), plan(scene(name)))
    for output, row in zip(described.outputs, found, strict=True):
        listed = {described.variables[k].name for k in depends_initially_on(described, output)}
        assert {n for n, x in zip(names, row, strict=True) if x != 0.0} <= listed


@pytest.mark.parametrize("kind", FMI3)
def test_fmi_3_gives_the_same_by_parameters_an_inertia_as_a_matrix(kind):
    known = [begun(opened("driven", one)) for one in ("native", kind)]
    seeds = {"inertia[1,1]": 0.3, "inertia[1,2]": -0.7, "inertia[2,3]": 0.2}
    other = ["mass", "quaternion_0[1]", "quaternion_0[4]"]
    columns = []
    for instance in known:
        parts = {n: instance.fmu.references[n] for n in (*seeds, *other)}
        if kind == "fmi3" and instance is known[1]:
            which = [parts["inertia[1,1]"], parts["mass"], parts["quaternion_0[1]"]]
            seed = [0.3, -0.7, 0.0, -0.7, 0.0, 0.2, 0.0, 0.2, 0.0, 1.0, 0.5, 0.0, 0.0, 2.0]
        else:
            which, seed = [*parts.values()], [*seeds.values(), 1.0, 0.5, 2.0]
        status, column = instance.derivative(variables(instance, "output"), which, seed)
        assert status == OK
        columns.append(column)
    assert columns[0] == columns[1]
    weights = [math.cos(k) for k in range(len(columns[1]))]
    status, row = known[1].derivative(variables(known[1], "output"), which, weights, adjoint=True)
    assert status == OK
    assert np.dot(row, seed) == pytest.approx(np.dot(weights, columns[1]), rel=1e-13)


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
    assert instance.derivative([output], [parameter], [1.0])[0] == ERROR
    assert b"mass is a parameter, which is known in Initialization Mode alone" in instance.log[-1][-1]
    assert instance.derivative([instance.fmu.references["status"]], [known], [1.0] * size)[0] == ERROR
    assert f"status is no {'Float64' if kind in FMI3 else 'Real'} output".encode() in instance.log[-1][-1]
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


@pytest.mark.thorough
def test_a_body_at_rest_has_derivatives_by_inputs_at_the_start_beside_a_norm_that_has_none(tmp_path: Path) -> None:
    """In Initialization Mode they were refused, as if a parameter changed the norm of the rates, which is zero."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "loads": {"torque_b": "-0.2*norm(omega_b)*omega_b"}}
    more = {"inputs": {"ports": ["torque_b"]}, "outputs": {"quantities": ["alpha_b"]}, "run": {"stop": 1.0}}
    path = rbfmu_fmu.build(rbfmu.Scene.from_dict(tables | more), tmp_path / "drag.fmu", kind="native")
    one = Fmu(unzipped_at(path, tmp_path / "drag")).instance()
    at, shown = one.fmu.references, variables(one, "output")
    assert one.setup() == one.enter() == OK
    assert one.derivative(shown, [at["torque_b[2]"]], [1.0]) == (OK, [0.0, 0.5, 0.0])
    assert one.derivative(shown, [at["omega_b_0[2]"]], [1.0])[0] == ERROR


def test_what_an_output_does_not_depend_on_does_not_change_it_where_it_has_no_derivative() -> None:
    """The angle between two axes has none by the attitude where they are one, and was refused by all else as well."""
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "constants": {"c": 0.3}}
    more = {"loads": {"torque_b": "c*[1, t, 0]"}, "run": {"stop": 1.0, "accuracy": 1e-3}}
    shown = {"quantities": ["alpha_b"], "tilt": "acos(R_ab[3,3])"}
    scene = rbfmu.Scene.from_dict(tables | more | {"outputs": shown})
    facts = Facts(scene, rbfmu.plan(scene), "native")
    at, z = {v.name: v.offset for v in facts.description.variables}, facts.start.copy()
    assert tiered(facts.unit.initialize)(z) == OK
    for name, expected in (("c", [1.0, 0.0]), ("quaternion_0[2]", [0.0, np.nan])):
        change = np.zeros(len(z))
        change[at[name]] = 1.0
        with np.errstate(all="ignore"):
            exec(facts.changes, {**IN_C, "sqrt": np.sqrt, "z": z, "change": change})
        np.testing.assert_array_equal(change[[at["alpha_b[1]"], at["tilt"]]], expected)


def test_at_a_corner_derivatives_are_those_of_one_side_as_of_a_linear_system() -> None:
    own = {"above": "max(u, 0)", "below": "max(0, u)", "way": "abs(u)", "other": "where(u > 0, u, 3*u)"}
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "inputs": {"ports": [{"name": "u", "size": 1}]}}
    more = {"outputs": {"quantities": ["omega_b"], **own}, "run": {"stop": 1.0}}
    scene = rbfmu.Scene.from_dict(tables | more)
    facts = Facts(scene, rbfmu.plan(scene), "native")
    at, z = {v.name: v.offset for v in facts.description.variables}, facts.start.copy()
    assert tiered(facts.unit.initialize)(z) == OK
    change = np.zeros(len(z))
    change[at["u"]] = 1.0
    facts.unit.feedthrough(z, change)
    assert change[[at[name] for name in own]].tolist() == [1.0, 0.0, 1.0, 3.0]
    linear = rbfmu.linearize(scene)
    assert linear.D[[linear.outputs.index(name) for name in own], 0].tolist() == [1.0, 0.0, 1.0, 3.0]
