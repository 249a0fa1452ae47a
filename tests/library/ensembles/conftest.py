"""The ensemble that tests of runs and of stores have in common, and its runs, made once for each of their files."""

import pytest

from rbfmu.ensembles.planning import plan_ensemble
from tests.support.ensembles.satellite import run, satellite


@pytest.fixture(scope="module")
def scene():
    return satellite()


@pytest.fixture(scope="module")
def whole(scene):
    return run(scene, executor=1)


@pytest.fixture(scope="module")
def planned(scene):
    """The plan of a module's own scene."""
    return plan_ensemble(scene)
