"""Members side by side have the bits of members one by one: with formulas, states of their own, inputs, controllers."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numba import config, njit

import rbfmu
from rbfmu.ensembles import chunks, loops
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.planning.methods import whole_series
from tests.support.paths import SCENES

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code")

BODY = {"body": {"mass": 2.0, "inertia": [1.0, 1.4, 1.9]}, "initial": {"omega_b": [0.3, -0.4, 0.5]}}
RUN = {"stop": 4.0, "step": 0.25, "accuracy": 1e-6}
RATES = {"initial.omega_b": {"normal": [[0.3, -0.4, 0.5], [0.1] * 3]}}
FORMULAS = {
    "states": BODY | {
        "constants": {"d": 0.2, "n": 2.0},
        "states": {"w": {"start": [0.1, 0.0, 0.0], "rate": "omega_b - 0.2*w"}},
        "loads": {"gravity_a": [0.0] * 3, "torque_b": "-d*omega_b - 0.1*w + 0.1*to_b([cos(n*t), 0, 1])"},
        "outputs": {"quantities": ["quaternion", "omega_b"], "speed": "norm(omega_b)"},
        "ensemble": {"vary": RATES | {"constants.d": {"normal": [0.2, 0.1]}}},
    },
    "functions": BODY | {
        "loads": {"gravity_a": [0.0] * 3, "torque_b": "-exp(-0.1*t)*omega_b*log(2 + sin(t)) + 0.1*atan2(2 + t, 3)*x_a"},
        "formulas": {"x_a": "to_b([1, 0, 0])*(3 + omega_b[1])**1.5/(3 + omega_b[2])"},
        "outputs": {"quantities": ["quaternion"]}, "ensemble": {"vary": RATES},
    },
    "corners": BODY | {
        "loads": {"gravity_a": [0.0, 0.0, -9.81], "torque_b": "-0.4*clip(norm(omega_b), 0, 0.5)*omega_b",
                  "force_a": "where(position[3] < 0, [0, 0, -400*position[3]], [0, 0, 0])"},
        "outputs": {"quantities": ["position", "quaternion"]},
        "events": {"ground": {"when": "position[3]", "direction": "falling"}},
        "ensemble": {"vary": RATES | {"initial.position": {"uniform": [[0, 0, 0.1], [0, 0, 1.0]]}}},
    },
    "refused": BODY | {
        "loads": {"gravity_a": [0.0] * 3, "torque_b": "0.05*omega_b*exp(omega_b[3])"},
        "outputs": {"quantities": ["omega_b"]}, "ensemble": {"vary": RATES},
    },
}  # fmt: skip


def both(monkeypatch, scene, planned=None, **given):
    """What an ensemble gives in lanes, which it must take, and one by one."""
    planned, taken, one_by_one = planned or plan_ensemble(scene), [], loops.run_in_lanes
    monkeypatch.setattr(chunks, "LANES_FROM", 0.0)

    def in_lanes(*arguments, compile_now):
        taken.append(one_by_one(*arguments, compile_now=True))
        return taken[-1]

    run = partial(rbfmu.run_ensemble, scene, executor=1, planned=planned, progress=False, **given)
    monkeypatch.setattr(chunks, "run_in_lanes", in_lanes)
    lanes = run()
    assert taken
    assert all(taken)
    monkeypatch.setattr(chunks, "run_in_lanes", lambda *arguments, compile_now: False)
    return lanes, run()


def assert_same(lanes, alone):
    assert lanes.failed == alone.failed
    for name in alone.all:
        assert lanes.all[name].tobytes() == alone.all[name].tobytes(), name
    for name in alone.counts:
        np.testing.assert_array_equal(lanes.counts[name], alone.counts[name])
        np.testing.assert_array_equal(lanes.first[name], alone.first[name])


def scene_of(tables, **ensemble):
    own = {"runs": 21, "seed": 3, "keep": ["all"]} | tables["ensemble"] | ensemble
    return rbfmu.Scene.from_dict({"run": RUN} | tables | {"ensemble": own}, "in lanes")


@pytest.mark.thorough  # each compiles lanes of its own
@pytest.mark.parametrize("name", FORMULAS)
def test_formulas(monkeypatch, name):
    scene, planned = scene_of(FORMULAS[name]), None
    if name == "refused":  # members that no pilot was like
        planned = plan_ensemble(scene)
        scene = scene.replace({"ensemble.vary": {"initial.omega_b": {"normal": [[0.3, -0.4, 0.5], [3.0] * 3]}}})
    lanes, alone = both(monkeypatch, scene, planned)
    assert_same(lanes, alone)
    assert bool(lanes.failed) == (name == "refused")
    if name == "corners":
        assert lanes.counts["ground"].max() > 1


@njit
def damper(t, outputs, state, inputs, noise):
    state[0] += 0.1
    for i in range(3):
        inputs[i] = inputs[i] - 0.3 * outputs[i] + 0.01 * noise[i] - 0.001 * state[0]
    if outputs[0] > 0.55:
        inputs[1] = np.inf


DRIVEN = BODY | {"loads": {"gravity_a": [0.0] * 3, "torque_a": [0.02, 0.0, 0.1]}, "ensemble": {"vary": RATES},
                 "inputs": {"ports": ["torque_b"]}, "outputs": {"quantities": ["omega_b", "quaternion"]}}  # fmt: skip
TABLE = np.array([0.0, 0.6, 1.1, 4.0]), 0.05 * np.random.default_rng(5).normal(size=(4, 3))
WAYS = {
    "hold": {"inputs": {"torque_b": TABLE}},
    "linear": {"inputs": {"torque_b": TABLE}, "interpolate": "linear"},
    "own": {"inputs": lambda i: {"torque_b": (TABLE[0], TABLE[1] * (1.0 + 0.1 * i))}},
    "controller": {"controller": rbfmu.Controller(damper, [0.1], noise=3), "inputs": {"torque_b": TABLE}},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("load", [pytest.param("formula", marks=pytest.mark.thorough), "number"])
def test_driven(monkeypatch, load, way):
    tables = DRIVEN if load == "number" else DRIVEN | {"loads": {"gravity_a": [0.0] * 3, "torque_b": "-0.1*omega_b"}}
    lanes, alone = both(monkeypatch, scene_of(tables, runs=25), **WAYS[way])
    assert_same(lanes, alone)
    assert bool(lanes.failed) == (way == "controller")


@pytest.mark.thorough
def test_own_times_of_tables_go_one_by_one_where_lanes_go_on_together():
    driven = {"inputs": lambda i: {"torque_b": ([0.0, 0.1 + 0.07 * i, 4.0], TABLE[1][:3])}}
    scene = scene_of(DRIVEN, runs=6)
    planned = plan_ensemble(scene)
    found = rbfmu.run_ensemble(scene, executor=1, planned=planned, progress=False, **driven)
    second = scene.replace({"ensemble": None, "initial.omega_b": found.samples["initial.omega_b"][2].tolist()})
    first = rbfmu.simulate(second, planned=planned, inputs=driven["inputs"](2))
    assert first.omega_b.tobytes() == found.all["omega_b"][2].tobytes()


TOP = {"body": {"mass": 1.0, "inertia": [1.0, 1.25, 0.3], "r_oc_b": [0.0, 0.0, 0.125], "pivot": True}}
OFF_AXES = {"mass": 2.0, "inertia": [[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.5]], "r_oc_b": [0.1, 0.0, 0.2]}
UNDRIVEN = {
    "a torque in b": {"loads": {"torque_b": [0.1, 0.05, -0.2]}},
    "a heavy top": TOP | {"loads": {"gravity_a": [0.0, 0.0, -9.81]}},
    "all fixed in a, damped": {
        "body": OFF_AXES, "loads": {"force_a": [0.3, 0.1, -0.4], "torque_a": [0.1, 0.0, 0.2], "damping_b": [0.1] * 3},
        "outputs": {"quantities": ["position", "velocity", "alpha_b", "rpy", "kinetic_energy"]}},
    "no attitude": {"loads": {"torque_b": [0.1, 0.05, -0.2]}, "outputs": {"quantities": ["omega_b"]}},
    "a force in b": {"loads": {"force_b": [0.1, 0.2, 0.3], "torque_b": [0.1, 0.05, -0.2]},
                     "outputs": {"quantities": ["position"]}},
    "two kinds": {"loads": {"torque_a": [0.1, 0.0, 0.0], "torque_b": [0.0, 0.1, 0.0]},
                  "ensemble": {"design": "grid", "vary": {
                      "initial.omega_b": {"uniform": [[0.5, 2.0, 0.5], [1.5, 2.0, 0.5]], "points": 7},
                      "loads.torque_a": {"uniform": [[-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]], "points": 3}}}},
    "some refused": {"loads": {"torque_b": [0.1, 0.05, -0.2]},
                     "ensemble": {"vary": {"initial.omega_b": {"lognormal": [[1.0, 2.0, 0.5], [150.0, 0.0, 0.0]]}}}},
    "all refused": {"loads": {"torque_b": [1e300, 0.0, 0.0]}},
}  # fmt: skip
"""By name: what is not that of BODY."""


@pytest.mark.parametrize("name", UNDRIVEN)
def test_whole_runs_whose_outputs_are_interpolated(monkeypatch, name):
    vary = {"initial.omega_b": {"normal": [[1.0, 2.0, 0.5], [0.5] * 3]}}
    tables = BODY | {"outputs": {"quantities": ["quaternion", "omega_b"]}, "ensemble": {"vary": vary}} | UNDRIVEN[name]
    scene = scene_of(tables | {"loads": {"gravity_a": [0.0] * 3} | tables["loads"]})
    planned, one_by_one, left = replace(whole_series(scene, 12, 1e-9), interpolated=True, cost=1e3), loops.run_alone, []

    def run_alone(*given):
        left.append(len(given[-1]))
        one_by_one(*given)

    monkeypatch.setattr(loops, "run_alone", run_alone)  # of those that lanes leave
    lanes, alone = both(monkeypatch, scene, planned)
    assert left == ([21] if name in ("a force in b", "all refused") else [len(lanes.failed)] * bool(lanes.failed))
    assert_same(lanes, alone)
    few, most = {"some refused": (1, 20), "all refused": (21, 21)}.get(name, (0, 0))
    assert few <= len(lanes.failed) <= most
    stepped = rbfmu.run_ensemble(scene, planned=replace(planned, interpolated=False), progress=False)
    assert stepped.failed == lanes.failed
    for quantity in scene.outputs.names:
        np.testing.assert_allclose(stepped.all[quantity], lanes.all[quantity], rtol=1e-7, atol=1e-7)
    ends = rbfmu.run_ensemble(scene.replace({"ensemble.keep": ["final"]}), planned=planned, progress=False)
    for k in sorted({0, 7, 20} - set(lanes.failed)):
        own = rbfmu.simulate(member(scene, draw(scene, 0, 21), k), planned=planned)
        for quantity in scene.outputs.names:
            assert own.quantities[quantity].tobytes() == lanes.all[quantity][k].tobytes()
            assert ends.final[quantity][k].tobytes() == lanes.all[quantity][k, -1].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spring_pendulum", "drone"])
def test_shipped_scenes(monkeypatch, name):
    scene = rbfmu.load_scene(SCENES / "formulas" / f"{name}.toml")
    rates = scene.initial.omega_b
    vary = {"initial.omega_b": {"normal": [[*rates], [0.1] * 3]}}
    tables = scene.to_dict() | {"ensemble": {"runs": 10, "seed": 1, "keep": ["all"], "vary": vary}}
    assert_same(*both(monkeypatch, rbfmu.Scene.from_dict(tables)))
