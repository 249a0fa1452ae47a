"""`rbfmu chart`, with a scene and without: what is said of methods, plans and peers, on made-up figures."""

import math
import random
from dataclasses import replace

import pytest

from rbfmu.studies import WIDTH, cost_text
from rbfmu.studies.chart import Chart, answers, drawing, measure, methods, plans_text, solvers, verdicts
from rbfmu.studies.chart.cases import CASES, Case
from rbfmu.studies.chart.measure import Extent, Trial, contestants, explore, why_not
from rbfmu.studies.chart.methods import NotFeasibleError, Run
from rbfmu.studies.chart.result import KINDS, STOPPED, End, Row, TooSmall, cost_of, front
from tests.support.chart_points import judged, made_chart, made_plan, made_row, true_states, turned_by
from tests.support.covering import some_of
from tests.support.pictures import overlaps

WHAT = Extent(0.3, 2, 1e-3)


def _made(errors: list[float], seconds: list[float]) -> methods.Method:
    """A method whose errors and times are given."""

    def run(case: Case, value: float) -> Run:
        error = errors[int(value)]
        if error < 0.0:
            raise NotFeasibleError("not with me")
        turned = [(*turned_by(row[:4], error), *row[4:]) for row in true_states(case.key)]
        return Run(case.at_checkpoints(turned), lambda k: k * seconds[int(value)], 1.0)

    return methods.Method("MuJoCo, made up", "peer", "step (s)", lambda *_: map(float, range(len(errors))), run)


def test_time_to_compile_is_that_of_the_first_run_beyond_what_two_runs_take(monkeypatch) -> None:
    """With a clock that only work moves on: the first run takes 5 s more than the others, which take 3."""
    clock = [0.0]

    def work(seconds: float) -> float:
        clock[0] += seconds
        return seconds

    def run(case: Case, value: float) -> Run:
        work(5.0 + 3.0)
        return Run(case.at_checkpoints(true_states("a")), lambda k: work(3.0 * k), 1.0)

    method = replace(_made([0.0], [0.0]), run=run)
    monkeypatch.setattr(measure, "thread_time", lambda: clock[0])
    first_calls: dict[str, float] = {}
    explore(WHAT, CASES["a"], method, first_calls)
    assert first_calls == {method.name: 5.0}


@pytest.mark.parametrize(("errors", "seconds", "points", "smallest", "why"), [
    ([1e-2, 1e-4, 1e-6, 1e-8], [0.01, 0.1, 0.25, 0.4], 3, 1e-6, STOPPED),
    ([1e-2, 1e-4], [0.01, 0.1], 2, 1e-4, "all settings tried"),
    ([1e-3, *(1.01e-3 + 1e-5 * k for k in range(9))], [0.01] * 10, 6, 1e-3, "no more digits"),
    ([3.0, 3.0], [0.01, 0.3], 0, math.inf, STOPPED),
    ([-1.0, -1.0], [0.0, 0.0], 0, math.inf, "not run at 1: not with me"),
    ([-1.0, 1e-3], [0.0, 0.1], 1, 1e-3, "all settings tried"),
])  # fmt: skip
def test_why_a_method_ended_is_kept(errors, seconds, points: int, smallest: float, why: str) -> None:
    found, ending = explore(WHAT, CASES["a"], _made(errors, seconds), {})
    assert len(found) == points
    assert ending.error == pytest.approx(smallest, rel=1e-6)
    assert (ending.why, ending.stopped) == (why, why == STOPPED)


def test_a_method_that_runs_at_no_step_size_is_given_up() -> None:
    def run(case: Case, value: float) -> Run:
        raise NotFeasibleError("never")

    found, ending = explore(WHAT, CASES["a"], replace(_made([], []), settings=methods.step_counts, run=run), {})
    assert found == []
    assert ending.why.endswith("never")


def test_no_finer_setting_is_tried_below_round_off() -> None:
    made = _made([1e-4, 0.0, 0.0], [0.01] * 3)
    found, ending = explore(WHAT, replace(CASES["a"], accuracies=()), made, {})
    assert [tried.row.value for tried in found] == [0.0, 1.0]
    assert ending.why == "no more digits"
    assert len(explore(WHAT, CASES["a"], made, {})[0]) == 3  # plans of all accuracies that are named


@pytest.mark.parametrize("key", ["a", "g"])
def test_what_it_takes_to_get_ready_is_no_part_of_the_cost(key: str) -> None:
    (tried,), _ = explore(WHAT, CASES[key], _made([1e-3], [1e-5]), {"MuJoCo, made up": 0.0})
    assert tried.row.run_seconds == 1e-5


def test_long_motions_are_said_to_be_beyond_the_peers_time(monkeypatch) -> None:
    monkeypatch.setattr(measure, "peers", lambda: [*solvers.SCIPY, solvers.HEYOKA])
    for peer in measure.peers():
        assert why_not(peer, CASES["g"]) == "a turn by 7e+06 rad takes it too long"
        assert peer not in contestants(CASES["g"])
        assert peer in contestants(CASES["a"])


def test_noise_is_how_far_halves_of_the_repeats_come_apart() -> None:
    times = iter([3.0, 2.2, 2.0, 2.5, 4.0, 2.4])
    tried = Trial(made_row("MuJoCo", "peer", 1e-6, 0.5), Run([], lambda k: k * next(times), 1.0), 10.0)
    for _ in range(6):
        tried.time(1e-9)
    row = tried.row
    assert (row.run_seconds, row.seconds, row.spread) == (2.0, 0.2, pytest.approx(1.1))
    rows = [replace(row, spread=1.0 + 0.01 * k) for k in range(100)]
    assert made_chart(made_plan(1e-10, 1.0, spread=2.0), *rows).noise == pytest.approx(1.95)


POWER_LAW = [made_row("RK4, quaternion", "classic", n**-4.0, 1e-6 * n) for n in (10.0, 20.0, 40.0, 80.0)]


def test_cost_follows_the_power_law_between_points_of_the_front() -> None:
    """It is the first point's where that is good enough, and none beyond the last."""
    for n in (15.0, 40.0, 77.0):
        assert cost_of(POWER_LAW, n**-4.0 * (1 + 1e-12)) == pytest.approx(1e-6 * n, rel=1e-9)
    assert cost_of(POWER_LAW, 1.0) == pytest.approx(1e-5)
    assert cost_of(POWER_LAW, 1e-12) is None
    worse = replace(POWER_LAW[1], error=1e-3)
    assert front([worse, *POWER_LAW]) == POWER_LAW


def test_answers_name_the_cheapest_of_each_kind() -> None:
    exact, planned = made_row("one axis", "exact", 1e-16, 1e-7), made_plan(1e-16, 2e-7)
    chart = made_chart(*POWER_LAW, exact, planned, made_row("SciPy DOP853", "peer", 1e-7, 1e-2))
    found = next(row for row in answers(chart) if row["accuracy"] == pytest.approx(1e-6))
    assert (found["library"], found["library_cost"]) == ("one axis", pytest.approx(1e-6))  # of a run of 10 s
    assert (found["planned"], found["planned_cost"]) == ("rbfmu, as planned", pytest.approx(2e-6))
    assert found["integrator_cost"] == pytest.approx(1e-5 * 10**1.5)
    assert (found["peer"], found["peer_cost"]) == ("SciPy DOP853", pytest.approx(1e-1))


@pytest.mark.parametrize(
    ("error", "others", "kept"), [(1e-10, 1.0, True), (2e-9, 1.0, False), (1e-10, 0.5, False), (1e-10, 0.75, True)]
)
def test_plans_are_held_against_their_accuracy_and_the_best_rival(error: float, others: float, kept: bool) -> None:
    found = judged(error, others, 1.0)
    assert found.dearness == pytest.approx(1.0 / others)
    assert found.kept == kept
    assert ("Every plan" in plans_text([found], ())) == kept


@pytest.mark.parametrize(
    ("peer", "words", "use"),
    [(2.5, "2.5 x", "closed form"), (1.08, "even", "closed form"), (0.93, "even", "closed form"),
     (0.25, "0.25 x", "heyoka.py")],
)  # fmt: skip
def test_what_is_within_noise_is_even_and_a_cheaper_peer_is_what_to_use(peer: float, words: str, use: str) -> None:
    found = judged(1e-10, 1.0, peer)
    assert found.kept
    assert f"heyoka.py            {words}\n" in plans_text([found], ())
    assert drawing.cell_of(found)[1] == use


def test_a_peer_stopped_by_time_is_not_said_to_be_unable() -> None:
    rows = made_plan(1e-10, 1e-6), made_row("MuJoCo RK4", "peer", 1e-7, 1e-3)
    slow = End("MuJoCo", "MuJoCo RK4", 1e-7, "")
    for why, words in ((STOPPED, STOPPED), ("no more digits", "none reaches it")):
        chart = made_chart(*rows, ends=(slow._replace(why=why),))
        (found,) = verdicts([chart])
        assert plans_text([found], ()).endswith(words)
        assert ("stopped" in drawing.cell_of(found)[3]) == chart.ends[0].stopped
        assert f"{'stopped' if why == STOPPED else 'misses it'}: 1e-7 by MuJoCo RK4" in chart.table


def test_a_refused_plan_is_in_the_table_with_what_the_peer_costs() -> None:
    peer, few = made_row("heyoka.py", "peer", 1e-13, 2e-5), made_chart(made_plan(1e-10, 1e-6))
    coarse = made_chart(peer, made_plan(1e-7, 1e-6, value=1e-6), many=True, accuracy=1e-6)
    found = next(v for v in verdicts([few, coarse]) if v.chart.many and v.accuracy == 1e-9)
    assert found.method == "refused"
    assert drawing.cell_of(found)[1:] == ("heyoka.py", "20 µs", "plan refuses")


# A chart of one's own scene


def _row(kind: str, method: str, family: str, error: float, micros: float, **more: object) -> Row:
    row = Row(kind, method, "", family, "tolerance", 1e-6, error, 1e-6 * micros, 2e-6 * micros, 1.05, math.nan)
    return replace(row, **more)


def made_up(peer: float, scene: str = "it", **changes: object) -> Chart:
    """A plan of 1 us at 1e-6, a peer that costs so many, one that is too slow, and one that never gets there."""
    detail = "elliptic functions, Gauss's rule of 16 points"
    plan = _row("rbfmu's plan", "rbfmu, as planned", "planned", 2e-7, 1.0, detail=detail)
    peers_rows = [_row("heyoka.py", "heyoka.py", "peer", 10.0**-k, peer * 1.2 ** (k - 6)) for k in range(3, 14)]
    slow = [_row("MuJoCo", "MuJoCo implicitfast", "peer", 10.0**-k, 900.0 * 2.0**k) for k in range(1, 4)]
    others = [_row("RK4, Euler and others", "RK4, quaternion not normalised", "classic", 10.0**-k, 3.0 * 2.0**k)
              for k in range(1, 13)]  # fmt: skip
    ends = [End(row.kind, row.method, row.error, why) for row, why in
            ((peers_rows[-1], "all settings tried"), (slow[-1], STOPPED), (others[-1], STOPPED))]  # fmt: skip
    further = [replace(plan, value=1e-7, error=9e-9, seconds=1.5e-6), replace(plan, value=1e-8, seconds=4e-6)]
    chart = Chart(
        scene, "torque-free body, body force", 1e-6, 2.0, 400, ("torque_b",),
        (*others, *peers_rows, *slow, plan, *further), tuple(ends),
        (TooSmall("torque-free symmetric body", 0.37), TooSmall("angular momentum", math.inf,
         "shows no attitude")), ("Drake: not installed",), "1e-09: refused", ("a processor",),
    )  # fmt: skip
    return replace(chart, **changes)


@pytest.mark.parametrize(("peer", "first", "second"), [
    (3.0, "it at 1e-6, ports at zero: use rbfmu's plan, 1.0 µs per", "best peer heyoka.py, 3.0 x that"),
    (1.02, "use rbfmu's plan", "heyoka.py is even"),
    (0.97, "use rbfmu's plan", "heyoka.py is even"),
    (0.5, "cheapest is heyoka.py, 500 ns per simulated second", "rbfmu's plan costs 2.0 x that"),
])  # fmt: skip
def test_the_headline_names_what_to_use(peer: float, first: str, second: str) -> None:
    lines = list(made_up(peer).headline)
    assert first in lines[0]
    assert second in lines[1]


def test_noise_is_that_of_what_costs_about_as_much_as_the_plan() -> None:
    noisy = [replace(row, spread=9.0 if row.seconds > 1e-5 else row.spread) for row in made_up(3.0).rows]
    assert made_up(3.0, rows=tuple(noisy)).noise == pytest.approx(1.05)
    noisy = [replace(row, spread=1.4) for row in made_up(3.0).rows]
    assert made_up(3.0, rows=tuple(noisy)).noise == pytest.approx(1.4)


def test_the_table_has_every_answer() -> None:
    text = made_up(3.0).table
    assert "MuJoCo                stopped: 1e-3 by MuJoCo implicitfast (stopped: time limit)" in text
    assert "torque-free symmetric body          0.37     3.7e+05 x" in text
    assert "shows no attitude" in text
    assert "1e-7      elliptic functions, Gauss's rule of 16" in text
    assert "1e-09: refused" in text
    assert "torque_b at zero" in text
    assert "Drake: not installed" in text
    assert max(map(len, text.splitlines())) <= WIDTH
    text = made_up(3.0, held="at their start").table
    assert "at 1e-6, ports at their start: use" in text
    assert "torque_b at their start all the time" in text
    assert "the first 2 s of 500 s" in made_up(3.0, whole=500.0).conditions


def test_a_method_stopped_by_time_is_not_said_to_be_unable() -> None:
    one = made_up(3.0)
    unable = made_up(3.0, ends=tuple(end._replace(why="no more digits") for end in one.ends))
    for chart, word, other in ((one, "stopped", "misses"), (unable, "misses", "stopped")):
        labels = [text.get_text() for axes in chart.figure().axes for text in axes.texts]
        assert f"MuJoCo  {word}" in labels
        assert f"MuJoCo  {other}" not in labels
    assert "MuJoCo                misses it: 1e-3 by MuJoCo implicitfast (no more digits)" in unable.table


def test_the_smallest_error_counts_of_a_method_that_then_cannot_run() -> None:
    """2026-12-01: the table had the first error, and no reason: "misses it: 0.1 by MuJoCo implicitfast ()"."""
    heyoka, mujoco, others = made_up(3.0).ends
    refused = made_up(3.0, ends=(heyoka, mujoco._replace(why="not run at 1e-5: small"), others))
    assert "misses it: 1e-3 by MuJoCo implicitfast (not run at 1e-5:" in refused.table
    rows = tuple(row for row in refused.rows if row.kind != "MuJoCo")
    never = replace(refused, rows=rows, ends=(mujoco._replace(error=math.inf, why="not run at 1: no"),))
    assert "MuJoCo" not in never.table


def test_the_picture_s_words_name_further_digits_and_models() -> None:
    small = [*made_up(3.0).too_small, *(TooSmall(m, 1e-9, "takes no torque_b") for m in ("one", "two"))]
    words = " ".join(text.get_text() for text in made_up(3.0, too_small=tuple(small)).figure().texts)
    assert "1e-7: 1.5 x, 1e-8: 4.0 x, no plan at 1e-09" in words
    assert "their errors: torque-free symmetric body 0.37. Models without torque_b: one, two." in words
    even = [replace(row, seconds=1e-6) for row in made_up(3.0).plans]
    others = [row for row in made_up(3.0).rows if row.family != "planned"]
    words = " ".join(text.get_text() for text in made_up(3.0, rows=(*others, *even)).figure().texts)
    assert "1e-7 to 1e-8: 1.0 x" in words


def test_dollars_of_a_scene_s_name_are_no_mathematics():
    """The title was set as it, and its underscores were a fault of Matplotlib's."""
    title = replace(made_up(3.0), scene="cost $5_ and $6_x").figure().texts[0]
    assert not title.get_parse_math()


def test_costs_within_a_decade_have_no_labels_of_another_kind() -> None:
    one = made_up(3.0)
    figure = replace(one, rows=one.plans[:1], ends=()).figure()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert not any(tick.label1.get_text() for tick in axes.yaxis.get_minor_ticks())


@pytest.mark.parametrize(("seconds", "text"), [
    (1.2e-15, "1.2 fs"), (3.4e-13, "340 fs"), (5e-12, "5.0 ps"), (1.54e-8, "15 ns"), (9.96e-6, "10 µs"),
    (1.06e-6, "1.1 µs"), (0.25, "250 ms"), (1.5, "1.5 s"),
])  # fmt: skip
def test_costs_have_units_of_their_size(seconds: float, text: str) -> None:
    assert cost_text(seconds) == text


def crowded(seed: int) -> Chart:
    """All kinds of methods, whose lines end anywhere."""
    draw, rows, ends = random.Random(seed), [], []
    for kind in KINDS:
        cost, best = 10.0 ** draw.uniform(-1.0, 4.0), draw.randint(4, 15)
        if kind != "rbfmu's plan":
            mine = [_row(kind, kind, "peer", 10.0**-k, cost * 1.3**k) for k in range(draw.randint(1, 3), best)]
            rows += mine
            ends.append(End(kind, kind, mine[-1].error, STOPPED))
    one = made_up(1.0, draw.choice(("it", "a_satellite_with_a_long_name_that_somebody_gave_it")))
    accuracy = 10.0 ** -draw.randint(1, 13)
    plans = [replace(row, value=accuracy * 0.1**k) for k, row in enumerate(one.plans)]
    return replace(one, rows=(*rows, *plans), ends=tuple(ends), accuracy=accuracy)


@pytest.mark.parametrize("seed", some_of(range(12), 3))
def test_no_label_of_the_picture_lies_on_another(seed: int) -> None:
    assert overlaps(crowded(seed).figure()) == []
    assert max(map(len, crowded(seed).table.splitlines())) <= WIDTH
