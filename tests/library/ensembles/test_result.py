"""What an ensemble gave: by name, with units and frames, in other programs' hands, and as a picture."""

import json

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.patches import Ellipse
from scipy import stats

import rbfmu
from rbfmu import run_ensemble
from rbfmu.ensembles import store, variables as names
from rbfmu.ensembles.result import Drivers, EnsembleResult
from tests.support.covering import some_of
from tests.support.ensembles.satellite import FILE, assert_same, run, satellite
from tests.support.pictures import overlaps

xarray = pytest.importorskip("xarray")


@pytest.fixture(scope="module")
def found():
    return run(satellite())


def test_a_result_says_what_it_has(found):
    text = "EnsembleResult('satellite': 100 runs, 1 failed, quaternion, omega_b, kinetic_energy)"
    assert repr(found) == text
    assert repr(found.final) == "{quaternion: (100, 4), omega_b: (100, 3), kinetic_energy: (100,)}"
    assert repr(found.samples["body.mass"]) == repr(np.asarray(found.samples["body.mass"]))
    assert set(found.samples) == {
        "body.mass", "body.inertia", "initial.attitude", "initial.omega_b", "loads.damping_b"
    }  # fmt: skip
    assert found.runs == 100
    html = found._repr_html_()
    assert "<caption>satellite: 100 runs, 1 failed; at t = 2 s</caption>" in html
    assert f"<td>{found.mean['kinetic_energy'][-1]:.5g}</td>" in html


def test_numbers_without_a_unit_have_squares_without_one():
    scene = satellite().replace({"outputs.share": "omega_b[1]/norm(omega_b)", "ensemble.keep": ["statistics"]})
    known = {variable.name: variable.attributes for variable in names.variables(scene, {})}
    assert known["share_std"]["units"] == known["share_covariance"]["units"] == "1"


def test_numbers_differ_that_round_off_cannot_make_differ():
    off = np.array([[1.0, 1.0, 0.0], [1.0 + 5e-13, 1.0 + 2e-12, 0.0]])
    assert names.differ(off).tolist() == [False, True, False]
    assert not names.differ(np.empty((2, 0))).any()


def test_failed_runs_are_numbers_nowhere(found):
    (failed,) = found.failed
    assert np.isnan(found.final["omega_b"][failed]).all()
    assert np.isfinite(found.final["omega_b"][found.good]).all()
    assert np.isfinite(found.samples["loads.damping_b"]).all()
    assert found.mean["omega_b"][-1] == pytest.approx(found.final["omega_b"][found.good].mean(axis=0), rel=1e-12)


@pytest.mark.parametrize("keep", [["final"], ["statistics"], ["statistics", "all"]])
def test_where_all_runs_fail_nothing_is_a_number(keep):
    vary = {"body.mass": {"normal": [1e-9, 1.0]}, "loads.damping_b": {"normal": [[0.0] * 3, [1.0] * 3]}}
    none = run(satellite().replace({"ensemble.vary": vary, "ensemble.keep": keep}), runs=9)
    assert len(none.failed) == none.runs
    for name in ("omega_b", "kinetic_energy"):
        assert np.isnan(none.at_end(name)).all()
        assert all(np.isnan(kept[name]).all() for kept in (none.mean, none.std, none.quantiles) if name in kept)
    assert all(spread.shape == (3,) and np.isnan(spread).all() for spread in [none.at_end("quaternion")[1]])
    assert all(np.isnan(part).all() for name, part in none.to_xarray().items() if name.startswith("quaternion"))
    assert none.drivers().correlations.size == 0
    assert none.plot().axes


def test_quantiles_do_not_hang_on_how_many_times_are_sorted_at_once(monkeypatch):
    """Each time has a mean of its own, about which attitudes and angles lie."""
    tables = {"ensemble.keep": ["statistics", "all"], "outputs.quantities": ["quaternion", "rpy"]}
    at_once = run(satellite().replace(tables))
    monkeypatch.setattr(store, "SORTED_AT_ONCE", 1000.0)
    assert_same(at_once, run(satellite().replace(tables)))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["redrawn", "probability", "omega_b_mean", "axis", "resume"])
def test_an_output_of_ones_own_is_named_as_nothing_else_of_the_result(name):
    scene = satellite().replace({f"outputs.{name}": "omega_b[1]", "outputs.quantities": ["quaternion", "omega_b"]})
    assert rbfmu.run_ensemble(scene, runs=3).final[name].shape == (3,)
    with pytest.raises(rbfmu.SceneError, match=f"outputs.{name}: expected another name where all of the runs is kept"):
        rbfmu.run_ensemble(scene.replace({"ensemble.keep": ["statistics", "all"]}), runs=3)


@pytest.mark.thorough
def test_an_output_of_ones_own_is_not_taken_for_what_is_not_kept():
    own = {"outputs.quantities": ["omega_b"], "outputs.tilt": "omega_b[1]", "outputs.tilt_mean": "omega_b[2]"}
    own |= {"outputs.tilt_final": "omega_b[3]", "outputs.quantile_rank_error": "omega_b[3]"}
    every = rbfmu.run_ensemble(satellite().replace({**own, "ensemble.keep": ["all"]}), runs=3)
    assert not every.mean
    assert not every.final
    assert every.rank_error == 0.0
    np.testing.assert_array_equal(every.at_end("tilt")[0], every.at_end("omega_b")[0][:1])
    own = {"outputs.quantities": ["omega_b"], "outputs.probability": "omega_b[1]"}
    ends = rbfmu.run_ensemble(satellite().replace({**own, "ensemble.keep": ["final"]}), runs=3)
    assert not ends.all
    np.testing.assert_array_equal(ends.ends("probability"), ends.ends("omega_b")[:, 0])


def test_what_is_not_kept_is_said(found):
    with pytest.raises(KeyError, match="omega_b: not all of the runs is kept; there is nothing"):
        found.all["omega_b"]
    ends = run(satellite().replace({"ensemble.keep": ["final"]}))
    with pytest.raises(KeyError, match="omega_b: statistics are not kept"):
        ends.mean["omega_b"]
    with pytest.raises(KeyError, match="position: the end of the runs is not kept; there is quaternion, omega_b"):
        ends.final["position"]
    for name in ("omega_b", "quaternion"):
        mean, std = ends.at_end(name)
        assert mean == pytest.approx(found.mean[name][-1], rel=1e-12)
        assert std == pytest.approx(found.std[name][-1], rel=1e-10)


def test_xarray_has_units_frames_and_names_of_components(found):
    data = found.to_xarray()
    assert data["omega_b_final"].dims == ("run", "axis")
    assert data["omega_b_final"].attrs["units"] == "rad/s"
    assert data["omega_b_final"].attrs["frame"] == "b (body)"
    assert data["omega_b_covariance"].attrs["units"] == "(rad/s)2"
    assert data["omega_b_covariance"].dims == ("time", "axis", "axis_2")
    assert data["quaternion_mean"].attrs["frame"] == "ab (from body to inertial)"
    assert data["quaternion_covariance"].attrs["units"] == "(rad)2"
    assert data["quaternion_std"].attrs["frame"] == "b (body)"
    assert data["quaternion_covariance"].dims == ("time", "axis", "axis_2")
    assert data["quaternion_quantiles"].dims == ("probability", "time")
    assert data["initial.attitude"].attrs["units"] == "1"
    assert data["body.inertia"].dims == ("run", "axis", "axis_2")
    assert data["body.inertia"].attrs == {
        "units": "kg m2", "long_name": "inertia matrix about the centre of mass, body axes", "frame": "b (body)"
    }  # fmt: skip
    assert data["time"].attrs["units"] == "s"
    median = data["kinetic_energy_quantiles"].sel(probability=0.5)
    assert median.values.tolist() == found.quantiles["kinetic_energy"][3].tolist()
    assert data["omega_b_final"].sel(axis="y").values.tobytes() == found.final["omega_b"][:, 1].tobytes()


@pytest.mark.parametrize("keep", ["final", "statistics", "all"])
def test_xarray_names_components_whatever_is_kept(keep):
    data = run(satellite().replace({"ensemble.keep": [keep]})).to_xarray()
    assert data["axis"].values.tolist() == ["x", "y", "z"]
    assert data["parameter"].values.tolist() == ["η", "ε₁", "ε₂", "ε₃"]


@pytest.mark.thorough
def test_others_read_the_store(found, tmp_path):
    kept = run(satellite().replace({"ensemble.keep": ["final", "statistics", "all"]}), tmp_path / "store.zarr")
    data = xarray.open_zarr(tmp_path / "store.zarr", consolidated=False)
    for name, values in kept.to_xarray().data_vars.items():
        assert data[name].values.tobytes() == values.values.tobytes(), name
        assert data[name].attrs == values.attrs
        assert data[name].dims == values.dims
    assert data.attrs["failed"] == {str(index): text for index, text in found.failed.items()}
    assert data.attrs["scene"] == json.loads(json.dumps(kept.scene.to_dict()))
    assert data["omega_b"].shape == (100, 5, 3)
    assert data["omega_b"][:, -1].values.tobytes() == found.final["omega_b"].tobytes()
    assert list(type(found).load(tmp_path / "store.zarr").samples) == list(found.samples)


def test_a_scene_file_runs(tmp_path):
    """Planned as it is: other bits than by the plan of these tests, within the accuracy."""
    planned, given = run_ensemble(FILE, progress=False), run(satellite())
    assert planned.failed.keys() == given.failed.keys()
    assert np.nanmax(np.abs(planned.final["quaternion"] - given.final["quaternion"])) < 1e-6


def test_rank_correlations_are_scipys(found, monkeypatch):
    drivers = found.drivers()
    i, j = drivers.varied.index("loads.damping_b[1]"), drivers.ends.index("omega_b[1]")
    a, b = found.samples["loads.damping_b"][found.good, 0], found.final["omega_b"][found.good, 0]
    assert drivers.correlations[i, j] == pytest.approx(stats.spearmanr(a, b).statistic, rel=1e-12)
    assert "initial.attitude[1]" not in drivers.varied
    assert "body.inertia[1,2]" not in drivers.varied  # it is 0 in all runs
    assert drivers.chance == pytest.approx(3.0 / np.sqrt(98.0))
    monkeypatch.setattr("rbfmu.ensembles.result.MOST_RANKED", 40)
    assert found.drivers().correlations[i, j] == pytest.approx(stats.spearmanr(a[:40], b[:40]).statistic, rel=1e-12)


def test_rank_correlations_of_equal_numbers_are_scipys():
    """As those of a grid, in which each place of an axis stands many times."""
    rng = np.random.default_rng(1)
    x = np.repeat([0.1, 0.2, 0.3, 0.7], [20, 1, 4, 5])
    y = np.round(x + rng.normal(scale=0.2, size=30), 1)
    found = Drivers.between({"x": x}, {"y": y}).correlations
    assert found[0, 0] == pytest.approx(stats.spearmanr(x, y).statistic, rel=1e-12)


def test_attitudes_and_angles_lie_about_their_mean_also_near_half_a_turn():
    rates = {"normal": [[0.0] * 3, [0.0, 0.01, 0.1]]}
    vary = {"initial.omega_b": rates, "initial.attitude": {"rotvec_deg": [0.0, 0.0, 6.0]}}
    half, none = {"euler": "ZYX", "angles_deg": [180.0, 0.0, 0.0]}, {"gravity_a": [0.0] * 3}
    scene = rbfmu.Scene(
        body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, initial={"attitude": half}, loads=none,
        outputs={"quantities": ["rpy"]}, run={"stop": 1.0, "step": 1.0}, ensemble={"runs": 100, "vary": vary},
    )  # fmt: skip
    turned = rbfmu.run_ensemble(scene)
    assert np.ptp(turned.final["rpy"][:, 2]) > 6.0  # of either sign
    drivers = turned.drivers()
    for name, truth in [("initial.omega_b[3]", 0.69), ("initial.attitude[4]", 0.72)]:  # 0.1 rad and 6 deg
        found = drivers.correlations[drivers.varied.index(name), drivers.ends.index("rpy[3]")]
        assert abs(found - truth) < 3.0 / np.sqrt(turned.runs)
    ends_alone = EnsembleResult(scene.replace({"ensemble.keep": ["final"]}), turned._arrays, {})
    for alone, by_statistics in zip(ends_alone.at_end("rpy"), turned.at_end("rpy"), strict=True):
        np.testing.assert_allclose(alone, by_statistics, rtol=1e-9, atol=1e-12)
    ellipses = [patch for patch in panel(turned.plot(), "rpy[3] (rad)").patches if isinstance(patch, Ellipse)]
    assert abs(abs(ellipses[0].center[1]) - np.pi) < 0.1


# Pictures


@pytest.fixture(scope="module")
def drawn():
    return run(satellite(), runs=300)


def panel(figure, label):
    return next(axes for axes in figure.axes if label in (axes.get_ylabel(), axes.get_xlabel()))


def test_bands_and_medians_are_the_quantiles(drawn):
    axes = panel(drawn.plot(), "body rates (rad/s)")
    assert [line.get_label() for line in axes.lines] == ["x", "y", "z"]
    for k, line in enumerate(axes.lines):
        assert np.array_equal(line.get_ydata(), drawn.quantiles["omega_b"][3][:, k])
    outer = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert outer.min() == drawn.quantiles["omega_b"][1][:, 0].min()
    assert outer.max() == drawn.quantiles["omega_b"][5][:, 0].max()


def test_ellipses_hold_what_normals_hold(drawn):
    axes = panel(drawn.plot(), "omega_b[1] (rad/s)")
    j, k = (int(label[len("omega_b[")]) - 1 for label in (axes.get_xlabel(), axes.get_ylabel()))
    ends = drawn.final["omega_b"][drawn.good][:, [j, k]]
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    # of two normals, a part 1 - exp(-s^2 / 2) lies inside s standard deviations
    for sigma, ellipse in zip((1.0, 2.0, 3.0), ellipses, strict=True):
        inside = ellipse.get_patch_transform().inverted().transform(ends)
        assert np.mean(np.sum(inside**2, axis=1) < 1.0) == pytest.approx(1.0 - np.exp(-(sigma**2) / 2.0), abs=0.06)
    assert len(axes.lines[0].get_xdata()) == len(drawn.good)


@pytest.mark.thorough
@pytest.mark.parametrize("keep", some_of([["final", "statistics"], ["final"], ["all"], ["statistics", "all"]], 2))
def test_every_text_can_be_read(keep):
    assert overlaps(run(satellite().replace({"ensemble.keep": keep})).plot()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("ending", some_of(["png", "svg", "pdf"], 1))
def test_a_picture_is_written(drawn, tmp_path, ending):
    drawn.plot(tmp_path / f"picture.{ending}")
    assert (tmp_path / f"picture.{ending}").stat().st_size > 10_000
    if ending == "png":
        assert imread(tmp_path / "picture.png").shape[1] == 1300


def test_ends_that_are_not_kept_are_not_drawn():
    figure = run(satellite().replace({"ensemble.keep": ["statistics"]})).plot()
    assert panel(figure, "body rates (rad/s)").lines


def test_round_off_is_not_drawn_and_offsets_are_as_large_as_numbers(drawn):
    heavy = rbfmu.Scene.from_dict({
        "body": {"mass": 50.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.1, 0.2, 0.3]},
        "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 2.0, "step": 1.0},
        "ensemble": {"runs": 20, "vary": {"body.mass": {"normal": [50.0, 1.0]}}},
    })  # fmt: skip
    alike = run_ensemble(heavy, planned=rbfmu.plan(heavy), progress=False)
    alike.final["omega_b"][0] += 3e-15
    assert alike.drivers().ends == ()
    assert {"all runs end alike", "no ends of runs that differ"} <= {
        text.get_text().partition(": ")[2] or text.get_text() for axes in alike.plot().axes for text in axes.texts
    }
    axes = panel(drawn.plot(), "omega_b[1] (rad/s)")
    assert axes.xaxis.get_offset_text().get_size() == axes.get_xticklabels()[0].get_size()


def test_what_drives_most_is_said(drawn):
    lines = repr(drawn.drivers()).splitlines()
    assert lines[0].startswith("Drivers(")
    k = drawn.drivers().ends.index("kinetic_energy")
    column = drawn.drivers().correlations[:, k]
    assert f"kinetic_energy: {column[np.argmax(np.abs(column))]:.2f} with " in lines[-1]
