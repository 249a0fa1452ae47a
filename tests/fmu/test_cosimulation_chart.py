"""The attitude loop through an FMU: its reference, the orders of the ways to pass inputs, what substeps buy."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rbfmu.runs.motion import attitude_error
from rbfmu_fmu import cosimulation_chart as chart

MOMENTS = np.array([1.0, 2.0, 3.0])


def test_reference_is_the_continuous_loop_to_1e_12() -> None:
    def rates(t, y):
        e, x, w = y[0], y[1:4], y[4:]
        torque = -chart.STIFFNESS * 2.0 * math.copysign(1.0, e) * x - chart.DAMPING * w
        dq = (-0.5 * x @ w, *(0.5 * (e * w + np.cross(x, w))))
        return (*dq, *((torque - np.cross(w, MOMENTS * w)) / MOMENTS))

    initial = chart.SCENE.initial
    start = [*initial.quaternion, *initial.omega_b]
    truth = solve_ivp(rates, (0.0, chart.FINAL_TIME), start, "DOP853", rtol=2.3e-14, atol=1e-15).y[:, -1]
    assert np.max(np.abs(chart.reference() - truth)) < 1e-12


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    seen = []
    paths = chart.run_cosimulation_chart(tmp_path_factory.mktemp("chart"), True, lambda *step: seen.append(step))
    assert [done for done, _, _ in seen] == list(range(len(seen)))
    assert {total for _, total, _ in seen} == {len(seen) - 1}
    return paths


@pytest.fixture(scope="module")
def errors(files: list[Path]) -> dict[tuple[str, int], list[float]]:
    """By way and substeps: errors at 8, 16, 32 communication steps."""
    with files[0].open(newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    found: dict[tuple[str, int], list[float]] = {}
    for row in rows:
        found.setdefault((row["way"], int(row["substeps"])), []).append(float(row["attitude_error"]))
    return found


@pytest.mark.thorough
def test_files_are_figures_and_a_picture(files: list[Path]) -> None:
    assert [path.name for path in files] == ["cosimulation.csv", "cosimulation.png"]
    assert files[1].read_bytes().startswith(b"\x89PNG")


def test_picture_shows_one_step_as_lines_and_eight_as_crosses_in_the_steps_colours(monkeypatch, tmp_path) -> None:
    drawn = []
    monkeypatch.setattr(chart.Picture, "savefig", lambda figure, path, **more: drawn.append(figure))
    points = [
        chart.Point(way, n, h, 0.1 * h * n, 100) for way in chart.WAYS for n in chart.SUBSTEPS for h in (0.2, 0.1)
    ]
    chart.draw(points, tmp_path / "it.png")
    by_step, by_work = drawn[0].axes
    for axes, many in ((by_step, ("x", "None")), (by_work, ("None", ":"))):
        styles = {round(line.get_ydata()[0] / 0.02): (line.get_marker(), line.get_linestyle()) for line in axes.lines}
        assert styles == {1: ("None", "-"), 8: many}
        assert len({line.get_color() for line in axes.lines}) == len(chart.WAYS)
    assert [text.get_text() for text in by_step.texts] == [label for label, _ in chart.WAYS.values()]


@pytest.mark.parametrize(("way", "order"), [("one step late", 1), ("held", 1), ("extrapolated", 2), ("rolled back", 2)])
@pytest.mark.parametrize("substeps", chart.SUBSTEPS)
def test_order_in_the_communication_step_whatever_the_substeps(errors, way, order, substeps) -> None:
    _, coarse, fine = errors[way, substeps]
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("way", ["one step late", "held"])
def test_substeps_buy_nothing_while_inputs_are_held(errors, way) -> None:
    assert errors[way, 8] == pytest.approx(errors[way, 1], rel=1e-9)


def test_extrapolation_gains_more_than_ten_times_at_the_same_cost(errors) -> None:
    assert errors["extrapolated", 1][-1] < errors["held", 1][-1] / 10.0


def test_an_iteration_that_does_not_settle_gives_no_answer() -> None:
    with chart.attitude_loop() as loop:
        final = chart.run_loop(loop, "rolled back", 2, 1)
    assert np.all(np.isnan(final))


def test_attitude_error_of_the_reference_to_itself_is_zero() -> None:
    final = chart.reference()
    assert attitude_error(final[:4], final[:4]) == 0.0
