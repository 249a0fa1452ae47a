"""Plans of scenes with formulas: one model, whose order and tolerance are found by pilot runs.

The series serve any communication step alike, so that what pilot runs find holds for other steps as well.
"""

import math
from dataclasses import replace
from functools import partial

from rbfmu.formulas import motion
from rbfmu.formulas.graph import numbers_of
from rbfmu.models.formulas import EVENT, FormulaModel, OverClosedForm
from rbfmu.models.question import Question
from rbfmu.planning import closed_forms, fitting, methods
from rbfmu.planning.judge import Judge, magnified_round_off, refuse_below
from rbfmu.runs.motion import largest_error, largest_size
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import PARAMETERS, SECTIONS, Scene, SceneError
from rbfmu_kernels.buffer import MOST_LISTED

ORDERS = (16, 14, 18, 12, 20, 10, 22, 8, 24)
"""From the middle, whose runs take as long as those of all on average: whether compiling pays is seen by the first."""
TRIES = 5
"""Tolerances that are tried of an order. Each aims three times lower than the last one's error says, as errors of
formulas follow the tolerance only roughly, and one that is a little tighter costs less than one that misses."""
NS_A_TERM, NS_AN_OPERATION, NS_A_STATE, NS_SHOWN = 0.085, 0.1, 4.2, 7.0
"""What a product of two coefficients, and of each order an operation and a state, cost a series; and what a state costs
a communication step: least squares of measured times of four scenes at five orders, to 15 %, on an AMD EPYC where
built-in series take 1.0 to 1.35 of what `methods.MACHINE` does."""


def _needed(formulas: FormulaModel | None) -> FormulaModel:
    assert formulas is not None
    return formulas


def _general(asked: Question) -> Plan:
    """Return a plan of the scene's formulas whose order and tolerance are still open."""
    rates = _needed(asked.formulas).rates
    return replace(methods.series_of_all(asked, 0, asked.accuracy), states=len(rates) - ("t" in rates))


def formula_plan(asked: Question, judge: Judge) -> Plan:
    """Return the cheapest plan whose error is within the accuracy. Raises SceneError where none is."""
    refuse_below(asked, fitting.SMALLEST)
    if asked.varying:
        return _plan_of_varying(asked, judge)
    tried = list[Plan]()

    def error_at(order: int, tolerance: float) -> float | None:
        plan = _try_out(asked, judge, methods.series_plan(general, order, tolerance))
        if asked.scene.events and plan.error == math.inf and not any(one.error < math.inf for one in tried):
            step = f"{asked.scene.run.step:g} s"
            expected = f"at most {MOST_LISTED:,} in a communication step of {step}, and a motion that can be followed"
            raise SceneError(f"events: expected {expected}", asked.scene.name)
        tried.append(plan)
        return plan.error if plan.tolerance == tolerance else None

    general, aim = _general(asked), fitting.AIM * asked.accuracy
    for k, order in enumerate(ORDERS):  # the error goes with the tolerance, and the cost with its root of that order
        judge.pilots, at_order = len(ORDERS) - k, partial(error_at, order)
        methods.climb(asked.accuracy / 8.0, at_order, (0.1 * aim, aim), aim, (1e-4, 1e4), tries=TRIES, caution=3.0)
    met = [plan for plan in tried if plan.error <= fitting.REACHED * asked.accuracy]
    if not met:
        best = min(tried, key=lambda plan: plan.error)
        raise fitting.refuse_accuracy(asked, best.error, _missed_by_own_outputs(asked, judge, best))
    best = min(met, key=lambda plan: plan.cost)
    reasons = (*what_formulas_read(asked, best), fitting.why_fitted(best, judge.arithmetic))
    return replace(best, pinned=asked.pinned, reasons=reasons)


def _missed_by_own_outputs(asked: Question, judge: Judge, plan: Plan) -> str:
    """Return which own outputs alone miss the accuracy, as those that are zero but for round-off do; or nothing."""
    found, truth, own = judge.motion_by(plan, judge.names), judge.motion, _needed(asked.formulas).own_outputs
    names = [name for name in judge.names if not name.startswith(EVENT)]
    missed = [name for name in names if largest_error(found, truth, (name,), judge.floors) > asked.accuracy]
    if not missed or missed == names or not {*missed} <= {*own}:
        return ""
    of = " and ".join(f"outputs.{name} (at most {largest_size(truth[name]):.1e})" for name in missed)
    return f", of {of}, as errors are relative to the largest; all else meets it"


def closed_plan(asked: Question, judge: Judge) -> Plan | None:
    """Return the plan of own outputs over a closed form that is exact; None where there is none.

    What own outputs lose of the motion's digits is measured. The model holds for other parameters, or refuses them.
    """
    formulas = _needed(asked.formulas)
    plain = _without_formulas(asked.scene, formulas)
    if plain is None:
        return None
    try:
        found = closed_forms.exact_plan(plain, Judge(plain))
    except SceneError:  # beyond round-off: series have the same, and say so of what is asked
        return None
    if found is None:
        return None
    found = methods.with_cost(plain, found)
    over = OverClosedForm(formulas, found.spec.module)
    cost = found.cost + NS_AN_OPERATION * len(over.motion.graph.reached(over.program.wanted.values()))
    found = replace(found, cost=cost, formulas=over)
    error = judge.error_if_soon(found, otherwise=math.inf)
    if error > asked.accuracy:
        return None
    reasons = (*closed_forms.what_is_left_out(plain, found.spec.force_keeps_direction), *found.reasons)
    if formulas.plain_loads:
        acting = {name: load for name in formulas.plain_loads if any(load := getattr(plain.scene.loads, name))}
        came = (f"{name} = [{', '.join(f'{x:.6g}' for x in load)}]" for name, load in acting.items())
        reasons += (f"loads: formulas that come to {' and '.join(came) or 'nothing'}",)
    what = "own outputs: functions of this motion, evaluated on its rows: " if formulas.own_outputs else ""
    reasons += (f"{what}error {error:.1e} in a pilot run, judged in {judge.arithmetic}",)
    return replace(found, error=max(error, found.error), reasons=reasons)


def _without_formulas(scene: Scene, formulas: FormulaModel) -> Question | None:
    """Return the question of a scene for the same motion, as own outputs read it; None where that takes formulas."""
    names = [*dict.fromkeys((*scene.outputs.quantities, *sorted(formulas.quantities_read)))]
    loads, listed = formulas.plain_loads, {*scene.inputs.parameters}
    if loads is None or scene.states or scene.events or scene.inputs.ports or not names:
        return None
    if loads and listed & {*formulas.read_by_loads, *loads}:
        return None
    tables = {name: table for name, table in scene.to_dict().items() if name in SECTIONS and name != "ensemble"}
    tables["outputs"] = {"quantities": names}
    tables["inputs"] = {"parameters": [name for name in PARAMETERS if name in listed]}
    tables["loads"] = {name: x for name, x in tables["loads"].items() if name != "potential"}
    graph = formulas.motion.graph
    try:
        tables["loads"] |= {name: numbers_of(graph, load, graph.numbers) for name, load in loads.items()}
        return Question(Scene.from_dict(tables, scene.name))
    except (ArithmeticError, ValueError):  # no number, or a load that no scene has, as a damping that drives
        return None


def _try_out(asked: Question, judge: Judge, plan: Plan) -> Plan:
    """Return a plan with its error in a pilot run, and its cost, ns a communication step."""
    error, substeps = judge.try_out(plan)
    formulas = _needed(plan.formulas)
    n, slots, states = plan.order, 4 * len(formulas.program.groups), len(formulas.rates)
    of_an_order = len(formulas.program.varying) * NS_AN_OPERATION + states * NS_A_STATE
    series = 0.5 * n * n * slots * NS_A_TERM + n * of_an_order
    cost = series * substeps / asked.scene.run.count + states * NS_SHOWN
    return replace(plan, error=error, cost=cost)


def _plan_of_varying(asked: Question, judge: Judge) -> Plan:
    """Return a plan whose tolerance is one of the whole run, as no pilot run has seen what ports supply."""
    growth = judge.growth()
    loosest, magnified = fitting.tolerance_of_varying(asked, growth), magnified_round_off(growth)
    for tolerance in (loosest, *methods.ever_tighter(loosest)):
        order = max(methods.likely_order(tolerance), 12)
        plan = replace(methods.series_plan(_general(asked), order, tolerance), span=asked.span, pinned=asked.pinned)
        plan = _try_out(asked, judge, plan)
        if plan.error <= asked.accuracy or magnified > asked.accuracy:
            break
    missed = partial(_missed_by_own_outputs, asked, judge, plan)
    why = fitting.why_held_whatever(asked, plan, growth, judge.arithmetic, missed)
    return replace(plan, reasons=(*what_formulas_read(asked, plan), *why))


def what_formulas_read(asked: Question, plan: Plan) -> tuple[str, ...]:
    """Return what is integrated for the formulas and outputs of a scene, and what is not."""
    kept = {name.partition("[")[0] for name in _needed(plan.formulas).rates}
    parts = {"attitude": ("q", 4), "rates": ("omega", 3), "position": ("r_c", 3), "velocity": ("v_c", 3)}
    sizes = [f"{what} {size}" for what, (name, size) in parts.items() if name in kept]
    sizes += [f"{name} {len(row.start)}" for name, row in asked.scene.states.items() if f"{motion.STATE}{name}" in kept]
    left = [what for what, (name, _) in parts.items() if name not in kept]
    left += [name for name in asked.scene.states if f"{motion.STATE}{name}" not in kept]
    lines = [f"states: {', '.join(sizes) or 'none'}"]
    if left:
        lines.append(f"left out: {', '.join(left)}, which no output needs")
    return tuple(lines)
