"""A body about a fixed point, in the units behind FMUs and `simulate`. Any method must pass."""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu.runs.motion import attitude_error
from tests.support.references import reference_mp as reference
from tests.support.scenes.model_cases import EPS, GRAVITY, LEANING, NO_GRAVITY, TOP, Unit, distance, made, matrix


@pytest.mark.parametrize("inertia", [[0.5, 0.5, 0.3], [0.5, 0.6, 0.3]], ids=["symmetric", "triaxial"])
def test_a_heavy_top_keeps_energy_and_vertical_momentum(inertia):
    scene = made(
        TOP | {"inertia": inertia},
        {"omega_b": [0.2, 0.0, 20.0], "attitude": LEANING},
        GRAVITY,
        stop=5.0,
    )
    unit = Unit(scene)

    def energy():
        return unit["kinetic_energy"] + 1.0 * 9.81 * (matrix(unit) @ [0.0, 0.0, 0.5])[2]

    start, vertical, own = energy(), unit["angular_momentum_a"][2], unit["omega_b"][2]
    unit.step(0.5, 10)
    assert energy() == pytest.approx(start, rel=1e-9)
    assert unit["angular_momentum_a"][2] == pytest.approx(vertical, rel=1e-9)
    assert (abs(unit["omega_b"][2] / own - 1.0) <= 20 * EPS) == (inertia[0] == inertia[1])
    assert distance(unit["angular_momentum_a"][:2], [0.0, 0.0]) > 1.0  # it precesses


def test_a_heavy_top_moves_as_40_digit_arithmetic_has_it():
    scene = made(
        TOP | {"inertia": [0.5, 0.6, 0.3]},
        {"omega_b": [0.2, 0.0, 20.0], "attitude": LEANING, "position": [1.0, 2.0, 3.0]},
        {"gravity_a": [0.0, 1.0, -9.81], "torque_a": [0.1, 0.0, 0.0], "damping_b": [0.0, 0.01, 0.02]},
        stop=2.0,
    )
    unit = Unit(scene).step(0.25, 8)
    (truth,) = reference.motion(scene, (2.0,))
    assert reference.angle_to(unit["quaternion"], truth.R_ab) <= 1e-10
    assert reference.distance(unit["omega_b"], truth.omega_b) <= 1e-10 * 20.0


def test_a_pivot_holds_the_origin_whatever_pushes_there():
    start = {"omega_b": [0.2, 0.0, 2.0], "attitude": LEANING, "position": [1.0, 2.0, 3.0]}
    pushed, free = (Unit(made(TOP, start, GRAVITY, inputs={"ports": ["force_a", "force_b"]})) for _ in range(2))
    pushed["force_a"], pushed["force_b"] = [100.0, 200.0, 300.0], [-50.0, 0.0, 10.0]
    pushed.step(0.5, 4)
    free.step(0.5, 4)
    np.testing.assert_array_equal(pushed["position"], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(pushed["velocity"], [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(pushed["acceleration"], [0.0, 0.0, 0.0])
    for name in ("quaternion", "omega_b", "alpha_b", "kinetic_energy"):
        np.testing.assert_array_equal(pushed[name], free[name])


def test_a_fast_top_precesses_slowly():
    """m g l / h about the vertical, to the square of the ratio of the rates: here 1 %."""
    unit = Unit(made(TOP, {"omega_b": [0.0, 0.0, 200.0], "attitude": LEANING}, GRAVITY, 1e-6, stop=1.0))
    unit.step(0.1, 10)
    axis = matrix(unit)[:, 2]
    assert math.atan2(axis[0], -axis[1]) == pytest.approx(9.81 * 0.5 / (0.3 * 200.0), rel=0.02)
    assert math.acos(axis[2]) == pytest.approx(0.4, abs=2e-3)


@pytest.mark.parametrize("amplitude", [0.01, 1.0, 3.0])
def test_a_beam_on_its_end_swings_with_the_period_of_a_pendulum(amplitude):
    """I = m l^2 / 3 about the end, arm l / 2: omega_0^2 = 3 g / (2 l); period 4 K(sin(amplitude / 2)) / omega_0."""
    body = {"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}, "r_oc_b": [1.0, 0.0, 0.0], "pivot": True}
    hanging = math.pi / 2.0  # turned about y, the beam's x axis points down
    period = float(4 * mp.ellipk(mp.sin(amplitude / 2) ** 2) / mp.sqrt(3 * 9.81 / 4))
    initial = {"attitude": {"rotvec": [0.0, hanging + amplitude, 0.0]}}
    unit = Unit(made(body, initial, GRAVITY, stop=period))
    start = unit["quaternion"]
    unit.step(period / 8.0, 4)
    half = Rotation.from_rotvec([0.0, hanging - amplitude, 0.0]).as_quat(scalar_first=True)
    assert attitude_error(unit["quaternion"], half) <= 1e-10 * max(1.0, amplitude)
    unit.step(period / 8.0, 4)
    assert attitude_error(unit["quaternion"], start) <= 1e-9
    assert unit["omega_b"][0] == 0.0


def test_a_free_beam_under_a_force_across_it_does_not_turn_about_itself():
    body = {"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}}
    unit = Unit(made(body, {"omega_b": [0.0, 1.0, 2.0]}, NO_GRAVITY | {"torque_b": [0.0, 0.3, -0.1]})).step(0.5, 10)
    assert unit["omega_b"][0] == 0.0
    assert unit["alpha_b"][0] == 0.0
    np.testing.assert_allclose(unit["omega_b"], [0.0, 1.0 + 0.3 * 5.0, 2.0 - 0.1 * 5.0], rtol=1e-10)
