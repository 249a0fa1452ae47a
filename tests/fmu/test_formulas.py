"""FMUs of scenes with formulas: the same bits as `simulate`, constants and starts as parameters, and derivatives."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu

import rbfmu
import rbfmu_fmu
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
    "run": {"stop": 4.0, "step": 0.25, "accuracy": 1e-9},
}
KINDS = {"native": {"kind": "native"}, "fmi3": {"kind": "native", "fmi": 3, "scalars": True}, "python": {}}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder, scene = tmp_path_factory.mktemp("fmus"), rbfmu.Scene.from_dict(SCENE, "orbit")
    return {name: rbfmu_fmu.build(scene, folder / f"{name}.fmu", **options) for name, options in KINDS.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_bits_are_those_of_simulate_with_other_parameters_and_start(fmus: dict[str, Path], kind: str) -> None:
    scene = rbfmu.Scene.from_dict(SCENE)
    tables = scene.to_dict()
    tables["states"]["h"]["start"] = [0.2, 0.1, 0.3]
    other = rbfmu.Scene.from_dict(tables).replace({"constants.n": 0.5, "run.start": 3.0, "run.stop": 7.0})
    expected = rbfmu.simulate(other, planned=rbfmu.plan(scene))
    start = {"n": 0.5, "h_0[1]": 0.2, "h_0[2]": 0.1, "h_0[3]": 0.3}
    found = fmpy.simulate_fmu(
        str(fmus[kind]), start_time=3.0, stop_time=7.0, step_size=0.25, output_interval=0.25, start_values=start
    )
    np.testing.assert_array_equal(np.array([found[f"omega_b[{k}]"] for k in (1, 2, 3)]).T, expected.omega_b)
    assert [found[f"h[{k}]"][0] for k in (1, 2, 3)] == [0.2, 0.1, 0.3]
    for name in ("tilt", "pull", "root"):
        np.testing.assert_array_equal(found[name], expected.quantities[name].ravel())


@pytest.mark.parametrize("kind", ["native", "python"])
def test_it_verifies_with_random_inputs(fmus: dict[str, Path], kind: str) -> None:
    found = rbfmu_fmu.verify(fmus[kind])
    assert found.passed, found.problems
    assert found.units["pull"] == "N m"


@pytest.mark.thorough
def test_without_shipped_code_the_text_of_the_formulas_is_compiled(fmus: dict[str, Path]) -> None:
    command = [sys.executable, "-m", "rbfmu", "verify", str(fmus["python"])]
    done = subprocess.run(command, env=os.environ | {"RBFMU_COMPILE": "1"}, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def test_variables_say_what_they_are_and_depend_on(fmus: dict[str, Path]) -> None:
    with zipfile.ZipFile(fmus["native"]) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
    names = [v.attrib["name"] for v in root.iter("ScalarVariable")]
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


def test_derivatives_refusals_and_what_is_not_finite(fmus: dict[str, Path], tmp_path: Path) -> None:
    fmpy.extract(str(fmus["native"]), str(tmp_path))
    model = fmpy.read_model_description(str(tmp_path))
    said: list[str] = []
    log = lambda *message: said.append(message[-1].decode())  # noqa: E731
    one = instantiate_fmu(str(tmp_path), model, "CoSimulation", logger=log)
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
    one.freeInstance()
