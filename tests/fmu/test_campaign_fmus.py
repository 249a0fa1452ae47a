"""The campaign drives units without FMI; here a few dozen settings go through FMUs of both kinds, to the same bits."""

import numpy as np
import pytest

import rbfmu_fmu
from rbfmu.planning.select import plan
from rbfmu.scene.scene import SceneError
from tests.support.fmu.fmu_importer import Fmu
from tests.support.fmu.fmus import unzipped_at
from tests.support.quadruple import reference
from tests.support.quadruple.campaign import FAILED, offered_by, verdict_of
from tests.support.quadruple.driving import Outcome, seen, true_motion
from tests.support.quadruple.errors import errors
from tests.support.quadruple.importing import seen_by_importer
from tests.support.quadruple.scenes import random_scene
from tests.support.quadruple.settings import random_settings

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision"),
]


@pytest.mark.parametrize("kind", ["python", "native"])
@pytest.mark.parametrize("seed", range(700_000, 700_018))
def test_an_fmu_answers_as_the_unit_and_rightly(kind, seed, tmp_path):
    try:
        _, scene = random_scene(seed)
        planned = plan(scene)
    except SceneError as error:
        pytest.skip(f"no plan: {error}")
    fmu = Fmu(unzipped_at(rbfmu_fmu.build(scene, tmp_path / "it.fmu", kind), tmp_path / "it"))
    offered = offered_by(scene, planned)
    for label, setting in random_settings(seed, scene, offered):
        refused, rows = seen(scene, planned, setting)
        said, got = seen_by_importer(fmu, scene, setting)
        assert bool(refused) == bool(said), (label, setting, refused, said)
        assert all(np.array_equal(got[name], values) for name, values in rows.items()), (label, setting)
        found = Outcome(said) if said else Outcome("", errors(got, true_motion(scene, setting)))
        verdict, _, text = verdict_of(scene, setting, found)
        assert verdict not in FAILED, (label, setting, text)
