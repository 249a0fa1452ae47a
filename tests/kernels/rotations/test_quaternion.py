"""Laws of Euler parameters."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation, Slerp

from rbfmu_kernels.rotations import matrix, quaternion, vec3
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
    any_quaternion,
    any_vector,
    of_all_sizes,
    quaternions,
    random_quaternions,
    random_vectors,
    rng,
)
from tests.support.references.laws import Law

QUATERNIONS = quaternions() + random_quaternions(150)
OTHERS = random_quaternions(len(QUATERNIONS), seed=31)
VECTORS = random_vectors(len(QUATERNIONS), seed=32)
PAIRS = list(zip(QUATERNIONS, OTHERS, strict=True))
WITH_VECTORS = list(zip(QUATERNIONS, VECTORS, strict=True))
APART = [1e-15, 1e-12, 1e-8, 1e-3, 0.5, 2.0, 3.0, math.pi - 1e-9]


def conjugate(q):
    return [q[0], -q[1], -q[2], -q[3]]


def half_of(omega):
    return [mp.zero, *(x / 2 for x in omega)]


def norm_of_second(_, v):
    return exact.norm(v)


def apart():
    """Pairs a known rotation angle apart, the second with either sign."""
    axes = [exact.unit(exact.exact(v)) for v in random_vectors(len(APART) * 12, seed=33)]
    pairs = []
    for n, (axis, q) in enumerate(zip(axes, OTHERS, strict=False)):
        turn = exact.quaternion_from_rotvec(exact.scaled(mp.mpf(APART[n % len(APART)]), axis))
        other = exact.compose_quaternions(exact.unit(exact.exact(q)), turn)
        pairs.append((q, exact.rounded(exact.scaled((-1) ** (n // len(APART)), other))))
    return pairs


def scaled():
    """All sizes that a float can have."""
    sizes = of_all_sizes(rng(34), -307, 307, len(QUATERNIONS)).tolist()
    return [(tuple(s * x for x in q),) for s, q in zip(sizes, QUATERNIONS, strict=True)]


ALONG = (0.0, 0.2, 0.5, 0.8, 1.0)
LAWS = [
    Law(quaternion.compose_quaternions, exact.compose_quaternions, lambda: PAIRS, 2.0),
    Law(quaternion.invert_quaternion, conjugate, lambda: [(q,) for q in QUATERNIONS], 0.0),
    Law(quaternion.normalize, exact.unit, scaled, 1.8),
    Law(quaternion.rotate, lambda q, v: exact.apply(exact.matrix_from_quaternion(q), v), lambda: WITH_VECTORS, 5.0,
        norm_of_second),
    Law(quaternion.slerp, exact.slerp, lambda: [(*pair, s) for pair in apart() for s in ALONG], 5.0),
    Law(quaternion.angle_between, exact.angle_between, lambda: [pair for pair in apart() if far_enough(*pair)], 3.5,
        exact.angle_between),
    Law(quaternion.quaternion_rate_a, lambda q, w: exact.compose_quaternions(half_of(w), q), lambda: WITH_VECTORS, 0.75,
        norm_of_second),
    Law(quaternion.quaternion_rate_b, lambda q, w: exact.compose_quaternions(q, half_of(w)), lambda: WITH_VECTORS, 0.75,
        norm_of_second),
    Law(quaternion.omega_a_from_quaternion_rate,
        lambda q, dq: exact.scaled(2, exact.compose_quaternions(dq, conjugate(q))[1:]), lambda: PAIRS, 3.0),
    Law(quaternion.omega_b_from_quaternion_rate,
        lambda q, dq: exact.scaled(2, exact.compose_quaternions(conjugate(q), dq)[1:]), lambda: PAIRS, 3.0),
]  # fmt: skip


def far_enough(q0, q1):
    """From 1e-7 on the lengths' own rounding (1 eps) does not show in the angle."""
    return exact.angle_between(exact.exact(q0), exact.exact(q1)) > 1e-7


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def test_zero_has_no_direction():
    assert np.isnan(quaternion.normalize((0.0, 0.0, 0.0, 0.0))).all()
    assert np.isnan(quaternion.rotate((0.0, 0.0, 0.0, 0.0), (1.0, 2.0, 3.0))).all()


def test_nothing_is_rotated_by_a_length_beyond_the_range():
    """It came to (0, 0, 0)."""
    for size in (1e155, 1e200, 1e308):
        assert np.isnan(quaternion.rotate((0.6 * size, 0.0, 0.8 * size, 0.0), (1.0, 2.0, 3.0))).all()


@given(any_quaternion, any_quaternion)
def test_quaternions_compose_and_invert_as_a_group(q, p):
    qp = quaternion.compose_quaternions(q, p)
    back = quaternion.compose_quaternions(quaternion.invert_quaternion(q), qp)
    assert exact.error(back, exact.exact(p)) <= 4.0  # 2 eps in |q|^2, 1 eps a product


@given(any_quaternion, any_quaternion)
def test_composition_is_that_of_matrices(q, p):
    composed = matrix.matrix_from_quaternion(quaternion.compose_quaternions(q, p))
    product = matrix.compose_matrices(matrix.matrix_from_quaternion(q), matrix.matrix_from_quaternion(p))
    assert exact.error(composed, exact.exact(product)) <= 12.0


@given(any_quaternion, any_vector)
def test_rotation_preserves_length(q, v):
    assert vec3.norm(quaternion.rotate(q, v)) == pytest.approx(vec3.norm(v), rel=8.0 * EPS)


@given(any_quaternion, any_vector)
def test_rotating_back_restores_the_vector(q, v):
    back = quaternion.rotate(quaternion.invert_quaternion(q), quaternion.rotate(q, v))
    assert exact.error(back, exact.exact(v), 1e-300 + vec3.norm(v)) <= 8.0


@given(any_quaternion, any_vector, st.sampled_from([1e-140, 1e-3, -1.0, 7.0, 1e140]))
def test_a_quaternion_of_any_length_is_one_rotation(q, v, size):
    scaled_q = tuple(size * x for x in q)
    difference = vec3.subtract(quaternion.rotate(scaled_q, v), quaternion.rotate(q, v))
    assert vec3.norm(difference) <= 6.0 * EPS * vec3.norm(v)


def test_vectors_turn_as_the_right_hand_rule_says():
    """q_ab of a quarter turn about z takes b's x axis to a's y axis (sign conventions, spelled out)."""
    half = math.sqrt(0.5)
    assert quaternion.rotate((half, 0.0, 0.0, half), (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=2.0 * EPS)


@given(any_quaternion, any_vector)
def test_rates_give_back_the_angular_velocity(q, omega):
    for rate, inverse in [
        (quaternion.quaternion_rate_a, quaternion.omega_a_from_quaternion_rate),
        (quaternion.quaternion_rate_b, quaternion.omega_b_from_quaternion_rate),
    ]:
        back = inverse(q, rate(q, omega))
        assert vec3.norm(vec3.subtract(back, omega)) <= 8.0 * EPS * vec3.norm(omega)


@given(any_quaternion, any_vector)
def test_rates_in_both_frames_are_one(q, omega_b):
    omega_a = quaternion.rotate(q, omega_b)
    rate_a, rate_b = quaternion.quaternion_rate_a(q, omega_a), quaternion.quaternion_rate_b(q, omega_b)
    assert exact.error(rate_a, exact.exact(rate_b), 1e-300 + vec3.norm(omega_b)) <= 8.0


def test_the_rate_is_the_derivative():
    """q(t) = q0 exp(omega_b t / 2), differentiated by mpmath."""
    for q, omega in WITH_VECTORS[::17]:
        direction, size = exact.unit(exact.exact(omega)), exact.norm(omega)

        def component(t, n, q=q, direction=direction, size=size):
            turn = exact.quaternion_from_rotvec(exact.scaled(t * size, direction))
            return exact.compose_quaternions(exact.exact(q), turn)[n]

        derivative = [mp.diff(lambda t, n=n: component(t, n), 1e-3 / size) for n in range(4)]
        now = exact.rounded([component(mp.mpf(1e-3) / size, n) for n in range(4)])
        assert exact.error(quaternion.quaternion_rate_b(now, omega), derivative, size) <= 2.0


@pytest.mark.parametrize("s", [-1.0, 2.5])
def test_slerp_extrapolates(s):
    for q0, q1 in apart():
        truth = exact.slerp(exact.exact(q0), exact.exact(q1), mp.mpf(s))
        assert exact.error(quaternion.slerp(q0, q1, s), truth) <= 2.0 * (1.0 + abs(s))


def test_slerp_extrapolates_far():
    """The worst that hill climbing found."""
    q0 = (1.0, 5.5487369227629044e-17, 3.6076737100936234e-16, -9.690847896822084e-17)
    q1 = (-1.1527375690656247e-06, -0.902458690335701, -0.37084983424584267, 0.21917735438697486)
    s = 1356261.9901124889
    truth = exact.slerp(exact.exact(q0), exact.exact(q1), mp.mpf(s))
    assert 3.0 < exact.error(quaternion.slerp(q0, q1, s), truth, 1.0 + s) <= 4.0


@given(any_quaternion, any_quaternion)
def test_slerp_ends_exactly(q, p):
    assert quaternion.slerp(q, p, 0.0) == pytest.approx(q, rel=0.0, abs=0.0)
    assert quaternion.slerp(q, p, 1.0) in (p, tuple(-x for x in p))


@given(any_quaternion, any_quaternion, st.floats(0.0, 1.0))
def test_slerp_turns_at_a_constant_rate_along_the_shorter_arc(q, p, s):
    angle = quaternion.angle_between(q, p)
    assert 0.0 <= angle <= math.pi
    assert quaternion.angle_between(q, quaternion.slerp(q, p, s)) == pytest.approx(s * angle, rel=0.0, abs=16.0 * EPS)


def test_slerp_between_half_a_turn_apart_stays_unit():
    q = quaternion.slerp((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), 0.5)
    assert q == pytest.approx((math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0), rel=2.0 * EPS)


@given(any_quaternion, any_quaternion)
def test_angle_is_symmetric_and_blind_to_signs(q, p):
    angle = quaternion.angle_between(q, p)
    assert quaternion.angle_between(p, q) == angle
    assert quaternion.angle_between(q, tuple(-x for x in p)) == angle
    assert quaternion.angle_between(q, q) == 0.0


def test_scipy_agrees():
    theirs, others = (Rotation.from_quat(np.roll(qs, -1, axis=1)) for qs in (QUATERNIONS, OTHERS))
    composed = np.array([quaternion.compose_quaternions(*pair) for pair in PAIRS])
    assert (
        np.abs(np.abs(np.sum(composed * np.roll((theirs * others).as_quat(), 1, axis=1), axis=1)) - 1.0).max()
        <= 8 * EPS
    )
    angles = np.array([quaternion.angle_between(*pair) for pair in PAIRS])
    assert np.abs(angles - (theirs.inv() * others).magnitude()).max() <= 16 * EPS
    for k in range(-20, 0):  # random pairs
        between = np.roll(Slerp([0, 1], Rotation.concatenate([theirs[k], others[k]]))(0.3).as_quat(), 1)
        assert abs(abs(np.dot(between, quaternion.slerp(*PAIRS[k], 0.3))) - 1.0) <= 8 * EPS
