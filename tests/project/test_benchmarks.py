"""The benchmarks judge made-up figures rightly, and run; no verdict on time is passed here (`make bench` does)."""

import math
import re
import runpy

import pytest
from numba import config

from tests.support.compilers import needs_compiler
from tests.support.covering import some_of
from tests.support.fmu import c_host
from tests.support.fmu.fmus import bench
from tests.support.paths import ROOT

NAMES = (
    "kernels", "free_rotation", "fmu", "held_gil", "native", "gallery", "costs", "stepping", "dense_output",
    "ensembles", "batches",
)  # fmt: skip
GALLERY, COSTS = bench("gallery"), bench("costs")


def test_make_runs_all_of_them():
    (line,) = re.findall(r"^BENCHES = (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert line.split() == list(NAMES)


@pytest.mark.parametrize(("bounds", "figure", "kept"), [
    ({"most": 2.0}, 2.0, True), ({"most": 2.0}, 2.1, False), ({"most": 2.0}, math.nan, False),
    ({"least": 2.0}, 2.0, True), ({"least": 2.0}, 1.9, False), ({"least": 2.0}, math.nan, False),
    ({"least": 1.0, "most": 2.0}, 1.5, True), ({"least": 1.0, "most": 2.0}, 0.5, False),
])  # fmt: skip
def test_a_goal_is_kept_within_its_bounds(bounds, figure, kept):
    assert bench("support.goals").Goal("it", figure, **bounds).kept == kept


def test_the_status_is_1_where_any_goal_is_missed(capsys):
    goals = bench("support.goals")
    kept, missed = goals.Goal("step", 1.0, most=2.0), goals.Goal("start", 0.2, least=0.5, most=1.0)
    assert goals.status([kept, kept]) == 0
    assert capsys.readouterr().out == "2 of 2 goals kept\n"
    assert goals.status([kept, missed]) == 1
    assert capsys.readouterr().out == "MISSED start: 0.2, goal at least 0.5 and at most 1\n1 of 2 goals kept\n"


@pytest.mark.parametrize(("name", "words"), [("plans", ["--peers", "d", "tops"]), ("weighed", ["rates", "tops"])])
def test_a_word_that_names_nothing_is_one_message(name, words):
    with pytest.raises(SystemExit, match=r"^tops: expected of .*(\bd, |rates, )"):
        bench(name).main(words)


KERNELS = {"SciPy": 100.0, "rbfmu": 1.0, "copy": 1.0}
FREE_ROTATION = {"an evaluation / an RK4 step": 4.0, "with its setup / an RK4 step": 50.0}
NATIVE = {"numba loop": 1.1, "pythonfmu": 0.1}
BY_HAND = {"by hand": 0.9, "difference": 1e-12, "first step": 1.0, "both without AVX2": 2.0}


def _row(who, ratio=1.0, error=1e-4):
    return GALLERY.Row("top", who, "", 1e-3, error, 100.0, ratio)


def _figure(stated, measured):
    return COSTS.Figure("free", "all", None, (), stated, measured)


def _output(ns, peer=100.0):
    return bench("dense_output").Row("top", 0.01, 1e-6, "", 1e-7, ns, 1e-7, 1e-8, peer)


def _ensembles(few=(1e-5, 250.0), many=(1e-5, 300.0), **others):
    ensembles = bench("ensembles")
    rows = [
        ensembles.Cost(shape, runs, runs * each, megabytes)
        for shape in ensembles.SHAPES
        for runs, (each, megabytes) in ((10_000, few), (1_000_000, many))
    ]
    return {"costs": rows, "threads": 1.9, "dask": 0.9, "example": 20.0} | others


def _batch(lanes, peer=10.0):
    batches = bench("batches")
    return batches.Row("top", 1e-6, {}, {batches.LANES: lanes, batches.FOUR: peer})


FIGURES = {
    "kernels": ([{"operation": "rotate"} | KERNELS], 2),
    "free_rotation": ({"generic": FREE_ROTATION | {"many times of one body / as many bodies": 0.3}}, 3),
    "fmu": ({"brick": {"step_ratio": 2.0, "start_ratio": 1.2}}, 2), "held_gil": (0.2, 1),
    "native": ({"top": NATIVE, "series and by hand": NATIVE | BY_HAND}, 7),
    "gallery": ([_row("planned"), _row("full", 6.0), _row("MuJoCo", 0.1, 1.0)], 4),
    "costs": ([_figure(100.0, 140.0), _figure(140.0, 100.0)], 2), "stepping": ({"stepped": 2.9e-6, "bare": 1e-6}, 1),
    "dense_output": ([_output(50.0), _output(100.0)], 2), "ensembles": (_ensembles(), 9),
    "batches": ([_batch(5.0), _batch(8.0)], 2),
}  # fmt: skip
"""Made up, all goals kept; how many goals there are."""


@pytest.mark.parametrize("name", NAMES)
def test_good_figures_keep_all_goals(name):
    figures, count = FIGURES[name]
    assert [goal.kept for goal in bench(name).goals(figures)] == [True] * count


@pytest.mark.parametrize(("name", "figures", "missed"), [
    ("kernels", [{"operation": "rotate"} | KERNELS | {"SciPy": 7.9}], "rotate, SciPy / rbfmu"),
    ("kernels", [{"operation": "rotate"} | KERNELS | {"copy": 0.8}], "rotate, copy / rbfmu"),
    ("free_rotation", {"generic": {"ns of CPU an output of many bodies at ten times": 81.0}},
     "generic, ns of CPU an output of many bodies at ten times"),
    ("free_rotation", {"generic": FREE_ROTATION | {"an evaluation / an RK4 step": 5.1}},
     "generic, an evaluation / an RK4 step"),
    ("fmu", {"brick": {"step_ratio": 2.3, "start_ratio": 1.2}}, "brick, step"),
    ("fmu", {"brick": {"step_ratio": 2.0, "start_ratio": 1.6}}, "brick, first step"),
    ("held_gil", 0.8, "held / not held"),
    ("native", {"series and by hand": NATIVE | BY_HAND | {"by hand": 1.01}}, "series and by hand, native / by hand"),
    ("native", {"series and by hand": NATIVE | BY_HAND | {"difference": 1e-9}}, "series and by hand, difference"),
    ("gallery", [_row("planned"), _row("full", 4.9)], "full / planned, median scene"),
    ("gallery", [_row("planned"), _row("full", 9.0), _row("full", 9.0), _row("full", 0.9)], "full / planned, top"),
    ("gallery", [_row("planned", error=2e-3), _row("full", 6.0)], "error, top, planned"),
    ("costs", [_figure(100.0, 160.0)], "free, all, stated / measured"),
    ("costs", [_figure(160.0, 100.0)], "free, all, stated / measured"),
    ("stepping", {"stepped": 3.1e-6, "bare": 1e-6}, "microseconds a step of a Simulator"),
    ("dense_output", [_output(101.0)], "top, every 0.01 s, 1e-06, plan / heyoka.py"),
    ("dense_output", [_output(50.0, math.nan)], "top, every 0.01 s, 1e-06, plan / heyoka.py"),
    ("ensembles", _ensembles(threads=1.7), "two threads / one"),
    ("ensembles", _ensembles(dask=0.8), "Dask / threads"),
    ("ensembles", _ensembles(example=61.0), "seconds of the example"),
    ("batches", [_batch(8.1)], "top, 1e-06, ours / heyoka.py, 4"),
    ("batches", [_batch(1.0, math.nan)], "top, 1e-06, ours / heyoka.py, 4"),
])  # fmt: skip
def test_a_figure_beyond_its_goal_is_missed(name, figures, missed):
    assert [goal.name for goal in bench(name).goals(figures) if not goal.kept] == [missed]


@pytest.mark.parametrize(("held", "expected"), [(60.0, 0), (80.0, 1)])
def test_a_missed_goal_is_the_status_of_the_process(held, expected, monkeypatch):
    """Of a whole benchmark, at made-up times."""
    times = {"0": 100.0, "1": held}
    monkeypatch.setattr(c_host, "run_c_host", lambda *_, RBFMU_HOLD_GIL: ([], times[RBFMU_HOLD_GIL]))
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "examples" / "benchmarks" / "held_gil.py"), run_name="__main__")
    assert ended.value.code == expected


# --- in tiny settings


@pytest.mark.thorough
def test_kernels_are_measured_written_and_drawn(tmp_path, capsys, monkeypatch):
    kernels = bench("kernels")
    monkeypatch.setattr(kernels, "ROUNDS", 1)
    few, data = kernels.tasks(1000)
    monkeypatch.setattr(kernels, "tasks", lambda n: (few[:2], data))
    for extra in ("one_item", "starts"):
        monkeypatch.setattr(kernels, extra, dict)
    monkeypatch.setattr(kernels, "threads", lambda n: {"two threads": 1.5})
    rows = kernels.main(tmp_path, 1000)
    assert [task.name for task in few] == list(kernels.GOALS)
    assert [row["operation"] for row in rows] == list(kernels.GOALS)[:2]
    assert all(row[who] > 0.0 for row in rows for who in ("rbfmu", "copy", "SciPy"))
    assert len(kernels.goals(rows)) == 2 * len(rows)
    assert (tmp_path / "kernels.png").stat().st_size > 4_000
    assert len((tmp_path / "kernels.csv").read_text().splitlines()) == 1 + len(rows)
    assert "two threads" in capsys.readouterr().out


@pytest.mark.parametrize(("many", "missed"), [
    ((1.3e-5, 300.0), ["cost of a run"] * 3), ((1e-5, 400.0), ["MB more"] * 2),
    ((1e-5, 500.0), ["MB more", "MB more", "bytes a run"]),
])  # fmt: skip
def test_ensembles_whose_cost_or_memory_grows_are_found(many, missed):
    found = [goal.name for goal in bench("ensembles").goals(_ensembles(many=many)) if not goal.kept]
    assert len(found) == len(missed)
    assert all(word in name for name, word in zip(found, missed, strict=True))


@pytest.mark.slow
def test_ensembles_are_measured_and_drawn(tmp_path, capsys):
    ensembles = bench("ensembles")
    found = ensembles.costs((50, 100))
    assert [(row.shape, row.runs) for row in found] == [(shape, n) for shape in ensembles.SHAPES for n in (50, 100)]
    assert all(row.seconds > 0.0 and row.megabytes > 50.0 for row in found)
    ensembles.draw(found, tmp_path / "ensembles.png")
    assert (tmp_path / "ensembles.png").stat().st_size > 10_000
    assert ensembles.example(20) > 0.0
    assert "the example with its picture" in capsys.readouterr().out


def test_ensembles_are_drawn_in_a_folder_that_need_not_be_there(tmp_path, monkeypatch):
    ensembles = bench("ensembles")
    rows = _ensembles()["costs"]
    for name, figures in {"costs": rows, "example": 1.0, "executors": {"threads": 1.0}}.items():
        monkeypatch.setattr(ensembles, name, lambda *_, figures=figures, **__: figures)
    assert ensembles.main(tmp_path / "new") == {"costs": rows, "example": 1.0, "threads": 1.0}
    assert (tmp_path / "new" / "ensembles.png").is_file()


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of Dask's own
def test_executors_of_ensembles_are_measured():
    pytest.importorskip("distributed")
    figures = bench("ensembles").executors(rounds=1, runs=8, overhead=2)
    assert set(figures) == {"threads", "dask", "overhead of threads", "overhead of dask"}
    assert all(figure > 0.0 for figure in figures.values())


@pytest.mark.slow
def test_free_rotation_is_measured():
    figures = bench("free_rotation").main(2, 10, 100)
    assert [len(ratios) for ratios in figures.values()] == [4, 2]
    assert all(ratio > 0.0 for ratios in figures.values() for ratio in ratios.values())


@pytest.mark.thorough
def test_steps_of_a_simulator_are_measured(capsys):
    figures = bench("stepping").main(rounds=1, steps=100)
    assert min(figures["bare"], figures["stepped"]) > 0.0
    assert "ratio" in capsys.readouterr().out


def test_many_outputs_are_measured_beside_a_peer_as_accurate(capsys):
    pytest.importorskip("heyoka")
    one = bench("dense_output")
    (row,) = one.main(("d",), (1.0,), (1e-6,), 2)
    assert row.error <= 1e-6
    assert row.peer_error <= row.error
    assert row.ratio > 0.0
    assert "constant body torque" in capsys.readouterr().out


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code")
@pytest.mark.thorough
def test_many_bodies_are_measured_beside_peers_as_accurate(capsys):
    pytest.importorskip("heyoka")
    batches = bench("batches")
    (row,) = batches.main(("d",), (1e-4,), 8, 2, (batches.ALONE, batches.FOUR))
    assert set(row.costs) == {batches.LANES, batches.ALONE, batches.FOUR}
    assert all(0.0 < error <= 1e-4 for error in row.errors.values())
    assert row.errors[batches.LANES] == row.errors[batches.ALONE]
    assert min(row.costs.values()) > 0.0
    assert "constant body torque" in capsys.readouterr().out


@pytest.mark.thorough
def test_the_pythonfmu_fmu_is_measured(monkeypatch):
    one = bench("fmu")
    monkeypatch.setattr(one, "SCENES", {"with inputs": one.SCENES["triaxial body, 6 inputs"]})
    by_scene = one.main(repeats=2, steps=5, starts=1)
    assert set(by_scene) == set(one.SCENES)
    for figure in by_scene.values():
        assert figure["step_ratio"] == figure["step_ours"] / figure["step_empty"] > 0.0
    assert len(one.goals(by_scene)) == 2


@pytest.mark.slow
@needs_compiler
def test_the_native_fmu_is_measured_and_c_by_hand_moves_alike():
    one = bench("native")
    by_scene = one.main(repeats=2, steps=50, starts=1, names=["prescribed rates", one.HAND])
    assert set(by_scene) == {"prescribed rates", one.HAND}
    assert len(one.goals(by_scene)) == 2 * len(by_scene) + 3
    assert all(figure > 0.0 for figures in by_scene.values() for figure in figures.values())
    assert by_scene[one.HAND]["difference"] < one.ROUND_OFF


@pytest.mark.parametrize("model", some_of([*COSTS.SERVED], 4))
def test_a_scene_costs_more_without_the_model_that_serves_it(model):
    """By what plans state; the benchmark measures it."""
    scene = COSTS.served(model)
    found = COSTS.rbfmu.plan(scene)
    with COSTS.without(model):
        other = COSTS.rbfmu.plan(scene)
    assert found.model == model != other.model
    assert other.cost > COSTS.WORTH * found.cost
    assert COSTS.rbfmu.plan(scene) == found


@pytest.mark.thorough
def test_what_a_model_saves_is_measured(capsys):
    assert COSTS.worth("constant rate", rounds=1, k=1) > 0.0
    assert "without constant rate: one axis, closed form" in capsys.readouterr().out


@pytest.mark.thorough
def test_steps_are_measured_beside_what_plans_state():
    scene = COSTS.scene_of("free", ("quaternion",), 1e-9, 0.01)
    (figure,) = COSTS.measured([(scene, COSTS.rbfmu.plan(scene))], rounds=1, k=1)
    assert figure.measured > 0.0
    assert figure.stated == figure.planned.cost
    assert (figure.body, figure.asked) == ("free, 0.01 s, 1e-09", "quaternion")
    assert list(COSTS.table([figure])) == figure.terms


@pytest.mark.thorough
def test_parts_are_weighed_against_what_is_left_without_them(monkeypatch):
    weighed = bench("weighed")
    for name, value in {"ROUNDS": 1, "SECONDS": 1e-4, "ORDERS": (12,), "ACCURACIES": (1e-6,)}.items():
        monkeypatch.setattr(weighed, name, value)
    (name,), (ratio,) = zip(*weighed.dop853(["d"]).items(), strict=True)
    assert name == "constant body torque, 1e-06: DOP853 / plan (Taylor series of order 12)"
    assert 0.0 < ratio < math.inf
    (name,) = weighed.free(["a"])
    assert name == "free body, 1e-06: exact / Taylor, order 12"
    errors = list(weighed.rates().values())
    assert errors[0] < 0.01 * errors[1]  # two derivatives, beside rates held at the middle
    assert errors[1:] == sorted(errors[1:], reverse=True)
