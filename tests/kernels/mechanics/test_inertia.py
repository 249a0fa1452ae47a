"""Inertia of shapes, of points, about other points and in other axes; principal axes; plausibility."""

import itertools
import math
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from numba import njit

import rbfmu
from rbfmu_kernels.mechanics import inertia, shape_inertia
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion

EPS = 2.0**-52
SCALES = (1.0, 1e-160, 1e150, 1e-20, 1e-290, 1e290)


def random_rotation(rng, angle=None):
    q = rng.normal(size=4)
    if angle is not None:
        q[1:] *= math.sin(angle / 2) / np.linalg.norm(q[1:])
        q[0] = math.cos(angle / 2)
    return matrix_from_quaternion(tuple((q / np.linalg.norm(q)).tolist()))


def exact(A):
    return [[Fraction(x) for x in row] for row in A]


def product(A, B):
    return [[sum(A[i][k] * B[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def transposed(A):
    return [list(column) for column in zip(*A, strict=True)]


def diagonal(d):
    return [[d[i] if i == j else 0 for j in range(3)] for i in range(3)]


def largest_difference(A, B):
    return max(abs(a - b) for row, other in zip(A, B, strict=True) for a, b in zip(row, other, strict=True))


def exact_trace(A):
    return sum(Fraction(A[i][i]) for i in range(3))


def tuples(A):
    return tuple(tuple(map(float, row)) for row in A)


# Second moments E[x^2], E[y^2], E[z^2] of homogeneous bodies, by integrals over the density of one coordinate.


def uniform(length):
    return mp.quad(lambda x: x * x / length, [-length / 2, length / 2]) if length else mp.mpf(0)


def half_ellipse(radius):
    return mp.quad(lambda x: x * x * 2 * mp.sqrt(radius**2 - x * x) / (mp.pi * radius**2), [-radius, 0, radius])


def parabola(radius):
    return mp.quad(lambda x: x * x * 3 * (1 - (x / radius) ** 2) / (4 * radius), [-radius, radius])


SHAPES = {
    "beam": (shape_inertia.beam_inertia, 1, lambda l: [uniform(l), mp.mpf(0), mp.mpf(0)], 2),
    "box": (shape_inertia.box_inertia, 3, lambda a, b, c: [uniform(a), uniform(b), uniform(c)], 2),
    "cylinder": (shape_inertia.cylinder_inertia, 2, lambda r, l: [half_ellipse(r), half_ellipse(r), uniform(l)], 2),
    "sphere": (shape_inertia.sphere_inertia, 1, lambda r: [parabola(r)] * 3, 2),
    "ellipsoid": (shape_inertia.ellipsoid_inertia, 3, lambda a, b, c: [parabola(a), parabola(b), parabola(c)], 2),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_inertia_of_a_shape_is_its_integral(shape):
    kernel, sizes, second_moments, eps = SHAPES[shape]
    rng = np.random.default_rng(1)
    worst = 0.0
    with mp.workdps(30):
        for _ in range(15):
            mass, *lengths = (10.0 ** rng.uniform(-2, 2, 1 + sizes)).tolist()
            x, y, z = second_moments(*map(mp.mpf, lengths))
            truth = [mass * (y + z), mass * (z + x), mass * (x + y)]
            M = kernel(mass, tuple(lengths)) if shape in ("box", "ellipsoid") else kernel(mass, *lengths)
            assert all(M[i][j] == 0.0 for i in range(3) for j in range(3) if i != j)
            worst = max(worst, *(float(abs(M[i][i] - t) / t) if t else abs(M[i][i]) for i, t in enumerate(truth)))
    assert worst <= eps * EPS


def test_a_beam_has_no_moment_about_itself():
    assert shape_inertia.beam_inertia(3.0, 2.0) == ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def test_parallel_axis_is_the_inertia_of_the_same_points_about_another():
    rng = np.random.default_rng(2)
    worst = 0
    for _ in range(100):
        mass, r, M_c = 10 ** rng.uniform(-2, 2), rng.normal(size=3) * 10 ** rng.uniform(-2, 2), rng.normal(size=(3, 3))
        M_c = M_c @ M_c.T
        m, r = float(mass), [Fraction(x) for x in r.tolist()]
        square = sum(x * x for x in r)
        truth = [
            [Fraction(M_c[i][j]) + Fraction(m) * ((i == j) * square - r[i] * r[j]) for j in range(3)] for i in range(3)
        ]
        M_o = inertia.parallel_axis(tuples(M_c), m, tuple(map(float, r)))
        worst = max(worst, largest_difference(exact(M_o), truth) / exact_trace(truth))
    assert worst <= 1 * EPS


def test_inertia_of_points_is_exact_far_from_the_origin():
    rng = np.random.default_rng(3)
    worst = [Fraction(0)] * 3
    for distance in (0.0, 1e3, 1e8):
        for n in (2, 5, 100):
            m, r = rng.uniform(0.1, 1.0, n), rng.normal(size=(n, 3)) + distance * rng.normal(size=3)
            found = rbfmu.inertia_of_points(m, r)
            truth = exact_inertia_of_points(m, r)
            errors = (
                abs(Fraction(float(found[0])) - truth[0]) / truth[0],
                max(abs(Fraction(float(a)) - b) for a, b in zip(found[1], truth[1], strict=True))
                / Fraction(np.max(np.abs(r))),
                largest_difference(exact(found[2].tolist()), truth[2]) / exact_trace(truth[2]),
            )
            worst = [max(a, b) for a, b in zip(worst, errors, strict=True)]
    assert max(worst) <= 1 * EPS


def test_errors_of_inertia_of_points_do_not_grow_with_their_number():
    """Plain sums of 10,000 terms are off by some 30 eps."""
    rng = np.random.default_rng(12)
    m, r = rng.uniform(0.1, 1.0, 10_000), rng.normal(size=(10_000, 3)) + 10.0
    mass, r_oc, M_c = inertia.inertia_of_points(m, r)
    truth = exact_inertia_of_points(m, r)
    assert abs(Fraction(mass) - truth[0]) <= EPS * truth[0]
    assert max(abs(Fraction(a) - b) for a, b in zip(r_oc, truth[1], strict=True)) <= EPS * Fraction(np.max(np.abs(r)))
    assert largest_difference(exact(M_c), truth[2]) <= EPS * exact_trace(truth[2])


def test_inertia_of_points_is_one_function_for_arrays_and_in_compiled_code():
    @njit
    def of_rows(masses, positions):
        return inertia.inertia_of_points(masses, positions)

    @njit
    def of_dumbbell(length):
        return inertia.inertia_of_points((1.0, 3.0), ((0.0, 0.0, 0.0), (length, 0.0, 0.0)))

    rng = np.random.default_rng(13)
    m, r = rng.uniform(0.1, 1.0, 7), rng.normal(size=(7, 3))
    found, arrays = of_rows(m, r), rbfmu.inertia_of_points(m, r)
    assert (found[0], np.array(found[1]).tolist(), np.array(found[2]).tolist()) == tuple(a.tolist() for a in arrays)
    assert of_rows(m, np.asfortranarray(r)) == found
    assert of_dumbbell(4.0) == (4.0, (3.0, 0.0, 0.0), inertia.diagonal((0.0, 12.0, 12.0)))


def test_points_without_mass_have_no_centre():
    """Nothing raises in a kernel."""
    mass, r_oc, M_c = inertia.inertia_of_points((0.0, 0.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    assert mass == 0.0
    assert np.isnan(r_oc).all()
    assert np.isnan(M_c).all()


def exact_inertia_of_points(masses, positions):
    m, r = [Fraction(x) for x in masses.tolist()], exact(positions.tolist())
    mass = sum(m)
    c = [sum(mk * rk[i] for mk, rk in zip(m, r, strict=True)) / mass for i in range(3)]
    M = [[Fraction(0)] * 3 for _ in range(3)]
    for mk, rk in zip(m, r, strict=True):
        d = [a - b for a, b in zip(rk, c, strict=True)]
        for i in range(3):
            for j in range(3):
                M[i][j] += mk * ((i == j) * sum(x * x for x in d) - d[i] * d[j])
    return mass, c, M


def test_a_light_point_far_from_a_heavy_cloud_does_no_harm():
    """The first point is no good origin here: its mass is 1e-20."""
    m, r = (
        np.array([1e-20, 1.0, 2.0, 1.5]),
        np.array([[1e6, 2e6, -1e6], [0.0, 1.0, 0.2], [1.0, 0.3, 0.0], [-0.7, 0.0, 0.9]]),
    )
    _, _, M = rbfmu.inertia_of_points(m, r)
    truth = exact_inertia_of_points(m, r)[2]
    assert largest_difference(exact(M.tolist()), truth) / exact_trace(truth) <= 2 * EPS


def test_inertia_of_points_agrees_with_a_box_of_eight_corners():
    """Points at +-s / sqrt(12) have the second moments of a box with sides s."""
    sides = np.array([0.2, 0.1, 0.5])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    mass, r_oc, M_c = rbfmu.inertia_of_points(np.full(8, 0.25), signs * sides / math.sqrt(12.0))
    assert mass == 2.0
    np.testing.assert_allclose(r_oc, 0.0, atol=EPS)
    np.testing.assert_allclose(M_c, rbfmu.box_inertia(2.0, sides), atol=2 * EPS * 2.0 * float(sides @ sides))


def test_inertia_of_points_broadcasts_and_keeps_to_one_cloud_at_a_time():
    rng = np.random.default_rng(4)
    m, r = rng.uniform(0.1, 1.0, (2, 1, 6)), rng.normal(size=(3, 6, 3))
    mass, r_oc, M_c = rbfmu.inertia_of_points(m, r)
    assert (mass.shape, r_oc.shape, M_c.shape) == ((2, 3), (2, 3, 3), (2, 3, 3, 3))
    one = rbfmu.inertia_of_points(m[1, 0], r[2])
    for many, single in zip((mass, r_oc, M_c), one, strict=True):
        np.testing.assert_array_equal(many[1, 2], single)


@pytest.mark.parametrize(
    ("masses", "positions", "message"),
    [
        ([1.0, 2.0], [[0, 0, 0]], r"masses must have trailing shape \(1,\), got \(2,\)"),
        (1.0, [[0, 0, 0]], r"masses must have trailing shape \(1,\), got \(\)"),
        ([1.0], [0, 0, 0], r"positions must have trailing shape \(n, 3\), got \(3,\)"),
        ([1.0], [[0, 0]], r"positions must have trailing shape \(n, 3\), got \(1, 2\)"),
        (["x"], [[0, 0, 0]], "masses must be numbers"),
        ([0.0, 0.0], [[0, 0, 0], [1, 1, 1]], "masses must have a sum above 0"),
        (np.zeros(0), np.zeros((0, 3)), "masses must have a sum above 0"),
    ],
)
def test_inertia_of_points_names_a_wrong_argument(masses, positions, message):
    with pytest.raises(ValueError, match=message):
        rbfmu.inertia_of_points(masses, positions)


def test_rotate_inertia_is_the_matrix_product_and_symmetric_to_the_bit():
    rng = np.random.default_rng(5)
    worst = 0
    for _ in range(200):
        A = rng.normal(size=(3, 3))
        M = (A @ A.T).tolist()
        M = tuples([[M[min(i, j)][max(i, j)] for j in range(3)] for i in range(3)])
        R = random_rotation(rng)
        found = inertia.rotate_inertia(R, M)
        assert found == tuples(transposed(found))
        truth = product(product(exact(R), exact(M)), transposed(exact(R)))
        worst = max(worst, largest_difference(exact(found), truth) / exact_trace(M))
    assert worst <= 2 * EPS


def test_rotate_inertia_keeps_the_moments():
    rng = np.random.default_rng(6)
    for _ in range(100):
        a, b = rng.uniform(0.1, 1.0, 2)
        moments = sorted([float(a), float(b), float(rng.uniform(abs(a - b), a + b))])
        found, _ = inertia.principal_axes(
            inertia.rotate_inertia(random_rotation(rng), inertia.diagonal(tuple(moments)))
        )
        np.testing.assert_allclose(found, moments, atol=6 * EPS * sum(moments))


HARD_MOMENTS = {
    "generic": (0.3, 0.7, 0.8),
    "sphere": (1.0, 1.0, 1.0),
    "disc": (0.5, 0.5, 1.0),
    "rod": (0.01, 1.0, 1.0),
    "beam": (0.0, 1.0, 1.0),
    "1:1:1e-6": (1e-6, 1.0, 1.0),
    "1:1:1e-10": (1e-10, 1.0, 1.0),
    "equal to 1e-13": (1.0, 1.0 + 1e-13, 1.0 + 2e-13),
    "two equal to 1e-9": (1.0, 1.0 + 1e-9, 1.3),
    "plate": (0.3, 0.4, 0.7),
}
HARD_ANGLES = (None, None, None, None, 1e-2, 1e-8, 1e-16, 1e-160)


def hard_matrices(name):
    """The moments in random axes and a little off the coordinate axes, at several scales."""
    rng = np.random.default_rng(7)
    for scale in SCALES:
        for angle in HARD_ANGLES:
            M = inertia.rotate_inertia(random_rotation(rng, angle), inertia.diagonal(HARD_MOMENTS[name]))
            yield inertia.scale_matrix(scale, M)


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


def test_principal_axes_take_a_denormal_off_the_diagonal():
    M = ((1.0, 5e-324, 0.0), (5e-324, 1.0, 0.0), (0.0, 0.0, 1.5))
    assert inertia.principal_axes(M) == ((1.0, 1.0, 1.5), inertia.diagonal((1.0, 1.0, 1.0)))


def test_principal_moments_are_those_of_mpmath():
    rng = np.random.default_rng(8)
    with mp.workdps(40):
        for _ in range(20):
            A = rng.normal(size=(3, 3))
            A = np.triu(A @ A.T)
            M = tuples(A + np.triu(A, 1).T)
            truth = sorted(mp.eigsy(mp.matrix([list(row) for row in M]), eigvals_only=True))
            found, _ = inertia.principal_axes(M)
            assert max(abs(a - b) for a, b in zip(found, truth, strict=True)) <= 2 * EPS * inertia.trace(M)


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


def exact_inverse(M):
    pairs = ((1, 2), (2, 0), (0, 1))
    minors = [[M[j][k] * M[l][m] - M[j][m] * M[l][k] for k, m in pairs] for j, l in pairs]
    det = sum(a * b for a, b in zip(M[0], minors[0], strict=True))
    return [[minors[j][i] / det for j in range(3)] for i in range(3)]


@pytest.mark.parametrize("scale", SCALES)
def test_inverse_inertia_of_a_diagonal_matrix_loses_three_eps_at_most(scale):
    rng = np.random.default_rng(9)
    for _ in range(50):
        d = [float(x) * scale for x in 10 ** rng.uniform(-5, 0, 3)]
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


def test_inverse_inertia_of_a_turned_beam_is_its_pseudo_inverse():
    rng = np.random.default_rng(10)
    worst = 0.0
    for _ in range(100):
        R = np.array(random_rotation(rng))
        M = inertia.rotate_inertia(tuples(R), shape_inertia.beam_inertia(2.0, 3.0))
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
        M = inertia.rotate_inertia(random_rotation(rng), shape_inertia.beam_inertia(scale, 3.0))
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


@pytest.mark.parametrize(
    ("M", "message"),
    [
        (np.full((3, 3), np.nan), "M is not finite"),
        ([[1, 2, 3]] * 3, "M is not symmetric"),
        (np.diag([-1, 1, 1]), "M has a negative principal moment: -1, 1, 1 kg m2"),
        (np.diag([1, 3, 1]), r"M breaks the triangle inequality: 3 kg m2 is above 1 \+ 1"),
        ([[np.eye(3)], [np.diag([1, 3, 1])]], r"M\[1, 0\] breaks the triangle inequality"),
        (np.eye(2), r"M must have trailing shape \(3, 3\), got \(2, 2\)"),
        ("brick", "M must be numbers, got 'brick'"),
    ],
)
def test_check_inertia_says_why(M, message):
    with pytest.raises(ValueError, match=message):
        rbfmu.check_inertia(M)


def test_check_inertia_is_silent_about_good_matrices():
    assert rbfmu.check_inertia(np.eye(3)) is None
    assert rbfmu.check_inertia(np.stack([np.eye(3), np.diag([0.0, 1.0, 1.0])])) is None
