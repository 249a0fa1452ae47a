"""The cost of the native FMU's step, as ratios to a Numba loop and to C by hand; that of a process's first step."""

import shutil
import sys

import pytest
from fmus import ROOT


@pytest.fixture(scope="module")
def figures():
    if not shutil.which("cc"):
        pytest.skip("no C compiler")
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        import bench_native
    finally:
        sys.path.remove(str(ROOT / "examples"))
    return bench_native, bench_native.main(repeats=301, steps=200, starts=9)


def test_a_step_costs_at_most_1p2_of_the_same_kernel_in_a_numba_loop(figures):
    bench, by_scene = figures
    for name in (*bench.TABLES, bench.HAND):
        assert by_scene[name]["numba loop"] <= 1.2 * bench.ALLOWANCE, name
        assert by_scene[name]["pythonfmu"] < 1.0, name


def test_a_step_costs_at_most_what_c_by_hand_does_for_the_same_motion(figures):
    bench, by_scene = figures
    assert by_scene[bench.HAND]["by hand"] <= 1.0 * bench.ALLOWANCE
    assert by_scene[bench.HAND]["difference"] < 1e-11  # round-off of 6e4 steps


def test_the_first_step_of_a_process_costs_at_most_1p1_of_an_fmus_that_does_nothing(figures):
    bench, by_scene = figures
    assert by_scene[bench.HAND]["first step"] <= bench.GOAL_START
