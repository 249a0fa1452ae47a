"""Laws of Gibbs (Rodrigues) parameters and of modified ones."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

import rbfmu
from rbfmu_kernels.rotations import rodrigues, vec3
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import (
    any_quaternion,
    quaternions,
    random_quaternions,
    random_vectors,
    rotation_vectors,
)
from tests.support.references.laws import Law, length

QUATERNIONS = quaternions() + random_quaternions(150, 91)
NOT_HALF_TURNS = [q for q in QUATERNIONS if abs(q[0]) > 4.0 * EPS]
PARAMETERS = rotation_vectors() + random_vectors(200, 92)
OMEGAS = random_vectors(len(PARAMETERS), 93)
MOVING = list(zip(PARAMETERS, OMEGAS, strict=True))


def gibbs(q):
    return [x / q[0] for x in q[1:]]


def mrp(q):
    """Of the turn's angle, which is an independent way: tan(theta / 4) k."""
    u = exact.rotvec_from_quaternion(q)
    angle = exact.norm(u)
    return exact.scaled(mp.tan(angle / 4) / angle, u) if angle else u


def quaternion_from_gibbs(g):
    return exact.unit([mp.one, *g])


def quaternion_from_mrp(sigma):
    """q = (cos, k sin) of theta / 2, with theta = 4 atan |sigma|."""
    length = exact.norm(sigma)
    half = 2 * mp.atan(length)
    return [mp.cos(half), *(exact.scaled(mp.sin(half) / length, sigma) if length else sigma)]


def shadow(sigma):
    return exact.scaled(-1 / exact.norm(sigma) ** 2, sigma)


def rate_of(parameters_of, quaternion_of, turned):
    """The derivative by the chain rule of q's own rate; `turned` is the side on which omega multiplies."""

    def rate(p, omega):
        q = quaternion_of(p)
        dq = exact.scaled(mp.mpf(1) / 2, turned(q, [mp.zero, *omega]))
        return parameters_of(q, dq)

    return rate


def gibbs_of_rate(q, dq):
    return [(d * q[0] - x * dq[0]) / q[0] ** 2 for x, d in zip(q[1:], dq[1:], strict=True)]


def mrp_of_rate(q, dq):
    """Of sigma = eps / (1 + eta)."""
    return [(d * (1 + q[0]) - x * dq[0]) / (1 + q[0]) ** 2 for x, d in zip(q[1:], dq[1:], strict=True)]


def from_left(q, omega):
    return exact.compose_quaternions(omega, q)


def size_of_rate(p, omega):
    return exact.norm(omega) * (1 + exact.norm(p) ** 2)


def each(cases):
    return lambda: [(case,) for case in cases]


TURNED = [p for p in PARAMETERS if any(p)]
LAWS = [
    Law(rodrigues.gibbs_from_quaternion, gibbs, each(NOT_HALF_TURNS), 0.5, lambda q: length(gibbs(q))),
    Law(rodrigues.quaternion_from_gibbs, quaternion_from_gibbs, each(PARAMETERS), 1.8),
    Law(rodrigues.gibbs_rate_a, rate_of(gibbs_of_rate, quaternion_from_gibbs, from_left), lambda: MOVING, 1.5,
        size_of_rate),
    Law(rodrigues.gibbs_rate_b, rate_of(gibbs_of_rate, quaternion_from_gibbs, exact.compose_quaternions),
        lambda: MOVING, 1.5, size_of_rate),
    Law(rodrigues.mrp_from_quaternion, mrp, each(QUATERNIONS), 2.3, lambda q: length(mrp(q))),
    Law(rodrigues.quaternion_from_mrp, quaternion_from_mrp, each(PARAMETERS), 2.4),
    Law(rodrigues.mrp_shadow, shadow, each(TURNED), 2.5, lambda sigma: 1 / exact.norm(sigma)),
    Law(rodrigues.mrp_rate_a, rate_of(mrp_of_rate, quaternion_from_mrp, from_left), lambda: MOVING, 2.0, size_of_rate),
    Law(rodrigues.mrp_rate_b, rate_of(mrp_of_rate, quaternion_from_mrp, exact.compose_quaternions), lambda: MOVING, 2.0,
        size_of_rate),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def distance(p, q):
    return vec3.norm(vec3.subtract(p, q))


@given(any_quaternion, st.sampled_from([1.0, -1.0, 1e-150, -1e150]))
def test_quaternions_of_any_length_and_sign_have_the_same_parameters(q, size):
    scaled = tuple(size * x for x in q)
    sigma, again = rodrigues.mrp_from_quaternion(q), rodrigues.mrp_from_quaternion(scaled)
    at_half_turn = abs(q[0]) < 1e-12
    assert distance(sigma, again) <= 4.0 * EPS or at_half_turn
    assert vec3.norm(sigma) <= 1.0 + 2.0 * EPS
    if not rodrigues.gibbs_is_singular(q):
        g, again = rodrigues.gibbs_from_quaternion(q), rodrigues.gibbs_from_quaternion(scaled)
        assert distance(g, again) <= 4.0 * EPS * vec3.norm(g)


def test_at_half_a_turn_a_gibbs_vector_is_nan_and_warns():
    q = np.array([Rotation.from_rotvec([0.1 * k, math.pi, 0.0]).as_quat(scalar_first=True) for k in range(3)])
    q[0] = [math.cos(math.pi / 2), 0.0, 1.0, 0.0]  # 6e-17 of eta: half a turn, as numbers have it
    with pytest.warns(RuntimeWarning, match="gibbs_from_quaternion: some of these rotations are half a turn"):
        g = rbfmu.gibbs_from_quaternion(q)
    assert np.isnan(g).all(axis=1).tolist() == [True, False, False]
    for size in (1e-300, 1.0, 1e300):
        assert rodrigues.gibbs_is_singular((3.9 * EPS * size, 0.0, 0.0, size))
        assert not rodrigues.gibbs_is_singular((4.1 * EPS * size, 0.0, 0.0, size))


def test_no_rotation_has_no_shadow_and_half_a_turn_is_no_trouble():
    with pytest.warns(RuntimeWarning, match="mrp_shadow: some of these parameters are 0"):
        assert np.isnan(rbfmu.mrp_shadow([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])).all(axis=1).tolist() == [True, False]
    assert rodrigues.mrp_from_quaternion((0.0, 0.0, 3.0, 0.0)) == (0.0, 1.0, 0.0)
    for size in (1e-299, 1e-250, 1e-200, 1e200, 1e300):
        assert rodrigues.mrp_shadow((size, 0.0, 0.0)) == pytest.approx((-1 / size, 0.0, 0.0), rel=4.0 * EPS, abs=0.0)
    for size, singular in ((0.0, True), (0.99e-300, True), (1e-300, False)):
        assert rodrigues.mrp_is_singular((0.0, size, 0.0)) == singular
    assert np.isnan(rodrigues.mrp_from_quaternion((0.0, 0.0, 0.0, 0.0))).all()


def test_scipy_agrees():
    q = random_quaternions(100, 94)
    theirs = Rotation.from_quat(q, scalar_first=True)
    assert np.abs(rbfmu.mrp_from_quaternion(q) - theirs.as_mrp()).max() <= 4.0 * EPS
