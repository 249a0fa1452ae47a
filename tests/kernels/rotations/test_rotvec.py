"""Laws of rotation vectors and of axis and angle."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from rbfmu_kernels.rotations import matrix, rodrigues, rotation_vector, vec3
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
    any_quaternion,
    of_all_sizes,
    quaternions,
    random_quaternions,
    random_vectors,
    rng,
    rotation_vectors as hard_rotation_vectors,
)
from tests.support.references.laws import Law, length, norm_of_second, up_to_sign


def directions(n, seed):
    return [exact.unit(exact.exact(v)) for v in random_vectors(n, seed)]


def of_lengths(lengths, seed):
    pairs = zip(lengths, directions(len(lengths), seed), strict=True)
    return [exact.rounded(exact.scaled(mp.mpf(float(length)), d)) for length, d in pairs]


WORST_OF_A_MATRIX = (-0.007897183691774124, -5.140751063667497e-10, 1.6513726421368992e-06)  # in its angle
VECTORS = [*hard_rotation_vectors(), WORST_OF_A_MATRIX, *of_lengths(rng(51).uniform(0.0, math.pi, 150), 52)]
MATRICES = [exact.rounded(exact.matrix_from_quaternion(exact.quaternion_from_rotvec(exact.exact(u)))) for u in VECTORS]
QUATERNIONS = quaternions() + random_quaternions(150, 53)
TURNING = [q for q in QUATERNIONS if any(q[1:])]
OMEGAS = random_vectors(len(VECTORS), 54)
AXIS_AND_ANGLE = [
    (exact.rounded(k), float(a)) for k, a in zip(directions(200, 55), rng(56).uniform(-7, 7, 200), strict=True)
]


def before_rounding(R):
    """The matrices are those of known rotation vectors, rounded."""
    return exact.exact(VECTORS[MATRICES.index(exact.rounded(R))])


def length_of_vector(R):
    return exact.norm(before_rounding(R)) or 1


def axis_and_angle(u):
    return exact.unit(u), exact.norm(u)


def in_axis_and_angle(value, truth, scale):
    """Error of the axis, and relative error of the angle; at half a turn the axis has either sign."""
    return max(up_to_sign(value[0], truth[0], 1), exact.error(value[1], truth[1], truth[1]))


def quaternion_from_axis_angle(k, theta):
    return [mp.cos(theta / 2), *exact.scaled(mp.sin(theta / 2), k)]


def matrix_from_axis_angle(k, theta):
    """The lecture's cos(theta) I + sin(theta) skew(k) + (1 - cos(theta)) k k^T."""
    k = exact.unit(k)
    kk = [[x * y for y in k] for x in k]
    return exact.combine((mp.cos(theta), exact.IDENTITY), (mp.sin(theta), exact.skew(k)), (1 - mp.cos(theta), kk))


def rate_a(u, omega):
    return exact.solve(exact.left_jacobian(u), omega)


def rate_b(u, omega):
    return exact.solve(exact.transpose(exact.left_jacobian(u)), omega)


LAWS = [
    Law(rotation_vector.quaternion_from_rotvec, exact.quaternion_from_rotvec, lambda: [(u,) for u in VECTORS], 2.0),
    Law(rotation_vector.rotvec_from_quaternion, exact.rotvec_from_quaternion, lambda: [(q,) for q in QUATERNIONS], 2.5,
        lambda q: length(exact.rotvec_from_quaternion(q))),
    Law(rotation_vector.matrix_from_rotvec, lambda u: exact.matrix_from_quaternion(exact.quaternion_from_rotvec(u)),
        lambda: [(u,) for u in VECTORS], 4.0),
    Law(rotation_vector.rotvec_from_matrix, before_rounding, lambda: [(R,) for R in MATRICES], 4.0, length_of_vector,
        measure=up_to_sign),
    Law(rotation_vector.quaternion_from_axis_angle, quaternion_from_axis_angle, lambda: AXIS_AND_ANGLE, 1.0),
    Law(rotation_vector.matrix_from_axis_angle, matrix_from_axis_angle, lambda: AXIS_AND_ANGLE, 3.0),
    Law(rotation_vector.axis_angle_from_quaternion, lambda q: axis_and_angle(exact.rotvec_from_quaternion(q)),
        lambda: [(q,) for q in TURNING], 2.5, measure=in_axis_and_angle),
    Law(rotation_vector.axis_angle_from_matrix, lambda R: axis_and_angle(before_rounding(R)),
        lambda: [(R,) for R, u in zip(MATRICES, VECTORS, strict=True) if any(u)], 4.5, measure=in_axis_and_angle),
    Law(rotation_vector.rotvec_rate_a, rate_a, lambda: list(zip(VECTORS, OMEGAS, strict=True)), 4.0, norm_of_second),
    Law(rotation_vector.rotvec_rate_b, rate_b, lambda: list(zip(VECTORS, OMEGAS, strict=True)), 4.0, norm_of_second),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


@pytest.mark.parametrize(("kernel", "truth", "bound"), [
    (rotation_vector.quaternion_from_axis_angle, quaternion_from_axis_angle, 3.0),
    (rotation_vector.matrix_from_axis_angle, matrix_from_axis_angle, 5.0),
])  # fmt: skip
def test_an_axis_of_any_length_is_a_direction(kernel, truth, bound):
    sizes = of_all_sizes(rng(59), -140, 140, len(AXIS_AND_ANGLE))
    cases = [(vec3.scale(float(size), k), a) for size, (k, a) in zip(sizes, AXIS_AND_ANGLE, strict=True)]
    cases.append(((9.683108800683478e-09, -4.1481184077252e-09, 1.0000000000000004), 2.4201851487990953))
    law = Law(kernel, lambda k, a: truth(exact.unit(k), a), lambda: cases, bound)
    assert bound / 3.0 < law.worst()[0] <= bound


def test_a_unit_axis_is_taken_as_it_is():
    for k, angle in AXIS_AND_ANGLE:
        assert rotation_vector.quaternion_from_axis_angle(k, angle) == rotation_vector.quaternion_about(k, angle)


@pytest.mark.parametrize("size", [10.0, 1e3, 1e5])
def test_long_rotation_vectors_are_within_their_own_rounding(size):
    for u in of_lengths(size * rng(57).uniform(1.0, 2.0, 50), 58):
        assert (
            exact.error(rotation_vector.quaternion_from_rotvec(u), exact.quaternion_from_rotvec(exact.exact(u)), size)
            <= 1.0
        )


def test_no_rotation_has_the_x_axis():
    assert rotation_vector.axis_angle_from_quaternion((1.0, 0.0, 0.0, 0.0)) == ((1.0, 0.0, 0.0), 0.0)
    assert rotation_vector.axis_angle_from_quaternion((-1.0, 0.0, 0.0, 0.0)) == ((1.0, 0.0, 0.0), 0.0)
    assert rotation_vector.axis_angle_from_matrix(matrix.rotation_x(0.0)) == ((1.0, 0.0, 0.0), 0.0)
    assert rotation_vector.rotvec_from_quaternion((1.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert rotation_vector.quaternion_from_rotvec((0.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0)


@given(any_quaternion, st.sampled_from([1e-150, 1e-3, 1e150]))
def test_quaternions_of_any_length_have_the_same_vector(q, size):
    u, again = (rotation_vector.rotvec_from_quaternion(tuple(s * x for x in q)) for s in (1.0, size))
    assert vec3.norm(vec3.subtract(u, again)) <= 4.0 * EPS * vec3.norm(u)
    k, theta = rotation_vector.axis_angle_from_quaternion(tuple(size * x for x in q))
    assert vec3.norm(vec3.subtract(vec3.scale(theta, k), u)) <= 6.0 * EPS * vec3.norm(u)


@pytest.mark.parametrize("eta", [1e-150, 3e-151, 1e-10, 0.99, 1.0, 1e10])
@pytest.mark.parametrize("eps", [5e-324, 5.25685847e-321, 1e-310, 1e-160, 1e-150, 1e150])
def test_the_least_vector_parts_have_their_angle(eta, eps):
    """2026-12-01: if eps was subnormal, beside an eta of 1e-150, the angle had the digits of |eps| only."""
    q = (-eta, eps, -eps, 0.0)
    _, theta = rotation_vector.axis_angle_from_quaternion(q)
    truth = 2 * mp.atan2(exact.norm(exact.exact(q[1:])), mp.mpf(eta))
    assert abs(theta - truth) <= 2.5 * EPS * truth + 1e-323  # numbers are 5e-324 apart at the least


@given(any_quaternion)
def test_angle_and_axis_are_in_their_ranges(q):
    k, theta = rotation_vector.axis_angle_from_quaternion(q)
    assert 0.0 <= theta <= math.pi
    assert vec3.norm(k) == pytest.approx(1.0, rel=2.0 * EPS)


def test_the_rate_is_the_derivative():
    """exp(skew(u + t du)) moves with omega, differentiated by mpmath."""
    for u, omega in zip(VECTORS[-20:], OMEGAS[-20:], strict=True):
        R, du = exact.exact(rotation_vector.matrix_from_rotvec(u)), exact.exact(rotation_vector.rotvec_rate_a(u, omega))

        def entry(t, i, j, u=u, du=du):
            moved = exact.add(exact.exact(u), exact.scaled(t, du))
            return exact.matrix_from_quaternion(exact.quaternion_from_rotvec(moved))[i][j]

        dR = [[mp.diff(lambda t, i=i, j=j: entry(t, i, j), 0, h=1e-20) for j in range(3)] for i in range(3)]
        S = exact.product(dR, exact.transpose(R))
        assert exact.error(omega, [S[2][1], S[0][2], S[1][0]], exact.norm(exact.exact(omega))) <= 16.0


@pytest.mark.parametrize("rate", [rotation_vector.rotvec_rate_a, rotation_vector.rotvec_rate_b])
def test_near_a_full_turn_rates_grow_as_the_inverse_of_the_gap(rate):
    """The coefficient is 1 / (2 pi (2 pi - |u|)): across u, |du/dt| tends to 2 pi / gap."""
    for gap in (1e-3, 1e-6):
        size = vec3.norm(rate((2.0 * math.pi - gap, 0.0, 0.0), (0.0, 1.0, 0.0)))
        assert size == pytest.approx(2.0 * math.pi / gap, rel=2.0 * gap)


def test_rates_are_singular_at_full_turns_only():
    singular = [2.0 * math.pi, 4.0 * math.pi, 6.0 * math.pi]
    for angle in [0.0, 1e-160, 1e-8, 1.0, math.pi, *singular]:
        assert rotation_vector.rotvec_rate_is_singular((0.0, angle, 0.0)) == (angle in singular)
        assert np.isfinite(rotation_vector.rotvec_rate_a((0.0, angle, 0.0), (1.0, 2.0, 3.0))).all()


def test_scipy_agrees():
    theirs = Rotation.from_rotvec(VECTORS)
    ours = np.array([rotation_vector.matrix_from_rotvec(u) for u in VECTORS])
    assert np.abs(ours - theirs.as_matrix()).max() <= 6.0 * EPS
    random = random_quaternions(100, 59)
    back = np.array([rotation_vector.rotvec_from_quaternion(q) for q in random])
    assert np.abs(back - Rotation.from_quat(np.roll(random, -1, axis=1)).as_rotvec()).max() <= 16.0 * EPS


@pytest.mark.parametrize("q", [(np.inf, 0.1, 0.2, 0.3), (-np.inf, 0.0, 0.0, 0.0), (1.0, np.inf, 0.0, 0.0)])
def test_of_infinite_numbers_nothing_is_known(q):
    """2026-11-28: of an infinite first one "no rotation" was."""
    axis, angle = rotation_vector.axis_angle_from_quaternion(q)
    others = rotation_vector.rotvec_from_quaternion, rodrigues.mrp_from_quaternion, rodrigues.gibbs_from_quaternion
    assert np.isnan([*axis, angle]).any()
    assert np.isnan([other(q) for other in others]).any(axis=1).all()
