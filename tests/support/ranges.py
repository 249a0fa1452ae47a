"""`make ranges`: the tests below with the lowest and the newest of all that rbfmu depends on, in fresh environments.

`python -m tests.support.ranges [lowest|newest] [3.11 3.12 ...] [tests/...]` takes some of them. What is lowest stands
in pyproject.toml alone: uv resolves it (`--resolution lowest-direct`). Every Python of PYTHONS that is found here is
taken; the others are named.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.paths import ROOT, of_a_session

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
TESTS = (
    "tests/kernels/compile",
    "tests/kernels/models/test_loaded_taylor_lanes.py",
    "tests/kernels/rotations/test_quaternion.py",
    "tests/library/arrays/test_array_functions.py",
    "tests/library/formulas/test_events.py",
    "tests/library/formulas/test_scenes.py",
    "tests/library/scene/test_scene.py",
    "tests/library/runs/test_simulation.py",
    "tests/library/planning/test_smallest_model.py",
    "tests/library/ensembles/test_chunks.py",
    "tests/library/ensembles/test_events.py",
    "tests/library/ensembles/test_result.py",
    "tests/fmu/test_any_kind.py",
    "tests/fmu/python/test_python_fmu.py",
    "tests/fmu/python/test_fmu_traps.py",
    "tests/fmu/native/test_native_fmu.py",
    "tests/fmu/native/test_native_fmu_build.py",
    "tests/fmu/native/test_native_fmu_compilers.py",
    "tests/fmu/test_verification.py",
    "tests/project/command_line/test_cli.py",
)
SHOWN = ("numba", "llvmlite", "numpy", "fmpy", "pythonfmu", "matplotlib", "click", "rich")


def python_of(version: str) -> str | None:
    """Return an interpreter of a version of Python on this machine, on PATH or of pyenv."""
    pyenv = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for path in filter(None, [shutil.which(f"python{version}"), *map(str, pyenv)]):
        asked = [path, "-c", "import sys; print(*sys.version_info[:2], sep='.')"]
        if subprocess.run(asked, capture_output=True, text=True).stdout.strip() == version:
            return path
    return None


def uv(*arguments: str, python: Path) -> str:
    """Return what uv prints; CalledProcessError where it fails."""
    command = [sys.executable, "-m", "uv", "--quiet", *arguments, "--python", str(python)]
    return subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout


def install(python: str, resolution: str, folder: Path) -> Path:
    """Return the interpreter of a new environment with rbfmu and its tests' packages, none of them compiled here."""
    uv("venv", str(folder), python=Path(python))
    installed = folder / "bin" / "python"
    options = "--resolution", RESOLUTIONS[resolution], "--only-binary", ":all:", "--no-binary", "rbfmu"
    uv("pip", "install", *options, "--editable", ".[dev]", python=installed)
    return installed


def versions(python: Path) -> str:
    """Return what is installed of SHOWN."""
    found = dict(line.split("==") for line in uv("pip", "freeze", python=python).splitlines() if "==" in line)
    return ", ".join(f"{name} {found[name]}" for name in SHOWN)


def tested(python: Path, tests: Sequence[str], folder: Path) -> bool:
    """Return whether these tests of a checkout pass; older packages may use what newer ones warn of."""
    command = [str(python), "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "not slow"]
    command += ["-W", "ignore::DeprecationWarning", *tests]
    environment = of_a_session(NUMBA_CACHE_DIR=str(python.parents[1] / "compiled"))
    return subprocess.run(command, cwd=folder, env=environment).returncode == 0


def typed(python: Path) -> bool:
    """Return whether mypy passes: what NumPy says of its types changes with its version."""
    return subprocess.run([str(python), "-m", "mypy"], cwd=ROOT).returncode == 0


def unknown(wanted: Sequence[str]) -> list[str]:
    """Return what is no resolution, no version of Python and no test."""
    return [word for word in wanted if word not in (*RESOLUTIONS, *PYTHONS) and word not in tests_of(wanted)]


def tests_of(wanted: Sequence[str]) -> list[str]:
    """Return the files and folders of tests that are asked for."""
    return [word for word in wanted if word.startswith("tests/") and (ROOT / word).exists()]


def results(wanted: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Give a line for each environment, and whether all is well there."""
    resolutions = [name for name in RESOLUTIONS if name in wanted] or [*RESOLUTIONS]
    tests = tests_of(wanted) or TESTS
    for version in [v for v in PYTHONS if v in wanted] or PYTHONS:
        path = python_of(version)
        if path is None:
            yield f"Python {version}: not on this machine, not tried", True
            continue
        for resolution in resolutions:
            with tempfile.TemporaryDirectory(prefix="rbfmu_ranges_") as folder:
                python = install(path, resolution, Path(folder) / "venv")
                well = tested(python, tests, ROOT) and (resolution != "newest" or typed(python))
                verdict = "passed" if well else "FAILED"
                yield f"Python {version}, {resolution}: {verdict} with {versions(python)}", well


def main(wanted: Sequence[str]) -> int:
    """Print the lines at the end, together."""
    if wrong := unknown(wanted):
        expected = f"{', '.join(RESOLUTIONS)}, {', '.join(PYTHONS)} or files of tests"
        print(f"{', '.join(wrong)}: expected of {expected}", file=sys.stderr)
        return 2
    found = list(results(wanted))
    print("\n".join(line for line, _ in found))
    return 0 if all(well for _, well in found) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
