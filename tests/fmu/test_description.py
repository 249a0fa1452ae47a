"""What an FMU says of itself: variables, units, bounds, dependencies, experiment; by FMPy's reading of it."""

import keyword
import math
import re
import zipfile
from functools import cache
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from rbfmu.scene.scene import Scene
from rbfmu_fmu.description import describe, identifier, sizes
from rbfmu_kernels.quantities import UNITS
from tests.support.covering import some_of
from tests.support.fmu.fmu_importer import OK
from tests.support.fmu.fmus import TABLES, built, opened, planned, scene, signal, unzipped

NAMES = ("brick", *TABLES)
SIZES = {"mass": 0, "kinetic_energy": 0, "quaternion": 4, "quaternion_0": 4}  # others: 3
BODY = ["mass", "inertia", "r_oc_b", "gravity_a"]
CENTRED = ["mass", "inertia", "gravity_a"]
START = ["position_0", "velocity_0", "quaternion_0", "omega_b_0"]
ALL = ["position", "velocity", "acceleration", "quaternion", "rpy", "omega_b", "omega_a", "alpha_b",
       "angular_momentum_a", "kinetic_energy"]  # fmt: skip
ROTATION = [name for name in ALL if name not in ("position", "velocity", "acceleration")]
EXPECTED = {  # inputs, parameters, outputs
    "brick": ([], ["inertia", "quaternion_0", "omega_b_0"], ["quaternion", "rpy", "omega_b"]),
    "default": ([], CENTRED + START, ALL),
    "driven": (["force_a", "force_b", "torque_a", "torque_b"], [*BODY, "damping_b", *START], ALL),
    "torqued": (["torque_a"], CENTRED + START, ALL),
    "two_ports": (["force_a", "torque_b"], CENTRED + START, ALL),
    "pendulum": (["torque_a"], [*BODY, "damping_b", "quaternion_0", "omega_b_0"], ROTATION),
    "prescribed": (["omega_b"], ["quaternion_0"], ["quaternion", "rpy", "omega_a"]),
    "class": ([], [*BODY, "force_a", *START], ALL),
}
DIMENSIONS = {
    "mass": "kg", "inertia": "kg m2", "r_oc_b": "m", "gravity_a": "m s-2", "damping_b": "kg m2 s-1 rad-1",
    "force_a": "kg m s-2", "force_b": "kg m s-2", "torque_a": "kg m2 s-2", "torque_b": "kg m2 s-2", "position_0": "m",
    "velocity_0": "m s-1", "quaternion_0": "", "omega_b_0": "rad s-1", "position": "m", "velocity": "m s-1",
    "acceleration": "m s-2", "quaternion": "", "rpy": "rad", "omega_b": "rad s-1", "omega_a": "rad s-1",
    "alpha_b": "rad s-2", "angular_momentum_a": "kg m2 s-1", "kinetic_energy": "kg m2 s-2",
}  # fmt: skip


def variables_of(block):
    if block == "inertia":
        return [f"inertia[{pair}]" for pair in ("1,1", "2,2", "3,3", "1,2", "1,3", "2,3")]
    size = SIZES.get(block, 3)
    return [f"{block}[{i + 1}]" for i in range(size)] if size else [block]


def block_of(name):
    return name.split("[")[0]


@pytest.mark.parametrize(("start", "span", "step"), [(0.0, 1e4, 0.1), (1e8, 1.0, 0.35), (1e9, 1.0, 0.3)])
def test_the_last_time_is_within_a_tenth_of_a_step_of_the_stop(start, span, step):
    """Or a `status` of 2 would not tell that FMPy, which takes 1e-9 of the time for round-off, went past it."""
    run = {"start": start, "stop": start + span, "step": step}
    made = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, run=run)
    last = describe(made, planned("default")).to_dict()["last_time"]
    assert start + span < last <= start + span + 0.1 * step


def test_how_large_an_fmu_and_the_full_model_are_is_counted():
    """Of a body with a pivot the full model has no place and no velocity among its states."""
    for name, expected in (("default", (53, (13, 53))), ("pendulum", (47, (7, 47))), ("prescribed", (18, (4, 18)))):
        assert sizes(scene(name), planned(name)) == expected


@cache
def model(name):
    return fmpy.read_model_description(str(built(name)))


def reals(name, causality=None):
    return [v for v in model(name).modelVariables if v.type == "Real" and causality in (None, v.causality)]


@pytest.mark.parametrize("name", some_of([*NAMES], 4))
def test_variables_are_those_that_the_scene_needs(name):
    for causality, blocks in zip(("input", "parameter", "output"), EXPECTED[name], strict=True):
        wanted = [variable for block in blocks for variable in variables_of(block)]
        assert sorted(v.name for v in reals(name, causality)) == sorted(wanted)
    assert [v.name for v in model(name).modelVariables if v.type != "Real"] == ["status"]


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_value_references_count_up_and_all_variables_are_described(name):
    variables = model(name).modelVariables
    assert [v.valueReference for v in variables] == list(range(len(variables)))
    assert all(v.description for v in variables)
    written = ElementTree.parse(unzipped(name) / "modelDescription.xml").getroot().iter("ScalarVariable")
    kinds = {v.get("causality"): (v.get("variability"), v.get("initial")) for v in written if v.get("name") != "status"}
    assert kinds.pop("input", ("continuous", None)) == ("continuous", None)
    assert kinds == {"parameter": ("fixed", "exact"), "output": ("continuous", "calculated")}


@pytest.mark.parametrize("name", NAMES)
def test_status_is_an_integer_output_from_0_to_2(name):
    status = model(name).modelVariables[-1]
    assert (status.name, status.type, status.causality, status.variability) == (
        "status",
        "Integer",
        "output",
        "discrete",
    )
    assert (status.min, status.max) == ("0", "2")
    assert all(f"{k}:" in status.description for k in (0, 1, 2))


@pytest.mark.parametrize("name", NAMES)
def test_units_are_the_quantities_own_in_si_base_units(name):
    defined = {u.name: u.baseUnit for u in model(name).unitDefinitions}
    assert {v.unit for v in reals(name)} == set(defined)
    for v in reals(name):
        exponents = {base: getattr(defined[v.unit], base) for base in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
        found = re.findall(r"(rad|kg|m|s)(-?\d*)", DIMENSIONS[block_of(v.name)])
        wanted = {base: int(power or 1) for base, power in found}
        assert {base: power for base, power in exponents.items() if power} == wanted, v.name
        assert (defined[v.unit].factor, defined[v.unit].offset) == (1.0, 0.0)


def test_every_unit_name_reads_as_its_exponents():
    known = {"N": {"kg": 1, "m": 1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2}}
    for name, (_, exponents, _) in UNITS.items():
        above, _, below = name.partition("/")
        total = dict.fromkeys(("kg", "m", "s", "rad"), 0)
        for sign, product in ((1, above), (-1, below)):
            for factor in product.split():
                base, power = re.fullmatch(r"([A-Za-z]+|1)(\d*)", factor).groups()
                for unit, exponent in known.get(base, {base: 1} if base != "1" else {}).items():
                    total[unit] += sign * exponent * int(power or 1)
        assert {unit: n for unit, n in total.items() if n} == exponents, name


@pytest.mark.parametrize("name", NAMES)
def test_default_experiment_is_the_scenes_run(name):
    run, experiment = scene(name).run, model(name).defaultExperiment
    found = (float(experiment.startTime), float(experiment.stopTime), float(experiment.stepSize))
    assert found == (run.start, run.stop, run.step)


@pytest.mark.parametrize("name", NAMES)
def test_capabilities_are_said(name):
    root = ElementTree.parse(unzipped(name) / "modelDescription.xml").getroot()
    said = root.find("CoSimulation").attrib
    yes = (
        "canHandleVariableCommunicationStepSize", "canGetAndSetFMUstate", "canSerializeFMUstate",
    )  # fmt: skip
    assert all(said[capability] == "true" for capability in yes)
    assert said["canBeInstantiatedOnlyOncePerProcess"] == said["needsExecutionTool"] == "false"
    assert root.get("variableNamingConvention") == "structured"
    assert {c.get("name") for c in root.iter("Category")} >= {"logStatusDiscard", "logStatusFatal"}


@pytest.mark.parametrize("name", NAMES)
def test_outputs_and_initial_unknowns_are_all_the_outputs(name):
    outputs = [v.name for v in model(name).modelVariables if v.causality == "output"]
    for unknowns in (model(name).outputs, model(name).initialUnknowns):
        assert [u.variable.name for u in unknowns] == outputs
        assert all(u.dependencies is not None for u in unknowns)


def changes(instance, before):
    """Names of the outputs that moved by more than round-off."""
    names = instance.fmu.by_causality["output"]
    pairs = zip(names, before, instance.outputs(), strict=True)
    return {name for name, a, b in pairs if abs(a - b) > 1e-12 * max(1.0, abs(a))}


@pytest.mark.parametrize("name", some_of([*NAMES], 4))
def test_outputs_depend_at_once_on_what_they_say_and_on_nothing_else(name):
    """Bounds no importer's algebraic loop but a real one: each input is moved and the outputs are looked at."""
    listed = {u.variable.name: {d.name for d in u.dependencies} for u in model(name).outputs}
    fmu, seen = opened(name), {}
    instance = fmu.started()
    if fmu.by_causality["input"]:
        instance.set(signal(name, 1)[0])
    instance.steps(3)
    for input_ in fmu.by_causality["input"]:
        before, usual = instance.outputs(), instance.get(input_)[0]
        assert instance.set({input_: usual + 0.7}) == OK
        for output in changes(instance, before):
            seen.setdefault(output, set()).add(input_)
        instance.set({input_: usual})
    for output, inputs in listed.items():
        assert seen.get(output, set()) <= inputs, output
        assert {block_of(i) for i in inputs} == {block_of(i) for i in seen.get(output, ())}


@pytest.mark.parametrize("name", ["driven", "pendulum", "prescribed"])
def test_initial_outputs_depend_on_what_they_say_and_on_nothing_else(name):
    listed = {u.variable.name: {d.name for d in u.dependencies} for u in model(name).initialUnknowns}
    fmu, seen = opened(name), {}
    instance = fmu.instance()
    assert instance.setup() == instance.enter() == OK
    rates = {f"omega_b_0[{i}]": 0.3 * i for i in (1, 2, 3) if f"omega_b_0[{i}]" in fmu.references}
    inputs = signal(name, 1)[0]
    assert instance.set(inputs | rates) == OK
    for known in [*fmu.by_causality["parameter"], *fmu.by_causality["input"]]:
        before, usual = instance.outputs(), instance.get(known)[0]
        assert instance.set({known: usual + 0.01}) == OK
        for output in changes(instance, before):
            seen.setdefault(output, set()).add(known)
        instance.set({known: usual})
    for output, knowns in listed.items():
        assert seen.get(output, set()) <= knowns, output
    everything = set().union(*seen.values())
    assert {block_of(k) for k in everything} == {block_of(v.name) for v in reals(name) if v.causality != "output"}


@pytest.mark.parametrize(("name", "output", "without"), [
    ("two_ports", "alpha_b", "force_a"), ("two_ports", "acceleration", "torque_b"),
    ("torqued", "acceleration", "torque_a"),
])  # fmt: skip
def test_initial_outputs_too_depend_on_no_input_that_does_not_move_them(name, output, without):
    """At the centre of mass a force turns no body, and a torque shifts none: an importer sees no loop there."""
    known = {v.block: v.begins_with for v in describe(scene(name), planned(name)).outputs}
    assert without not in known[output]
    assert {"inertia" if output == "alpha_b" else "mass"} <= known[output]


@pytest.mark.parametrize("name", NAMES)
def test_values_keep_within_the_bounds_that_are_said(name):
    variables, fmu = reals(name), opened(name)
    lowest = np.array([-math.inf if v.min is None else float(v.min) for v in variables])
    highest = np.array([math.inf if v.max is None else float(v.max) for v in variables])
    assert (np.isfinite(lowest) | np.isfinite(highest)).any()
    instance = fmu.started()
    for k, inputs in enumerate(signal(name, 300)):
        assert not inputs or instance.set(inputs) == OK
        assert instance.step(0.1 * k, 0.1) == OK
        values = np.array(instance.get(*(v.name for v in variables)))
        assert (lowest <= values).all()
        assert (values <= highest).all()


def test_bounds_are_those_of_the_quantities():
    bounds = {v.name: (v.min and float(v.min), v.max and float(v.max)) for v in reals("driven")}
    assert bounds["mass"] == bounds["inertia[3,3]"] == bounds["damping_b[1]"] == bounds["kinetic_energy"] == (0.0, None)
    assert bounds["inertia[1,2]"] == bounds["torque_a[1]"] == bounds["position[1]"] == (None, None)
    assert bounds["rpy[1]"] == bounds["rpy[3]"] == (-math.pi, math.pi)
    assert bounds["rpy[2]"] == (-math.pi / 2, math.pi / 2)
    assert bounds["quaternion[4]"] == pytest.approx((-1.0, 1.0), abs=1e-14)


def test_guid_tells_fmus_apart():
    guids = [model(name).guid for name in NAMES]
    assert len(set(guids)) == len(NAMES)
    assert all(re.fullmatch(r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}", guid) for guid in guids)


@given(st.text(st.characters(codec="utf-8", exclude_characters="/\\"), min_size=1).filter(str.strip))
@example("\ufdfa" * 200)
def test_any_name_makes_an_identifier(name):
    found = identifier(name)
    assert found.isidentifier()
    assert found.isascii()
    assert len(found) <= 201
    assert not keyword.iskeyword(found)


def test_a_name_in_any_script_is_kept_as_the_models_name():
    tables = TABLES["default"] | {"name": 'Würfel 立方体 <&> "1"'}
    description = describe(Scene.from_dict(tables), planned("default"))
    assert description.scene.name == tables["name"]
    assert description.identifier == "Wurfel__________1_"


@pytest.mark.parametrize("name", ["brick", "driven"])
def test_the_archive_is_sorted_timeless_and_compressed(name):
    with zipfile.ZipFile(built(name)) as archive:
        entries = archive.infolist()
    names = [e.filename for e in entries]
    assert names == ["modelDescription.xml", *sorted(names[1:])]
    assert {e.date_time for e in entries} == {(1980, 1, 1, 0, 0, 0)}
    assert {e.compress_type for e in entries} == {zipfile.ZIP_DEFLATED}
    assert {e.external_attr >> 16 for e in entries} == {0o644}
