"""How fast a disturbance grows: the textbook's free spin about the middle axis, and its sleeping top."""

import numpy as np
import pytest

from rbfmu import Scene
from rbfmu.models.question import Question
from rbfmu.planning.closed_forms import growth_rate


def rate_of(body, loads=None, **initial):
    loads = {"gravity_a": [0.0] * 3} if loads is None else loads
    return growth_rate(Question(Scene(body=body, initial=initial, loads=loads)))


def test_a_spin_about_the_middle_axis_grows_and_others_do_not():
    body = {"mass": 1.0, "inertia": [2.0, 1.5, 3.0]}  # the first is in the middle
    expected = 3.0 * np.sqrt((2.0 - 1.5) * (3.0 - 2.0) / (1.5 * 3.0))
    assert rate_of(body, omega_b=[3.0, 0.1, 0.0]) == pytest.approx(expected)
    assert rate_of(body, omega_b=[0.1, 3.0, 0.0]) == rate_of(body, omega_b=[0.1, 0.0, 3.0]) == 0.0


def test_a_top_above_its_pivot_falls_unless_it_spins_fast():
    """The textbook's sleeping top, about its pivot: 2 kg, 0.5 m above it."""
    weight = {"gravity_a": [0.0, 0.0, -9.81]}
    top = {"mass": 2.0, "inertia": [1.0, 1.0, 0.6], "r_oc_b": [0.0, 0.0, 0.5], "pivot": True}
    hanging, transverse = top | {"r_oc_b": [0.0, 0.0, -0.5]}, 1.0 + 2.0 * 0.5**2
    for spin in (0.0, 3.0, 40.0):
        square = 4.0 * transverse * 2.0 * 9.81 * 0.5 - (0.6 * spin) ** 2
        expected = np.sqrt(max(square, 0.0)) / (2.0 * transverse)
        assert rate_of(top, weight, omega_b=[0.0, 0.0, spin]) == pytest.approx(expected)
        assert rate_of(hanging, weight, omega_b=[0.0, 0.0, spin]) == 0.0
