"""What the bits of an ensemble rest on besides its scene and its plan."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rbfmu_kernels.compile.stamp import SOURCES, hash_of_sources

PACKAGES = ("ensembles", "runs", "scene")
"""Parts of this package by which members are drawn and run."""
LIBRARIES = ("numpy", "scipy")
"""Packages that drawn numbers rest on."""


@cache
def origin() -> dict[str, str]:
    """Return hashes of sources and versions of libraries by their names: the same bits are made where all are equal."""
    here = Path(__file__).parents[1]
    sources = {f"rbfmu.{name}": hash_of_sources(here / name) for name in PACKAGES}
    return {"rbfmu_kernels": SOURCES} | sources | {name: _version(name) for name in LIBRARIES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
