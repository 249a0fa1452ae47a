"""Laws of the lecture's equations read from left to right, and of momentum: loads from accelerations, and back."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import rbfmu
from rbfmu_kernels.mechanics import inertia, kinematics, newton_euler
from rbfmu_kernels.rotations import matrix, vec3
from tests.support.references import exact
from tests.support.references.exact import EPS
from tests.support.references.hard_cases import (
    any_quaternion,
    any_vector,
    of_all_sizes,
    random_quaternions,
    random_vectors,
    rng,
    rotation_matrices,
)
from tests.support.references.laws import Law

A, B, C, D = (random_vectors(300, seed) for seed in range(101, 105))
MASSES = of_all_sizes(rng(105), -3, 3, 300).tolist()
BOXES = [inertia.box_inertia(m, tuple(s)) for m, s in zip(MASSES, rng(106).uniform(0.1, 2.0, (300, 3)), strict=True)]
INERTIAS = [
    inertia.rotate_inertia(R, M) for R, M in zip(rotation_matrices(random_quaternions(300, 107)), BOXES, strict=True)
]
ZERO = (0.0, 0.0, 0.0)


BODIES = BOXES[:150] + INERTIAS[150:]
"""Half of them in principal axes, half in any."""


def cases(*columns):
    return lambda: list(zip(*columns, strict=True))


def size(M):
    return exact.norm(exact.flat(M))


def torque(M, omega, alpha):
    """M alpha + omega x (M omega), as on the slide."""
    return exact.add(exact.apply(M, alpha), exact.cross(omega, exact.apply(M, omega)))


def size_of_torque(M, omega, alpha):
    return size(M) * (exact.norm(alpha) + exact.norm(omega) ** 2)


def centre_s_acceleration(r, omega, a_o, alpha):
    return exact.add(a_o, exact.cross(alpha, r), exact.cross(omega, exact.cross(omega, r)))


def loads_o(m, M, r, omega, a_o, alpha):
    force = exact.scaled(m, centre_s_acceleration(r, omega, a_o, alpha))
    return [force, exact.add(torque(M, omega, alpha), exact.scaled(m, exact.cross(r, a_o)))]


def worst_of_two(value, truth, scale):
    """Force and torque, each by its own scale."""
    return max(exact.error(v, t, s) for v, t, s in zip(value, truth, scale, strict=True))


LAWS = [
    Law(vec3.cross, exact.cross, cases(A, B), 1.0, lambda a, b: exact.norm(a) * exact.norm(b)),
    Law(newton_euler.linear_momentum, exact.scaled, cases(MASSES, A), 0.5, lambda m, v: m * exact.norm(v)),
    Law(newton_euler.angular_momentum_o,
        lambda m, M, r, v, w: exact.add(exact.apply(M, w), exact.scaled(m, exact.cross(r, v))),
        cases(MASSES, BODIES, A, B, C), 2.0,
        lambda m, M, r, v, w: size(M) * exact.norm(w) + m * exact.norm(r) * exact.norm(v)),
    Law(newton_euler.inverse_newton_euler_c, lambda m, M, w, a, alpha: [exact.scaled(m, a), torque(M, w, alpha)],
        cases(MASSES, BODIES, A, B, C), 2.0,
        lambda m, M, w, a, alpha: [m * exact.norm(a), size_of_torque(M, w, alpha)], worst_of_two),
    Law(newton_euler.inverse_newton_euler_o, loads_o, cases(MASSES, BODIES, A, B, C, D), 3.5,
        lambda m, M, r, w, a, alpha: [
            m * (exact.norm(a) + exact.norm(r) * (exact.norm(alpha) + exact.norm(w) ** 2)),
            size_of_torque(M, w, alpha) + m * exact.norm(r) * exact.norm(a),
        ], worst_of_two),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


masses = st.floats(1e-3, 1e3)
sides = st.tuples(*[st.floats(0.1, 2.0)] * 3)


def body(mass, box, q):
    """Inertia of a box in any axes, and its condition."""
    M = inertia.rotate_inertia(matrix.matrix_from_quaternion(q), inertia.box_inertia(mass, box))
    return M, float(np.linalg.cond(np.array(M)))


def distance(a, b):
    return vec3.norm(vec3.subtract(a, b))


@given(masses, sides, any_quaternion, any_vector, any_vector, any_vector)
def test_loads_of_the_accelerations_that_loads_give_are_those_loads_about_c(mass, box, q, omega, force, torque_c):
    M, condition = body(mass, box, q)
    a_c, alpha = newton_euler.newton_euler_c(mass, M, omega, force, torque_c)
    again = newton_euler.inverse_newton_euler_c(mass, M, omega, a_c, alpha)
    torques = vec3.norm(torque_c) + np.linalg.norm(M, 2) * vec3.dot(omega, omega)
    assert distance(again[0], force) <= 1.5 * EPS * vec3.norm(force)
    assert distance(again[1], torque_c) <= 3.0 * EPS * condition * torques


@given(masses, sides, any_quaternion, any_vector, any_vector, any_vector)
def test_accelerations_of_the_loads_of_accelerations_are_those_accelerations_about_c(mass, box, q, omega, a_c, alpha):
    M, condition = body(mass, box, q)
    again = newton_euler.newton_euler_c(
        mass, M, omega, *newton_euler.inverse_newton_euler_c(mass, M, omega, a_c, alpha)
    )
    rates = vec3.norm(alpha) + vec3.dot(omega, omega)
    assert distance(again[0], a_c) <= 1.5 * EPS * vec3.norm(a_c)
    assert distance(again[1], alpha) <= 4.0 * EPS * condition**2 * rates


@pytest.mark.thorough
@given(masses, sides, any_quaternion, any_vector, any_vector, any_vector, any_vector)
def test_loads_of_the_accelerations_that_loads_give_are_those_loads_about_o(mass, box, q, r_oc, omega, force, torque_o):
    """M_o keeps M_c to eps of m r^2 only: what the lever takes is gone in both directions."""
    r_oc = vec3.scale(1e-3, r_oc)
    M_c, _ = body(mass, box, q)
    M_o = inertia.parallel_axis(M_c, mass, r_oc)
    a_o, alpha = newton_euler.newton_euler_o(mass, M_o, r_oc, omega, force, torque_o)
    again = newton_euler.inverse_newton_euler_o(mass, M_o, r_oc, omega, a_o, alpha)
    r, rates = vec3.norm(r_oc), vec3.norm(alpha) + vec3.dot(omega, omega)
    forces = vec3.norm(force) + mass * r * rates
    torques = vec3.norm(torque_o) + np.linalg.norm(M_o, 2) * rates + r * forces
    condition = np.linalg.norm(M_o, 2) / np.linalg.norm(M_c, -2)
    assert distance(again[0], force) <= 4.0 * EPS * forces
    assert distance(again[1], torque_o) <= 4.0 * EPS * condition * torques


@pytest.mark.thorough
@given(masses, sides, any_quaternion, any_vector, any_vector, any_vector, any_vector)
def test_loads_about_o_are_those_about_c_moved_to_o(mass, box, q, r_oc, omega, a_o, alpha):
    """T_o = T_c + r_c x F, of one motion."""
    M_c, _ = body(mass, box, q)
    M_o = inertia.parallel_axis(M_c, mass, r_oc)
    a_c = kinematics.point_acceleration(a_o, omega, alpha, r_oc, ZERO, ZERO)
    force_c, torque_c = newton_euler.inverse_newton_euler_c(mass, M_c, omega, a_c, alpha)
    force_o, torque_o = newton_euler.inverse_newton_euler_o(mass, M_o, r_oc, omega, a_o, alpha)
    r, rates = vec3.norm(r_oc), vec3.norm(alpha) + vec3.dot(omega, omega)
    forces = mass * (vec3.norm(a_o) + r * rates)
    assert distance(force_o, force_c) <= 4.0 * EPS * forces
    moved = vec3.add(torque_c, vec3.cross(r_oc, force_c))
    assert distance(torque_o, moved) <= 6.0 * EPS * (np.linalg.norm(M_o, 2) * rates + r * forces)


@given(masses, sides, any_quaternion, any_vector, any_vector, any_vector)
def test_loads_about_o_at_the_centre_of_mass_are_those_about_c(mass, box, q, omega, a, alpha):
    M, _ = body(mass, box, q)
    about_c = newton_euler.inverse_newton_euler_c(mass, M, omega, a, alpha)
    assert newton_euler.inverse_newton_euler_o(mass, M, ZERO, omega, a, alpha) == about_c


def test_a_ball_on_a_string_is_held_by_the_centripetal_force():
    """Mass 2 at 3 m from o, turning at 4 rad/s about z: 2 * 3 * 16 = 96 N towards o, and no torque about o."""
    M_o = inertia.parallel_axis(inertia.sphere_inertia(2.0, 0.5), 2.0, (3.0, 0.0, 0.0))
    loads = newton_euler.inverse_newton_euler_o(2.0, M_o, (3.0, 0.0, 0.0), (0.0, 0.0, 4.0), ZERO, ZERO)
    assert loads == ((-96.0, 0.0, 0.0), ZERO)


def test_a_rate_about_no_principal_axis_needs_a_torque_to_stay():
    """Diag(1, 2, 3) at omega = (1, 1, 0): omega x (M omega) = (0, 0, 1)."""
    loads = newton_euler.inverse_newton_euler_c(1.0, inertia.diagonal((1.0, 2.0, 3.0)), (1.0, 1.0, 0.0), ZERO, ZERO)
    assert loads == (ZERO, (0.0, 0.0, 1.0))


def test_momentum_is_that_of_the_particles():
    """P = sum of m v, h_o = sum of m r x v, of particles that move as one body."""
    random = rng(108)
    for _ in range(30):
        m, r = random.uniform(0.5, 1.0, 5), random.normal(size=(5, 3))
        omega, v_c = random.normal(size=(2, 3))
        mass, r_oc, M_c = rbfmu.inertia_of_points(m, r)
        v = v_c + np.cross(omega, r - r_oc)
        p, h_o = rbfmu.linear_momentum(mass, v_c), rbfmu.angular_momentum_o(mass, M_c, r_oc, v_c, omega)
        np.testing.assert_allclose(p, m @ v, atol=20 * EPS)
        np.testing.assert_allclose(h_o, (m[:, None] * np.cross(r, v)).sum(axis=0), atol=50 * EPS)


@pytest.mark.parametrize("time", [0.0, 0.4, 3.0])
def test_torque_is_the_rate_of_the_angular_momentum(time):
    """Of a free body's exact motion under no load, with loads from differences of its momentum: none."""
    moments, q_0, omega_0 = (1.0, 2.0, 2.5), (0.5, 0.5, 0.5, 0.5), (0.3, 1.0, -0.7)
    _, omega = rbfmu.free_rotation(moments, q_0, omega_0, time)
    M = np.diag(moments)
    alpha = rbfmu.euler_equation(M, omega, ZERO)
    force, torque_c = rbfmu.inverse_newton_euler_c(2.0, M, omega, ZERO, alpha)
    assert not force.any()
    np.testing.assert_allclose(torque_c, 0.0, atol=4 * EPS)
