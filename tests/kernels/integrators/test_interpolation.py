"""Outputs between two substeps: as accurate as the substeps' ends, at any point, by the order of the formula."""

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from rbfmu.models.model_buffer import places_of
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.studies.chart.cases import CASES
from rbfmu_kernels.integrators.interpolation import keep_beginning, motion_inside, place_of
from rbfmu_kernels.integrators.substeps import Method
from rbfmu_kernels.integrators.taylor_coefficients import RATE, TURN, WORK, term
from rbfmu_kernels.mechanics.equations_of_motion import ROTATION
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from tests.support.references import reference_mp as reference

BOTH = ("quaternion", "omega_b")


def run(case, times, order, substep, asked):
    """Attitudes (n, 4) and rates (n, 3) at the times after the first, in substeps of one length."""
    plan = Plan("body under loads, by series", "Taylor", 7, tolerance=math.inf, order=order, substep=substep)
    z = filled_buffer(case.scene, plan, asked)
    initialize(case.scene, LOADED_TAYLOR, z)
    rows = np.empty((len(times), 7))
    at = places_of(LOADED_TAYLOR.BLOCKS, BOTH)
    reached = LOADED_TAYLOR.run_through(z, np.array(times), at, rows, np.empty((len(times) - 1, 8)))
    assert reached == len(times) - 1
    return rows[1:, :4], rows[1:, 4:]


def errors(case, times, order, substep):
    """Errors of attitudes, rad, and of rates, rad/s."""
    q, omega = run(case, times, order, substep, BOTH)
    truth = reference.motion(case.scene, tuple(times[1:]))
    attitudes = [reference.angle_to(row, point.R_ab) for row, point in zip(q, truth, strict=True)]
    rates = [reference.distance(row, point.omega_b) for row, point in zip(omega, truth, strict=True)]
    return np.array(attitudes), np.array(rates)


@pytest.mark.parametrize(("key", "faster"), [("c", 12.0), ("d", 0.4)])
@pytest.mark.parametrize(("order", "substep"), [(6, 0.1), (12, 0.3), (18, 0.5)])
def test_outputs_inside_substeps_are_as_accurate_as_at_their_ends(key, faster, order, substep):
    """At 13 points of each of 8 substeps, beside its end."""
    substep /= faster
    for found in errors(CASES[key], np.arange(8 * 14 + 1) * (substep / 14), order, substep):
        ends = np.maximum.accumulate(found[13::14]).repeat(14)
        assert np.all(found <= 1.1 * ends + 1e-15)
        assert found[-1] > 0.0


def test_rates_alone_follow_their_series_inside_substeps():
    times = np.arange(8 * 14 + 1) * (1.25 / 14)
    (_, beside), (_, alone) = (run(CASES["d"], times, 18, 1.25, asked) for asked in (BOTH, ("omega_b",)))
    np.testing.assert_allclose(alone, beside, rtol=0.0, atol=3.0 * np.max(errors(CASES["d"], times, 18, 1.25)[1]))


def rows_at(polynomials, t, m):
    """Taylor coefficients 0 to m at t of polynomials, (m + 1, number of polynomials)."""
    return np.array([[p.deriv(k)(t) / math.factorial(k) if k else p(t) for p in polynomials] for k in range(m + 1)])


@pytest.mark.parametrize("m", [2, 5, 9])
def test_polynomials_of_degree_2_m_and_1_are_exact_and_the_next_one_has_hermite_s_error(m):
    h, random = 0.7, np.random.default_rng(m)
    for degree in (2 * m + 1, 2 * m + 2):
        p = [Polynomial(random.normal(size=degree + 1)) for _ in range(7)]
        p[3] += 10.0  # the attitude is made of unit length
        s = np.zeros(WORK)
        for t in (0.0, h):
            for k, row in enumerate(rows_at(p, t, m)):
                s[term(RATE, k) : term(RATE, k) + 3], s[term(TURN, k) : term(TURN, k) + 4] = row[:3], row[3:]
            if t == 0.0:
                keep_beginning(s, m)
        for x in (0.0, 0.1, 0.5, 0.9, 1.0):
            one = (1.0, 0.0, 0.0, 0.0)
            q, omega = motion_inside(s, Method(ROTATION, 0, 0.0, 0.0), m, h, x, one, one)
            error = [(x * (1.0 - x) * h * h) ** (m + 1) * own.coef[-1] * (degree - 2 * m - 1) for own in p]
            expected = np.array([own(x * h) for own in p]) - (-1.0) ** (m + 1) * np.array(error)
            np.testing.assert_allclose(omega, expected[:3], rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(q, expected[3:] / np.linalg.norm(expected[3:]), rtol=0.0, atol=1e-12)


def test_points_belong_to_the_substep_that_reaches_over_them():
    time = np.array([2.0, 2.5, 3.0, 4.0])
    assert place_of(time, 1, 0.25, 0.5, False) == 0.5
    assert place_of(time, 1, 0.0, 0.5, False) == 1.0
    assert place_of(time, 2, 0.25, 0.5, False) == -1.0
    assert place_of(time, 2, 0.25, 0.5, True) == 1.0  # round-off in the last one leaves no point out
    assert place_of(time, 1, 0.6, 0.5, False) == 0.0
    assert place_of(time, 3, 1.5, 0.5, True) == -1.0  # the end of the run is that of its last substep
