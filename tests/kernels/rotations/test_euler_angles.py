"""Laws of Euler angles, all 24 sequences."""

import math
import warnings
from functools import cache

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

import rbfmu_kernels
from rbfmu_kernels.rotations import euler_angles as euler
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
    any_quaternion,
    euler_angles,
    quaternions,
    random_vectors,
)
from tests.support.references.laws import Law

NAME = {euler.sequence(name): name for name in euler.NAMES}
CASES = {seq: euler_angles(name) for seq, name in NAME.items()}
SEQUENCES = pytest.mark.parametrize("seq", NAME, ids=NAME.get)
OMEGAS = random_vectors(40, seed=41)


def is_proper(seq):
    return NAME[seq][0] == NAME[seq][2]


def poles(seq):
    return (0.0, math.pi) if is_proper(seq) else (-math.pi / 2, math.pi / 2)


def all_cases():
    return [(seq, angles) for seq, cases in CASES.items() for angles in cases]


def exact_matrix(seq, angles):
    return exact.matrix_from_euler(NAME[seq], exact.exact(angles))


@cache
def with_quaternions():
    """Rounded from the exact quaternions of all cases; and hard quaternions."""
    rows = []
    for seq, angles in all_cases():
        axes = exact.letters(NAME[seq])
        turns = [exact.quaternion_from_rotvec([a if i == axis else mp.zero for i in range(3)]) for axis, a in
                 zip(axes, exact.exact(angles), strict=True)]  # fmt: skip
        a, b, c = turns if NAME[seq].isupper() else turns[::-1]
        rows.append((seq, exact.rounded(exact.compose_quaternions(exact.compose_quaternions(a, b), c))))
    return rows + [(seq, q) for seq in NAME for q in quaternions()[::7]]


@cache
def with_rotations():
    return [(seq, exact.rounded(exact_matrix(seq, angles))) for seq, angles in all_cases()]


def with_omegas():
    return [(seq, a, OMEGAS[n % len(OMEGAS)]) for n, (seq, a) in enumerate(all_cases()) if determinant(seq, a) > 1e-13]


def determinant(seq, angles):
    return float(abs(mp.sin(mp.mpf(angles[1])) if is_proper(seq) else mp.cos(mp.mpf(angles[1]))))


def omega_over_determinant(seq, angles, omega):
    return exact.norm(omega) / mp.mpf(determinant(seq, angles))


def rebuilt(value, truth, scale):
    """Error of the rotation that angles stand for; the truth carries the sequence."""
    seq, matrix = truth
    return exact.error(exact_matrix(seq, value), matrix)


LAWS = [
    Law(euler.quaternion_from_euler, exact_matrix, all_cases, 2.0,
        measure=lambda q, matrix, _: exact.error(exact.matrix_from_quaternion(exact.exact(q)), matrix, 2)),
    Law(euler.matrix_from_euler, exact_matrix, all_cases, 4.0),
    Law(euler.euler_from_quaternion, lambda seq, q: (seq, exact.matrix_from_quaternion(q)), with_quaternions, 5.0,
        measure=rebuilt),
    Law(euler.euler_from_matrix, lambda seq, R: (seq, R), with_rotations, 5.0, measure=rebuilt),
    Law(euler.euler_rate_matrix_a, lambda seq, a: exact.euler_rate_matrix_a(NAME[seq], a), all_cases, 1.0),
    Law(euler.euler_rate_matrix_b, lambda seq, a: exact.euler_rate_matrix_b(NAME[seq], a), all_cases, 1.0),
    Law(euler.euler_rate_a, lambda seq, a, w: exact.solve(exact.euler_rate_matrix_a(NAME[seq], a), w), with_omegas, 4.0,
        omega_over_determinant),
    Law(euler.euler_rate_b, lambda seq, a, w: exact.solve(exact.euler_rate_matrix_b(NAME[seq], a), w), with_omegas, 4.0,
        omega_over_determinant),
]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


@pytest.mark.parametrize("convert", [euler.euler_from_quaternion, euler.euler_from_matrix])
def test_middle_angle_is_within_2_eps(convert):
    """Also at the poles and 1e-15 to 1e-3 beside them."""
    inputs = with_quaternions() if convert is euler.euler_from_quaternion else with_rotations()
    for (seq, angles), (_, value) in zip(all_cases(), inputs, strict=False):
        assert abs(convert(seq, value)[1] - angles[1]) <= 2.0 * EPS, (NAME[seq], angles)


def test_middle_angle_of_a_matrix_within_3_eps_of_a_pole():
    """The pole's takes its place, and the matrix is rounded: the worst that hill climbing found is 4.1 eps."""
    q = exact.unit(exact.exact((0.6459963108286482, -0.28755654469299974, 0.6459963108286475, -0.2875565446929999)))
    R = exact.matrix_from_quaternion(q)
    truth = mp.atan2(R[0][2], mp.hypot(R[0][0], R[0][1]))
    middle = euler.euler_from_matrix(euler.XYZ, exact.rounded(R))[1]
    assert middle == math.pi / 2
    assert 4.0 < abs(middle - truth) / EPS <= 4.5


@pytest.mark.parametrize("convert", [euler.euler_from_quaternion, euler.euler_from_matrix])
def test_small_angles_keep_their_digits(convert):
    inputs = with_quaternions() if convert is euler.euler_from_quaternion else with_rotations()
    small = [(s, a, v) for (s, a), (_, v) in zip(all_cases(), inputs, strict=False) if max(map(abs, a)) < 1e-8]
    assert len(small) == 4 * 12
    for seq, angles, value in small:
        assert convert(seq, value) == pytest.approx(angles, rel=4.0 * EPS)


@SEQUENCES
def test_angles_are_in_their_ranges(seq):
    low, high = poles(seq)
    for q in quaternions():
        first, middle, third = euler.euler_from_quaternion(seq, q)
        assert -math.pi < first <= math.pi
        assert -math.pi < third <= math.pi
        assert low <= middle <= high


@SEQUENCES
def test_at_a_pole_the_third_angle_is_zero_and_nothing_warns(seq):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for pole in poles(seq):
            for first, third in [(0.3, 0.0), (-2.0, 1.1), (3.0, 3.0), (0.0, -0.7)]:
                q = euler.quaternion_from_euler(seq, (first, pole, third))
                angles = euler.euler_from_quaternion(seq, q)
                assert angles[1:] == (pole, 0.0)
                assert exact.error(exact_matrix(seq, angles), exact.matrix_from_quaternion(exact.exact(q))) <= 5.0


@pytest.mark.thorough
@given(st.sampled_from(list(NAME)), any_quaternion, st.sampled_from([1e-70, -1.0, 1e70]))
def test_quaternions_of_any_length_and_sign_have_the_same_angles(seq, q, size):
    angles, again = (euler.euler_from_quaternion(seq, tuple(s * x for x in q)) for s in (1.0, size))
    assert exact.error(euler.matrix_from_euler(seq, again), exact.exact(euler.matrix_from_euler(seq, angles))) <= 10.0


@SEQUENCES
def test_the_rate_matrix_is_the_derivative(seq):
    """dR/dangle R^T = skew(column of E_a), differentiated by mpmath."""
    angles = exact.exact((0.7, 0.5, -1.2))
    R = exact_matrix(seq, angles)
    columns = []
    for n in range(3):
        moved = [lambda x, m=m, n=n: x if m == n else angles[m] for m in range(3)]

        def entry(x, i, j, moved=moved):
            return exact_matrix(seq, [f(x) for f in moved])[i][j]

        dR = [[mp.diff(lambda x, i=i, j=j: entry(x, i, j), angles[n]) for j in range(3)] for i in range(3)]
        S = exact.product(dR, exact.transpose(R))
        columns.append([S[2][1], S[0][2], S[1][0]])
    E_a = exact.transpose(columns)
    ours = exact.rounded(angles)
    assert exact.error(euler.euler_rate_matrix_a(seq, ours), E_a) <= 1.0
    assert exact.error(euler.euler_rate_matrix_b(seq, ours), exact.product(exact.transpose(R), E_a)) <= 1.0


@SEQUENCES
def test_rates_are_singular_at_the_poles_only(seq):
    for pole in poles(seq):
        assert euler.euler_rate_is_singular(seq, (0.3, pole, 0.2))
        assert not euler.euler_rate_is_singular(seq, (0.3, pole + 8.0 * EPS, 0.2))
    assert not euler.euler_rate_is_singular(seq, (0.3, 0.7, 0.2))


@pytest.mark.parametrize("rate", [euler.euler_rate_a, euler.euler_rate_b])
def test_rates_are_not_finite_only_where_the_determinant_is_zero(rate):
    """cos(pi/2) is 6e-17 in floating point, sin(0) is 0."""
    assert np.isfinite(rate(euler.ZYX, (0.1, math.pi / 2, 0.2), (1.0, 2.0, 3.0))).all()
    assert not np.isfinite(rate(euler.ZXZ, (0.1, 0.0, 0.2), (1.0, 2.0, 3.0))).all()


def test_sequences_are_constants_of_the_package():
    for name in euler.NAMES:
        assert getattr(rbfmu_kernels, name) == euler.sequence(name)
    assert len(set(NAME)) == 24


@pytest.mark.parametrize("name", ["ZYy", "zyX", "ZZX", "", "ABC"])
def test_what_is_no_sequence_is_refused(name):
    with pytest.raises(ValueError, match="Euler sequence"):
        euler.sequence(name)


@SEQUENCES
def test_scipy_agrees(seq):
    generic = [angles for angles in CASES[seq] if determinant(seq, angles) > 1e-2]
    theirs = Rotation.from_euler(NAME[seq], generic)
    matrices = [exact.rounded(R.tolist()) for R in theirs.as_matrix()]
    assert np.abs(np.array([euler.matrix_from_euler(seq, a) for a in generic]) - theirs.as_matrix()).max() <= 8.0 * EPS
    ours = np.array([euler.euler_from_matrix(seq, R) for R in matrices])
    assert np.abs(ours - theirs.as_euler(NAME[seq])).max() <= 1e-13  # SciPy's error over sin of the middle angle
