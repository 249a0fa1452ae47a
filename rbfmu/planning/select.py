"""From a scene to a plan."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from rbfmu.models.body_at_start import body_at_start
from rbfmu.models.registry import (
    FREE_BODY_FORCE,
    LOADED_TAYLOR,
    ONE_AXIS,
    ONE_AXIS_TAYLOR,
    PRESCRIBED_RATES,
    smaller_closed_forms,
)
from rbfmu.models.scene_needs import GROWING, Needs, varying_parameters
from rbfmu.models.sensitivity import GROWTH, growth_rate, prescribed_rates_error
from rbfmu.models.spec import ModelSpec
from rbfmu.planning import reasons as say
from rbfmu.planning.candidates import exact_closed_form
from rbfmu.planning.fitting import cheapest_fit, cheapest_quadrature, swinging_fit
from rbfmu.planning.judge import MAX_SUBSTEPS, Judge, least_sizes, lost_to_cancellation, refuse_unfinished, watched
from rbfmu.planning.methods import TIGHTEST, likely_order, load_shares, series, series_cost, stated, work_of
from rbfmu.runs.inputs import Drive, InputTables, drive_of
from rbfmu.runs.motion import Motion, largest_error, record_driven, record_trajectory, start_run
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import thinned_steps
from rbfmu.scene.scene import PARAMETERS as SCENE_PARAMETERS
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.compile.said import PATIENCE, said_after
from rbfmu_kernels.integrators.substeps import ROUND_OFF
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.quantities import OUTPUTS

EXACT = 1e-14
"""The accuracy that closed forms keep."""
TRANSLATION = {row.name for row in OUTPUTS if row.of_origin}
CONSERVED = {row.name for row in OUTPUTS if row.conserved}
DIFFERENCES = {row.name for row in OUTPUTS if row.cancels}
"""Quantities that are sums of terms that may cancel, so that round-off counts for more than in the state."""
LITTLE = 0.1
"""The part of the accuracy that what cancels may lose by a bound before a closed form is compared."""
DERIVED = 1e-9
"""The accuracy below which these are compared even where the state is exact."""
SHARE = 0.8
"""The part of the accuracy that the error of a model that leaves something out may be, if no closed form judges it."""


def plan(
    scene: Scene, full: bool = False, progress: Callable[[float], Any] | None = None, judge: Judge | None = None
) -> Plan:
    """Choose model, method and step; full: whether to integrate all degrees of freedom and outputs.

    progress: a function that is told from time to time which part of the motion that judges plans is known.
    judge: that of the scene, where its motion is wanted for more than this plan.
    Raises SceneError where the accuracy asked cannot be met.
    """
    if full:
        own, scene = scene, with_all_outputs(scene)
        judge = judge or Judge(scene, progress, fewer=own)
    judge = judge or Judge(scene, progress)
    with said_after(PATIENCE, lambda: f"rbfmu: planning {scene.name} takes long: {judge.doing}"):
        found = _planned(scene, full, judge)
    return replace(found, reasons=(*found.reasons, *say.what_inputs_cost(scene, found)))


def _planned(scene: Scene, full: bool, judge: Judge) -> Plan:
    if "omega_b" in scene.inputs.ports:
        return _prescribed(scene)
    needs = Needs.of(scene)
    if full:
        return _integrated(scene, Needs(True, True, not _has_pivot(scene)), judge, splitting=False)
    exact = exact_closed_form(scene, needs)
    found = _closed(scene, exact, needs, judge) if exact else None
    smaller = _smaller(scene, found, needs, judge)
    if smaller:
        return smaller
    found = (
        found
        or _swinging(scene, needs, judge)
        or _under_body_force(scene, needs, judge)
        or _integrated(scene, needs, judge)
    )
    return replace(found, reasons=(*_left_out(scene, needs, found.spec), *found.reasons))


def _prescribed(scene: Scene) -> Plan:
    spec, error = PRESCRIBED_RATES, prescribed_rates_error(scene)
    _refuse_below(scene, error)
    return stated(scene, Plan(spec.key, spec.method, spec.states, error=error, reasons=(say.PRESCRIBED,)))


def _closed(scene: Scene, spec: ModelSpec, needs: Needs, judge: Judge) -> Plan:
    found, delicate = _candidate(scene, spec, needs), scene.run.accuracy < DERIVED and set(judge.names) & DIFFERENCES
    motion = _coarse_motion(scene, spec, judge)
    error = EXACT + (ROUND_OFF * _angle(scene, motion) if spec.angle_round_off else 0.0)
    error += spec.conditioning(scene)
    lost = lost_to_cancellation(scene, motion)
    if delicate or lost > LITTLE * scene.run.accuracy:
        error = max(error, judge.error_if_soon(found, otherwise=lost if lost > LITTLE * scene.run.accuracy else 0.0))
    if delicate:
        found = replace(found, pinned=_pinned(scene) if "alpha_b" in delicate else ())
    _refuse_below(scene, error)
    return replace(found, error=error, reasons=say.why_exact(scene, spec, needs))


def _refuse_below(scene: Scene, error: float) -> None:
    if scene.run.accuracy < error:
        expected = f"at least {error:.1e}, what double precision keeps"
        raise SceneError(f"run.accuracy = {scene.run.accuracy!r}: expected {expected}", scene.name)


def _coarse_motion(scene: Scene, spec: ModelSpec, judge: Judge) -> Motion:
    """Return a closed form's motion at some times, to know sizes by."""
    cancelling = tuple(name for name in judge.names if name in DIFFERENCES)
    names = tuple(dict.fromkeys((*cancelling, "omega_b"))) if spec.angle_round_off else cancelling
    if not names:
        return {}  # without running the model, which would be loaded or compiled
    z = start_run(scene, Plan(spec.key, "", 0), names)
    return record_trajectory(spec.kernels, z, thinned_steps(scene, 100), names)


def _angle(scene: Scene, motion: Motion) -> float:
    """Return the largest angle that the body may turn by, rad."""
    return float(np.max(np.linalg.norm(motion["omega_b"], axis=1))) * (scene.run.stop - scene.run.start)


def _candidate(scene: Scene, spec: ModelSpec, needs: Needs) -> Plan:
    return stated(scene, Plan(spec.key, spec.method, spec.states_for(needs)))


def _left_out(scene: Scene, needs: Needs, spec: ModelSpec) -> tuple[str, ...]:
    return say.what_is_left_out(scene, needs, spec.force_keeps_direction)


def _swinging(scene: Scene, needs: Needs, judge: Judge) -> Plan | None:
    """Return the plan of one angle under forces fixed in space, by the cheapest series that meets the accuracy."""
    spec = ONE_AXIS_TAYLOR
    if not spec.serves(scene, needs):
        return None
    found = swinging_fit(scene, Plan(spec.key, "", spec.states_for(needs), tolerance=scene.run.accuracy), judge)
    if found is None:
        return None
    reasons = say.why_swinging(scene, found)
    return stated(scene, replace(found, pinned=_pinned(scene), reasons=(*reasons, *found.reasons)))


def _under_body_force(scene: Scene, needs: Needs, judge: Judge) -> Plan | None:
    """Return exact rotation with a quadrature for the path; for a symmetric body, an integration if it costs less."""
    spec = FREE_BODY_FORCE
    if not any(scene.loads.force_b) or not needs.translation or not spec.serves(scene, needs):
        return None
    found = cheapest_quadrature(scene, Plan(spec.key, "", spec.states_for(needs), pinned=_pinned(scene)), judge)
    if found is None:
        return None
    found = stated(scene, found)
    if not body_at_start(scene).is_symmetric:
        return found
    try:
        other = _integrated(scene, needs, judge)
    except SceneError:
        return found
    return found if found.cost < other.cost else other


def _integrated(scene: Scene, needs: Needs, judge: Judge, splitting: bool = True) -> Plan:
    general = Plan(LOADED_TAYLOR.key, "", 0, tolerance=scene.run.accuracy)
    found = cheapest_fit(scene, general, judge, splitting)
    return stated(scene, replace(found, states=found.spec.states_for(needs), pinned=_pinned(scene)))


def _has_pivot(scene: Scene) -> bool:
    return scene.body is not None and scene.body.pivot


def with_all_outputs(scene: Scene) -> Scene:
    """Return the scene with every quantity asked for."""
    return Scene.from_dict({k: v for k, v in scene.to_dict().items() if k != "outputs"}, scene.name)


# Models that are not exact, but within the accuracy


def _smaller(scene: Scene, found: Plan | None, needs: Needs, judge: Judge) -> Plan | None:
    """Return the smallest model that stays within the accuracy, if nothing varies that turns it.

    found: the closed form that serves exactly, by which smaller models are judged; where there is none, they are judged
    by the motion in double-double arithmetic.
    """
    names, varying = watched(scene), varying_parameters(scene)
    smaller = [*smaller_closed_forms(found.model if found else "")]
    if not smaller or not needs.rotation or not _may_be_compared(scene, needs):
        return None
    if "force_b" in varying and "acceleration" in names and "quaternion" not in names:
        names = (*names, "quaternion")  # ports are at zero here: what they bring is as wrong as the attitude
    truth = _motion_of(scene, found, judge, names) if found else judge.motion
    bound = (1.0 if found else SHARE) * scene.run.accuracy - EXACT
    for spec in smaller:
        if _may_be_close(scene, spec, truth, names):
            candidate = replace(_candidate(scene, spec, needs), pinned=_pinned(scene))
            error = judge.compare(candidate, truth, names, bool(varying & GROWING))
            if error <= bound:
                why = say.why_close(scene, spec.key, found, error, len(truth["omega_b"]) - 1)
                error += found.error if found else 0.0
                return replace(candidate, error=error, reasons=(*_left_out(scene, needs, spec), why))
    return None


def _may_be_compared(scene: Scene, needs: Needs) -> bool:
    """Return whether nothing varies on which the rotation or the size of the compared quantities depends."""
    names, varying = set(watched(scene)), varying_parameters(scene)
    rests = {*ONE_AXIS.rests_on(scene, needs)}
    if needs.translation or "acceleration" in names:
        rests = rests | {"r_oc_b"}
        if any(scene.loads.force_b):
            rests = rests | {"mass"}
    if names & {"acceleration", "kinetic_energy"}:
        rests = rests | GROWING
    return not rests & varying


def _motion_of(scene: Scene, found: Plan, judge: Judge, names: tuple[str, ...]) -> Motion:
    """Return a closed form's motion at the judge's times; its rates only measure how much changes."""
    names = tuple(dict.fromkeys((*names, "omega_b")))
    z = start_run(scene, replace(found, pinned=_pinned(scene)), names)
    return record_trajectory(found.kernels, z, judge.cut_steps, names)


def _may_be_close(scene: Scene, spec: ModelSpec, truth: Motion, names: tuple[str, ...]) -> bool:
    """Return whether it is worth running a model, judged by the larger one's motion."""
    span = scene.run.stop - scene.run.start
    kept = TRANSLATION | CONSERVED if spec.stands_still else set()
    if growth_rate(scene) * span > GROWTH and not set(names) <= kept:
        return False
    if spec.stands_still:
        return _stays(scene, truth, names)
    if spec.rates_from is None:
        return True
    rates = truth["omega_b"]
    change = float(np.max(np.linalg.norm(rates - spec.rates_from(scene, rates), axis=1)))
    fastest = float(np.max(np.linalg.norm(rates, axis=1)))
    if "omega_b" in names and change > scene.run.accuracy * fastest:
        return False
    return 0.01 * change * min(span, 1.0 / fastest if fastest > 0.0 else math.inf) <= scene.run.accuracy


def _stays(scene: Scene, truth: Motion, names: tuple[str, ...]) -> bool:
    """Return whether all compared quantities stay as they begin, except for the path."""
    names = tuple(n for n in names if n not in (*TRANSLATION, "kinetic_energy"))
    still = {n: truth[n][:1] + 0.0 * truth[n] for n in names}
    return largest_error(still, truth, names, least_sizes(scene, truth)) <= scene.run.accuracy


def _pinned(scene: Scene) -> tuple[str, ...]:
    """Return the parameters on whose values a pilot run or a comparison rests: all but those listed."""
    return tuple(name for name in SCENE_PARAMETERS if name not in scene.inputs.parameters)


MAX_TRIED = 1e7
"""The number of substeps of a trial."""
ORDERS = (MAX_ORDER - 4, MAX_ORDER)
"""The orders of the two series, in half pieces and at the least tolerance, by which the others are judged."""


def plan_for_inputs(scene: Scene, tables: InputTables, interpolate: str, found: Plan) -> Plan:
    """Return a scene's plan with its error and cost under the inputs given, or a tighter one where it misses.

    Raises SceneError where none meets the scene's accuracy.
    """
    if found.model == PRESCRIBED_RATES.key:
        return without_loops(scene, found)
    with said_after(PATIENCE, lambda: f"rbfmu: planning {scene.name} takes long: methods are tried under its inputs"):
        return _planned_for(scene, tables, interpolate, found)


def _planned_for(scene: Scene, tables: InputTables, interpolate: str, found: Plan) -> Plan:
    names = watched(scene)
    with_rates = tuple(dict.fromkeys((*names, "omega_b")))  # by which rest is judged
    drive, halves = drive_of(scene, tables, interpolate), drive_of(scene, tables, interpolate, parts=2)
    tight = [Plan(LOADED_TAYLOR.key, "", 0, tolerance=1e-18, order=order) for order in ORDERS]
    (truth, taken), (other, more) = (record_driven(scene, plan, halves, with_rates, MAX_SUBSTEPS) for plan in tight)
    for motion, substeps in ((truth, taken), (other, more)):
        refuse_unfinished(scene, np.diff(halves.time).tolist(), motion["omega_b"], substeps)
    floors = least_sizes(scene, truth)
    doubt = largest_error(other, truth, names, floors)
    best = math.inf
    for plan in (found, *_tighter(scene, found)):
        motion, substeps = record_driven(scene, plan, drive, names, MAX_TRIED)
        error = largest_error(motion, truth, names, floors) + doubt
        if error <= scene.run.accuracy:
            return _stated(scene, found, plan, error, substeps, drive)
        best = min(best, error)
    expected = f"one that these inputs allow; the methods here reach {best:.1e} with them"
    raise SceneError(f"run.accuracy = {scene.run.accuracy!r}: expected {expected}", scene.name)


def without_loops(scene: Scene, found: Plan) -> Plan:
    """Return a plan without what it says of loops closed through inputs: inputs that are known close none."""
    of_loops = say.what_inputs_cost(scene, found)
    return replace(found, reasons=tuple(reason for reason in found.reasons if reason not in of_loops))


def _tighter(scene: Scene, found: Plan) -> Iterator[Plan]:
    """Yield series of ever smaller tolerance, for the whole run."""
    general = replace(found, model=LOADED_TAYLOR.key, tolerance=scene.run.accuracy, substep=math.inf, order=0)
    span = scene.run.stop - scene.run.start
    tolerance = found.tolerance if found.model == LOADED_TAYLOR.key else scene.run.accuracy
    while tolerance > TIGHTEST:
        tolerance = max(0.1 * tolerance, TIGHTEST)
        order = max(found.order, likely_order(tolerance))
        yield replace(series(general, order, load_shares(scene)).plan_of(tolerance), span=span)


def _stated(scene: Scene, found: Plan, plan: Plan, error: float, substeps: float, drive: Drive) -> Plan:
    steps, reasons = len(drive.time) - 1, without_loops(scene, found).reasons
    cost = found.cost * len(drive.lengths) / steps
    if plan.model == LOADED_TAYLOR.key:
        ns = series_cost(plan.order, load_shares(scene)) * work_of(substeps, float(len(drive.lengths)))
        cost = stated(scene, replace(plan, cost=ns / steps)).cost
    if plan is not found:
        reasons = (*reasons, say.tighter_than_the_fmu(found.method, plan.method, plan.tolerance))
    return replace(plan, error=error, cost=cost, reasons=(*reasons, say.under_inputs(error)))
