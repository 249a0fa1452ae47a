"""Values, first roots and least values of polynomials near zero, against their factors and NumPy's."""

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from rbfmu_kernels.integrators.polynomials import (
    TOUCHING,
    begins_at_zero,
    bound_of,
    first_root,
    first_touch,
    known_until,
    polynomial,
    slope_of,
)
from tests.support.references.hard_cases import rng

START, ROW = 2, 3


def arguments(p):
    """A polynomial's coefficients as they stand in a buffer among other numbers: (buffer, start, row, degree)."""
    n = p.degree()
    z = np.full(START + ROW * (n + 1), np.nan)
    z[START::ROW][: n + 1] = p.coef
    return z, START, ROW, n


def from_roots(*roots, factor=1.0):
    return factor * Polynomial.fromroots(roots)


@pytest.mark.parametrize("degree", [1, 2, 7])
def test_value_and_slope_are_those_of_the_polynomial(degree):
    p = Polynomial(rng(1).standard_normal(degree + 1))
    for t in (0.0, 0.3, -1.7):
        assert polynomial(*arguments(p), t) == pytest.approx(p(t), rel=1e-14)
        assert slope_of(*arguments(p), t) == pytest.approx(p.deriv()(t), rel=1e-14)


def test_bounds_are_met_where_no_coefficient_takes_from_another():
    p = Polynomial([0.5, 2.0, 0.25, 3.0])
    for signs in ([1, 1, 1, 1], [-1, 1, -1, 1]):
        size, slope = bound_of(*arguments(Polynomial(p.coef * signs)), 0.7)
        assert (size, slope) == pytest.approx((p(0.7), p.deriv()(0.7)), rel=1e-15)


@pytest.mark.parametrize(
    ("coefficients", "begins"),
    [([0.0, 1.0], True), ([0.0, 0.0, -1e-300], True), ([0.0, -1.0, 1.0], True), ([1e-300, 1.0], False),
     ([0.0, 0.0], False)],
)  # fmt: skip
def test_what_is_zero_everywhere_does_not_begin_there(coefficients, begins):
    assert begins_at_zero(*arguments(Polynomial(coefficients))) == begins


@pytest.mark.parametrize("factor", [1.0, -2.5, 1e-200])
@pytest.mark.parametrize(
    "roots",
    [(0.3,), (2.0,), (1e-7,), (0.3, 0.9), (1.5, 1.6), (-0.5, 0.7, 1.1), (0.2, 0.21, 1.9), (1.9, 2.1, 5.0)],
)
def test_the_first_root_in_reach_is_found_in_any_units(roots, factor):
    unit = abs(factor) ** 0.05
    found = (
        first_root(*arguments(from_roots(*(unit * root for root in roots), factor=factor)), 0.0, 2.0 * unit, 0.0) / unit
    )
    first = min(root for root in roots if root > 0.0)
    assert found == pytest.approx(first, rel=1e-9)
    assert found <= 2.0 * (1.0 + 1e-15)


@pytest.mark.parametrize("roots", [(1.5, 1.5 + 1e-6), (0.2, 0.20001, 1.9)])
def test_of_two_roots_that_nearly_meet_none_is_passed_over(roots):
    found = first_root(*arguments(from_roots(*roots)), 0.0, 2.0, 0.0)
    assert 0.99 * roots[0] < found <= roots[0] * (1.0 + 1e-9)


@pytest.mark.parametrize(("times", "near"), [(2, 1e-6), (3, 1e-4), (6, 0.02), (9, 0.1)])
def test_beside_a_multiple_root_the_search_ends_before_it(times, near):
    for root in rng(21).uniform(0.3, 1.8, 40):
        p, noise = from_roots(*([root] * times)), 2e-15 * 2.0**times
        p = Polynomial(np.pad(p.coef, (0, 6)))  # as that of a series, which leaves nothing out here
        found = first_root(*arguments(p), 0.0, 2.0, noise)
        assert (1.0 - near) * root < found < root
        assert abs(p(found)) <= noise * bound_of(*arguments(p), found)[0]


@pytest.mark.parametrize(
    "p",
    [Polynomial([0.0, 0.0]), Polynomial([1.0, 0.0]), from_roots(-0.1), from_roots(2.1), from_roots(-1.0, 2.0 + 1e-6),
     Polynomial([1.0, -1.0, 1.0])],
)  # fmt: skip
def test_a_root_out_of_reach_is_twice_as_far(p):
    assert first_root(*arguments(p), 0.0, 2.0, 0.0) == 4.0


@pytest.mark.parametrize("factor", [1.0, 1e-200, 1e200])
@pytest.mark.parametrize("places", [(0.3,), (1.999,), (0.4, 1.2), (-0.5, 0.8), (1e-2, 3.0)])
def test_the_first_place_where_zero_is_touched_is_found(places, factor):
    squares = from_roots(*(place for place in places for _ in range(2)), factor=factor)
    found = first_touch(*arguments(squares), 0.0, 2.0, 1.0, TOUCHING)
    assert first_touch(*arguments(-squares), 0.0, 2.0, -1.0, TOUCHING) == found
    assert found == pytest.approx(min(place for place in places if place > 0.0), abs=1e-6)


@pytest.mark.parametrize(
    "p",
    [
        Polynomial([0.0, 0.0]),
        Polynomial([1.0, 0.0]),
        from_roots(2.01, 2.01),  # further away
        from_roots(-0.01, -0.01),
        from_roots(0.7, 0.7) + 1e-6,  # passes by
        from_roots(0.0, 0.0),  # rises from zero
        Polynomial([2.0 + 1e-13, -1.0]),  # falls still where the reach ends
    ],
)
def test_where_nothing_is_touched_the_answer_is_twice_as_far(p):
    for factor in (1.0, 1e-200, 1e200):
        assert first_touch(*arguments(whole(factor * p)), 0.0, 2.0, 1.0, TOUCHING) == 4.0


def test_a_touch_comes_before_one_that_passes_by_nearer():
    """A minimum of 1e-6 at 0.5 is passed over, and the touch at 1.5 is the first."""
    p = from_roots(1.5, 1.5) * (from_roots(0.5, 0.5) + 1e-6)
    assert first_touch(*arguments(whole(p)), 0.0, 2.0, 1.0, TOUCHING) == pytest.approx(1.5, abs=1e-6)


@pytest.mark.parametrize("part", [1e-4, 1e-12])
def test_a_series_is_known_as_far_as_it_leaves_out_little(part):
    p = Polynomial([(-1) ** (k // 2) * (k % 2) / math.factorial(k) for k in range(14)])  # of sin
    far = known_until(*arguments(p), 20.0, part)
    assert abs(p(far) - math.sin(far)) <= part * math.exp(far)
    assert abs(p(4.0 * far) - math.sin(4.0 * far)) > part
    assert known_until(*arguments(p), 0.5 * far, part) == 0.5 * far
    assert known_until(*arguments(whole(p)), 20.0, part) == 20.0  # nothing is left out


def whole(p):
    """The polynomial with terms to come that are zero: it leaves nothing out."""
    return Polynomial([*p.coef, 0.0, 0.0])


@pytest.mark.parametrize("degree", [10, 14, 20])
def test_a_touch_is_one_also_where_the_terms_left_out_lift_it_off_zero(degree):
    """cos(2 t)^2 to some degree, whose least value is off zero by what is left out."""
    terms = [0.0 if k % 2 else (-1) ** (k // 2) * 4.0**k / math.factorial(k) / 2.0 for k in range(degree + 1)]
    terms[0] = 1.0
    p, reach = Polynomial(terms), {10: 0.9, 14: 1.0, 20: 1.2}[degree]
    assert abs(p(math.pi / 4.0)) > 1e-11
    assert first_touch(*arguments(p), 0.0, reach, 1.0, TOUCHING) == pytest.approx(math.pi / 4.0, abs=0.02)
    above = p + 10.0 * abs(p(reach))
    assert first_touch(*arguments(above), 0.0, reach, 1.0, TOUCHING) == 2.0 * reach
