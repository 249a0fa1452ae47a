"""Portable sine, cosine, arctangent, exponential, logarithm and powers of two against 50 digits."""

import math
from itertools import product

import numpy as np
import pytest

from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.numerics.elementary import (
    atan2,
    exp2,
    exponential,
    logarithm,
    logistic,
    power_of_two_for,
    relaxation,
    round_to_integer,
    scale_for_squares,
    sincos,
    sincos_half_turns,
)
from rbfmu_kernels.rotations.vec3 import norm
from tests.support.references import exact
from tests.support.references.exact import mp
from tests.support.references.hard_cases import of_all_sizes, rng
from tests.support.references.laws import Law


def ulps(value, truth, scale):
    """Largest error in units in the last place of the truth."""
    pairs = zip(exact.flat(value), exact.flat(truth), strict=True)
    return max(float(abs(mp.mpf(v) - t) / mp.mpf(math.ulp(float(t)))) for v, t in pairs)


def nearest_to_multiples_of_quarter_turns(n):
    """The n doubles up to 2e5 whose sine or cosine is smallest: the worst of range reduction."""
    quarter = mp.pi / 2
    distances = {k: abs(mp.mpf(float(k * quarter)) - k * quarter) for k in range(1, 127_000, 7)}
    return [float(k * quarter) for k in sorted(distances, key=distances.__getitem__)[:n]]


def angles_to_2e5():
    r = rng(11)
    values = [*r.uniform(-4, 4, 1000), *r.uniform(-2e5, 2e5, 1000), *of_all_sizes(r, -1000, 17, 300, 2.0)]
    return [(float(x),) for x in [*values, *nearest_to_multiples_of_quarter_turns(100)]]


def half_turns():
    """A double and what it lacks of a number."""
    r = rng(15)
    values = [
        *r.uniform(-1, 1, 500),
        *r.uniform(-1e6, 1e6, 500),
        *(0.5 * r.integers(-9, 9, 300) + 1e-9 * r.random(300)),
    ]
    return [(float(x), float(0.5 * math.ulp(x) * r.uniform(-1, 1))) for x in values]


def exponents():
    r = rng(16)
    values = [*r.uniform(-1022, 1022, 1000), *r.uniform(-1, 1, 500), 0.0, -0.5, 0.5, 1022.0, -1022.0]
    return [(float(x), float(0.5 * math.ulp(x) * r.uniform(-1, 1))) for x in values]


def powers_of_e():
    r = rng(17)
    values = [
        *r.uniform(-708, 708, 1000), *r.uniform(-1, 1, 1000), *of_all_sizes(r, -1000, 0, 100, 2.0), 0.0, 708.0, -708.0,
    ]  # fmt: skip
    return [(float(x),) for x in values]


def damped_times():
    """Most where the series ends and where the difference loses most."""
    r = rng(19)
    values = [
        *r.uniform(0, 1, 1000),
        *r.uniform(1, 4, 1000),
        *of_all_sizes(r, -15, 300, 500),
        1.0,
        math.nextafter(1, 0),
    ]
    return [(float(x),) for x in values]


def relaxation_truth(x):
    return [mp.exp(-x), -mp.expm1(-x) / x, (mp.expm1(-x) + x) / x**2]


def positive_numbers():
    """All sizes, also those with fewer digits, and many near 1, where the logarithm has a root."""
    r = rng(18)
    near_one = 1.0 + r.uniform(-1, 1, 500) * of_all_sizes(r, -15.5, -1, 500)
    values = [*of_all_sizes(r, -1074, 1024, 1000, 2.0), *r.uniform(0.5, 2, 1000), *near_one, 5e-324, 1.7e308]
    return [(float(x),) for x in values if x != 1.0]


def points():
    """All octants, all ratios, and sizes from 1e-150 to 1e150."""
    r = rng(12)
    y, x = r.standard_normal((2, 2000))
    x[1000:] *= of_all_sizes(r, -20, 20, 1000)
    size = of_all_sizes(r, -150, 150, 2000)
    return [(float(a), float(b)) for a, b in zip(size * y, size * x, strict=True)]


def vectors():
    """Of all sizes, and along each axis."""
    sizes = of_all_sizes(rng(13), -300, 300, 300)
    return [(tuple(s * x for x in v),) for s in sizes for v in ((1.0, -2.0, 0.3), *np.eye(3).tolist())]


LAWS = [
    Law(sincos, lambda x: [mp.sin(x), mp.cos(x)], angles_to_2e5, 1.0, measure=ulps),
    Law(sincos_half_turns, lambda x, y: [mp.sinpi(x + y), mp.cospi(x + y)], half_turns, 1.3, measure=ulps),
    Law(exp2, lambda x, y: mp.mpf(2) ** (x + y), exponents, 0.9, measure=ulps),
    Law(atan2, lambda y, x: mp.atan2(y, x), points, 1.7, measure=ulps),
    Law(exponential, mp.exp, powers_of_e, 1.0, measure=ulps),
    Law(relaxation, relaxation_truth, damped_times, 3.0, measure=ulps),
    Law(logistic, lambda x: 1 / (1 + mp.exp(-x)), powers_of_e, 2.0, measure=ulps),
    Law(logarithm, mp.log, positive_numbers, 1.0, measure=ulps),
    Law(norm, exact.norm, vectors, 1.3, scale=exact.norm),
]  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_error_is_as_stated(law):
    law.check()


@pytest.mark.parametrize("x", [0.0, 1e-300])
def test_relaxation_begins_with_the_rate_itself(x):
    assert relaxation(x) == (1.0, 1.0, 0.5)
    assert all(map(math.isnan, relaxation(math.nan)))


@pytest.mark.parametrize("x", [1e6, 1e9, 1e12, 4.9e14])
def test_sine_of_large_angles_is_within_their_own_rounding(x):
    for angle in x * (1.0 + rng(14).uniform(0.0, 1.0, 50)):
        assert exact.error(sincos(angle), [mp.sin(mp.mpf(angle)), mp.cos(mp.mpf(angle))], 1 + angle) <= 1.0


def test_half_turns_of_which_low_leads_out_of_the_series_range():
    case = (-204953362494408.25, -0.01559268966355717)
    truth = [mp.sinpi(mp.fsum(case)), mp.cospi(mp.fsum(case))]
    assert 2.5 < ulps(sincos_half_turns(*case), truth, 1) <= 3.0


def test_huge_angles_count_as_zero():
    assert sincos(1.1e15) == sincos(-1e300) == (0.0, 1.0)


def test_arctangent_has_the_signs_of_c():
    for y, x in product([0.0, -0.0, 1.0, -1.0], repeat=2):
        ours, libm = atan2(y, x), math.atan2(y, x)
        assert (ours, math.copysign(1.0, ours)) == (libm, math.copysign(1.0, libm)), (y, x)


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_has_no_sine(x):
    assert np.isnan(sincos(x)).all()


def test_arctangent_of_what_is_not_finite():
    assert math.isnan(atan2(math.nan, 1.0))
    assert math.isnan(atan2(1.0, math.nan))
    assert math.isnan(atan2(math.inf, math.inf))
    assert atan2(math.inf, 1.0) == math.pi / 2
    assert atan2(-1.0, -math.inf) == -math.pi


@pytest.mark.parametrize(
    ("x", "power"),
    [(0.0, 1.0), (-0.0, 1.0), (5e-324, 1.0), (708.1, math.inf), (1e300, math.inf), (math.inf, math.inf),
     (-708.1, 0.0), (-1e300, 0.0), (-math.inf, 0.0), (math.nan, math.nan)],
)  # fmt: skip
def test_exponential_ends_in_zero_and_infinity_near_where_doubles_end(x, power):
    assert exponential(x) == pytest.approx(power, abs=0.0, rel=0.0, nan_ok=True)


@pytest.mark.parametrize(
    ("x", "found"),
    [(1.0, 0.0), (0.0, -math.inf), (-0.0, -math.inf), (math.inf, math.inf), (-5e-324, math.nan), (-1.0, math.nan),
     (-math.inf, math.nan), (math.nan, math.nan)],
)  # fmt: skip
def test_logarithm_of_nothing_is_infinite_and_of_less_is_not_a_number(x, found):
    assert logarithm(x) == pytest.approx(found, abs=0.0, rel=0.0, nan_ok=True)


@pytest.mark.parametrize("largest", [5e-324, 1e-160, 1.0, 1e160, 1.7e308])
def test_scaled_numbers_can_be_squared(largest):
    s = scale_for_squares(largest)
    assert math.frexp(s)[0] == 0.5
    assert 2.0**-1000 < (s * largest) ** 2 < 2.0**1000


@pytest.mark.parametrize("x", [2.0**-1022, 1e-160, 0.3, 2.0**-64, 2.0**64, -1e300, 1.7e308])
def test_a_power_of_two_brings_numbers_near_one(x):
    power = interpreted(power_of_two_for)(x)
    assert math.frexp(power)[0] == 0.5
    assert 2.0**-64 <= abs(power * x) < 2.0**64


def test_the_power_of_two_of_what_has_no_size_is_one():
    power = interpreted(power_of_two_for)
    assert power(0.0) == power(math.nan) == 1.0
    assert power(5e-324) * 5e-324 == 2.0**-114


@pytest.mark.parametrize("x", [0.0, 0.5, -0.5, 1.5, 2.5, 0.49999999999999994, -7.3, 2.0**52 + 1.0, 1e300])
def test_integers_are_the_nearest_and_of_two_the_even_one(x):
    assert interpreted(round_to_integer)(x) == round(x)
