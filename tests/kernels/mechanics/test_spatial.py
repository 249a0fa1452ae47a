"""Laws of homogeneous transforms, twists, wrenches and of Newton-Euler as one system."""

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.mechanics import spatial
from tests.support.references import exact
from tests.support.references.hard_cases import random_quaternions, random_vectors, rotation_matrices
from tests.support.references.laws import Law

N = 300
R_1, R_2 = (rotation_matrices(random_quaternions(N, seed)) for seed in (101, 102))
A, B, C = (random_vectors(N, seed) for seed in (103, 104, 105))
MASSES = [abs(v[0]) for v in random_vectors(N, 106)]


def homogeneous(R, r):
    return [*([*row, x] for row, x in zip(R, r, strict=True)), [0, 0, 0, 1]]


def transforms(matrices, places):
    return [exact.rounded(homogeneous(R, r)) for R, r in zip(matrices, places, strict=True)]


def place(T):
    return [row[3] for row in T[:3]]


def rotation(T):
    return [row[:3] for row in T[:3]]


def inverse(T):
    R = exact.transpose(rotation(T))
    return homogeneous(R, exact.scaled(-1, exact.apply(R, place(T))))


def by_parts(value, truth, scale):
    """The rotation's error, and the place's by its scale."""
    rotations = exact.error([row[:3] for row in value], [row[:3] for row in truth])
    assert tuple(value[3]) == (0.0, 0.0, 0.0, 1.0)
    return max(rotations, exact.error([row[3] for row in value[:3]], place(truth), scale))


def second_half(value, truth, scale):
    assert all(v == t for v, t in zip(value[:3], truth[:3], strict=True))
    return exact.error(value[3:], truth[3:], scale)


def first_half(value, truth, scale):
    assert all(v == t for v, t in zip(value[3:], truth[3:], strict=True))
    return exact.error(value[:3], truth[:3], scale)


def inertia(m, M_c, r):
    """The blocks of the lecture's equations about o, and each one's error in its own size."""
    S = exact.skew(r)
    M_o = exact.combine((1, M_c), (-m, exact.product(S, S)))
    upper = [[*a, *(m * x for x in b)] for a, b in zip(M_o, S, strict=True)]
    lower = [[*(-m * x for x in a), *(m * x for x in b)] for a, b in zip(S, exact.IDENTITY, strict=True)]
    return upper + lower


def block_by_block(value, truth, scale):
    def part(M, i, j):
        return [row[j : j + 3] for row in M[i : i + 3]]

    return max(exact.error(part(value, *at), part(truth, *at), s) for at, s in scale.items())


def sizes_of_blocks(m, M_c, r):
    rotating, mixed = exact.norm(M_c) + m * exact.norm(r) ** 2, m * exact.norm(r)
    return {(0, 0): rotating, (0, 3): mixed, (3, 0): mixed, (3, 3): m}


def symmetric(a, b):
    """A matrix of sizes such as a and b."""
    return ((a[0] ** 2 + 1.0, b[0], b[1]), (b[0], a[1] ** 2 + 1.0, b[2]), (b[1], b[2], a[2] ** 2 + 1.0))


PAIRS = list(zip(transforms(R_1, A), transforms(R_2, B), strict=True))
SIX = [(*a, *b) for a, b in zip(A, B, strict=True)]
LAWS = [
    Law(spatial.transform_from_matrix, homogeneous, lambda: list(zip(R_1, A, strict=True)), 0.0),
    Law(spatial.transform_compose, exact.product, lambda: PAIRS, 2.0,
        lambda T, U: exact.norm(place(T)) + exact.norm(place(U)), by_parts),
    Law(spatial.transform_invert, inverse, lambda: [(T,) for T, _ in PAIRS], 1.5, lambda T: exact.norm(place(T)),
        by_parts),
    Law(spatial.transform_point, lambda T, p: exact.add(place(T), exact.apply(rotation(T), p)),
        lambda: [(T, p) for (T, _), p in zip(PAIRS, C, strict=True)], 2.0,
        lambda T, p: exact.norm(place(T)) + exact.norm(p)),
    Law(spatial.twist_at, lambda V, r: [*V[:3], *exact.add(V[3:], exact.cross(V[:3], r))],
        lambda: list(zip(SIX, C, strict=True)), 1.5,
        lambda V, r: exact.norm(V[3:]) + exact.norm(V[:3]) * exact.norm(r), second_half),
    Law(spatial.wrench_at, lambda F, r: [*exact.add(F[:3], exact.cross(F[3:], r)), *F[3:]],
        lambda: list(zip(SIX, C, strict=True)), 1.5,
        lambda F, r: exact.norm(F[:3]) + exact.norm(F[3:]) * exact.norm(r), first_half),
    Law(spatial.spatial_inertia, inertia, lambda: list(zip(MASSES, map(symmetric, A, B), C, strict=True)), 2.0,
        sizes_of_blocks, block_by_block),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def a_body():
    r = np.random.default_rng(107)
    mass, M_c, r_oc = 2.5, rbfmu.box_inertia(2.5, [0.3, 0.5, 0.8]), np.array([0.2, -0.1, 0.4])
    return mass, M_c, r_oc, *r.normal(size=(4, 3))


def test_one_system_of_six_has_the_accelerations_of_newton_euler():
    mass, M_c, r_oc, omega, force, torque_o, _ = a_body()
    M_o = rbfmu.parallel_axis(M_c, mass, r_oc)
    bias = rbfmu.inverse_newton_euler_o(mass, M_o, r_oc, omega, np.zeros(3), np.zeros(3))
    right = np.concatenate([torque_o - bias[1], force - bias[0]])
    found = np.linalg.solve(rbfmu.spatial_inertia(mass, M_c, r_oc), right)
    a_o, alpha = rbfmu.newton_euler_o(mass, M_o, r_oc, omega, force, torque_o)
    np.testing.assert_allclose(found, np.concatenate([alpha, a_o]), rtol=1e-12)


def test_inertia_times_twist_is_momentum_and_energy_at_any_point():
    mass, M_c, r_oc, omega, v_o, r_op, _ = a_body()
    twist_o = np.concatenate([omega, v_o])
    v_c = rbfmu.twist_at(twist_o, r_oc)[3:]
    momentum = rbfmu.spatial_inertia(mass, M_c, r_oc) @ twist_o
    h_o = rbfmu.angular_momentum_o(mass, M_c, r_oc, v_c, omega)
    np.testing.assert_allclose(momentum, np.concatenate([h_o, rbfmu.linear_momentum(mass, v_c)]), rtol=1e-12)
    for r in (np.zeros(3), r_op):
        twist = rbfmu.twist_at(twist_o, r)
        energy = 0.5 * twist @ rbfmu.spatial_inertia(mass, M_c, r_oc - r) @ twist
        np.testing.assert_allclose(energy, rbfmu.kinetic_energy(mass, M_c, v_c, omega), rtol=1e-12)
