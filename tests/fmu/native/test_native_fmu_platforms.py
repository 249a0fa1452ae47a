"""One result everywhere: native FMUs of other platforms, run by an emulator, give the kernels' bits (`make platforms`).

Linux on aarch64 under qemu-aarch64 (Debian: qemu-user, libc6-arm64-cross), Windows under Wine (wine64). Each scene has
another of the kernels' units. macOS: only built, see test_native_fmu_compilers.py.
"""

import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import rbfmu_fmu
from rbfmu_fmu.description import describe
from rbfmu_fmu.native.platforms import PLATFORMS
from tests.fmu.native.test_native_fmu_build import needs_ziglang
from tests.support.fmu.fmus import Kernels, planned, scene, unzipped_at, workshop
from tests.support.paths import C_SOURCES, SCENES

pytestmark = [pytest.mark.slow, needs_ziglang]
STEPS, SIZE = 500, 0.01
NAMES = ["driven", "prescribed", "default", *sorted(path.stem for path in SCENES.rglob("*.toml"))]
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")


def emulator(platform):
    """The command that runs a program of another platform; skips where there is none."""
    if platform == "linux64":
        return []
    if platform == "linux-aarch64":
        command = shutil.which("qemu-aarch64") or pytest.skip("no qemu-aarch64: apt install qemu-user")
        if not ARM_LIBRARIES.is_dir():
            pytest.skip(f"no {ARM_LIBRARIES}: apt install libc6-arm64-cross")
        return [command, "-L", str(ARM_LIBRARIES)]
    places = ["wine64", "wine", "/usr/lib/wine/wine64"]
    return [next(filter(None, map(shutil.which, places)), None) or pytest.skip("no Wine: apt install wine64")]


@cache
def host(platform):
    """The importer in C."""
    program = workshop() / f"host-{platform}.exe"
    command = [sys.executable, "-m", "ziglang", "cc", "-target", PLATFORMS[platform].zig, "-std=gnu11", "-O1"]
    subprocess.run([*command, C_SOURCES / "fmu_host.c", "-o", program], check=True, capture_output=True)
    return program


def variables(name, causality):
    """Names."""
    return [v.name for v in describe(scene(name), planned(name)).variables if v.causality == causality]


def rows_on(platform, name, **version):
    """Outputs at each step of four lives."""
    path = workshop() / f"{name}-{platform}-{len(version)}.fmu"
    rbfmu_fmu.build(scene(name), path, "native", [platform], **version)
    folder = unzipped_at(path, path.with_suffix(""))
    library, *_ = sorted(folder.glob("binaries/*/*"))
    inputs, parameters, outputs = (len(variables(name, c)) for c in ("input", "parameter", "output"))
    guid = re.search(r'(guid|instantiationToken)="([^"]*)"', (folder / "modelDescription.xml").read_text())[2]
    command = [*emulator(platform), host(platform), library, guid, "", STEPS, SIZE, inputs, inputs + parameters]
    environment = os.environ | {"WINEPREFIX": str(workshop() / "wine"), "WINEDEBUG": "-all"}
    done = subprocess.run([*map(str, command), str(outputs), "1"], env=environment, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return [list(map(float.fromhex, line.split())) for line in done.stdout.decode().splitlines() if "x" in line]


def rows_of_kernels(name):
    kernels, inputs, rows = Kernels(name), variables(name, "input"), []
    for k in range(STEPS):
        kernels.set({n: 0.125 * ((k + i) % 8 - 4) for i, n in enumerate(inputs)})
        kernels.step(SIZE)
        rows.append(kernels.outputs())
    return rows


@pytest.mark.parametrize("platform", ["linux64", "linux-aarch64", "win64"])
@pytest.mark.parametrize("name", NAMES)
def test_every_platform_gives_the_kernels_bits(name, platform):
    emulator(platform)
    assert rows_on(platform, name) == rows_of_kernels(name) * 4


@pytest.mark.parametrize("platform", ["linux64", "linux-aarch64", "win64"])
@pytest.mark.parametrize("name", ["driven", "prescribed", "default"])
def test_every_platform_gives_them_by_fmi_3(name, platform):
    emulator(platform)
    assert rows_on(platform, name, fmi=3, scalars=True) == rows_of_kernels(name) * 4
