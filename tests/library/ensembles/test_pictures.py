"""The picture of an ensemble: what is drawn is what was found, and can be read."""

import numpy as np
import pytest
from matplotlib.image import imread
from matplotlib.patches import Ellipse

import rbfmu
from rbfmu import run_ensemble
from tests.support.covering import some_of
from tests.support.ensembles.satellite import run, satellite
from tests.support.pictures import overlaps


@pytest.fixture(scope="module")
def found():
    return run(satellite(), runs=300)


def panel(figure, label):
    return next(axes for axes in figure.axes if label in (axes.get_ylabel(), axes.get_xlabel()))


def test_bands_and_medians_are_the_quantiles(found):
    axes = panel(found.plot(), "body rates (rad/s)")
    assert [line.get_label() for line in axes.lines] == ["x", "y", "z"]
    for k, line in enumerate(axes.lines):
        assert np.array_equal(line.get_ydata(), found.quantiles["omega_b"][3][:, k])
    outer = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert outer.min() == found.quantiles["omega_b"][1][:, 0].min()
    assert outer.max() == found.quantiles["omega_b"][5][:, 0].max()


def test_ellipses_hold_what_normals_hold(found):
    axes = panel(found.plot(), "omega_b[1]")
    j, k = (int(label[-2]) - 1 for label in (axes.get_xlabel(), axes.get_ylabel()))
    ends = found.final["omega_b"][found.good][:, [j, k]]
    ellipses = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    # of two normals, a part 1 - exp(-s^2 / 2) lies inside s standard deviations
    for sigma, ellipse in zip((1.0, 2.0, 3.0), ellipses, strict=True):
        inside = ellipse.get_patch_transform().inverted().transform(ends)
        assert np.mean(np.sum(inside**2, axis=1) < 1.0) == pytest.approx(1.0 - np.exp(-(sigma**2) / 2.0), abs=0.06)
    assert len(axes.lines[0].get_xdata()) == len(found.good)


@pytest.mark.thorough
@pytest.mark.parametrize("keep", some_of([["final", "statistics"], ["final"], ["all"], ["statistics", "all"]], 2))
def test_every_text_can_be_read(keep):
    assert overlaps(run(satellite().replace({"ensemble.keep": keep})).plot()) == []


@pytest.mark.parametrize("ending", some_of(["png", "svg", "pdf"], 1))
def test_a_picture_is_written(found, tmp_path, ending):
    found.plot(tmp_path / f"picture.{ending}")
    assert (tmp_path / f"picture.{ending}").stat().st_size > 10_000
    if ending == "png":
        assert imread(tmp_path / "picture.png").shape[1] == 1300


def test_ends_that_are_not_kept_are_not_drawn():
    figure = run(satellite().replace({"ensemble.keep": ["statistics"]})).plot()
    assert panel(figure, "body rates (rad/s)").lines


def test_round_off_is_not_drawn_and_offsets_are_as_large_as_numbers(found):
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
    axes = panel(found.plot(), "omega_b[1]")
    assert axes.xaxis.get_offset_text().get_size() == axes.get_xticklabels()[0].get_size()


def test_what_drives_most_is_said(found):
    lines = repr(found.drivers()).splitlines()
    assert lines[0].startswith("Drivers(")
    k = found.drivers().ends.index("kinetic_energy")
    column = found.drivers().correlations[:, k]
    assert f"kinetic_energy: {column[np.argmax(np.abs(column))]:.2f} with " in lines[-1]
