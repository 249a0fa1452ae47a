"""The ensemble that tests of runs and of stores have in common, and its runs, made once for each of their files."""

import pytest

from tests.support.ensembles.satellite import run, satellite


@pytest.fixture(scope="module")
def scene():
    return satellite()


@pytest.fixture(scope="module")
def whole(scene):
    return run(scene, executor=1)
