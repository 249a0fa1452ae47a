"""FMI 3.0 has the bits of 2.0, with arrays and with scalars; what is refused says why and changes nothing."""

import ctypes as c
import re
import zipfile

import fmpy
import pytest

import rbfmu_fmu
from rbfmu_fmu import builder
from rbfmu_fmu.native.platforms import FMI_HEADERS, PLATFORMS
from rbfmu_fmu.python.call_rules import CALLS, PHASES, SETTABLE
from tests.support.covering import some_of
from tests.support.fmu.beside_kernels import LOADED, assert_same_before_and_after_a_restore
from tests.support.fmu.elf import elf
from tests.support.fmu.fmu_importer import DISCARD, ERROR, OK
from tests.support.fmu.fmus import Kernels, built, native, opened, scene, signal, unzipped

OWN = ["driven", "brick", "prescribed", "pendulum"]
KINDS = ["fmi3", "fmi3_scalars"]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", some_of(OWN, 2))
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


def test_an_array_has_its_quantitys_shape():
    model = fmpy.read_model_description(str(built("driven", "fmi3")))
    shapes = {v.name: v.shape for v in model.modelVariables}
    assert shapes["quaternion"] == (4,)
    assert shapes["inertia"] == (3, 3)
    assert shapes["torque_b"] == shapes["omega_b"] == (3,)
    assert shapes["mass"] == shapes["kinetic_energy"] == shapes["time"] == shapes["status"] == ()


def test_libraries_lie_in_the_folders_of_fmi_3(tmp_path, monkeypatch):
    monkeypatch.setattr(builder.object_code, "object_files", lambda kernels, platform: {})
    monkeypatch.setattr(builder.native, "link", lambda sources, objects, platform, *rest: platform.name.encode())
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


@pytest.mark.thorough
def test_builds_are_the_same_bytes(tmp_path):
    again = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", fmi=3)
    assert again.read_bytes() == built("prescribed", "fmi3").read_bytes() != built("prescribed", "native").read_bytes()


@pytest.mark.parametrize(("options", "message"), [
    ({"fmi": 3}, r'fmi = 3: expected kind = "native" with it'),
    ({"fmi": 4, "kind": "native"}, "fmi = 4: expected 2 or 3"),
    ({"fmi": 3.0, "kind": "native"}, "fmi = 3.0: expected 2 or 3"),
    ({"scalars": True, "kind": "native"}, "scalars = True: expected fmi = 3 with it"),
    ({"scalars": "no", "kind": "native", "fmi": 3}, "scalars = 'no': expected True or False"),
    ({"platforms": ["win64"]}, r"platforms = \['win64'\]: expected kind = \"native\" with them"),
    ({"kind": "C"}, "kind = 'C': expected \"pythonfmu\" or \"native\""),
])  # fmt: skip
def test_versions_that_there_are_not_are_refused(options, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", **options)
    assert not (tmp_path / "it.fmu").exists()


# Calls


H = 0.01
TYPES = ["Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64", "Boolean", "String"]


def fmi3(name="driven"):
    return opened(name, "fmi3")


def started(values=()):
    return fmi3().started(values)


def references(instance, name):
    return instance.fmu.references[name]


MADE = {
    "enter": lambda i: i.enter(),
    "exit": lambda i: i.exit(),
    "set input": lambda i: i.set({"torque_b[1]": 0.5}),
    "set parameter": lambda i: i.set({"mass": 3.0}),
    "set output": lambda i: i.set({"rpy[1]": 3.0}),
    "set time": lambda i: i.set({"time": 3.0}),
    "get parameter": lambda i: i.get_references([references(i, "mass")])[0],
    "get time": lambda i: i.get_references([references(i, "time")])[0],
    "get output": lambda i: i.get_references([references(i, "rpy[1]")])[0],
    "get derivative": lambda i: i.get_rates("rpy[1]")[0],
    "get status": lambda i: i.get_integer(references(i, "status"))[0],
    "directional": lambda i: i.derivative([references(i, "alpha_b[1]")], [], [])[0],
    "adjoint": lambda i: i.derivative([references(i, "alpha_b[1]")], [], [0.0] * 3, adjoint=True)[0],
    "step": lambda i: i.step(0.0, H),
    "event mode": lambda i: i.lib.fmi3EnterEventMode(i.component),
    "step mode": lambda i: i.lib.fmi3EnterStepMode(i.component),
    "configuration mode": lambda i: i.lib.fmi3EnterConfigurationMode(i.component),
    "terminate": lambda i: i.terminate(),
    "state": lambda i: i.restore(i.state()),
    "reset": lambda i: i.reset(),
}
RULES = {
    "enter": CALLS["enter_initialization"].phases,
    "exit": CALLS["exit_initialization"].phases,
    **{f"set {causality}": SETTABLE[causality] for causality in ("input", "parameter", "output")},
    **dict.fromkeys(["get output", "get derivative", "directional", "adjoint"], CALLS["get_outputs"].phases),
    "step": CALLS["do_step"].phases,
    "terminate": CALLS["terminate"].phases,
    **dict.fromkeys(["set time", "event mode", "step mode", "configuration mode"], ()),
}
"""The phases in which a call is allowed; any other call is in all."""
ALLOWED = {phase: {name for name in MADE if k in RULES.get(name, range(4))} for k, phase in enumerate(PHASES)}


@pytest.mark.parametrize("call", MADE)
@pytest.mark.parametrize("phase", ALLOWED)
def test_calls_are_allowed_in_their_phase_and_else_an_error(phase, call):
    instance = fmi3().instance()
    for name in ("enter", "exit", "terminate")[: [*ALLOWED].index(phase)]:
        assert MADE[name](instance) == OK
    allowed = call in ALLOWED[phase]
    assert MADE[call](instance) == (OK if allowed else ERROR)
    assert len(instance.log) == (not allowed)


def test_every_function_of_the_standard_is_there_and_nothing_else():
    header = (FMI_HEADERS / "fmi3Functions.h").read_text()
    functions = set(re.findall(r"FMI3_Export \w+\s+(fmi3\w+);", header))
    (library,) = unzipped("driven", "fmi3").glob("binaries/x86_64-linux/*.so")
    _, found, _ = elf(library.read_bytes())
    assert found == functions
    assert len(functions) > 70


def test_an_instance_needs_no_logger():
    instance = fmi3().instance()
    lib, text = fmi3().lib, [b"it", fmi3().guid.encode(), None]
    flags = [c.c_bool(False)] * 4
    silent = c.c_void_p(lib.fmi3InstantiateCoSimulation(*text, *flags, None, c.c_size_t(0), None, None, None))
    assert lib.fmi3Terminate(silent) == ERROR
    lib.fmi3FreeInstance(silent)
    lib.fmi3FreeInstance(None)
    assert instance.log == []


def test_null_pointers_are_errors():
    instance, state, lib = started(), started().state(), fmi3().lib
    one, real = c.c_size_t(1), c.c_double(0.0)
    for name, *arguments in (
        ("GetFloat64", None, one, None, one), ("SetFloat64", None, one, None, one), ("GetInt32", None, one, None, one),
        ("GetString", None, one, None, one), ("SetBoolean", None, one, None, one),
        ("GetBinary", None, one, None, None, one),
        ("SetDebugLogging", c.c_bool(True), one, None), ("GetOutputDerivatives", None, one, None, None, one),
        ("GetDirectionalDerivative", None, one, None, one, None, one, None, one),
        ("GetAdjointDerivative", None, one, None, one, None, one, None, one),
        ("DoStep", real, c.c_double(H), c.c_bool(True), None, None, None, None),
        ("GetFMUState", None), ("SetFMUState", None), ("SerializedFMUStateSize", state, None),
        ("SerializeFMUState", state, None, c.c_size_t(0)), ("DeserializeFMUState", None, c.c_size_t(0), None),
        ("EnterEventMode",), ("UpdateDiscreteStates", *[None] * 6), ("SetTime", real), ("GetClock", None, one, None),
    ):  # fmt: skip
        for component in (None, instance.component):
            instance.log.clear()
            assert getattr(lib, f"fmi3{name}")(component, *arguments) == ERROR, name
            assert len(instance.log) == (component is not None), name
    assert instance.steps(5) == started().steps(5)


@pytest.mark.parametrize("kind", TYPES)
def test_there_are_no_variables_of_other_types(kind):
    instance, none, one, room = started(), c.c_size_t(0), c.c_size_t(1), c.create_string_buffer(8)
    for verb in ("Get", "Set"):
        function = getattr(instance.lib, f"fmi3{verb}{kind}")
        assert function(instance.component, None, none, None, none) == OK
        assert function(instance.component, (c.c_uint * 1)(3), one, room, one) == ERROR
        assert instance.log[-1][-1].decode() == f"fmi3{verb}{kind}: torque_b is no {kind} variable"


@pytest.mark.parametrize("count", [0, 2, 4, 2**40])
def test_the_number_of_values_must_be_that_of_the_elements(count):
    instance, one, room = started(LOADED), c.c_size_t(1), (c.c_double * 4)(9.0, 9.0, 9.0, 9.0)
    which = (c.c_uint * 1)(references(instance, "torque_b[1]"))
    for verb in ("Get", "Set"):
        function = getattr(instance.lib, f"fmi3{verb}Float64")
        assert function(instance.component, which, one, room, c.c_size_t(count)) == ERROR
        assert instance.log[-1][-1].decode() == f"fmi3{verb}Float64: {count} values: expected 3"
    assert instance.get(*LOADED) == list(LOADED.values())


def test_an_inertia_matrix_must_be_symmetric():
    instance = fmi3().instance()
    which = [references(instance, "inertia[1,1]")]
    wrong, right = [1.0, 0.1, 0.0, 0.2, 2.0, 0.0, 0.0, 0.0, 2.5], [1.0, 0.1, 0.0, 0.1, 2.0, 0.0, 0.0, 0.0, 2.5]
    before = instance.get_references(which)
    assert instance.set_references(which, wrong) == ERROR
    assert instance.log[-1][-1] == b"fmi3SetFloat64: inertia[1,2] = 0.1 and 0.2: expected a symmetric matrix"
    assert instance.get_references(which) == before
    assert instance.set_references(which, right) == OK
    assert instance.get_references(which) == (OK, right)


def test_a_steps_answers():
    """Time reached, and whether to end the simulation; the time is a variable as well."""
    instance = started(LOADED)
    assert (instance.step(0.0, H), instance.answer) == (OK, (False, False, False, H))
    assert (instance.step(H, 1e300), instance.answer) == (DISCARD, (False, True, False, H))
    assert (instance.step(H, -H), instance.answer) == (ERROR, (False, False, False, H))
    assert instance.get("time") == [H]
    assert (instance.step(H, 2 * H), instance.answer) == (OK, (False, False, False, 3 * H))
    assert instance.get("time", "mass") == [3 * H, 2.0]


def test_a_state_of_fmi_2_is_none_of_fmi_3():
    older = opened("driven", "native").started()
    assert started().deserialized(older.serialized(older.state()))[0] == ERROR


def test_a_hash_in_a_message_names_no_variable():
    instance = started()
    assert instance.set_debug_logging(1, "#7# %n") == ERROR
    assert instance.log[-1][-1] == b"fmi3SetDebugLogging: there is no category ##7## %n"
    assert instance.set_debug_logging(1, "#" * 5000) == ERROR
