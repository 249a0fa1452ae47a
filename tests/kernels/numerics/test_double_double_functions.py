"""Exponential, logarithm, sine, cosine and angle in double-double arithmetic against 50 digits."""

import math

import pytest

from rbfmu_kernels.numerics.double_double_functions import angle_of, exponential, natural_logarithm, sine_and_cosine
from tests.support.references.exact import mp
from tests.support.references.hard_cases import of_all_sizes, rng

BOUND = 5e-32
"""The largest error over the size of result and argument: two units in the last place of a double-double number."""
NAN, INF = math.nan, math.inf


def value(x):
    return mp.mpf(x[0]) + mp.mpf(x[1])


def pairs(values, seed):
    """Double-double numbers that begin with these."""
    low = rng(seed).uniform(-0.5, 0.5, len(values))
    return [(float(x), float(part * math.ulp(x))) for x, part in zip(values, low, strict=True)]


def of_both_signs(seed, smallest, largest, n=150):
    """Numbers between two powers of two in size."""
    r = rng(seed)
    return of_all_sizes(r, smallest, largest, n, 2.0) * r.choice([-1.0, 1.0], n)


def test_exponential_has_30_digits_beside_those_of_its_argument():
    for x in pairs([*of_both_signs(1, -100, 0), *rng(2).uniform(-660.0, 660.0, 150), 0.0, 699.9], 3):
        truth = mp.exp(value(x))
        assert abs(value(exponential(x)) - truth) <= BOUND * truth * max(1.0, abs(x[0])), x


@pytest.mark.parametrize(("x", "power"), [(701.0, INF), (INF, INF), (-701.0, 0.0), (-INF, 0.0), (NAN, NAN)])
def test_exponential_out_of_range_is_zero_or_infinite(x, power):
    found = exponential((x, 0.0))
    assert found == pytest.approx((power, 0.0), abs=0.0, rel=0.0, nan_ok=True)


def test_logarithm_has_30_digits_beside_those_of_its_argument():
    r = rng(4)
    near_one = 1.0 + r.uniform(-1.0, 1.0, 100) * of_all_sizes(r, -14, 0, 100)
    for x in pairs([*abs(of_both_signs(5, -960, 960)), *near_one, 1.0], 6):
        truth = mp.log(value(x))
        assert abs(value(natural_logarithm(x)) - truth) <= BOUND * max(1.0, abs(truth)), x


@pytest.mark.parametrize(
    ("x", "found"), [(0.0, -INF), (INF, INF), (-1.0, NAN), (NAN, NAN), (1e300, NAN), (1e-306, NAN)]
)
def test_logarithm_out_of_range_is_infinite_or_not_a_number(x, found):
    assert natural_logarithm((x, 0.0))[0] == pytest.approx(found, abs=0.0, rel=0.0, nan_ok=True)


def test_sine_and_cosine_have_30_digits_beside_those_of_their_argument():
    for x in pairs([*of_both_signs(7, -100, 0), *rng(8).uniform(-8.0, 8.0, 200), *of_both_signs(9, 3, 20)], 10):
        angle, (s, c) = value(x), sine_and_cosine(x)
        assert abs(value(s) - mp.sin(angle)) <= BOUND * abs(x[0]), x
        assert abs(value(c) - mp.cos(angle)) <= BOUND * max(1.0, abs(x[0])), x


@pytest.mark.parametrize("x", [NAN, INF, -INF, 1e16])
def test_what_is_not_finite_or_has_no_digit_of_a_turn_left_has_no_sine(x):
    assert all(math.isnan(part[0]) for part in sine_and_cosine((x, 0.0)))


def test_angle_has_30_digits():
    r = rng(11)
    near_axes = of_all_sizes(r, -20, 20, 100)
    sines = [*r.standard_normal(200), *near_axes * r.choice([-1.0, 1.0], 100)]
    for y, x in zip(pairs(sines, 12), pairs(r.standard_normal(300), 13), strict=True):
        truth = mp.atan2(value(y), value(x))
        assert abs(value(angle_of(y, x)) - truth) <= BOUND * abs(truth), (y, x)


@pytest.mark.parametrize(
    ("y", "x", "angle"),
    [(0.0, 1.0, mp.mpf(0)), (0.0, -1.0, mp.pi), (1.0, 0.0, mp.pi / 2), (-1.0, 0.0, -mp.pi / 2), (0.0, 0.0, mp.mpf(0))],
)
def test_angle_on_the_axes_and_of_nothing(y, x, angle):
    assert abs(value(angle_of((y, 0.0), (x, 0.0))) - angle) <= BOUND * abs(angle)
