"""Classical Runge-Kutta, with which others are compared, against 40 digits: order, round-off, unit quaternions."""

import itertools
import math

import mpmath as mp
import numpy as np
import pytest
from numba import config, njit

from rbfmu.scene.scene import Scene, load_scene
from rbfmu.studies.reference_methods import rk4_step
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.mechanics.equations_of_motion import NO_LOADS, Body, Loads, State
from tests.support.paths import SCENES
from tests.support.references import free_rotation_mp, reference_mp as reference
from tests.support.scenes.model_cases import ALL_LOADS

EPS = 2.0**-52
ZERO = (0.0, 0.0, 0.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
BRICK = load_scene(SCENES / "tumbling_brick.toml")


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


def orders(errors):
    return [math.log2(a / b) for a, b in itertools.pairwise(errors)]


def test_rk4_converges_at_order_4_in_all_of_a_loaded_body_s_motion():
    scene = Scene(**ALL_LOADS, run={"stop": 4.0})
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


def test_a_step_leaves_a_unit_quaternion():
    state, body = spinning((3.0, -2.0, 5.0), (0.5, 0.5, -0.5, 0.5)), free_body(inertia.diagonal((1.0, 2.0, 2.5)))
    for _ in range(200):
        state = rk4_step(state, 0.1, body, NO_LOADS)
        assert abs(sum(x * x for x in state.q_ab) - 1.0) <= 3 * EPS


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="too many steps to interpret")
def test_rk4_s_round_off_stays_small_where_its_error_has_gone():
    """3e4 steps leave 3e-15 of error of the method; round-off of 80 eps, a random walk of half an eps a step."""
    (truth,) = reference.motion(BRICK, (30.0,))
    body = free_body(BRICK.body.inertia, BRICK.body.mass)
    end = run(spinning(BRICK.initial.omega_b), 1e-3, 30_000, body, NO_LOADS)
    assert 1e-15 < reference.angle_to(end.q_ab, truth.R_ab) < 0.5 * math.sqrt(30_000) * EPS


def test_what_is_not_finite_stays_so():
    state = rk4_step(spinning((math.nan, 0.0, 0.0)), 0.1, free_body(inertia.diagonal((1.0, 2.0, 2.5))), NO_LOADS)
    assert all(map(math.isnan, (*state.q_ab, *state.omega_b)))
