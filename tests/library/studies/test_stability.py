"""The laws of stability: each number that theory predicts is measured, and methods fail where it says."""

import csv
import math
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rbfmu.models.registry import MODELS
from rbfmu.studies import dop853, stability
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS
from rbfmu.studies.stability import AT_MOST, Finding, method_laws, motion_laws, motions, pictures
from rbfmu.studies.stability.method_laws import crossing, growth, stability_polynomial
from rbfmu.studies.stability.motion_laws import flip_rate, time_between_flips
from rbfmu_kernels.models import free, one_axis
from tests.support.command_line import call
from tests.support.covering import some_of
from tests.support.references import stability_references

STUDIES = {study.__name__: study for study in stability.all_studies()}
_MEASURED: dict[str, Any] = {}


def _measure(name: str) -> Any:
    if name not in _MEASURED:
        _MEASURED[name] = STUDIES[name](True)
    return _MEASURED[name]


def _laws_said_to_be_measured(name: str) -> set[int]:
    """By the docstring, such as "Measure laws 1 to 3: ...", as the laws of a table stand under their own words."""
    said = re.match(r"Measure laws? (\d+)(?: (?:to|and) (\d+))?:", STUDIES[name].__doc__ or "")
    assert said
    return set(range(int(said[1]), int(said[2] or said[1]) + 1))


@pytest.mark.parametrize("name", some_of([*STUDIES], 8))
def test_every_law_holds(name: str) -> None:
    findings = _measure(name).findings
    assert {f.law for f in findings} == _laws_said_to_be_measured(name)
    for f in findings:
        if f.kind == AT_MOST:
            assert f.measured <= f.predicted, (f.what, f.place)
        else:
            assert f.measured == pytest.approx(f.predicted, rel=f.tolerance, abs=0.0), f.what


def test_a_tableau_s_polynomial_is_that_of_exact_fractions() -> None:
    """A linear solver's answer is some 1e-12 off, otherwise on each processor."""
    rows, stages = [[Fraction(a) for a in row] for row in dop853.A[: dop853.STAGES + 1].tolist()], []
    for row in rows:
        stages.append(1 - 3 * sum(a * stage for a, stage in zip(row, stages, strict=False)))
    assert stability_polynomial("DOP853")(-3.0) == pytest.approx(float(stages[-1]), rel=2e-13, abs=0.0)


@pytest.mark.thorough  # it compiles all methods, 12 s
def test_all_laws_are_measured_and_named() -> None:
    assert {f.law for name in STUDIES for f in _measure(name).findings} == set(range(1, 15))
    assert set(stability.LAWS) == set(range(1, 16))  # the last is that of the maps


def test_every_model_that_a_plan_may_choose_is_held_against_its_reference() -> None:
    assert {case.model for case in motion_laws.CASES} | {"prescribed rates"} == {*MODELS, motion_laws.LOADED}  # DOP853
    assert {case.order for case in motion_laws.CASES if case.model == "one swinging axis"} == set(one_axis.ORDERS)
    assert {1, 2, *(case.order for case in motion_laws.CASES if case.motion == "body force")} == set(free.ORDERS)


@pytest.mark.parametrize("key", motions.MOTIONS)
def test_references_are_of_these_motions(key: str) -> None:
    assert motions.references()["motions"][key]["scene"] == motions.MOTIONS[key].to_dict()


@pytest.mark.parametrize("key", ["fall", "loaded", "damped swing"])
def test_references_are_what_40_digits_give(key: str) -> None:
    scene, stored = motions.MOTIONS[key], dict(motions.references()["motions"][key])
    times = stability_references.communication_points(scene)[:2]
    again = stability_references.motion_of(scene, times)
    for name in motions.QUANTITIES:
        assert again[name] == stored[name][:2]


def test_references_of_maps_and_prescribed_rates_are_what_40_digits_give() -> None:
    stored = motions.references()
    assert stability_references.prescribed_attitudes() == stored["prescribed"]
    assert set(stored["maps"]) == {repr(ratio) for ratio in motions.ratios_of_moments(quick=False)}
    scene = motions.map_scene(0.1)
    assert stability_references.motion_of(scene, motions.CHECK_TIMES[:2])["quaternion"] == stored["maps"]["0.1"][:2]


def test_errors_count_every_digit_and_every_quantity() -> None:
    true = motions.truth("loaded")
    assert motions.error_of(true, true) == 0.0
    for name, values in true.items():
        off = values * (1.0 + 1e-5 * (np.arange(values.shape[1]) == 0))
        assert 1e-7 < motions.error_of({name: off}, true) < 1e-4, name
    assert motions.error_of({"omega_b": true["omega_b"] * math.nan}, true) == math.inf
    longer, turned = np.array([[1.00001, 0.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0, 0.0]])
    assert motions.attitude_error(longer, turned) == pytest.approx(2e-5, rel=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize("name", STUDIES)
def test_curves_have_columns_of_one_length(name: str) -> None:
    columns = _measure(name).columns
    assert len({len(values) for values in columns.values()}) == 1


@pytest.mark.thorough
def test_curves_drift_grow_and_keep_what_their_methods_do() -> None:
    assert max(_measure("drift").columns["q normalised"]) < 2.0**-51
    assert all(factor > 1.0 for factor in _measure("growth_factors").columns["explicit Euler, measured"])
    rod = _measure("gyroscopic_blow_up").columns
    assert rod["implicit midpoint"] == pytest.approx([1.0] * 61, rel=2e-10)  # the iteration stops at 3e-14 rad/s
    assert min(rod["RK4, quaternion"]) > 0.98


def test_the_peak_that_the_picture_of_the_resonance_names_is_on_its_curve() -> None:
    study = _measure("splitting_resonance")
    named = next(f.measured for f in study.findings if f.what.startswith("Strang, energy error") and f.measured > 1.0)
    assert max(study.columns["Strang"]) == pytest.approx(named, rel=0.01)


def test_implicit_midpoint_by_iteration_ends_at_the_damping_limit_of_explicit_euler() -> None:
    assert abs(method_laws.decay_factor(method_laws.MIDPOINT, 1.3)) == pytest.approx(0.35 / 1.65, rel=1e-13)
    assert not math.isfinite(method_laws.decay_factor(method_laws.MIDPOINT, 2.1))


@pytest.mark.thorough
def test_long_runs_of_exact_steps_keep_their_energy_and_flips_take_the_moments_about_the_pivot() -> None:
    for f in STUDIES["energy_drift"](False).findings:  # 1e5 steps
        assert f.holds, f.what
    assert [f.holds for f in STUDIES["intermediate_axis"](False).findings if "pivot" in f.what] == [True]


def test_time_between_flips_needs_no_order_of_disturbances() -> None:
    by_largest = time_between_flips((1.0, 2.0, 3.0), (1e-4, 2.0, 1e-4))
    by_least = time_between_flips((1.0, 2.0, 3.0), (1e-4 * math.sqrt(5.0), 2.0, 1e-4))
    assert by_least == pytest.approx(by_largest, rel=0.1)
    assert flip_rate((1.0, 2.0, 3.0), 2.0) == pytest.approx(2.0 / math.sqrt(3.0), rel=1e-15)


def test_polynomials_are_exp_to_their_order() -> None:
    for method, order, z in (
        ("explicit Euler", 1, -0.25),
        ("RK4", 4, -0.5),
        ("DOP853", 8, -0.5),
        ("Taylor 12", 12, -2.0),
    ):
        R = stability_polynomial(method)
        errors = [abs(R(x) - math.exp(x)) for x in (z, 0.5 * z)]
        assert math.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.3)


def test_crossing_finds_the_end_of_stability() -> None:
    assert crossing(lambda x: x * x <= 1.0, 0.5, 3.0) == pytest.approx(1.0, rel=1e-15)
    assert growth(method_laws.RK4_ON_Q, 5.6) < 1.0
    assert growth(method_laws.RK4_ON_Q, 5.7) > 1.0


@pytest.mark.parametrize(("name", "h", "ratio", "verdict"), [
    ("semi-implicit Euler", 0.01, 0.1, motions.WRONG),
    ("semi-implicit Euler", 1.0, 0.1, motions.NOT_FINITE),
    ("RK4, quaternion", 0.1, 0.1, motions.RIGHT),
    ("RK4, quaternion", 1.5, 0.1, motions.WRONG),
    ("RK4, quaternion", 8.0, 0.1, motions.NOT_FINITE),
    ("implicit midpoint", 5.0, 0.1, motions.NOT_FINITE),
])  # fmt: skip
def test_verdicts_on_fixed_steps(name: str, h: float, ratio: float, verdict: int) -> None:
    assert motions.verdict_of_steps(REFERENCE_INTEGRATORS[name], h, ratio)[0] == verdict


@pytest.mark.parametrize("name", motions.OURS)
@pytest.mark.parametrize("h", [0.1, 10.0])
def test_product_is_right_at_any_step(name: str, h: float) -> None:
    for ratio in motions.ratios_of_moments(quick=True):
        verdict, error = motions.METHODS[name](h, ratio)
        assert verdict == motions.RIGHT
        assert error <= motions.ACCURACY


def test_a_tile_of_the_product_that_is_wrong_or_refused_is_a_finding_that_fails() -> None:
    ours = next(iter(motions.OURS))
    rows = [(ours, 0.1, 1.0, "right", 2e-9), (ours, 1.0, 1.0, "refused with a message", math.inf)]
    rows += [(ours, 1.0, 0.1, "right", 1e-12), ("RK4, quaternion", 1.0, 1.0, "wrong", 1.0)]
    found = motions.findings_of_maps([motions.Row(*row) for row in rows])
    assert [f.holds for f in found] == [False, False, True]


def test_steps_of_a_map_divide_the_turn_at_its_check_points() -> None:
    for h in motions.grid(quick=False)[0]:
        turn, n = motions.steps_of_a_turn(h)
        assert turn / n == h
        assert n % motions.CHECKS == 0
        assert {turn * (k + 1) / motions.CHECKS for k in range(motions.CHECKS)} <= set(motions.CHECK_TIMES)


@pytest.mark.slow
def test_stability_leaves_tables_and_pictures(tmp_path: Path) -> None:
    seen: list[int] = []

    def progress(parts: Any) -> Any:
        for part in parts:
            yield part
            seen.append(len(seen))

    findings, paths = stability.run_stability(tmp_path / "out", quick=True, progress=progress)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {p.name for p in paths}
    assert len([p for p in paths if p.suffix == ".png" and p.stat().st_size > 10_000]) == len(STUDIES) + 1
    assert len(seen) == 2 * len(STUDIES) + len(motions.QUICK_METHODS) + 2
    assert [str(f) for f in findings if not f.holds] == []
    with (tmp_path / "out" / "laws.csv").open(newline="") as file:
        assert [float(row["measured"]) for row in csv.DictReader(file)] == [f.measured for f in findings]
    with (tmp_path / "out" / "maps.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows if row["method"] in motions.OURS} == {"right"}
    assert {row["verdict"] for row in rows} >= {"right", "wrong", "not finite"}


def test_a_law_that_does_not_hold_is_reported() -> None:
    wrong = Finding(1, "growth", 1.0, 1.1, 0.01)
    place = Finding(15, "tile", 1e-9, math.inf, 0.0, AT_MOST, "h omega 1, moments 1")
    findings = [wrong, Finding(2, "bound", 1.0, 0.5, 0.0, AT_MOST), place]
    assert [str(f) for f in findings if not f.holds] == [
        "law 1, growth: predicted 1.0, measured 1.1",
        "law 15, tile (h omega 1, moments 1): predicted 1e-09, measured inf",
    ]


def test_the_table_names_law_source_prediction_measurement_and_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    findings = [
        Finding(1, "growth of |q| [a step]", 1.0, 1.1, 0.01),
        Finding(4, "a figure measured before", 8e-2, 8.1e-2, 0.04, stability.RECORDED),
        Finding(4, "another", 1.0, 2.0, 0.04, stability.RECORDED),
        *(Finding(15, "tile", 1e-9, error, 0.0, AT_MOST, f"place {error:g}") for error in (1e-12, 1e-10, 1e-5)),
    ]
    stability.print_laws(findings)
    shown = capsys.readouterr().out
    lines = [" ".join(line.split()) for line in shown.splitlines()]
    assert max(map(len, shown.splitlines())) <= 80
    assert "Predicted by: the accuracy asked; truth: 40-digit references" in lines
    assert "growth of |q| [a step] 1 1.1 FAILS" in lines
    assert "a figure measured before 0.08 0.081 as recorded" in lines
    assert "another 1 2 NOT as recorded" in lines
    assert '"Recorded": no theory gives this figure;' in " ".join(lines)
    assert "tile (2 of 3) <= 1e-09 1e-10 holds" in lines
    assert "tile (place 1e-05) <= 1e-09 1e-05 FAILS" in lines


@pytest.mark.parametrize(("measured", "status"), [(1e-12, 0), (1e-5, 1)])
def test_command_prints_the_table_and_fails_with_a_finding(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: float, status: int
) -> None:
    def run(folder: Path, quick: bool, progress: Any, method: Path | None) -> tuple[list[Finding], list[Path]]:
        return [Finding(15, "tile", 1e-9, measured, 0.0, AT_MOST)], [folder / "laws.csv"]

    monkeypatch.setattr(stability, "run_stability", run)
    result = call("stability", "--quick", "-o", tmp_path / "out")
    assert result.exit_code == status
    assert "Law 15." in result.output
    assert ("does not hold: law 15, tile" in result.output) == bool(status)


def test_a_method_that_refuses_a_step_is_infinitely_far_from_the_other(monkeypatch):
    """2026-11-22: under a wrong error estimate the command ended with a traceback instead of a finding."""
    where = {"quaternion": np.ones((1, 4)), "omega_b": np.ones((1, 3))}
    for refused in (motion_laws.SERIES, motion_laws.LOADED):
        driven = {motion_laws.SERIES: where, motion_laws.LOADED: where} | {refused: {}}
        monkeypatch.setattr(motion_laws, "_drive", lambda case, driven=driven: driven[case.model])
        assert motion_laws._apart() == math.inf


@pytest.mark.parametrize(
    "sizes", [(1.0, 0.0), (0.0, 1.0), (math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0), (1.0, -1.0)]
)
def test_an_error_that_is_no_size_is_a_finding_that_does_not_hold(sizes: tuple[float, float]) -> None:
    """2026-11-22: a sign in the composition of quaternions ended the study with a traceback."""
    assert stability.exponent(8.0, 1.0) == pytest.approx(3.0, rel=1e-15)
    assert not Finding(12, "order", 2.0, stability.exponent(*sizes), 0.03).holds


def test_a_pictures_ticks_stand_on_their_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    row = pictures.Picture("title", "x", "y", ticks={"x": [(0.5, "a half")], "y": [(2.0, "two")]})
    monkeypatch.setitem(pictures.PICTURES, "made", row)
    (axes,) = pictures.figure_of(stability.Study("made", [], {"x": [0.0, 1.0]})).axes
    assert [text.get_text() for text in axes.get_xticklabels()] == ["a half"]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["two"]


@pytest.mark.thorough
def test_titles_say_the_errors_of_resonant_and_shorter_steps() -> None:
    """2026-11-27: at a quarter of the resonant step the title had 0.0004, and the curve 0.00048."""
    resonance = 2.0 * math.pi / (0.3 * 50.0)
    large, small = (motion_laws._energy_error("Strang", h) for h in (resonance, 0.25 * resonance))
    title = pictures.PICTURES["splitting_resonance"].title
    assert f"error is {large:.1f} m g l, at a quarter of that step it is {small:.4f} m g l" in title


@pytest.mark.parametrize(("error", "said"), [
    (1.32e-10, "2e-10"), (2e-10, "2e-10"), (9.1e-10, "1e-09"), (5e-11, "5e-11"), (0.0, "0e+00"), (math.inf, "inf"),
])  # fmt: skip
def test_no_picture_says_a_smaller_error_than_was_found(error: float, said: str, monkeypatch, tmp_path: Path) -> None:
    """2026-11-22: 1.32e-10 rad were "within 1e-10 rad". 2026-12-01: 5e-11 rad were "within 6e-11 rad"."""
    drawn = []
    monkeypatch.setattr(pictures.Figure, "savefig", lambda figure, path, **more: drawn.append(figure))
    rows = [motions.Row("rbfmu planned", h, ratio, "right", error) for h in (0.1, 1.0) for ratio in (0.1, 1.0)]
    pictures.draw_maps(rows, tmp_path / "maps.png")
    (figure,) = drawn
    assert f"(bold) is {said} rad at any step" in figure.get_suptitle()
    assert figure.axes[0].get_title(loc="left") == f"rbfmu planned: within {said} rad"
