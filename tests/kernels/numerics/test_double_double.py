"""Double-double arithmetic against rational numbers. u = 2^-53."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from rbfmu_kernels.numerics import double_double as dd

U = Fraction(1, 2**53)
numbers = st.floats(-1e90, 1e90).filter(lambda x: x == 0.0 or abs(x) > 1e-90)


def value(a):
    return Fraction(a[0]) + Fraction(a[1])


def random_pairs(seed, n=400):
    """Double-doubles of all signs, sizes within 2^+-30 of each other, some with a tiny or no low part."""
    rng = np.random.default_rng(seed)
    high = rng.standard_normal((n, 2)) * 2.0 ** rng.integers(-30, 31, (n, 2))
    low = high * 2.0**-54 * rng.uniform(-1.0, 1.0, (n, 2)) * rng.choice([1.0, 1.0, 1e-8, 0.0], (n, 2))
    return [tuple(zip(h.tolist(), e.tolist(), strict=True)) for h, e in zip(high, low, strict=True)]


def assert_normalised(a):
    assert a[0] + a[1] == a[0]


@settings(deadline=None)  # the first call compiles
@given(numbers, numbers)
def test_two_sum_is_exact(a, b):
    assert value(dd.two_sum(a, b)) == Fraction(a) + Fraction(b)
    larger, smaller = (a, b) if abs(a) >= abs(b) else (b, a)
    assert dd.quick_two_sum(larger, smaller) == dd.two_sum(a, b)


@settings(deadline=None)  # the first call compiles
@given(numbers, numbers)
def test_two_product_is_exact(a, b):
    assert value(dd.two_product(a, b)) == Fraction(a) * Fraction(b)


def test_two_product_is_exact_up_to_the_stated_limits():
    for a, b in [(1e298, 1.0 + 2.0**-52), (-3.3e298, 7.1e-290), (1.1e-150, 1.3e-140)]:
        assert value(dd.two_product(a, b)) == Fraction(a) * Fraction(b)


LAWS = {
    "add": (lambda a, b: a + b, lambda a, b: abs(a) + abs(b), 3.0),
    "subtract": (lambda a, b: a - b, lambda a, b: abs(a) + abs(b), 3.0),
    "multiply": (lambda a, b: a * b, lambda a, b: abs(a * b), 7.0),
    "divide": (lambda a, b: a / b, lambda a, b: abs(a / b), 15.0),
}


@pytest.mark.parametrize("name", LAWS)
def test_error_of_two_operands_is_as_stated(name):
    truth, scale, bound = LAWS[name]
    worst = 0.0
    for a, b in random_pairs(1):
        found = getattr(dd, name)(a, b)
        assert_normalised(found)
        x, y = value(a), value(b)
        worst = max(worst, float(abs(value(found) - truth(x, y)) / scale(x, y) / U**2))
    assert bound / 10.0 < worst <= bound
    assert f"{bound:g} u^2" in getattr(dd, name).__doc__


@pytest.mark.parametrize(("name", "truth", "bound"), [
    ("add_float", lambda a, b: a + b, 2.0),
    ("multiply_float", lambda a, b: a * b, 3.0),
])  # fmt: skip
def test_error_with_a_float_is_as_stated(name, truth, bound):
    worst = 0.0
    for a, (b, _) in random_pairs(2):
        found = getattr(dd, name)(a, b)
        assert_normalised(found)
        x, y = value(a), Fraction(b)
        scale = abs(x) + abs(y) if "add" in name else abs(x * y)
        worst = max(worst, float(abs(value(found) - truth(x, y)) / scale / U**2))
    assert bound / 10.0 < worst <= bound
    assert f"{bound:g} u^2" in getattr(dd, name).__doc__


def test_square_root_squares_back():
    worst = 0.0
    for a, _ in random_pairs(3):
        a = a if a[0] > 0.0 else dd.negate(a)
        root = dd.root(a)
        assert_normalised(root)
        worst = max(worst, float(abs(value(root) ** 2 / value(a) - 1) / 2 / U**2))
    assert 0.4 < worst <= 4.0


def test_square_root_of_nothing_is_nothing_and_of_nan_nan():
    assert dd.root((0.0, 0.0)) == (0.0, 0.0)
    assert dd.root((-1e-40, 0.0)) == (0.0, 0.0)
    assert math.isnan(dd.root((math.nan, 0.0))[0])


def test_pi_has_106_bits():
    digits = "3.14159265358979323846264338327950288419716939937510"
    assert abs(value(dd.PI) - Fraction(digits)) < Fraction(1, 2**107)


def test_thirty_digits_survive_a_cancellation_that_leaves_none_in_double():
    third = dd.divide((1.0, 0.0), (3.0, 0.0))
    rest = dd.add_float(dd.multiply_float(third, 3.0), -1.0)
    assert abs(rest[0]) < 4.0 * float(U**2)
    assert value(third) != Fraction(1 / 3)
