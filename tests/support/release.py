"""`make release`: wheel and source archive in `dist`, checked, and each tried where nothing else is installed.

Each is installed with the lowest and the newest Python found here. There `rbfmu demo` passes, with no more than
rbfmu depends on, and then TESTS, from a copy that has no sources of the product.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.ranges import PYTHONS, python_of, tested, uv

COPIED = ("tests", "examples", "pyproject.toml")
TESTS = (
    "tests/kernels/rotations/test_quaternion.py", "tests/library/scene/test_scene.py",
    "tests/library/runs/test_simulation.py", "tests/library/ensembles/test_chunks.py", "tests/fmu/test_verification.py",
    "tests/project/command_line/test_cli.py",
)  # fmt: skip


def archives(folder: Path) -> list[Path]:
    """Return wheel and source archive, new in this folder; CalledProcessError where they or what they say is wrong."""
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "build", "--outdir", folder], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    found = sorted(folder.iterdir())
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *found], check=True)
    return found


def passes(version: str, archive: Path, folder: Path) -> bool:
    """Return whether demo and tests pass of an archive that is installed in this folder."""
    python, copy = folder / "venv" / "bin" / "python", folder / "copy"
    uv("venv", str(python.parents[1]), python=Path(str(python_of(version))))
    uv("pip", "install", str(archive), python=python)
    copy.mkdir()
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "compiled")}
    if subprocess.run([python.with_name("rbfmu"), "demo"], cwd=copy, env=environment).returncode:
        return False
    uv("pip", "install", f"rbfmu[test] @ {archive.as_uri()}", python=python)
    for name in COPIED:
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
    return tested(python, TESTS, copy)


def main() -> int:
    """Print a line for each archive and Python at the end, together."""
    here = [version for version in PYTHONS if python_of(version)]
    lines, wrong = [], 0
    for archive in archives(ROOT / "dist"):
        for version in dict.fromkeys((here[0], here[-1])):
            with tempfile.TemporaryDirectory(prefix="rbfmu_release_") as folder:
                well = passes(version, archive, Path(folder))
            lines.append(f"{archive.name}, Python {version}: {'passed' if well else 'FAILED'}")
            wrong += not well
    print("\n".join(lines))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
