"""Events in ensembles: how often each happened in a run and when first, whatever ran it and wherever it is kept."""

import numpy as np
import pytest
import tomlkit

import rbfmu
from rbfmu.ensembles.members import draw, member
from tests.support.command_line import call

pytestmark = pytest.mark.thorough

TABLES = {
    "body": {"mass": 2.0, "inertia": [1.0, 2.0, 3.0]},
    "initial": {"omega_b": [0.1, 1.0, 0.05]},
    "events": {
        "flip": {"when": "omega_b[2]"},
        "fast": {"when": "omega_b[1] - 0.9", "direction": "rising", "stop": True},
        "never": {"when": "omega_b[3] - 2"},
    },
    "outputs": {"quantities": ["omega_b"]},
    "run": {"stop": 24.0, "step": 8.0, "accuracy": 1e-8},
    "ensemble": {"runs": 40, "keep": ["final"], "vary": {
        "initial.omega_b": {"normal": [[0.1, 1.0, 0.05], [0.05] * 3]}, "body.inertia": {"relative": [0.0, 0.0, 0.3]}}},
}  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return rbfmu.Scene.from_dict(TABLES, "flips")


@pytest.fixture(scope="module")
def result(scene, planned):
    return rbfmu.run_ensemble(scene, planned=planned, executor=1)


def test_they_are_those_of_each_run_alone_which_no_event_ends(scene, planned, result):
    samples = draw(scene, 0, len(result.samples["initial.omega_b"]))
    for row in range(0, 40, 3):
        alone = rbfmu.simulate(member(scene, samples, row), planned=planned)
        assert alone.time[-1] == 24.0
        np.testing.assert_array_equal(result.final["omega_b"][row], alone.omega_b[-1])
        for name, times in alone.events.items():
            assert result.counts[name][row] == len(times)
            np.testing.assert_array_equal(result.first[name][row], times[0] if len(times) else np.nan)
    assert {0, 1} <= {*result.counts["fast"].tolist()}
    assert max(result.counts["flip"]) > 1


def test_runs_without_one_are_counted_and_are_in_no_mean(scene, planned, result, tmp_path):
    assert np.all(np.isnan(result.first["never"]))
    assert len(result.first_of("never")) == 0
    assert len(result.first_of("fast")) == np.count_nonzero(result.counts["fast"]) < 40
    assert np.all(np.isfinite(result.first_of("fast")))
    (tmp_path / "flips.toml").write_text(tomlkit.dumps(TABLES))
    done = call("ensemble", tmp_path / "flips.toml", "--plot", tmp_path / "flips.png")
    lines = done.stdout.splitlines()
    assert f"fast: in {len(result.first_of('fast'))} of 40 runs; first times: mean " in done.stdout
    assert f", standard deviation {result.first_of('fast').std(ddof=1):.3g} s" in done.stdout
    assert "never: in 0 of 40 runs" in lines
    assert "standard deviation nan s" in call("ensemble", tmp_path / "flips.toml", "--runs", 1).stdout  # of one run
    assert (tmp_path / "flips.png").stat().st_size > 10_000
    often = [axes for axes in result.plot().axes if axes.get_xlabel().startswith("how often")]
    assert often
    assert all(float(tick).is_integer() for axes in often for tick in axes.get_xticks())


@pytest.mark.parametrize("ending", [".npz", ".zarr"])
def test_they_are_the_same_from_a_store_that_was_gone_on_with(scene, planned, result, ending, tmp_path):
    store = tmp_path / f"flips{ending}"
    rbfmu.run_ensemble(scene, store, planned=planned, runs=16, executor=2)
    rbfmu.run_ensemble(scene, store, planned=planned, executor=2, resume=True)
    found = rbfmu.EnsembleResult.load(store)
    for name in scene.events:
        np.testing.assert_array_equal(found.first[name], result.first[name])
        np.testing.assert_array_equal(found.counts[name], result.counts[name])
    assert found.to_xarray()["fast.first"].attrs["units"] == "s"
    with pytest.raises(KeyError, match="no event of that name; there is flip, fast, never"):
        found.first["flop"]


def test_a_run_that_failed_has_none(scene, planned):
    given = {"initial.omega_b": {"normal": [[0.1, 1.0, 0.05], [1e160, 0.0, 0.0]]}}
    wild = scene.replace({"ensemble.vary": given, "ensemble.runs": 4})
    found = rbfmu.run_ensemble(wild, planned=planned, executor=1)
    assert len(found.failed) == 4
    assert found.counts["flip"].tolist() == [0] * 4
    assert np.all(np.isnan(found.first["flip"]))
    assert len(found.first_of("flip")) == 0
