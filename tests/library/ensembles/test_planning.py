"""One plan for all members of an ensemble: its model holds for each, and each meets the accuracy asked."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import rbfmu
import rbfmu_fmu
from rbfmu.ensembles import fitting, planning
from rbfmu.ensembles.fitting import _errors, likely_worst
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.variables import Columns
from rbfmu.exceptions import SceneError, SceneWarning
from rbfmu.models.question import Question
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import TIGHTEST
from rbfmu.planning.select import plan
from rbfmu.runs.motion import attitude_error
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT
from tests.library.ensembles.test_control import TABLES as DRIVEN
from tests.support.covering import some_of
from tests.support.ensembles.accuracy import drawn, errors
from tests.support.quadruple import reference
from tests.support.quadruple.driving import outcome

ROTATION = {"quantities": ["quaternion", "omega_b"]}
RUN = {"stop": 20.0, "step": 1.0}
FREE = {
    "body": {"mass": 50.0, "inertia": [2.0, 2.0, 3.0]}, "initial": {"omega_b": [0.3, 0.1, 1.0]},
    "loads": {"gravity_a": [0.0, 0.0, 0.0]}, "outputs": ROTATION, "run": RUN,
}  # fmt: skip


def varied(vary, **tables):
    return FREE | tables | {"ensemble": {"vary": vary}}


CASES = {
    "a free symmetric body of any inertia": varied(
        {"body.inertia": {"relative": 0.02}, "initial.omega_b": {"relative": 0.1}}),
    "a satellite that flips": varied(
        {"body.inertia": {"relative": 0.01, "axes_deg": 1.0}, "initial.omega_b": {"normal": [[0.01, 1.0, 0.01], 0.01]},
         "loads.torque_b": {"normal": [[0.0, 0.0, 0.001], 0.0005]}},
        body={"mass": 50.0, "inertia": [1.0, 2.0, 2.5]}, initial={"omega_b": [0.01, 1.0, 0.01]}),
    "a heavy top": varied(
        {"body.mass": {"uniform": [1.5, 2.5]}, "body.inertia": {"relative": 0.03},
         "body.r_oc_b": {"normal": [[0.0, 0.0, 0.1], 0.005]}, "initial.attitude": {"rotvec_deg": 5.0}},
        body={"mass": 2.0, "inertia": [0.02, 0.02, 0.01], "r_oc_b": [0.0, 0.0, 0.1], "pivot": True},
        initial={"omega_b": [0.0, 0.0, 40.0], "attitude": {"rotvec": [0.3, 0.0, 0.0]}}, loads={},
        run={"stop": 4.0, "step": 0.5}),
    "a thruster off the centre": varied(
        {"body.mass": {"normal": [4.0, 0.1]}, "body.r_oc_b": {"normal": [[0.0, 0.0, 0.0], 0.002]},
         "initial.omega_b_deg": {"normal": [[0.0, 0.0, 0.0], 5.0]}, "initial.attitude": "uniform",
         "loads.damping_b": {"lognormal": [[2e-4, 2e-4, 2e-4], 0.2]}},
        body={"mass": 4.0, "shape": {"kind": "box", "sides": [0.1, 0.1, 0.34]}}, initial={},
        loads={"force_b": [0.0, 0.0, 0.02], "damping_b": [2e-4, 2e-4, 2e-4]},
        outputs={"quantities": ["quaternion", "omega_b", "position"]}),
    "a torque that is zero in the scene": varied(
        {"loads.torque_b": {"triangular": [[-0.1] * 3, [0.0] * 3, [0.1] * 3]}}),
}  # fmt: skip


def scene_of(name, accuracy=1e-7):
    tables = CASES[name]
    return Scene.from_dict(tables | {"name": "members", "run": tables["run"] | {"accuracy": accuracy}})


@pytest.mark.skipif(reference.library() is None, reason="no C compiler with quadruple precision")
@pytest.mark.parametrize("name", some_of([*CASES], 3))
def test_every_member_meets_the_accuracy_by_the_plan_for_all(name):
    """The reference is quadruple precision, which `test_quadruple` holds to 40 digits."""
    scene = scene_of(name)
    planned, samples = plan_ensemble(scene), draw(scene, 0, 12)
    assert not set(planned.pinned) & set(scene.ensemble.parameters)
    for row in range(len(samples)):
        found = outcome(member(scene, samples, row), planned)
        assert not found.refused
        assert found.error <= scene.run.accuracy, (row, found)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "single", "together"), [
    ("a free symmetric body of any inertia", "torque-free symmetric body", "torque-free body"),
    ("a torque that is zero in the scene", "torque-free symmetric body", "body under loads, by series"),
    ("a heavy top", "symmetric top", "body under loads, by series"),
])  # fmt: skip
def test_a_model_that_holds_for_the_scene_alone_is_not_taken(name, single, together):
    scene = scene_of(name, 1e-4)
    assert plan(scene.replace({"ensemble": None})).model == single
    assert plan_ensemble(scene).model == together


@pytest.mark.thorough
def test_a_plan_says_what_varies_and_how_far_its_pilots_are_off():
    found = plan_ensemble(scene_of("a heavy top"))
    said = "\n".join(found.reasons)
    assert "whatever body.mass, body.inertia, body.r_oc_b, initial.attitude may be" in said
    assert "pilot members" in said
    assert 0.0 < found.error <= 1e-7
    assert "the cheapest of those that serve all pilot members" in said
    assert "add up" not in said


def test_a_plan_of_driven_members_says_that_its_tolerance_is_of_a_whole_run():
    (said,) = [text for text in plan_ensemble(Scene.from_dict(DRIVEN)).reasons if text.startswith("Taylor series")]
    assert "estimated errors of a run add up to at most" in said
    assert said.endswith("in every member")


def test_a_plan_depends_on_neither_design_nor_runs():
    scene = scene_of("a torque that is zero in the scene", 1e-3)
    one, other = (
        plan_ensemble(scene.replace({"ensemble.design": design, "ensemble.runs": runs}))
        for design, runs in (("random", 1), ("latin_hypercube", 5000))
    )
    assert replace(one, reasons=()) == replace(other, reasons=())


def test_an_accuracy_that_no_member_can_meet_is_refused():
    with pytest.raises(SceneError, match=r"members, pilot member 1: run\.accuracy = 1e-15: expected"):
        plan_ensemble(scene_of("a heavy top", 1e-15))


def test_members_that_are_no_scenes_at_all_are_refused_with_the_first_fault():
    scene = scene_of("a heavy top").replace({"ensemble.vary": {"body.inertia": {"uniform": [[-2.0] * 3, [-1.0] * 3]}}})
    with pytest.raises(SceneError, match=r"ensemble\.vary: expected members that are scenes.*body\.inertia"):
        plan_ensemble(scene)


def test_sobol_points_that_are_not_balanced_are_said():
    scene = scene_of("a torque that is zero in the scene", 1e-3)
    scene = scene.replace({"ensemble.design": "sobol", "ensemble.runs": 1000})
    pytest.importorskip("scipy")
    assert any("512 or 1,024 in place of 1,000" in line for line in plan_ensemble(scene).reasons)
    balanced = plan_ensemble(scene.replace({"ensemble.runs": 1024}))
    assert not any("in place of" in line for line in balanced.reasons)


def test_progress_is_told_up_to_the_end():
    told = []
    plan_ensemble(scene_of("a free symmetric body of any inertia", 1e-4), told.append)
    assert told == sorted(set(told))
    assert told[0] > 0.0
    assert told[-1] == 1.0
    assert np.isfinite(told).all()


def test_keys_without_effect_are_named_as_the_file_has_them(recwarn):
    """The free motion of a sphere has no moments in it; that of a box has, which a torque turns."""
    warnings.simplefilter("always")
    sphere = {"mass": 2.0, "shape": {"kind": "sphere", "radius": 0.5}}
    box, turned = {"mass": 2.0, "shape": {"kind": "box", "sides": [0.6, 0.5, 0.4]}}, {"torque_b": [0.0, 0.0, 0.1]}
    for body, loads, key, mean, said in (
        (FREE["body"], {}, "body.mass", 50.0, "body.mass"), (sphere, {}, "body.mass", 2.0, "body.mass"),
        (sphere, {}, "body.shape.radius", 0.5, "body.shape"), (box, turned, "body.mass", 2.0, None),
    ):  # fmt: skip
        recwarn.clear()
        vary = {key: {"normal": [mean, 0.02 * mean]}, "initial.omega_b": {"relative": 0.1}}
        plan_ensemble(Scene.from_dict(varied(vary, body=body, loads=FREE["loads"] | loads) | {"name": "it"}))
        found = [(str(w.message), w.filename) for w in recwarn if issubclass(w.category, rbfmu.SceneWarning)]
        expected = f"it: ensemble.vary: {said} varies without effect on any output"
        assert found == ([(expected, __file__)] if said else [])


@pytest.mark.thorough
def test_a_key_that_moves_an_event_alone_has_an_effect(recwarn):
    """2026-11-28: the warning said that it does nothing, while the times of the event followed it. A day later an event
    that does not happen refused the ensemble, as a largest of no numbers."""
    tables = FREE | {"constants": {"late": 0.3, "idle": 1.0}, "events": {"passed": "t - late", "never": "t + 1"}}
    vary = {"constants.late": {"uniform": [0.1, 0.5]}, "constants.idle": {"uniform": [0.1, 0.5]}}
    plan_ensemble(Scene.from_dict(tables | {"name": "it", "ensemble": {"vary": vary}}))
    said = [str(w.message) for w in recwarn if issubclass(w.category, rbfmu.SceneWarning)]
    assert said == ["it: ensemble.vary: constants.idle varies without effect on any output"]


def test_a_scene_that_was_run_is_planned_once_and_its_warnings_are_said_each_time(recwarn):
    warnings.simplefilter("always")
    vary = {"body.mass": {"uniform": [40.0, 60.0]}, "initial.omega_b": {"relative": 0.1}}
    scene = Scene.from_dict(FREE | {"name": "again", "ensemble": {"runs": 4, "vary": vary}})
    before = planning._kept_with_doubts.cache_info().misses
    first, again = (rbfmu.run_ensemble(scene, executor=1, progress=False) for _ in range(2))
    rbfmu.run_ensemble(scene.replace({"run.accuracy": 1e-9}), executor=1, progress=False)
    assert planning._kept_with_doubts.cache_info().misses == before + 2
    assert [w.filename for w in recwarn if "without effect" in str(w.message)] == [__file__] * 3
    np.testing.assert_array_equal(first.final["omega_b"], again.final["omega_b"])


@pytest.mark.parametrize("seed", [0, 86, 110, *(pytest.param(k, marks=pytest.mark.thorough) for k in range(600, 620))])
def test_all_members_meet_the_accuracy(seed):
    """86 and 110: of a thousand members the worst few were beyond it, while all pilots were far within."""
    scene = drawn(seed, 300 if seed == 0 else 1000)
    plan = plan_ensemble(scene)
    if plan.error <= scene.run.accuracy:  # else it says that the worst may miss it
        assert np.nanmax(errors(scene, plan)) <= 1.0


def test_what_goes_from_point_to_point_refuses_a_plan_for_whole_runs(tmp_path):
    """2026-12-01: an FMU at an equilibrium was off by 750 times the accuracy, where other last digits were promised."""
    scene = drawn(42001, 8)
    planned = plan_ensemble(scene)
    rbfmu.simulate(scene, planned=planned)
    build, step = partial(rbfmu_fmu.build, scene, tmp_path / "it.fmu"), partial(rbfmu.compiled_step, scene)
    for take in (build, step, partial(rbfmu.sensitivity, scene, ["initial.omega_b"])):
        with pytest.raises(ValueError, match=r"Plan.interpolated = True: expected a plan by rbfmu\.plan"):
            take(planned=planned)


@pytest.mark.thorough
def test_where_nearly_equal_starts_lead_apart_no_worst_member_is_promised():
    """Member 0 to 999 of this pivot: the worst is off by 18 times the accuracy, at the tightest tolerance there is."""
    with pytest.warns(SceneWarning, match="nearly equal starts lead apart"):
        found = plan_ensemble(drawn(13169, 1000))
    said = found.reasons
    assert found.tolerance == TIGHTEST
    assert any(text.startswith("error at most") and "in 8 pilot members" in text for text in said)
    assert not any("with 99 in 100" in text for text in said)


@pytest.mark.parametrize("seed", [6, *(pytest.param(k, marks=pytest.mark.thorough) for k in (8, 11, 16, 19))])
def test_members_about_a_centre_that_just_reaches_the_top_meet_the_accuracy(seed):
    """2026-12-01: few come so near to it that errors grow most; with these of 14 seeds some missed the accuracy."""
    tables = {"body": {"mass": 2.7, "inertia": [0.45, 0.46, 0.48], "pivot": True, "r_oc_b": [0.0, 0.0, -0.16]}}
    rate = 2.0 * np.sqrt(2.7 * 9.81 * 0.16 / (0.46 + 2.7 * 0.16**2))
    tables |= {"initial": {"omega_b": [0.0, rate, 0.0]}, "outputs": ROTATION}
    vary = {"initial.omega_b": {"normal": [[0.0, rate, 0.0], [0.0, 1e-4, 0.0]]}}
    tables |= {"ensemble": {"runs": 3000, "seed": seed, "keep": ["all"], "vary": vary}}
    scene = Scene.from_dict(tables | {"run": {"stop": 8.8, "step": 8.8, "accuracy": 1e-3}}, "to the top")
    assert np.nanmax(errors(scene, plan_ensemble(scene))) <= 1.0


@pytest.mark.parametrize("seed", [18004, 18039])
def test_a_heavy_tail_that_a_tighter_tolerance_holds_is_no_cause_to_warn(seed):
    """Few members beside a tolerance that is not much tighter would tell of worst ones beyond any."""
    scene = drawn(seed, 1000)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*lead apart.*", SceneWarning)
        found = plan_ensemble(scene)
    assert any("with 99 in 100" in text for text in found.reasons)
    assert np.nanmax(errors(scene, found)) <= 1.0


@pytest.mark.thorough
def test_a_plan_holds_whatever_the_ports_supply_and_what_acts_through_them_alone_may_vary(recwarn):
    """Without inputs this body rests, and no tolerance matters nor any inertia."""
    tables = {**DRIVEN, "initial": {}, "outputs": {"quantities": ["quaternion"]}}
    scene = rbfmu.Scene.from_dict(tables | {"run": {"stop": 60.0, "step": 2.0, "accuracy": 1e-6}}).replace(
        {"ensemble.vary": {"body.inertia": {"relative": 0.02}}}
    )
    planned = plan_ensemble(scene)
    assert not [one for one in recwarn if "without effect" in str(one.message)]

    def kick(t, outputs, state, inputs, noise):
        inputs[:3] = 0.2 * noise

    tight = planned.__class__(planned.model, "series", 7, tolerance=1e-15, order=24)
    found, true = (
        rbfmu.run_ensemble(
            scene, executor=1, progress=False, planned=one, controller=rbfmu.Controller(kick, noise=3)
        ).all["quaternion"]
        for one in (planned, tight)
    )
    assert 0.0 < 2.0 * np.linalg.norm(found - true, axis=-1).max() < 1e-6


def test_round_off_of_bodies_at_rest_is_no_sign_of_starts_that_lead_apart(recwarn):
    """They hang in a turned attitude, where gravity's moment is zero but for round-off."""
    turned = {"rotvec": [0.3, 0.5, -0.2]}
    down = rbfmu.rotate(rbfmu.quaternion_from_rotvec(turned["rotvec"]), [0.0, 0.0, -9.81])
    body = {"mass": 1.0, "inertia": [1.0, 1.2, 1.4], "r_oc_b": [0.0, 0.0, -0.2], "pivot": True}
    tables = {
        "body": body, "initial": {"attitude": turned}, "loads": {"gravity_a": down, "damping_b": [0.01, 0.1, 0.1]},
    }  # fmt: skip
    tables |= {"outputs": {"quantities": ["quaternion", "alpha_b"]}, "run": {"stop": 5.0, "step": 0.5}}
    tables |= {"ensemble": {"runs": 100, "vary": {"body.mass": {"uniform": [0.9, 1.1]}}}}
    found = plan_ensemble(Scene.from_dict(tables))
    assert found.tolerance > 1e-9
    assert found.error < 1e-12
    assert not [one for one in recwarn if "lead apart" in str(one.message)]


# Series that are fitted to all members: their order, and the likely worst of the members' errors


@pytest.mark.parametrize(("exponent", "shape"), [(1.0, "as 1/d beside a separatrix"), (0.1, "much the same in all")])
def test_the_likely_worst_error_is_rarely_exceeded_and_not_far_off(exponent, shape):
    random, beyond, far = np.random.default_rng(4), 0, []
    for _ in range(200):
        drawn = random.uniform(size=1024) ** -exponent
        worst = (random.uniform(size=10_000) ** -exponent).max()
        likely = likely_worst(drawn, 10_000)
        beyond += bool(worst > likely)
        far.append(likely / worst)
    assert beyond <= 8  # 2 of 200 are expected
    assert np.median(far) < (500.0 if exponent == 1.0 else 2.0)


def test_a_scout_that_fails_makes_no_heavy_tail(monkeypatch):
    scene = drawn(0, 300)
    plan = plan_ensemble(scene)
    scouts = fitting.Scouts(scene, plan, scene.outputs.quantities, seconds=0.0)
    for found, few in (([np.nan, *[1e-9] * 63], False), ([1e-9 * 3.0**k for k in range(64)], True)):
        monkeypatch.setattr(fitting, "_errors", lambda *given, found=found: np.array(found))
        scouts.likely_worst(plan)
        assert scouts.are_too_few == few


def test_errors_that_are_zero_or_missing_have_no_worst():
    assert likely_worst(np.zeros(100), 1000) == 0.0
    assert likely_worst(np.full(5, np.nan), 1000) == 0.0
    assert likely_worst(np.array([1e-9, np.nan]), 1000) >= 1e-9


def _long_run(omega: float, torque: float, stop: float) -> Scene:
    """20 members of 4,500 steps."""
    rates = [0.3 * omega, omega, 0.2 * omega]
    loads = {"gravity_a": [0] * 3, "torque_b": [torque, 2.0 * torque, -torque]}
    return Scene.from_dict(
        FREE
        | {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}, "initial": {"omega_b": rates}, "loads": loads}
        | {"run": {"stop": stop, "step": stop / 4500, "accuracy": 1e-6}}
        | {"ensemble": {"runs": 20, "keep": ["all"], "vary": {"initial.omega_b": {"relative": 0.01}}}}
    )


@pytest.mark.parametrize(("force", "parts"), [(0.0, 1), pytest.param(0.1, 5, marks=pytest.mark.thorough)])
def test_plans_of_long_runs_look_at_some_points(force, parts, monkeypatch):
    """Of 4,500 points pilots and scouts are compared at 900, with substeps that end at all points where any do."""
    scene, seen = _long_run(100.0, 1.0, 10.0), []
    scene = scene.replace({"loads.force_b": [force, 0.0, 0.0], "outputs.quantities": ["quaternion", "position"]})

    def run_samples(work, *given, **named):
        found = fitting_run(work, *given, **named)
        seen.append((found[0].shape[1], work.control.parts))
        return found

    fitting_run = fitting.run_samples
    monkeypatch.setattr(fitting, "run_samples", run_samples)
    plan = plan_ensemble(scene)
    assert plan.interpolated == (force == 0.0)
    assert len(seen) >= 2
    assert set(seen) == {(901, parts)}
    assert np.nanmax(errors(scene, plan)) <= 1.0


def test_substeps_pass_over_communication_points_without_ports():
    """Nearly as many substeps are then planned for many points as for few."""
    scene = _long_run(2.0, 0.5, 10.0)
    many, few = (plan_ensemble(scene.replace({"run.step": step})) for step in (0.01, 2.5))
    substeps = [Judge(Question(member(scene, draw(scene, 0, 1), 0))).try_out(found)[1] for found in (many, few)]
    assert many.interpolated
    assert 0.7 < substeps[0] / substeps[1] < 1.4
    assert not plan_ensemble(scene.replace({"inputs.ports": ["torque_a"]})).interpolated


def test_a_truth_that_is_discarded_is_one_of_the_same_points_again():
    """2026-12-01: "leading shapes {'q0': (3,), 'q1': (33,)} do not broadcast"; tight series do not agree to 1e-15."""
    scene = Scene.from_dict(varied(
        {"initial.position": {"normal": [[0.0, 0.0, 0.0], 1.0]}},
        body={"mass": 1.0, "inertia": [1.0, 1.5, 2.0]}, initial={"omega_b": [0.5, 1.0, 2.0]},
        loads={"gravity_a": [0.0, 0.0, 0.0], "torque_b": [0.1, 0.0, 0.2]},
        outputs={"quantities": ["quaternion", "position"]}, run={"stop": 8.0, "step": 4.0, "accuracy": 1e-12},
    ))  # fmt: skip
    assert 0.0 < plan_ensemble(scene).error <= scene.run.accuracy


def test_members_errors_are_those_that_an_accuracy_counts():
    random = np.random.default_rng(1)
    q = random.normal(size=(50, 3, 4))
    q /= np.linalg.norm(q, axis=2, keepdims=True)
    near = q + 1e-9 * random.normal(size=q.shape)
    near /= np.linalg.norm(near, axis=2, keepdims=True)
    near[::2] *= -1.0  # the same attitudes
    for other in (near, q[::-1].copy()):
        expected = attitude_error(other.reshape(-1, 4), q.reshape(-1, 4)).reshape(50, 3).max(axis=1)
        np.testing.assert_allclose(_errors(Columns((OUTPUT["quaternion"],)), other, q), expected, rtol=1e-12)
    rates = random.normal(size=(5, 3, 3))
    found = _errors(Columns((OUTPUT["omega_b"],)), rates + np.array([0.0, 0.0, 1e-3]), rates)
    np.testing.assert_allclose(found, 1e-3 / np.linalg.norm(rates, axis=2).max(axis=1), rtol=1e-12)
