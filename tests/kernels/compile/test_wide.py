"""Numbers side by side, of several bodies or four of one: each lane is plain arithmetic, none branches."""

import math
from typing import Any

import numpy as np
import pytest
from numba import config, njit
from numba.core.errors import TypingError

from rbfmu_kernels.buffer_access import put_vec3_at, vec3_at
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.compile.simd import (
    add_lanes,
    lane_at,
    lanes,
    lanes_at,
    multiply_lanes,
    numbers,
    put_lane_at,
    put_lanes,
    wide_at,
    width_of,
)
from rbfmu_kernels.compile.wide import alike, all_of, any_of, bits_of, choose, number_of
from rbfmu_kernels.integrators.taylor_coefficients import ROW, WORK, _inner_products, put_factors
from rbfmu_kernels.rotations.vec3 import add, cross

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="wide numbers are compiled code")
ROWS = 24


@kernel
def _arithmetic(s):
    total, x = (0.0, 0.0, 0.0), 0.0
    for k in range(3):
        total = add(total, cross(vec3_at(s, 0), vec3_at(s, 3)))
        x = x + 2.0 * s[k]
    put_vec3_at(s, 6, total)
    s[9] = choose(x > 1.0, x / s[1], -1.0)
    s[10] = max(abs(x), 1.0)
    s[11] = math.sqrt(math.ceil(abs(x)))
    s[12] = -x - 1
    s[13] = choose(((x >= 0.0) & (s[1] < 0.0)) | (s[2] <= 0.0), 1.0, 0.0)
    s[14] = 3.0
    four = multiply_lanes(lanes_at(s, 0), lanes(s[3], 2.0, s[5], 0.5))
    put_lanes(s, 15, add_lanes(four, lanes(1.0, 2.0, 3.0, 4.0)))
    s[19] = numbers(four)[1]
    put_lane_at(s, 20, 1, 5.0)
    s[21] = lane_at(s, 0, 2)
    return width_of(s)


@kernel
def _in_four(z):
    return _arithmetic(wide_at(z, 0, 4))


@kernel
def _in_eight(z):
    return _arithmetic(wide_at(z, 0, 8))


@pytest.mark.parametrize(("width", "run"), [(4, _in_four), (8, _in_eight)])
def test_each_lane_is_plain_arithmetic(width, run):
    z = np.random.default_rng(1).normal(size=ROWS * width)
    s = z.copy().reshape(ROWS, width)
    assert run(z) == width
    found = z.reshape(ROWS, width)
    turn = np.cross(s[:3].T, s[3:6].T).T
    np.testing.assert_array_equal(found[6:9], turn + turn + turn)
    x = 2.0 * s[0] + 2.0 * s[1] + 2.0 * s[2]
    np.testing.assert_array_equal(found[9], np.where(x > 1.0, x / s[1], -1.0))
    np.testing.assert_array_equal(found[10], np.maximum(abs(x), 1.0))
    np.testing.assert_array_equal(found[11], np.sqrt(np.ceil(abs(x))))
    np.testing.assert_array_equal(found[12], -x - 1.0)
    np.testing.assert_array_equal(found[13], ((x >= 0.0) & (s[1] < 0.0)) | (s[2] <= 0.0))
    np.testing.assert_array_equal(found[14], 3.0)
    four = np.array([s[0] * s[3], s[1] * 2.0, s[2] * s[5], s[3] * 0.5])
    np.testing.assert_array_equal(found[15:19], four + np.arange(1.0, 5.0)[:, None])
    np.testing.assert_array_equal(found[19], four[1])
    assert found[20, 1] == 5.0
    np.testing.assert_array_equal(np.delete(found[20], 1), np.delete(s[20], 1))
    np.testing.assert_array_equal(found[21], s[0, 2])


@kernel
def _bits(z):
    s = wide_at(z, 0, 4)
    x = s[0]
    s[1] = number_of(bits_of(x) ^ ((bits_of(s[1]) & 2) << 62))
    s[2] = choose((bits_of(x) + 1) & 1 != 0, math.copysign(3.0, x), alike(x, 4.0))
    s[3] = choose(alike(x, 1.0) > 0.0, 1.0, x)


def test_bits_are_those_of_each_lane():
    z = np.random.default_rng(4).normal(size=16)
    s = z.copy().reshape(4, 4)
    _bits(z)
    bits = s.view(np.int64)
    np.testing.assert_array_equal(z.reshape(4, 4)[1], (bits[0] ^ ((bits[1] & 2) << 62)).view(float))
    np.testing.assert_array_equal(z.reshape(4, 4)[2], np.where(bits[0] & 1 == 0, np.copysign(3.0, s[0]), 4.0))
    np.testing.assert_array_equal(z.reshape(4, 4)[3], 1.0)


def test_of_a_plain_number_they_are_its_own():
    assert number_of(bits_of(-2.5)) == -2.5
    assert alike(2.0, 3.0) == 3.0


@kernel
def _summaries(z, limit):
    s = wide_at(z, 0, 4)
    return any_of(s[0] > limit), all_of(s[0] > limit)


@pytest.mark.parametrize(("limit", "expected"), [(0.5, (True, True)), (1.5, (True, False)), (4.5, (False, False))])
def test_conditions_are_summed_up_over_all_lanes(limit, expected):
    assert _summaries(np.array([1.0, 2.0, 3.0, 4.0]), limit) == expected


@pytest.mark.parametrize("condition", [True, False])
def test_a_plain_condition_is_its_own_summary(condition):
    assert (any_of(condition), all_of(condition)) == (condition, condition)
    assert choose(condition, 1.0, 2.0) == (1.0 if condition else 2.0)


@kernel
def _branches(z):
    s = wide_at(z, 0, 4)
    return 1.0 if s[0] > 0.0 else 2.0


def test_numba_refuses_to_branch_on_what_may_differ_from_lane_to_lane():
    with pytest.raises(TypingError):
        _branches(np.zeros(4))


# Vectors of four


@njit
def _sum(z: Any, a: float, b: float, c: float, d: float) -> Any:
    total = lanes(a, b, c, d)
    for i in range(0, len(z) - 3, 4):
        total = add_lanes(multiply_lanes(total, lanes_at(z, i)), lanes(a, b, c, d))
    put_lanes(z, 1, total)
    return numbers(total)


def test_lanes_are_plain_arithmetic_to_the_bit():
    z = np.random.default_rng(1).normal(size=401)
    start = (0.1, -0.2, 0.3, 1e-5)
    expected = list(start)
    for i in range(0, len(z) - 3, 4):
        expected = [x * y + x_0 for x, y, x_0 in zip(expected, z[i : i + 4].tolist(), start, strict=True)]
    assert list(_sum(z, *start)) == expected
    assert z[1:5].tolist() == expected


@njit
def _filled(s: Any, terms: Any) -> None:
    for k, (a, b, c) in enumerate(terms):
        put_factors(s, ROW * k, (a, b, c))


@njit
def _inner(s: Any, k: int) -> Any:
    return _inner_products(s, 0, 0, k)


def test_inner_products_are_a_product_of_series_without_its_ends():
    """(x, y, z) times (y, z, x); integers, so that no order of summation matters."""
    terms = np.random.default_rng(2).integers(-99, 99, (12, 3)).astype(float)
    s = np.zeros(WORK)
    _filled(s, terms)
    for k in range(12):
        expected = [sum(terms[j, i] * terms[k - j, (i + 1) % 3] for j in range(1, k)) for i in range(3)]
        assert list(_inner(s, k)) == expected
