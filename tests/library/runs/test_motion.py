"""Errors between two motions, and the sizes that they are relative to: by hand."""

import math

import numpy as np
import pytest

from rbfmu import Scene
from rbfmu.models.question import Question
from rbfmu.runs.motion import largest_error, largest_size, least_sizes, lost_to_cancellation, natural_sizes

EPS = 2.0**-52


@pytest.mark.parametrize(("rows", "size"), [
    ([[3.0, 4.0, 0.0], [0.0, 0.0, -1.0]], 5.0), ([[3e200, 0.0, -4e200]], 5e200), ([[3e-200, 4e-200, 0.0]], 5e-200),
    ([[0.0, 0.0, 0.0]], 0.0), (np.zeros((0, 3)), 0.0), ([[1.0, -math.inf, 0.0]], math.inf),
])  # fmt: skip
def test_the_largest_size_leaves_no_range_of_numbers(rows, size):
    assert largest_size(np.array(rows)) == pytest.approx(size, rel=4.0 * EPS)


def test_the_largest_error_is_the_worst_of_all_quantities_relative_to_the_largest_of_the_run():
    """Of positions and velocities relative to 1 m and 1 m/s at least."""
    motion = {"quaternion": np.array([[1.0, 0.0, 0.0, 0.0]]), "omega_b": np.array([[0.0, 0.0, 2.0]]),
              "position": np.array([[0.0, 0.5, 0.0]]), "velocity": np.array([[5.0, 0.0, 0.0]])}  # fmt: skip
    turned = np.array([[math.cos(0.05), math.sin(0.05), 0.0, 0.0]])
    for name, value, error in [
        ("quaternion", turned, 0.1), ("quaternion", -turned, 0.1), ("omega_b", np.array([[0.0, 0.5, 2.0]]), 0.25),
        ("position", np.array([[0.25, 0.5, 0.0]]), 0.25), ("velocity", np.array([[6.0, 0.0, 0.0]]), 0.2),
        ("velocity", np.array([[math.nan, 0.0, 0.0]]), math.inf), ("velocity", motion["velocity"], 0.0),
    ]:  # fmt: skip
        assert largest_error(motion | {name: value}, motion, motion) == pytest.approx(error, rel=8 * EPS)
    still = {"omega_b": np.zeros((1, 3))}
    assert largest_error({"omega_b": np.eye(1, 3)}, still, still) == 1.0


def test_only_positions_and_velocities_count_by_metres_where_sizes_vary():
    truth = {name: np.array([[100.0, 0.0, 0.0]]) for name in ("position", "omega_b")}
    found = {name: rows + np.array([1.0, 0.0, 0.0]) for name, rows in truth.items()}
    assert largest_error(found, truth, ["position"]) == largest_error(found, truth, ["omega_b"]) == 0.01
    assert largest_error(found, truth, ["position"], absolute=True) == 1.0
    assert largest_error(found, truth, ["omega_b"], absolute=True) == 0.01


LOADS = {"gravity_a": [0.0, 0.0, -2.0], "force_a": [3.0, 4.0, 0.0], "torque_b": [0.0, 1.2, 1.6],
         "damping_b": [7.0, 7.0, 7.0]}  # fmt: skip
RATE, SPAN = [0.0, 3.0, 0.0], 8.0


def sizes(moments, pivot=False):
    body = {"mass": 2.0, "inertia": moments, "r_oc_b": [0.5, 0.0, 0.0], "pivot": pivot}
    scene = Scene(body=body, initial={"omega_b": RATE}, loads=LOADS, run={"stop": SPAN})
    return natural_sizes(Question(scene), {})


def test_sizes_are_what_loads_make_that_are_not_in_balance():
    """Of 5 N at an arm of 0.5 m and 2 N m about the least moment, 3 rad/s, and 2 m/s2 and 5 N / 2 kg for 8 s."""
    found = sizes([1.5, 2.0, 3.0])
    alpha = (2.0 + 0.5 * 5.0) / 1.5
    rate, linear = math.sqrt(alpha) + 3.0, 2.0 + 2.5
    assert found == pytest.approx({
        "omega_b": rate, "omega_a": rate, "alpha_b": alpha + 9.0, "acceleration": 0.5 * (alpha + 9.0) + linear,
        "angular_momentum_a": 3.0 * rate, "kinetic_energy": 3.0 * rate**2 + 2.0 * (linear * SPAN) ** 2,
    })  # fmt: skip


def test_sizes_of_a_body_on_a_pivot_are_of_its_weight_and_turn():
    found = sizes([1.5, 2.0, 3.0], pivot=True)
    alpha = (2.0 + 0.5 * 2.0 * 2.0) / 1.5
    rate = math.sqrt(alpha) + 3.0
    assert found["omega_b"] == pytest.approx(rate)
    assert found["kinetic_energy"] == pytest.approx((3.0 + 2.0 * 0.25) * rate**2)


def test_what_round_off_leaves_counts_by_its_terms():
    scene = Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, loads={"torque_b": [4.0, 0.0, 0.0]})
    asked, size = Question(scene), natural_sizes(Question(scene), {"omega_b": np.zeros((1, 3))})["omega_b"]
    assert size == 2.0
    for part, counted in ((1e-15, True), (1e-12, False)):
        motion = {"omega_b": np.array([[0.0, size * part, 0.0]])}
        assert ("omega_b" in least_sizes(asked, motion)) is counted
        assert lost_to_cancellation(asked, motion) == pytest.approx(0.0 if counted else 64.0 * EPS / part)
    energy = {"kinetic_energy": np.array([natural_sizes(asked, {})["kinetic_energy"] * 1e-24])[:, None]}
    assert lost_to_cancellation(asked, energy) == pytest.approx(64.0 * EPS / 1e-12)  # as of its rate
