"""The tables and figures of pages are today's, and what pages say of them is what was measured."""

import re
from pathlib import Path

import pytest
from PIL import Image

import rbfmu
from examples import pages
from examples.benchmarks import plans
from examples.figures import measure, record
from examples.gallery import page as gallery
from examples.interop import run as interop
from rbfmu.studies.chart.cases import CASES
from tests.project.test_pages import NAMES, joined, text_of
from tests.support.covering import some_of
from tests.support.paths import ROOT


@pytest.mark.parametrize("name", NAMES)
def test_tables_are_those_of_todays_code_and_figures(name: str) -> None:
    assert text_of(name) == pages.filled(text_of(name)), "renew by: python -m examples.pages"


def test_every_table_stands_on_a_page() -> None:
    found = [name for page in NAMES for _, name, _ in pages.PLACE.findall(text_of(page))]
    assert sorted(found) == sorted(pages.TABLES)


@pytest.mark.thorough
@pytest.mark.parametrize("name", record.SOURCES)
def test_figures_are_not_older_than_their_sources(name: str) -> None:
    assert record.is_up_to_date(name), f"renew by: python -m examples.pages --measure {name}"


@pytest.mark.parametrize(("counted", "texts"), [
    ([], ['"""Words."""\nx = 1.0\n', '"""Other\nwords."""\n\nx = 1.0  # and more\n', "x = 2.0\n"]),
    (["one"], [f"{above}def one():\n    return {n}\n" for above, n in (("", 1), ("import os\n\n\n", 1), ("", 2))]),
], ids=["code but no words", "functions named alone"])  # fmt: skip
def test_figures_grow_old_with_what_counts_of_their_sources(
    counted: list[str], texts: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    source = tmp_path / "it.py"
    monkeypatch.setattr(record, "sources", lambda name: [(source, counted)])
    seen = []
    for text in texts:
        source.write_text(text)
        seen.append(record.digest("peers"))
    assert seen[0] == seen[1] != seen[2]
    monkeypatch.setattr(record, "sources", lambda name: [(source, ["no such"])])
    with pytest.raises(KeyError, match="no such"):
        record.digest("peers")


def test_comments_in_c_do_not_count() -> None:
    first, second, third = (
        list(record.lines_of_c(text))
        for text in ('f("//"); /* words\n */\n', '\nf("//"); // other\n', 'f("/"); // other\n')
    )
    assert first == second != third


@pytest.mark.thorough
def test_a_picture_grows_old_with_its_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(record, "place", lambda name: tmp_path / f"{name}.png")
    monkeypatch.setitem(measure.NEEDED, "own_chart", ())
    monkeypatch.setitem(measure.DRAWN, "own_chart", lambda path: Image.new("RGB", (2, 2)).save(path))
    measure.measure("own_chart")
    assert record.is_up_to_date("own_chart")
    monkeypatch.setattr(record, "digest", lambda name: "other")
    assert not record.is_up_to_date("own_chart")


def test_pictures_that_pages_show_have_sources() -> None:
    """Those that are made otherwise are of the gallery, whose tests draw them, or of laws, which a command tests."""
    shown = {Path(path).stem for name in NAMES for path in re.findall(r"!\[[^\]]*\]\((\S+\.png)\)", text_of(name))}
    assert shown - {"stability_maps"} == set(record.PICTURES)


@pytest.mark.parametrize("name", record.SOURCES)
def test_every_pattern_of_sources_finds_some(name: str) -> None:
    assert all(list(ROOT.glob(entry.partition(":")[0])) for entry in record.SOURCES[name])
    assert name in (measure.DRAWN if name in record.PICTURES else measure.MEASURED)


def test_one_command_takes_stale_figures_anew_and_writes_the_tables(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    taken: list[str] = []
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- made by examples.pages: importers -->\nold\n<!-- end -->\nb\n")
    monkeypatch.setattr(pages, "PAGES", [page])
    monkeypatch.setattr(pages.subprocess, "run", lambda command, check: taken.append(command[-1]))
    monkeypatch.setattr(record, "is_up_to_date", lambda name: name != "interop")
    pages.main(["--measure", "stale"])
    assert taken == ["interop"]
    assert page.read_text() == f"a\n<!-- made by examples.pages: importers -->\n{pages.importers()}<!-- end -->\nb\n"


def test_what_came_of_every_fmu_stands_in_its_importer_s_row() -> None:
    lines = pages.importers().splitlines()
    assert len(lines) == 2 + len(pages.IMPORTERS) + len(pages.NEVER_TRIED)
    titles = dict(zip((cell.strip() for cell in lines[0].split("|")), range(99), strict=False))
    for row in record.read("interop")[1]:
        title = pages.IMPORTERS[row["importer"].partition(",")[0]][0]
        (line,) = (line for line in lines if line.startswith(f"| {title} | "))
        cell = line.split(" | ")[titles[pages.TRIED[row["FMU"]]] - 1]
        assert row["result"].rstrip(".") in cell


def test_an_importer_s_cell_says_what_another_one_with_libpython_does() -> None:
    rows = [
        {"importer": name, "version": version, "FMU": fmu, "result": result}
        for name, version, fmu, result in (
            ("it", "1.0", "python", "failed: no Python."), ("it", "1.0", "native", "same bits"),
            ("it, libpython preloaded", "1.0", "python", "same bits"),
            ("it, libpython preloaded", "1.0", "native", "same bits"),
        )
    ]  # fmt: skip
    assert pages.tried(rows, "python") == "failed: no Python; with libpython: same bits"
    assert pages.tried(rows, "native") == "same bits"
    assert pages.tried([row | {"version": ""} for row in rows], "python") == "not tried"


def test_an_importer_that_is_not_here_keeps_what_an_earlier_fmu_did(monkeypatch: pytest.MonkeyPatch) -> None:
    def row(name: str, version: str, result: str) -> dict[str, str]:
        return {"importer": name, "version": version, "FMU": "native", "result": result}

    before = [row("here", "1", "failed"), row("elsewhere", "2", "same bits"), row("nowhere", "", "not on this machine")]
    now = [row("here", "3", "same bits"), row("elsewhere", "", "none"), row("nowhere", "", "none")]
    for _ in range(2):
        monkeypatch.setattr(record, "read", lambda name, rows=before: ([], rows))
        monkeypatch.setattr(interop, "main", lambda: now)
        before = measure.interop()
        kept = row("elsewhere", "2", "same bits (an earlier FMU)")
        assert before[:2] == [now[0], kept]
        assert not before[2]["version"]


@pytest.mark.thorough
def test_figures_are_kept_with_the_digest_of_their_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(record, "place", lambda name: tmp_path / f"{name}.csv")
    monkeypatch.setitem(measure.MEASURED, "native", lambda: [{"scene": "one", "by hand": 0.5}])
    measure.measure("native")
    head, rows = record.read("native")
    assert rows == [{"scene": "one", "by hand": "0.5"}]
    assert head[0]
    assert not any(line.startswith("sources") for line in head)
    assert record.is_up_to_date("native")
    monkeypatch.setattr(record, "digest", lambda name: "other")
    assert not record.is_up_to_date("native")


def test_measuring_without_a_peer_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(measure.NEEDED, "peers", ("no_such_package",))
    with pytest.raises(SystemExit, match="no_such_package"):
        measure.measure("peers")


@pytest.mark.thorough
@pytest.mark.parametrize("case", some_of(measure.PEERS_CASES, 2))
def test_plans_are_those_whose_cost_is_quoted(case: str) -> None:
    """What is planned has no digest: plans are made again."""
    for row in record.read("peers")[1]:
        if row["case"] == case:
            asked = CASES[case] if int(row["outputs"]) == CASES[case].outputs else CASES[case].with_many_outputs()
            assert rbfmu.plan(asked.asking(float(row["accuracy"]))).method == row["plan"]


@pytest.mark.thorough
@pytest.mark.parametrize("name", gallery.PICTURES)
def test_the_gallery_s_plans_are_those_whose_cost_is_quoted(name: str) -> None:
    (row,) = (r for r in record.read("gallery_cost")[1] if (r["scene"], r["who"]) == (name, "planned"))
    planned = rbfmu.plan(gallery.scene_file(name))
    assert f"{planned.model}: {planned.method}" == row["what"]


def test_the_faster_one_is_bold_where_ratios_hold_to_less() -> None:
    row = {"seconds": "1e-6", "peer_seconds": "3e-6", "even": "False", "peer": "heyoka.py"}
    assert pages.times(row) == "**1** / 3"
    assert pages.times(row | {"peer_seconds": "0.4e-6", "peer": "other"}) == "1 / **0.4** other"
    assert pages.times(row | {"peer_seconds": "1.9e-6"}) == "1 / 1.9"
    assert pages.times(row | {"peer_seconds": "0.6e-6"}) == "1 / 0.6"
    assert pages.SURE == 2.0
    assert "only ratios hold, and only to a factor of two" in joined(text_of("README.md"))


def test_rows_of_peers_are_quoted_with_every_accuracy() -> None:
    rows = record.read("peers")[1]
    assert {row["case"] for row in rows} == set(measure.PEERS_CASES)
    assert len(rows) == 2 * 4 * len(measure.PEERS_CASES)
    assert all(float(row["error"]) <= float(row["accuracy"]) for row in rows)
    assert set(plans.FASTEST) >= {row["peer"] for row in rows}


def test_who_is_ahead_where_is_what_the_readme_says() -> None:
    """DOP853 at 1e-3, with many outputs LSODA there; from 1e-6 on nobody."""
    behind = [row for row in record.read("peers")[1] if not float(row["seconds"]) < float(row["peer_seconds"])]
    assert {float(row["accuracy"]) for row in behind} == {1e-3}
    behind = [row for row in behind if row["even"] == "False"]
    ahead = {(row["case"], row["peer"], float(row["accuracy"]), int(row["outputs"]) > CASES[row["case"]].outputs):
             float(row["peer_seconds"]) / float(row["seconds"]) for row in behind}  # fmt: skip
    few = {key: ratio for key, ratio in ahead.items() if not key[-1]}
    assert {key[1:3] for key in few} == {("numbalsoda DOP853", 1e-3)}
    assert 0.775 <= min(few.values()) < 0.785
    coarse = {key: ratio for key, ratio in ahead.items() if key[1] == "numbalsoda LSODA"}
    assert {key[2] for key in coarse} == {1e-3}
    assert 0.765 <= min(coarse.values()) < 0.775
    assert ahead.keys() == few.keys() | coarse.keys()
    many = [row for row in record.read("peers")[1] if int(row["outputs"]) > CASES[row["case"]].outputs]
    sure = [row for row in many if "**" in pages.times(row)]
    assert [
        (row["case"], float(row["accuracy"])) for row in sure if float(row["seconds"]) > float(row["peer_seconds"])
    ] == []


@pytest.mark.thorough
def test_round_off_limits_what_can_be_asked_as_the_readme_says() -> None:
    assert "1e-13 of a fast top that turns by 500 rad; 1e-15 is refused" in joined(text_of("README.md"))
    fast = rbfmu.load_scene(gallery.scene_file("top_sleeping")).replace({"run.stop": 2.5})
    assert fast.initial.omega_b[2] * fast.run.stop == pytest.approx(500.0)
    assert rbfmu.plan(fast.replace({"run.accuracy": 1e-13})).error < 1e-13
    with pytest.raises(rbfmu.SceneError, match=r"expected at least 1\.0e-14"):
        rbfmu.plan(fast.replace({"run.accuracy": 1e-15}))
