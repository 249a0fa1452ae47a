"""`rbfmu chart`: references against other arithmetic, and what counts as an error."""

import json
import math
from types import ModuleType

import mpmath as mp
import pytest

from examples.references import reference_motions
from rbfmu.studies.chart.cases import CASES, CHECKPOINTS, DRIFTS, REFERENCES
from tests.support.chart_points import true_states
from tests.support.covering import some_of
from tests.support.references import free_rotation_mp, reference_mp

DIGITS = mp.mpf(10) ** -37
"""Of 40 in the file; body rates grow to 50."""
EPS = 2.0**-52
MOTIONS = json.loads(REFERENCES.read_text())["motions"]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return reference_motions


def _largest_difference(a, b):
    with mp.workdps(60):
        return max(abs(mp.mpf(x) - mp.mpf(y)) for u, v in zip(a, b, strict=True) for x, y in zip(u, v, strict=True))


@pytest.mark.parametrize("key", CASES)
def test_references_are_of_these_scenes(key: str) -> None:
    assert MOTIONS[key]["scene"] == CASES[key].scene.to_dict()


@pytest.mark.parametrize("key", ["d", "e"])
def test_references_do_not_depend_on_the_arithmetic_s_settings(script: ModuleType, key: str) -> None:
    stored, again = MOTIONS[key], script.reference_motion(key, script.Settings(230, 32, 60))
    assert max(_largest_difference(stored[name], again[name]) for name in again) < DIGITS


@pytest.mark.parametrize("key", ["a", "b", "g"])
def test_torque_free_references_are_the_closed_form(key: str) -> None:
    case, stored = CASES[key], MOTIONS[key]
    for i in (0, CHECKPOINTS - 1):
        q, omega = free_rotation_mp.closed_form(
            case.moments, case.start.q_ab, case.start.omega_b, case.interval * (i + 1)
        )
        with mp.workdps(60):
            sign = mp.sign(sum(x * mp.mpf(y) for x, y in zip(q, stored["quaternion"][i], strict=True)))
            q = [sign * x for x in q]
        assert _largest_difference([q], [stored["quaternion"][i]]) < DIGITS
        assert _largest_difference([omega], [stored["omega_b"][i]]) < DIGITS


@pytest.mark.parametrize("key", some_of(["c'", "d", "e", "f"], 2))
def test_forced_references_agree_with_another_formulation(key: str) -> None:
    case, stored = CASES[key], MOTIONS[key]
    times = tuple(case.interval * (i + 1) for i in range(1 if key == "c'" else CHECKPOINTS))
    for i, point in enumerate(reference_mp.motion(case.scene, times)):
        with mp.workdps(60):
            e, x, y, z = map(mp.mpf, stored["quaternion"][i])
            bottom = [2 * (x * z - e * y), 2 * (y * z + e * x), e * e - x * x - y * y + z * z]
        assert _largest_difference([bottom], [point.R_ab[2]]) < DIGITS
        assert _largest_difference([point.omega_b], [stored["omega_b"][i]]) < DIGITS


@pytest.mark.parametrize("key", CASES)
def test_the_truth_has_no_error_and_keeps_what_it_keeps(key: str) -> None:
    assert CASES[key].error(true_states(key)) < 2 * EPS  # its rounding
    drifts = CASES[key].drifts(true_states(key))
    assert drifts.keys() == {f"{name.replace(' ', '_')}_drift" for name in DRIFTS if name in CASES[key].keeps}
    assert max(drifts.values(), default=0.0) < 1e-14


def test_errors_are_angles() -> None:
    states = true_states("a")
    half = 0.5e-6
    e, x, y, z = states[3][2]
    turned = (e * math.cos(half) - x * math.sin(half), x * math.cos(half) + e * math.sin(half),
              y * math.cos(half) + z * math.sin(half), z * math.cos(half) - y * math.sin(half))  # fmt: skip
    states[3] = (*states[3][:2], tuple(-2.0 * c for c in turned), states[3][3])  # neither sign nor length counts
    assert CASES["a"].error(states) == pytest.approx(1e-6, rel=1e-9)


def test_what_is_not_finite_has_an_infinite_error() -> None:
    states = true_states("a")
    states[1] = (*states[1][:3], (math.nan, 0.0, 0.0))
    assert CASES["a"].error(states) == math.inf
