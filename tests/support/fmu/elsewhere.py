"""Modules of the tests for a process in which neither the checkout nor rbfmu is on the path."""

import shutil
from pathlib import Path

from tests.support.paths import ROOT

PARTS = ["__init__", "support/__init__", "support/fmu/__init__"]


def copy_modules(folder, *names):
    """Copy modules of tests.support.fmu there, so that `python -m tests.support.fmu.NAME` runs in that folder."""
    for name in [*PARTS, *(f"support/fmu/{n}" for n in names)]:
        target = Path(folder, "tests", f"{name}.py")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "tests" / f"{name}.py", target)
