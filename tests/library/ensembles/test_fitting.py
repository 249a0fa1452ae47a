"""Series that are fitted to all members of an ensemble: their order, and the likely worst of the members' errors."""

from dataclasses import replace

import numpy as np
import pytest

from rbfmu.ensembles import fitting
from rbfmu.ensembles.fitting import _errors, likely_worst
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.variables import Columns
from rbfmu.models.question import Question
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import series_cost
from rbfmu.runs.motion import attitude_error
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT
from tests.library.ensembles.test_planning import FREE
from tests.support.ensembles.accuracy import drawn, errors


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


@pytest.mark.parametrize(
    ("omega", "torque", "stop", "parts"),
    [(0.5, 1e-3, 30.0, 1), pytest.param(100.0, 1.0, 10.0, 5, marks=pytest.mark.thorough)],
)
def test_plans_of_long_runs_look_at_some_points(omega, torque, stop, parts, monkeypatch):
    """Pilots and scouts take steps of five communication steps where series serve many of these, else the run's own."""
    scene, seen = _long_run(omega, torque, stop), []

    def run_samples(work, *given, **named):
        found = fitting_run(work, *given, **named)
        seen.append((found[0].shape[1], work.control.parts))
        return found

    fitting_run = fitting.run_samples
    monkeypatch.setattr(fitting, "run_samples", run_samples)
    plan = plan_ensemble(scene)
    assert len(seen) >= 2
    assert set(seen) == {(901, parts)}
    assert np.nanmax(errors(scene, plan)) <= 1.0


def test_orders_are_compared_by_what_members_cost_side_by_side():
    """A series that serves some two steps costs more there than two substeps of a lower order, one a step."""
    omega = [2.0, -1.4, 1.8]
    tables = FREE | {"body": {"mass": 1.0, "inertia": [1.0, 2.0, 2.5]}, "initial": {"omega_b": omega}}
    tables |= {"loads": {"gravity_a": [0] * 3, "torque_b": [0.3, -0.2, 0.4]}}
    tables |= {
        "outputs": {"quantities": ["quaternion", "omega_b"]},
        "run": {"stop": 6.0, "step": 0.2, "accuracy": 1e-8},
    }
    scene = Scene.from_dict(tables | {"ensemble": {"vary": {"initial.omega_b": {"normal": [omega, 0.02]}}}})
    steps = scene.run.count

    def work(found):
        return Judge(Question(member(scene, draw(scene, 0, 1), 0))).try_out(found)[1]

    found = plan_ensemble(scene)
    higher = replace(found, order=20)
    assert work(found) >= steps > work(higher)
    assert series_cost(found.order, (0.0, 0.0)) * work(found) > series_cost(20, (0.0, 0.0)) * work(higher)


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
