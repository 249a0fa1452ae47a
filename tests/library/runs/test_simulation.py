"""`simulate`: its grid, its result, its files; NASA's tumbling brick for all of its 30 s."""

import copy
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import rbfmu
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.scene.tables import Run
from rbfmu.simulation import SimulationError
from tests.support.paths import SCENES, SHARED

EPS = 2.0**-52
EARTH_RATE = 7.292115e-5  # rad/s, about north
EXAMPLE = SCENES / "tumbling_brick.toml"
NASA = SHARED / "nasa_tumbling_brick.csv"


def scene(run=None, **tables):
    usual = {"body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.1, 0.0, 0.0]},
             "initial": {"omega_b": [1.0, 2.0, -1.0]}, "run": run or {"stop": 1.0, "step": 0.1}}  # fmt: skip
    return Scene(**usual | tables)


# The grid


def test_the_grid_ends_at_the_last_of_its_steps_which_round_off_parts_from_its_stop():
    """As importers' last point is that one."""
    run = Run()._with(start=0.0, stop=0.3, step=0.1)
    assert run.grid()[-1] == run.end == 3 * 0.1 != run.stop


@pytest.mark.parametrize("start", [0.0, 0.1, 1e3, 1e6 + 0.7, 1e9, 1.7e9 + 0.3, 2e9])
@pytest.mark.parametrize("step", [1e-3, 0.1, 0.3, 0.35, 10.0])
@pytest.mark.parametrize("steps", [1, 3, 3.25, 1000])
def test_the_grid_ends_at_its_stop_at_times_of_any_clock(start, step, steps):
    stop = start + steps * step
    grid = Run()._with(start=start, stop=stop, step=step).grid()
    assert abs(grid[-1] - stop) <= 2 * math.ulp(stop)
    assert len(grid) == math.ceil(steps) + 1
    np.testing.assert_array_equal(grid[:-1], start + np.arange(len(grid) - 1) * step)
    assert grid[-1] - grid[-2] > 0.2 * step


def test_round_off_in_the_stop_makes_no_step_of_its_own():
    assert Run(stop=0.1 * 3, step=0.1).count == 3  # 0.1 * 3 > 0.3
    assert Run(start=0.1, stop=0.1 + 0.2, step=0.1).count == 2
    assert Run(stop=1.0 - EPS, step=0.1).count == 10


@pytest.mark.parametrize(("start", "stop", "step", "slack"), [
    (0.0, 100.0, 1.0, 1e-7), (-10.0, 0.0, 1.0, 1e-9), (-100.0, -99.0, 1.0, 9.9e-8), (1e9, 1e9 + 10.0, 1.0, 0.1),
])  # fmt: skip
def test_an_importer_s_round_off_beyond_the_stop_is_a_tenth_of_a_step_at_most(start, stop, step, slack):
    assert Run(start=start, stop=stop, step=step).last_time - stop == pytest.approx(slack, rel=2e-6)


def test_steps_end_within_a_tenth_of_them_also_where_the_clock_is_coarse():
    run = Run(start=1e15, stop=1e15 + 10.0, step=0.5)
    assert [run.steps_until(1e15 + t) for t in (0.25, 0.5, 0.875, 10.0)] == [0, 1, 1, 20]
    assert [Run().steps_until(t) for t in (0.03 - 1e-12, math.inf)] == [3, 2**62]
    for start in (1e9, 1.7e9 + 0.3):
        run = Run(start=start, stop=start + 1.0, step=0.1)
        assert [run.steps_until(start + 0.1 * k) for k in range(11)] == [*range(11)]


def test_steps_of_a_thinned_run_end_where_it_does():
    run = Run(stop=1.0, step=0.1)
    assert run.thinned_steps(4) == pytest.approx([0.3, 0.3, 0.3, 0.1])
    assert run.thinned_steps(10) == pytest.approx([0.1] * 10)


@pytest.mark.parametrize(("substep", "kept"), [(0.25, 0.25), (math.inf, 0.0)])
def test_a_model_is_told_a_substep_of_zero_where_it_chooses_its_own(substep, kept):
    assert rbfmu.Plan("symmetric top", "", 7, substep=substep).settings["substep"] == kept


# The result


def test_a_result_has_the_scene_s_quantities_by_attribute():
    result = rbfmu.simulate(scene())
    shapes = {name: values.shape for name, values in result.quantities.items()}
    three = dict.fromkeys(
        ("position", "velocity", "acceleration", "rpy", "omega_b", "omega_a", "alpha_b", "angular_momentum_a"), (11, 3)
    )
    assert shapes == three | {"quaternion": (11, 4), "kinetic_energy": (11,)}
    assert result.kinetic_energy is result.quantities["kinetic_energy"]
    assert repr(result).startswith("Result(11 points, position, ")


def test_a_result_has_no_more_than_asked_for():
    result = rbfmu.simulate(scene(outputs={"quantities": ["omega_b", "rpy"]}))
    assert list(result.quantities) == ["omega_b", "rpy"]
    with pytest.raises(AttributeError, match="no quantity 'position' in this result; it has time, omega_b, rpy"):
        result.position  # noqa: B018


def test_a_result_can_be_copied_and_sent():
    result = rbfmu.simulate(scene())
    for other in (copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
        np.testing.assert_array_equal(other.quaternion, result.quaternion)


def test_a_motion_that_leaves_the_numbers_is_an_error_that_says_when():
    """1e308 m/s2: the velocity leaves them at 1.8 s."""
    body, loads = {"mass": 1e-3, "inertia": [1.0, 2.0, 2.5]}, {"force_a": [1e305, 0.0, 0.0]}
    with np.errstate(all="ignore"), pytest.raises(SimulationError, match=r"the step from t = 1\.70*\d? s was refused"):
        rbfmu.simulate(scene({"stop": 100.0, "step": 0.1}, body=body, loads=loads))


# Files


@pytest.mark.parametrize("name", ["run.txt", "run", "run.csv.gz", ".csv"])
def test_another_suffix_is_refused_and_nothing_written(tmp_path, name):
    with pytest.raises(ValueError, match=r"the name must end in \.csv, \.npz or \.aem"):
        rbfmu.Result([0.0], {"kinetic_energy": [1.0]}).save(str(tmp_path / name))
    assert list(tmp_path.iterdir()) == []


# NASA's tumbling brick


@pytest.mark.skipif(not NASA.exists(), reason="NASA's data are not here")
@pytest.mark.parametrize("simulation", ["01", "04"])
def test_the_brick_is_where_nasa_s_simulations_have_it_for_30_s(simulation):
    """North-east-down at time t is the initial one, turned with the earth by 7.292115e-5 rad/s t about north."""
    table = np.genfromtxt(NASA, delimiter=",", names=True)
    result = rbfmu.simulate(rbfmu.load_scene(EXAMPLE))
    np.testing.assert_allclose(table["time_s"], result.time, atol=1e-9)
    rates = np.column_stack([table[f"sim{simulation}_{name}"] for name in "pqr"])
    assert np.max(np.abs(np.degrees(result.omega_b) - rates)) <= 1e-9
    angles = np.column_stack([table[f"sim{simulation}_{name}"] for name in ("yaw", "pitch", "roll")])
    north = np.zeros((len(result.time), 3))
    north[:, 0] = EARTH_RATE * result.time
    inertial = Rotation.from_rotvec(north) * Rotation.from_euler("ZYX", angles, degrees=True)
    error = np.degrees(attitude_error(result.quaternion, inertial.as_quat(scalar_first=True)))
    assert np.max(error) <= 1e-4
    standing = Rotation.from_euler("ZYX", angles, degrees=True).as_quat(scalar_first=True)
    assert np.max(np.degrees(attitude_error(result.quaternion, standing))) > 0.1  # the earth's turn is 0.125 deg


# Plans by hand


@pytest.mark.parametrize(
    ("setting", "value"),
    [("model", "no such"), ("order", 0), ("order", 26), ("tolerance", math.nan), ("substep", -1.0), ("span", math.nan)],
)
def test_a_plan_that_cannot_be_run_is_refused_by_name_and_value(setting, value):
    """A series of a higher order than its buffer has room for wrote beyond it."""
    planned = replace(Plan("body under loads, by series", "", 7, tolerance=1e-9, order=12), **{setting: value})
    with pytest.raises(ValueError, match=f"Plan.{setting} = {value!r}: expected "):
        rbfmu.simulate(scene(), planned=planned)


@pytest.mark.parametrize(("planned", "tables", "expected"), [
    ("body under loads, by series", {"loads": {"torque_b": "-norm(omega_b)*omega_b"}}, "'formulas', as formulas"),
    ("torque-free body", {"states": {"x": {"start": 1.0, "rate": "-x"}}}, "'formulas', as formulas take part"),
    ("torque-free body", {"events": {"over": "omega_b[1]"}}, "'formulas', as formulas take part"),
    ("prescribed rates", {}, "a model of a body"),
    ("formulas", {"body": None, "inputs": {"ports": ["omega_b"]}}, "'prescribed rates'"),
])  # fmt: skip
def test_a_plan_by_hand_whose_model_has_no_place_for_what_moves_the_body_is_refused(planned, tables, expected):
    """Loads that were formulas went unheard, and other plans ended in a KeyError."""
    given = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "outputs": {"quantities": ["quaternion"]}, **tables}
    one = rbfmu.Scene(**{name: table for name, table in given.items() if table is not None})
    with pytest.raises(ValueError, match=f"Plan.model = '{planned}': expected {expected}"):
        rbfmu.simulate(one, planned=Plan(planned, "", 7, tolerance=1e-9, order=12))


def test_a_body_that_is_no_sphere_any_more_is_refused_for_its_moments():
    """It was said to have a torque, which an FMU of this model has no parameter for."""
    tables = {"outputs": {"quantities": ["omega_a"]}, "inputs": {"ports": ["torque_a"]}}
    sphere = scene(body={"mass": 2.0, "inertia": [1.0, 1.0, 1.0]}, **tables)
    planned = rbfmu.plan(sphere)
    assert planned.model == "angular momentum"
    with pytest.raises(rbfmu.SceneError, match="three equal moments where rates are shown"):
        rbfmu.simulate(sphere.replace({"body.inertia": [1.0, 1.0, 1.1]}), planned=planned)


def test_a_plan_by_formulas_serves_a_scene_without_any():
    """The same plan read of JSON, which holds no kernels, ended in an AttributeError."""
    one = rbfmu.Scene.from_dict({
        "body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.1, 1.2, 0.3]},
        "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 1.0, "step": 0.5},
    })  # fmt: skip
    found = rbfmu.simulate(one, planned=Plan("formulas", "", 7, tolerance=1e-12, order=12))
    M = np.array([1.0, 2.0, 3.0])
    exactly = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13}
    true = solve_ivp(lambda t, w: np.cross(M * w, w) / M, (0.0, 1.0), [0.1, 1.2, 0.3], **exactly)
    np.testing.assert_allclose(found.omega_b[-1], true.y[:, -1], rtol=0, atol=1e-11)
