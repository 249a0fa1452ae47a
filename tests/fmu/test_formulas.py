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
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.simulation import instantiate_fmu

import rbfmu
import rbfmu_fmu
from rbfmu.models.formulas import equations_of
from rbfmu_fmu.description import describe, sizes
from rbfmu_fmu.native.headers import slopes_header
from rbfmu_kernels.buffer import OK
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
KINDS = {"native": {"kind": "native"}, "fmi3": {"kind": "native", "fmi": 3, "scalars": True}, "python": {}}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Built:
    folder, scene = tmp_path_factory.mktemp("fmus"), rbfmu.Scene.from_dict(SCENE, "orbit")
    return cache(lambda kind: rbfmu_fmu.build(scene, folder / f"{kind}.fmu", **KINDS[kind]))


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
def test_counts_are_integers_that_a_saved_state_has(
    fmus: Built, kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    fmpy.extract(str(fmus(kind)), str(tmp_path))
    model = fmpy.read_model_description(str(tmp_path))
    at = {v.name: v.valueReference for v in model.modelVariables}
    types = {v.type for v in model.modelVariables if v.name.endswith("_count")}
    assert types == {"Int32" if kind == "fmi3" else "Integer"}
    said: list[object] = []
    log = lambda *told: said.append(told)  # noqa: E731 - kept while the unit is there: FMPy calls an earlier one's else
    unit = instantiate_fmu(str(tmp_path), model, "CoSimulation", logger=log)
    if kind == "fmi3":
        unit.enterInitializationMode(startTime=0.0)
    else:
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
    unit.exitInitializationMode()
    counts = unit.getInt32 if kind == "fmi3" else unit.getInteger
    save, restore = (getattr(unit, f"{name}FMU{'State' if kind == 'fmi3' else 'state'}") for name in ("get", "set"))
    unit.doStep(0.0, 1.0)
    saved = save()
    unit.doStep(1.0, 1.0)
    assert counts([at["wave_count"], at["status"], at["late_count"]]) == [2, 0, 0]  # at the start and at pi / 2
    assert counts([at["graze_count"]]) == [1]  # by round-off it crosses zero twice more at 1 s, which is a touch
    read = unit.getFloat64 if kind == "fmi3" else unit.getReal
    assert read([at["graze_time"]]) == pytest.approx([0.5], abs=1e-12)
    restore(saved)
    assert counts([at["wave_count"]]) == [1]
    with pytest.raises(FMICallException):
        counts([at["wave_time"]])
    with pytest.raises(FMICallException):
        counts([max(at.values()) + 1])
    with pytest.raises(FMICallException):
        read([at["graze_count"]])
    assert "graze_count is no" in f"{said} {capfd.readouterr().err}"  # the pythonfmu FMU says it on stderr alone
    unit.terminate()
    unit.freeInstance()


def test_counts_can_be_read_in_intermediate_updates(fmus: Built, tmp_path: Path) -> None:
    fmpy.extract(str(fmus("fmi3")), str(tmp_path))
    model = fmpy.read_model_description(str(tmp_path))
    at = {v.name: v.valueReference for v in model.modelVariables}
    counts, read = [at["wave_count"], at["late_count"], at["status"]], []

    def update(environment: object, time: float, may_set: bool, may_get: bool, *_: object) -> None:
        if may_get:
            read.append((time, *unit.getInt32(counts)))

    unit = FMU3Slave(guid=model.guid, unzipDirectory=str(tmp_path), modelIdentifier=model.coSimulation.modelIdentifier)
    unit.instantiate(intermediateUpdate=update, requiredIntermediateVariables=counts)
    unit.enterInitializationMode(startTime=0.0)
    unit.exitInitializationMode()
    unit.doStep(0.0, 1.0)
    unit.doStep(1.0, 1.0)
    assert read == [(1.0, 1, 0, 0), (2.0, 2, 0, 0)]
    unit.terminate()
    unit.freeInstance()


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
def test_outputs_that_are_not_finite_at_the_start_are_called_so(
    fmus: Built, kind: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """No parameter is at fault where the formula or the value of an input is."""
    fmpy.extract(str(fmus(kind)), str(tmp_path))
    model = fmpy.read_model_description(str(tmp_path))
    said: list[str] = []
    one = instantiate_fmu(str(tmp_path), model, "CoSimulation", logger=lambda *m: said.append(m[-1].decode()))
    at = {v.name: v.valueReference for v in model.modelVariables}
    if kind == "fmi3":
        one.enterInitializationMode(startTime=0.0)
    else:
        one.setupExperiment(startTime=0.0)
        one.enterInitializationMode()
    (one.setFloat64 if kind == "fmi3" else one.setReal)([at["torque_b[3]"]], [-3.0])
    with pytest.raises((FMICallException, OSError)):
        one.exitInitializationMode()
    words = "outputs: expected finite numbers with these parameters, initial values and inputs"
    assert words in "".join(said) + capfd.readouterr().err
    if kind != "python":  # an error of pythonfmu's is the unit's end
        (one.setFloat64 if kind == "fmi3" else one.setReal)([at["torque_b[3]"]], [-1.0])
        one.exitInitializationMode()
        one.terminate()
    one.freeInstance()


@pytest.mark.parametrize("kind", ["native", "python"])
def test_a_run_ends_also_where_an_output_is_not_finite(fmus: Built, kind: str, tmp_path: Path) -> None:
    """2026-11-27: the pythonfmu kind answered fmi2Fatal, and that of the next unit ended the process."""
    model = fmpy.read_model_description(fmpy.extract(str(fmus(kind)), str(tmp_path)))
    one = instantiate_fmu(str(tmp_path), model, "CoSimulation", logger=lambda *_: None)
    at = {v.name: [v.valueReference] for v in model.modelVariables}
    for begin in (one.setupExperiment, one.enterInitializationMode, one.exitInitializationMode):
        begin()
    one.setReal(at["torque_b[3]"], [-3.0])
    one.terminate()
    assert one.getReal(at["torque_b[3]"]) == [-3.0]
    with pytest.raises((FMICallException, OSError)):
        one.getReal(at["root"])
    one.freeInstance()


def test_derivatives_refusals_and_what_is_not_finite(fmus: Built, tmp_path: Path) -> None:
    model = fmpy.read_model_description(fmpy.extract(str(fmus("native")), str(tmp_path)))
    said: list[str] = []
    one = instantiate_fmu(str(tmp_path), model, "CoSimulation", logger=lambda *m: said.append(m[-1].decode()))
    reference = {v.name: v.valueReference for v in model.modelVariables}
    ports = [reference[f"torque_b[{k}]"] for k in (1, 2, 3)]
    one.setupExperiment(startTime=0.0)
    one.enterInitializationMode()
    one.setReal([reference["c"]], [0.2])
    with pytest.raises(FMICallException):
        one.exitInitializationMode()
    assert 'list "c" under parameters' in said[-1]
    one.setReal([reference["c"]], [0.1])
    one.exitInitializationMode()
    one.setReal([*ports, reference["gain"]], [0.1, 4.0, -1.0, 3.0])
    shown = [reference[name] for name in ("alpha_b[1]", "tilt", "pull", "root")]
    found = [one.getDirectionalDerivative(shown, [port], [1.0]) for port in (*ports, reference["gain"])]
    total = np.hypot(np.hypot(3.1, 4.0), -1.0)
    expected = [
        [1.0 / 0.9, 0.0, 3.1 / total, 0.0],
        [0.0, 0.0, 4.0 / total, 0.0],
        [0.0, 0.0, -1.0 / total, 0.5],
        [0.0, 0.0, 0.0, 6.0],
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-16)
    one.setReal(ports, [-3.0, 0.0, 0.0])
    with pytest.raises(FMICallException):
        one.getDirectionalDerivative([reference["pull"]], ports[:1], [1.0])
    assert "no finite derivative here" in said[-1]
    one.setReal(ports, [0.0, 0.0, -3.0])
    with pytest.raises(FMICallException):
        one.getReal([reference["root"]])
    assert "an output is not finite" in said[-1]
    with pytest.raises(FMICallException):
        one.getReal([reference["wave_count"]])  # whose reference is next to that of `status`
    assert "wave_count is no" in said[-1]
    one.freeInstance()


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
