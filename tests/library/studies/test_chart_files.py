"""`rbfmu chart`: its files, tables and pictures."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numba
import pytest

from examples.benchmarks import plans
from rbfmu.studies.work_precision import (
    collection,
    drawing,
    library_methods,
    methods,
    peers,
    run_charts,
    write_charts,
)  # fmt: skip
from rbfmu.studies.work_precision.cases import CASES, CHECKPOINTS
from rbfmu.studies.work_precision.collection import (
    STOPPED,
    Collection,
    Ending,
    few_and_many,
    read_points,
    write_points,
)  # fmt: skip
from rbfmu.studies.work_precision.plans import verdicts
from rbfmu.studies.work_precision.tables import WIDTH, plan_table
from tests.support.chart_points import judged, made_point
from tests.support.pictures import overlaps


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    seen: list[tuple[int, int, str]] = []
    folder = tmp_path_factory.mktemp("charts")
    paths = run_charts(folder, True, lambda *step: seen.append(step))
    done = [step[0] for step in seen]
    assert done == sorted(done)
    assert done[-1] == seen[-1][1]
    assert sorted(paths) == sorted(folder.iterdir())
    return {path.name: path for path in paths}


@pytest.mark.thorough
def test_quick_run_writes_figures_answers_and_pictures(files: dict[str, Path]) -> None:
    pictures = {"answers.png", *(f"case_{key}.png" for key in collection.QUICK_CASES), "kept_a.png", "kept_c.png"}
    assert set(files) == {"work_precision.csv", "endings.csv", "answers.csv", "answers.txt", *pictures}
    for name in pictures:
        assert files[name].read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_figures_tell_machine_and_versions_and_are_read_back_as_written(files: dict[str, Path], tmp_path: Path) -> None:
    text = files["work_precision.csv"].read_text()
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert "processors" in head[0]
    assert f"numba {numba.__version__}" in head[1]
    assert "SciPy" in head[2]
    named = "\n".join(head)
    assert all(name in named for name in peers._PEERS)
    points = read_points(files["work_precision.csv"])
    again = write_points(tmp_path / "again.csv", points).read_text()
    assert [line for line in again.splitlines() if line[0] != "#"] == [x for x in text.splitlines() if x[0] != "#"]


def test_quick_figures_are_sound(files: dict[str, Path]) -> None:
    points = read_points(files["work_precision.csv"])
    assert {p.method for p in points} >= {
        "exact", "DOP853, error control", "Taylor, order 12", "splitting, order 4", "SciPy DOP853",
    }  # fmt: skip
    for point in points:
        assert point.seconds > 0.0
        assert point.spread >= 1.0
        assert point.compiling >= 0.0
        assert 0.0 <= point.error <= collection.LARGEST_ERROR
    assert {p.outputs for p in points if p.case == "d"} == {5, 2000}


def test_answers_on_the_terminal_name_every_motion_and_fit_it(files: dict[str, Path]) -> None:
    text = files["answers.txt"].read_text()
    assert max(map(len, text.splitlines())) <= WIDTH
    for key in collection.QUICK_CASES:
        assert f"{CASES[key].title} ({key})" in text
    assert "elliptic functions" in text
    assert "are even" in text


@pytest.fixture(scope="module")
def made_up() -> Collection:
    """All motions, at few and at many outputs, with the longest names; most lines end at one place."""
    names = ("SciPy LSODA, NumPy", "numbalsoda DOP853", "heyoka.py", "MuJoCo implicitfast", "Drake RK3")
    others = (
        ("exact", "exact"),
        ("DOP853, error control", "DOP853"),
        ("Taylor, order 24", "Taylor"),
        ("splitting, order 4", "splitting"),
    )
    points, endings = [], []
    for case in few_and_many(CASES):
        mine = [made_point(name, "peer", 10.0**-k, 1e-6 * 3.0**k) for name in names for k in range(2, 11)]
        mine += [made_point(*who, 10.0**-k, 1.1e-6 * 2.9**k) for who in others for k in range(3, 12)]
        plan = replace(made_point("rbfmu, as planned", "planned", 1e-10, 1e-4), detail="Taylor series of order 24")
        mine += [replace(plan, value=accuracy) for accuracy in (1e-3, 1e-6, 1e-9)]
        points += [replace(p, case=case.key, title=case.title, outputs=case.outputs, spread=1.05) for p in mine]
        endings += [Ending(case.key, case.outputs, name, "peer", 1e-10, STOPPED) for name in names]
    kept = {key: case.keeps for key, case in CASES.items()}
    nothing = {f"{name}_drift": math.nan for name in ("energy", "momentum")}
    return Collection([p if kept[p.case] else replace(p, **nothing) for p in points], endings)


@pytest.mark.thorough
def test_tables_fit_the_terminal_and_no_label_lies_on_another(
    made_up: Collection, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(drawing.Figure, "savefig", lambda figure, path, **more: drawn.append(figure))
    paths = write_charts(tmp_path, made_up)
    text = (tmp_path / "answers.txt").read_text()
    assert max(map(len, text.splitlines())) <= WIDTH
    assert text.startswith(plan_table(verdicts(made_up)))
    assert {path.name for path in paths} >= {"answers.png", "case_c2.png", "case_f.png", "kept_b.png"}
    assert "kept_f.png" not in {path.name for path in paths}  # nothing is kept there
    assert len(drawn) == sum(path.suffix == ".png" for path in paths)
    drawing.draw_answers(verdicts(made_up)[:2], tmp_path / "one_motion.png")
    for figure in drawn:
        assert overlaps(figure) == []
        assert all(axes.lines or axes.patches for axes in figure.axes)  # no panel is empty


def test_the_readme_s_figures_are_those_of_plans_and_of_the_best_peers(made_up: Collection) -> None:
    ahead, none = judged(1e-10, 1.0, 0.25), replace(judged(1e-10, 1.0, 0.25), peer=None)
    (row, other) = plans.rows([ahead, none])
    assert (row["peer"], row["seconds"], row["peer_seconds"]) == ("heyoka.py", ahead.cost, 0.25 * ahead.cost)
    assert other["peer"] == ""
    assert math.isnan(float(str(other["peer_seconds"])))
    outputs = [int(str(row["outputs"])) for row in plans.rows(verdicts(made_up))]
    assert len(outputs) == len(verdicts(made_up))
    assert [n > CHECKPOINTS for n in outputs] == sorted(n > CHECKPOINTS for n in outputs)  # few first


@pytest.mark.parametrize("places", [[0.5, 0.5, 0.5], [0.0, 0.01, 0.99, 1.0], [0.9, 0.95, 1.0]])
def test_labels_are_spread_in_order(places: list[float]) -> None:
    found = drawing.spread(places, 0.05)
    assert all(b - a > 0.0499 for a, b in pairwise(found))
    assert max(found) <= 1.0
    assert drawing.spread([0.1, 0.5, 0.9], 0.05) == [0.1, 0.5, 0.9]


def test_labels_at_one_place_are_spread_about_it() -> None:
    assert drawing.spread([0.5, 0.5, 0.5], 0.05) == pytest.approx([0.45, 0.5, 0.55])
    assert drawing.spread([0.0, 0.0], 0.05) == pytest.approx([0.0, 0.05])


def test_every_line_has_its_name() -> None:
    made = [*peers.peers()[0], *library_methods.library_methods(), *methods.reference_integrators()]
    groups = {drawing.group_of(made_point(method.name, method.family, 1e-3, 1.0)) for method in made}
    assert groups <= set(drawing.GROUPS)
    assert drawing.group_of(made_point("SciPy odeint", "peer", 1e-3, 1.0)) == "SciPy odeint"
    assert drawing.group_of(made_point("SciPy LSODA", "peer", 1e-3, 1.0)) == "SciPy solve_ivp"
