"""Laws of rotation matrices."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu_kernels.rotations import matrix, vec3
from tests.support.covering import some_of
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
    quaternions,
    random_quaternions,
    random_vectors,
    rng,
    rotation_matrices,
)
from tests.support.references.laws import Law, norm_of_second, up_to_sign

QUATERNIONS = quaternions() + random_quaternions(150)
MATRICES = rotation_matrices(QUATERNIONS)
VECTORS = random_vectors(len(MATRICES))
PAIRS = list(zip(MATRICES, MATRICES[::-1], strict=True))
WITH_VECTORS = list(zip(MATRICES, VECTORS, strict=True))
ANGLES = [(float(x),) for x in [*rng(21).uniform(-1e5, 1e5, 200), *(2 * mp.pi * n for n in range(0, 15_000, 99))]]


def noisy(noise):
    r = rng(22)
    return [(exact.rounded((np.array(R) + noise * r.standard_normal((3, 3))).tolist()),) for R in MATRICES[::3]]


def vee(S):
    """v of the skew-symmetric part of S, skew(v)."""
    return [(S[2][1] - S[1][2]) / 2, (S[0][2] - S[2][0]) / 2, (S[1][0] - S[0][1]) / 2]


def product_with_skew_on_the_left(R, v):
    return exact.product(exact.skew(v), R)


def product_with_skew_on_the_right(R, v):
    return exact.product(R, exact.skew(v))


def rates(rate):
    return [(R, rate(R, v)) for R, v in WITH_VECTORS]


def quaternion_before_rounding(R):
    """The matrices are those of known quaternions, rounded."""
    return exact.unit(exact.exact(QUATERNIONS[MATRICES.index(exact.rounded(R))]))


LAWS = [
    Law(vec3.skew, exact.skew, lambda: [(v,) for v in VECTORS], 0.0),
    Law(vec3.unskew, vee, lambda: [(vec3.skew(v),) for v in VECTORS], 0.0),
    Law(matrix.rotation_x, lambda a: exact.simple_rotation(0, a), lambda: ANGLES, 0.5),
    Law(matrix.rotation_y, lambda a: exact.simple_rotation(1, a), lambda: ANGLES, 0.5),
    Law(matrix.rotation_z, lambda a: exact.simple_rotation(2, a), lambda: ANGLES, 0.5),
    Law(matrix.compose_matrices, exact.product, lambda: PAIRS, 1.5),
    Law(matrix.invert_matrix, exact.transpose, lambda: [(R,) for R in MATRICES], 0.0),
    Law(matrix.transform, exact.apply, lambda: WITH_VECTORS, 1.5, norm_of_second),
    Law(matrix.matrix_rate_a, product_with_skew_on_the_left, lambda: WITH_VECTORS, 1.0, norm_of_second),
    Law(matrix.matrix_rate_b, product_with_skew_on_the_right, lambda: WITH_VECTORS, 1.0, norm_of_second),
    Law(matrix.omega_a_from_matrix_rate, lambda R, dR: vee(exact.product(dR, exact.transpose(R))),
        lambda: rates(matrix.matrix_rate_a), 2.0, norm_of_second),
    Law(matrix.omega_b_from_matrix_rate, lambda R, dR: vee(exact.product(exact.transpose(R), dR)),
        lambda: rates(matrix.matrix_rate_b), 2.0, norm_of_second),
    Law(matrix.matrix_from_quaternion, exact.matrix_from_quaternion, lambda: [(q,) for q in QUATERNIONS], 3.5),
    Law(matrix.quaternion_from_matrix, quaternion_before_rounding, lambda: [(R,) for R in MATRICES], 1.5,
        measure=up_to_sign),
    Law(matrix.nearest_rotation, exact.polar_factor, lambda: noisy(1e-12), 3.0),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def test_quaternion_of_a_matrix_has_no_negative_eta():
    assert min(matrix.quaternion_from_matrix(R)[0] for R in MATRICES) == 0.0


@pytest.mark.parametrize("noise", some_of([1e-8, 1e-4, 1e-2, 0.1], 2))
def test_nearest_rotation_is_the_polar_factor(noise):
    law = Law(matrix.nearest_rotation, exact.polar_factor, lambda: noisy(noise), 3.0)
    assert law.worst()[0] <= law.bound


def test_nearest_rotation_of_any_matrix_has_the_largest_trace():
    """Nearest in the Frobenius norm is where tr(R^T M) is largest; against the singular value decomposition."""
    for M in rng(23).standard_normal((200, 3, 3)):
        R = np.array(matrix.nearest_rotation(exact.rounded(M.tolist())))
        U, _, V = np.linalg.svd(M)
        best = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
        assert np.sum(R * M) >= np.sum(best * M) - 8.0 * EPS * np.linalg.norm(M)
        assert abs(np.linalg.det(R) - 1.0) <= 4.0 * EPS


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e160, 1e300])
def test_nearest_rotation_of_any_size(size):
    for R in MATRICES[::10]:
        scaled = tuple(vec3.scale(size, row) for row in R)
        assert exact.error(matrix.nearest_rotation(scaled), exact.exact(matrix.nearest_rotation(R))) <= 4.0


def test_nearest_rotation_of_all_that_take_axes_to_axes():
    """Half turns such as NED to ENU have equal components of q; reflections have several nearest rotations."""
    for order, signs in itertools.product(itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)):
        M = np.diag(signs)[:, order]
        R = np.array(matrix.nearest_rotation(exact.rounded(M.tolist())))
        assert np.trace(R.T @ M) == pytest.approx(3.0 if np.linalg.det(M) > 0.0 else 1.0, abs=8.0 * EPS)
        assert np.linalg.det(R) == pytest.approx(1.0, abs=4.0 * EPS)


@pytest.mark.parametrize("second", [1e-14, 1e-13, 1e-12])
def test_nearest_rotation_of_nearly_rank_one_is_within_eps_over_the_gap(second):
    for U, V in np.linalg.qr(rng(24).standard_normal((20, 2, 3, 3)))[0]:
        R = matrix.nearest_rotation(exact.rounded((U @ np.diag([1.0, second, 0.0]) @ V).tolist()))
        best = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
        assert np.abs(R - best).max() <= 10.0 * EPS / second


@pytest.mark.parametrize("size", [1e-10, 1e-9])
def test_nearest_rotation_of_nearly_a_reflection_is_within_eps_over_the_gap(size):
    """2026-12-01: Newton's step had a determinant without digits there, and made the error up to 20 times as large."""
    random = rng(25)
    for R in MATRICES[:60]:
        M = (size * random.standard_normal((3, 3)) - R).tolist()
        U, S, V = mp.svd_r(mp.matrix(M))
        side = mp.sign(mp.det(U) * mp.det(V))
        best = (U * mp.diag([1, 1, side]) * V).tolist()
        assert exact.error(matrix.nearest_rotation(exact.rounded(M)), best) <= 10.0 * S[0] / (2 * (S[1] + side * S[2]))


def test_nearest_rotation_of_rank_one_is_one_of_many_equally_near():
    """The last step had nothing to go by there, and with these zeros it went to the rotation that is farthest."""
    M = np.zeros((3, 3))
    M[2, :2] = 0.04373891237045473, -0.08171775683669098
    assert np.sum(matrix.nearest_rotation(exact.rounded(M.tolist())) * M) == pytest.approx(np.linalg.norm(M), rel=1e-15)


def test_nearest_rotation_of_nothing_is_no_rotation():
    assert matrix.nearest_rotation(((0.0,) * 3,) * 3) == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def test_scipy_agrees():
    theirs = Rotation.from_quat(np.roll(QUATERNIONS, -1, axis=1))
    ours = np.array([matrix.matrix_from_quaternion(q) for q in QUATERNIONS])
    assert np.abs(ours - theirs.as_matrix()).max() <= 5.0 * EPS
    applied = np.array([matrix.transform(exact.rounded(R.tolist()), v) for R, v in zip(ours, VECTORS, strict=True)])
    sizes = np.linalg.norm(VECTORS, axis=1, keepdims=True)
    assert np.abs((applied - theirs.apply(VECTORS)) / sizes).max() <= 8.0 * EPS
