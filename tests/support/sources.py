"""A copy of the product's sources, to be changed and run in processes of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

PACKAGES = ("rbfmu", "kernels", "fmu_build")


def copy_sources(folder: Path) -> None:
    """Copy the product's packages, and the licence, which FMUs carry."""
    shutil.copy(ROOT / "LICENSE", folder)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))


def run_copy(folder: Path, code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run code in a process that imports the product from a copy, and nothing of it from here; all compiles anew."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(folder / part) for part in ("", "kernels", "fmu_build")),
        "NUMBA_CACHE_DIR": str(folder / "cache"),
    }
    code = f"import rbfmu_kernels; assert rbfmu_kernels.__file__.startswith({str(folder)!r})\n{code}"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, cwd=folder)


def assert_same_in_plain_python(code: str, different: int) -> None:
    """Assert that a program prints the same compiled and not, and so many different words."""
    found = [
        subprocess.run([sys.executable, "-c", code], env=os.environ | {"NUMBA_DISABLE_JIT": flag}, cwd=ROOT, check=True,
                       capture_output=True, text=True).stdout for flag in ("0", "1")
    ]  # fmt: skip
    assert found[0] == found[1]
    assert len(set(found[0].split())) == different
