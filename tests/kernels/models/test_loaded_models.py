"""The units behind FMUs and `simulate`: laws of motion, ports, outputs, a pivot. Any method must pass."""

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rbfmu.runs.motion import attitude_error
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
    TURNED,
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


def test_the_centre_of_mass_of_an_offset_body_falls_on_a_parabola_as_it_tumbles():
    initial = {
        "position": [1.0, 2.0, 3.0], "velocity": [0.4, 0.5, 0.6], "omega_b": [1.0, 2.0, -1.0], "attitude": TURNED,
    }  # fmt: skip
    unit = Unit(made(OFFSET, initial, {"gravity_a": [0.0, 1.0, -9.81]}))
    r_oc = np.array(OFFSET["r_oc_b"])

    def centre():
        return unit["position"] + matrix(unit) @ r_oc

    start, velocity = centre(), unit["velocity"] + np.cross(unit["omega_a"], matrix(unit) @ r_oc)
    unit.step(1.0, 10)
    assert distance(centre(), start + 10.0 * velocity + 50.0 * np.array([0.0, 1.0, -9.81])) <= 100 * EPS * 490.0


def test_gravity_does_not_turn_a_free_body():
    initial = {"omega_b": [1.0, 2.0, -1.0]}
    with_gravity = Unit(made(OFFSET, initial, GRAVITY))
    without = Unit(made(OFFSET, initial), with_gravity.plan)
    with_gravity.step(0.5, 10)
    without.step(0.5, 10)
    for name in ("quaternion", "omega_b", "angular_momentum_a"):
        np.testing.assert_array_equal(with_gravity[name], without[name])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_body_spins_steadily_about_a_principal_axis(axis):
    omega = [0.0, 0.0, 0.0]
    omega[axis] = 3.0
    unit = Unit(made(TRIAXIAL, {"omega_b": omega})).step(0.5, 20)
    np.testing.assert_array_equal(unit["omega_b"], omega)
    truth = np.zeros(4)
    truth[0], truth[1 + axis] = math.cos(15.0), math.sin(15.0)
    assert attitude_error(unit["quaternion"], truth) <= 1e-10
    assert distance(unit["quaternion"], truth) <= 1e-10  # not its negative: continuous in time


def test_a_symmetric_body_precesses_about_its_momentum():
    """By h / I1, and its rates turn about the axis by w3 (1 - I3 / I1)."""
    omega, t = np.array([0.6, 0.0, 2.0]), 10.0
    unit = Unit(made({"mass": 1.0, "inertia": [1.0, 1.0, 0.4]}, {"omega_b": omega.tolist()})).step(0.5, 20)
    momentum = np.array([1.0, 1.0, 0.4]) * omega
    inner = (1.0 - 0.4 / 1.0) * 2.0 * t
    turn = Rotation.from_rotvec(momentum / 1.0 * t) * Rotation.from_rotvec([0.0, 0.0, inner])
    assert attitude_error(unit["quaternion"], turn.as_quat(scalar_first=True)) <= 1e-10
    turned = Rotation.from_rotvec([0.0, 0.0, -inner]).apply(omega)
    assert distance(unit["omega_b"], turned) <= 1e-10 * np.linalg.norm(omega)
    assert unit["omega_b"][2] == 2.0
    assert distance(unit["angular_momentum_a"], momentum) <= 1e-10


def test_a_free_body_keeps_energy_and_momentum():
    unit = Unit(made(OFFSET, {"omega_b": [1.0, 2.0, -1.0], "velocity": [1.0, 0.0, 0.0]}))
    energy, momentum = unit["kinetic_energy"], unit["angular_momentum_a"]
    unit.step(1.0, 10)
    assert abs(unit["kinetic_energy"] / energy - 1.0) <= 2e-10
    assert distance(unit["angular_momentum_a"], momentum) <= 2e-10 * np.linalg.norm(momentum)


# Loads


@pytest.mark.parametrize("loads", [[name] for name in LOADED] + [pytest.param([*LOADED], marks=pytest.mark.thorough)])
def test_loads_move_the_body_as_40_digit_arithmetic_has_it(loads):
    scene = made(OFFSET, MOVING, NO_GRAVITY | {load: LOADED[load] for load in loads}, stop=5.0)
    unit = Unit(scene).step(0.5, 10)
    found = ([unit[name]] for name in ("quaternion", "omega_b", "position", "velocity"))
    errors = reference.errors(reference.motion(scene, (5.0,)), *found)
    assert max(errors.values()) <= 1e-10


def test_a_force_at_the_origin_turns_an_offset_body_about_its_centre_of_mass():
    """T_c = -r_oc x F, so alpha = M_c^-1 (-r_oc x F) at rest."""
    unit = Unit(made(OFFSET, {}, NO_GRAVITY | {"force_b": [1.0, 0.5, 0.2]}))
    alpha = np.linalg.solve(np.array(OFFSET["inertia"]), np.cross(np.negative(OFFSET["r_oc_b"]), [1.0, 0.5, 0.2]))
    np.testing.assert_allclose(unit["alpha_b"], alpha, atol=4 * EPS)
    np.testing.assert_allclose(
        unit["acceleration"], np.array([1.0, 0.5, 0.2]) / 2.0 - np.cross(alpha, OFFSET["r_oc_b"]), atol=4 * EPS
    )


@pytest.mark.parametrize("kind", ["force", "torque"])
def test_a_load_in_inertial_and_in_body_axes_act_alike_when_turned_into_each_other(kind):
    load = np.array([0.3, -0.2, 0.5])
    in_a, in_b = (
        Unit(made(OFFSET, MOVING, NO_GRAVITY, inputs={"ports": [f"{kind}_a", f"{kind}_b"]})) for _ in range(2)
    )
    in_a[f"{kind}_a"] = matrix(in_a) @ load
    in_b[f"{kind}_b"] = load
    for name in ("alpha_b", "acceleration"):
        np.testing.assert_allclose(in_a.refresh()[name], in_b.refresh()[name], atol=20 * EPS)
    in_a.step(1.0)
    in_b.step(1.0)
    assert attitude_error(in_a["quaternion"], in_b["quaternion"]) > 1e-3  # one keeps its direction, the other turns


def test_inertial_axes_are_a_matter_of_choice():
    """The whole scene turned: so is the motion."""
    Q = Rotation.from_rotvec([0.7, 1.1, -0.4])
    turned_loads = {k: Q.apply(v).tolist() if k.endswith("_a") else v for k, v in LOADED.items()}
    attitude = (Q * Rotation.from_rotvec(TURNED["rotvec"])).as_quat(scalar_first=True)
    turned_start = MOVING | {
        "position": Q.apply(MOVING["position"]).tolist(),
        "velocity": Q.apply(MOVING["velocity"]).tolist(),
        "attitude": {"quaternion": attitude.tolist()},
    }
    one = Unit(made(OFFSET, MOVING, LOADED)).step(0.5, 10)
    other = Unit(made(OFFSET, turned_start, turned_loads)).step(0.5, 10)
    for name in ("position", "velocity", "acceleration", "omega_a", "angular_momentum_a"):
        np.testing.assert_allclose(other[name], Q.apply(one[name]), atol=1e-10 * max(1.0, np.linalg.norm(one[name])))
    np.testing.assert_allclose(other["omega_b"], one["omega_b"], atol=1e-10 * np.linalg.norm(one["omega_b"]))


def test_damping_decays_exponentially():
    """exp(-d t / I) about each axis by itself."""
    for axis, (moment, d) in enumerate(zip((1.0, 2.0, 2.5), (0.5, 0.7, 0.1), strict=True)):
        omega = [0.0, 0.0, 0.0]
        omega[axis] = 4.0
        unit = Unit(made(TRIAXIAL, {"omega_b": omega}, NO_GRAVITY | {"damping_b": [0.5, 0.7, 0.1]})).step(1.0, 5)
        assert abs(unit["omega_b"][axis] / 4.0 - math.exp(-d * 5.0 / moment)) <= 1e-10


def test_work_of_known_loads_is_energy_gained():
    """A constant force and gravity through the path of o and c."""
    scene = made(TRIAXIAL, MOVING, {"gravity_a": [0.0, 0.0, -9.81], "force_a": [3.0, 1.0, 2.0]})
    unit = Unit(scene)
    energy, position = unit["kinetic_energy"], unit["position"]
    unit.step(0.5, 10)
    work = (np.array([3.0, 1.0, 2.0]) + 2.0 * np.array([0.0, 0.0, -9.81])) @ (unit["position"] - position)
    assert abs(unit["kinetic_energy"] - energy - work) <= 1e-10 * work


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


def test_accelerations_follow_the_inputs_at_once_and_the_state_only_in_a_step():
    unit = Unit(made(TRIAXIAL, MOVING, inputs={"ports": ["torque_b", "force_a"]}))
    before = {name: unit[name] for name in OUTPUT}
    unit["torque_b"], unit["force_a"] = [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]
    unit.refresh()
    np.testing.assert_allclose(unit["alpha_b"] - before["alpha_b"], [1.0, 1.0, 1.2], rtol=8 * EPS)
    np.testing.assert_allclose(unit["acceleration"] - before["acceleration"], [2.0, 2.5, 3.0], rtol=8 * EPS)
    for name in OUTPUT.keys() - {"alpha_b", "acceleration"}:
        np.testing.assert_array_equal(unit[name], before[name], err_msg=name)


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


@pytest.mark.thorough
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
