"""The platforms for which FMUs are compiled, by name, and how C sources and object files are linked for each.

ziglang links for any platform; without it, the machine's own C compiler links for this platform.
"""

import shutil
import struct
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from platform import machine

from rbfmu.extras import remedy

FMI_HEADERS = Path(str(find_spec("fmpy").origin)).parent / "c-code"  # type: ignore[union-attr]
"""The folder of FMI's headers, as FMPy ships them; FMPy is not imported for them."""

HEADERS = ("cosimulation.h", "instance.h", "model.h")
"""The headers of `native/`, which are in the folder of every C source when it is compiled."""

ANY_VERSION = ("values.c", "steps.c", "derivatives.c", "messages.c", "saved_states.c")
"""The C sources of an FMU that are the same for all versions of FMI."""

# The C layer rounds as the kernels do: without -ffp-contract=off a compiler may fuse a * b + c, which rounds once where
# two operations round twice, and a processor with fused products would give other bits than one without (C11 6.5,
# paragraph 8). Hidden symbols keep two FMUs in one process apart: only the functions of FMI are found by name, so that
# neither calls the other's `step`. No unwind tables, as nothing here throws.
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fno-asynchronous-unwind-tables"]
FLAGS += ["-shared", "-s"]

_ZIG = "ziglang"


class BuildError(ValueError):
    """The error of an FMU that cannot be built here, with the reason."""


class NoLinkerError(BuildError):
    """The error of a platform without a C compiler, or with one that fails."""


@dataclass(frozen=True)
class Platform:
    """A triple and a processor for LLVM, a target for ziglang, further FLAGS, and the suffix of a shared library."""

    name: str
    triple: str
    cpu: str
    zig: str
    flags: str
    suffix: str
    features: tuple[str, ...]
    """Features of newer processors; for each there is another step function, chosen at run time (native/model.h)."""


_ROWS = tomllib.loads(Path(__file__).with_name("platforms.toml").read_text(encoding="utf-8"))
PLATFORMS = {name: Platform(name, **row | {"features": tuple(row["features"])}) for name, row in _ROWS.items()}


def platforms_named(names: str | Iterable[str]) -> list[Platform]:
    """Return the platforms with these names, or this name, in a fixed order; "all" names every one.

    Without names, this platform is returned. Raises BuildError for an unknown name.
    """
    listed = [*names] if isinstance(names, Iterable) and not isinstance(names, str) else [names]
    for name in listed:
        if name not in [*PLATFORMS, "all"]:
            raise BuildError(f"platform {name!r}: expected one of {', '.join(PLATFORMS)}, all")
    chosen = {name for given in listed for name in (PLATFORMS if given == "all" else [given])}
    return [PLATFORMS[name] for name in sorted(chosen)] or [this_platform()]


def this_platform() -> Platform:
    """Return the platform on which Python runs. Raises BuildError if it is not in PLATFORMS."""
    if found := next(filter(is_this, PLATFORMS.values()), None):
        return found
    raise BuildError(f"{_this_target()} is no platform for FMUs: name one of {', '.join(PLATFORMS)}")


def is_this(platform: Platform) -> bool:
    """Return whether Python runs on this platform."""
    return platform.zig.startswith(_this_target())


def _this_target() -> str:
    """Return processor and system, named as by ziglang."""
    name = machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(name, name)
    return f"{processor}-{ {'darwin': 'macos', 'win32': 'windows'}.get(sys.platform, sys.platform) }"


def link(
    layer: Sequence[str], objects: dict[str, bytes], platform: Platform, name: str,
    includes: dict[str, str] | None = None,
) -> bytes:  # fmt: skip
    """Link object files and C sources of `native/` to a stripped shared library, with the same bytes each time.

    layer: names of the C sources; objects: contents by file name; name: that of the library, without its suffix;
    includes: generated C headers by file name, and headers that replace those of `native/`. Raises BuildError.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="rbfmu_") as place:
            folder, library = Path(place), f"{name}{platform.suffix}"
            contents = {f: source(f) for f in (*layer, *HEADERS)} | objects
            contents |= {include: text.encode("ascii") for include, text in (includes or {}).items()}
            for file, content in contents.items():
                (folder / file).write_bytes(content)
            command = [*compiler(platform), *FLAGS, *platform.flags.split(), f"-I{FMI_HEADERS}"]
            command += [*layer, *objects, "-lm", "-o", library]
            done = subprocess.run(
                command, capture_output=True, cwd=folder, check=False, encoding="utf-8", errors="replace"
            )
            if done.returncode:  # a machine's compiler may lack C's headers, as Debian's gcc does without more packages
                failed = f"{platform.name}: {command[0]} failed:\n{done.stderr.strip()}"
                raise BuildError(failed) if _ZIG in command else NoLinkerError(f"{failed}\n{_needed(platform)}")
            return (folder / library).read_bytes()
    except OSError as error:  # a full disk, or no further process
        where = f"in a temporary folder ({error}): TMPDIR names another"
        raise BuildError(f"{platform.name}: cannot be linked {where}") from None


def source(name: str) -> bytes:
    """Return the content of a C source or header of `native/`."""
    return Path(__file__).with_name(name).read_bytes()


def compiler(platform: Platform) -> list[str]:
    """Return the command that compiles C for a platform. Raises NoLinkerError if there is none.

    ziglang is preferred: it has the same compiler and C library on every machine, so that the bytes are the same too.
    """
    if find_spec(_ZIG):
        return [sys.executable, "-m", _ZIG, "cc", "-target", platform.zig]
    own = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if own and sys.platform != "win32" and is_this(platform):
        return [own, "-Wl,-z,noseparate-code"] if platform.suffix == ".so" else [own]  # 8 kB less
    raise NoLinkerError(_needed(platform))


def _needed(platform: Platform) -> str:
    needed = f"{remedy('native')} (ziglang, compiles for every platform)"
    own = ", or a C compiler on PATH (cc, gcc or clang) with its headers" if is_this(platform) else ""
    return f"a native FMU for {platform.name} needs {needed}{own}"


def takes_minutes(platform: Platform) -> bool:
    """Return whether ziglang first compiles a C library, which takes minutes, once; for Linux it takes seconds."""
    try:
        return _ZIG in compiler(platform) and platform.suffix != ".so"
    except NoLinkerError:  # linking will raise it again
        return False


def universal(libraries: list[bytes]) -> bytes:
    """Return libraries for one or two processors of macOS joined into one (Mach-O, by <mach-o/fat.h>)."""
    if len(libraries) == 1:
        return libraries[0]
    align, place, header, body = 14, 1 << 14, struct.pack(">II", 0xCAFEBABE, len(libraries)), b""
    for library in libraries:
        processor = library[4:12][::-1]  # (subtype, type), converted to big-endian
        body += bytes(-len(body) % place)
        header += processor[4:] + processor[:4] + struct.pack(">III", place + len(body), len(library), align)
        body += library
    return header.ljust(place, b"\0") + body
