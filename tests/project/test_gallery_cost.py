"""Every scene of the gallery meets its accuracy, planned and full; the table of what they cost."""

import csv

import pytest

import rbfmu
from examples.benchmarks import gallery as bench
from examples.gallery import page as gallery
from tests.support.covering import some_of

NAMES = sorted(path.stem for path in gallery.SCENES.glob("*.toml"))


def test_every_scene_is_in_the_gallery():
    assert sorted(bench.PICTURES) == NAMES
    for name in NAMES:
        assert rbfmu.load_scene(gallery.scene_file(name)).name == name
        assert (gallery.FOLDER / f"{name}.png").stat().st_size < 60_000


@pytest.mark.parametrize("name", some_of(NAMES, 2))
def test_a_scene_is_as_accurate_as_asked_by_40_digits(name):
    scene = rbfmu.load_scene(gallery.scene_file(name))
    true = bench.reference(bench.everywhere_accepted(scene))
    plans = {"planned": rbfmu.plan(scene)}
    if scene.body is not None:
        plans["full"] = rbfmu.plan(scene, full=True)
    for who, planned in plans.items():
        error = bench.own(scene, who, planned, true).error
        assert error <= scene.run.accuracy
        assert error <= 2.0 * planned.error + 1e-13  # what it says to expect, and round-off that pilot runs share


def test_a_wrong_motion_has_a_large_error():
    scene = rbfmu.load_scene(gallery.scene_file("t_handle"))
    tables = scene.to_dict()
    tables["initial"]["omega_b"][1] *= 1.01
    other = rbfmu.Scene.from_dict(tables)
    assert bench.own(other, "planned", rbfmu.plan(other), bench.reference(scene)).error > 0.01


@pytest.mark.thorough
def test_costs_are_measured_written_and_drawn(tmp_path, capsys):
    rows = bench.main(tmp_path, ["earth", "gyro_attitude"], repeats=3, least=1e-4)
    by_scene = {name: [row for row in rows if row.scene == name] for name in ("earth", "gyro_attitude")}
    assert {"planned", "full"} <= {row.who for row in by_scene["earth"]}
    assert [row.who for row in by_scene["gyro_attitude"]] == ["planned"]
    for row in rows:
        assert row.cost > 0.0
        assert row.error <= row.accuracy
        assert (row.ratio == 1.0) == (row.who == "planned")
    with (tmp_path / "gallery_cost.csv").open(newline="") as file:
        written = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert [float(row["cost"]) for row in written] == [row.cost for row in rows]
    assert (tmp_path / "gallery_cost.png").stat().st_size > 4_000
    assert "times cheaper on the median scene" in capsys.readouterr().out


def test_the_page_quotes_todays_plans():
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.page()
