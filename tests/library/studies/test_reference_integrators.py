"""The reference integrators are what they claim: their orders, on a free body and under loads, and their forms."""

import math
from typing import Any

import pytest

from rbfmu.studies.one_step import OneStepMethod
from rbfmu.studies.reference_methods import MAX_ROUNDS, REFERENCE_INTEGRATORS, TORQUE_FREE_INTEGRATORS, midpoint
from rbfmu_kernels.exact.free_rotation import free_rotation
from rbfmu_kernels.integrators.splitting import rkn6_steps
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, State
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia
from rbfmu_kernels.rotations.quaternion import angle_between, normalize

EPS = 2.0**-52
ZERO = (0.0, 0.0, 0.0)
MOMENTS = (1.0, 2.0, 3.0)
BRICK = Body(1.0, diagonal(MOMENTS), inverse_inertia(diagonal(MOMENTS)), ZERO, ZERO, 1.0)
TUMBLE = State(ZERO, ZERO, (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, 0.2))
ROD = diagonal((1.0, 1.0, 0.3))
LOADED = Body(0.5, ROD, inverse_inertia(ROD), (0.2, -0.1, 0.3), ZERO, 1.0)
LOADS = Loads((0.0, 0.0, -9.81), (1.0, 2.0, -1.0), (0.3, -0.2, 0.5), (0.1, 0.2, 0.3), (-0.3, 0.2, 0.1))
START = State(ZERO, (1.0, 0.0, 0.0), normalize((0.8, -0.3, 0.4, 0.2)), (0.3, -1.0, 0.8))
STEPS = {1: 2000, 2: 400, 4: 200, 10: 20}
"""Over 8 s, from which on the order shows."""


def _angle(state: State, q: Any) -> float:
    return angle_between(state.q_ab, tuple(q))


def _order(errors: list[float]) -> float:
    return math.log2(errors[0] / errors[1])


@pytest.mark.parametrize("method", (REFERENCE_INTEGRATORS | TORQUE_FREE_INTEGRATORS).values(), ids=lambda m: m.name)
def test_order_on_a_free_body(method: OneStepMethod) -> None:
    q, omega = free_rotation(MOMENTS, TUMBLE.q_ab, TUMBLE.omega_b, 8.0)
    n = STEPS[method.order]
    runs = [method.run(TUMBLE, 8.0 / m, m, BRICK, NO_LOADS) for m in (n, 2 * n)]
    assert _order([_angle(r, q) for r in runs]) == pytest.approx(method.order, abs=0.1)
    assert _order([math.dist(r.omega_b, omega) for r in runs]) == pytest.approx(method.order, abs=0.1)


@pytest.mark.parametrize("method", REFERENCE_INTEGRATORS.values(), ids=lambda m: m.name)
def test_order_of_six_degrees_of_freedom_under_all_loads(method: OneStepMethod) -> None:
    truth = START
    for _ in range(200):
        truth = rkn6_steps(truth, 0.01, 1, LOADED, LOADS)  # 4e-13 off SciPy's: see its own test
    n = STEPS[method.order] // 4
    runs = [method.run(START, 2.0 / m, m, LOADED, LOADS) for m in (n, 2 * n)]
    assert _order([_angle(r, truth.q_ab) for r in runs]) == pytest.approx(method.order, abs=0.1)
    for part in (0, 1, 3):
        assert _order([math.dist(r[part], truth[part]) for r in runs]) == pytest.approx(method.order, abs=0.15)


@pytest.mark.parametrize("method", REFERENCE_INTEGRATORS.values(), ids=lambda m: m.name)
def test_state_survives_the_method_s_form(method: OneStepMethod) -> None:
    after = method.run(START, 0.1, 0, LOADED, LOADS)
    assert _angle(after, START.q_ab) < 6 * EPS
    assert (after.r_c, after.v_c, after.omega_b) == (START.r_c, START.v_c, START.omega_b)


@pytest.mark.thorough
@pytest.mark.parametrize("method", REFERENCE_INTEGRATORS.values(), ids=lambda m: m.name)
def test_drift_adds_up_over_calls_of_steps(method: OneStepMethod) -> None:
    once = method.steps(method.start(TUMBLE), 0.3, 200, BRICK, NO_LOADS)
    twice = method.start(TUMBLE)
    for _ in range(2):
        twice = method.steps(twice, 0.3, 100, BRICK, NO_LOADS)
    assert once == twice


@pytest.mark.parametrize("method", TORQUE_FREE_INTEGRATORS.values(), ids=lambda m: m.name)
def test_a_body_of_a_planet_s_size_turns_like_a_small_one(method: OneStepMethod) -> None:
    """2026-11-24: powers of its moments overflowed, and `rbfmu chart` of the earth ended with a traceback."""
    large = BRICK._replace(inertia=diagonal(tuple(2.0**130 * moment for moment in MOMENTS)))
    assert method.run(TUMBLE, 0.1, 20, large, NO_LOADS) == method.run(TUMBLE, 0.1, 20, BRICK, NO_LOADS)


def test_implicit_midpoint_keeps_energy_and_length_of_q() -> None:
    q, omega = REFERENCE_INTEGRATORS["implicit midpoint"].steps(TUMBLE, 0.1, 10_000, BRICK, NO_LOADS)[2:]
    energy = sum(moment * w * w for moment, w in zip(MOMENTS, omega, strict=True))
    assert abs(math.hypot(*q) - 1.0) < 1e-12  # the iteration stops at 1e-15 a step
    assert energy == pytest.approx(0.09 + 2.0 + 0.12, rel=1e-12)


def test_implicit_midpoint_is_not_finite_where_its_iteration_fails() -> None:
    assert midpoint(TUMBLE, 3.0, BRICK, NO_LOADS)[1] == MAX_ROUNDS  # settles nowhere
    assert midpoint(TUMBLE, 5.0, BRICK, NO_LOADS)[1] < MAX_ROUNDS  # overflows
    for h in (3.0, 5.0):
        assert not math.isfinite(
            REFERENCE_INTEGRATORS["implicit midpoint"].run(TUMBLE, h, 1, BRICK, NO_LOADS).omega_b[0]
        )
