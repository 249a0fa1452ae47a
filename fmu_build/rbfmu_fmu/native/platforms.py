"""The platforms that a native FMU can be built for, by name."""

import platform
import sys
from collections.abc import Iterable
from dataclasses import dataclass


class BuildError(ValueError):
    """An FMU that cannot be built here, and why."""


@dataclass(frozen=True)
class Platform:
    """A triple and a processor for LLVM, a target for ziglang, and the suffix of a shared library."""

    name: str
    triple: str
    cpu: str
    zig: str
    suffix: str
    features: tuple[str, ...] = ()
    """What newer processors have: for each there is one more step, which is chosen at run time (native/model.h)."""


PLATFORMS = {
    p.name: p
    for p in (
        Platform("linux64", "x86_64-unknown-linux-gnu", "x86-64", "x86_64-linux-gnu.2.17", ".so", ("avx2",)),
        Platform("win64", "x86_64-pc-windows-gnu", "x86-64", "x86_64-windows-gnu", ".dll", ("avx2",)),
        Platform("darwin64", "x86_64-apple-macosx11.0.0", "x86-64", "x86_64-macos.11.0", ".dylib",
                 ("avx2",)),
        Platform("linux-aarch64", "aarch64-unknown-linux-gnu", "generic", "aarch64-linux-gnu.2.17", ".so"),
        Platform("darwin-aarch64", "arm64-apple-macosx11.0.0", "apple-m1", "aarch64-macos.11.0", ".dylib"),
    )
}  # fmt: skip
"""Processors are the oldest of their kind. No code has fused products, so that all give the same bits."""


def platforms_named(names: Iterable[str]) -> list[Platform]:
    """Return platforms by their names, in an order; "all" names every one; without names this one.

    Raises BuildError where there is none of a name.
    """
    chosen = {name for given in names for name in (PLATFORMS if given == "all" else [given])}
    if unknown := sorted(chosen.difference(PLATFORMS)):
        raise BuildError(f"platform {unknown[0]!r}: expected one of {', '.join(PLATFORMS)}, all")
    return [PLATFORMS[name] for name in sorted(chosen)] or [this_platform()]


def this_platform() -> Platform:
    """Return the platform that Python runs on. Raises BuildError where it is none of the above."""
    if found := next(filter(is_this, PLATFORMS.values()), None):
        return found
    raise BuildError(f"{_here()} is no platform for FMUs: name one of {', '.join(PLATFORMS)}")


def is_this(one: Platform) -> bool:
    """Return whether Python runs on this platform."""
    return one.zig.startswith(_here())


def _here() -> str:
    """Return processor and system, as ziglang names them."""
    machine = platform.machine().lower()
    processor = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{processor}-{ {'darwin': 'macos', 'win32': 'windows'}.get(sys.platform, sys.platform) }"
