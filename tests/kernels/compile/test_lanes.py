"""Four numbers side by side: the bits of plain numbers, whatever the machine's vectors are."""

from typing import Any

import numpy as np
from numba import njit

from rbfmu_kernels.compile.simd import add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from rbfmu_kernels.integrators.taylor_coefficients import ROW, WORK, _inner_products, put_factors


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
    return _inner_products(s, 0, 4, k)


def test_inner_products_are_a_product_of_series_without_its_ends():
    """(x, y, z) times (y, z, x); integers, so that no order of summation matters."""
    terms = np.random.default_rng(2).integers(-99, 99, (12, 3)).astype(float)
    s = np.zeros(WORK)
    _filled(s, terms)
    for k in range(12):
        expected = [sum(terms[j, i] * terms[k - j, (i + 1) % 3] for j in range(1, k)) for i in range(3)]
        assert list(_inner(s, k)) == expected
