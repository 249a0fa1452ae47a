"""From a scene to a plan: models are tried from the smallest to the largest, and the first valid one is chosen.

A model that leaves more out costs less. Where several methods integrate the same motion, the cheapest is chosen. The
judge measures errors against a motion that is far more exact than any plan's. An exact closed form has only round-off
errors, for which there are formulas. If inputs are known, the plan is checked last with the motion that they drive.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from rbfmu.models import registry
from rbfmu.models.question import Question
from rbfmu.planning import closed_forms, fitting, methods
from rbfmu.planning.judge import MAX_SUBSTEPS, Judge, refuse_unfinished, watched_sizes, what_is_reached
from rbfmu.runs.inputs import Drive
from rbfmu.runs.motion import largest_error, least_sizes
from rbfmu.runs.plan import Plan
from rbfmu.runs.steps import Steps, Tell, record, substeps_counted
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Motion
from rbfmu_kernels.compile.said import PATIENCE, said_after
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.quantities import FORCES, TORQUES

MOST_UNDER_INPUTS = 1e7
"""The most substeps of a trial under known inputs."""
ORDERS = (MAX_ORDER - 4, MAX_ORDER)
"""The orders of two series, in half pieces and at the least tolerance, that judge plans for known inputs.

Two different orders are used, as series of one order may take the same steps and then have the same round-off.
"""
LOW_ORDERS = (methods.LOW_ORDER, methods.LOW_ORDER + 4)
"""Those of formulas whose coefficients overflow at high orders."""


def plan(scene: Scene, full: bool = False, progress: Tell = None, driven: Callable[[int], Drive] | None = None) -> Plan:
    """Choose model, method and settings; full: whether to integrate all degrees of freedom and outputs.

    progress: a function that is called from time to time with the part of the truth that is computed, 0 to 1.
    driven: if inputs are known, returns the pieces of the run, each cut into a given number of parts; see
    `plan_for_inputs`. Raises SceneError if the accuracy asked cannot be met.
    """
    asked = Question(scene)
    judged = Question(with_all_outputs(scene)) if full else asked
    found = cheapest(judged, Judge(judged, progress, asked), full)
    if driven:  # known inputs close no loop
        return plan_for_inputs(asked, found, driven)
    return replace(found, reasons=(*found.reasons, *reasons_of_held_inputs(judged, found)))


def with_all_outputs(scene: Scene) -> Scene:
    """Return the scene with all quantities as outputs, besides its own outputs."""
    tables = scene.to_dict()
    del tables["outputs"]["quantities"]
    return Scene.from_dict(tables, scene.name)


def cheapest(asked: Question, judge: Judge, full: bool = False) -> Plan:
    """Return the cheapest plan within the accuracy; full: only series that integrate all that is judged.

    judge: for the same question. Raises SceneError if the accuracy asked cannot be met.
    """
    with said_after(PATIENCE, lambda: f"rbfmu: planning {asked.scene.name} takes long: {judge.doing}"):
        if asked.scene.has_formulas:
            from rbfmu.planning.formulas import closed_plan, formula_plan  # only if needed, as it loads slowly

            return (None if full else closed_plan(asked, judge)) or formula_plan(asked, judge)
        if asked.scene.body is None:
            return methods.with_cost(asked, closed_forms.prescribed_plan(asked))
        smaller = None if full else next(filter(None, _plans_of_smaller_models(asked, judge)), None)
        found = smaller or fitting.cheapest_fit(asked, judge, full)
        pinned = found.pinned if found.spec.closed_form else asked.pinned  # pilot runs depend on their values
        left_out = () if full else closed_forms.what_is_left_out(asked, found.spec.force_keeps_direction)
        return methods.with_cost(asked, replace(found, pinned=pinned, reasons=(*left_out, *found.reasons)))


def _plans_of_smaller_models(asked: Question, judge: Judge) -> Iterator[Plan | None]:
    """Yield the plans of models that integrate less than all, from the smallest; None for a model that is not valid."""
    exact = closed_forms.exact_plan(asked, judge)
    yield closed_forms.plan_within_accuracy(asked, judge, exact)
    yield exact
    yield fitting.of_one_angle(asked, judge)
    yield fitting.of_path_alone(asked, judge)


def series_serve_alone(judge: Judge) -> bool:
    """Return whether only series that integrate all degrees of freedom are valid, and no smaller model."""
    scene = judge.scene
    return not (scene.has_formulas or scene.body is None or any(_plans_of_smaller_models(judge.asked, judge)))


# Inputs that are known


def plan_for_inputs(asked: Question, found: Plan, driven: Callable[[int], Drive]) -> Plan:
    """Return a scene's plan with its error and cost under given inputs, or a tighter plan if it misses the accuracy.

    driven: returns the pieces of the run, each cut into a given number of parts.
    Raises SceneError if no plan meets the scene's accuracy.
    """
    if found.model == registry.PRESCRIBED_RATES.key:
        return found
    message = f"rbfmu: planning {asked.scene.name} takes long: methods are tried under its inputs"
    with said_after(PATIENCE, lambda: message):
        return _loosest_accurate(asked, found, driven(1), driven(2))


def _loosest_accurate(asked: Question, found: Plan, drive: Drive, halves: Drive) -> Plan:
    scene, names = asked.scene, asked.judged
    with_rates = tuple(dict.fromkeys((*names, "omega_b")))  # for `least_sizes` of a body at rest
    for orders in (ORDERS, LOW_ORDERS) if scene.has_formulas else (ORDERS,):
        tight = [methods.series_of_all(asked, order, 1e-18) for order in orders]
        judging = [_run_driven(halves, scene, plan, with_rates, MAX_SUBSTEPS) for plan in tight]
        if all(np.isfinite(motion["omega_b"][-1]).all() for motion, _ in judging):
            break
    for motion, run in judging:
        substeps = substeps_counted(run.kernels, run.z)
        refuse_unfinished(scene, np.diff(halves.time).tolist(), motion["omega_b"], substeps, driven=True)
    (truth, run), (check, _) = judging
    floors = least_sizes(asked, truth) | watched_sizes(scene, run.kernels.BLOCKS, run.z)
    doubt = largest_error(check, truth, names, floors)
    best = math.inf
    for plan in (found, *_tighter(asked, found)):
        motion, run = _run_driven(drive, scene, plan, names, MOST_UNDER_INPUTS)
        error = largest_error(motion, truth, names, floors) + doubt
        if error <= asked.accuracy:
            reasons = [*found.reasons]
            if plan is not found:
                misses = f"{found.method}, planned for any inputs, misses the accuracy under these"
                reasons.append(f"{misses}: {plan.method} at {plan.tolerance:.1e} instead")
            judged = f"judged by series of order {max(orders)} in half steps"
            reasons.append(f"error {error:.1e} in a pilot run with the inputs given, {judged}")
            cost = _cost_driven(asked, plan, found, substeps_counted(run.kernels, run.z), drive)
            return replace(plan, error=error, cost=cost, reasons=tuple(reasons))
        best = min(best, error)
    expected = f"one that these inputs allow; {what_is_reached(best)} with them"
    raise SceneError(f"run.accuracy = {asked.accuracy!r}: expected {expected}", scene.name)


def _run_driven(drive: Drive, scene: Scene, plan: Plan, names: tuple[str, ...], most: float) -> tuple[Motion, Steps]:
    """Return the motion under inputs, which ends after `most` substeps, and the run.

    No event ends it: each plan finds one at another time, and the rest could not be compared.
    """
    run = Steps(scene, plan, drive, names)
    return record(run, names, most), run


def without_loops(scene: Scene, found: Plan) -> Plan:
    """Return a plan without its reasons about loops closed through inputs, as known inputs close no loop."""
    of_loops = reasons_of_held_inputs(Question(scene), found)
    return replace(found, reasons=tuple(reason for reason in found.reasons if reason not in of_loops))


def _tighter(asked: Question, found: Plan) -> Iterator[Plan]:
    """Yield series of ever smaller tolerance, for the whole run."""
    model = methods.series_of_all(asked, 0, 0.0).model
    general = replace(found, model=model, tolerance=asked.accuracy, substep=math.inf)
    for tolerance in methods.ever_tighter(found.tolerance if found.model == model else asked.accuracy):
        order = max(found.order, methods.likely_order(tolerance))
        yield replace(methods.series_plan(general, order, tolerance), span=asked.span)


def _cost_driven(asked: Question, plan: Plan, found: Plan, substeps: float, drive: Drive) -> float:
    """Return the cost of a communication step, ns, given the run's pieces and its number of substeps."""
    steps, pieces = len(drive.time) - 1, len(drive.lengths)
    if plan.model != registry.LOADED_TAYLOR.key:
        return found.cost * pieces / steps
    ns = methods.series_cost(plan.order, asked.load_shares) * methods.work_of(substeps, float(pieces))
    return methods.with_cost(asked, replace(plan, cost=ns / steps)).cost


# What inputs cost


def reasons_of_held_inputs(asked: Question, plan: Plan) -> tuple[str, ...]:
    """Return reasons: the effect of a zero-order hold of the inputs over a communication step on a closed loop.

    No loop can be closed if no output shows the effect of the ports; the energy alone shows no direction. The energy of
    a spring k grows in each step of length h by a part k h^2 / (2 m), or (k h^2 / m)^2 / 12 with first derivatives of
    the inputs. With a damper d in parallel the loop is stable for k h / 2 < d < 2 m / h, as the products of its
    eigenvalues show.
    """
    scene, read = asked.scene, asked.formulas.quantities_read if asked.formulas else set()
    shown = (asked.quantities | read) - {"kinetic_energy"}
    ports, h, body = scene.inputs.ports, scene.run.step, scene.body
    if not ports:
        return ()
    derivatives = all(f"{port}_rate" in plan.kernels.BLOCKS for port in ports)
    remedy = "input derivatives, with which it is of second or third order, or " if derivatives else ""
    why = f"inputs are held over each step of {h:g} s: a loop closed through them is of first order in it"
    held = f"{why}, whatever the accuracy asked", f"remedy: {remedy}a shorter step"
    if "omega_b" in ports or body is None:
        return *held, f"a feedback of the angle on omega_b is unstable where its gain is beyond {2.0 / h:.3g} 1/s"
    lines: tuple[str, ...] = ()
    moved = shown & {"position", "velocity", "acceleration"}
    moved_by_forces, turned_by_torques = moved and set(ports) & set(FORCES), shown - moved and set(ports) & set(TORQUES)
    has_arm = any(body.r_oc_b) or "r_oc_b" in scene.inputs.parameters
    if not (moved_by_forces or turned_by_torques or (shown and has_arm) or scene.inputs.own):
        return ()
    if moved_by_forces and not body.pivot:
        lines = _reasons_of_loop(h, "forces", body.mass, "kg", "N/m", "N s/m")
    if turned_by_torques:
        moments = asked.start.principal_axes[0].tolist()
        least = next(moment for moment in moments if moment > 1e-12 * sum(moments))  # a beam's first is 0
        lines += _reasons_of_loop(h, "torques", least, "kg m2", "N m/rad", "N m s/rad")
    return *held, *lines


def _reasons_of_loop(h: float, loads: str, m: float, inertia: str, spring: str, damper: str) -> tuple[str, ...]:
    gain, enough = f"gains {0.5 * h * h / m:.3g} k of its energy each step", f"{0.5 * h:.3g} k {damper}"
    return (
        f"a spring of k {spring} through {loads} on {m:.3g} {inertia} {gain}, unless a damper of {enough} is beside it",
        f"a damper beyond {2.0 * m / h:.3g} {damper} through {loads} is unstable",
    )
