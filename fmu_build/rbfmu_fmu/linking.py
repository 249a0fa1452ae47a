"""A shared library from C and an object file: by the machine's own C compiler, or by ziglang for any platform."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

from rbfmu_fmu.platforms import BuildError, Platform, this_platform

FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"]


class NoLinkerError(BuildError):
    """There is no C compiler for a platform."""


class LinkError(BuildError):
    """The compiler failed: with what it said."""


def link(sources: list[Path], includes: list[Path], library: Path, platform: Platform) -> None:
    """Write a shared library that exports what the C sources export, stripped, the same bytes each time."""
    command = [*compiler(platform), *FLAGS, *_format_flags(platform), *[f"-I{folder}" for folder in includes]]
    done = subprocess.run(
        [*command, *map(str, sources), "-lm", "-o", str(library)],
        capture_output=True, text=True, cwd=library.parent, check=False,
    )  # fmt: skip
    if done.returncode:
        raise LinkError(f"{platform.name}: {command[0]} failed:\n{done.stderr.strip()}")


def compiler(platform: Platform) -> list[str]:
    """The command that compiles C for a platform. Raises NoLinkerError."""
    own = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if own and sys.platform != "win32" and platform == this_platform():
        return [own]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", platform.zig]
    remedy = 'pip install "rbfmu[native]" (ziglang, compiles for every platform)'
    own_remedy = ", or a C compiler on PATH (cc, gcc or clang)" if platform == this_platform() else ""
    raise NoLinkerError(f"a native FMU for {platform.name} needs {remedy}{own_remedy}")


def _format_flags(platform: Platform) -> list[str]:
    if platform.suffix == ".so":
        return ["-fPIC", "-Wl,--build-id=none,--gc-sections,-z,defs"]
    return ["-fPIC"] if platform.suffix == ".dylib" else []
