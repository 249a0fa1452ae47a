"""Where things stand in the checkout."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "examples" / "scenes"
C_SOURCES = Path(__file__).parent / "fmu"
SOURCE_ROOTS = [str(ROOT / part) for part in (".", "kernels", "fmu_build")]
SHARED = ROOT.parent / "shared" / "reference"
"""Data that a clone does not have; tests of it skip."""
if "RBFMU_TESTS" not in os.environ:
    os.environ["RBFMU_TESTS"] = tempfile.mkdtemp(prefix="rbfmu-tests-")
    atexit.register(shutil.rmtree, os.environ["RBFMU_TESTS"], ignore_errors=True)
SHARED_BY_WORKERS = Path(os.environ["RBFMU_TESTS"])
"""A folder for what one worker of a session makes and all use; who comes first, the session, makes and removes it."""


def of_a_session(**more: str) -> dict[str, str]:
    """Return the environment of a session of tests that is started here: it makes FMUs of its own."""
    return {name: value for name, value in os.environ.items() if name != "RBFMU_TESTS"} | more


def with_sources(**more: str) -> dict[str, str]:
    """Return the environment of a program that is started here and finds these sources."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(SOURCE_ROOTS)} | more
