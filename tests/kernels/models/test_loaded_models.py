"""The units behind FMUs and `simulate`: loads, ports, outputs, a pivot. Any method must pass."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu_kernels.quantities import OUTPUT
from tests.support.references import reference_mp as reference
from tests.support.scenes.model_cases import (
    EPS,
    GRAVITY,
    LEANING,
    LOADED,
    MOVING,
    NO_GRAVITY,
    OFFSET,
    TOP,
    TRIAXIAL,
    Unit,
    distance,
    made,
    matrix,
)

# Free motion


def test_a_body_falls_on_a_parabola():
    unit = Unit(made(TRIAXIAL, {"position": [1.0, 2.0, 3.0], "velocity": [4.0, 5.0, 6.0]}, GRAVITY))
    unit.step(0.5, 20)
    g = np.array([0.0, 0.0, -9.81])
    assert distance(unit["position"], [1.0, 2.0, 3.0] + 10.0 * np.array([4.0, 5.0, 6.0]) + 50.0 * g) <= 10 * EPS * 490.0
    assert distance(unit["velocity"], [4.0, 5.0, 6.0] + 10.0 * g) <= 10 * EPS * 98.0
    np.testing.assert_array_equal(unit["acceleration"], g)
    np.testing.assert_array_equal(unit["quaternion"], [1.0, 0.0, 0.0, 0.0])


# Loads


def error_under(loads):
    """The largest error after 5 s, of all that an accuracy counts."""
    scene = made(OFFSET, MOVING, NO_GRAVITY | {load: LOADED[load] for load in loads}, stop=5.0)
    unit = Unit(scene).step(0.5, 10)
    found = ([unit[name]] for name in ("quaternion", "omega_b", "position", "velocity"))
    return max(reference.errors(reference.motion(scene, (5.0,)), *found).values())


def test_each_load_moves_the_body_as_40_digit_arithmetic_has_it():
    errors = {load: error_under([load]) for load in LOADED}
    assert max(errors.values()) <= 1e-10, errors


@pytest.mark.thorough
def test_all_loads_move_the_body_as_40_digit_arithmetic_has_it():
    assert error_under(LOADED) <= 1e-10


# Ports and outputs


def test_a_port_acts_as_the_known_load_does_to_the_bit():
    ports = ("force_a", "force_b", "torque_a", "torque_b")
    driven = Unit(made(OFFSET, MOVING, {"gravity_a": LOADED["gravity_a"]}, inputs={"ports": ports}))
    known = Unit(made(OFFSET, MOVING, {k: v for k, v in LOADED.items() if k != "damping_b"}), driven.plan)
    for port in ports:
        driven[port] = LOADED[port]
    known.step(0.5, 5)
    driven.step(0.5, 5)
    for name in OUTPUT:
        np.testing.assert_array_equal(driven[name], known[name], err_msg=name)


def test_outputs_agree_with_each_other():
    unit = Unit(made(OFFSET, MOVING, LOADED)).step(0.5, 3)
    R, omega, r = matrix(unit), unit["omega_b"], np.array(OFFSET["r_oc_b"])
    M = np.array(OFFSET["inertia"])
    yaw_pitch_roll = Rotation.from_matrix(R).as_euler("ZYX")
    np.testing.assert_allclose(unit["rpy"], yaw_pitch_roll[::-1], atol=8 * EPS)
    np.testing.assert_allclose(unit["omega_a"], R @ omega, atol=8 * EPS)
    np.testing.assert_allclose(unit["angular_momentum_a"], R @ M @ omega, atol=16 * EPS)
    v_c = unit["velocity"] + R @ np.cross(omega, r)
    assert unit["kinetic_energy"] == pytest.approx(0.5 * 2.0 * v_c @ v_c + 0.5 * omega @ M @ omega, rel=8 * EPS)
    force = R @ LOADED["force_b"] + LOADED["force_a"]
    a_c = np.array(LOADED["gravity_a"]) + force / 2.0
    a_o = a_c - R @ (np.cross(unit["alpha_b"], r) + np.cross(omega, np.cross(omega, r)))
    np.testing.assert_allclose(unit["acceleration"], a_o, atol=16 * EPS)
    torque_c = (
        R.T @ LOADED["torque_a"] + LOADED["torque_b"] - np.cross(r, R.T @ force) - np.array(LOADED["damping_b"]) * omega
    )
    np.testing.assert_allclose(M @ unit["alpha_b"] + np.cross(omega, M @ omega), torque_c, atol=16 * EPS)


# A body about a fixed point


@pytest.mark.parametrize("inertia", [[0.5, 0.5, 0.3], [0.5, 0.6, 0.3]], ids=["symmetric", "triaxial"])
def test_a_heavy_top_keeps_energy_and_vertical_momentum(inertia):
    scene = made(
        TOP | {"inertia": inertia}, {"omega_b": [0.2, 0.0, 20.0], "attitude": LEANING}, GRAVITY, stop=5.0,
    )  # fmt: skip
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


def test_a_free_beam_under_a_force_across_it_does_not_turn_about_itself():
    body = {"mass": 3.0, "shape": {"kind": "beam", "length": 2.0}}
    unit = Unit(made(body, {"omega_b": [0.0, 1.0, 2.0]}, NO_GRAVITY | {"torque_b": [0.0, 0.3, -0.1]})).step(0.5, 10)
    assert unit["omega_b"][0] == 0.0
    assert unit["alpha_b"][0] == 0.0
    np.testing.assert_allclose(unit["omega_b"], [0.0, 1.0 + 0.3 * 5.0, 2.0 - 0.1 * 5.0], rtol=1e-10)
