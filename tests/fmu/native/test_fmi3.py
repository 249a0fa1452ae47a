"""Native FMUs of FMI 3.0 compute what those of FMI 2.0 do, to the bit, with arrays as variables and with scalars."""

import zipfile

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.validation import validate_fmu

import rbfmu_fmu
from rbfmu.cli import main
from rbfmu.simulation import simulate
from rbfmu_fmu import builder, verify
from rbfmu_fmu.native.platforms import PLATFORMS
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED, assert_same_before_and_after_a_restore
from tests.support.fmu.fmu_importer import OK
from tests.support.fmu.fmus import BRICK, Kernels, built, native, opened, scene, signal

OWN = ["brick", "driven", "pendulum", "prescribed"]
KINDS = ["fmi3", "fmi3_scalars"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", OWN)
def test_fmu_is_the_kernels_and_that_of_fmi_2_before_and_after_a_restore(name, kind):
    inputs, size = signal(name, 2000), scene(name).run.step
    instance, kernels, older = opened(name, kind).started(), Kernels(name), native(name).started()
    assert instance.outputs() == older.outputs()
    assert_same_before_and_after_a_restore(instance, kernels, inputs, size, 1200)
    for k, values in enumerate(inputs):
        assert not values or older.set(values) == OK
        assert older.step(k * size, size) == OK
    assert older.outputs() == instance.outputs()
    instance.free()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", some_of([*OWN], 2))
def test_verify_finds_no_difference(name, kind):
    found = verify(built(name, kind))
    assert found.passed, found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["class", *some_of([*OWN, "two_ports", "default"], 2)])
def test_fmpy_validates(name, kind):
    assert validate_fmu(str(built(name, kind))) == []


@pytest.mark.parametrize("kind", KINDS)
def test_fmpy_gets_the_bits_of_simulate(kind):
    run = scene("brick").run
    recorded = fmpy.simulate_fmu(str(built("brick", kind)), stop_time=run.stop, output_interval=run.step)
    result = simulate(scene("brick"))
    for name in ("quaternion", "omega_b"):
        values = getattr(result, name)
        columns = recorded[name] if kind == "fmi3" else [recorded[f"{name}[{k + 1}]"] for k in range(len(values[0]))]
        assert np.array_equal(np.transpose(columns) if kind == "fmi3" else columns, values.T), name


@pytest.mark.parametrize("kind", KINDS)
def test_values_of_parameters_and_inputs_are_those_of_fmi_2(kind):
    values = {"mass": 5.0, "inertia[1,1]": 1.5, "inertia[2,3]": 0.1, "omega_b_0[2]": 0.7, "quaternion_0[1]": 0.5}
    instance, older = opened("driven", kind).started(values | LOADED), native().started(values | LOADED)
    names = [name for group in ("parameter", "input", "output") for name in older.fmu.by_causality[group]]
    assert instance.get(*names) == older.get(*names)
    assert instance.steps(20) == older.steps(20)


def test_an_array_has_its_quantitys_shape():
    model = fmpy.read_model_description(str(built("driven", "fmi3")))
    shapes = {v.name: v.shape for v in model.modelVariables}
    assert shapes["quaternion"] == (4,)
    assert shapes["inertia"] == (3, 3)
    assert shapes["torque_b"] == shapes["omega_b"] == (3,)
    assert shapes["mass"] == shapes["kinetic_energy"] == shapes["time"] == shapes["status"] == ()


def test_libraries_lie_in_the_folders_of_fmi_3(tmp_path, monkeypatch):
    monkeypatch.setattr(builder, "object_files", lambda kernels, platform: {})
    monkeypatch.setattr(builder, "link", lambda sources, objects, platform, *rest: platform.name.encode())
    path = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", PLATFORMS, fmi=3)
    with zipfile.ZipFile(path) as archive:
        libraries = {name: archive.read(name).decode() for name in archive.namelist() if "binaries/" in name}
    assert libraries == {
        "binaries/x86_64-linux/prescribed.so": "linux64",
        "binaries/x86_64-windows/prescribed.dll": "win64",
        "binaries/x86_64-darwin/prescribed.dylib": "darwin64",
        "binaries/aarch64-linux/prescribed.so": "linux-aarch64",
        "binaries/aarch64-darwin/prescribed.dylib": "darwin-aarch64",
    }


def test_builds_are_the_same_bytes(tmp_path):
    again = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", fmi=3)
    assert again.read_bytes() == built("prescribed", "fmi3").read_bytes() != built("prescribed", "native").read_bytes()


@pytest.mark.parametrize(("options", "message"), [
    ({"fmi": 3}, r'fmi = 3: expected kind = "native" with it'),
    ({"fmi": 4, "kind": "native"}, "fmi = 4: expected 2 or 3"),
    ({"scalars": True, "kind": "native"}, "scalars = True: expected fmi = 3 with it"),
])  # fmt: skip
def test_versions_that_there_are_not_are_refused(options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", **options)
    assert not (tmp_path / "it.fmu").exists()


def test_the_command_builds_and_verifies_it(tmp_path):
    fmu = tmp_path / "it.fmu"
    done = CliRunner().invoke(main, ["build", str(BRICK), "--native", "--fmi", "3", "-o", str(fmu)])
    assert done.exit_code == 0, done.output
    assert fmpy.read_model_description(str(fmu)).fmiVersion == "3.0"
    done = CliRunner().invoke(main, ["verify", str(fmu)])
    assert done.exit_code == 0, done.output
    assert done.output.endswith("passed\n")


@pytest.mark.parametrize(("options", "message"), [
    (["--fmi", "3"], "--fmi 3: expected --native with it"),
    (["--native", "--scalars"], "--scalars: expected --fmi 3 with it"),
    (["--native", "--fmi", "1"], "'1' is not one of '2', '3'"),
])  # fmt: skip
def test_the_command_refuses_what_does_not_go_together(options, message):
    done = CliRunner().invoke(main, ["build", str(BRICK), *options])
    assert done.exit_code == 2
    assert message in done.output
