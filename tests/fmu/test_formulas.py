"""FMUs of scenes with formulas: the same bits as `simulate`, constants and starts as parameters, and derivatives."""

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from rbfmu.models.formulas import equations_of
from rbfmu_fmu.description import describe, sizes
from rbfmu_fmu.native.headers import slopes_header
from tests.support.fmu.fmu_importer import ERROR, OK, Fmu
from tests.support.fmu.fmu_importer3 import imported
from tests.support.fmu.fmus import unzipped_at
from tests.support.paths import ROOT

SCENE = {
    "body": {"mass": 12.0, "inertia": [0.9, 1.1, 1.4]},
    "initial": {"omega_b": [0.01, 0.02, 0.0]},
    "constants": {"n": {"value": 0.3, "unit": "rad/s", "about": "orbital rate"}, "c": {"value": 0.1, "unit": "1/s"}},
    "formulas": {"u_b": "to_b([cos(n*t), sin(n*t), 0])"},
    "loads": {"gravity_a": [0.0, 0.0, 0.0], "torque_b": "3*n**2 * cross(u_b, M_c @ u_b) - c*h + wheel"},
    "states": {"h": {"start": [0.1, 0.0, 0.0], "rate": "torque_b + omega_b - 0.2*h", "unit": "N m s"}},
    "inputs": {
        "ports": ["torque_b", {"name": "wheel", "unit": "N m", "start": [0.01, 0.0, 0.0]}, {"name": "gain", "size": 1}],
        "parameters": ["n", "h_0"],
    },
    "outputs": {
        "quantities": ["quaternion", "omega_b", "alpha_b"],
        "tilt": {"value": "acos(clip(R_ab[3,3], -1, 1))", "unit": "rad", "about": "angle between z_b and z_a"},
        "pull": {"value": "norm(torque_b + [3, 0, 0])", "unit": "N m"},
        "root": "sqrt(2 + torque_b[3]) + gain**2",
    },
    "events": {
        "wave": {"when": "sin(2*t)", "about": "a wave"},
        "late": {"when": "t - 6.1", "direction": "falling"},
        "graze": "(t - 0.5)*(2e-15 - abs(t - 1))",
    },
    "run": {"stop": 4.0, "step": 0.25, "accuracy": 1e-9},
}
Built = Callable[[str], Path]
Units = Callable[[str], Fmu]
KINDS = {"native": {"kind": "native"}, "fmi3": {"kind": "native", "fmi": 3, "scalars": True}, "python": {}}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Built:
    folder, scene = tmp_path_factory.mktemp("fmus"), rbfmu.Scene.from_dict(SCENE, "orbit")
    return cache(lambda kind: rbfmu_fmu.build(scene, folder / f"{kind}.fmu", **KINDS[kind]))


@pytest.fixture(scope="module")
def units(fmus: Built) -> Units:
    return cache(lambda kind: imported(unzipped_at(fmus(kind), fmus(kind).with_suffix(""))))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_bits_are_those_of_simulate_with_other_parameters_and_start(fmus: Built, kind: str) -> None:
    scene = rbfmu.Scene.from_dict(SCENE)
    tables = scene.to_dict()
    tables["states"]["h"]["start"] = [0.2, 0.1, 0.3]
    other = rbfmu.Scene.from_dict(tables).replace({"constants.n": 0.5, "run.start": 3.0, "run.stop": 7.0})
    expected = rbfmu.simulate(other, planned=rbfmu.plan(scene))
    start = {"n": 0.5, "h_0[1]": 0.2, "h_0[2]": 0.1, "h_0[3]": 0.3}
    found = fmpy.simulate_fmu(
        str(fmus(kind)), start_time=3.0, stop_time=7.0, step_size=0.25, output_interval=0.25, start_values=start
    )
    np.testing.assert_array_equal(np.array([found[f"omega_b[{k}]"] for k in (1, 2, 3)]).T, expected.omega_b)
    assert [found[f"h[{k}]"][0] for k in (1, 2, 3)] == [0.2, 0.1, 0.3]
    for name in ("tilt", "pull", "root"):
        np.testing.assert_array_equal(found[name], expected.quantities[name].ravel())
    happened = expected.events["wave"]
    np.testing.assert_array_equal(found["wave_count"], [np.sum(happened <= t) for t in found["time"]])
    last = [max(happened[happened <= t], default=3.0) for t in found["time"]]
    np.testing.assert_array_equal(found["wave_time"], last)
    assert found["late_count"][-1] == 0  # it rises through zero
    assert found["late_time"][-1] == 3.0  # the start


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_counts_are_integers_that_a_saved_state_has(units: Units, kind: str) -> None:
    fmu = units(kind)
    types = {v.type for v in fmpy.read_model_description(str(fmu.folder)).modelVariables if v.name.endswith("_count")}
    assert types == {"Int32" if kind == "fmi3" else "Integer"}
    unit = fmu.started()

    def counts(*names: str) -> list[int]:
        return [unit.get_integer(fmu.references[name])[1] for name in names]

    assert unit.step(0.0, 1.0) == OK
    saved = unit.state()
    assert unit.step(1.0, 1.0) == OK
    assert counts("wave_count", "status", "late_count") == [2, 0, 0]  # at the start and at pi / 2
    assert counts("graze_count") == [1]  # by round-off it crosses zero twice more at 1 s, which is a touch
    assert unit.get("graze_time") == pytest.approx([0.5], abs=1e-12)
    assert unit.restore(saved) == OK
    assert counts("wave_count") == [1]
    assert unit.get_integer(fmu.references["wave_time"])[0] >= ERROR
    assert unit.get_integer(max(fmu.references.values()) + 1)[0] >= ERROR
    assert unit.get_references([fmu.references["graze_count"]])[0] >= ERROR
    assert "graze_count is no" in unit.log[-1][-1].decode()
    unit.free()


@pytest.mark.thorough
def test_counts_can_be_read_in_intermediate_updates(units: Units) -> None:
    names, read = ("wave_count", "late_count", "status"), []

    def update(environment: object, time: float, may_set: bool, may_get: bool, *_: object) -> None:
        if may_get:
            read.append((time, *(unit.get_integer(unit.fmu.references[name])[1] for name in names)))

    unit = units("fmi3").instance(updates=update, intermediate=names)
    unit.start()
    assert unit.step(0.0, 1.0) == unit.step(1.0, 1.0) == OK
    assert read == [(1.0, 1, 0, 0), (2.0, 2, 0, 0)]
    unit.free()


@pytest.mark.thorough
def test_an_event_that_ends_a_run_shortens_no_step_of_an_fmu(tmp_path: Path) -> None:
    events = {"turned": {"when": "omega_b[1] - 0.25", "stop": True}}
    tables = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, "initial": {"omega_b": [0.3, 1.0, 0.2]},
              "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 10.0, "step": 0.5}}  # fmt: skip
    scene = rbfmu.Scene.from_dict(tables | {"events": events}, "turning")
    end = rbfmu.simulate(scene).time[-1]
    assert end < 10.0
    rows = fmpy.simulate_fmu(str(rbfmu_fmu.build(scene, tmp_path / "turning.fmu")), output_interval=0.5)
    assert rows["time"][-1] == 10.0
    assert rows["turned_time"][np.argmax(rows["turned_count"] == 1)] == pytest.approx(end, abs=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["native", "python"])
def test_it_verifies_with_random_inputs(fmus: Built, kind: str) -> None:
    found = rbfmu_fmu.verify(fmus(kind))
    assert found.passed, found.problems
    assert found.units["pull"] == "N m"


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_own_outputs_over_a_closed_form_have_the_bits_of_simulate(kind: str, tmp_path: Path) -> None:
    tables = {
        name: table for name, table in SCENE.items() if name not in ("states", "inputs", "formulas", "loads", "events")
    }
    own = {"wave": "n*sin(t)*R_ab[1,1]", "far": "position + velocity"}
    scene = rbfmu.Scene.from_dict(tables | {"outputs": {"quantities": ["omega_b"], **own}}, "free")
    planned = rbfmu.plan(scene)
    assert planned.model == "torque-free body"
    path = rbfmu_fmu.build(scene, tmp_path / "free.fmu", **KINDS[kind])
    found = rbfmu_fmu.verify(path)
    assert found.passed, found.problems
    other = rbfmu.simulate(scene.replace({"constants.n": 0.7, "initial.omega_b": [0.2, 0.1, 0.3]}), planned=planned)
    start = {"n": 0.7, "omega_b_0[1]": 0.2, "omega_b_0[2]": 0.1, "omega_b_0[3]": 0.3}
    rows = fmpy.simulate_fmu(str(path), stop_time=4.0, step_size=0.25, output_interval=0.25, start_values=start)
    np.testing.assert_array_equal(rows["wave"], other.wave.ravel())
    np.testing.assert_array_equal([rows[f"far[{k}]"] for k in (1, 2, 3)], other.far.T)


@pytest.mark.thorough
def test_without_shipped_code_the_text_of_the_formulas_is_compiled(fmus: Built) -> None:
    command = [sys.executable, "-m", "rbfmu", "verify", str(fmus("python"))]
    done = subprocess.run(command, env=os.environ | {"RBFMU_COMPILE": "1"}, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def test_variables_say_what_they_are_and_depend_on(fmus: Built) -> None:
    with zipfile.ZipFile(fmus("native")) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
        planned = rbfmu.Plan.from_dict(json.loads(archive.read("resources/scene.json"))["plan"])
    assert "maxOutputDerivativeOrder" not in root.find("CoSimulation").attrib  # which formulas have none of
    names = [v.attrib["name"] for v in root.iter("ScalarVariable")]
    assert sizes(rbfmu.Scene.from_dict(SCENE, "orbit"), planned)[0] == len(names)  # with counts of events
    about = {v.attrib["name"]: v for v in root.iter("ScalarVariable")}
    assert about["n"].attrib["causality"] == about["h_0[2]"].attrib["causality"] == "parameter"
    assert about["n"].attrib["description"] == "orbital rate"
    assert "cannot be changed here" in about["c"].attrib["description"]
    assert about["tilt"].attrib["description"] == "angle between z_b and z_a = acos(clip(R_ab[3,3], -1, 1))"
    assert about["h_0[2]"].find("Real").attrib["unit"] == about["h[2]"].find("Real").attrib["unit"] == "N.m.s"
    assert about["h[2]"].attrib["causality"] == "output"
    depends = {
        kind: {names[int(u.attrib["index"]) - 1]: {names[int(k) - 1] for k in u.attrib["dependencies"].split()}
               for u in root.find(f"ModelStructure/{kind}")}
        for kind in ("Outputs", "InitialUnknowns")
    }  # fmt: skip
    ports = {f"torque_b[{k}]" for k in (1, 2, 3)}
    assert depends["Outputs"]["alpha_b[1]"] == ports | {f"wheel[{k}]" for k in (1, 2, 3)}
    assert depends["Outputs"]["pull"] == ports
    assert depends["Outputs"]["tilt"] == depends["Outputs"]["omega_b[1]"] == set()
    assert about["wheel[1]"].attrib["causality"] == about["gain"].attrib["causality"] == "input"
    assert about["wheel[1]"].find("Real").attrib["start"] == "0.01"
    assert {"n", "c", "h_0[1]", "inertia[1,1]"} <= depends["InitialUnknowns"]["alpha_b[1]"]
    assert depends["InitialUnknowns"]["h[1]"] == {f"h_0[{k}]" for k in (1, 2, 3)}
    assert depends["InitialUnknowns"]["tilt"] == {f"quaternion_0[{k}]" for k in (1, 2, 3, 4)}
    assert "3*n**2 * cross(u_b, M_c @ u_b) - c*h" in page


@pytest.mark.parametrize("listed", ["mass", "inertia", "r_oc_b"])
def test_only_a_centre_of_mass_that_may_change_couples_forces_and_torques(listed: str) -> None:
    """With a mass listed, outputs followed ports that nothing links, and depended on an r_oc_b that is not said."""
    tables = {"body": SCENE["body"], "constants": {"k": 0.3}, "loads": {"torque_b": "-k*omega_a"}}
    inputs, outputs = {"ports": ["force_a"], "parameters": [listed]}, {"quantities": ["omega_b", "alpha_b"]}
    scene = rbfmu.Scene.from_dict(tables | {"inputs": inputs, "outputs": outputs})
    found, coupled = equations_of(scene), listed == "r_oc_b"
    assert found.follows("alpha_b") == ({"force_a"} if coupled else set())
    assert ("r_oc_b" in found.parameters) == coupled


def test_initial_dependencies_are_of_numbers_that_are_zero_as_well() -> None:
    """The derivative by position_0[3], which is zero here, is 117.72, and dependencies said that there is none."""
    body = SCENE["body"] | {"pivot": True, "r_oc_b": [0.0, 0.0, -0.5]}
    tables = {"body": body, "initial": {"position": [1.0, 0.0, 0.0]}}
    outputs = {"quantities": ["omega_b", "potential_energy"], "place": "position"}
    found = equations_of(rbfmu.Scene.from_dict(tables | {"outputs": outputs}))
    assert found.begins_with("potential_energy") == {"mass", "gravity_a", "position_0", "r_oc_b", "quaternion_0"}
    assert found.begins_with("place") == {"position_0"}
    assert found.begins_with("omega_b") == {"omega_b_0"}


def test_own_outputs_over_a_closed_form_read_every_number_of_a_parameter() -> None:
    """A closed form takes another value of what is not listed; energies were without the numbers that had been zero."""
    tables = {"body": SCENE["body"], "initial": {"omega_b": [0.1, 0.2, 0.3], "position": [1.0, 0.0, 0.0]}}
    tables |= {"outputs": {"quantities": ["kinetic_energy", "total_energy"]}, "run": {"stop": 1.0, "step": 0.5}}
    scene = rbfmu.Scene.from_dict(tables)
    found = describe(scene, rbfmu.plan(scene))
    z, place = np.array(found.start_buffer), {v.name: v.offset for v in found.variables}
    assert not any(v.pinned for v in found.variables)
    z[[place[name] for name in ("gravity_a[1]", "inertia[1,2]")]] = [2.0, 0.5]
    assert found.plan.kernels.initialize(z) == OK
    kinetic = 0.5 * (0.9 * 0.01 + 1.1 * 0.04 + 1.4 * 0.09) + 0.5 * 0.1 * 0.2
    shown = [z[place[name]] for name in ("kinetic_energy", "total_energy")]
    np.testing.assert_allclose(shown, [kinetic, kinetic - 12.0 * 2.0 * 1.0], rtol=1e-14)


def test_outputs_follow_the_time_that_stands_in_their_formulas(fmus: Built) -> None:
    """FMI 3 has the time as a variable, which dependencies name."""
    model = fmpy.read_model_description(str(fmus("fmi3")))
    for listed in (model.outputs, model.initialUnknowns):
        timed = {u.variable.name for u in listed if "time" in {d.name for d in u.dependencies}}
        assert timed == {f"alpha_b[{k}]" for k in (1, 2, 3)}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_outputs_that_are_not_finite_at_the_start_are_called_so(units: Units, kind: str) -> None:
    """No parameter is at fault where the formula or the value of an input is."""
    one = units(kind).instance()
    assert one.setup() == one.enter() == one.set({"torque_b[3]": -3.0}) == OK
    assert one.exit() >= ERROR
    words = "outputs: expected finite numbers with these parameters, initial values and inputs"
    assert words in one.log[-1][-1].decode()
    assert one.set({"torque_b[3]": -1.0}) == one.exit() == OK
    one.free()


@pytest.mark.parametrize("kind", ["native", "python"])
def test_a_run_ends_also_where_an_output_is_not_finite(units: Units, kind: str) -> None:
    """2026-11-27: the pythonfmu kind answered fmi2Fatal, and that of the next unit ended the process."""
    one = units(kind).started()
    assert one.set({"torque_b[3]": -3.0}) == one.terminate() == OK
    assert one.get("torque_b[3]") == [-3.0]
    assert one.get_references([one.fmu.references["root"]])[0] >= ERROR
    one.free()


def test_derivatives_refusals_and_what_is_not_finite(units: Units) -> None:
    one = units("native").instance()
    reference = one.fmu.references
    ports = [reference[name] for name in (*(f"torque_b[{k}]" for k in (1, 2, 3)), "gain")]
    assert one.setup() == one.enter() == one.set({"c": 0.2}) == OK
    assert one.exit() == ERROR
    assert b'list "c" under parameters' in one.log[-1][-1]
    assert one.set({"c": 0.1}) == one.exit() == OK
    assert one.set_references(ports, [0.1, 4.0, -1.0, 3.0]) == OK
    shown = [reference[name] for name in ("alpha_b[1]", "tilt", "pull", "root")]
    found = [one.derivative(shown, [port], [1.0])[1] for port in ports]
    total = np.hypot(np.hypot(3.1, 4.0), -1.0)
    expected = [
        [1.0 / 0.9, 0.0, 3.1 / total, 0.0],
        [0.0, 0.0, 4.0 / total, 0.0],
        [0.0, 0.0, -1.0 / total, 0.5],
        [0.0, 0.0, 0.0, 6.0],
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-16)
    assert one.set_references(ports[:3], [-3.0, 0.0, 0.0]) == OK
    assert one.derivative([reference["pull"]], ports[:1], [1.0])[0] == ERROR
    assert b"no finite derivative here" in one.log[-1][-1]
    assert one.set_references(ports[:3], [0.0, 0.0, -3.0]) == OK
    for name, said in (("root", b"an output is not finite"), ("wave_count", b"wave_count is no")):
        assert one.get_references([reference[name]])[0] == ERROR  # the count's reference is next to that of `status`
        assert said in one.log[-1][-1]
    one.free()


def test_a_state_may_have_the_name_of_a_block_of_the_body() -> None:
    """Its derivatives at the start were looked for there, and building ended with a traceback."""
    tables = {
        "body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]},
        "states": {"q": {"start": [1.0, 0.0, 0.5], "rate": "-q"}},
    }
    more = {"loads": {"torque_b": "q"}, "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 1.0, "accuracy": 1e-3}}
    scene = rbfmu.Scene.from_dict(tables | more)
    described = describe(scene, rbfmu.plan(scene))
    at = {v.name: v.offset for v in described.variables}
    lines = slopes_header(described).splitlines()
    for k in (1, 2, 3):
        at_q, of_start = f"change[{at[f'q[{k}]']}] += ", f"change[{at[f'q_0[{k}]']}]);"
        assert any(at_q in line and of_start in line for line in lines)
