"""Plans of scenes with formulas: one model, whose order and tolerance are found by pilot runs.

The series do not depend on the communication step, so that errors of pilot runs are valid for other steps as well.
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
"""The orders to try, from the middle, whose run takes the average time, so that the first shows if compiling pays."""
TRIES = 5
"""How many tolerances are tried of an order. The last error is multiplied by three for the next one, as errors of
formulas follow the tolerance only roughly, and a slightly tighter one costs less than one that misses."""
NS_A_TERM, NS_AN_OPERATION, NS_A_STATE, NS_SHOWN = 0.085, 0.1, 4.2, 7.0
"""Costs, ns: in a series of a product of two coefficients, and for each order of an operation and of a state; and in a
communication step of a state. Least squares of measured times of four scenes at five orders, to 15 %, on an AMD EPYC
where built-in series take 1.0 to 1.35 of what `methods.MACHINE` does."""


def _formulas_of(owner: Question | Plan) -> FormulaModel:
    assert owner.formulas is not None
    return owner.formulas


def _general(asked: Question) -> Plan:
    """Return a plan of the scene's formulas whose order and tolerance are still open."""
    rates = _formulas_of(asked).rates
    return replace(methods.series_of_all(asked, 0, asked.accuracy), states=len(rates) - ("t" in rates))


def formula_plan(asked: Question, judge: Judge) -> Plan:
    """Return the cheapest plan whose error is within the accuracy. Raises SceneError if there is none."""
    refuse_below(asked, fitting.SMALLEST)
    if asked.varying:
        return _plan_of_varying(asked, judge)
    trials = list[Plan]()

    def error_at(order: int, tolerance: float) -> float | None:
        plan = _try_out(asked, judge, methods.series_plan(general, order, tolerance))
        if asked.scene.events and plan.error == math.inf and not any(trial.error < math.inf for trial in trials):
            step = f"{asked.scene.run.step:g} s"
            expected = f"at most {MOST_LISTED:,} in a communication step of {step}, and a motion that can be followed"
            raise SceneError(f"events: expected {expected}", asked.scene.name)
        trials.append(plan)
        return plan.error if plan.tolerance == tolerance else None

    general, aim = _general(asked), fitting.AIM * asked.accuracy
    for k, order in enumerate(ORDERS):  # error ~ tolerance, cost ~ tolerance^(-1 / order)
        judge.pilots, at_order = len(ORDERS) - k, partial(error_at, order)
        methods.climb(asked.accuracy / 8.0, at_order, (0.1 * aim, aim), aim, (1e-4, 1e4), tries=TRIES, caution=3.0)
    accurate = [plan for plan in trials if plan.error <= fitting.REACHED * asked.accuracy]
    if not accurate:
        best = min(trials, key=lambda plan: plan.error)
        raise fitting.accuracy_error(asked, best.error, _missed_by_own_outputs(asked, judge, best))
    best = min(accurate, key=lambda plan: plan.cost)
    reasons = (*what_formulas_read(asked, best), fitting.why_fitted(best, judge.arithmetic))
    return replace(best, pinned=asked.pinned, reasons=reasons)


def _missed_by_own_outputs(asked: Question, judge: Judge, plan: Plan) -> str:
    """Return text that names own outputs if they alone miss the accuracy, as those that are only round-off; else ""."""
    found, truth, own = judge.motion_by(plan, judge.names), judge.motion, _formulas_of(asked).own_outputs
    names = [name for name in judge.names if not name.startswith(EVENT)]
    missed = [name for name in names if largest_error(found, truth, (name,), judge.floors) > asked.accuracy]
    if not missed or missed == names or not {*missed} <= {*own}:
        return ""
    named = " and ".join(f"outputs.{name} (at most {largest_size(truth[name]):.1e})" for name in missed)
    return f", of {named}, as errors are relative to the largest; all else meets it"


def closed_plan(asked: Question, judge: Judge) -> Plan | None:
    """Return the plan of own outputs over an exact closed form, or None if there is none.

    The error of own outputs is measured. The model is valid for other parameters, or refuses them.
    """
    formulas = _formulas_of(asked)
    plain = _without_formulas(asked.scene, formulas)
    if plain is None:
        return None
    try:
        found = closed_forms.exact_plan(plain, Judge(plain))
    except SceneError:  # accuracy below round-off: series raise the same error, for the whole scene
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
    prefix = "own outputs: functions of this motion, evaluated on its rows: " if formulas.own_outputs else ""
    reasons += (f"{prefix}error {error:.1e} in a pilot run, judged in {judge.arithmetic}",)
    return replace(found, error=max(error, found.error), reasons=reasons)


def _without_formulas(scene: Scene, formulas: FormulaModel) -> Question | None:
    """Return the question for the same motion without formulas, with all that own outputs read; None if impossible."""
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
    except (ArithmeticError, ValueError):  # not a number, or a load that a scene refuses, such as negative damping
        return None


def _try_out(asked: Question, judge: Judge, plan: Plan) -> Plan:
    """Return a plan with its error in a pilot run, and its cost of a communication step, ns."""
    error, substeps = judge.try_out(plan)
    formulas = _formulas_of(plan)
    n, slots, states = plan.order, 4 * len(formulas.program.groups), len(formulas.rates)
    of_an_order = len(formulas.program.varying) * NS_AN_OPERATION + states * NS_A_STATE
    series = 0.5 * n * n * slots * NS_A_TERM + n * of_an_order
    cost = series * substeps / asked.scene.run.count + states * NS_SHOWN
    return replace(plan, error=error, cost=cost)


def _plan_of_varying(asked: Question, judge: Judge) -> Plan:
    """Return a plan whose tolerance is for the whole run, as pilot runs do not contain what ports supply."""
    growth = judge.growth()
    loosest, magnified = fitting.tolerance_of_varying(asked, growth), magnified_round_off(growth)
    for tolerance in (loosest, *methods.ever_tighter(loosest)):
        for order in (max(methods.likely_order(tolerance), methods.LOW_ORDER), methods.LOW_ORDER):
            plan = replace(methods.series_plan(_general(asked), order, tolerance), span=asked.span, pinned=asked.pinned)
            plan = _try_out(asked, judge, plan)
            if plan.error < math.inf:
                break
        if plan.error <= asked.accuracy or magnified > asked.accuracy:
            break
    missed = partial(_missed_by_own_outputs, asked, judge, plan)
    why = fitting.why_held_whatever(asked, plan, growth, judge.arithmetic, missed)
    return replace(plan, reasons=(*what_formulas_read(asked, plan), *why))


def what_formulas_read(asked: Question, plan: Plan) -> tuple[str, ...]:
    """Return reasons: which states are integrated for the formulas and outputs of a scene, and which are not."""
    kept = {name.partition("[")[0] for name in _formulas_of(plan).rates}
    parts = {"attitude": ("q", 4), "rates": ("omega", 3), "position": ("r_c", 3), "velocity": ("v_c", 3)}
    sizes = [f"{part} {size}" for part, (name, size) in parts.items() if name in kept]
    sizes += [f"{name} {len(row.start)}" for name, row in asked.scene.states.items() if f"{motion.STATE}{name}" in kept]
    left = [part for part, (name, _) in parts.items() if name not in kept]
    left += [name for name in asked.scene.states if f"{motion.STATE}{name}" not in kept]
    lines = [f"states: {', '.join(sizes) or 'none'}"]
    if left:
        lines.append(f"left out: {', '.join(left)}, which no output needs")
    return tuple(lines)
