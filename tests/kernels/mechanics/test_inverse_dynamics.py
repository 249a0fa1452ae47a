"""Laws of the lecture's equations read in both directions, of momentum and of energy."""

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.mechanics import inertia, newton_euler
from rbfmu_kernels.rotations import vec3
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
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


def alpha_of(M, omega, torque_c):
    return exact.solve(M, exact.add(torque_c, exact.scaled(-1, torque(M, omega, [0, 0, 0]))))


def moments(M):
    """The least and the largest singular value."""
    found = mp.svd_r(mp.matrix(M), compute_uv=False)
    return min(found), max(found)


def size_of_alpha(M, omega, torque_c):
    low, high = moments(M)
    return (exact.norm(torque_c) + high * exact.norm(omega) ** 2) / low * (high / low)


def energy(m, M, v, w):
    return [(m * mp.fdot(v, v) + mp.fdot(w, exact.apply(M, w))) / 2]


def force_and_alpha(value, truth, scale):
    """In units of what is stated of each."""
    return max(exact.error(value[0], truth[0], scale[0]), exact.error(value[1], truth[1], 7 * scale[1]))


def worst_of_two(value, truth, scale):
    """Force and torque, each by its own scale."""
    return max(exact.error(v, t, s) for v, t, s in zip(value, truth, scale, strict=True))


LAWS = [
    Law(newton_euler.angular_momentum, exact.apply, cases(BODIES, A), 1.5, lambda M, w: moments(M)[1] * exact.norm(w)),
    Law(newton_euler.kinetic_energy, energy, cases(MASSES, BODIES, A, B), 3.5,
        lambda m, M, v, w: (m * exact.norm(v) ** 2 + moments(M)[1] * exact.norm(w) ** 2) / 2,
        lambda value, truth, scale: exact.error([value], truth, scale)),
    Law(newton_euler.euler_equation, alpha_of, cases(BODIES, A, B), 7.0, size_of_alpha),
    Law(newton_euler.newton_euler_c, lambda m, M, w, F, T: [exact.scaled(1 / m, F), alpha_of(M, w, T)],
        cases(MASSES, BODIES, A, B, C), 1.0,
        lambda m, M, w, F, T: [exact.norm(F) / m, size_of_alpha(M, w, T)], force_and_alpha),
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


def test_a_ball_on_a_string_is_held_by_the_centripetal_force():
    """Mass 2 at 3 m from o, turning at 4 rad/s about z: 2 * 3 * 16 = 96 N towards o, and no torque about o."""
    M_o = inertia.parallel_axis(inertia.sphere_inertia(2.0, 0.5), 2.0, (3.0, 0.0, 0.0))
    loads = newton_euler.inverse_newton_euler_o(2.0, M_o, (3.0, 0.0, 0.0), (0.0, 0.0, 4.0), ZERO, ZERO)
    assert loads == ((-96.0, 0.0, 0.0), ZERO)


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
