"""The kernels that are made of a scene's formulas: their text, what is kept of them, and for which scenes they hold."""

import gc
import inspect
import weakref
from importlib import import_module

import numpy as np
import pytest

import rbfmu
from rbfmu.models import formulas
from rbfmu.planning.formulas import ORDERS
from rbfmu.runs import steps
from rbfmu_kernels.types import python_function
from tests.support.command_line import call

TABLES = {
    "body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": [0.1, 0.2, 0.3]},
    "loads": {"torque_b": "[gain*sin(t), 0, 0]", "gravity_a": [0.0, 0.0, 0.0]}, "formulas": {"gain": "0.1"},
    "outputs": {"quantities": ["omega_b"]}, "run": {"stop": 2.0, "step": 0.5, "accuracy": 1e-9},
}  # fmt: skip


@pytest.mark.parametrize("change", [
    {"loads.torque_b": "[gain*cos(t), 0, 0]"},
    {"formulas.gain": "0.2"},
    {"outputs": {"quantities": ["omega_b"], "twice": {"value": "2*omega_b[1]", "unit": "rad/s"}}},
    {"outputs.quantities": ["position", "quaternion"], "initial.velocity": [1.0, 0.0, 0.0]},
    {"loads.damping_b": [0.5, 0.5, 0.5]},
    {"loads.torque_a": [1.0, 0.0, 0.0]},
    {"loads.gravity_a": [0.0, 0.0, -9.81], "outputs.quantities": ["position"]},
    {"body.inertia": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 3.0]]},
    {"body.pivot": True, "body.r_oc_b": [0.0, 0.0, 0.5], "loads.gravity_a": [0.0, 0.0, -9.81]},
])  # fmt: skip
def test_a_plan_of_another_scene_runs_what_the_scene_says(change):
    """Kernels are made of a scene's texts, without what is zero in it: 2026-11-25, they ran on scenes of others."""
    one = rbfmu.Scene.from_dict(TABLES)
    other = one.replace(change)
    found, wanted = rbfmu.simulate(other, planned=rbfmu.plan(one)).quantities, rbfmu.simulate(other).quantities
    assert found.keys() == wanted.keys()
    for name, rows in wanted.items():
        np.testing.assert_allclose(found[name], rows, atol=1e-7)


@pytest.mark.parametrize("change", [
    {"initial.omega_b": [0.3, 0.0, 0.1]}, {"body.mass": 2.0}, {"run.step": 0.1},
    {"constants.c": 0.2}, {"constants.c": 0.0},
])  # fmt: skip
def test_kernels_hold_for_other_numbers(change):
    one = rbfmu.Scene.from_dict(TABLES | {"constants": {"c": 0.1}, "formulas": {"gain": "c"}})
    planned = rbfmu.plan(one)
    assert planned.of_scene(one.replace(change)) is planned


@pytest.mark.thorough
def test_the_text_of_the_kernels_can_be_printed(tmp_path):
    (tmp_path / "scene.toml").write_text(
        '[body]\nmass = 1.0\ninertia = [1.0, 2.0, 3.0]\n[loads]\ntorque_b = "-0.1*omega_b + [t, 0, 0]"\n'
    )
    printed = call("plan", tmp_path / "scene.toml", "--code").stdout
    compile(printed, "formulas", "exec")
    assert "def further(z: Buffer, w: int, k: int)" in printed


def test_kept_code_finds_the_module_that_it_was_compiled_of():
    """2026-11-23: it named none, so that each process compiled a scene's model anew, which takes 10 s."""
    formulas = rbfmu.plan(rbfmu.Scene.from_dict(TABLES)).formulas
    assert formulas.model
    found = import_module(f"rbfmu.models.formulas.formulas_{formulas.key}")
    assert inspect.getmodule(python_function(found.first)) is found  # as Numba asks


def test_whether_compiling_pays_is_known_from_all_pilot_runs_to_come(monkeypatch):
    """A moored hull's first plan took 14 s: its kernels were compiled when most pilots were done in plain Python."""
    to_come, tiered = [], steps.tiered
    monkeypatch.setattr(steps, "tiered", lambda kernel, calls=1: to_come.append(calls) or tiered(kernel, calls))
    scene = rbfmu.Scene.from_dict(TABLES)
    rbfmu.plan(scene)
    assert to_come[0] == len(ORDERS) * scene.run.count
    assert to_come[-1] == scene.run.count


def test_outputs_that_come_of_no_state_have_code():
    own = {"quantities": [], "thrust": {"value": "2*torque_b"}}
    planned = rbfmu.plan(rbfmu.Scene.from_dict(TABLES | {"outputs": own, "inputs": {"ports": ["torque_b"]}}))
    assert [name for name, place in planned.formulas._places.items() if place == ()] == []  # of no type to Numba
    assert planned.states == 0


def test_kernels_of_texts_long_past_go_with_the_last_who_runs_them(monkeypatch):
    """A loop that wrote its numbers into texts took a megabyte more each turn, which the process never gave back."""
    monkeypatch.setattr(formulas, "MOST_MADE", 1)

    def scene(gain):
        return rbfmu.Scene.from_dict(TABLES).replace({"formulas.gain": f"{gain}"})

    stepped, whole = rbfmu.Simulator(scene(0.3)), rbfmu.simulate(scene(0.3))
    ends = [weakref.ref(rbfmu.plan(scene(gain)).kernels.step) for gain in (0.31, 0.32, 0.33)]
    gc.collect()
    assert [end() is None for end in ends] == [True, True, False]
    for _ in range(4):
        stepped.step()
    assert stepped.omega_b.tobytes() == whole.omega_b[-1].tobytes()
