"""The laws of stability: each number that theory predicts is measured, and methods fail where it says."""

import csv
import math
from pathlib import Path
from typing import Any

import pytest

from rbfmu import stability
from rbfmu.contestants import CONTESTANTS
from rbfmu.stability import Finding, body_laws, maps
from rbfmu.stability.attitude_laws import crossing, quaternion_growth, stability_polynomial
from rbfmu.stability.cases import EXACT_STEPS
from rbfmu.stability.findings import AT_MOST
from rbfmu.stability.top_laws import flip_rate, time_between_flips

STUDIES = {study.__name__: study for study in stability.STUDIES}
_MEASURED: dict[str, Any] = {}


def _measure(name: str) -> Any:
    if name not in _MEASURED:
        _MEASURED[name] = STUDIES[name](True)
    return _MEASURED[name]


@pytest.mark.parametrize("name", STUDIES)
def test_every_law_holds(name: str) -> None:
    findings = _measure(name).findings
    assert findings
    for f in findings:
        if f.kind == AT_MOST:
            assert f.measured <= f.predicted, f.what
        else:
            assert f.measured == pytest.approx(f.predicted, rel=f.tolerance, abs=0.0), f.what


def test_all_twelve_laws_are_measured() -> None:
    assert {f.law for name in STUDIES for f in _measure(name).findings} == set(range(1, 13))


@pytest.mark.parametrize("name", STUDIES)
def test_curves_have_columns_of_one_length(name: str) -> None:
    columns = _measure(name).columns
    assert len({len(values) for values in columns.values()}) == 1


def test_measured_factors_are_the_stability_polynomials() -> None:
    columns = _measure("growth_factors").columns
    for method in ("explicit Euler", "RK4, quaternion not normalised", "DOP853", "RK4, matrix"):
        for predicted, measured in zip(columns[f"{method}, predicted"], columns[f"{method}, measured"], strict=True):
            assert measured == pytest.approx(predicted, rel=2e-11)  # DOP853's weights of 43 cancel
    columns = _measure("damping_limits").columns
    for method in ("explicit Euler", "RK4, quaternion", "DOP853"):
        for predicted, measured in zip(columns[f"{method}, predicted"], columns[method], strict=True):
            assert measured == pytest.approx(predicted, rel=1e-10, abs=1e-12)


def test_normalised_rk4_does_not_drift() -> None:
    assert max(_measure("drift").columns["q normalised"]) < 2.0**-51


def test_explicit_euler_is_never_stable() -> None:
    assert all(factor > 1.0 for factor in _measure("growth_factors").columns["explicit Euler, measured"])


def test_rod_keeps_its_nutation_where_the_method_is_not_explicit_in_it() -> None:
    columns = _measure("gyroscopic_blow_up").columns
    assert columns["implicit midpoint"] == pytest.approx([1.0] * 61, rel=2e-10)  # the iteration stops at 3e-14 rad/s
    assert min(columns["RK4, quaternion"]) > 0.98


def test_implicit_midpoint_by_iteration_ends_at_the_damping_limit_of_explicit_euler() -> None:
    assert abs(body_laws.decay_factor("implicit midpoint", 1.3)) == pytest.approx(0.35 / 1.65, rel=1e-13)
    assert not math.isfinite(body_laws.decay_factor("implicit midpoint", 2.1))


def test_long_runs_of_exact_steps_keep_their_energy() -> None:
    for f in STUDIES["energy_drift"](False).findings:  # 1e5 steps
        assert f.holds, f.what


def test_flips_about_a_pivot_take_the_moments_about_the_pivot() -> None:
    findings = STUDIES["intermediate_axis"](False).findings
    assert [f.holds for f in findings if "pivot" in f.what] == [True]


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
    assert crossing(lambda x: x * x, 0.5, 3.0) == pytest.approx(1.0, rel=1e-15)
    assert quaternion_growth("RK4, quaternion not normalised", 5.6) < 1.0
    assert quaternion_growth("RK4, quaternion not normalised", 5.7) > 1.0


@pytest.mark.parametrize(
    ("name", "h", "ratio", "verdict"),
    [
        ("semi-implicit Euler", 0.01, 0.5, maps.WRONG),
        ("semi-implicit Euler", 1.0, 0.1, maps.NOT_FINITE),
        ("RK4, quaternion", 0.1, 0.1, maps.RIGHT),
        ("RK4, quaternion", 1.5, 0.1, maps.WRONG),
        ("RK4, quaternion", 8.0, 0.1, maps.NOT_FINITE),
        ("implicit midpoint", 5.0, 0.1, maps.NOT_FINITE),
    ],
)
def test_verdicts_on_fixed_steps(name: str, h: float, ratio: float, verdict: int) -> None:
    assert maps.verdict_of_steps(CONTESTANTS[name], h, ratio) == verdict


@pytest.mark.parametrize("h", [0.1, 10.0])
@pytest.mark.parametrize("ratio", [0.01, 0.4, 1.0])
def test_product_is_right_at_any_step_or_refuses(h: float, ratio: float) -> None:
    assert maps.verdict_of_steps(EXACT_STEPS, h, ratio) == maps.RIGHT
    assert maps.verdict_of_product((), h, ratio) == maps.RIGHT
    assert maps.verdict_of_product(("torque_b",), h, ratio) in (maps.RIGHT, maps.REFUSED)


def test_stability_leaves_tables_and_pictures(tmp_path: Path) -> None:
    seen: list[int] = []

    def progress(parts: Any) -> Any:
        for part in parts:
            yield part
            seen.append(len(seen))

    paths = stability.run_stability(tmp_path / "out", quick=True, progress=progress)
    assert paths[0].name == "laws.csv"
    assert {p.name for p in (tmp_path / "out").iterdir()} == {p.name for p in paths}
    assert len([p for p in paths if p.suffix == ".png" and p.stat().st_size > 10_000]) == len(STUDIES) + 1
    assert len(seen) == 2 * len(STUDIES) + len(maps.QUICK_METHODS) + 2
    assert stability.failures(tmp_path / "out") == []
    with (tmp_path / "out" / "maps.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    ours = {row["verdict"] for row in rows if row["method"].startswith("rbfmu")}
    assert ours <= {"right", "refused with a message"}
    assert {row["verdict"] for row in rows} >= {"right", "wrong", "not finite"}


def test_a_law_that_does_not_hold_is_reported(tmp_path: Path) -> None:
    wrong = Finding(1, "growth", 1.0, 1.1, 0.01)
    stability.write_findings(tmp_path / "laws.csv", [wrong, Finding(2, "bound", 1.0, 0.5, 0.0, AT_MOST)])
    assert stability.failures(tmp_path) == ["law 1, growth: predicted 1.0, measured 1.1"]
