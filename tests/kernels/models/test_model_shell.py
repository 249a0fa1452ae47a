"""What models are made of: `initialize` and `step`, made once for all, and named tuples in their buffers."""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import config, njit

from rbfmu.models.registry import MODELS
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body import shell
from rbfmu_kernels.buffer import STEP_REJECTED
from rbfmu_kernels.buffer_access import record
from rbfmu_kernels.types import Vec3
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


@pytest.mark.slow
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


# Named tuples in flat buffers


class Inner(NamedTuple):
    high_and_low: tuple[float, float]
    sign: float


class Outer(NamedTuple):
    kind: float
    inner: Inner
    axis: Vec3


VALUE = Outer(1.0, Inner((2.0, 3.0), 4.0), (5.0, 6.0, 7.0))
SIZE, PUT, READ, FLATTEN = record(Outer)
_, _, READ_INNER, FLATTEN_INNER = record(Inner, 5)


def test_numbers_stand_in_the_order_of_the_fields():
    assert SIZE == 7
    assert FLATTEN(VALUE) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)


def test_what_is_read_is_what_was_stored_and_no_other_number_changes():
    z = np.full(SIZE + 5, math.nan)
    PUT(z, 2, VALUE)
    assert READ(z[2 : 2 + SIZE]) == VALUE
    assert READ(FLATTEN(VALUE)) == VALUE
    assert np.isnan(z).nonzero()[0].tolist() == [0, 1, 9, 10, 11]


def test_a_short_record_is_filled_up_with_zeros():
    assert FLATTEN_INNER(VALUE.inner) == (2.0, 3.0, 4.0, 0.0, 0.0)
    assert READ_INNER(FLATTEN_INNER(VALUE.inner)) == VALUE.inner


def test_compiled_code_reads_fields_by_name():
    @njit
    def sign_times_axis(z):
        value = READ(z)
        return value.inner.sign * value.axis[2] + value.inner.high_and_low[1]

    assert sign_times_axis(np.array(FLATTEN(VALUE))) == 31.0
