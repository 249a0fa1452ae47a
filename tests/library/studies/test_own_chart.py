"""`rbfmu chart SCENE`: errors against independent arithmetic, what is said of peers and models, the table, files."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import rbfmu
from rbfmu.models.registry import CLOSED_FORMS
from rbfmu.studies import WIDTH
from rbfmu.studies.chart import Chart, cases, measure, methods, solvers
from rbfmu.studies.chart.cases import WHOLE
from rbfmu.studies.chart.methods import NotFeasibleError
from rbfmu.studies.chart.simulators import MUJOCO
from rbfmu.types import Array
from tests.support.command_line import call
from tests.support.full_disk import full_disk
from tests.support.paths import ROOT
from tests.support.references import reference_mp

GALLERY = sorted((ROOT / "examples" / "scenes").rglob("*.toml"))
MIXED = ((2.0, 0.1, -0.2), (0.1, 2.5, 0.3), (-0.2, 0.3, 3.0))
SATELLITE = {
    "name": "satellite",
    "body": {"mass": 2.0, "inertia": MIXED, "r_oc_b": [0.1, -0.2, 0.05]},
    "initial": {"omega_b": [0.3, -0.5, 0.8], "velocity": [1.0, 0.0, 0.0], "position": [0.0, 2.0, 0.0]},
    "loads": {"force_b": [1.0, 0.5, -2.0], "torque_b": [0.1, 0.0, 0.2]},
    "outputs": {"quantities": ["position", "velocity", "rpy", "omega_a"]},
    "run": {"start": 3.0, "stop": 5.0, "step": 0.1, "accuracy": 1e-8},
}
"""Loads and outputs of many kinds, moments that are not principal, and a start that is not 0."""


def scene_of(tables: dict, **changes: object) -> rbfmu.Scene:
    scene = rbfmu.Scene.from_dict(tables, "it")
    return scene.replace(changes) if changes else scene


def gallery(name: str) -> cases.Case:
    return cases.case_of(rbfmu.load_scene(ROOT / "examples" / "scenes" / f"{name}.toml"))


@pytest.fixture(scope="module")
def satellite() -> cases.Case:
    return cases.case_of(scene_of(SATELLITE))


# Errors


@pytest.fixture(scope="module")
def by_mpmath(satellite: cases.Case) -> Array:
    """Attitude, rates and the centre of mass at the checkpoints, rounded from 40 digits."""
    times = tuple(3.0 + satellite.interval * n for n in np.cumsum(satellite.outputs_between).tolist())
    found = []
    for point in reference_mp.motion(satellite.scene, times):
        R, w = np.array(point.R_ab, dtype=float), np.array(point.omega_b, dtype=float)
        arm = np.array(satellite.scene.body.r_oc_b)
        r, v = np.array(point.position, dtype=float), np.array(point.velocity, dtype=float)
        q = rbfmu.quaternion_from_matrix(R)
        found.append([*(-2.0 * q), *w, *(r + R @ arm), *(v + R @ np.cross(w, arm))])  # neither sign nor length counts
    return np.array(found)


def test_the_true_motion_has_no_error(satellite: cases.Case, by_mpmath: Array) -> None:
    assert len(by_mpmath) == 20
    assert satellite.error(satellite.at_checkpoints(by_mpmath)) < cases.FLOOR


@pytest.mark.parametrize(
    ("turned", "moved", "faster", "expected"),
    [(1e-5, 0.0, 0.0, 1e-5), (0.0, 1e-4, 0.0, "position"), (0.0, 0.0, 1e-4, "omega_a")],
)
def test_errors_are_those_that_the_accuracy_counts(
    satellite: cases.Case, by_mpmath: Array, turned: float, moved: float, faster: float, expected: object
) -> None:
    states = by_mpmath.copy()
    row = states[7]
    row[:4] = rbfmu.compose_quaternions(row[:4], rbfmu.quaternion_from_rotvec(np.array([0.0, turned, 0.0])))
    row[4:7] *= 1.0 + faster
    row[7] += moved
    found = satellite.error(satellite.at_checkpoints(states))
    if expected == "position":
        expected = moved / max(1.0, np.max(np.linalg.norm(satellite.truth["position"], axis=1)))
    if expected == "omega_a":
        sizes = np.linalg.norm(satellite.truth["omega_a"], axis=1)
        assert 0.0 < found <= faster * 1.0001
        assert found >= faster * sizes[8] / np.max(sizes) * 0.9999
    else:
        assert found == pytest.approx(expected, rel=0.5 if turned else 1e-6)


@pytest.mark.parametrize("place", [0, 4, 7], ids=["attitude", "rates", "position"])
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_has_an_infinite_error(
    satellite: cases.Case, by_mpmath: Array, place: int, number: float
) -> None:
    states = by_mpmath.copy()
    states[3, place] = number
    assert satellite.error(satellite.at_checkpoints(states)) == math.inf


def _of_peers() -> list[methods.Method]:
    return [*measure.peers(), *methods.own_methods()]


@pytest.mark.parametrize("name", [
    "SciPy DOP853", "SciPy odeint", "heyoka.py", "RK4, quaternion", "MuJoCo RK4",
    pytest.param("Taylor, order 12", marks=pytest.mark.thorough),
])  # fmt: skip
def test_all_follow_the_same_motion_in_their_own_ways(satellite: cases.Case, name: str) -> None:
    method = next((m for m in _of_peers() if m.name == name), None)
    if method is None:
        pytest.skip(f"{name} is not installed")
    value = 0.001 if "RK4" in name else 1e-9
    assert satellite.error(method.run(satellite, value).found) < 1e-6


# What is charted of a scene


@pytest.mark.parametrize(
    ("name", "states"),
    [("thrown_ball", WHOLE[7:]), ("flywheel", WHOLE[4:7]), ("toutatis", WHOLE[:7]), ("ship", WHOLE)],
)
def test_solvers_integrate_what_the_outputs_need_and_no_more(name: str, states: tuple[str, ...]) -> None:
    case = gallery(name)
    assert case.states == states
    assert len(case.integrated) == len(states)
    for method in (solvers.SCIPY[-1], *(m for m in measure.peers() if m.name == "heyoka.py")):
        assert case.error(method.run(case, 1e-10).found) < 1e-6


def test_a_run_too_long_for_the_reference_is_charted_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases.judge, "MAX_REFERENCE_STEPS", 1)
    case = cases.case_of(scene_of(SATELLITE))
    assert case.outputs == 5
    assert case.span == pytest.approx(0.5)
    assert case.scene.run.start == 3.0


@pytest.mark.slow
def test_a_motion_too_stiff_for_a_reference_is_refused() -> None:
    with pytest.raises(rbfmu.SceneError, match=r"run.step = 0.1: expected a step over which the true motion"):
        rbfmu.chart(scene_of(SATELLITE, **{"loads.damping_b": [1e8, 1e8, 1e8]}))


@pytest.mark.parametrize(("step", "outputs", "span"), [(0.3, 6, 1.8), (0.1, 20, 2.0), (2.0, 1, 2.0)])
def test_a_last_step_that_is_shorter_is_left_out(step: float, outputs: int, span: float) -> None:
    case = cases.case_of(scene_of(SATELLITE, **{"run.step": step}))
    assert (case.outputs, case.span) == (outputs, pytest.approx(span))


def test_errors_are_measured_at_the_end_and_at_a_few_hundred_points_at_most() -> None:
    case = cases.case_of(scene_of(SATELLITE, **{"run.step": 0.002}))
    at = list(range(case.outputs)[case.checkpoints])
    assert len(at) == cases.POINTS == len(case.outputs_between)
    assert at[-1] == case.outputs - 1
    assert sum(case.outputs_between) == case.outputs
    assert len(case.truth["omega_b"]) == cases.POINTS + 1


def test_closed_forms_compete_only_where_ports_leave_them_exact() -> None:
    closed = {form.name: form for form in map(methods.closed_form, CLOSED_FORMS)}
    free, driven = gallery("t_handle"), gallery("controlled_satellite")
    assert [name for name, form in closed.items() if not form.why_not(free)] == ["torque-free body"]
    assert not any(not form.why_not(driven) for form in closed.values())
    planned = rbfmu.plan(driven.scene)
    small = {model.model: model for model in measure.too_small(driven, planned)}
    assert small["torque-free body"].why == "takes no torque_b"
    assert small["torque-free body"].error < 1e-12


def test_models_too_small_are_named_with_their_errors() -> None:
    case = gallery("flywheel")
    small = measure.too_small(case, rbfmu.plan(case.scene))
    assert [model.model for model in small] == ["no rotation", "constant rate", "angular momentum"]
    decayed = 1.0 - math.exp(-0.02 / 0.4 * 100.0)  # of the rate; the energy's is its square
    assert small[1].error == pytest.approx(1.0 - (1.0 - decayed) ** 2, rel=1e-6)
    assert small[2].why == "shows no rates in b"


def test_what_mujoco_cannot_model_is_said() -> None:
    pytest.importorskip("mujoco")
    with pytest.raises(NotFeasibleError, match="damping is the same"):
        MUJOCO[-1].run(gallery("flywheel"), 0.1)
    with pytest.raises(NotFeasibleError, match="centre of mass"):
        MUJOCO[-1].run(cases.case_of(scene_of(SATELLITE, **{"loads.force_a": [1.0, 0.0, 0.0]})), 0.01)


def test_mujoco_knows_loads_fixed_in_space() -> None:
    pytest.importorskip("mujoco")
    loads = {"loads.force_a": [1.0, 0.0, 0.5], "loads.torque_a": [0.2, -0.1, 0.1], "body.r_oc_b": [0.0, 0.0, 0.0]}
    case = cases.case_of(scene_of(SATELLITE, **loads))
    assert case.error(MUJOCO[-1].run(case, 0.001).found) < 1e-6


# Charts


def few(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let few methods compete, which need little compilation."""
    chosen = measure.contestants
    monkeypatch.setattr(
        measure, "contestants", lambda case: [m for m in chosen(case) if m.name in (*names, "rbfmu, as planned")]
    )


@pytest.fixture(scope="module")
def small_chart() -> Chart:
    with pytest.MonkeyPatch.context() as patch:
        few(patch, "SciPy odeint", "Taylor, order 12")
        patch.setattr(measure, "QUICK", measure.Extent(60.0, 2, 2e-4, True))  # whatever the load
        seen: list[tuple[int, int, str]] = []
        found = rbfmu.chart(ROOT / "examples/scenes/top_falling.toml", True, lambda *step: seen.append(step))
    assert seen[-1][0] == seen[-1][1]
    return found


@pytest.mark.thorough
def test_a_chart_has_its_plan_and_its_methods(small_chart: Chart) -> None:
    assert {row.kind for row in small_chart.rows} == {"rbfmu's plan", "Taylor series", "SciPy odeint"}
    assert small_chart.plan.value == small_chart.accuracy == 1e-6
    assert small_chart.plan.error <= 1e-6
    for row in small_chart.rows:
        assert row.seconds == row.run_seconds / 2.0 > 0.0
    assert repr(small_chart).startswith(f"Chart of top_falling: {len(small_chart.rows)} points")
    assert str(small_chart) == small_chart.table
    assert small_chart._repr_html_().startswith('<img src="data:image/png;base64,')


@pytest.mark.thorough
def test_all_points_are_in_the_file_with_the_machine(small_chart: Chart, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="folder = 3: expected a path"):
        small_chart.save(3)
    paths = small_chart.save(tmp_path / "charts")
    assert [path.name for path in paths] == ["top_falling.csv", "top_falling.txt", "top_falling.png"]
    lines = paths[0].read_text().splitlines()
    assert "processors" in lines[0]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [float(row["error"]) for row in rows] == [row.error for row in small_chart.rows]
    assert [float(row["seconds"]) for row in rows] == [row.seconds for row in small_chart.rows]
    assert paths[1].read_text() == small_chart.table + "\n"
    assert paths[2].read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_a_chart_that_stands_there_is_not_lost_on_a_full_disk(small_chart: Chart, tmp_path: Path) -> None:
    """2026-11-30: it was emptied, or left cut short."""
    before = {path: path.read_bytes() for path in small_chart.save(tmp_path)}
    for size, ending in ((10, "csv"), (20_000, "png")):
        with full_disk(size), pytest.raises(OSError, match=rf"top_falling\.{ending}"):
            small_chart.save(tmp_path)
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.thorough
def test_the_command_charts_a_scene_and_names_what_is_wrong_with_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    few(monkeypatch, "SciPy odeint")
    done = call("chart", ROOT / "examples/scenes/controlled_satellite.toml", "--quick", "-o", tmp_path)
    assert done.exit_code == 0
    assert "torque_b at zero" in done.stdout
    assert str(tmp_path / "controlled_satellite.png") in done.stdout
    (tmp_path / "bad.toml").write_text("[body]\nmass = -1.0\ninertia = [1, 1, 1]\n")
    wrong = call("chart", tmp_path / "bad.toml")
    assert wrong.exit_code == 2
    assert "bad.toml" in wrong.stderr
    assert "mass" in wrong.stderr


@pytest.mark.thorough
def test_prescribed_rates_are_charted_at_rest() -> None:
    found = rbfmu.chart(ROOT / "examples/scenes/gyro_attitude.toml", quick=True)
    assert found.plan.error == 0.0
    assert "omega_b at zero" in found.table
    assert "prescribed rates" in found.table
    found.figure()


def test_a_peer_that_does_not_load_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str):
        raise NotFeasibleError(f"{name} is installed but does not load: no shared library")

    monkeypatch.setattr(solvers, "module", broken)
    few(monkeypatch, "SciPy odeint")
    found = rbfmu.chart(ROOT / "examples/scenes/thrown_ball.toml", quick=True)
    assert "SciPy: scipy.integrate is installed but does not load" in found.table


@pytest.mark.slow
@pytest.mark.parametrize("path", GALLERY, ids=lambda path: path.stem)
def test_every_scene_of_the_gallery_has_its_chart(path: Path, tmp_path: Path) -> None:
    found = rbfmu.chart(path, quick=True)
    assert found.plan.error <= found.accuracy
    assert max(map(len, found.table.splitlines())) <= WIDTH
    assert all(file.stat().st_size > 0 for file in found.save(tmp_path))
