"""Laws of attitude errors."""

import numpy as np
import pytest

import rbfmu
from rbfmu_kernels.rotations import quaternion, rotation_vector, vec3
from tests.support.references import exact
from tests.support.references.exact import EPS, mp
from tests.support.references.hard_cases import quaternions, random_quaternions, random_vectors
from tests.support.references.laws import Law, up_to_sign

DESIRED = quaternions() + random_quaternions(150, 95)
ACTUAL = random_quaternions(len(DESIRED), 96)
OF_DESIRED, OF_BODY = (random_vectors(len(DESIRED), seed) for seed in (97, 98))


def error(q_ad, q_ab):
    return exact.compose_quaternions([q_ad[0], *exact.scaled(-1, q_ad[1:])], q_ab)


def rate(q_db, omega_ad_d, omega_ab_b):
    R_bd = exact.transpose(exact.matrix_from_quaternion(q_db))
    omega = exact.add(omega_ab_b, exact.scaled(-1, exact.apply(R_bd, omega_ad_d)))
    return exact.scaled(mp.mpf(1) / 2, exact.compose_quaternions(q_db, [mp.zero, *omega])), omega


LAWS = [
    Law(quaternion.attitude_error, error, lambda: list(zip(DESIRED, ACTUAL, strict=True)), 1.2, measure=up_to_sign),
    Law(quaternion.attitude_error_rate, rate, lambda: list(zip(DESIRED, OF_DESIRED, OF_BODY, strict=True)), 6.0,
        lambda q, omega_ad, omega_ab: exact.norm(omega_ad) + exact.norm(omega_ab)),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


def test_the_error_takes_the_desired_attitude_to_the_actual_one():
    """R_ad R_db = R_ab, whatever the signs, and the shorter way round."""
    for q_ad, q_ab in zip(DESIRED[:40], ACTUAL, strict=False):
        for sign in (1.0, -1.0):
            q_db = quaternion.attitude_error(q_ad, tuple(sign * x for x in q_ab))
            assert q_db[0] >= 0.0
            assert quaternion.angle_between(quaternion.compose_quaternions(q_ad, q_db), q_ab) <= 16.0 * EPS
    assert quaternion.attitude_error((1.0, 0.0, 0.0, 0.0), (-0.6, 0.8, 0.0, 0.0)) == (0.6, -0.8, 0.0, 0.0)


def turned(q, omega_b, t):
    """After a time at a rate that stays in body axes."""
    return quaternion.compose_quaternions(q, rotation_vector.quaternion_from_rotvec(vec3.scale(t, omega_b)))


def test_the_rate_is_that_of_the_error_of_two_moving_frames():
    h = 1e-5
    omega_ad_d, omega_ab_b = (0.3, -0.7, 0.2), (-0.1, 0.4, 1.1)
    q_ad, q_ab = (0.8, 0.6, 0.0, 0.0), (0.6, 0.0, -0.48, 0.64)
    before, now, after = (
        np.array(quaternion.attitude_error(turned(q_ad, omega_ad_d, t), turned(q_ab, omega_ab_b, t)))
        for t in (-h, 0.0, h)
    )
    dq, omega_db_b = rbfmu.attitude_error_rate(now, omega_ad_d, omega_ab_b)
    np.testing.assert_allclose(dq, (after - before) / (2.0 * h), atol=1e-9)
    np.testing.assert_allclose(rbfmu.quaternion_rate_b(now, omega_db_b), dq, atol=1e-15)
