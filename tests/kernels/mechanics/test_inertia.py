"""Inertia about other points and in other axes, its inverse, principal axes, plausibility."""

import itertools
import math

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.compile import tiered
from rbfmu_kernels.mechanics import inertia
from tests.support.references import exact as digits
from tests.support.references.hard_cases import of_all_sizes
from tests.support.references.hard_inertia import HARD_MOMENTS, SCALES, hard_matrices, random_rotation
from tests.support.references.laws import Law
from tests.support.references.rational_matrices import (
    diagonal,
    exact,
    exact_inverse,
    exact_trace,
    largest_difference,
    product,
    transposed,
    tuples,
)

EPS = 2.0**-52


def parallel_axis(M, m, r):
    S = digits.skew(r)
    return digits.combine((1, M), (-m, digits.product(S, S)))


def random_points():
    """Inertia, mass and place of bodies of all sizes."""
    rng = np.random.default_rng(2)
    for _ in range(100):
        A, mass, size = rng.normal(size=(3, 3)), 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-2, 2)
        yield tuples(A @ A.T), mass, tuple((size * rng.normal(size=3)).tolist())


def random_turns():
    """Rotations and symmetric matrices."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        A = np.triu(rng.normal(size=(3, 3)))
        yield random_rotation(rng), tuples(A @ A.T)


LAWS = [
    Law(inertia.parallel_axis, parallel_axis, lambda: [*random_points()], 1.0,
        lambda *case: trace(parallel_axis(*case))),
    Law(inertia.rotate_inertia, lambda R, M: digits.product(digits.product(R, M), digits.transpose(R)),
        lambda: [*random_turns()], 2.2, lambda _, M: trace(M)),
]  # fmt: skip


def trace(M):
    return M[0][0] + M[1][1] + M[2][2]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def test_rotated_inertia_is_symmetric_to_the_bit():
    for case in random_turns():
        found = inertia.rotate_inertia(*case)
        assert found == tuples(transposed(found))


@pytest.mark.parametrize("name", HARD_MOMENTS)
def test_principal_axes_rebuild_the_matrix_and_are_a_rotation(name):
    for M in hard_matrices(name):
        moments, R = inertia.principal_axes(M)
        assert list(moments) == sorted(moments)
        R_exact = exact(R)
        rebuilt = product(product(R_exact, exact(diagonal(moments))), transposed(R_exact))
        assert largest_difference(rebuilt, exact(M)) <= 1.5 * EPS * exact_trace(M)
        assert largest_difference(product(transposed(R_exact), R_exact), diagonal([1, 1, 1])) <= 2 * EPS
        assert np.linalg.det(np.array(R)) > 0.99


def test_principal_axes_of_a_matrix_that_is_no_inertia_rebuild_it_to_its_largest_moment():
    """The worst that hill climbing found; its trace says nothing of its size."""
    x, y, z = 2.1339978090163543e-07, 0.13495343153842437, 0.0011758797391388594
    M = ((7.459158996101356e-09, x, y), (x, 0.0665559289837617, z), (y, z, 1.951837320094553e-06))
    moments, R = inertia.principal_axes(M)
    R_exact = exact(R)
    rebuilt = product(product(R_exact, exact(diagonal(moments))), transposed(R_exact))
    assert 2.0 < largest_difference(rebuilt, exact(M)) / (EPS * max(map(abs, moments))) <= 6.0


def test_principal_axes_take_a_denormal_off_the_diagonal():
    M = ((1.0, 5e-324, 0.0), (5e-324, 1.0, 0.0), (0.0, 0.0, 1.5))
    assert inertia.principal_axes(M) == ((1.0, 1.0, 1.5), inertia.diagonal((1.0, 1.0, 1.0)))


@pytest.mark.parametrize(
    "d", [*itertools.permutations((1.0, 2.0, 2.5)), (0.0, 0.1, 0.1), (0.1, 0.1, 0.1), (3e-170, 1e-170, 3e-170)]
)
def test_principal_axes_of_a_diagonal_matrix_are_its_own_numbers_and_a_permutation(d):
    moments, R = inertia.principal_axes(inertia.diagonal(d))
    assert moments == tuple(sorted(d))
    assert {abs(x) for row in R for x in row} == {0.0, 1.0}
    assert product(product(R, diagonal(moments)), transposed(R)) == diagonal(d)
    assert np.linalg.det(np.array(R)) == 1.0


def test_principal_axes_in_order_already_are_the_identity():
    assert inertia.principal_axes(inertia.diagonal((1.0, 2.0, 2.5)))[1] == inertia.diagonal((1.0, 1.0, 1.0))


@pytest.mark.parametrize("name", sorted(HARD_MOMENTS.keys() - {"beam"}))
def test_inverse_inertia_is_the_inverse_within_its_condition(name):
    for M in hard_matrices(name):
        found = exact(inertia.inverse_inertia(M))
        truth = exact_inverse(exact(M))
        largest = max(abs(x) for row in truth for x in row)
        condition = largest * max(abs(x) for row in exact(M) for x in row)
        assert largest_difference(found, truth) <= 2 * EPS * condition * largest


@pytest.mark.parametrize("scale", SCALES)
def test_inverse_inertia_of_a_diagonal_matrix_loses_three_eps_at_most(scale):
    rng = np.random.default_rng(9)
    for _ in range(50):
        d = [float(x) * scale for x in of_all_sizes(rng, -5, 0, 3)]
        found = inertia.inverse_inertia(inertia.diagonal(tuple(d)))
        for i in range(3):
            assert abs(found[i][i] * d[i] - 1.0) <= 2.5 * EPS
            assert all(found[i][j] == 0.0 for j in range(3) if j != i)


@pytest.mark.parametrize("exponent", range(-300, 301, 20))
def test_inverse_inertia_is_the_same_at_every_scale(exponent):
    """A power of two changes no bit of a number that is not subnormal."""
    M = inertia.rotate_inertia(random_rotation(np.random.default_rng(14)), inertia.diagonal((0.3, 0.7, 0.8)))
    power = 2.0 ** round(exponent * math.log2(10.0))
    scaled = inertia.inverse_inertia(inertia.scale_matrix(power, M))
    assert inertia.scale_matrix(power, scaled) == inertia.inverse_inertia(M)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("zero", [0, 1, 2])
def test_inverse_inertia_of_a_beam_is_exactly_zero_along_it(zero, scale):
    d = [0.3 * scale] * 3
    d[zero] = 0.0
    found = inertia.inverse_inertia(inertia.diagonal(tuple(d)))
    for i in range(3):
        assert found[i][i] == 0.0 if i == zero else abs(found[i][i] * d[i] - 1.0) <= 3 * EPS


def test_inverse_inertia_of_negative_moments_is_nan_also_in_plain_python():
    for kernel in (inertia.inverse_inertia, tiered.interpreted(inertia.inverse_inertia)):
        assert np.isnan(kernel(inertia.diagonal((-1.0, -1.0, 0.0)))).all()


def test_inverse_inertia_of_a_turned_beam_is_its_pseudo_inverse():
    rng = np.random.default_rng(10)
    worst = 0.0
    for _ in range(100):
        R = np.array(random_rotation(rng))
        M = inertia.rotate_inertia(tuples(R), inertia.beam_inertia(2.0, 3.0))
        truth = R @ np.diag([0, 1 / 1.5, 1 / 1.5]) @ R.T
        worst = max(worst, 1.5 * np.max(np.abs(np.array(inertia.inverse_inertia(M)) - truth)))
    assert worst <= 9 * EPS


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(
    ("excess", "reason"), [(0.9e-12, 0), (1.1e-12, 1)], ids=["within 1e-12 of the trace", "beyond 1e-12 of the trace"]
)
def test_check_inertia_allows_round_off_and_no_more(excess, reason, scale):
    t = 4.0  # the trace of each matrix here

    def check(rows):
        return inertia.check_inertia(tuples(np.array(rows) * scale))

    assert check([[1.5, excess * t, 0], [0, 1.5, 0], [0, 0, 1]]) == reason * inertia.NOT_SYMMETRIC
    assert check([[1.5, 0, 0], [0, 1.5, 0.3 + excess * t], [0, 0.3, 1]]) == reason * inertia.NOT_SYMMETRIC
    assert check(np.diag([-excess * t, 2, 2])) == reason * inertia.NEGATIVE
    assert check(np.diag([1, 1, 2 + excess * t])) == reason * inertia.TRIANGLE
    assert check(np.diag([2 + excess * t, 1, 1])) == reason * inertia.TRIANGLE


def test_check_inertia_allows_a_beam_and_a_particle_in_any_axes():
    rng = np.random.default_rng(11)
    for scale in SCALES:
        M = inertia.rotate_inertia(random_rotation(rng), inertia.beam_inertia(scale, 3.0))
        assert inertia.check_inertia(M) == 0.0
    assert inertia.check_inertia(inertia.diagonal((0.0, 0.0, 0.0))) == 0.0
    assert inertia.check_inertia(inertia.point_inertia(2.0, (1.0, 2.0, 3.0))) == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_check_inertia_finds_what_is_not_finite_first(bad):
    for i in range(3):
        for j in range(3):
            rows = [[1.0, 5.0, 0.0], [0.0, -9.0, 0.0], [0.0, 0.0, 1.0]]
            rows[i][j] = bad
            assert inertia.check_inertia(tuples(rows)) == inertia.NOT_FINITE


def test_check_inertia_looks_past_the_diagonal_for_negative_moments():
    assert inertia.check_inertia(((1.0, 2.0, 0.0), (2.0, 1.0, 0.0), (0.0, 0.0, 1.0))) == inertia.NEGATIVE
    assert inertia.check_inertia(inertia.diagonal((-1.0, -1.0, -1.0))) == inertia.NEGATIVE


@pytest.mark.parametrize(("M", "message"), [
    (np.full((3, 3), np.nan), "M is not finite"),
    ([[1, 2, 3]] * 3, "M is not symmetric"),
    (np.diag([-1, 1, 1]), "M has a negative principal moment: -1, 1, 1 kg m2"),
    (np.diag([1, 3, 1]), r"M breaks the triangle inequality: 3 kg m2 is above 1 \+ 1 by 1"),
    (np.diag([1, 2 + 1e-10, 1]), r"M breaks the triangle inequality: 2 kg m2 is above 1 \+ 1 by 1e-10"),
    ([[np.eye(3)], [np.diag([1, 3, 1])]], r"M\[1, 0\] breaks the triangle inequality"),
    (np.eye(2), r"M must have trailing shape \(3, 3\), got \(2, 2\)"),
    ("brick", "M must be real numbers, got 'brick'"),
])  # fmt: skip
def test_check_inertia_says_why(M, message):
    with pytest.raises(ValueError, match=message):
        rbfmu.check_inertia(M)


def test_check_inertia_is_silent_about_good_matrices():
    assert rbfmu.check_inertia(np.eye(3)) is None
    assert rbfmu.check_inertia(np.stack([np.eye(3), np.diag([0.0, 1.0, 1.0])])) is None
