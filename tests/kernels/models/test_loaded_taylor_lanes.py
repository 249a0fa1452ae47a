"""Bodies side by side in lanes have the bits that each has alone, whatever stands beside it."""

import numpy as np
import pytest
from numba import config

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body.lanes import MARKS, STATUS
from rbfmu_kernels.buffer import OK, STEP_REJECTED
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.simd import wide_at
from rbfmu_kernels.models.loaded import LOADED_TAYLOR, go_on
from rbfmu_kernels.models.loaded_taylor_lanes import COLUMNS_SIZE, WORK, Bodies, advance

pytestmark = [pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code"), pytest.mark.thorough]

BLOCKS = LOADED_TAYLOR.BLOCKS


@kernel
def _begin(buffers, h, marks):
    for i in range(len(buffers)):
        if marks[i, STATUS] == OK:
            marks[i, STATUS] = go_on(buffers[i], h) if h > 0.0 else STEP_REJECTED
    return Bodies(buffers, marks, (h,))


@kernel
def _in_four(buffers, h, scratch, marks):
    advance(_begin(buffers, h, marks), wide_at(scratch, 0, 4), wide_at(scratch, 4 * COLUMNS_SIZE, 4))


@kernel
def _in_eight(buffers, h, scratch, marks):
    advance(_begin(buffers, h, marks), wide_at(scratch, 0, 8), wide_at(scratch, 8 * COLUMNS_SIZE, 8))


WAYS = {4: _in_four, 8: _in_eight}
SCRATCH = 8 * (COLUMNS_SIZE + WORK)
OFF_AXES = [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]]
TRIAXIAL = {"mass": 2.0, "inertia": [1.0, 1.5, 2.0]}
TOP = {"mass": 1.0, "inertia": [1.0, 1.25, 0.3], "r_oc_b": [0.0, 0.0, 0.125], "pivot": True}
KINDS = {
    "a torque in b": {"body": TRIAXIAL, "loads": {"torque_b": [0.1, 0.05, -0.2]}},
    "a torque in a, damped": {"body": TRIAXIAL,
                              "loads": {"torque_a": [0.3, 0.1, -0.2], "damping_b": [0.1, 0.2, 0.0]}},
    "a heavy top": {"body": TOP, "loads": {"gravity_a": [0.0, 0.0, -9.81]}},
    "off its axes": {"body": {"mass": 2.0, "inertia": OFF_AXES, "r_oc_b": [0.1, -0.2, 0.3]},
                     "loads": {"force_a": [0.3, 0.1, -0.4], "torque_a": [0.1, 0.0, 0.2]}},
    "off its axes, a torque in b": {"body": {"mass": 2.0, "inertia": OFF_AXES},
                                    "loads": {"torque_b": [0.1, 0.05, -0.2]}},
    "a force at c, and a torque": {"body": TRIAXIAL,
                                   "loads": {"force_a": [0.3, 0.1, -0.4], "torque_a": [0.1, 0.0, 0.2]}},
    "a force in b": {"body": TRIAXIAL, "loads": {"force_b": [1.0, 0.5, 0.2], "torque_b": [0.1, 0.2, 0.1]}},
}  # fmt: skip
OUTPUTS = ["quaternion", "omega_b", "position"]
KEPT = ("quaternion", "omega_b", "position", "q", "omega", "r_c", "v_c", "step_size", "substeps")


def buffers_of(kinds, count, omega=(1.0, 2.0, -1.5), outputs=OUTPUTS, order=12):
    """Return buffers of bodies of these kinds, dispersed, one kind after the other."""
    numbers = np.random.default_rng(7)
    z = aligned_zeros(count * LOADED_TAYLOR.SIZE).reshape(count, LOADED_TAYLOR.SIZE)
    for i in range(count):
        tables = KINDS[kinds[i % len(kinds)]] | {
            "initial": {"omega_b": list(numbers.normal(1.0, 0.2, 3) * omega)},
            "outputs": {"quantities": list(outputs)},
            "run": {"stop": 10.0, "step": 1.0},
        }
        plan = Plan("body under loads, by series", "Taylor", 13, tolerance=1e-9, order=order, span=10.0)
        z[i] = filled_buffer(Scene.from_dict(tables, "a body in a lane"), plan)
        assert LOADED_TAYLOR.initialize(z[i]) == 0
    return z


def advanced(way, z, steps, stale=0.0):
    """Return buffers after steps in lanes, and the last statuses; stale: what the lanes' work space holds before."""
    z, scratch, marks = z.copy(), aligned_zeros(SCRATCH), np.zeros((len(z), MARKS))
    scratch[:] = stale
    for h in steps:
        WAYS[way](z, h, scratch, marks)
    return z, marks[:, STATUS]


def advanced_alone(z, steps):
    """Return the same of bodies that are advanced alone."""
    z, statuses = z.copy(), np.zeros(len(z), dtype=np.int64)
    for h in steps:
        for i in range(len(z)):
            statuses[i] = LOADED_TAYLOR.step(z[i], h) if statuses[i] == OK else statuses[i]
    return z, statuses


def shown(z):
    """Return what bodies show and how they went on."""
    return np.hstack([z[:, BLOCKS[name]] for name in KEPT])


def assert_same(way, z, steps):
    """Assert that lanes leave buffers as `step` does, and that the steps did something."""
    found, statuses = advanced(way, z, steps)
    expected, alone = advanced_alone(z, steps)
    np.testing.assert_array_equal(shown(found), shown(expected))
    np.testing.assert_array_equal(statuses, alone)
    assert not np.array_equal(shown(found), shown(z))


@pytest.mark.parametrize("way", [4, 8])
@pytest.mark.parametrize("kind", KINDS)
def test_a_body_in_a_lane_has_the_bits_that_it_has_alone(kind, way):
    assert_same(way, buffers_of([kind], 11), [4.0, 0.5, 7.0, 0.3])


@pytest.mark.parametrize("kind", KINDS)
def test_lanes_take_all_but_a_force_that_turns_with_the_body(kind):
    scratch = aligned_zeros(SCRATCH)
    _in_eight(buffers_of([kind], 11), 4.0, scratch, np.zeros((11, MARKS)))
    assert scratch.any() == (kind != "a force in b")


def test_inputs_that_are_new_in_a_step_hold_in_the_next():
    """Of which a series serves several."""
    z = buffers_of(["a torque in b"], 11)
    z[:, BLOCKS["torque_b"]] = [0.02, 0.0, -0.03]
    assert_same(8, z, [4.0, *[0.05] * 20])


@pytest.mark.parametrize("way", [4, 8])
def test_bodies_of_all_kinds_may_come_together(way):
    assert_same(way, buffers_of([*KINDS], 23), [3.0, 5.0])


@pytest.mark.parametrize("stale", [1e3, np.nan])
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_work_space_holds_from_before_changes_no_bit(kind, stale):
    z, steps = buffers_of([kind], 5), [4.0, *[0.01] * 20, 5.0, 0.3]
    z[1, BLOCKS["force_a_rate"]] = z[2, BLOCKS["torque_a_rate"]] = 0.05, 0.1, -0.2
    z[3, BLOCKS["torque_b_rate_2"]] = 0.05, 0.1, -0.2
    expected = shown(advanced_alone(z, steps)[0])
    z[:, BLOCKS["work"]] = stale
    np.testing.assert_array_equal(shown(advanced_alone(z, steps)[0]), expected)
    np.testing.assert_array_equal(shown(advanced(8, z, steps, stale)[0]), expected)


TWO = ["a torque in b", "a heavy top"]


@pytest.mark.parametrize(("kinds", "count", "settings", "steps"), [
    (TWO, 9, {}, [0.01] * 40 + [5.0, 0.01, 0.02]),  # a series reaches over the short ones
    *[(TWO, 24, {"order": 16}, [h] * 12) for h in (0.1, 0.2, 0.3)],  # one ends in a step, and the next may be too short
    (TWO[:1], 9, {"outputs": ["omega_b"]}, [4.0, 2.0]),
], ids=["short steps", "0.1 s", "0.2 s", "0.3 s", "rates alone"])  # fmt: skip
def test_steps_of_any_size_and_rates_alone_are_the_same_too(kinds, count, settings, steps):
    assert_same(8, buffers_of(kinds, count, **settings), steps)


def test_inputs_that_change_within_a_step_are_the_same_too():
    z = buffers_of(TWO, 9)
    z[::3, BLOCKS["torque_b_rate"]] = 0.05, 0.1, -0.2
    z[1::3, BLOCKS["torque_a"]] = 0.05, 0.1, -0.2
    assert_same(8, z, [4.0, 2.0])


def test_neither_neighbours_nor_places_change_a_body_s_bits():
    z = buffers_of(["a heavy top", "a torque in b"], 24)
    together, _ = advanced(8, z, [4.0, 2.0])
    order = np.random.default_rng(3).permutation(len(z))[:17]
    np.testing.assert_array_equal(shown(advanced(8, z[order], [4.0, 2.0])[0]), shown(together)[order])


@pytest.mark.parametrize("way", [4, 8])
def test_a_body_that_cannot_go_on_is_refused_and_the_others_go_on(way):
    z = buffers_of(["a torque in b"], 9)
    z[4, BLOCKS["omega"]] = 1e200
    z[6, BLOCKS["omega"]] = np.nan
    z[8, BLOCKS["v_c"]] = 1e308  # whose position leaves the range of numbers when its lane has done
    refused = [4, 6, 8]
    _, statuses = advanced(way, z, [4.0])
    assert statuses.tolist() == [STEP_REJECTED if i in refused else OK for i in range(9)]
    assert_same(way, np.delete(z, refused, axis=0), [4.0])
    assert_same(way, z, [4.0, 1.0])


def test_a_body_whose_status_is_not_ok_is_left_as_it_is():
    z = buffers_of(["a torque in b"], 5)
    after, marks = z.copy(), np.zeros((5, MARKS))
    marks[1, STATUS] = STEP_REJECTED
    _in_four(after, 4.0, aligned_zeros(SCRATCH), marks)
    np.testing.assert_array_equal(after[1], z[1])
    assert marks[:, STATUS].tolist() == [OK, STEP_REJECTED, OK, OK, OK]
