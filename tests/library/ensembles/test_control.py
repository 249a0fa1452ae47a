"""Members whose ports are driven, by tables and by a controller with noise, have the bits of single runs anywhere."""

import concurrent.futures as cf
import multiprocessing
from functools import partial
from pathlib import Path
from threading import Lock
from types import MethodType, ModuleType

import numpy as np
import pytest
from numba import config, njit

import rbfmu
from rbfmu import Controller, simulation
from rbfmu.ensembles import running
from rbfmu.ensembles.control import NONE, digest
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.runs.inputs import size_of
from tests.library.ensembles.test_resuming import StopError, stopped_after
from tests.support.ensembles.satellite import assert_same

RUNS, SEED, STEPS = 20, 3, 10
TABLES = {
    "body": {"mass": 5.0, "inertia": [2.0, 2.5, 3.0]},
    "initial": {"omega_b": [0.1, -0.2, 0.15]},
    "loads": {"gravity_a": [0.0] * 3},
    "inputs": {"ports": ["torque_b", "force_a"]},
    "outputs": {"quantities": ["quaternion", "omega_b", "velocity"]},
    "run": {"start": 1.0, "stop": 5.9, "step": 0.5, "accuracy": 1e-6},
    "ensemble": {"runs": RUNS, "seed": SEED, "keep": ["all", "statistics"], "vary": {
        "body.inertia": {"relative": 0.02}, "initial.omega_b": {"normal": [[0.1, -0.2, 0.15], [0.02] * 3]}}},
}  # fmt: skip
FORMULAS = {
    **TABLES,
    "inputs": {"ports": ["force_a", {"name": "dipole", "size": 3}, {"name": "thrust", "size": 1}]},
    "outputs": {"quantities": ["quaternion", "omega_b"], "spin": {"value": "norm(omega_b)", "unit": "rad/s"}},
    "loads": {"gravity_a": [0.0] * 3, "torque_b": "cross(dipole, [0.1, 0.0, 0.2])", "force_b": "[thrust, 0, 0]"},
}
GAIN = 0.3
TIMED = {"torque_b": (np.array([0.0, 2.3, 2.5, 4.2]), np.array([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3], [0, 0, 0]]))}


@njit
def damp(t, outputs, state, inputs, noise):
    """Damp the rates that a sensor with noise shows, with a share of their sum and a clock in it."""
    for j in range(3):
        state[j] += outputs[4 + j] + 0.01 * noise[j]
        inputs[j] += -GAIN * outputs[4 + j] - 0.02 * state[j] + 0.001 * t
        inputs[3 + j] = 0.1 * noise[j]


DAMPED = Controller(damp, state=[0.0, 0.0, 0.1], noise=3)
TO_THE_END = {"torque_b": (np.append(TIMED["torque_b"][0], 5.9), np.vstack([TIMED["torque_b"][1], [0.0, 0.1, 0.0]]))}


def until_the_end(i):
    """Drive each member by a table of its own that has a row where the run ends."""
    rows = [[0.1 * i, 0, 0], [0, 1, 0], [0, 0, 0.1]]
    return {"force_a": (np.array([-9.0, 1.0 + 0.1 * i, 5.9]), np.array(rows))} if i % 3 else {}


def number_of(i):
    """Drive each member by a table of its own, with rows at other times; some have none."""
    return {"force_a": (np.array([-9.0, 1.0 + 0.3 * i]), np.array([[0.1 * i, 0, 0], [0, 1, 0]]))} if i % 3 else {}


@pytest.fixture(scope="module")
def scene():
    return rbfmu.Scene.from_dict(TABLES, "driven")


def run(scene, planned, **options):
    return rbfmu.run_ensemble(scene, **{"executor": 1, "progress": False, "planned": planned} | options)


def assert_row(found, i, shown):
    """Member i has these rows of quantities, to the bit, and not those of another member."""
    assert not found.failed
    for name, rows in shown.items():
        assert found.all[name][i].tobytes() == np.array(rows).tobytes(), (name, i)
    assert found.all["omega_b"][i - 1].tobytes() != np.array(shown["omega_b"]).tobytes()


def looped(monkeypatch, scene, planned, controller, i, table=()):
    """Return a member's quantities by a plain loop over a Simulator, beside which the controller is called.

    table: torque_b, a row a step.
    """
    monkeypatch.setattr(simulation, "plan", lambda given: planned.of_scene(given))
    one, names = rbfmu.Simulator(member(scene, draw(scene, 0, RUNS), i)), scene.outputs.names
    state, noise = np.array(controller.state), controller.noise_of(SEED, i, STEPS)
    ends = np.cumsum([size_of(scene, port) for port in scene.inputs.ports])
    inputs, rows = np.zeros(ends[-1]), [[getattr(one, name) for name in names]]
    for k in range(STEPS):
        if len(table):
            inputs[:3] = table[k]
        controller.function(one.time, np.hstack(rows[-1]), state, inputs, noise[k])
        values = dict(zip(scene.inputs.ports, np.split(inputs, ends[:-1]), strict=True))
        last = scene.run.stop - one.time if k == STEPS - 1 else None  # which is shorter than the others
        one.step(last, **{port: x if len(x) > 1 else x[0] for port, x in values.items()})
        rows.append([getattr(one, name) for name in names])
    return dict(zip(names, zip(*rows, strict=True), strict=True))


# The bits of single runs


@pytest.mark.parametrize("inputs", [TO_THE_END, until_the_end], ids=["one table", "a table each"])
@pytest.mark.parametrize("interpolate", ["hold", "linear"])
def test_members_under_tables_have_the_bits_of_single_runs(scene, planned, inputs, interpolate):
    """Also of what inputs change at once."""
    scene = scene.replace({"outputs.quantities": ["omega_b", "alpha_b", "acceleration"]})
    found = run(scene, planned, inputs=inputs, interpolate=interpolate)
    for i in (0, 1, 2, 19):
        table, one = inputs(i) if callable(inputs) else inputs, member(scene, draw(scene, 0, RUNS), i)
        assert_row(found, i, rbfmu.simulate(one, planned=planned, inputs=table, interpolate=interpolate).quantities)


def test_linear_tables_are_followed_where_rates_are_prescribed_too():
    tables = {
        "inputs": {"ports": ["omega_b"]},
        "run": {"stop": 2.0, "step": 0.5},
        "ensemble": {"runs": 3, "vary": {"initial.attitude": {"rotvec_deg": 1.0}}},
    }
    steered = rbfmu.Scene.from_dict(tables, "steered")
    table = {"omega_b": ([0.0, 2.0], [[0.1, 0.2, 0.3], [0.5, -0.1, 0.0]])}
    planned = plan_ensemble(steered)
    found = run(steered, planned, inputs=table, interpolate="linear")
    alone = rbfmu.simulate(member(steered, draw(steered, 0, 3), 2), inputs=table, interpolate="linear", planned=planned)
    assert found.final["quaternion"][2].tobytes() == alone.quaternion[-1].tobytes()


def test_members_under_a_controller_have_the_bits_of_a_plain_loop(scene, planned, monkeypatch):
    found = run(scene, planned, controller=DAMPED)
    for i in (1, 2, 17):
        assert_row(found, i, looped(monkeypatch, scene, planned, DAMPED, i))


@pytest.mark.thorough
def test_scenes_with_formulas_and_inputs_of_ones_own_as_well(monkeypatch):
    scene = rbfmu.Scene.from_dict(FORMULAS, "dipoles")
    assert scene.inputs.ports == ("force_a", "dipole", "thrust")

    def push(t, outputs, state, inputs, noise):
        inputs[3:6] = -outputs[4:7] * GAIN + 0.1 * noise[:3]
        inputs[6] = noise[3] + outputs[7]

    planned, controller = plan_ensemble(scene), Controller(push, noise=4)
    assert_row(run(scene, planned, controller=controller), 5, looped(monkeypatch, scene, planned, controller, 5))


def test_a_controller_adds_to_what_a_table_gives(scene, planned, monkeypatch):
    table = np.linspace(-0.1, 0.1, 3 * STEPS).reshape(STEPS, 3)
    found = run(scene, planned, inputs={"torque_b": table}, controller=DAMPED)
    assert_row(found, 4, looped(monkeypatch, scene, planned, DAMPED, 4, table))


def test_a_row_between_two_points_acts_from_its_time_on_and_a_controller_keeps_other_ports(scene, planned):
    """The force of the table changes within a step, over which the controller's torque stays."""

    def twist(t, outputs, state, inputs, noise):
        inputs[0] = 0.1

    steady = {"torque_b": np.tile([0.1, 0.0, 0.0], (STEPS, 1))}
    both = run(scene, planned, inputs=number_of, controller=twist)
    tables = run(scene, planned, inputs=lambda i: number_of(i) | steady)
    for name, rows in tables.all.items():  # a series at the start knows the torque of a table, not of a controller
        np.testing.assert_allclose(both.all[name], rows, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("interpolate", ["hold", "linear"])
def test_what_a_controller_adds_lasts_while_rows_of_another_port_cut_the_step(scene, planned, interpolate):
    """A torque along a principal axis of a body at rest: the rate is its integral over the moment of inertia."""

    def add(t, outputs, state, inputs, noise):
        inputs[0] += 0.5

    still = {"initial.omega_b": [0.0] * 3, "ensemble.vary": {"initial.omega_b": {"normal": [[0.0] * 3, 1e-12]}}}
    end = 0.8 if interpolate == "linear" else 0.1
    begin = 0.1 + (end - 0.1) / 5.9  # of the run, at 1 s
    torque = [0.0, 5.9], [[0.1, 0.0, 0.0], [end, 0.0, 0.0]]
    force = [0.0, 2.1, 2.2, 4.9, 5.9], np.zeros((5, 3))
    given = {"inputs": {"torque_b": torque, "force_a": force}, "interpolate": interpolate, "controller": add}
    found = run(scene.replace(still), planned, **given)
    assert found.all["omega_b"][3, -1, 0] == pytest.approx((0.5 * (begin + end) + 0.5) * 4.9 / 2.0, rel=1e-9)


def test_ends_alone_are_those_of_whole_runs(scene, planned):
    ends = run(scene.replace({"ensemble.keep": ["final"]}), planned, controller=DAMPED)
    assert ends.final["omega_b"].tobytes() == run(scene, planned, controller=DAMPED).all["omega_b"][:, -1].tobytes()


# Wherever they run


def in_chunks_of_four(monkeypatch):
    monkeypatch.setattr(running, "members_of_a_chunk", lambda *given: 4)


EVERYTHING = {"inputs": number_of, "controller": DAMPED}


def test_threads_give_the_same_bits(scene, planned, monkeypatch):
    whole = run(scene, planned, **EVERYTHING)
    in_chunks_of_four(monkeypatch)
    found = run(scene, planned, executor=3, **EVERYTHING)
    for name, rows in whole.all.items():  # statistics are merged by chunks, and members in one have the same bits
        assert found.all[name].tobytes() == rows.tobytes()


@pytest.mark.thorough
def test_processes_give_the_same_bits(scene, planned, monkeypatch):
    in_chunks_of_four(monkeypatch)
    whole = run(scene, planned, **EVERYTHING)
    with cf.ProcessPoolExecutor(2, multiprocessing.get_context("forkserver")) as pool:
        assert_same(whole, run(scene, planned, executor=pool, **EVERYTHING))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of Dask's own
def test_workers_of_dask_are_sent_functions_that_stand_in_no_module(scene, planned, monkeypatch):
    distributed = pytest.importorskip("distributed")
    in_chunks_of_four(monkeypatch)
    share = 0.5

    def push(t, outputs, state, inputs, noise):
        inputs[3:] = share * outputs[7:10] + noise

    options = {"inputs": lambda i: number_of(i + 1), "controller": Controller(push, noise=3)}
    with distributed.Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        assert_same(run(scene, planned, **options), run(scene, planned, executor=client, **options))


def test_what_was_stopped_goes_on_under_the_same_control_alone(scene, planned, tmp_path, monkeypatch):
    in_chunks_of_four(monkeypatch)
    store, options = tmp_path / "store.npz", {"inputs": TO_THE_END, "controller": DAMPED}
    with monkeypatch.context() as patch:
        stopped_after(patch, 2)
        with pytest.raises(StopError):
            run(scene, planned, store=store, **options)
    other = {"torque_b": (TO_THE_END["torque_b"][0], TO_THE_END["torque_b"][1] + 1e-9)}
    for named, wrong in (("controller", {"controller": Controller(damp, [0.0, 0.0, 0.2], 3)}),
                         ("controller", {"controller": None}), ("inputs", {"inputs": other}),
                         ("inputs", {"interpolate": "linear"})):  # fmt: skip
        with pytest.raises(ValueError, match=rf"of another ensemble: {named} = .*: expected .*, with which the store"):
            run(scene, planned, store=store, resume=True, **options | wrong)
    assert_same(run(scene, planned, **options), run(scene, planned, store=store, resume=True, **options))


def test_a_digest_knows_all_that_a_function_computes_by():
    def made(source, **names):
        names = {"np": np, **names}
        exec(compile(source, "some file", "exec"), names)
        return names["f"]

    source = "def f(x, a=1):\n    return [helper(y) + gain for y in x]"
    same = {"gain": 2.0, "helper": made("def f(y):\n    return np.sin(y)")}
    known = digest(made(source, **same))
    assert known == digest(made("\n\n" + source, **same, unused=1)) == digest(njit(made(source, **same)))
    other = made("def f(y):\n    return np.cos(y)")
    others = [
        made(source, **same | {"gain": 2.5}), made(source, **same | {"helper": other}),
        made(source, **same | {"gain": np.array([2.0])}), made(source.replace("a=1", "a=2"), **same),
        made(source.replace("a=1", "*, a=1"), **same), made(source.replace("a=1", "*, a=2"), **same),
        made(source.replace("+", "-"), **same), made(source.replace("for y", "+ 1.0 for y"), **same),
    ]  # fmt: skip
    assert len({known, *map(digest, others)}) == 1 + len(others)

    def of_module(gain):
        module = ModuleType("gains")
        module.gain, module.own = gain, module
        return made("def f(x):\n    return x * gains.gain", gains=module)

    assert digest(of_module(1.0)) == digest(of_module(1.0)) != digest(of_module(2.0))

    def within(gain):
        return lambda x: gain * x

    assert digest(within(1.0)) == digest(within(1.0)) != digest(within(2.0))
    assert digest(partial(within(1.0), 3)) == digest(partial(within(1.0), 3)) != digest(partial(within(2.0), 3))
    assert len({digest(partial(within(1.0), *x, **named)) for x, named in (((), {}), ((3,), {}), ((), {"x": 3}))}) == 3
    assert (
        digest(MethodType(within(1.0), 3)) == digest(MethodType(within(1.0), 3)) != digest(MethodType(within(1.0), 4))
    )
    assert digest(made("def f(x):\n    return f(x - 1)")) != digest(made("def f(x):\n    return f(x - 2)"))


def test_what_cannot_be_pickled_drives_members_without_a_store(scene, planned, tmp_path):
    lock = Lock()

    def none(number):
        with lock:
            return {}

    assert_same(run(scene, planned, inputs=none), run(scene, planned))
    with pytest.raises(ValueError, match=r"what drives the ports: cannot pickle .*: expected numbers and functions"):
        run(scene, planned, store=tmp_path / "store.npz", inputs=none)


# Noise


def test_noise_is_a_members_own_and_begins_alike_in_longer_runs():
    """No number is that of two members, as where one's began a number of words after that of the one before."""
    few, more = DAMPED.noise_of(SEED, 7, 10), DAMPED.noise_of(SEED, 7, 4000)
    assert few.tobytes() == more[:10].tobytes()
    streams = [more, DAMPED.noise_of(SEED, 8, 4000), DAMPED.noise_of(SEED + 1, 7, 4000)]
    rows = np.hstack(streams)
    assert len(np.unique(rows)) == rows.size
    assert np.abs(np.corrcoef(rows.T) - np.eye(9)).max() < 5.0 / np.sqrt(4000)
    assert np.abs(rows.mean(axis=0)).max() < 5.0 / np.sqrt(4000)
    assert np.abs(rows.var(axis=0) - 1.0).max() < 5.0 * np.sqrt(2.0 / 4000)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_what_stands_for_no_controller_is_compiled_once_for_all_processes():
    """Half a second of each `rbfmu ensemble` went into a function that does nothing."""
    assert NONE.compiled() is NONE.function
    assert Path(NONE.function._cache._cache_file._index_path).exists()
