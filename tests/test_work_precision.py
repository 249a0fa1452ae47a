"""`rbfmu chart`: references against other arithmetic, figures that are what they claim to be, answers, files."""

import importlib.util
import math
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import ModuleType

import free_rotation_mp
import mpmath as mp
import numba
import pytest
import reference_mp

from rbfmu.work_precision import cases, collection, methods, own, peers, run_charts, simulators
from rbfmu.work_precision.answers import Offer, answer_table, answers, cost_of, front, text_of
from rbfmu.work_precision.cases import CASES, CHECKPOINTS, reference
from rbfmu.work_precision.collection import Point, read_points, write_points
from rbfmu.work_precision.plans import verdict_table, verdicts

DIGITS = mp.mpf(10) ** -37
"""Of 40 in the file; body rates grow to 50."""
EPS = 2.0**-52
OWN = {method.name: method for method in own.own_methods()}


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = Path(__file__).parents[1] / "examples" / "reference_motions.py"
    spec = importlib.util.spec_from_file_location("reference_motions", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _largest_difference(a, b):
    with mp.workdps(60):
        return max(abs(mp.mpf(x) - mp.mpf(y)) for u, v in zip(a, b, strict=True) for x, y in zip(u, v, strict=True))


# References


@pytest.mark.parametrize("key", CASES)
def test_references_are_of_these_scenes(key: str) -> None:
    assert cases._references()[key]["scene"] == CASES[key].scene.to_dict()


@pytest.mark.parametrize("key", ["d", "e"])
def test_references_do_not_depend_on_the_arithmetic_s_settings(script: ModuleType, key: str) -> None:
    stored, again = cases._references()[key], script.reference_motion(key, script.Settings(230, 32, 60))
    assert max(_largest_difference(stored[name], again[name]) for name in again) < DIGITS


@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_torque_free_references_are_the_closed_form(key: str) -> None:
    case, stored = CASES[key], cases._references()[key]
    for i in (0, CHECKPOINTS - 1):
        q, omega = free_rotation_mp.closed_form(case.moments, *case.start[2:], case.interval * (i + 1))
        with mp.workdps(60):
            sign = mp.sign(sum(x * mp.mpf(y) for x, y in zip(q, stored["quaternion"][i], strict=True)))
            q = [sign * x for x in q]
        assert _largest_difference([q], [stored["quaternion"][i]]) < DIGITS
        assert _largest_difference([omega], [stored["omega_b"][i]]) < DIGITS


@pytest.mark.parametrize("key", ["c'", "d", "e", "f"])
def test_forced_references_agree_with_another_formulation(key: str) -> None:
    case, stored = CASES[key], cases._references()[key]
    times = tuple(case.interval * (i + 1) for i in range(1 if key == "c'" else CHECKPOINTS))
    for i, point in enumerate(reference_mp.motion(case.scene, times)):
        with mp.workdps(60):
            e, x, y, z = map(mp.mpf, stored["quaternion"][i])
            bottom = [2 * (x * z - e * y), 2 * (y * z + e * x), e * e - x * x - y * y + z * z]
        assert _largest_difference([bottom], [point.R_ab[2]]) < DIGITS
        assert _largest_difference([point.omega_b], [stored["omega_b"][i]]) < DIGITS


# Errors


def _true_states(key: str):
    truth, case = reference(key), CASES[key]
    rows = zip(truth["r_c"], truth["q"], truth["omega_b"], strict=True)
    return [(tuple(r), case.start[1], tuple(q), tuple(w)) for r, q, w in rows]


@pytest.mark.parametrize("key", CASES)
def test_the_truth_has_no_error_and_keeps_what_it_keeps(key: str) -> None:
    found = CASES[key].errors(_true_states(key))
    assert found["attitude"] < 2 * EPS  # its rounding
    assert found["position"] < 3e-16
    for name in cases.DRIFTS:
        assert found[name] < 1e-14 if name in CASES[key].keeps else math.isnan(found[name])


def test_errors_are_angles() -> None:
    states = _true_states("a")
    half = 0.5e-6
    e, x, y, z = states[3][2]
    turned = (e * math.cos(half) - x * math.sin(half), x * math.cos(half) + e * math.sin(half),
              y * math.cos(half) + z * math.sin(half), z * math.cos(half) - y * math.sin(half))  # fmt: skip
    states[3] = (*states[3][:2], tuple(-2.0 * c for c in turned), states[3][3])  # neither sign nor length counts
    assert CASES["a"].errors(states)["attitude"] == pytest.approx(1e-6, rel=1e-9)


def test_what_is_not_finite_has_an_infinite_error() -> None:
    states = _true_states("a")
    states[1] = (*states[1][:3], (math.nan, 0.0, 0.0))
    assert CASES["a"].errors(states)["attitude"] == math.inf


# Methods


def test_steps_divide_the_checkpoints_intervals() -> None:
    for case in CASES.values():
        counts = [case.interval / h for h in islice(methods.step_counts(case, False), 12)]
        assert counts == pytest.approx([round(n) for n in counts], rel=1e-12)
        assert counts == sorted(set(counts))


@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_exact_motion_is_exact(key: str) -> None:
    assert CASES[key].errors(OWN["exact"].run(CASES[key], 5).states())["attitude"] < 1e-15


@pytest.mark.parametrize("name", ["Taylor, order 12", "DOP853, error control"])
@pytest.mark.parametrize("key", ["d", "e", "f"])
def test_substeps_meet_their_tolerance(key: str, name: str) -> None:
    found = CASES[key].errors(OWN[name].run(CASES[key], 1e-12).states())
    assert max(found["attitude"], found["position"]) < 1e-12 * 60  # steps


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_plans_keep_their_promise(accuracy: float) -> None:
    for key in ("c", "c'", "d", "f"):
        found = CASES[key].errors(OWN["rbfmu, as planned"].run(CASES[key], accuracy).states())
        assert max(found["attitude"], found["position"]) <= accuracy


# Peers


def test_scipy_has_the_same_equations() -> None:
    for compiled in (True, False):
        for key in ("c'", "e", "f"):
            found = CASES[key].errors(peers.SciPy("DOP853", compiled).run(CASES[key], 1e-9).states())
            assert max(found["attitude"], found["position"]) < 1e-6


def test_absent_peers_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "_package", lambda name: None)
    found, versions = peers.peers.__wrapped__()
    assert found == ()
    assert versions == dict.fromkeys(("SciPy", "MuJoCo", "Basilisk", "Drake"), "not installed")


def test_a_peer_that_does_not_load_is_not_feasible() -> None:
    with pytest.raises(methods.NotFeasibleError, match="does not load"):
        simulators.module("rbfmu.no_such_module")


# Answers


def _point(method: str, family: str, error: float, seconds: float) -> Point:
    return Point("a", "free body", method, family, "step (s)", 0.1, error, 0.0, 0.0, 0.0, 0.0, 1.0, seconds, 10.0, 0.0)


POWER_LAW = [_point("RK4, quaternion", "classic", n**-4.0, 1e-6 * n) for n in (10.0, 20.0, 40.0, 80.0)]


def test_cost_follows_the_power_law_between_points() -> None:
    for n in (15.0, 40.0, 77.0):
        assert cost_of(POWER_LAW, n**-4.0 * (1 + 1e-12)) == pytest.approx(1e-7 * n, rel=1e-9)


def test_cost_is_the_first_point_s_where_that_is_good_enough_and_none_beyond_the_last() -> None:
    assert cost_of(POWER_LAW, 1.0) == pytest.approx(1e-6)
    assert cost_of(POWER_LAW, 1e-12) is None


def test_front_leaves_out_what_a_cheaper_point_beats() -> None:
    worse = replace(POWER_LAW[1], attitude_error=1e-3)
    assert front([worse, *POWER_LAW]) == POWER_LAW


def test_answers_name_the_cheapest_of_each_kind() -> None:
    exact, planned = _point("exact", "exact", 1e-16, 1e-7), _point("rbfmu, as planned", "planned", 1e-16, 2e-7)
    (found,) = answers([*POWER_LAW, exact, planned, _point("SciPy DOP853", "peer", 1e-7, 1e-2)], [1e-6])
    assert found.own == Offer("exact", "exact", 1e-8)
    assert found.planned == Offer("rbfmu, as planned", "planned", 2e-8)
    assert found.contestant is not None
    assert found.contestant.cost == pytest.approx(1e-7 * 10**1.5)
    assert found.peer == Offer("SciPy DOP853", "peer", 1e-3)


def test_answers_on_the_terminal_name_method_and_cost() -> None:
    exact, peer = _point("exact", "exact", 1e-16, 1e-7), _point("SciPy DOP853", "peer", 1e-7, 1e-2)
    head, _, names, costs = answer_table(answers([*POWER_LAW, exact, peer], [1e-6, 1e-9]), [1e-6, 1e-9]).splitlines()
    assert head.split() == ["attitude", "error", "at", "most", "1e-6", "rad", "1e-9", "rad"]
    assert names.split() == ["free", "body", "exact", "exact"]
    assert costs.strip().startswith("10 ns a second, best peer 100000 x")
    assert costs.endswith("10 ns a second")


def test_costs_in_words() -> None:
    assert [text_of(x) for x in (2.63e-13, 15.4e-9, 1.06e-6, 9.96e-6, 3e-3, 1.5)] == [
        "263 fs", "15 ns", "1.1 µs", "10 µs", "3.0 ms", "1.5 s",
    ]  # fmt: skip


# Plans


def _at_rest(method: str, family: str, error: float, seconds: float) -> Point:
    return replace(_point(method, family, error, seconds), case="e", value=1e-9)


@pytest.mark.parametrize(
    ("error", "others", "peers_cost", "kept"),
    [(1e-10, 1.0, 1.0, True), (2e-9, 1.0, 1.0, False), (1e-10, 0.5, 1.0, False), (1e-10, 1.0, 0.5, False)],
)
def test_plans_are_held_against_their_accuracy_the_best_contestant_and_the_best_peer(
    error: float, others: float, peers_cost: float, kept: bool
) -> None:
    planned = _at_rest("rbfmu, as planned", "planned", error, 1e-6)
    contestants = [
        _at_rest("exact", "exact", 1e-16, 2e-6),
        _at_rest("Taylor, order 16", "Taylor", 1e-11, others * 1e-6),
    ]
    peer = _at_rest("SciPy DOP853", "peer", 1e-10, peers_cost * 101e-6)
    (found,) = verdicts([planned, *contestants, peer, _at_rest("RK4, matrix", "classic", 1e-8, 1e-9)])
    assert found.method == "closed form"
    assert found.dearness == pytest.approx(1.0 / others)
    assert found.lead == pytest.approx(101.0 * peers_cost)
    assert found.kept == kept
    assert ("kept" if kept else "MISSED") in verdict_table([found])


def test_a_closed_form_under_torque_competes() -> None:
    """Damping about one axis."""
    closed = OWN["closed form"]
    assert [key for key, case in CASES.items() if closed.suits(case)] == ["e"]
    run = closed.run(CASES["e"], *closed.settings(CASES["e"], False))
    assert CASES["e"].errors(run.states())["attitude"] < 1e-13


# Files


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


def test_quick_run_writes_figures_answers_and_pictures(files: dict[str, Path]) -> None:
    pictures = {"answers.png", *(f"case_{key}.png" for key in collection.QUICK_CASES)}
    assert set(files) == {"work_precision.csv", "answers.csv", "answers.txt", *pictures}
    for name in pictures:
        assert files[name].read_bytes().startswith(b"\x89PNG")


def test_figures_tell_machine_and_versions_and_are_read_back_as_written(files: dict[str, Path], tmp_path: Path) -> None:
    text = files["work_precision.csv"].read_text()
    head = [line for line in text.splitlines() if line.startswith("#")]
    assert "processors" in head[0]
    assert f"numba {numba.__version__}" in head[1]
    assert "SciPy" in head[2]
    points = read_points(files["work_precision.csv"])
    again = write_points(tmp_path / "again.csv", points).read_text()
    assert [line for line in again.splitlines() if line[0] != "#"] == [x for x in text.splitlines() if x[0] != "#"]


def test_quick_figures_are_sound(files: dict[str, Path]) -> None:
    points = read_points(files["work_precision.csv"])
    assert {p.method for p in points} >= {
        "exact", "DOP853, error control", "Taylor, order 12", "kicks, order 4", "SciPy DOP853",
    }  # fmt: skip
    for point in points:
        assert point.seconds > 0.0
        assert point.compiling >= 0.0
        assert 0.0 <= point.attitude_error <= collection.LARGEST_ERROR


def test_answers_are_those_of_the_figures(files: dict[str, Path]) -> None:
    table = answer_table(answers(read_points(files["work_precision.csv"])))
    assert files["answers.txt"].read_text().startswith(table)
