"""`rbfmu chart`: references against other arithmetic, figures that are what they claim to be, answers, files."""

import math
import re
import tomllib
from dataclasses import replace
from itertools import combinations, islice, pairwise
from pathlib import Path
from types import ModuleType

import mpmath as mp
import numba
import pytest
from matplotlib.text import Text

from examples.benchmarks import plans
from examples.references import reference_motions
from rbfmu.studies.work_precision import (
    cases,
    collection,
    drawing,
    heyoka_peer,
    library_methods,
    methods,
    peers,
    run_charts,
    simulators,
    solvers,
    write_charts,
)  # fmt: skip
from rbfmu.studies.work_precision.answers import Offer, answers, cost_of, front, text_of
from rbfmu.studies.work_precision.cases import CASES, CHECKPOINTS, reference
from rbfmu.studies.work_precision.collection import (
    STOPPED,
    Collection,
    Ending,
    Extent,
    Point,
    Tried,
    explored,
    few_and_many,
    read_points,
    write_points,
)  # fmt: skip
from rbfmu.studies.work_precision.methods import NotFeasibleError, Run
from rbfmu.studies.work_precision.plans import verdicts
from rbfmu.studies.work_precision.tables import WIDTH, dearness_table, plan_table, stopped_table
from rbfmu_kernels.mechanics.equations_of_motion import State
from tests.support.paths import ROOT
from tests.support.references import free_rotation_mp, reference_mp

DIGITS = mp.mpf(10) ** -37
"""Of 40 in the file; body rates grow to 50."""
EPS = 2.0**-52
OWN = {method.name: method for method in library_methods.library_methods()}


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return reference_motions


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
        q, omega = free_rotation_mp.closed_form(
            case.moments, case.start.q_ab, case.start.omega_b, case.interval * (i + 1)
        )
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
    return [State(tuple(r), case.start.v_c, tuple(q), tuple(w)) for r, q, w in rows]


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


def test_many_outputs_are_of_the_same_motion() -> None:
    for case in few_and_many(CASES):
        assert case.interval * case.outputs == pytest.approx(case.span)
        assert len(range(case.outputs)[case.checkpoints]) == CHECKPOINTS
        assert range(case.outputs)[case.checkpoints][-1] == case.outputs - 1
    many = CASES["c"].with_many_outputs()
    assert many.outputs == 1000
    for name in ("RK4, quaternion", "splitting, order 4"):
        method = {m.name: m for m in (*library_methods.library_methods(), *methods.reference_integrators())}[name]
        few = CASES["c"].errors(method.run(CASES["c"], 0.005).states())
        assert many.errors(method.run(many, 0.005).states()) == few  # the same steps


def test_a_plan_gives_the_same_motion_at_many_outputs() -> None:
    for key in ("a", "d"):
        many = CASES[key].with_many_outputs()
        assert many.errors(OWN["rbfmu, as planned"].run(many, 1e-6).states())["attitude"] <= 1e-6


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


def _solvers() -> list[methods.Method]:
    return [*solvers.scipy_methods(), *solvers.numbalsoda_methods(), heyoka_peer.Heyoka()]


@pytest.mark.parametrize("method", _solvers(), ids=lambda method: method.name)
def test_solvers_have_the_same_equations_at_few_and_at_many_outputs(method: methods.Method) -> None:
    for name in ("numbalsoda", "heyoka"):
        if method.name.startswith(name):
            pytest.importorskip(name)
    for key in ("c'", "e", "f"):
        for case in few_and_many([key]):
            found = case.errors(method.run(case, 1e-8).states())
            assert max(found["attitude"], found["position"]) < 1e-5


@pytest.mark.parametrize("integrator", peers.MUJOCO_INTEGRATORS)
def test_mujoco_has_the_same_equations_at_few_and_at_many_outputs(integrator: str) -> None:
    pytest.importorskip("mujoco")
    assert "implicitfast" in peers.MUJOCO_INTEGRATORS
    for case in few_and_many(["d", "f"]):
        found = case.errors(simulators.MuJoCo(integrator).run(case, 0.0005).states())
        assert found["attitude"] < 0.06  # first order: 0.05 at this step


def test_absent_peers_are_named_and_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "_package", lambda name: None)
    monkeypatch.setattr(peers, "peers", peers.peers.__wrapped__)
    assert peers.peers()[0] == ()
    lines = peers.absent()
    assert len(lines) == len(peers._PEERS)
    assert 'heyoka.py: not installed (pip install "rbfmu[bench]")' in lines


def test_the_extras_that_are_named_install_their_peers() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for package, extra, _ in peers._PEERS.values():
        assert any(re.fullmatch(rf"{package}([>=].*)?", wanted) for wanted in extras[extra])


def test_a_peer_that_does_not_load_is_not_feasible() -> None:
    with pytest.raises(NotFeasibleError, match="does not load"):
        methods.module("rbfmu.no_such_module")


# Endings, on made-up methods


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
        turned = [(r, v, _turned(q, error), w) for r, v, q, w in _true_states(case.key)]
        return Run(lambda: turned, lambda k: k * seconds, 1.0)


def _turned(q, angle: float):
    e, x, y, z = q
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return (e * c - x * s, x * c + e * s, y * c + z * s, z * c - y * s)


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
    tried = Tried(_point("made", "peer", 1e-6, 1.0), Run(list, lambda k: k * next(times), 1.0))
    for _ in range(6):
        tried.time(1e-9)
    assert tried.point.seconds == 2.0
    assert tried.point.spread == pytest.approx(1.1)
    points = [replace(tried.point, spread=1.0 + 0.01 * k) for k in range(101)]
    assert Collection(points, []).noise == pytest.approx(1.95)


# Answers


def _point(method: str, family: str, error: float, seconds: float) -> Point:
    drifts = (error, error, math.nan)
    return Point("a", "free body", 5, method, "", family, "step (s)", 0.1, error, 0.0, *drifts, 1.0, seconds, 10.0, 0.0)


POWER_LAW = [_point("RK4, quaternion", "classic", n**-4.0, 1e-6 * n) for n in (10.0, 20.0, 40.0, 80.0)]


def test_cost_follows_the_power_law_between_points() -> None:
    for n in (15.0, 40.0, 77.0):
        assert cost_of(POWER_LAW, n**-4.0 * (1 + 1e-12)) == pytest.approx(1e-6 * n, rel=1e-9)


def test_cost_is_the_first_point_s_where_that_is_good_enough_and_none_beyond_the_last() -> None:
    assert cost_of(POWER_LAW, 1.0) == pytest.approx(1e-5)
    assert cost_of(POWER_LAW, 1e-12) is None


def test_front_leaves_out_what_a_cheaper_point_beats() -> None:
    worse = replace(POWER_LAW[1], attitude_error=1e-3)
    assert front([worse, *POWER_LAW]) == POWER_LAW


def test_answers_name_the_cheapest_of_each_kind() -> None:
    exact, planned = _point("exact", "exact", 1e-16, 1e-7), _point("rbfmu, as planned", "planned", 1e-16, 2e-7)
    (found,) = answers([*POWER_LAW, exact, planned, _point("SciPy DOP853", "peer", 1e-7, 1e-2)], [1e-6])
    assert found.library == Offer("exact", "exact", 1e-7)
    assert found.planned == Offer("rbfmu, as planned", "planned", 2e-7)
    assert found.integrator is not None
    assert found.integrator.cost == pytest.approx(1e-6 * 10**1.5)
    assert found.peer == Offer("SciPy DOP853", "peer", 1e-2)


def test_costs_in_words() -> None:
    assert [text_of(x) for x in (1.54e-8, 4.1e-7, 1.06e-6, 9.96e-6, 1.7e-4, 3e-3, 0.32, 1.5)] == [
        "0.015 µs", "0.41 µs", "1.1 µs", "10 µs", "170 µs", "3.0 ms", "320 ms", "1.5 s",
    ]  # fmt: skip


# Plans


def _at_rest(method: str, family: str, error: float, seconds: float) -> Point:
    return replace(_point(method, family, error, seconds), case="e", title="damped spin", value=1e-9)


def _judged(error: float, others: float, peer: float, noise: float = 1.1):
    """A plan of 1 µs at 1e-9, whose rival costs so many µs, and a peer."""
    points = [
        replace(_at_rest("rbfmu, as planned", "planned", error, 1e-6), detail="closed form"),
        _at_rest("exact", "exact", 1e-16, 2e-6),
        _at_rest("Taylor, order 16", "Taylor", 1e-11, others * 1e-6),
        _at_rest("heyoka.py", "peer", 1e-10, peer * 1e-6),
        _at_rest("RK4, matrix", "classic", 1e-8, 1e-9),
    ]
    (found,) = verdicts(Collection([replace(p, spread=noise) for p in points], []))
    return found


@pytest.mark.parametrize(
    ("error", "others", "kept"), [(1e-10, 1.0, True), (2e-9, 1.0, False), (1e-10, 0.5, False), (1e-10, 0.75, True)]
)
def test_plans_are_held_against_their_accuracy_and_the_best_rival(error: float, others: float, kept: bool) -> None:
    found = _judged(error, others, 1.0)
    assert found.dearness == pytest.approx(1.0 / others)
    assert found.kept == kept
    assert ("Every plan" in dearness_table([found])) == kept


@pytest.mark.parametrize(
    ("peer", "words", "use"),
    [(2.5, "2.5 x", "closed form"), (1.08, "even", "closed form"), (0.93, "even", "closed form"),
     (0.25, "0.25 x", "heyoka.py")],
)  # fmt: skip
def test_what_is_within_noise_is_even_and_a_cheaper_peer_is_what_to_use(peer: float, words: str, use: str) -> None:
    found = _judged(1e-10, 1.0, peer)
    assert found.kept
    assert plan_table([found]).splitlines()[-1].endswith(f"heyoka.py            {words}")
    assert drawing.cell_of(found)[1] == use


def test_a_peer_stopped_by_time_is_not_said_to_be_unable() -> None:
    planned = replace(_at_rest("rbfmu, as planned", "planned", 1e-10, 1e-6), detail="closed form")
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
    refused = Collection([_at_rest("heyoka.py", "peer", 1e-13, 2e-5), replace(
        _at_rest("rbfmu, as planned", "planned", 1e-10, 1e-6), outputs=1000)], [])  # fmt: skip
    found = verdicts(refused)[0]
    assert found.method == "refused"
    assert drawing.cell_of(found)[1:] == ("heyoka.py", "20 µs", "plan refuses")


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
    pictures = {"answers.png", *(f"case_{key}.png" for key in collection.QUICK_CASES), "kept_a.png", "kept_c.png"}
    assert set(files) == {"work_precision.csv", "endings.csv", "answers.csv", "answers.txt", *pictures}
    for name in pictures:
        assert files[name].read_bytes().startswith(b"\x89PNG")


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
        assert 0.0 <= point.attitude_error <= collection.LARGEST_ERROR
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
        mine = [_point(name, "peer", 10.0**-k, 1e-6 * 3.0**k) for name in names for k in range(2, 11)]
        mine += [_point(*who, 10.0**-k, 1.1e-6 * 2.9**k) for who in others for k in range(3, 12)]
        plan = replace(_point("rbfmu, as planned", "planned", 1e-10, 1e-4), detail="Taylor series of order 24")
        mine += [replace(plan, value=accuracy) for accuracy in (1e-3, 1e-6, 1e-9)]
        points += [replace(p, case=case.key, title=case.title, outputs=case.outputs, spread=1.05) for p in mine]
        endings += [Ending(case.key, case.outputs, name, "peer", 1e-10, STOPPED) for name in names]
    kept = {key: case.keeps for key, case in CASES.items()}
    nothing = {f"{name}_drift": math.nan for name in ("energy", "momentum")}
    return Collection([p if kept[p.case] else replace(p, **nothing) for p in points], endings)


def _overlaps(figure) -> list[tuple[str, str]]:
    """Texts that lie on one another, or beyond the page; ticks beyond their axis' ends are not drawn."""
    figure.draw_without_rendering()
    hidden = set()
    for axes in figure.axes:
        (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
        hidden |= {tick.label1 for tick in axes.xaxis.get_major_ticks() if not left <= tick.get_loc() <= right}
        hidden |= {tick.label1 for tick in axes.yaxis.get_major_ticks() if not bottom <= tick.get_loc() <= top}
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text().strip() and t not in hidden]
    boxes = [(t.get_text(), Text.get_window_extent(t, figure.canvas.get_renderer())) for t in texts]
    boxes = [(text, box) for text, box in boxes if box.width > 1.0]
    page = figure.bbox
    outside = [(text, "figure") for text, b in boxes if min(b.x0, b.y0) < 0.0 or b.x1 > page.x1 or b.y1 > page.y1]
    pairs = ((a, b) for a, b in combinations(boxes, 2) if a[1].shrunk(0.9, 0.8).overlaps(b[1].shrunk(0.9, 0.8)))
    return outside + [(a[0], b[0]) for a, b in pairs]


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
        assert _overlaps(figure) == []
        assert all(axes.lines or axes.patches for axes in figure.axes)  # no panel is empty


def test_the_readme_s_figures_are_those_of_plans_and_of_the_best_peers(made_up: Collection) -> None:
    ahead, none = _judged(1e-10, 1.0, 0.25), replace(_judged(1e-10, 1.0, 0.25), peer=None)
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


def test_every_line_has_its_name() -> None:
    made = [*peers.peers()[0], *library_methods.library_methods(), *methods.reference_integrators()]
    groups = {drawing.group_of(_point(method.name, method.family, 1e-3, 1.0)) for method in made}
    assert groups <= set(drawing.GROUPS)
    assert drawing.group_of(_point("SciPy odeint", "peer", 1e-3, 1.0)) == "SciPy odeint"
    assert drawing.group_of(_point("SciPy LSODA", "peer", 1e-3, 1.0)) == "SciPy solve_ivp"
