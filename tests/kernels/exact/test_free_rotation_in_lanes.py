"""Exact torque-free motions of many bodies side by side: the bits that each has alone, and errors against mpmath."""

import warnings

import numpy as np
import pytest
from numba import config

import rbfmu
from rbfmu.arrays import bodies as array_bodies
from rbfmu_kernels import free_rotation as body_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.simd import wide_at
from rbfmu_kernels.exact import free_rotation as lanes
from tests.support.references.free_rotation_mp import angle_to, closed_form, relative_distance

pytestmark = [
    pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code"),
    pytest.mark.thorough,  # that takes longer than all else
]

EPS = 2.0**-52


@kernel
def _in_four(bodies, found, scratch):
    return lanes.in_lanes(bodies, found, wide_at(scratch, 0, 4), wide_at(scratch, 4 * lanes._ROWS, 4))


@kernel
def _in_eight(bodies, found, scratch):
    return lanes.in_lanes(bodies, found, wide_at(scratch, 0, 8), wide_at(scratch, 8 * lanes._ROWS, 8))


WAYS = {4: _in_four, 8: _in_eight}
TIMES = np.array([0.0, 0.7, -3.0, 25.0, 1e6])


def bodies(count, seed=3):
    """Moments, attitudes and rates: tumbling, near and on the separatrix, steady, symmetric, and none at all."""
    numbers = np.random.default_rng(seed)
    moments = np.array([1.0, 2.0, 2.9]) * (1.0 + 0.02 * numbers.normal(size=(count, 3)))
    omega, q = numbers.normal(size=(count, 3)), numbers.normal(size=(count, 4))
    moments = np.array([numbers.permutation(row) for row in moments])
    omega[1::9, 0] *= 1e-9
    omega[2::9] = 1.0, 1e-3, 1e-4
    moments[3::9, 1] = moments[3::9, 0]
    omega[4::9, 1] = 0.0
    moments[5::9], omega[5::9] = (1.0, 2.0, 3.0), (1.0, 0.3, 1.0 / np.sqrt(3.0))
    moments[7::27], omega[16::27] = -1.0, np.nan
    return moments, q / np.linalg.norm(q, axis=1, keepdims=True), omega


def in_lanes(way, moments, q_0, omega, t):
    q, rates = np.empty((len(moments), t.shape[1], 4)), np.empty((len(moments), t.shape[1], 3))
    found = lanes.Motions(t, q, rates)
    singular = WAYS[way](lanes.Bodies(moments, q_0, omega), found, np.zeros(16 * lanes._ROWS))
    return singular, q, rates


@pytest.mark.parametrize("way", [4, 8])
@pytest.mark.parametrize("count", [1, 11, 100])
def test_a_body_in_a_lane_has_the_bits_that_it_has_alone(way, count):
    moments, q_0, omega = bodies(count)
    _, q, rates = in_lanes(way, moments, q_0, omega, TIMES[None])
    for i in range(count):
        for k, t in enumerate(TIMES):
            attitude, rate = body_at(tuple(moments[i]), tuple(q_0[i]), tuple(omega[i]), t)
            np.testing.assert_array_equal(q[i, k], attitude)
            np.testing.assert_array_equal(rates[i, k], rate)


def test_the_bodies_are_of_all_kinds():
    moments, _, omega = bodies(100)
    found = [lanes._kind_of(tuple(m), tuple(w)) for m, w in zip(moments, omega, strict=True)]
    assert min(found.count(kind) for kind in (0.0, 3.0, -1.0)) >= 8


def test_each_body_may_have_times_of_its_own():
    moments, q_0, omega = bodies(20)
    t = np.random.default_rng(5).normal(size=(20, 3))
    _, q, rates = in_lanes(8, moments, q_0, omega, t)
    _, turned, other = in_lanes(8, moments[::-1].copy(), q_0[::-1].copy(), omega[::-1].copy(), t[::-1].copy())
    np.testing.assert_array_equal(turned[::-1], q)
    np.testing.assert_array_equal(other[::-1], rates)


@pytest.mark.parametrize("shape", [(40, 1), (5, 8, 1)])
def test_the_array_function_gives_the_same_bits_however_it_computes(shape):
    moments, q_0, omega = (a[:40] for a in bodies(60))
    moments[7::27] = 1.0, 2.0, 2.5
    numbers = [a.reshape(*shape, a.shape[-1]) for a in (moments, q_0, omega)]
    q, rates = rbfmu.free_rotation(*numbers, TIMES)
    assert array_bodies._in_lanes(*numbers, TIMES) is not None
    assert array_bodies._in_lanes(numbers[0][..., :2], *numbers[1:], TIMES) is None
    assert q.shape == (*shape[:-1], len(TIMES), 4)
    for k, t in enumerate(TIMES):
        attitude, rate = rbfmu.free_rotation(moments, q_0, omega, t)
        np.testing.assert_array_equal(q.reshape(40, -1, 4)[:, k], attitude)
        np.testing.assert_array_equal(rates.reshape(40, -1, 3)[:, k], rate)


def test_moments_of_no_body_are_told_of_once():
    moments, q_0, omega = bodies(30)
    with pytest.warns(RuntimeWarning, match="of no body"):
        rbfmu.free_rotation(moments[:, None], q_0[:, None], omega[:, None], TIMES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbfmu.free_rotation(abs(moments[8:16, None]), q_0[8:16, None], omega[8:16, None], TIMES)


def test_errors_are_at_most_4_eps():
    numbers = np.random.default_rng(11)
    moments = np.array([1.0, 2.0, 2.9]) * (1.0 + 0.01 * numbers.normal(size=(12, 3)))
    omega, t = numbers.normal(size=(12, 3)), numbers.uniform(0.0, 100.0, size=(12, 2))
    q_0 = np.tile([0.5, 0.5, 0.5, 0.5], (12, 1))
    _, q, rates = in_lanes(4, moments, q_0, omega, t)
    for i in range(12):
        for k in range(2):
            q_true, omega_true = closed_form(tuple(moments[i]), tuple(q_0[i]), tuple(omega[i]), t[i, k])
            assert angle_to(tuple(q[i, k]), q_true) <= 4.0 * EPS
            assert relative_distance(tuple(rates[i, k]), omega_true) <= 4.0 * EPS
