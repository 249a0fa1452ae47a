"""One-step methods: order of convergence, and the errors that theory predicts for them, with their numbers."""

import cmath
import itertools
import math

import mpmath as mp
import numpy as np
import pytest
from numba import config, njit

from rbfmu.scene.scene import Scene, load_scene
from rbfmu.studies.reference_methods import rk4_not_normalised_step, rk4_step
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, State
from rbfmu_kernels.mechanics.newton_euler import kinetic_energy
from tests.support.paths import SCENES
from tests.support.references import free_rotation_mp, reference_mp as reference

EPS = 2.0**-52
ZERO = (0.0, 0.0, 0.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
BRICK = load_scene(SCENES / "tumbling_brick.toml")
compiled = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="too many steps to interpret")


@njit(error_model="numpy")
def run(state, h, n, body, loads):
    for _ in range(n):
        state = rk4_step(state, h, body, loads)
    return state


@pytest.mark.thorough
def test_the_reference_has_its_40_digits():
    """Against the closed form of torque-free motion, in another formulation and from another module."""
    (found,) = reference.motion(BRICK, (30.0,))
    moments = [BRICK.body.inertia[i][i] for i in range(3)]
    q, omega = free_rotation_mp.closed_form(moments, BRICK.initial.quaternion, BRICK.initial.omega_b, 30.0)
    with mp.workdps(50):
        truth = reference.matrix_of(q)
        error = max(
            abs(a - b) for row, other in zip(found.R_ab, truth, strict=True) for a, b in zip(row, other, strict=True)
        )
        assert error < mp.mpf(10) ** -40
        assert max(abs(a - b) for a, b in zip(found.omega_b, omega, strict=True)) < mp.mpf(10) ** -40


def free_body(M, mass=1.0, arm=ZERO, damping_b=ZERO):
    return Body(1.0 / mass, M, inertia.inverse_inertia(M), arm, damping_b, 1.0)


def spinning(omega, quaternion=IDENTITY):
    return State(ZERO, ZERO, quaternion, omega)


def polynomial(z):
    """What classical Runge-Kutta makes of exp(z)."""
    return 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0


def orders(errors):
    return [math.log2(a / b) for a, b in itertools.pairwise(errors)]


@pytest.mark.thorough
def test_rk4_converges_at_order_4_in_attitude_on_nasa_s_brick():
    (truth,) = reference.motion(BRICK, (30.0,))
    body, omega = free_body(BRICK.body.inertia, BRICK.body.mass), BRICK.initial.omega_b
    ends = [run(spinning(omega), 30.0 / n, n, body, NO_LOADS) for n in (200, 400, 800, 1600, 3200)]
    attitude = [reference.angle_to(end.q_ab, truth.R_ab) for end in ends]
    rates = [reference.distance(end.omega_b, truth.omega_b) for end in ends]
    assert attitude[-1] > 1e-11  # far above round-off
    assert orders(attitude) == pytest.approx([4.0] * 4, abs=0.1)
    assert orders(rates) == pytest.approx([4.0] * 4, abs=0.1)
    assert attitude[-1] == pytest.approx(1.85e-11, rel=0.02)


def loaded_scene():
    return Scene(
        body={"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]],
              "r_oc_b": [0.1, -0.2, 0.3]},
        initial={"omega_b": [1.0, 2.0, -1.0], "position": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2, 0.3]},
        loads={"force_b": [1.0, 0.5, 0.2], "force_a": [0.3, 0.1, -0.4], "torque_b": [0.1, 0.2, 0.1],
               "torque_a": [0.05, 0.0, 0.02], "damping_b": [0.1, 0.05, 0.02]},
        run={"stop": 4.0},
    )  # fmt: skip


def test_rk4_converges_at_order_4_in_all_of_a_loaded_body_s_motion():
    scene = loaded_scene()
    (truth,) = reference.motion(scene, (4.0,))
    r, omega, loads = np.array(scene.body.r_oc_b), scene.initial.omega_b, scene.loads
    body = free_body(scene.body.inertia, 2.0, tuple((-r).tolist()), loads.damping_b)
    start = State(
        tuple((np.array(scene.initial.position) + r).tolist()),
        tuple((np.array(scene.initial.velocity) + np.cross(omega, r)).tolist()),
        IDENTITY,
        omega,
    )
    known = Loads(loads.gravity_a, loads.force_a, loads.force_b, loads.torque_a, loads.torque_b)
    errors = []
    for n in (100, 200, 400):
        r_c, v_c, q, rate = run(start, 4.0 / n, n, body, known)
        R = np.array(reference.matrix_of(q), dtype=float)
        position, velocity = r_c - R @ r, v_c - R @ np.cross(rate, r)
        errors.append(
            [reference.angle_to(q, truth.R_ab)]
            + [
                reference.distance(x, t)
                for x, t in ((rate, truth.omega_b), (position, truth.position), (velocity, truth.velocity))
            ]
        )
    assert np.min(errors) > 1e-11
    for quantity in np.transpose(errors):
        assert orders(quantity) == pytest.approx([4.0] * 2, abs=0.1)


def test_rk4_is_exact_on_a_parabola():
    start = State((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), IDENTITY, ZERO)
    loads = Loads((0.0, 0.0, -8.0), (2.0, 0.0, 0.0), (0.0, 4.0, 0.0), ZERO, ZERO)
    r, v, q, omega = run(start, 0.25, 40, free_body(inertia.diagonal((1.0, 1.0, 1.0)), 2.0), loads)
    assert v == (4.0 + 10.0, 5.0 + 20.0, 6.0 - 80.0)
    assert r == pytest.approx((1.0 + 40.0 + 50.0, 2.0 + 50.0 + 100.0, 3.0 + 60.0 - 400.0), rel=4 * EPS)
    assert (q, omega) == (IDENTITY, ZERO)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("turn", [0.05, 0.2, 1.0])
def test_rk4_lags_by_the_fifth_power_over_1920(axis, turn):
    """Spin about a principal axis, a turn of h omega a step: the angle of a step is 2 arg p(i h omega / 2)."""
    omega, steps = [0.0] * 3, 50
    omega[axis] = 2.0
    body = free_body(inertia.diagonal((1.0, 2.0, 2.5)))
    _, _, q, rate = run(spinning(tuple(omega)), turn / 2.0, steps, body, NO_LOADS)
    step = 2.0 * cmath.phase(polynomial(0.5j * turn))
    assert rate == tuple(omega)
    assert q[0] == pytest.approx(math.cos(0.5 * steps * step), abs=20 * EPS)  # 50 steps' round-off
    assert q[1 + axis] == pytest.approx(math.sin(0.5 * steps * step), abs=20 * EPS)
    assert (turn - step) / turn**5 == pytest.approx(1.0 / 1920.0, rel=0.095 * turn**2 + 4 * EPS / turn**5 * 1920.0)


def without_normalising(omega, h):
    """The length of the quaternion after one classical step from the identity."""
    body, start = free_body(inertia.diagonal((1.0, 2.0, 2.5))), spinning(omega)
    return math.hypot(*rk4_not_normalised_step(start, h, body, NO_LOADS).q_ab)


def test_without_normalising_the_quaternion_would_shrink_by_the_sixth_power_over_9216():
    for turn in (0.3, 0.6):
        loss = 1.0 - without_normalising((0.0, 0.0, 3.0), turn / 3.0)
        assert loss / turn**6 == pytest.approx(1.0 / 9216.0, rel=0.07 * turn**2 + 1e-9)
    limit = 4.0 * math.sqrt(2.0)
    assert (
        without_normalising((0.0, 0.0, 3.0), 0.999 * limit / 3.0)
        < 1.0
        < without_normalising((0.0, 0.0, 3.0), 1.001 * limit / 3.0)
    )


def test_a_step_leaves_a_unit_quaternion():
    state, body = spinning((3.0, -2.0, 5.0), (0.5, 0.5, -0.5, 0.5)), free_body(inertia.diagonal((1.0, 2.0, 2.5)))
    for _ in range(200):
        state = rk4_step(state, 0.1, body, NO_LOADS)
        assert abs(sum(x * x for x in state.q_ab) - 1.0) <= 3 * EPS


@pytest.mark.parametrize("stiffness", [0.01, 0.5, 2.0, 2.785, 2.786])
def test_damping_multiplies_the_rate_by_rk4_s_polynomial(stiffness):
    """Stable while h d / I < 2.785."""
    body = free_body(inertia.diagonal((2.0, 2.0, 2.0)), damping_b=(4.0, 4.0, 4.0))
    _, _, _, omega = rk4_step(spinning((0.0, 0.0, 1.0)), 0.5 * stiffness, body, NO_LOADS)
    assert omega[2] == pytest.approx(polynomial(-stiffness), abs=4 * EPS * max(1.0, stiffness**4 / 24.0))
    assert (abs(omega[2]) < 1.0) == (stiffness <= 2.785)


def energy_error(h, steps):
    M, omega = inertia.diagonal((1.0, 2.0, 3.0)), (0.3, 1.0, 0.2)
    end = run(spinning(omega, (0.5, 0.5, 0.5, 0.5)), h, steps, free_body(M), NO_LOADS)
    return kinetic_energy(0.0, M, ZERO, end.omega_b) / kinetic_energy(0.0, M, ZERO, omega) - 1.0


@compiled
def test_rk4_loses_energy_at_the_fifth_power_of_the_step():
    """-0.026 h^5 per 100 s, so 26 millionths in 1e5 steps of 0.1 s: moments 1, 2, 3, rates 0.3, 1, 0.2."""
    errors = [energy_error(h, round(1e4 / h)) for h in (0.2, 0.1, 0.05)]
    assert orders(np.abs(errors)) == pytest.approx([5.0] * 2, abs=0.1)
    assert errors[1] == pytest.approx(-2.6e-5, rel=0.02)


@compiled
def test_rk4_s_round_off_stays_small_where_its_error_has_gone():
    """3e4 steps leave 3e-15 of error of the method; round-off of 80 eps, a random walk of half an eps a step."""
    (truth,) = reference.motion(BRICK, (30.0,))
    body = free_body(BRICK.body.inertia, BRICK.body.mass)
    end = run(spinning(BRICK.initial.omega_b), 1e-3, 30_000, body, NO_LOADS)
    assert 1e-15 < reference.angle_to(end.q_ab, truth.R_ab) < 0.5 * math.sqrt(30_000) * EPS


def test_what_is_not_finite_stays_so():
    state = rk4_step(spinning((math.nan, 0.0, 0.0)), 0.1, free_body(inertia.diagonal((1.0, 2.0, 2.5))), NO_LOADS)
    assert all(map(math.isnan, (*state.q_ab, *state.omega_b)))
