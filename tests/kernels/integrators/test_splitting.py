"""Splitting of symmetric bodies: orders, exactness without loads, truth under loads, kept quantities."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rbfmu.studies.reference_methods import SPLITTINGS
from rbfmu_kernels.exact.free_rotation import free_rotation
from rbfmu_kernels.integrators import splitting
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, State
from rbfmu_kernels.mechanics.inertia import diagonal, inverse_inertia, rotate_inertia, scale_matrix
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion
from rbfmu_kernels.rotations.quaternion import angle_between, normalize, rotate

EPS = 2.0**-52
ZERO = (0.0, 0.0, 0.0)
MOMENTS = {"x": (0.4, 1.0, 1.0), "y": (1.0, 1.7, 1.0), "z": (1.0, 1.0, 0.3), "sphere": (0.7, 0.7, 0.7)}
Q_0 = normalize((0.8, -0.3, 0.4, 0.2))
TILT = normalize((0.6, 0.1, -0.7, 0.3))


def _body(M: Any, arm: Any = ZERO, inverse_mass: float = 0.0) -> Body:
    return Body(inverse_mass, M, inverse_inertia(M), arm, ZERO, 1.0 if inverse_mass else 0.0)


def _tilted(moments: Any) -> Any:
    """An inertia matrix whose symmetry axis is none of x, y, z, symmetric to the bit."""
    M = rotate_inertia(matrix_from_quaternion(TILT), diagonal(moments))
    return tuple(tuple(0.5 * (M[i][j] + M[j][i]) for j in range(3)) for i in range(3))


TOP = _body(diagonal((1.0, 1.0, 0.3)), (0.0, 0.0, 1.0))
WEIGHT = Loads((0.0, 0.0, -1.0), (0.0, 0.0, -1.0), ZERO, ZERO, ZERO)
ALL_LOADS = Loads((0.0, 0.0, -9.81), (1.0, 2.0, -1.0), (0.3, -0.2, 0.5), (0.1, 0.2, 0.3), (-0.3, 0.2, 0.1))
SPIN = State(ZERO, ZERO, (math.cos(0.3), math.sin(0.3), 0.0, 0.0), (0.5, 0.2, 4.0))


def _angle(state: State, q: Any) -> float:
    return angle_between(state.q_ab, tuple(q))


@pytest.mark.parametrize(("name", "h"), [("Strang", 0.05), ("RKN4", 0.05), ("RKN6", 0.2)])
def test_order_of_convergence(name: str, h: float) -> None:
    method = SPLITTINGS[name]
    runs = [method.run(SPIN, h / n, round(4.0 / h) * n, TOP, WEIGHT) for n in (1, 2, 4)]
    order = math.log2(_angle(runs[0], runs[1].q_ab) / _angle(runs[1], runs[2].q_ab))
    assert order == pytest.approx(method.order, abs=0.1)


@pytest.mark.parametrize("name", SPLITTINGS)
@pytest.mark.parametrize("axis", MOMENTS)
def test_one_step_without_loads_is_exact_about_any_axis(name: str, axis: str) -> None:
    omega = (0.3, -1.0, 0.8)
    after = SPLITTINGS[name].run(State(ZERO, ZERO, Q_0, omega), 3.0, 1, _body(diagonal(MOMENTS[axis])), NO_LOADS)
    q, omega_then = free_rotation(MOMENTS[axis], Q_0, omega, 3.0)
    assert _angle(after, q) < 16 * EPS  # 8 measured: 11 drifts of some rad
    assert np.allclose(after.omega_b, omega_then, rtol=0.0, atol=4 * EPS)  # 2 measured


def _scipy(state: State, t: float, body: Body, loads: Loads) -> Any:
    """The same motion by other means: matrices and cross products of NumPy, SciPy's integrator."""
    inverse_mass, M, _, arm, _, free = body
    gravity_a, force_a, force_b, torque_a, torque_b = map(np.array, loads)

    def rates(_: float, y: Any) -> Any:
        v, q, omega = y[3:6], y[6:10], y[10:]
        R = np.array(matrix_from_quaternion(tuple(q / np.linalg.norm(q))))
        torque = R.T @ torque_a + torque_b + np.cross(arm, R.T @ force_a + force_b)
        alpha = np.linalg.solve(np.array(M), torque - np.cross(omega, np.array(M) @ omega))
        dq = 0.5 * np.array([-q[1:] @ omega, *(q[0] * omega + np.cross(q[1:], omega))])
        return np.concatenate([v, free * gravity_a + inverse_mass * (force_a + R @ force_b), dq, alpha])

    return solve_ivp(rates, (0.0, t), np.concatenate(state), method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("case", ["pivot", "free, tilted axis"])
def test_true_motion_under_loads(case: str) -> None:
    if case == "pivot":
        body, loads, state = TOP, WEIGHT, SPIN
    else:
        body, loads = _body(_tilted((1.0, 1.0, 0.3)), (0.2, -0.1, 0.3), 0.5), ALL_LOADS
        state = State(ZERO, (1.0, 0.0, 0.0), Q_0, (0.3, -1.0, 0.8))
    truth = _scipy(state, 2.0, body, loads)
    after = SPLITTINGS["RKN6"].run(state, 0.01, 200, body, loads)
    assert _angle(after, truth[6:10]) < 4e-13  # 2e-13 measured: SciPy's own
    assert np.allclose(np.concatenate(after), truth, rtol=0.0, atol=4e-13)


@pytest.mark.parametrize("name", SPLITTINGS)
def test_steps_are_reversible(name: str) -> None:
    method = SPLITTINGS[name]
    there = method.run(SPIN, 0.05, 100, TOP, WEIGHT)
    back = method.run(there, -0.05, 100, TOP, WEIGHT)
    assert _angle(back, SPIN.q_ab) < 160 * EPS  # 82 measured: round-off of 200 steps


@pytest.mark.parametrize("name", SPLITTINGS)
def test_quaternion_keeps_its_length(name: str) -> None:
    y = SPLITTINGS[name].steps(SPIN, 0.05, 20_000, TOP, WEIGHT)
    assert abs(math.hypot(*y.q_ab) - 1.0) < 3 * EPS


def test_energy_stays_bounded_over_a_thousand_revolutions() -> None:
    def energy(state: State) -> float:
        a, b, c = state.omega_b
        return 0.5 * (a * a + b * b + 0.3 * c * c) + rotate(state.q_ab, (0.0, 0.0, 1.0))[2]

    y, worst = SPIN, [0.0, 0.0]
    for k in range(1000):
        y = SPLITTINGS["Strang"].steps(y, 0.1, 100, TOP, WEIGHT)
        worst[k >= 500] = max(worst[k >= 500], abs(energy(y) - energy(SPIN)))
    assert worst[0] == pytest.approx(2.1e-3, rel=0.05)  # of m g l = 1
    assert worst[1] == pytest.approx(worst[0], rel=0.01)


@pytest.mark.parametrize("moments", [(1.0, 1.0, 0.3), (1.0, 1.0, 1.9), (1.0, 1.0, 1.0 - 1e-9), (1.0, 1.0, 0.0)])
def test_transverse_moment_of_any_axes(moments: Any) -> None:
    for M in (diagonal(moments), diagonal(moments[::-1]), _tilted(moments)):
        assert splitting.transverse_moment(M) == pytest.approx(1.0, abs=6 * EPS)
        assert splitting.is_symmetric_top(M)


@pytest.mark.parametrize("moments", [(1.0, 2.0, 2.5), (1.0, 1.0 + 1e-14, 1.5), (1.0, 1.3, 1.0 + 1e-12)])
def test_unequal_moments_are_no_symmetric_top(moments: Any) -> None:
    assert not splitting.is_symmetric_top(diagonal(moments))
    assert not splitting.is_symmetric_top(_tilted(moments))


@pytest.mark.parametrize("exponent", range(-300, 301, 20))
def test_symmetry_and_transverse_moment_are_the_same_at_every_scale(exponent: int) -> None:
    power = 2.0 ** round(exponent * math.log2(10.0))
    for moments, symmetric in (((1.0, 1.0, 0.3), True), ((1.0, 2.0, 2.5), False), ((1.0, 1.0 + 1e-12, 1.5), False)):
        for M in (diagonal(moments), _tilted(moments)):
            scaled = scale_matrix(power, M)
            assert splitting.is_symmetric_top(scaled) == symmetric
            assert splitting.transverse_moment(scaled) == power * splitting.transverse_moment(M)


def test_resonant_step_is_a_turn_about_the_momentum() -> None:
    M = diagonal((1.0, 1.0, 0.3))
    fast: Callable[..., float] = splitting.resonant_step
    assert fast(M, (0.0, 0.0, -50.0)) == pytest.approx(2.0 * math.pi / 15.0, rel=4 * EPS)
    assert fast(M, (3.0, 4.0, 0.0)) == pytest.approx(2.0 * math.pi / 5.0, rel=4 * EPS)
    assert fast(M, ZERO) > 1e300


def test_torque_fixed_in_the_body_resonates_with_its_turns() -> None:
    start = State(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 50.0))
    loads = Loads(ZERO, ZERO, ZERO, ZERO, (1.0, 0.0, 0.0))

    def error(h: float) -> float:
        n = round(10.0 / h)
        truth = SPLITTINGS["RKN6"].run(start, n * h / 10_000, 10_000, TOP, loads)
        return _angle(SPLITTINGS["Strang"].run(start, h, n, TOP, loads), truth.q_ab)

    at_resonance = error(2.0 * math.pi / 50.0)
    assert at_resonance == pytest.approx(0.670, abs=2e-3)  # rad in 10 s: the kicks all point the same way in space
    assert error(0.8 * 2.0 * math.pi / 50.0) < 0.01 * at_resonance
