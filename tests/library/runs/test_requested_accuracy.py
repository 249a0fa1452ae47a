"""What a scene asks for it gets: errors of planned runs against 40-digit references, neither above nor far below."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rbfmu
from rbfmu import Plan, Scene
from rbfmu.runs.motion import relative_error
from rbfmu.studies.chart.cases import CASES
from rbfmu_kernels.integrators.splitting import resonant_step

FORCED = ("c", "c'", "d", "e", "f")


@cache
def run(key: str, accuracy: float) -> tuple[Plan, dict[str, float]]:
    """The plan and the errors of a case's scene at an accuracy."""
    case = CASES[key]
    tables = case.scene.to_dict() | {"outputs": {}}
    tables["run"]["accuracy"] = accuracy
    scene = Scene.from_dict(tables, key)
    planned = rbfmu.plan(scene)
    result, truth = rbfmu.simulate(scene, planned=planned), {name: rows[1:] for name, rows in case.truth.items()}
    attitude = rbfmu.angle_between(result.quaternion[1:], truth["quaternion"])
    rates = relative_error(result.omega_b[1:], truth["omega_b"], 0.0)
    errors = {"attitude": float(np.max(attitude)), "rates": float(np.max(rates))}
    if not case.scene.body.pivot:
        errors["position"] = float(np.max(relative_error(result.position[1:], truth["position"], 1.0)))
    return planned, errors


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("key", FORCED)
def test_error_is_at_most_the_accuracy_asked(key: str, accuracy: float) -> None:
    _, errors = run(key, accuracy)
    assert max(errors.values()) <= accuracy, errors


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("key", FORCED)
def test_accuracy_is_not_wasted(key: str, accuracy: float) -> None:
    """Unless a closed form, or the longest step short of a resonance, is better than asked."""
    planned, errors = run(key, accuracy)
    if planned.model == "one axis":
        return
    if planned.model == "symmetric top" and planned.substep >= 0.449 * resonant_step(
        CASES[key].body.inertia, CASES[key].scene.initial.omega_b
    ):
        return
    largest = max(*errors.values(), planned.error)  # the plan's counts other quantities too: of a top, alpha_b most
    assert largest >= 0.01 * accuracy, errors


@pytest.mark.parametrize("accuracy", [1e-3, 1e-12])
@pytest.mark.parametrize("key", ["a", "b"])
def test_torque_free_scenes_are_exact_whatever_is_asked(key: str, accuracy: float) -> None:
    planned, errors = run(key, accuracy)
    assert planned.model == "torque-free body"
    assert errors["attitude"] <= 1e-13  # 60 to 100 rad in inputs that are exact; measured 2e-15


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_what_comes_of_small_numbers_meets_the_accuracy_with_ports_as_well(accuracy: float) -> None:
    """Positions count relative to 1 m, accelerations to themselves: one tolerance was tried, and the plan refused."""
    swing = Scene(
        body={"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}, initial={"position": [1e-3, 0, 0]},
        loads={"gravity_a": [0, 0, 0], "force_a": "-4*position"}, inputs={"ports": ["force_a"]},
        outputs={"quantities": ["acceleration"]}, run={"stop": 10.0, "step": 0.5, "accuracy": accuracy},
    )  # fmt: skip
    found = rbfmu.simulate(swing)
    np.testing.assert_allclose(found.acceleration[:, 0], -4e-3 * np.cos(2.0 * found.time), rtol=0, atol=4e-3 * accuracy)


@pytest.mark.thorough
def test_a_motion_by_formulas_that_magnifies_errors_has_the_accuracy_asked() -> None:
    """A body that turns over; its tolerance is far below the accuracy, and is found by more than one pilot run."""
    start, moments, accuracy = [1e-3, 1.0, 1e-3], np.array([1.0, 2.0, 3.0]), 1e-6
    scene = Scene(
        body={"mass": 2.0, "inertia": moments}, initial={"omega_b": start}, outputs={"quantities": ["omega_b"]},
        loads={"torque_b": "-0.1*omega_b*cos(t)"}, run={"stop": 60.0, "step": 2.0, "accuracy": accuracy},
    )  # fmt: skip

    def rates(t: float, omega: np.ndarray) -> np.ndarray:
        return (-0.1 * omega * np.cos(t) - np.cross(omega, moments * omega)) / moments

    found = rbfmu.simulate(scene)
    truth = solve_ivp(rates, (0.0, 60.0), start, "DOP853", found.time, rtol=1e-12, atol=1e-14).y.T
    assert 0.01 * accuracy <= np.max(relative_error(found.omega_b, truth, 0.0)) <= accuracy
