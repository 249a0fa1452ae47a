"""The gallery's scenes with formulas, against SciPy's DOP853 on equations written by hand, and their FMUs."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import rbfmu
import rbfmu_fmu
from examples.gallery import formulas, page
from rbfmu.runs.motion import attitude_error
from tests.support.references.by_scipy import by_scipy, worst
from tests.support.references.formulas_by_eval import Motion

Z = np.array([0.0, 0.0, 1.0])


def gravity_gradient(t, R, w, p, v, own):
    n, u = 1.1e-3, R.T @ [math.cos(1.1e-3 * t), math.sin(1.1e-3 * t), 0.0]
    control = 2e-5 * np.cross(Z, u) - 6e-3 * (w - n * R.T @ Z)
    gradient = 3 * n**2 * np.cross(u, [1.1, 1.2, 0.4] * u)
    return {"torque_b": gradient + control - np.cross(w, own[:3])}, -control


def magnetic_dipole(t, R, w, p, v, own):
    n, u = 1.1e-3, R.T @ [math.cos(1.1e-3 * t), 0.0, math.sin(1.1e-3 * t)]
    field = 3e-5 * (R.T @ Z - 3 * math.sin(n * t) * u)
    gradient = 3 * n**2 * np.cross(u, [0.04, 0.042, 0.01] * u)
    return {"torque_b": np.cross([0.0, 0.0, 0.6], field) + gradient - 2e-4 * w}, ()


def moored_hull(t, R, w, p, v, own):
    v_b, up = R.T @ v, R[2]
    yaw = math.atan2(R[1, 0], R[0, 0])
    drag, turning = np.array([2e4, 1.5e5, 4e5]) * abs(v_b) * v_b, np.array([2e7, 1e8, 5e7]) * abs(w) * w
    righting = np.array([-8e6 * up[1], 4e7 * up[0], 0.0])
    force = np.array([-2e4 * p[0], -2e4 * p[1], 2e5 * 9.81 - 2e6 * p[2]])
    return {"force_a": force, "force_b": -drag, "torque_b": righting - 6e5 * yaw * up - turning}, ()


def spring_pendulum(t, R, w, p, v, own):
    corner = np.array([0.1, 0.06, 0.15])
    end = p + R @ corner
    pull = -80.0 * (1.0 - 0.5 / np.linalg.norm(end)) * end
    return {"force_a": pull, "torque_b": np.cross(corner, R.T @ pull)}, ()


def drone(t, R, w, p, v, own):
    T, a, turn = np.array(own[:4]), 0.18, 0.016
    lean = R.T @ (np.array([0, 0, 9.81]) - 1.2 * (p - [0, 0, 10]) - 1.7 * v)
    shared = min(max(0.25 * 1.2 * lean[2], 0.5), 6.0)
    want = [-0.09 * w[0] - 0.04 * lean[1], -0.09 * w[1] + 0.04 * lean[0], -0.05 * w[2]]
    x, y, z = want[0] / (4 * a), want[1] / (4 * a), want[2] / (4 * turn)
    asked = np.array([x - y + z, x + y - z, -x + y + z, -x - y - z]) + shared
    torque = [a * (T[0] + T[1] - T[2] - T[3]), a * (T[1] + T[2] - T[0] - T[3]), turn * (T[0] - T[1] + T[2] - T[3])]
    return {"force_b": np.array([0, 0, T.sum()]), "torque_b": np.array(torque)}, (np.clip(asked, 0, 8.0) - T) / 0.06


DRAG = CubicSpline([0, 0.05, 0.1, 0.2, 0.5], [0.2, 0.205, 0.22, 0.3, 0.9], bc_type="natural")


def projectile(t, R, w, p, v, own):
    speed, v_b = np.linalg.norm(v), R.T @ v
    sine = math.sqrt(v_b[1] ** 2 + v_b[2] ** 2 + 1e-12 * speed**2) / speed
    moment = 5.5e-5 * speed * np.cross(v_b, [-1, 0, 0]) - 4e-9 * speed * np.array([0, w[1], w[2]])
    return {"force_a": -7.7e-4 * DRAG(sine) * speed * v, "torque_b": moment}, ()


BY_HAND = {one.__name__: one for one in (gravity_gradient, magnetic_dipole, moored_hull, spring_pendulum, drone,
                                         projectile)}  # fmt: skip
DEAR = ("moored_hull", "spring_pendulum", "projectile")
NAMES = [pytest.param(name, marks=pytest.mark.thorough) if name in DEAR else name for name in formulas.PICTURES]
STARTS = {"gravity_gradient": [0.0] * 3, "drone": [2.9] * 4}


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_a_scene_is_as_accurate_as_asked_by_equations_written_by_hand(name):
    scene, of = rbfmu.load_scene(page.scene_file(name)), BY_HAND[name]
    assert (page.FOLDER / f"{name}.png").stat().st_size < 60_000
    result, own = rbfmu.simulate(scene), STARTS.get(name, [])
    truth = by_scipy(scene.to_dict(), lambda *now: of(*now)[0], result.time, lambda *now: of(*now)[1], own, whole=True)
    names = [name for name in ("position", "quaternion", "omega_b") if name in scene.outputs.quantities]
    assert worst(result, truth, names) <= max(scene.run.accuracy, 3e-9)  # SciPy's own is some 1e-9 beside corners
    if name == "gravity_gradient":
        np.testing.assert_allclose(result.momentum, truth["own"], rtol=0, atol=1e-9 * 1.4e-3)
    if name == "drone":
        np.testing.assert_allclose(result.first, truth["own"][:, 0], rtol=0, atol=1e-6 * 4.0)
    if name == "spring_pendulum":
        assert np.ptp(result.total_energy) <= scene.run.accuracy * abs(result.total_energy[0])


@pytest.mark.slow
def test_the_first_scene_is_as_accurate_as_asked_by_36_digits():
    """By its equations written by hand; u is a state that nothing reads."""
    zenith = "to_b([cos(n*t), sin(n*t), 0])"
    control = f"(k*cross([0, 0, 1], {zenith}) - g*(omega_b - n*to_b([0, 0, 1])))"
    wheel, half = {"start": [0.0, 0.0, 0.0], "rate": f"-{control}"}, math.radians(57.5)
    turned = {"attitude": {"quaternion": [math.cos(half), 0.0, math.sin(half), 0.0]}, "omega_b": [0.0] * 3}
    torque = f"3*n**2*cross({zenith}, M_c @ {zenith}) + {control} - cross(omega_b, w)"
    truth = Motion({
        "body": {"mass": 1.0, "inertia": np.diag([1.1, 1.2, 0.4]).tolist(), "r_oc_b": [0.0] * 3}, "initial": turned,
        "constants": {"n": 1.1e-3, "k": 2e-5, "g": 6e-3}, "tables": {},
        "states": {"u": {"start": 0.0, "rate": "0*t"}, "w": wheel},
        "loads": {"gravity_a": [0.0] * 3, "damping_b": [0.0] * 3, "torque_b": torque},
    })  # fmt: skip
    scene = rbfmu.load_scene(page.scene_file("gravity_gradient"))
    found, every = rbfmu.simulate(scene), slice(None, None, 5)
    states = np.array([[float(x) for x in state] for state in truth.states_at(0.0, found.time[every].tolist())])
    assert attitude_error(found.quaternion[every], states[:, :4]).max() <= scene.run.accuracy
    for values, true in ((found.omega_b, states[:, 4:7]), (found.momentum, states[:, 14:])):
        size = np.linalg.norm(true, axis=1).max()
        assert np.linalg.norm(values[every] - true, axis=1).max() <= scene.run.accuracy * size


@pytest.mark.thorough
@pytest.mark.parametrize("name", formulas.PICTURES)
def test_its_fmu_has_the_bits_of_its_kernels(name, tmp_path):
    found = rbfmu_fmu.verify(rbfmu_fmu.build(page.scene_file(name), tmp_path / "it.fmu", kind="native"))
    assert found.passed, found.problems


@pytest.mark.thorough
def test_the_page_quotes_todays_plans():
    assert page.FORMULAS_PAGE.read_text(encoding="utf-8") == page.formulas_page()
    assert sorted(path.stem for path in page.FORMULAS_PAGE.parent.glob("*.toml")) == sorted(formulas.PICTURES)
