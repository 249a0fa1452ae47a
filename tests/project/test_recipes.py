"""Recipes of ARCHITECTURE.md, carried out in a copy of the sources, do what they promise.

They stand as patches in `tests/support/recipes/`. Each is used as a user would use what it adds, and compared with
SciPy or an exact motion. Where one no longer applies, carry it out by hand and write the patch anew by `git diff -U1`.
"""

import csv
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.support.fmu.fmu_importer import OK, Fmu
from tests.support.fmu.fmus import unzipped_at
from tests.support.paths import ROOT
from tests.support.sources import copy_sources, run_copy

RECIPES = ROOT / "tests" / "support" / "recipes"
NAMES = {"output": "Add an output", "load": "Make a load built in"}
NAMES |= {"integrator": "Add an integrator", "model": "Add a model"}
COMMAND = "from rbfmu.cli import main; main()"

INERTIA, R_OC = np.array([[2.0, 0.1, 0.0], [0.1, 3.0, -0.2], [0.0, -0.2, 4.0]]), np.array([0.1, -0.05, 0.2])
MASS, GRAVITY, FORCE_A, FORCE_B = 2.0, np.array([0, 0, -9.81]), np.array([0.3, 0, 0.1]), np.array([0, 0.7, -0.2])
TORQUE_A, TORQUE_B, DAMPING = np.array([0.2, -0.1, 0.4]), np.array([0.5, 0, -0.3]), np.array([0.05, 0.02, 0.1])
OMEGA_0, VELOCITY_0, STOP = np.array([0.7, -1.1, 0.4]), np.array([1.0, 2.0, 3.0]), 3.0
LOADED = f"""
name = "loaded"
[body]
mass = {MASS}
inertia = {INERTIA.tolist()}
r_oc_b = {R_OC.tolist()}
[initial]
omega_b = {OMEGA_0.tolist()}
velocity = {VELOCITY_0.tolist()}
[loads]
gravity_a = {GRAVITY.tolist()}
force_a = {FORCE_A.tolist()}
force_b = {FORCE_B.tolist()}
torque_a = {TORQUE_A.tolist()}
torque_b = {TORQUE_B.tolist()}
damping_b = {DAMPING.tolist()}
[outputs]
quantities = QUANTITIES
[run]
stop = {STOP}
step = 0.05
accuracy = 1e-10
"""
SPHERE = f"""
name = "ball"
[body]
mass = 0.4
inertia = [0.03, 0.03, 0.03]
[initial]
omega_b = {OMEGA_0.tolist()}
velocity = {VELOCITY_0.tolist()}
[outputs]
quantities = ["position", "quaternion", "omega_a"]
[loads]
gravity_a = {GRAVITY.tolist()}
[run]
stop = 20.0
step = 0.1
accuracy = 1e-8
"""


def loaded(times, drag=np.zeros(3)):  # noqa: B008
    """Body rates, angular accelerations and positions of o of the scene LOADED by SciPy."""

    def rates(t, y):
        R, omega = Rotation.from_quat(y[6:10]).as_matrix(), y[10:13]
        torque = TORQUE_B + R.T @ TORQUE_A + np.cross(-R_OC, FORCE_B + R.T @ FORCE_A) - DAMPING * omega
        torque = torque - drag * np.linalg.norm(omega) * omega
        alpha = np.linalg.solve(INERTIA, torque - np.cross(omega, INERTIA @ omega))
        v, e = y[6:9], y[9]
        turn = 0.5 * np.concatenate([e * omega + np.cross(v, omega), [-v @ omega]])
        return np.concatenate([y[3:6], GRAVITY + (FORCE_A + R @ FORCE_B) / MASS, turn, alpha])

    begin = np.concatenate([R_OC, VELOCITY_0 + np.cross(OMEGA_0, R_OC), [0, 0, 0, 1], OMEGA_0])
    y = solve_ivp(rates, (0.0, STOP), begin, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y.T
    alphas = np.array([rates(0.0, row)[10:13] for row in y])
    return y[:, 10:13], alphas, y[:, 0:3] - Rotation.from_quat(y[:, 6:10]).apply(R_OC)


def columns(path, name, count=3):
    """The numbers of a quantity in a CSV file."""
    with path.open() as file:
        return np.array([[float(row[f"{name}[{k}]"]) for k in range(1, count + 1)] for row in csv.DictReader(file)])


def run(folder, *arguments, code=COMMAND):
    done = run_copy(folder, code, *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def files_of(name):
    return re.findall(r"^\+\+\+ b/(.+)$", (RECIPES / f"{name}.patch").read_text(), re.MULTILINE)


def carried_out(names, copy):
    """Return a folder with a copy of the sources in which recipes were carried out."""
    if not shutil.which("git"):
        pytest.skip("no git")
    copy_sources(copy)
    for name in names:
        subprocess.run(["git", "apply", str(RECIPES / f"{name}.patch")], cwd=copy, check=True)
    return copy


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A copy with all recipes, which compiles its kernels once for all tests."""
    return carried_out(NAMES, tmp_path_factory.mktemp("copy"))


@pytest.mark.parametrize("name", NAMES)
def test_the_recipe_has_as_many_files_as_it_says_and_they_apply(name, tmp_path):
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    said = re.search(rf"\*\*{NAMES[name]}\*\*.*?\((\d) files", text)
    folder = carried_out([name], tmp_path)
    assert len(files_of(name)) == int(said[1])
    for file in files_of(name):
        compile((folder / file).read_text(), file, "exec")


@pytest.mark.slow
def test_an_output_is_shown_by_a_run_and_an_fmu_with_its_time_derivative(folder, tmp_path):
    (folder / "loaded.toml").write_text(LOADED.replace("QUANTITIES", '["angular_momentum_b"]'))
    run(folder, "run", "loaded.toml", "-o", "loaded.csv")
    times = np.linspace(0.0, STOP, 61)
    omega, alpha, _ = loaded(times)
    found = columns(folder / "loaded.csv", "angular_momentum_b")
    assert np.abs(found - omega @ INERTIA).max() < 1e-9
    run(folder, "build", "--native", "loaded.toml", "-o", "loaded.fmu")
    run(folder, "verify", "loaded.fmu")
    instance = Fmu(unzipped_at(folder / "loaded.fmu", tmp_path / "unzipped")).started()
    names = [f"angular_momentum_b[{k}]" for k in (1, 2, 3)]
    for k in range(1, 61):
        assert instance.step(0.05 * (k - 1), 0.05) == OK
        assert instance.get(*names) == pytest.approx(found[k], rel=1e-14)
    status, rates = instance.get_rates(*names)
    assert status == OK
    assert rates == pytest.approx(INERTIA @ alpha[-1], abs=1e-9)
    instance.free()


@pytest.mark.slow
def test_a_load_acts_in_runs_and_in_an_fmu_whose_parameter_it_is(folder, tmp_path):
    drag = np.array([0.3, 0.2, 0.5])
    text = LOADED.replace("QUANTITIES", '["position", "omega_b"]').replace("1e-10", "1e-9")
    listed = f"drag_b = {drag.tolist()}\n[inputs]\nparameters = ['drag_b']\n[outputs]"
    (folder / "loaded.toml").write_text(text.replace("[outputs]", listed))
    run(folder, "run", "loaded.toml", "-o", "loaded.csv")
    omega, _, position = loaded(np.linspace(0.0, STOP, 61), drag)
    assert np.abs(columns(folder / "loaded.csv", "omega_b") - omega).max() < 1e-9
    assert np.abs(columns(folder / "loaded.csv", "position") - position).max() < 1e-8
    run(folder, "build", "--native", "loaded.toml", "-o", "loaded.fmu")
    run(folder, "verify", "loaded.fmu")
    doubled = {f"drag_b[{k}]": 2.0 * drag[k - 1] for k in (1, 2, 3)}
    instance = Fmu(unzipped_at(folder / "loaded.fmu", tmp_path / "unzipped")).started(doubled)
    for k in range(60):
        assert instance.step(0.05 * k, 0.05) == OK
    omega = loaded(np.linspace(0.0, STOP, 61), 2.0 * drag)[0]
    assert instance.get(*(f"omega_b[{k}]" for k in (1, 2, 3))) == pytest.approx(omega[-1], abs=1e-9)
    instance.free()


@pytest.mark.slow
def test_an_integrator_runs_by_a_plan_that_names_it_with_its_order(folder):
    (folder / "loaded.toml").write_text(LOADED.replace("QUANTITIES", '["position", "omega_b"]'))
    code = """
import rbfmu
import rbfmu_fmu
scene = rbfmu.load_scene("loaded.toml")
for parts in (1, 2):
    plan = rbfmu.Plan("classical Runge-Kutta", "order 4", 13, substep=0.01 / parts)
    rbfmu.simulate(scene, planned=plan).save(f"{parts}.csv")
for kind in ("native", "python"):
    rbfmu_fmu.build(scene, f"{kind}.fmu", kind, planned=plan)
"""
    run(folder, code=code)
    omega, _, position = loaded(np.linspace(0.0, STOP, 61))
    for name, truth in (("omega_b", omega), ("position", position)):
        errors = [np.abs(columns(folder / f"{parts}.csv", name) - truth).max() for parts in (1, 2)]
        assert errors[0] < 1e-7
        assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)
    for kind in ("native", "python"):
        run(folder, "verify", f"{kind}.fmu")


@pytest.mark.slow
def test_a_model_is_chosen_by_planning_where_it_serves_and_refused_elsewhere(folder):
    (folder / "ball.toml").write_text(SPHERE)
    assert json.loads(run(folder, "plan", "--json", "ball.toml"))["model"] == "free sphere"
    run(folder, "run", "ball.toml", "-o", "ball.csv")
    times, rate = np.linspace(0.0, 20.0, 201), np.linalg.norm(OMEGA_0)
    half = 0.5 * rate * times[:, None]
    truth = np.hstack([np.cos(half), np.sin(half) * OMEGA_0 / rate])
    position = times[:, None] * VELOCITY_0 + 0.5 * times[:, None] ** 2 * GRAVITY
    assert np.abs(columns(folder / "ball.csv", "quaternion", 4) - truth).max() < 1e-13
    assert np.abs(columns(folder / "ball.csv", "position") - position).max() < 1e-15 * np.abs(position).max()
    assert columns(folder / "ball.csv", "omega_a") == pytest.approx(np.tile(OMEGA_0, (201, 1)), abs=1e-15)
    run(folder, "build", "--native", "ball.toml", "-o", "ball.fmu")
    run(folder, "verify", "ball.fmu")
    for key, other in (("inertia", [0.03, 0.03, 0.02]), ("torque_b", [0, 0, 0.1]), ("force_b", [0, 0, 0.1])):
        without = re.sub(f"^{key} = .*$", "", SPHERE, flags=re.MULTILINE)
        table = "body" if key == "inertia" else "loads"
        (folder / "other.toml").write_text(without.replace(f"[{table}]", f"[{table}]\n{key} = {other}"))
        assert json.loads(run(folder, "plan", "--json", "other.toml"))["model"] != "free sphere", key
