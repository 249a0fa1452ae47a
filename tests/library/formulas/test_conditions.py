"""Conditions of formulas at and beside zero: what comes there and stays, and multiple roots."""

import pytest

import rbfmu
from tests.support.scenes.balls import ball


@pytest.mark.parametrize(("condition", "before", "rise"), [
    ("u > 0", 1.0, 1.2), ("u >= 0", -1.0, 1.2), ("u < 0", -1.0, 1.2), ("u <= 0", 1.0, 1.2), ("u >= 0", 1.0, 2.0),
    ("max(1 - t, 0) > 0", 0.0, 1.2), ("min(t - 1, 0) < 0", 0.0, 1.2),
])  # fmt: skip
def test_what_comes_to_zero_and_stays_there_is_zero(condition, before, rise):
    """2026-11-28: it counted as what it had been before, so that a thruster went on after its port came to zero."""
    one = ball(f"where({condition}, 1, 0.2)", accuracy=1e-8, inputs={"ports": [{"name": "u", "size": 1}]})
    found = rbfmu.simulate(one, inputs={"u": ([0.0, 1.0], [before, 0.0])})
    assert found.omega_b[-1, 2] == pytest.approx(rise, abs=1e-8)


@pytest.mark.parametrize(("condition", "accuracy", "rise"), [
    ("(t - p)**2 >= 0", 1e-10, 2.0), ("(t - p)**3 > 0", 1e-11, 0.6), ("(t - p)**6 > 0", 1e-5, 2.0),
    pytest.param("(t - p)**4 > 0", 1e-5, 2.0, marks=pytest.mark.thorough),
    pytest.param("(t - p)**9 > 0", 1e-8, 0.6, marks=pytest.mark.thorough),
])  # fmt: skip
def test_a_condition_on_a_power_turns_where_that_is_zero(condition, accuracy, rise):
    """2026-11-28: a series finds the zero of (t - 0.7)**4 1e-4 s early, from where on the condition was wrong."""
    one = ball(f"where({condition}, 1, -1)", accuracy=accuracy, constants={"p": 0.7})
    assert rbfmu.simulate(one).omega_b[-1, 2] == pytest.approx(rise, abs=accuracy)
    derivative = rbfmu.sensitivity(one, ["constants.p"]).of["omega_b"][-1, 2, 0]
    assert derivative == pytest.approx(0.0 if rise == 2.0 else -2.0, abs=1e-9)


@pytest.mark.thorough
def test_a_condition_turns_at_two_multiple_roots():
    """2026-11-28: what a series leaves out beside them moves them by more than round-off, or has one passed over."""
    powers = "(t - 1.8503929448194252)**5*sin(1.8933640991148937*t + 2.9387523423419806)**5*(t - 2)**2"
    end = rbfmu.simulate(ball(f"where({powers} < 0, 1, -0.5)", accuracy=2.65e-6)).omega_b[-1, 2]
    assert end == pytest.approx(-0.7133079810778495, rel=1e-9)


@pytest.mark.parametrize(("load", "accuracy", "rise"), [
    ("max((t - 1.4605841684185181)**2*(t - 2.1401306842357575)**5, 0)", 6e-8, 0.0),  # which touches zero from below
    pytest.param("where((exp(-t) - 0.8817941922895439)**4 <= 0, cos(t), omega_b[3])", 7e-8, 0.0,
                 marks=pytest.mark.thorough),
])  # fmt: skip
def test_conditions_on_products_of_powers_turn_where_these_are_zero(load, accuracy, rise):
    """2026-11-28: their closed forms; the second was refused."""
    assert rbfmu.simulate(ball(load, accuracy=accuracy)).omega_b[-1, 2] == pytest.approx(rise, rel=1e-9, abs=0.0)
