"""Laws of Euler parameters."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation, Slerp

from rbfmu_kernels.rotations import quaternion, vec3
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
from tests.support.references.laws import Law, norm_of_second

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


@given(any_quaternion, any_vector, st.sampled_from([1e-140, 1e-3, -1.0, 7.0, 1e140]))
def test_a_quaternion_of_any_length_is_one_rotation(q, v, size):
    scaled_q = tuple(size * x for x in q)
    difference = vec3.subtract(quaternion.rotate(scaled_q, v), quaternion.rotate(q, v))
    assert vec3.norm(difference) <= 6.0 * EPS * vec3.norm(v)


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
