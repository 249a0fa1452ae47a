"""A shared library from C and an object file: by the machine's own C compiler, or by ziglang for any platform."""

import shutil
import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from rbfmu_fmu.platforms import BuildError, Platform, this_platform

FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fno-asynchronous-unwind-tables"]
FLAGS += ["-shared", "-s"]
FORMAT_FLAGS = {
    ".so": ["-fPIC", "-Wl,--build-id=none,--gc-sections,-z,defs"],
    ".dylib": ["-fPIC"],
    ".dll": ["-D__USE_MINGW_ANSI_STDIO=0"],  # else MinGW's own printf is linked in, 50 kB
}


class NoLinkerError(BuildError):
    """There is no C compiler for a platform."""


class LinkError(BuildError):
    """The compiler failed: with what it said."""


def link(folder: Path, sources: list[str], includes: list[Path], library: str, platform: Platform) -> None:
    """Make a shared library of sources in a folder: it exports what they export, stripped, the same bytes each time."""
    command = [*compiler(platform), *FLAGS, *FORMAT_FLAGS[platform.suffix], *[f"-I{place}" for place in includes]]
    done = subprocess.run(
        [*command, *sources, "-lm", "-o", library], capture_output=True, text=True, cwd=folder, check=False
    )
    if done.returncode:
        raise LinkError(f"{platform.name}: {command[0]} failed:\n{done.stderr.strip()}")


def compiler(platform: Platform) -> list[str]:
    """The command that compiles C for a platform. Raises NoLinkerError."""
    own = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if own and sys.platform != "win32" and platform == this_platform():
        return [own, "-Wl,-z,noseparate-code"] if platform.suffix == ".so" else [own]  # 8 kB less
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", platform.zig]
    remedy = 'pip install "rbfmu[native]" (ziglang, compiles for every platform)'
    own_remedy = ", or a C compiler on PATH (cc, gcc or clang)" if platform == this_platform() else ""
    raise NoLinkerError(f"a native FMU for {platform.name} needs {remedy}{own_remedy}")


def universal(libraries: list[bytes]) -> bytes:
    """One library for macOS from one or two of its processors (Mach-O; magic numbers of <mach-o/fat.h>)."""
    if len(libraries) == 1:
        return libraries[0]
    align, place, header, body = 14, 1 << 14, struct.pack(">II", 0xCAFEBABE, len(libraries)), b""
    for library in libraries:
        processor = library[4:12][::-1]  # subtype, type: big-endian here
        body += bytes(-len(body) % place)
        header += processor[4:] + processor[:4] + struct.pack(">III", place + len(body), len(library), align)
        body += library
    return header.ljust(place, b"\0") + body
