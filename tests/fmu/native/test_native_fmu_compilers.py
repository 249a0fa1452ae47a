"""Compilers of native FMUs and the platforms that they compile for: which is taken, what is said where none serves."""

import struct
import sys
import zipfile

import pytest

import rbfmu_fmu
from rbfmu_fmu import builder
from rbfmu_fmu.model_description import FMI2
from rbfmu_fmu.native import object_code, platforms
from rbfmu_fmu.native.platforms import PLATFORMS, BuildError, NoLinkerError, platforms_named, this_platform, universal
from tests.fmu.native.test_native_fmu_build import assert_nothing_superfluous, needs_ziglang
from tests.support.fmu.fmu_importer import Fmu
from tests.support.fmu.fmus import native, scene, unzipped_at
from tests.support.full_disk import full_disk

FORMATS = {"linux64": b"\x7fELF\x02", "win64": b"MZ", "darwin64": b"\xcf\xfa\xed\xfe\x07",
           "linux-aarch64": b"\x7fELF\x02", "darwin-aarch64": b"\xcf\xfa\xed\xfe\x0c"}  # fmt: skip


def test_without_any_compiler_one_message_names_both_remedies(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    with pytest.raises(NoLinkerError, match=r'pip install "rbfmu\[native\]".*, or a C compiler on PATH'):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")
    other = "win64" if this_platform().name != "win64" else "linux64"
    with pytest.raises(NoLinkerError, match=rf"{other} needs pip install .*for every platform\)$"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms=[other])
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_under_the_compiler_is_said_with_the_remedy():
    """2026-11-30: it was said of "standard output or a file"."""
    with (
        full_disk(10),
        pytest.raises(BuildError, match=r"linked in a temporary folder \(.*large\): TMPDIR names another"),
    ):
        platforms.link(["messages.c"], {}, this_platform(), "it")


def test_a_compiler_that_fails_counts_as_none(tmp_path, monkeypatch):
    own = tmp_path / "bin" / "cc"  # as Debian's gcc without the headers of C
    own.parent.mkdir()
    own.write_text("#!/bin/sh\necho 'fatal error: stdint.h: No such file or directory' >&2; exit 1\n")
    own.chmod(0o755)
    monkeypatch.setenv("PATH", str(own.parent))
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    with pytest.raises(NoLinkerError, match=r"(?s)stdint\.h.* needs pip install .* C compiler on PATH .* its headers"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")
    rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu")
    with zipfile.ZipFile(tmp_path / "it.fmu") as archive:
        assert any(name.endswith(".o") for name in archive.namelist())


def test_code_that_needs_what_platforms_round_in_their_own_ways_is_refused(monkeypatch):
    code = "declare double @sin(double)\n\ndefine double @step(double %x) {{\n%y = {}\nret double %y\n}}"
    monkeypatch.setattr(object_code, "_source", code.format)
    assert object_code._compile("fadd double %x, %x", this_platform(), "")
    with pytest.raises(BuildError, match="the compiled model needs sin"):
        object_code._compile("call double @sin(double %x)", this_platform(), "")


@pytest.mark.skipif(sys.platform == "win32", reason="a machine's own compiler makes no FMU there")
def test_ziglang_compiles_for_any_platform_and_a_machine_s_own_compiler_for_itself(monkeypatch):
    monkeypatch.setattr(platforms, "find_spec", lambda name: name)
    for one in PLATFORMS.values():
        assert platforms.compiler(one)[2:] == ["ziglang", "cc", "-target", one.zig]
        assert platforms.takes_minutes(one) == (one.suffix != ".so")
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    monkeypatch.setattr(platforms.shutil, "which", lambda name: f"/bin/{name}")
    for one in PLATFORMS.values():
        assert not platforms.takes_minutes(one)
        if one == this_platform():
            assert platforms.compiler(one)[0] == "/bin/cc"
        else:
            with pytest.raises(NoLinkerError):
                platforms.compiler(one)


def test_libraries_for_two_processors_of_macos_are_one():
    """By <mach-o/fat.h>: a table, big-endian, of processor, subtype, place, size and alignment; each at a page."""
    numbers = ((0x01000007, 3), (0x0100000C, 0))
    parts = [struct.pack("<III", 0xFEEDFACF, *number) + b"code" * n for number, n in zip(numbers, (7, 5), strict=True)]
    content = universal(parts)
    assert struct.unpack(">II", content[:8]) == (0xCAFEBABE, 2)
    for k, part in enumerate(parts):
        *number, place, size, align = struct.unpack(">5I", content[8 + 20 * k : 28 + 20 * k])
        assert (tuple(number), size, place % 2**align) == (numbers[k], len(part), 0)
        assert content[place : place + size] == part
    assert universal(parts[:1]) == parts[0]


def test_all_names_every_platform():
    assert [p.name for p in platforms_named(["all", "win64"])] == sorted(PLATFORMS)
    assert [p.name for p in platforms_named([])] == [this_platform().name]
    assert [p.name for p in platforms_named("win64")] == ["win64"]


def test_unknown_platforms_and_kinds_are_refused(tmp_path):
    with pytest.raises(BuildError, match="'linux32': expected one of linux64, win64"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms=["linux32"])
    with pytest.raises(BuildError, match="'linux32': expected one of linux64, win64"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms="linux32")
    for wrong, named in ((3, "3"), (["win64", 3], "3"), ([["win64"]], r"\['win64'\]")):
        with pytest.raises(BuildError, match=f"platform {named}: expected one of linux64, win64"):
            rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native", platforms=wrong)
    with pytest.raises(ValueError, match="'nativ': expected"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="nativ")


@pytest.mark.thorough
def test_what_the_c_compiler_says_is_in_the_message(tmp_path, monkeypatch):
    exported = b'__attribute__((visibility("default")))'
    layer = b"int unknown(void); %s int f(void) { return unknown(); }" % exported
    own = platforms.source
    monkeypatch.setattr(platforms, "source", lambda name: layer if name == FMI2.signatures else own(name))
    with pytest.raises(BuildError, match="unknown"):
        rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", kind="native")


@pytest.mark.parametrize(("platforms", "folders"), [
    (["linux64"], {"linux64": "linux64"}),
    (["linux-aarch64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux-aarch64"}),
    (["linux-aarch64", "linux64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux64"}),
    (["linux-aarch64", "win64"], {"aarch64-linux": "linux-aarch64", "linux64": "linux-aarch64", "win64": "win64"}),
])  # fmt: skip
def test_aarch64_lies_where_importers_look_unless_another_platform_does(platforms, folders, tmp_path, monkeypatch):
    """FMPy looks into binaries/linux64 on any Linux; FMI 2.0.5 has aarch64-linux."""
    monkeypatch.setattr(builder.object_code, "object_files", lambda kernels, platform: {})
    monkeypatch.setattr(builder.native, "link", lambda sources, objects, platform, *rest: platform.name.encode())
    path = rbfmu_fmu.build(scene("prescribed"), tmp_path / "it.fmu", "native", platforms)
    with zipfile.ZipFile(path) as archive:
        libraries = {name.split("/")[1]: archive.read(name) for name in archive.namelist() if "binaries/" in name}
    assert libraries == {folder: platform.encode() for folder, platform in folders.items()}


@pytest.mark.parametrize("platform", PLATFORMS)
@pytest.mark.parametrize("name", ["brick", "driven", "prescribed"])
@pytest.mark.slow
@needs_ziglang
def test_every_platform_is_built_the_same_each_time_with_the_model_once(name, platform, tmp_path):
    """Of its own format, with no second copy of the model's code."""
    paths = [rbfmu_fmu.build(scene(name), tmp_path / f"{k}.fmu", "native", [platform]) for k in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    with zipfile.ZipFile(paths[0]) as fmu:
        library, *_ = (n for n in fmu.namelist() if n.startswith("binaries/"))
        assert library.split("/")[1] == FMI2.folders[platform]
        assert fmu.read(library).startswith(FORMATS[platform])
        assert_nothing_superfluous(fmu, library, name, PLATFORMS[platform])


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
