"""From a scene to a plan: one question, the models that may answer it from the smallest on, and the first that does.

A model that leaves more out costs less, so that models are asked from the smallest to the largest, and costs decide
where several methods integrate the same motion. The judge measures errors by a motion that is far more exact than any
plan's; of a closed form that is exact only round-off counts, for which there are formulas. Inputs that are known are
planned for at last, by the motion that they drive.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from rbfmu.models import registry
from rbfmu.models.disturbances import GROWTH, growth_rate
from rbfmu.models.question import GROWING, Question
from rbfmu.models.spec import ModelSpec
from rbfmu.planning import reasons as say
from rbfmu.planning.fitting import EXACT, cheapest_fit, cheapest_quadrature, swinging_fit
from rbfmu.planning.judge import MAX_SUBSTEPS, Judge, least_sizes, lost_to_cancellation, refuse_unfinished
from rbfmu.planning.methods import ever_tighter, likely_order, series, series_cost, whole_series, with_cost, work_of
from rbfmu.runs.inputs import Drive, Driven
from rbfmu.runs.motion import largest_error, record, substeps_counted
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import communication_steps, thinned_steps
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Motion
from rbfmu_kernels.compile.said import PATIENCE, said_after
from rbfmu_kernels.integrators.substeps import ROUND_OFF
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.quantities import OUTPUTS

CONDITIONED = 0.1
"""The part of the accuracy that a model may lose by its conditioning where another one serves as well."""
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
MOST_UNDER_INPUTS = 1e7
"""The number of substeps of a trial under known inputs."""
ORDERS = (MAX_ORDER - 4, MAX_ORDER)
"""The orders of two series, in half pieces and at the least tolerance, that judge plans for known inputs."""


def plan(
    scene: Scene,
    full: bool = False,
    progress: Callable[[float], Any] | None = None,
    judge: Judge | None = None,
    driven: Callable[[int], Drive] | None = None,
) -> Plan:
    """Choose model, method and step; full: whether to integrate all degrees of freedom and outputs.

    progress: a function that is told from time to time which part of the motion that judges plans is known.
    judge: that of the scene, where its motion is wanted for more than this plan.
    driven: where inputs are known, the pieces of the run, each cut into so many parts; see `plan_for_inputs`.
    Raises SceneError where the accuracy asked cannot be met.
    """
    asked = judge.asked if judge else Question(scene)
    judge = judge or (
        Judge(Question(with_all_outputs(scene), full), progress, asked) if full else Judge(asked, progress)
    )
    with said_after(PATIENCE, lambda: f"rbfmu: planning {scene.name} takes long: {judge.doing}"):
        found = _cheapest(judge)
    found = replace(found, reasons=(*found.reasons, *say.what_inputs_cost(judge.asked, found)))
    return plan_for_inputs(asked, found, driven) if driven else found


def with_all_outputs(scene: Scene) -> Scene:
    """Return the scene with every quantity asked for, and with its own outputs."""
    tables = scene.to_dict()
    del tables["outputs"]["quantities"]
    return Scene.from_dict(tables, scene.name)


def _cheapest(judge: Judge) -> Plan:
    asked = judge.asked
    if asked.scene.has_formulas:
        from rbfmu.planning.formulas import closed_plan, formula_plan  # what has none starts sooner

        return (None if asked.full else closed_plan(judge)) or formula_plan(judge)
    if asked.scene.body is None:
        found = _prescribed(asked)
    elif asked.full:
        found = replace(_integrated(judge), pinned=asked.pinned)
    else:
        found = _smallest(judge)
    return with_cost(asked, found)


def series_serve_alone(judge: Judge) -> bool:
    """Return whether no smaller model serves than series that integrate whatever acts."""
    asked = judge.asked
    return not (asked.scene.has_formulas or asked.scene.body is None) and _smaller(judge)[1] is None


def _smaller(judge: Judge) -> tuple[Plan | None, Plan | None]:
    """Return the plan of an exact closed form, and that of the smallest model that serves, where series need not."""
    exact = exact_plan(judge)
    return exact, _within_accuracy(judge, exact) or exact or _swinging(judge) or _under_body_force(judge)


def _smallest(judge: Judge) -> Plan:
    """Return the plan of the smallest model that serves; of those that serve only nearly, with what that leaves out."""
    asked, (exact, smaller) = judge.asked, _smaller(judge)
    found = smaller or _integrated(judge)
    left_out = say.what_is_left_out(asked, found.spec.force_keeps_direction)
    pinned = found.pinned if found is exact else asked.pinned  # a pilot run or a comparison rests on their values
    return replace(found, pinned=pinned, reasons=(*left_out, *found.reasons))


def _refuse_below(asked: Question, error: float) -> None:
    if asked.accuracy < error:
        expected = f"at least {error:.1e}, what double precision keeps"
        raise SceneError(f"run.accuracy = {asked.accuracy!r}: expected {expected}", asked.scene.name)


# Rates that are prescribed


def prescribed_rates_error(scene: Scene) -> float:
    """Return what prescribed rates lose of the attitude, rad: up to 0.6 eps for each change of the rates.

    It does not matter how far the body turns between them. Rates that change within a step, which the native FMU takes,
    lose as much for each radian.
    """
    return ROUND_OFF * (1.0 + communication_steps(scene))


def _prescribed(asked: Question) -> Plan:
    spec, error = registry.PRESCRIBED_RATES, prescribed_rates_error(asked.scene)
    _refuse_below(asked, error)
    return Plan(spec.key, spec.method, spec.states, error=error, reasons=(say.PRESCRIBED,))


# Closed forms that are exact


def exact_closed_form(asked: Question) -> ModelSpec | None:
    """Return the smallest model with a closed form that is exact for this scene, and well conditioned if any is."""
    exact = [spec for spec in registry.CLOSED_FORMS if spec.serves(asked)]
    good = (spec for spec in exact if spec.conditioning(asked) <= CONDITIONED * asked.accuracy)
    return next(good, exact[0] if exact else None)


def exact_plan(judge: Judge) -> Plan | None:
    """Return the plan of a closed form that is exact, with its round-off; raise SceneError where that is too large."""
    asked = judge.asked
    spec = exact_closed_form(asked)
    if spec is None:
        return None
    found, delicate = Plan(spec.key, spec.method, 0), asked.accuracy < DERIVED and set(judge.names) & DIFFERENCES
    motion = _coarse_motion(judge, spec)
    error = EXACT + (ROUND_OFF * _angle(asked, motion) if spec.angle_round_off else 0.0)
    error += spec.conditioning(asked)
    lost = lost_to_cancellation(asked, motion)
    if delicate or lost > LITTLE * asked.accuracy:
        error = max(error, judge.error_if_soon(found, otherwise=lost if lost > LITTLE * asked.accuracy else 0.0))
    if delicate and "alpha_b" in delicate:
        found = replace(found, pinned=asked.pinned)
    _refuse_below(asked, error)
    return replace(found, error=error, reasons=say.why_exact(asked, spec))


def _coarse_motion(judge: Judge, spec: ModelSpec) -> Motion:
    """Return a closed form's motion at some times, to know sizes by."""
    cancelling = tuple(name for name in judge.names if name in DIFFERENCES)
    names = tuple(dict.fromkeys((*cancelling, "omega_b"))) if spec.angle_round_off else cancelling
    if not names:
        return {}  # without running the model, which would be loaded or compiled
    return judge.motion_by(Plan(spec.key, "", 0), names, thinned_steps(judge.scene, 100))


def _angle(asked: Question, motion: Motion) -> float:
    """Return the largest angle that the body may turn by, rad."""
    return float(np.max(np.linalg.norm(motion["omega_b"], axis=1))) * asked.span


# Models that are not exact, but within the accuracy


def _within_accuracy(judge: Judge, exact: Plan | None) -> Plan | None:
    """Return the smallest model that stays within the accuracy, if nothing varies that turns it.

    exact: the closed form that serves exactly, by which smaller models are judged; where there is none, they are judged
    by the motion in double-double arithmetic.
    """
    asked, names = judge.asked, judge.names
    smaller = [*registry.smaller_closed_forms(exact.model if exact else "")]
    if not smaller or not asked.rotation or not _may_be_compared(asked):
        return None
    if "force_b" in asked.varying and "acceleration" in names and "quaternion" not in names:
        names = (*names, "quaternion")  # ports are at zero here: what they bring is as wrong as the attitude
    shown = tuple(dict.fromkeys((*names, "omega_b")))  # of the rates only how much they change is measured
    truth = judge.motion_by(replace(exact, pinned=asked.pinned), shown) if exact else judge.motion
    bound = (1.0 if exact else SHARE) * asked.accuracy - EXACT
    for spec in smaller:
        if _may_be_close(asked, spec, truth, names):
            candidate = Plan(spec.key, spec.method, 0, pinned=asked.pinned)
            error = judge.compare(candidate, truth, names, bool(asked.varying & GROWING))
            if error <= bound:
                why = say.why_close(asked, spec.key, exact, error, len(truth["omega_b"]) - 1)
                return replace(candidate, error=error + (exact.error if exact else 0.0), reasons=(why,))
    return None


def _may_be_compared(asked: Question) -> bool:
    """Return whether nothing varies on which the rotation or the size of the compared quantities depends."""
    names = set(asked.judged)
    rests = {*registry.ONE_AXIS.rests_on(asked)}
    if asked.translation or "acceleration" in names:
        rests = rests | {"r_oc_b"}
        if any(asked.scene.loads.force_b):
            rests = rests | {"mass"}
    if names & {"acceleration", "kinetic_energy"}:
        rests = rests | GROWING
    return not rests & asked.varying


def _may_be_close(asked: Question, spec: ModelSpec, truth: Motion, names: tuple[str, ...]) -> bool:
    """Return whether it is worth running a model, judged by the larger one's motion."""
    kept = TRANSLATION | CONSERVED if spec.stands_still else set()
    if growth_rate(asked) * asked.span > GROWTH and not set(names) <= kept:
        return False
    if spec.stands_still:
        return _stays(asked, truth, names)
    if spec.rates_from is None:
        return True
    rates = truth["omega_b"]
    change = float(np.max(np.linalg.norm(rates - spec.rates_from(asked, rates), axis=1)))
    fastest = float(np.max(np.linalg.norm(rates, axis=1)))
    if "omega_b" in names and change > asked.accuracy * fastest:
        return False
    return 0.01 * change * min(asked.span, 1.0 / fastest if fastest > 0.0 else math.inf) <= asked.accuracy


def _stays(asked: Question, truth: Motion, names: tuple[str, ...]) -> bool:
    """Return whether all compared quantities stay as they begin, except for the path."""
    names = tuple(n for n in names if n not in (*TRANSLATION, "kinetic_energy"))
    still = {n: truth[n][:1] + 0.0 * truth[n] for n in names}
    return largest_error(still, truth, names, least_sizes(asked, truth)) <= asked.accuracy


# Methods that integrate


def _swinging(judge: Judge) -> Plan | None:
    """Return the plan of one angle under forces fixed in space, by the cheapest series that meets the accuracy."""
    asked, spec = judge.asked, registry.ONE_AXIS_TAYLOR
    found = swinging_fit(judge, Plan(spec.key, "", 0, tolerance=asked.accuracy)) if spec.serves(asked) else None
    return replace(found, reasons=(say.SWINGING, *found.reasons)) if found else None


def _under_body_force(judge: Judge) -> Plan | None:
    """Return exact rotation with a quadrature for the path; for a symmetric body, an integration if it costs less."""
    asked, spec = judge.asked, registry.FREE_BODY_FORCE
    if not any(asked.scene.loads.force_b) or not asked.translation or not spec.serves(asked):
        return None
    found = cheapest_quadrature(judge, Plan(spec.key, "", 0, pinned=asked.pinned))
    if found is None or not asked.start.is_symmetric:
        return found
    try:
        return min(_integrated(judge), found, key=lambda plan: with_cost(asked, plan).cost)
    except SceneError:
        return found


def _integrated(judge: Judge) -> Plan:
    return cheapest_fit(judge, whole_series(judge.asked.scene, 0, judge.asked.accuracy))


# Inputs that are known


def plan_for_inputs(asked: Question, found: Plan, driven: Callable[[int], Drive]) -> Plan:
    """Return a scene's plan with its error and cost under the inputs given, or a tighter one where it misses.

    driven: the pieces of the run, each cut into so many parts.
    Raises SceneError where none meets the scene's accuracy.
    """
    if found.model == registry.PRESCRIBED_RATES.key:
        return without_loops(asked, found)
    what = f"rbfmu: planning {asked.scene.name} takes long: methods are tried under its inputs"
    with said_after(PATIENCE, lambda: what):
        return _least_tight(asked, found, driven(1), driven(2))


def _least_tight(asked: Question, found: Plan, drive: Drive, halves: Drive) -> Plan:
    scene, names = asked.scene, asked.judged
    with_rates = tuple(dict.fromkeys((*names, "omega_b")))  # by which rest is judged
    tight = [whole_series(scene, order, 1e-18) for order in ORDERS]
    (truth, taken), (other, more) = (_run_under(halves, scene, plan, with_rates, MAX_SUBSTEPS) for plan in tight)
    for motion, substeps in ((truth, taken), (other, more)):
        refuse_unfinished(scene, np.diff(halves.time).tolist(), motion["omega_b"], substeps)
    floors = least_sizes(asked, truth)
    doubt = largest_error(other, truth, names, floors)
    best = math.inf
    for plan in (found, *_tighter(asked, found)):
        motion, substeps = _run_under(drive, scene, plan, names, MOST_UNDER_INPUTS)
        error = largest_error(motion, truth, names, floors) + doubt
        if error <= asked.accuracy:
            reasons = [*without_loops(asked, found).reasons]
            if plan is not found:
                reasons.append(say.tighter_than_the_fmu(found.method, plan.method, plan.tolerance))
            cost = _cost_under(asked, plan, found, substeps, drive)
            return replace(plan, error=error, cost=cost, reasons=(*reasons, say.under_inputs(error)))
        best = min(best, error)
    expected = f"one that these inputs allow; the methods here reach {best:.1e} with them"
    raise SceneError(f"run.accuracy = {asked.accuracy!r}: expected {expected}", scene.name)


def _run_under(drive: Drive, scene: Scene, plan: Plan, names: tuple[str, ...], most: float) -> tuple[Motion, float]:
    """Return the motion under inputs, which ends after so many substeps, and how many it took."""
    run = Driven(scene, plan, drive, names)
    return record(run, names, most), substeps_counted(run.kernels, run.z)


def without_loops(asked: Question, found: Plan) -> Plan:
    """Return a plan without what it says of loops closed through inputs: inputs that are known close none."""
    of_loops = say.what_inputs_cost(asked, found)
    return replace(found, reasons=tuple(reason for reason in found.reasons if reason not in of_loops))


def _tighter(asked: Question, found: Plan) -> Iterator[Plan]:
    """Yield series of ever smaller tolerance, for the whole run."""
    model = whole_series(asked.scene, 0, 0.0).model
    general = replace(found, model=model, tolerance=asked.accuracy, substep=math.inf, order=0)
    for tolerance in ever_tighter(found.tolerance if found.model == model else asked.accuracy):
        order = max(found.order, likely_order(tolerance))
        yield replace(series(general, order, asked.load_shares).plan_of(tolerance), span=asked.span)


def _cost_under(asked: Question, plan: Plan, found: Plan, substeps: float, drive: Drive) -> float:
    """Return ns a communication step of a run whose pieces, and whose substeps, were counted."""
    steps, pieces = len(drive.time) - 1, len(drive.lengths)
    if plan.model != registry.LOADED_TAYLOR.key:
        return found.cost * pieces / steps
    ns = series_cost(plan.order, asked.load_shares) * work_of(substeps, float(pieces))
    return with_cost(asked, replace(plan, cost=ns / steps)).cost
