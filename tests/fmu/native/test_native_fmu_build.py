"""The native FMU's file: what it says, what it holds, what it needs, and how it is built."""

import hashlib
import importlib.util
import re
import struct
import subprocess
import zipfile
from xml.etree import ElementTree

import fmpy
import pytest

import rbfmu_fmu
from rbfmu_fmu import VerificationError, archive, verify
from rbfmu_fmu.fmi2_xml import FMI2
from rbfmu_fmu.native import build as native_build
from rbfmu_fmu.native import linking, object_code
from rbfmu_fmu.native.linking import NoLinkerError, universal
from rbfmu_fmu.native.platforms import PLATFORMS, BuildError, this_platform
from tests.support.command_line import call
from tests.support.fmu.builds import KILLED, build_elsewhere
from tests.support.fmu.fmu_importer import Fmu
from tests.support.fmu.fmus import built, native, scene, unzipped, unzipped_at
from tests.support.paths import SCENES

LARGEST = {"linux64": 112_000, "win64": 165_000, "darwin64": 145_000, "linux-aarch64": 175_000,
           "darwin-aarch64": 145_000}  # fmt: skip
"""Linux on aarch64 has its library twice."""
FORMATS = {"linux64": b"\x7fELF\x02", "win64": b"MZ", "darwin64": b"\xcf\xfa\xed\xfe\x07",
           "linux-aarch64": b"\x7fELF\x02", "darwin-aarch64": b"\xcf\xfa\xed\xfe\x0c"}  # fmt: skip
needs_ziglang = pytest.mark.skipif(not importlib.util.find_spec("ziglang"), reason="no ziglang: rbfmu[native]")


@pytest.mark.parametrize("name", ["brick", "driven", "pendulum", "prescribed"])
def test_description_is_the_pythonfmu_fmus_but_for_the_kind(name):
    found = []
    for kind in ("native", "python"):
        root = ElementTree.parse(unzipped(name, kind) / "modelDescription.xml").getroot()
        root.attrib.pop("guid")
        for kinds_own in ("needsExecutionTool", "canInterpolateInputs", "canNotUseMemoryManagementFunctions",
                          "maxOutputDerivativeOrder", "providesDirectionalDerivative"):  # fmt: skip
            root.find("CoSimulation").attrib.pop(kinds_own, None)
        found.append(ElementTree.tostring(root))
    assert found[0] == found[1]


def test_there_is_no_writable_data_and_nothing_is_exported_but_fmi():
    (library,) = (unzipped("driven", "native") / "binaries" / "linux64").glob("*.so")
    listed = subprocess.run(["nm", "-D", library], capture_output=True, text=True, check=True).stdout.splitlines()
    symbols = [line.split() for line in listed]
    assert {s[-1] for s in symbols if s[-2] == "T"} == set(FUNCTIONS)
    assert {s[-2] for s in symbols} <= {"T", "U", "w"}
    needed = {s[-1].split("@")[0] for s in symbols if s[-2] == "U"}
    libc = {"malloc", "free", "memcpy", "memset", "strcmp", "memcmp", "strlen", "strchr", "strcpy", "strspn",
            "strcspn", "snprintf", "vsnprintf", "strtod", "strtol", "atoi"}  # fmt: skip
    assert needed <= libc | {f"__{name}_chk" for name in libc} | {"__stack_chk_fail", "floor", "ceil", "fmin", "fmax"}
    sections = subprocess.run(["size", "-A", library], capture_output=True, text=True, check=True).stdout
    sizes = dict(re.findall(r"^(\.\S+)\s+(\d+)", sections, re.MULTILINE))
    assert int(sizes[".data"]) <= 8  # the linker's __dso_handle
    assert int(sizes[".bss"]) <= 8


FUNCTIONS = [f"fmi2{name}" for name in (
    "GetTypesPlatform", "GetVersion", "SetDebugLogging", "Instantiate", "FreeInstance", "SetupExperiment",
    "EnterInitializationMode", "ExitInitializationMode", "Terminate", "Reset", "GetReal", "GetInteger", "GetBoolean",
    "GetString", "SetReal", "SetInteger", "SetBoolean", "SetString", "GetFMUstate", "SetFMUstate", "FreeFMUstate",
    "SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate", "GetDirectionalDerivative",
    "SetRealInputDerivatives", "GetRealOutputDerivatives", "DoStep", "CancelStep", "GetStatus", "GetRealStatus",
    "GetIntegerStatus", "GetBooleanStatus", "GetStringStatus",
)]  # fmt: skip


# --- builds


@pytest.mark.thorough
def test_builds_are_the_same_bytes_in_any_process_and_with_any_cache(tmp_path):
    here = hashlib.sha256(built("prescribed", "native").read_bytes()).hexdigest()
    warm = build_elsewhere(tmp_path / "a.fmu", kind="native", PYTHONHASHSEED="1")
    cold = build_elsewhere(tmp_path / "b.fmu", kind="native", PYTHONHASHSEED="2", NUMBA_CACHE_DIR=str(tmp_path))
    assert here == warm == cold


@pytest.mark.thorough
@pytest.mark.parametrize("before", KILLED, ids=["before it is in place", "while it is written"])
def test_a_killed_build_leaves_the_file_that_was_there(before, tmp_path):
    path = tmp_path / "it.fmu"
    path.write_bytes(b"what was there")
    assert build_elsewhere(path, before, kind="native") == -9
    assert path.read_bytes() == b"what was there"


def test_a_build_that_fails_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(archive.os, "replace", lambda *paths: (_ for _ in ()).throw(OSError(28, "disk full")))
    with pytest.raises(OSError, match="disk full"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")
    assert list(tmp_path.iterdir()) == []


def test_without_any_compiler_one_message_names_both_remedies(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(linking, "find_spec", lambda name: None)
    with pytest.raises(NoLinkerError, match=r'pip install "rbfmu\[native\]".*, or a C compiler on PATH'):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")
    other = "win64" if this_platform().name != "win64" else "linux64"
    with pytest.raises(NoLinkerError, match=rf"{other} needs pip install .*for every platform\)$"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms=[other])
    assert list(tmp_path.iterdir()) == []


def test_unknown_platforms_and_kinds_are_refused(tmp_path):
    with pytest.raises(BuildError, match="'linux32': expected one of linux64, win64"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms=["linux32"])
    with pytest.raises(ValueError, match="'nativ': expected"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="nativ")


def test_what_the_c_compiler_says_is_in_the_message(tmp_path, monkeypatch):
    exported = b'__attribute__((visibility("default")))'
    layer = b"int unknown(void); %s int f(void) { return unknown(); }" % exported
    own = linking.source
    monkeypatch.setattr(linking, "source", lambda name: layer if name == FMI2.signatures else own(name))
    with pytest.raises(linking.LinkError, match="unknown"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")


@pytest.mark.parametrize(
    ("platforms", "folders"),
    [
        (["linux64"], {"linux64": "linux64"}),
        (["linux-aarch64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux-aarch64"}),
        (["linux-aarch64", "linux64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux64"}),
        (["linux-aarch64", "win64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux-aarch64", "win64": "win64"}),
    ],
)
def test_aarch64_lies_where_importers_look_unless_another_platform_does(platforms, folders, tmp_path, monkeypatch):
    """FMPy looks into binaries/linux64 on any Linux; FMI 2.0.5 has aarch64-linux."""
    monkeypatch.setattr(native_build, "object_files", lambda kernels, platform: {})
    monkeypatch.setattr(native_build, "linked", lambda sources, objects, platform, *rest: platform.name.encode())
    path = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", platforms)
    with zipfile.ZipFile(path) as archive:
        libraries = {name.split("/")[1]: archive.read(name) for name in archive.namelist() if "binaries/" in name}
    assert libraries == {folder: platform.encode() for folder, platform in folders.items()}


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("name", ["brick", "driven", "prescribed"])
@pytest.mark.slow
@needs_ziglang
def test_every_platform_is_built_small_and_the_same_each_time(name, platform, tmp_path):
    """Of its own format, and the FMU no larger than this, all in all."""
    paths = [rbfmu_fmu.build(scene(name), tmp_path / f"{k}.fmu", "native", [platform]) for k in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size < LARGEST[platform]
    with zipfile.ZipFile(paths[0]) as fmu:
        library, *_ = (n for n in fmu.namelist() if n.startswith("binaries/"))
        assert library.split("/")[1] == FMI2.folders[platform]
        assert fmu.read(library).startswith(FORMATS[platform])


@pytest.mark.slow
@needs_ziglang
def test_one_fmu_may_serve_all_platforms(tmp_path):
    path = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", list(PLATFORMS))
    folder = unzipped_at(path, tmp_path / "it")
    assert {p.parent.name for p in folder.glob("binaries/*/*")} == set(FMI2.folders.values())
    assert Fmu(folder).started().steps(5) == native("prescribed").started().steps(5)
    (both,) = folder.glob("binaries/darwin64/*.dylib")
    content = both.read_bytes()
    assert struct.unpack(">II", content[:8]) == (0xCAFEBABE, 2)
    for k in range(2):
        processor, _, place, size, _ = struct.unpack(">5I", content[8 + 20 * k : 28 + 20 * k])
        assert place % 2**14 == 0
        assert content[place : place + 8] == b"\xcf\xfa\xed\xfe" + processor.to_bytes(4, "little")
    assert place + size == len(content)
    assert universal([content]) == content


# --- the command line


def test_the_command_builds_what_the_function_builds(tmp_path):
    path = tmp_path / "it.fmu"
    result = call("build", SCENES / "gyro_attitude.toml", "--native", "-o", path)
    assert (result.exit_code, result.stdout.strip()) == (0, str(path))
    expected = rbfmu_fmu.build(scene("gyro_attitude"), tmp_path / "expected.fmu", "native")
    assert path.read_bytes() == expected.read_bytes()
    verified = call("verify", path)
    assert verified.exit_code == 0
    assert "passed" in verified.stdout


@pytest.mark.parametrize(("options", "message"), [
    (["--platform", "win64"], "--platform: expected --native"),
    (["--native", "--platform", "amiga"], "platform 'amiga': expected one of linux64, win64"),
])  # fmt: skip
def test_bad_usage_is_one_message_and_status_2(options, message, tmp_path):
    result = call("build", SCENES / "gyro_attitude.toml", "-o", tmp_path / "it.fmu", *options)
    assert result.exit_code == 2
    assert message in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_machine_without_compilers_gets_one_message(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(linking, "find_spec", lambda name: None)
    result = call("build", SCENES / "gyro_attitude.toml", "--native", "-o", tmp_path / "it.fmu")
    assert result.exit_code == 2
    assert 'pip install "rbfmu[native]"' in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.slow
@needs_ziglang
def test_an_fmu_for_another_platform_cannot_be_verified_here(tmp_path):
    other = "win64" if this_platform().name != "win64" else "linux64"
    path = rbfmu_fmu.build(scene("gyro_attitude"), tmp_path / "it.fmu", "native", [other])
    with pytest.raises(VerificationError, match=f"built for {other}, not {fmpy.platform}"):
        verify(path)


def test_the_c_signature_has_pointers_as_llvm_has_them():
    assert "double* %z, double %second" in object_code._c_signature("step", "inner", typed=True)
    assert "double* %z, double* %second" in object_code._c_signature("feedthrough", "inner", typed=True)
    assert "ptr" not in object_code._c_signature("step", "inner", typed=True)
    assert "*" not in object_code._c_signature("step", "inner", typed=False)
