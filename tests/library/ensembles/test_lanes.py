"""Members in lanes: what the loop over members gives, to the bit."""

import numpy as np
import pytest
from numba import config

from rbfmu.ensembles.loops import AT_ONCE, advance_lanes, compiled, entries, run_members
from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu_kernels.models.free import FREE_TRIAXIAL
from rbfmu_kernels.models.loaded import LOADED_TAYLOR

SCENE = Scene.from_dict(
    {
        "body": {"mass": 2.0, "inertia": [1.0, 1.5, 2.0]},
        "initial": {"omega_b": [1.0, 2.0, -1.5]},
        "loads": {"torque_b": [0.1, 0.05, -0.2]},
        "run": {"stop": 6.0, "step": 2.0},
    },
    "members in lanes",
)
PLAN = Plan("body under loads, by series", "Taylor", 13, tolerance=1e-9, order=12, span=6.0)
BLOCKS = LOADED_TAYLOR.BLOCKS
STEPS = np.array([2.0, 1.0, 3.0])
KEPT = np.arange(BLOCKS["quaternion"].start, BLOCKS["quaternion"].stop)
PLACES = np.array([*range(BLOCKS["inertia"].start, BLOCKS["inertia"].start + 3), BLOCKS["omega_b_0"].start])


def members(count):
    """Values of members; the third has moments of no body, the sixth turns too fast to be followed."""
    values = np.array([1.0, 1.5, 2.0, 1.0]) * (1.0 + 0.05 * np.random.default_rng(2).normal(size=(count, 4)))
    values[2, 0], values[5, 3] = 50.0, 1e140
    return values


def given(count, points):
    rows = np.full((count, points, 4), -1.0)
    return PLACES, members(count), STEPS, KEPT, rows, np.empty((count, 2), dtype=np.int64)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code")
@pytest.mark.parametrize("points", [1, 4])
def test_lanes_give_what_the_loop_gives(points):
    base, count = filled_buffer(SCENE, PLAN), AT_ONCE + 13
    *others, rows, ends = given(count, points)
    assert advance_lanes(LOADED_TAYLOR, base, *others, rows, ends)
    *others, expected, expected_ends = given(count, points)
    compiled(run_members)(*entries(LOADED_TAYLOR), aligned_zeros(len(base)), base, *others, expected, expected_ends)
    np.testing.assert_array_equal(ends, expected_ends)
    assert ends[2, 0] != 0
    assert ends[5].tolist() == [0, 0]
    assert np.all(np.delete(ends, (2, 5), axis=0) == (0, 3))
    np.testing.assert_array_equal(rows, expected)


@pytest.mark.parametrize(("model", "count"), [(FREE_TRIAXIAL, 10), (LOADED_TAYLOR, 1)])
def test_other_models_and_single_members_are_left_to_the_loop(model, count):
    arguments = [array[:count] if i in (1, 4, 5) else array for i, array in enumerate(given(10, 1))]
    assert not advance_lanes(model, filled_buffer(SCENE, PLAN), *arguments)
    assert np.all(arguments[-2] == -1.0)
