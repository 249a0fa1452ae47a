"""`initialize` and `step`, made once for all models: each runs its own model, and is found again on disk."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import config

from rbfmu.models.registry import MODELS
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body import shell
from rbfmu_kernels.buffer import STEP_REJECTED
from tests.support.scenes.scene_tables import SMALLEST

TWO = ("unturned.NO_ROTATION", "free.CONSTANT_RATE")
STEPS = f"""
import json
import numpy as np
from rbfmu_kernels.models import model_named
from rbfmu_kernels.quantities import active_flags
found = {{}}
for model in map(model_named, {TWO}):
    z = np.zeros(model.SIZE)
    values = {{"mass": 1.0, "inertia": [2.0, 2.0, 2.0, 0.0, 0.0, 0.0], "quaternion_0": [1.0, 0.0, 0.0, 0.0]}}
    values |= {{"omega_b_0": [0.0, 0.0, 3.0], "skip_model_checks": 1.0, "active": active_flags(["quaternion"])}}
    for name, value in values.items():
        z[model.BLOCKS[name]] = value
    assert model.initialize(z) == 0 and model.step(z, 0.5) == 0
    stats = [getattr(model, entry).stats for entry in ("initialize", "step")]
    counts = [[sum(s.cache_hits.values()), sum(s.cache_misses.values())] for s in stats]
    found[model.name] = [z[model.BLOCKS["quaternion"]].tolist(), counts]
print(json.dumps(found))
"""


@pytest.mark.thorough
@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs the compiler")
def test_a_second_process_finds_each_models_own_functions_in_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    first, second = (
        json.loads(subprocess.run([sys.executable, "-c", STEPS], capture_output=True, text=True, check=True).stdout)
        for _ in range(2)
    )
    rest, turned = TWO
    for found, counts in ((first, [[0, 1]] * 2), (second, [[1, 0]] * 2)):
        assert found[rest] == [[1.0, 0.0, 0.0, 0.0], counts]
        np.testing.assert_allclose(found[turned][0], [np.cos(0.75), 0.0, 0.0, np.sin(0.75)], rtol=1e-15)
        assert found[turned][1] == counts


@pytest.mark.parametrize("name", MODELS)
def test_entry_functions_bear_the_name_of_their_model(name: str) -> None:
    model = MODELS[name].kernels
    module, _, constant = model.name.partition(".")
    assert model.initialize.__module__ == model.step.__module__ == f"rbfmu_kernels.models.{module}"
    assert model.step.__qualname__ == f"{constant}.step"
    assert getattr(sys.modules[model.step.__module__], constant) is model
    assert model.step.__doc__ == shell.step.__doc__


@pytest.mark.parametrize("h", [0.0, -0.1, float("nan")])
def test_a_step_that_is_not_positive_never_reaches_the_model(h: float) -> None:
    z = filled_buffer(Scene.from_dict(SMALLEST), Plan("no rotation", "", 0, pinned=("all",)))
    no_rotation = MODELS["no rotation"].kernels
    assert no_rotation.initialize(z) == 0
    before = z.copy()
    assert no_rotation.step(z, h) == STEP_REJECTED
    assert np.array_equal(z, before, equal_nan=True)


def test_a_body_that_is_refused_is_not_set_up() -> None:
    z = filled_buffer(Scene.from_dict(SMALLEST), Plan("no rotation", "", 0, pinned=("all",)))
    no_rotation = MODELS["no rotation"].kernels
    z[no_rotation.BLOCKS["mass"]] = -1.0
    before = z.copy()
    assert no_rotation.initialize(z) == 1
    assert np.array_equal(z, before)
