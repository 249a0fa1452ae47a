"""A scene stepped by hand: the bits of a run, states that are saved and restored, and what is refused."""

import copy
import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

import rbfmu
from rbfmu import simulation
from rbfmu_kernels.buffer import OK
from tests.support.paths import SCENES

FILE = SCENES / "controlled_satellite.toml"
SATELLITE = rbfmu.load_scene(FILE).replace({"run.stop": 6.0})


def torques(n, seed=1):
    return np.random.default_rng(seed).normal(scale=0.05, size=(n, 3))


def state_of(sim):
    return {name: getattr(sim, name) for name in sim.scene.outputs.quantities}


def assert_same(one, other):
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


def test_steps_have_the_bits_of_a_run_with_the_same_inputs():
    sim, u = rbfmu.Simulator(FILE), torques(600)
    u[0] = 0.0  # a run has its first inputs at initialisation, a simulator none
    run = rbfmu.simulate(FILE, inputs={"torque_b": u})
    for k in range(600):
        assert sim.time == run.time[k]
        assert_same({n: v[k] for n, v in run.quantities.items()}, state_of(sim))
        sim.step(torque_b=u[k])
    assert (sim.time, sim.status) == (run.time[-1], 0)
    sim.step()
    assert sim.status == 2  # past the scene's stop


@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_an_input_is_any_three_numbers_and_keeps_its_last_value(kind):
    one, other, u = rbfmu.Simulator(SATELLITE), rbfmu.Simulator(SATELLITE), [0.1, -0.2, 0.3]
    one.step(torque_b=kind(u))
    one.step()
    other.step(0.1, torque_b=u)
    other.step(torque_b=u)
    np.testing.assert_array_equal(one.quaternion, other.quaternion)


def test_what_was_read_stays_as_it_was():
    sim = rbfmu.Simulator(SATELLITE)
    q = sim.quaternion
    kept = q.copy()
    sim.step()
    np.testing.assert_array_equal(q, kept)
    q[:] = 0.0
    assert sim.quaternion.any()


def test_a_restored_state_goes_on_with_the_same_bits_in_another_simulator():
    sim, other = rbfmu.Simulator(SATELLITE), rbfmu.Simulator(SATELLITE)
    for u in torques(20):
        sim.step(torque_b=u)
    sim.step(0.037)
    saved = sim.save()
    for u in torques(5, seed=2):
        sim.step(torque_b=u)
    other.restore(saved)
    assert other.time != sim.time
    for u in torques(5, seed=2):
        other.step(torque_b=u)
    assert other.time == sim.time
    assert_same(state_of(sim), state_of(other))
    assert other.save() == sim.save()


def test_what_is_no_state_of_the_scene_is_refused_and_changes_nothing():
    sim = rbfmu.Simulator(SATELLITE)
    sim.step()
    before, longer = sim.save(), rbfmu.Simulator(SATELLITE.replace({"run.stop": 7.0})).save()
    damaged = before[:-9] + bytes([before[-9] ^ 64]) + before[-8:]  # with which a step could end the process
    for wrong in (b"", before[:-1], b"x" + before[1:], longer, damaged):
        with pytest.raises(ValueError, match=f"these {len(wrong)} bytes are no state of controlled_satellite"):
            sim.restore(wrong)
        assert sim.save() == before


@pytest.mark.parametrize("h", [0.0, -0.1, math.nan, math.inf, 1e-300])
def test_a_step_of_no_size_is_refused_and_changes_nothing(h):
    sim = rbfmu.Simulator(SATELLITE)
    sim.step(0.5)
    before = sim.save()
    with pytest.raises(rbfmu.SimulationError, match=r"controlled_satellite: the step from t = 0.5 s by .* was refused"):
        sim.step(h, torque_b=[1.0, 2.0, 3.0])
    assert sim.save() == before


def test_numbers_are_floats_and_the_clock_is_one_whatever_the_step_is():
    sim, h = rbfmu.Simulator(SATELLITE.replace({"outputs.quantities": ["kinetic_energy"]})), np.float32(0.1)
    for _ in range(3):
        sim.step(h)
    assert type(sim.time) is type(sim.kinetic_energy) is float
    assert sim.time == float(h) + float(h) + float(h)
    assert sim.kinetic_energy > 0.0


@pytest.mark.parametrize("parts", [(0.05,), (0.05, 0.05), (0.13,), (0.1 - 1e-12,)])
def test_a_step_of_no_given_size_goes_to_the_next_communication_point(parts):
    sim, h = rbfmu.Simulator(SATELLITE), 0.1
    for _ in range(3):
        sim.step()
    for part in parts:
        sim.step(part)
    for point in (5, 6) if sum(parts) > h - 1e-9 else (4, 5):
        sim.step()
        assert sim.time == point * h


def test_the_last_step_to_a_communication_point_ends_where_the_run_does():
    """It went on to a time beyond the scene's stop where that is no whole number of steps."""
    scene = SATELLITE.replace({"run": {"start": -0.2, "stop": 0.8, "step": 0.3}})
    sim, run = rbfmu.Simulator(scene), rbfmu.simulate(scene)
    rows = [sim.values()]
    while sim.time < scene.run.stop:
        sim.step()
        rows.append(sim.values())
    assert [row["time"] for row in rows] == run.time.tolist() == pytest.approx([-0.2, 0.1, 0.4, 0.7, 0.8])
    np.testing.assert_array_equal([row["quaternion"] for row in rows], run.quaternion)
    assert sim.status == 0
    sim.step()
    assert (sim.time, sim.status) == (pytest.approx(1.0), 2)


def test_a_step_that_leaves_the_range_of_numbers_is_refused_and_changes_nothing():
    sim, other = rbfmu.Simulator(SATELLITE), rbfmu.Simulator(SATELLITE)
    with pytest.raises(rbfmu.SimulationError, match="no finite motion, or none that the accuracy allows"):
        sim.step(torque_b=[1e300, 1e300, 1e300])
    for _ in range(3):
        assert sim.time == other.time
        assert_same(state_of(sim), state_of(other))
        sim.step()  # with the input that was before, none
        other.step()


def test_reset_begins_anew_with_the_parameters_that_the_scene_lists():
    scene = SATELLITE.replace({"inputs.parameters": ["omega_b_0", "inertia"]})
    sim = rbfmu.Simulator(scene, omega_b_0=[0.1, 0.2, 0.3])
    np.testing.assert_array_equal(sim.omega_b, [0.1, 0.2, 0.3])
    fresh = sim.save()
    sim.step(torque_b=[1.0, 0.0, 0.0])
    sim.reset(omega_b_0=np.array([0.1, 0.2, 0.3]))
    assert sim.save() == fresh
    sim.reset(inertia=[2.0, 3.0, 4.0])
    sim.step()
    changed = rbfmu.Simulator(scene.replace({"body.inertia": [2.0, 3.0, 4.0]}))
    changed.step()
    np.testing.assert_allclose(sim.omega_b, changed.omega_b, rtol=0, atol=1e-12)


def test_a_scene_may_be_given_by_name():
    one = rbfmu.Scene(body={"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, inputs={"parameters": ["omega_b_0"]})
    assert rbfmu.Simulator(scene=one, omega_b_0=[0, 0, 1]).omega_b.tolist() == [0.0, 0.0, 1.0]


def test_a_name_of_one_s_own_may_be_python_s_usual_name_for_an_object():
    """Python said that it was given twice."""
    own = {"constants": {"self": 0.1}, "inputs": {"ports": ["torque_b"], "parameters": ["self"]}}
    tables = {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "loads": {"torque_b": "-self*omega_b"}}
    sim = rbfmu.Simulator(rbfmu.Scene.from_dict(tables | own), self=0.2)
    sim.reset(self=0.3)
    port = rbfmu.Scene.from_dict(tables | {"inputs": {"ports": [{"name": "self", "size": 1}]}})
    driven = rbfmu.Simulator(port)
    driven.hold(self=0.2)
    driven.step(self=0.1)
    driven.step_to_event(self=0.1)


@pytest.mark.parametrize(("parameters", "said"), [
    ({"k": [1.0, 2.0, 3.0]}, r"k = \[1.0, 2.0, 3.0\]: expected a number"), ({"v": 2.0}, "v = 2.0: expected 3 numbers"),
    ({"s_0": np.ones(3)}, r"s_0 = \[1.0, 1.0, 1.0\]: expected a number"),
])  # fmt: skip
def test_parameters_of_one_s_own_keep_their_shape(parameters, said):
    scene = rbfmu.Scene.from_dict({
        "body": {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, "constants": {"k": 0.3, "v": [1.0, 2.0, 3.0]},
        "states": {"s": {"start": 1.0, "rate": "-0.1*s"}}, "inputs": {"parameters": ["k", "v", "s_0"]},
        "outputs": {"quantities": ["omega_b"], "of_k": "k*t", "of_v": "v*t", "of_s": "2*s"},
        "run": {"stop": 5.0, "step": 0.5},
    })  # fmt: skip
    with pytest.raises(rbfmu.SceneError, match=said):
        rbfmu.Simulator(scene, **parameters)


def test_a_quantity_that_is_not_asked_for_is_named_with_those_that_are():
    with pytest.raises(
        AttributeError, match=r"no quantity 'position' is asked for .*; it has quaternion, omega_b, rpy"
    ):
        _ = rbfmu.Simulator(SATELLITE).position


@pytest.mark.parametrize("name", ["torque_b", "mass", "omega_b", "anything"])
def test_an_attribute_that_would_do_nothing_is_refused(name):
    """`sim.torque_b = ...` was kept beside the motion, which it did not drive."""
    simulator = rbfmu.Simulator(SATELLITE)
    with pytest.raises(AttributeError, match=r"Simulator' object has no"):
        setattr(simulator, name, [1.0, 0.0, 0.0])


@pytest.mark.thorough
def test_simulators_of_one_scene_run_in_threads_side_by_side():
    def run(seed):
        sim = rbfmu.Simulator(SATELLITE)
        for u in torques(300, seed):
            sim.step(torque_b=u)
        return sim.save()

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, range(8)))
    assert together == [run(seed) for seed in range(8)]
    assert len(set(together)) == 8


def test_the_compiled_step_works_on_its_buffer():
    scene = SATELLITE
    planned = rbfmu.plan(scene)
    step, z = rbfmu.compiled_step(scene, planned)
    sim, blocks = rbfmu.Simulator(scene), planned.kernels.BLOCKS
    z[blocks["torque_b"]] = [0.1, 0.2, 0.3]
    sim.step(torque_b=[0.1, 0.2, 0.3])
    assert step(z, sim.time) == OK
    np.testing.assert_array_equal(z[blocks["quaternion"]], sim.quaternion)


STEPPED = [
    ([1.0, 2.0], r"torque_b = \[1.0, 2.0\]: expected 3 finite numbers \(N m\)"),
    ([1.0, math.nan, 2.0], r"torque_b = \[1.0, nan, 2.0\]: expected 3 finite numbers"),
    ("abc", 'torque_b = "abc": expected 3 finite numbers'), (1.0, r"torque_b = 1.0: expected 3 finite numbers"),
    ({1.0, 2.0, 3.0}, r"torque_b = .*: expected 3 finite numbers"), ([10**400, 0, 0], "numbers whose sum is finite"),
    (np.zeros((3, 1)), r"of shape \(3,\) and not \(3, 1\)"), (lambda t: t, "torque_b = a function: expected 3 finite"),
]  # fmt: skip
LENGTHS = [
    ("0.1", r'h = "0.1": expected a number \(s\)'), ([0.1], r"h = \[0.1\]"), (10**400, "h = 1000"),
    ([0.0, 0.0, 1.0], r"h = \[0.0, 0.0, 1.0\]: expected a number \(s\); inputs are"),
]  # fmt: skip
PARAMETERS = [
    ({"mass": 2.0}, "mass = 2.0: expected 50.0, for which the model was planned; list 'mass' in inputs.par"),
    ({"weight": 2.0}, "parameter 'weight': expected one of mass, inertia"), ({"inertia": [1, 1, 9.0]}, "body.inertia"),
    ({"omega_b_0": [1.0]}, r"initial.omega_b = \[1.0\]: expected 3 numbers"),
    ({"omega_b_0[1]": 1.0}, "'omega_b_0.1.': expected omega_b_0, with all"),
    ({"quaternion": [1, 0, 0, 0]}, "'quaternion': expected quaternion_0, with all"),
    ({"size": 1.0}, "parameter 'size': expected one of mass, inertia, "),
]  # fmt: skip


@pytest.mark.parametrize(("call", "error", "said"), [
    *((partial(rbfmu.Simulator.step, torque_b=given), ValueError, said) for given, said in STEPPED),
    *((partial(rbfmu.Simulator.step, h=h, torque_b=[1.0, 2.0, 3.0]), TypeError, said) for h, said in LENGTHS),
    *((partial(rbfmu.Simulator.step, **given, force_a=[1.0, 2.0, 3.0]), ValueError, "input 'force_a': expected one of")
      for given in ({}, {"torque_b": [1.0, 2.0, 3.0]})),
    *((partial(rbfmu.Simulator.reset, **given), rbfmu.SceneError, said) for given, said in PARAMETERS),
])  # fmt: skip
def test_what_is_given_wrongly_is_named_with_what_was_expected_and_changes_nothing(call, error, said):
    sim = rbfmu.Simulator(SATELLITE)
    sim.step(torque_b=[0.1, 0.2, 0.3])
    before = sim.save()
    with pytest.raises(error, match=said):
        call(sim)
    assert sim.save() == before


def test_a_loop_becomes_a_result():
    scene = SATELLITE.replace({"outputs.turning": {"value": "norm(omega_b)", "unit": "rad/s"}})
    sim = rbfmu.Simulator(scene)
    rows = [sim.values()]
    for _ in range(3):
        sim.step()
        rows.append(sim.values())
    looped, run = rbfmu.Result.of_rows(rows), rbfmu.simulate(scene).until(sim.time)
    assert looped.turning[-1] == sim.turning
    assert_same(run.columns(), looped.columns())
    assert looped.units == run.units
    with pytest.raises(ValueError, match=r"rows = \[\]: expected at least one"):
        rbfmu.Result.of_rows([])


def test_a_copy_goes_its_own_way_and_is_not_planned_again(monkeypatch):
    """It shared the memory of the first, which went on with it but for its time."""
    sim = rbfmu.Simulator(SATELLITE)
    monkeypatch.delattr(simulation, "plan")
    sim.step(torque_b=[0.1, 0.2, 0.3])
    for copied in (copy.copy(sim), copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))):
        before, time = state_of(sim), sim.time
        copied.step()
        assert_same(state_of(sim), before)
        assert (sim.time, copied.time) == (time, 2 * time)
    sim.step()
    assert_same(state_of(sim), state_of(copied))


def test_after_an_interrupt_within_compiled_code_the_state_is_gone_back_to():
    """2026-11-28: the state had moved and the time had not, so that what followed was wrong without a word."""
    one = rbfmu.Simulator(rbfmu.Scene.from_dict({"body": {"mass": 1.0, "inertia": [1.0, 1.5, 2.2]},
                          "initial": {"omega_b": [0.4, 2.0, 0.3]}, "run": {"stop": 2.0, "step": 0.5}}))  # fmt: skip
    one.step()
    saved, step = one.save(), one._step

    def interrupted(*args):
        step(*args)
        raise KeyboardInterrupt

    one._step = interrupted
    with pytest.raises(KeyboardInterrupt):
        one.step()
    one._step = step
    for h in (None, 0.1):
        with pytest.raises(rbfmu.SimulationError, match=r"an interrupt came within .* `restore` goes on"):
            one.step(h)
    one.restore(saved)
    one.step()
    assert one.time == 1.0
