"""A plugin of pytest for `mutants reach`: which test runs which lines of the product in its own process."""

import os

import coverage

from tests.support.paths import ROOT

_COVERAGE = coverage.Coverage(
    os.environ["COVERAGE_FILE"],
    data_suffix=True,
    source=[str(ROOT / part) for part in ("rbfmu", "fmu_build")],
    config_file=False,
)


def pytest_sessionstart() -> None:
    _COVERAGE.start()


def pytest_runtest_logstart(nodeid: str) -> None:
    _COVERAGE.switch_context(nodeid)


def pytest_sessionfinish() -> None:
    _COVERAGE.stop()
    _COVERAGE.save()
