"""The cost of a communication step and of a process's first step, as ratios to an empty pythonfmu slave's."""

import sys

import pytest
from fmus import ROOT


@pytest.fixture(scope="module")
def figures():
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        import bench_fmu
    finally:
        sys.path.remove(str(ROOT / "examples"))
    return bench_fmu, bench_fmu.main(repeats=15, steps=500, starts=5)


def test_a_communication_step_costs_at_most_2p2_empty_ones(figures):
    bench, by_scene = figures
    assert set(by_scene) == set(bench.SCENES)
    for figure in by_scene.values():
        assert 1.0 < figure["step_ratio"] <= bench.GOAL_STEP == 2.2
        assert figure["step_ratio"] == figure["step_ours"] / figure["step_empty"]


def test_the_first_step_of_a_process_costs_at_most_1p5_empty_ones(figures):
    bench, by_scene = figures
    for figure in by_scene.values():
        assert 1.0 < figure["start_ratio"] <= bench.GOAL_START == 1.5
