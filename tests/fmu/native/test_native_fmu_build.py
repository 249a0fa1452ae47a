"""The native FMU's file: what it says, what it holds, what it needs, its bytes, and what is kept of a build."""

import hashlib
import importlib.util
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest

import rbfmu_fmu
from rbfmu_fmu import VerificationError, verify
from rbfmu_fmu.native import object_code, platforms
from rbfmu_fmu.native.platforms import BuildError, this_platform
from tests.support.command_line import call, refused
from tests.support.fmu.builds import KILLED, build_elsewhere
from tests.support.fmu.elf import elf
from tests.support.fmu.fmus import built, planned, scene, unzipped
from tests.support.paths import ROOT, SCENES

BESIDE_THE_MODEL = {".so": 96_000, ".dylib": 128_000, ".dll": 160_000}
"""Bytes of a library that are no code of the model: the C layer and the format, on Windows a part of the C library."""
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
    sections, exported, needed = elf(library.read_bytes())
    assert exported == set(FUNCTIONS)
    libc = {"malloc", "free", "memcpy", "memset", "strcmp", "memcmp", "bcmp", "strlen", "strchr", "strcpy", "strspn",
            "strcspn", "snprintf", "vsnprintf", "strtod", "strtol", "atoi"}  # fmt: skip
    assert needed <= libc | {f"__{name}_chk" for name in libc} | {
        "__stack_chk_fail",
        "floor",
        "ceil",
        "fmin",
        "fmax",
        "sqrt",
    }
    assert all(sections.get(name, 0) <= 8 for name in (".data", ".bss"))  # the linker's __dso_handle


def assert_nothing_superfluous(fmu, library, name, platform):
    """Every file is compressed, and the library holds the model's code once."""
    assert all(file.compress_type == zipfile.ZIP_DEFLATED for file in fmu.infolist())
    model = sum(map(len, object_code.object_files(planned(name).kernels, platform).values()))
    assert len(fmu.read(library)) - model < BESIDE_THE_MODEL[platform.suffix]


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["brick", "driven", "pendulum", "prescribed"])
def test_an_fmu_holds_the_model_once_and_nothing_to_debug_it_by(name):
    with zipfile.ZipFile(built(name, "native")) as fmu:
        (library,) = (n for n in fmu.namelist() if n.startswith("binaries/"))
        assert_nothing_superfluous(fmu, library, name, this_platform())
        sections, _, _ = elf(fmu.read(library))
    assert not [section for section in sections if section.startswith((".debug", ".symtab", ".note.gnu.build-id"))]


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
@pytest.mark.parametrize(("name", "kind"), [
    ("prescribed", "native"), pytest.param("prescribed", "python", marks=pytest.mark.slow),
    pytest.param("driven", "python", marks=pytest.mark.slow),
])  # fmt: skip
def test_builds_are_the_same_bytes_in_any_process_and_with_any_cache(name, kind, tmp_path):
    here = rbfmu_fmu.build(scene(name), tmp_path / "another name.fmu", kind).read_bytes()
    assert here == built(name, kind).read_bytes()
    for seed, more in (("1", {}), ("2", {"NUMBA_CACHE_DIR": str(tmp_path)})):
        again = build_elsewhere(tmp_path / f"{seed}.fmu", kind=kind, name=name, PYTHONHASHSEED=seed, **more)
        assert again == hashlib.sha256(here).hexdigest()


CPUS = {
    "generic": "", "znver3": "+avx2,+fma", "skylake": "+avx2,+fma", "skylake-avx512": "+avx2,+fma,+avx512f,+avx512vl",
    "nehalem": "+sse4.2",
}  # fmt: skip
"""Processors of two makers by LLVM's names, and what they have."""


def for_processor(cpu, folder):
    return {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": CPUS[cpu], "NUMBA_CACHE_DIR": str(folder / cpu)}


@pytest.mark.thorough
def test_object_code_is_the_same_on_any_processor(tmp_path):
    command = [sys.executable, "-m", "tests.support.fmu.compiled_for_any"]
    found = [
        subprocess.run(
            command, capture_output=True, env=os.environ | for_processor(cpu, tmp_path), check=True, cwd=ROOT
        )
        for cpu in ("generic", "skylake-avx512")
    ]
    assert found[0].stdout == found[1].stdout


OBJECTS = """
import sys, rbfmu
from rbfmu_fmu.native import object_code, platforms
scene = rbfmu.load_scene(sys.argv[1])
if "run" in sys.argv:
    rbfmu.simulate(scene)
else:
    files = object_code.object_files(rbfmu.plan(scene).kernels, platforms.PLATFORMS["linux64"])
    sys.stdout.buffer.write(b"".join(files.values()))
"""


@pytest.mark.slow
def test_object_code_of_formulas_is_the_same_whatever_was_compiled_before(tmp_path):
    """2026-11-29: what was made of their text was no kept code, so that a run before put it into an FMU twice."""

    def said(cache, *before):
        command = [sys.executable, "-c", OBJECTS, str(SCENES / "formulas" / "moored_hull.toml"), *before]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / cache)}
        return subprocess.run(command, capture_output=True, env=environment, check=True, cwd=ROOT).stdout

    said("used", "run")
    assert said("used") == said("fresh") != b""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "kind"), [("driven", "native"), ("prescribed", "python")])
@needs_ziglang
def test_five_processors_and_both_linkers_build_the_same_bytes(name, kind, tmp_path):
    """Two compilers of C make two libraries of the same object code; all else is the same."""
    found = {"gcc": set(), "ziglang": set()}
    for cpu in CPUS:
        for linker, before in (("gcc", WITHOUT_ZIGLANG), ("ziglang", "")):
            path = tmp_path / f"{linker}_{cpu}.fmu"
            found[linker].add(build_elsewhere(path, before, kind=kind, name=name, **for_processor(cpu, tmp_path)))
    assert [len(hashes) for hashes in found.values()] == [1, 1]
    if kind == "native":
        guids = {fmpy.read_model_description(str(path)).guid for path in tmp_path.glob("*.fmu")}
        assert len(guids) == 1  # a hash of the object code and of the C sources


WITHOUT_ZIGLANG = "from rbfmu_fmu.native import platforms; platforms.find_spec = lambda name: None"


# --- what is kept


def test_tables_that_llvm_numbers_are_named_alike():
    text = "@switch.table.step.{0} = private constant\nload @switch.table.step.{0}, @switch.table.{0}"
    assert object_code._without_counters(text.format(48)) == object_code._without_counters(text.format(51))


def test_exceptions_that_numba_names_by_their_address_are_named_alike():
    """2026-11-29: with Numba 0.61 each process built another FMU of a scene with formulas."""
    text = "@.const.pickledata.{0} = c\n@.const.pickledata.{0}.sha1 = c\n@.const.picklebuf.{0} = @.const.pickledata.{0}"
    assert object_code._without_counters(text.format(1399)) == object_code._without_counters(text.format(1400))


def test_object_code_is_compiled_once_and_anew_where_the_kept_file_is_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr(object_code.numba.config, "CACHE_DIR", str(tmp_path))
    codes = iter([b"first", b"second", b"third"])

    def code(what="a model"):
        return object_code.keep_or_compile(what, lambda: next(codes))

    assert code() == code() == b"first"
    (file,) = tmp_path.rglob("*.o")
    for damaged in (file.read_bytes()[:-1], file.read_bytes()[:10], b"", b"x" + file.read_bytes()[1:]):
        file.write_bytes(damaged)
        codes = iter([b"first"])
        assert code() == b"first"
    codes = iter([b"of another"])
    assert code("another model") == b"of another"
    assert code() == b"first"
    assert len(list(tmp_path.rglob("*"))) == 3  # their folder and two files: no part of one is left
    monkeypatch.setattr(object_code, "MOST", 1)
    codes = iter([b"of a third", b"first anew"])
    assert code("a third model") == b"of a third"
    assert code() == b"first anew"


@pytest.mark.parametrize(
    ("module", "changed", "other"),
    [(object_code.code_cache, "SOURCES", "others"), (object_code, "COMPILER", Path(__file__))],
    ids=["sources", "compiler"],
)
def test_object_code_of_other_sources_is_not_taken(module, changed, other, tmp_path, monkeypatch):
    monkeypatch.setattr(object_code.numba.config, "CACHE_DIR", str(tmp_path))
    assert object_code.keep_or_compile("a model", lambda: b"first") == b"first"
    monkeypatch.setattr(module, changed, other)
    assert object_code.keep_or_compile("a model", lambda: b"second") == b"second"


def test_without_numba_s_compiler_what_is_set_is_named(monkeypatch):
    """2026-11-28: "Numba 0.68.1 does not give a function's LLVM source", though that version does."""
    model = planned("prescribed").kernels  # loaded before the JIT is disabled, as others ask for it
    monkeypatch.setattr(object_code.numba.config, "DISABLE_JIT", 1)
    monkeypatch.setattr(object_code.decorator, "code_for_callers", lambda function, signature: function)
    with pytest.raises(BuildError, match="NUMBA_DISABLE_JIT is set: expected not, as FMUs have compiled code"):
        object_code._entry_module(model, "outputs")


def test_where_nothing_can_be_kept_a_model_is_compiled_each_time(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(object_code.numba.config, "CACHE_DIR", str(tmp_path / "file"))
    assert [object_code.keep_or_compile("a model", lambda code=code: code) for code in (b"1", b"2")] == [b"1", b"2"]


def test_a_build_takes_what_is_kept(monkeypatch):
    platform, model = this_platform(), planned("prescribed").kernels
    expected = object_code.object_files(model, platform)
    object_code._object_file.cache_clear()
    monkeypatch.setattr(object_code, "_compile", None)
    assert object_code.object_files(model, platform) == expected


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["native", "python"])
@pytest.mark.parametrize("before", KILLED, ids=["before it is in place", "while it is written"])
def test_a_killed_build_leaves_the_file_that_was_there(before, kind, tmp_path):
    path = tmp_path / "it.fmu"
    path.write_bytes(b"what was there")
    assert build_elsewhere(path, before, kind=kind) == -9
    assert path.read_bytes() == b"what was there"
    assert build_elsewhere(path, kind=kind) == hashlib.sha256(path.read_bytes()).hexdigest()
    assert path.read_bytes() == built("prescribed", kind).read_bytes()


@pytest.mark.parametrize("kind", [pytest.param("native", marks=pytest.mark.thorough), "python"])
def test_a_build_that_fails_leaves_nothing(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("os.replace", lambda *paths: (_ for _ in ()).throw(OSError(28, "disk full")))
    with pytest.raises(OSError, match="disk full"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind)
    assert list(tmp_path.iterdir()) == []


# --- the command line


@pytest.mark.thorough
@pytest.mark.parametrize("more", [{}, {"fmi": 3}], ids=["FMI 2.0", "FMI 3.0"])
def test_the_command_builds_what_the_function_builds(more, tmp_path):
    path, options = tmp_path / "it.fmu", [word for key, value in more.items() for word in (f"--{key}", value)]
    result = call("build", SCENES / "gyro_attitude.toml", "--native", *options, "-o", path)
    assert (result.exit_code, result.stdout.strip()) == (0, str(path))
    expected = rbfmu_fmu.build(scene("gyro_attitude"), tmp_path / "expected.fmu", "native", **more)
    assert path.read_bytes() == expected.read_bytes()
    verified = call("verify", path)
    assert verified.exit_code == 0
    assert verified.stdout.endswith("passed\n")


def test_bad_usage_is_one_message_and_status_2(tmp_path):
    for options, message in (
        (["--platform", "win64"], "--platform: expected --native"),
        (["--native", "--platform", "amiga"], "platform 'amiga': expected one of linux64, win64"),
        (["--fmi", "3"], "--fmi 3: expected --native with it"),
        (["--native", "--scalars"], "--scalars: expected --fmi 3 with it"),
        (["--native", "--fmi", "1"], "'1' is not one of '2', '3'"),
    ):
        assert message in refused("build", SCENES / "gyro_attitude.toml", "-o", tmp_path / "it.fmu", *options)
    assert list(tmp_path.iterdir()) == []


def test_a_machine_without_compilers_gets_one_message(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    said = refused("build", SCENES / "gyro_attitude.toml", "--native", "-o", tmp_path / "it.fmu")
    assert 'pip install "rbfmu[native]"' in said


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
