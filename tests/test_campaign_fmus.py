"""The campaign drives units without FMI; here a few dozen settings go through FMUs of both kinds, to the same bits."""

import numpy as np
import pytest
from fmu_importer import Fmu
from fmus import unzipped_at
from quadruple import reference
from quadruple.campaign import FAILED, offered_by, verdict_of
from quadruple.driving import Outcome, seen, true_motion
from quadruple.errors import errors
from quadruple.importing import seen_by_importer
from quadruple.scenes import random_scene
from quadruple.settings import random_settings

import rbfmu_fmu
from rbfmu.planning import plan
from rbfmu.scene import SceneError

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
