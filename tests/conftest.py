"""Compiled kernels are cached by a hash of all kernel sources: numba itself looks only at a function's own file.

What many tests use stands here too.
"""

import hashlib
import os
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from rbfmu_fmu.native.platforms import NoLinkerError
from tests.support.compilers import can_link
from tests.support.covering import mark_what_a_covering_set_leaves
from tests.support.paths import ROOT


def _hash_of_kernels() -> str:
    digest = hashlib.sha256()
    for path in sorted((ROOT / "kernels").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


os.environ.setdefault("NUMBA_CACHE_DIR", str(Path(tempfile.gettempdir()) / f"rbfmu-numba-{_hash_of_kernels()}"))

os.environ.setdefault("RBFMU_QUIET", "1")  # what is said of slow compilations hangs on the cache and the load

os.environ |= {"COLUMNS": "80", "TERM": "xterm"}  # what is printed would else hang on the terminal that tests run in
for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
    os.environ.pop(name, None)

settings.register_profile("unhurried", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("unhurried")


@pytest.hookimpl(tryfirst=True)  # before those that are marked are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave of cross products of parameters what covers each value; begin with what takes longest.

    Tests of the project start whole programs, few in a file: at the end they would leave all workers but one idle.
    """
    mark_what_a_covering_set_leaves(items)
    items.sort(key=lambda item: ROOT / "tests" / "project" not in item.path.parents)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """Skip what builds a native FMU on a machine that can link none."""
    try:
        return (yield)
    except NoLinkerError:
        if can_link():
            raise
        pytest.skip("no C compiler")
