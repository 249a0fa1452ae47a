"""`rbfmu chart`: its files, tables and pictures."""

import csv
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numba
import pytest

from examples.benchmarks import plans
from rbfmu.studies import WIDTH, chart
from rbfmu.studies.chart import drawing, measure, methods
from rbfmu.studies.chart.cases import CASES, CHECKPOINTS, few_and_many
from rbfmu.studies.chart.result import KINDS, STOPPED, End, kind_of
from tests.support.chart_points import judged, made_chart, made_plan, made_row
from tests.support.pictures import overlaps


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    seen: list[tuple[int, int, str]] = []
    folder = tmp_path_factory.mktemp("charts")
    paths = chart.run_charts(folder, True, lambda *step: seen.append(step))
    done = [step[0] for step in seen]
    assert done == sorted(done)
    assert done[-1] == seen[-1][1]
    assert sorted(paths) == sorted(folder.iterdir())
    return {path.name: path for path in paths}


@pytest.mark.slow
def test_quick_run_writes_figures_answers_and_pictures(files: dict[str, Path]) -> None:
    charts = [f"case_{key}{many}" for key in chart.QUICK_MOTIONS for many in ("", "_many")]
    pictures = {"answers.png", "kept_a.png", "kept_c.png", *(f"{name}.png" for name in charts)}
    tables = {"answers.csv", "answers.txt", *(f"{name}{ending}" for name in charts for ending in (".csv", ".txt"))}
    assert set(files) == {"work_precision.csv", "endings.csv", *tables, *pictures}
    assert next(name for name in files if name.endswith(".txt")) == "answers.txt"  # which the terminal shows
    for name in pictures:
        assert files[name].read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_figures_tell_machine_and_versions(files: dict[str, Path]) -> None:
    text = files["work_precision.csv"].read_text()
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert "processors" in head[0]
    assert f"numba {numba.__version__}" in head[1]
    assert "SciPy" in head[2]
    named = "\n".join(head)
    assert all(name in named for name in measure.PEERS)


@pytest.mark.thorough
def test_quick_figures_are_sound(files: dict[str, Path]) -> None:
    lines = [line for line in files["work_precision.csv"].read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert {row["method"] for row in rows} >= {
        "torque-free body", "DOP853, error control", "Taylor, order 12", "splitting, order 4", "SciPy DOP853",
    }  # fmt: skip
    for row in rows:
        assert float(row["run_seconds"]) > float(row["seconds"]) > 0.0
        assert float(row["spread"]) >= 1.0
        assert float(row["compiling"]) >= 0.0
        assert 0.0 <= float(row["error"]) <= measure.LARGEST_ERROR
        assert math.isfinite(float(row["energy_drift"])) == ("energy" in CASES[row["case"]].keeps)
    assert {row["outputs"] for row in rows if row["case"] == "d"} == {"5", "2000"}


@pytest.mark.thorough
def test_answers_on_the_terminal_name_every_motion_and_fit_it(files: dict[str, Path]) -> None:
    text = files["answers.txt"].read_text()
    assert max(map(len, text.splitlines())) <= WIDTH
    for key in chart.QUICK_MOTIONS:
        assert f"{CASES[key].scene.name} ({key})" in text
    assert "elliptic functions" in text
    assert "are even" in text


@pytest.fixture(scope="module")
def made_up() -> list[chart.Chart]:
    """All motions, at few and at many outputs, with the longest names; most lines end at one place."""
    names = ("SciPy LSODA, NumPy", "numbalsoda DOP853", "heyoka.py", "MuJoCo implicitfast", "Drake RK3")
    others = (
        ("torque-free body", "exact"), ("DOP853, error control", "DOP853"), ("Taylor, order 24", "Taylor"),
        ("splitting, order 4", "splitting"),
    )  # fmt: skip
    charts = []
    for case in few_and_many():
        mine = [made_row(name, "peer", 10.0**-k, 1e-6 * 3.0**k) for name in names for k in range(2, 11)]
        mine += [made_row(*who, 10.0**-k, 1.1e-6 * 2.9**k) for who in others for k in range(3, 12)]
        plan = made_plan(1e-10, 1e-4, detail="Taylor series of order 24")
        mine += [replace(plan, value=accuracy) for accuracy in (1e-3, 1e-6, 1e-9)]
        drifts = [f"{name.replace(' ', '_')}_drift" for name in case.keeps]
        rows = [replace(row, spread=1.05, **dict.fromkeys(drifts, row.error)) for row in mine]
        ends = [End(kind_of(name, "peer"), name, 1e-10, STOPPED) for name in names]
        ends += [End(kind_of(*who), who[0], 1e-11, "all settings tried") for who in others]
        chart = made_chart(*rows, ends=tuple(ends))
        what = {"scene": case.scene.name, "span": case.span}
        what |= {"key": case.key, "outputs": case.outputs, "many": case.many}
        charts.append(replace(chart, accuracy=1e-6, **what))
    return charts


@pytest.mark.slow
def test_tables_fit_the_terminal_and_no_label_lies_on_another(
    made_up: list[chart.Chart], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(drawing.Figure, "savefig", lambda figure, path, **more: drawn.append(figure))
    paths = chart.write_charts(tmp_path, made_up)
    text = (tmp_path / "answers.txt").read_text()
    assert max(map(len, text.splitlines())) <= WIDTH
    assert text.startswith(chart.plans_text(chart.verdicts(made_up), ()))
    names = {path.name for path in paths}
    assert names >= {"answers.png", "case_c2.png", "case_c2_many.txt", "case_f.png", "kept_b.png"}
    assert "kept_f.png" not in names  # nothing is kept there
    assert len(drawn) == sum(path.suffix == ".png" for path in paths)
    drawing.draw_answers(chart.verdicts(made_up)[:2], tmp_path / "one_motion.png")
    for figure in drawn:
        assert overlaps(figure) == []
        assert all(axes.lines or axes.patches for axes in figure.axes)  # no panel is empty


def test_the_readme_s_figures_are_those_of_plans_and_of_the_best_peers(made_up: list[chart.Chart]) -> None:
    ahead, none = judged(1e-10, 1.0, 0.25), replace(judged(1e-10, 1.0, 0.25), peer=None)
    (row, other) = plans.rows([ahead, none])
    cost = 10.0 * ahead.cost  # of the run
    assert (row["peer"], row["seconds"], row["peer_seconds"]) == ("heyoka.py", cost, 0.25 * cost)
    assert other["peer"] == ""
    assert math.isnan(float(str(other["peer_seconds"])))
    outputs = [int(str(row["outputs"])) for row in plans.rows(chart.verdicts(made_up))]
    assert len(outputs) == len(chart.verdicts(made_up))
    assert [n > CHECKPOINTS for n in outputs] == sorted(n > CHECKPOINTS for n in outputs)  # few first


def test_labels_are_spread_in_order_about_their_places() -> None:
    for places in ([0.5, 0.5, 0.5], [0.0, 0.01, 0.99, 1.0], [0.9, 0.95, 1.0]):
        found = drawing.spread(places, 0.05)
        assert all(b - a > 0.0499 for a, b in pairwise(found))
        assert max(found) <= 1.0
    assert drawing.spread([0.1, 0.5, 0.9], 0.05) == [0.1, 0.5, 0.9]
    assert drawing.spread([0.5, 0.5, 0.5], 0.05) == pytest.approx([0.45, 0.5, 0.55])
    assert drawing.spread([0.0, 0.0], 0.05) == pytest.approx([0.0, 0.05])


def test_every_line_has_its_name() -> None:
    made = [*measure.peers(), *methods.own_methods()]
    assert {kind_of(method.name, method.family) for method in (*made, methods.planned())} <= set(KINDS)
    assert kind_of("SciPy odeint", "peer") == "SciPy odeint"
    assert kind_of("SciPy LSODA", "peer") == "SciPy solve_ivp"
