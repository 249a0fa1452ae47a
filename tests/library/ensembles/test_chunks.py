"""A chunk's members have the bits of single runs, whatever the model, and say what a single run says."""

import math
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from numba import config

from rbfmu import SceneError, SimulationError, load_scene, simulate
from rbfmu.ensembles import chunks, loops
from rbfmu.ensembles.chunks import Work, members_of_a_chunk, run_chunk
from rbfmu.ensembles.loops import AT_ONCE
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.models.registry import MODELS
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from tests.support.paths import SCENES
from tests.support.scenes.model_cases import GRAVITY, NO_GRAVITY, TOP, TRIAXIAL, plan_by_hand

DISC = {"mass": 2.0, "inertia": [1.0, 1.0, 1.3]}
SPIN, TUMBLE = {"omega_b": [0.0, 0.0, 2.0]}, {"omega_b": [0.3, -0.2, 1.0]}
MASS = {"body.mass": {"normal": [2.0, 0.05]}}
START = {"initial.position": {"uniform": [[-1.0] * 3, [1.0] * 3]}, "initial.attitude": {"rotvec_deg": 5.0}}
RATES = {"initial.omega_b": {"normal": [[0.3, -0.2, 1.0], [0.1] * 3]}}
ANY_INERTIA = {"body.inertia": {"relative": 0.02, "axes_deg": 1.0}}
ANYTHING = {
    "loads.torque_b": {"normal": [[0.1, 0.2, 0.1], [0.01] * 3]}, "loads.damping_b": {"relative": 0.1},
    "body.r_oc_b": {"normal": [[0.0, 0.0, 0.0], [0.01] * 3]}, "initial.velocity": {"normal": [[0, 0, 0], [1.0] * 3]},
}  # fmt: skip
PENDULUM = {"mass": 2.0, "inertia": [1.0, 1.2, 1.4], "r_oc_b": [0.0, 0.3, 0.0], "pivot": True}
SWING = {"attitude": {"rotvec": [0.7, 0.0, 0.0]}}
EVERYTHING = {
    "gravity_a": [0.0, 0.0, -1.0], "force_b": [1.0, 0.5, 0.2], "torque_b": [0.1, 0.2, 0.1],
    "damping_b": [0.1, 0.1, 0.1],
}  # fmt: skip
FREELY = MASS | START
SERIES = "body under loads, by series"
TWIST = {**NO_GRAVITY, "torque_b": [0.0, 0.0, 0.3]}
CASES = {
    "no rotation": (TRIAXIAL, {}, NO_GRAVITY, FREELY),
    "constant rate": (TRIAXIAL, SPIN, NO_GRAVITY, FREELY | {"initial.omega_b": {"normal": [[0, 0, 2], [0, 0, 1]]}}),
    "angular momentum": (TRIAXIAL, TUMBLE, {**NO_GRAVITY, "torque_a": [0.1, 0.0, 0.2]}, FREELY),
    "one axis": (TRIAXIAL, SPIN, TWIST, FREELY),
    "undamped pendulum": (PENDULUM, SWING, GRAVITY, MASS),
    "torque-free symmetric body": (DISC, TUMBLE, NO_GRAVITY, FREELY | RATES),
    "symmetric body spun up": (DISC, TUMBLE, TWIST, MASS),
    "torque-free body": (TRIAXIAL, TUMBLE, NO_GRAVITY, FREELY | ANY_INERTIA),
    "one swinging axis": (PENDULUM, SWING, {**GRAVITY, "damping_b": [0.1, 0.1, 0.1]}, MASS),
    "torque-free body, body force": (TRIAXIAL, TUMBLE, {**NO_GRAVITY, "force_b": [0.0, 0.3, 1.0]}, FREELY),
    "symmetric top": (TOP, TUMBLE, GRAVITY, {"initial.attitude": {"rotvec_deg": 5.0}}),
    "body under loads, by series": (TRIAXIAL, TUMBLE, EVERYTHING, FREELY | ANYTHING),
}
SHOWN = {"angular momentum": ["angular_momentum_a"], "symmetric body spun up": ["omega_b"]}


def ensemble_scene(body, initial, loads, vary, shown=("position", "quaternion", "omega_b"), **table):
    tables = {"body": body, "initial": initial, "loads": loads, "outputs": {"quantities": list(shown)}}
    ensemble = {"runs": 9, "seed": 4, "keep": ["all", "statistics"], "vary": vary} | table
    return Scene.from_dict(tables | {"run": {"stop": 2.0, "step": 0.25, "accuracy": 1e-6}, "ensemble": ensemble})


def given_plan(key):
    return plan_by_hand(key, substep=0.02, tolerance=1e-9)


def outcome(scene, samples, row, planned):
    """What a single run gives, or says."""
    try:
        return simulate(member(scene, samples, row), planned=planned).quantities
    except (SceneError, SimulationError) as error:
        return str(error)


def assert_like_single_runs(scene, plan):
    chunk, samples = run_chunk(Work(scene, plan, 2 * AT_ONCE), 0), draw(scene, 0, scene.ensemble.runs)
    for i in range(scene.ensemble.runs):
        single = outcome(scene, samples, i, plan)
        if isinstance(single, str):
            assert chunk.failed[i] == single
            assert all(np.isnan(chunk.arrays[name][i]).all() for name in scene.outputs.names)
            continue
        assert i not in chunk.failed
        for name in scene.outputs.names:
            assert chunk.arrays[name][i].tobytes() == single[name].tobytes(), (name, i)
    return chunk


@pytest.mark.parametrize("model", CASES)
def test_members_have_the_bits_of_single_runs(model):
    body, initial, loads, vary = CASES[model]
    scene = ensemble_scene(body, initial, loads, vary, SHOWN.get(model, ("position", "quaternion", "omega_b")))
    chunk = assert_like_single_runs(scene, given_plan(model))
    assert not chunk.failed
    ends = (chunk.arrays[name][:, -1] for name in scene.outputs.names)
    assert any(len(np.unique(values, axis=0)) > 1 for values in ends) or model in SHOWN  # what varies acts


def test_every_model_is_tried():
    assert set(CASES) == set(MODELS) - {"prescribed rates"}  # which is tried below


def test_attitudes_vary_where_rates_are_prescribed():
    scene = load_scene(SCENES / "gyro_attitude.toml").replace(
        run={"stop": 1.0, "step": 0.25}, ensemble={"runs": 5, "vary": {"initial.attitude": "uniform"}, "keep": ["all"]}
    )
    assert_like_single_runs(scene, plan_ensemble(scene))


BOX = {"mass": 2.0, "shape": {"kind": "box", "sides": [1.0, 1.2, 1.4]}}
FAILING = {  # body, loads, what varies, model, and words of which all that is said has one
    "numbers that no scene has": (
        TRIAXIAL, EVERYTHING,
        {"body.mass": {"normal": [1.0, 1.0]}, "loads.damping_b": {"normal": [[0.1] * 3, [0.1] * 3]}},
        SERIES, ("mass", "damping_b")),
    "a step that is refused": (
        TRIAXIAL, EVERYTHING, {"loads.torque_b": {"lognormal": [[1e150] * 3, [40.0] * 3]}},
        SERIES, ("was refused: not finite",)),
    "sizes that no shape has, though their inertia is possible": (
        BOX, NO_GRAVITY, {"body.shape.sides": {"normal": [[1.0, 1.2, 1.4], [1.0] * 3]}},
        "torque-free body", ("body.shape.sides",)),
}  # fmt: skip


def test_members_that_cannot_be_simulated_say_why_and_the_rest_goes_on():
    for body, loads, vary, model, words in FAILING.values():
        chunk = assert_like_single_runs(ensemble_scene(body, TUMBLE, loads, vary, runs=40), given_plan(model))
        assert 0 < len(chunk.failed) < 40 + (model == SERIES)
        assert all(any(word in text for word in words) for text in chunk.failed.values())
        assert chunk.summary.members == 40 - len(chunk.failed)


def test_torques_about_a_beams_own_axis_are_refused_as_in_its_scene():
    beam = {"mass": 2.0, "inertia": [0.0, 1.0, 1.0]}
    loads = {**NO_GRAVITY, "torque_b": [0.0, 0.1, 0.1]}
    vary = {"loads.torque_b": {"normal": [[0.0, 0.1, 0.1], [0.1, 0.0, 0.0]]}}
    scene = ensemble_scene(beam, {}, loads, vary)
    chunk = run_chunk(Work(scene, given_plan(SERIES), 16), 0)
    assert len(chunk.failed) == 9
    assert "no torque about (1, 0, 0)" in chunk.failed[0]


def test_members_side_by_side_have_the_bits_of_single_runs(monkeypatch):
    """Also where some turn too fast to begin, or to be followed; one alone, and other models, are left to the loop."""
    taken = []

    def noted(*arguments, **options):
        taken.append(loops.run_in_lanes(*arguments, **options))
        return taken[-1]

    monkeypatch.setattr(chunks, "run_in_lanes", noted)
    loops.compile_lanes(LOADED_TAYLOR).join()
    body, initial, loads, vary = CASES[SERIES]
    wild = {"initial.omega_b": {"lognormal": [[1.0, 1.0, 1.0], [90.0, 90.0, 90.0]]}}
    for varied, runs in ((vary, AT_ONCE + 13), (wild, 21), (vary, 1)):
        scene = ensemble_scene(body, initial, loads, varied, runs=runs)
        chunk = assert_like_single_runs(scene, replace(given_plan(SERIES), cost=1e4))
        assert bool(chunk.failed) == (varied is wild)
    assert taken == [True, True, False]
    assert not loops.run_in_lanes(MODELS["torque-free body"].kernels, *[None] * 3)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="lanes are compiled code")
@pytest.mark.parametrize("worth", [0.0, math.inf])
def test_lanes_are_compiled_beside_the_first_members_where_that_pays(monkeypatch, worth):
    begun = []
    monkeypatch.setattr(loops, "has_code", lambda *given: False)
    monkeypatch.setattr(chunks, "compile_lanes", lambda *given: begun.append(given))
    monkeypatch.setattr(chunks, "WORTH_COMPILING", worth)
    scene = ensemble_scene(*CASES[SERIES], runs=21)
    plan = replace(given_plan(SERIES), cost=1e4)
    chunk = run_chunk(Work(scene, plan, 32), 0)
    assert all(np.isfinite(chunk.arrays[name]).all() for name in scene.outputs.names)
    assert begun == ([] if worth else [(LOADED_TAYLOR, False)])


@pytest.mark.parametrize("found", [True, False], ids=["found on disk meanwhile", "none"])
def test_lanes_that_others_have_found_on_disk_need_no_compiler(found):
    """Who runs by them lets none be compiled, at which a thread that waits for the compiler would end in an error."""

    class Waiting:
        overloads = ()

        def compile(self, signature):
            self.overloads = (signature,) * found
            raise RuntimeError("compilation disabled")

    with nullcontext() if found else pytest.raises(RuntimeError, match="compilation disabled"):
        loops._compile(Waiting(), ("float64",))


@pytest.mark.parametrize(("cost", "runs", "pay"), [(1e4, 10**6, True), (1e4, 1000, False), (90.0, 10**6, False)])
def test_compiling_lanes_pays_where_steps_are_long_and_runs_are_many(cost, runs, pay):
    plan = replace(given_plan(SERIES), cost=cost)
    work = Work(ensemble_scene(*CASES[SERIES], runs=runs), plan, 16)
    assert chunks.compiling_pays(work, 100) == pay


def test_events_that_did_not_happen_have_no_first_time():
    watched = Scene(body=DISC, events={"a": "t - 1", "b": "t - 2"})
    found = chunks._events(watched, np.array([[0.0, 2.0, 0.0, 1.5], [1.0, 0.0, 0.0, 9.0]]))  # counts, and first times
    assert (found["a.count"].tolist(), found["b.count"].tolist()) == ([0, 1], [2, 0])
    np.testing.assert_array_equal(found["a.first"], [np.nan, 0.0])
    np.testing.assert_array_equal(found["b.first"], [1.5, np.nan])


def test_there_are_no_more_chunks_than_members_need():
    for runs, count in ((1, 1), (8, 1), (9, 2), (16, 2)):
        one = Scene(body=DISC, ensemble={"runs": runs, "vary": MASS})
        assert Work(one, plan_by_hand("torque-free body"), 8).chunks == count


def test_chunks_have_the_size_of_their_cost():
    scene = ensemble_scene(*CASES["torque-free body"])

    def size(cost, model="torque-free body", **changes):
        plan = Plan(model, "", 7, cost=cost)
        return members_of_a_chunk(scene.replace({f"{key.replace('__', '.')}": v for key, v in changes.items()}),
                                  plan)  # fmt: skip

    assert size(1e8) == 1
    assert size(3e5) == 32  # of 2.4 ms each, 0.1 s together
    assert size(3e5, ensemble__runs=10**6) == 32
    assert size(3e5, "body under loads, by series") == 64  # of which three are done in the time of one
    assert size(1.0) == 8192
    assert size(1.0, run__step=0.01, ensemble__keep=["statistics"]) == 2048  # at 201 points 32 MB, summed up in place
    assert size(1.0, ensemble__keep=["all"]) == 8192
    assert size(1.0, run__step=0.01, ensemble__keep=["all"]) == 256  # at 201 points 4 MB
    assert size(1.0, run__step=0.01, ensemble__keep=["final"]) == 8192
