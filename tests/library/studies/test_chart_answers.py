"""`rbfmu chart`: why a method ended, what it costs, and what is said of plans and peers, on made-up figures."""

import math
from dataclasses import replace

import pytest

from rbfmu.studies.chart import drawing, methods, solvers
from rbfmu.studies.chart.cases import CASES, Case
from rbfmu.studies.chart.contestants import contestants, why_not
from rbfmu.studies.chart.findings import cost_of, front, noise, verdicts
from rbfmu.studies.chart.measure import Extent, Tried, explore
from rbfmu.studies.chart.methods import NotFeasibleError, Run
from rbfmu.studies.chart.motions import answers
from rbfmu.studies.chart.result import STOPPED, End
from rbfmu.studies.chart.tables import plans_text
from tests.support.chart_points import judged, made_chart, made_plan, made_row, true_states, turned_by

WHAT = Extent(0.3, 2, 1e-3)


class _Made(methods.Method):
    """A method whose errors and times are given."""

    name = "MuJoCo, made up"

    def __init__(self, errors: list[float], seconds: list[float]) -> None:
        self.given = list(zip(errors, seconds, strict=True))

    def settings(self, case: Case, quick: bool):
        return map(float, range(len(self.given)))

    def run(self, case: Case, value: float) -> Run:
        error, seconds = self.given[int(value)]
        if error < 0.0:
            raise NotFeasibleError("not with me")
        turned = [(r, v, turned_by(q, error), w) for r, v, q, w in true_states(case.key)]
        return Run(lambda: turned, lambda k: k * seconds, 1.0)


@pytest.mark.parametrize(
    ("errors", "seconds", "points", "smallest", "why"),
    [
        ([1e-2, 1e-4, 1e-6, 1e-8], [0.01, 0.1, 0.25, 0.4], 3, 1e-6, STOPPED),
        ([1e-2, 1e-4], [0.01, 0.1], 2, 1e-4, "all settings tried"),
        ([1e-3, *(1.01e-3 + 1e-5 * k for k in range(9))], [0.01] * 10, 6, 1e-3, "no more digits"),
        ([3.0, 3.0], [0.01, 0.3], 0, math.inf, STOPPED),
        ([-1.0, -1.0], [0.0, 0.0], 0, math.inf, "not run at 1: not with me"),
        ([-1.0, 1e-3], [0.0, 0.1], 1, 1e-3, "all settings tried"),
    ],
)
def test_why_a_method_ended_is_kept(errors, seconds, points: int, smallest: float, why: str) -> None:
    found, ending = explore(WHAT, CASES["a"], _Made(errors, seconds), {})
    assert len(found) == points
    assert ending.error == pytest.approx(smallest, rel=1e-6)
    assert (ending.why, ending.stopped) == (why, why == STOPPED)


def test_a_method_that_runs_at_no_step_size_is_given_up() -> None:
    class Refusing(_Made):
        def settings(self, case: Case, quick: bool):
            return methods.step_counts(case, quick)

        def run(self, case: Case, value: float) -> Run:
            raise NotFeasibleError("never")

    found, ending = explore(WHAT, CASES["a"], Refusing([], []), {})
    assert found == []
    assert ending.why.endswith("never")


def test_no_finer_setting_is_tried_below_round_off() -> None:
    made = _Made([1e-4, 0.0, 0.0], [0.01] * 3)
    found, ending = explore(WHAT, replace(CASES["a"], accuracies=()), made, {})
    assert [tried.value for tried in found] == [0.0, 1.0]
    assert ending.why == "no more digits"
    assert len(explore(WHAT, CASES["a"], made, {})[0]) == 3  # plans of all accuracies that are named


@pytest.mark.parametrize("key", ["a", "g"])
def test_what_it_takes_to_get_ready_is_no_part_of_the_cost(key: str) -> None:
    (tried,), _ = explore(WHAT, CASES[key], _Made([1e-3], [1e-5]), {_Made.name: 0.0})
    assert tried.seconds == 1e-5


def test_long_motions_are_said_to_be_beyond_the_peers_time() -> None:
    for peer in (solvers.Odeint(), solvers.Heyoka()):
        assert why_not(peer, CASES["g"]) == "a turn by 7e+06 rad takes it too long"
        assert peer not in contestants(CASES["g"], [peer])
        assert peer in contestants(CASES["a"], [peer])


def test_noise_is_how_far_halves_of_the_repeats_come_apart() -> None:
    times = iter([3.0, 2.2, 2.0, 2.5, 4.0, 2.4])
    tried = Tried(_Made([], []), 0.1, Run(list, lambda k: k * next(times), 1.0), 1e-6, 5.0)
    for _ in range(6):
        tried.time(1e-9)
    assert tried.seconds == 2.0
    assert tried.spread == pytest.approx(1.1)
    row = tried.row(CASES["e"])
    assert (row.run_seconds, row.seconds, row.spread) == (2.0, 0.2, tried.spread)
    rows = [replace(row, spread=1.0 + 0.01 * k) for k in range(100)]
    assert noise(made_chart(made_plan(1e-10, 1.0, spread=2.0), *rows)) == pytest.approx(1.95)


POWER_LAW = [made_row("RK4, quaternion", "classic", n**-4.0, 1e-6 * n) for n in (10.0, 20.0, 40.0, 80.0)]


def test_cost_follows_the_power_law_between_points() -> None:
    for n in (15.0, 40.0, 77.0):
        assert cost_of(POWER_LAW, n**-4.0 * (1 + 1e-12)) == pytest.approx(1e-6 * n, rel=1e-9)


def test_cost_is_the_first_point_s_where_that_is_good_enough_and_none_beyond_the_last() -> None:
    assert cost_of(POWER_LAW, 1.0) == pytest.approx(1e-5)
    assert cost_of(POWER_LAW, 1e-12) is None


def test_front_leaves_out_what_a_cheaper_point_beats() -> None:
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
    rows, slow = (
        (made_plan(1e-10, 1e-6), made_row("MuJoCo RK4", "peer", 1e-7, 1e-3)),
        End("MuJoCo", "MuJoCo RK4", 1e-7, ""),
    )
    for why, words in ((STOPPED, STOPPED), ("no more digits", "none reaches it")):
        chart = made_chart(*rows, ends=(replace(slow, why=why),))
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
