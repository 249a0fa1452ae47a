"""`rbfmu chart`: why a method ended, what it costs, and what is said of plans and peers, on made-up figures."""

import math
from dataclasses import replace

import pytest

from rbfmu.studies.work_precision import (
    cases,
    collection,
    drawing,
    methods,
    solvers,
)  # fmt: skip
from rbfmu.studies.work_precision.answers import Offer, answers, cost_of, front, text_of
from rbfmu.studies.work_precision.cases import CASES
from rbfmu.studies.work_precision.collection import (
    STOPPED,
    Collection,
    Ending,
    Extent,
    Tried,
    explored,
)  # fmt: skip
from rbfmu.studies.work_precision.methods import NotFeasibleError, Run
from rbfmu.studies.work_precision.plans import verdicts
from rbfmu.studies.work_precision.tables import dearness_table, plan_table, stopped_table
from tests.support.chart_points import at_rest, judged, made_point, true_states, turned_by


class _Made:
    """A method whose errors and times are given."""

    name, family, setting = "made", "peer", "step (s)"

    def __init__(self, errors: list[float], seconds: list[float]) -> None:
        self.given = list(zip(errors, seconds, strict=True))

    def suits(self, case: cases.Case) -> bool:
        return True

    def settings(self, case: cases.Case, quick: bool):
        return map(float, range(len(self.given)))

    def run(self, case: cases.Case, value: float) -> Run:
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
    what = Extent((), (), 0.3, 2, 1e-3, False)
    found, ending = explored(what, CASES["a"], _Made(errors, seconds), {})
    assert len(found) == points
    assert ending.error == pytest.approx(smallest, rel=1e-6)
    assert (ending.why, ending.stopped) == (why, why == STOPPED)


def test_a_method_that_runs_at_no_step_size_is_given_up() -> None:
    class Refusing(_Made):
        def settings(self, case: cases.Case, quick: bool):
            return methods.step_counts(case, quick)

        def run(self, case: cases.Case, value: float) -> Run:
            raise NotFeasibleError("never")

    what = Extent((), (), 0.3, 2, 1e-3, False)
    found, ending = explored(what, CASES["a"], Refusing([], []), {})
    assert found == []
    assert ending.why.endswith("never")


def test_no_finer_setting_is_tried_below_round_off() -> None:
    what = Extent((), (), 0.3, 2, 1e-3, False, 1e-5)
    found, ending = explored(what, CASES["a"], _Made([1e-4, 1e-6, 1e-8], [0.01] * 3), {})
    assert [tried.point.value for tried in found] == [0.0, 1.0]
    assert ending.why == "no more digits"


@pytest.mark.parametrize("key", ["a", "g"])
def test_what_it_takes_to_get_ready_is_no_part_of_the_cost(key: str) -> None:
    what = Extent((), (), 0.3, 2, 1e-3, False)
    (tried,), _ = explored(what, CASES[key], _Made([1e-3], [1e-5]), {"made": 0.0})
    assert tried.point.seconds == 1e-5


def test_long_motions_are_said_to_be_beyond_the_peers_time() -> None:
    what = Extent((CASES["g"],), (solvers.Odeint(),), 0.3, 1, 1e-3, True)
    (ending,) = collection.collect(what, lambda *step: None).endings
    assert ending == Ending("g", 5, "SciPy odeint", "peer", math.inf, STOPPED)


def test_noise_is_how_far_halves_of_the_repeats_come_apart() -> None:
    times = iter([3.0, 2.2, 2.0, 2.5, 4.0, 2.4])
    tried = Tried(made_point("made", "peer", 1e-6, 1.0), Run(list, lambda k: k * next(times), 1.0))
    for _ in range(6):
        tried.time(1e-9)
    assert tried.point.seconds == 2.0
    assert tried.point.spread == pytest.approx(1.1)
    points = [replace(tried.point, spread=1.0 + 0.01 * k) for k in range(101)]
    assert Collection(points, []).noise == pytest.approx(1.95)


POWER_LAW = [made_point("RK4, quaternion", "classic", n**-4.0, 1e-6 * n) for n in (10.0, 20.0, 40.0, 80.0)]


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
    exact, planned = made_point("exact", "exact", 1e-16, 1e-7), made_point("rbfmu, as planned", "planned", 1e-16, 2e-7)
    (found,) = answers([*POWER_LAW, exact, planned, made_point("SciPy DOP853", "peer", 1e-7, 1e-2)], [1e-6])
    assert found.library == Offer("exact", "exact", 1e-7)
    assert found.planned == Offer("rbfmu, as planned", "planned", 2e-7)
    assert found.integrator is not None
    assert found.integrator.cost == pytest.approx(1e-6 * 10**1.5)
    assert found.peer == Offer("SciPy DOP853", "peer", 1e-2)


def test_costs_in_words() -> None:
    assert [text_of(x) for x in (1.54e-8, 4.1e-7, 1.06e-6, 9.96e-6, 1.7e-4, 3e-3, 0.32, 1.5)] == [
        "0.015 µs", "0.41 µs", "1.1 µs", "10 µs", "170 µs", "3.0 ms", "320 ms", "1.5 s",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("error", "others", "kept"), [(1e-10, 1.0, True), (2e-9, 1.0, False), (1e-10, 0.5, False), (1e-10, 0.75, True)]
)
def test_plans_are_held_against_their_accuracy_and_the_best_rival(error: float, others: float, kept: bool) -> None:
    found = judged(error, others, 1.0)
    assert found.dearness == pytest.approx(1.0 / others)
    assert found.kept == kept
    assert ("Every plan" in dearness_table([found])) == kept


@pytest.mark.parametrize(
    ("peer", "words", "use"),
    [(2.5, "2.5 x", "closed form"), (1.08, "even", "closed form"), (0.93, "even", "closed form"),
     (0.25, "0.25 x", "heyoka.py")],
)  # fmt: skip
def test_what_is_within_noise_is_even_and_a_cheaper_peer_is_what_to_use(peer: float, words: str, use: str) -> None:
    found = judged(1e-10, 1.0, peer)
    assert found.kept
    assert plan_table([found]).splitlines()[-1].endswith(f"heyoka.py            {words}")
    assert drawing.cell_of(found)[1] == use


def test_a_peer_stopped_by_time_is_not_said_to_be_unable() -> None:
    planned = replace(at_rest("rbfmu, as planned", "planned", 1e-10, 1e-6), detail="closed form")
    slow = Ending("e", 5, "MuJoCo RK4", "peer", 1e-7, STOPPED)
    for ending, words in ((slow, STOPPED), (replace(slow, why="no more digits"), "none reaches it")):
        (found,) = verdicts(Collection([planned], [ending]))
        assert plan_table([found]).endswith(words)
        assert ("stopped" in drawing.cell_of(found)[3]) == ending.stopped
    told = stopped_table(Collection([planned], [slow], limit=0.25))
    assert "MuJoCo RK4: e 1e-7" in told
    assert "250 ms" in told
    assert stopped_table(Collection([planned], [replace(slow, why="no more digits")])) == ""


def test_a_refused_plan_is_in_the_table_with_what_the_peer_costs() -> None:
    refused = Collection([at_rest("heyoka.py", "peer", 1e-13, 2e-5), replace(
        at_rest("rbfmu, as planned", "planned", 1e-10, 1e-6), outputs=1000)], [])  # fmt: skip
    found = verdicts(refused)[0]
    assert found.method == "refused"
    assert drawing.cell_of(found)[1:] == ("heyoka.py", "20 µs", "plan refuses")
