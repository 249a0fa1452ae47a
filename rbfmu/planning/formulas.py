"""Plans of scenes with formulas: one model, whose order and tolerance are found by pilot runs.

The series serve any communication step alike, so that what pilot runs find holds for other steps as well.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

from rbfmu.formulas.motion import STATE
from rbfmu.models import registry
from rbfmu.models.formulas import formulas_of
from rbfmu.models.question import Question
from rbfmu.planning import methods
from rbfmu.planning.fitting import AIM, REACHED, refuse_accuracy
from rbfmu.planning.judge import Judge
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import communication_steps
from rbfmu_kernels.integrators.substeps import ROUND_OFF

ORDERS = range(8, 25, 2)
TRIES = 5
"""Tolerances that are tried of an order."""
NS_A_TERM, NS_AN_OPERATION, NS_A_STATE = 0.6, 0.5, 0.4
"""What a product of two coefficients, an operation and a state's term cost, in four lanes: on `methods.MACHINE`."""


def general_plan(asked: Question) -> Plan:
    """Return a plan of the scene's formulas whose order and tolerance are still open."""
    formulas = formulas_of(asked.scene)
    assert formulas is not None
    states = len(formulas.rates) - ("t" in formulas.rates)
    return Plan(registry.FORMULAS.key, "", states, tolerance=asked.accuracy, formulas=formulas)


def formula_plan(judge: Judge) -> Plan:
    """Return the cheapest plan whose error is within the accuracy. Raises SceneError where none is."""
    asked, general = judge.asked, general_plan(judge.asked)
    asked.start.check()
    if asked.varying:
        return _plan_of_varying(judge, general)
    best, least = None, math.inf
    for order in ORDERS:
        for found in _tried(judge, general, order):
            least = min(least, found.error)
            if found.error <= REACHED * asked.accuracy and (best is None or found.cost < best.cost):
                best = found
    if best is None:
        raise refuse_accuracy(asked, least)
    how = f"{best.method} at tolerance {best.tolerance:.1e}: error {best.error:.1e}"
    reason = f"{how} in a pilot run, judged in {judge.arithmetic}"
    return replace(best, pinned=asked.pinned, reasons=(*what_formulas_read(asked, general), reason))


def _tried(judge: Judge, general: Plan, order: int) -> Iterator[Plan]:
    """Yield plans of an order with their errors and costs, until one is as near to the accuracy as pays.

    The error goes with the tolerance, and the cost with its root of that order.
    """
    accuracy = judge.asked.accuracy
    tolerance = accuracy / 8.0
    for _ in range(TRIES):
        plan = methods.series_plan(general, order, tolerance)
        error, substeps = judge.try_out(plan)
        yield replace(plan, error=error, cost=_cost(judge, plan, substeps))
        if 0.1 * AIM * accuracy <= error <= AIM * accuracy or plan.tolerance != tolerance:
            return
        ratio = AIM * accuracy / (3.0 * error) if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)
        tolerance *= min(max(ratio, 1e-4), 1e4)


def _cost(judge: Judge, plan: Plan, substeps: float) -> float:
    """Return ns a communication step."""
    formulas = plan.formulas
    assert formulas is not None
    n, slots = plan.order, 4 * len(formulas.layout.groups)
    series = 0.5 * n * n * slots * NS_A_TERM + n * len(formulas.program.varying) * NS_AN_OPERATION
    steps = communication_steps(judge.scene)
    return series * substeps / steps + n * len(formulas.rates) * NS_A_STATE


def _plan_of_varying(judge: Judge, general: Plan) -> Plan:
    """Return a plan whose errors add up to a quarter of the accuracy, as magnified as a pilot run's.

    What ports supply no pilot run has seen: the tolerance is one of the whole run, see `fitting`.
    """
    asked, growth = judge.asked, judge.growth()
    tolerance = max(0.25 * asked.accuracy / growth, methods.TIGHTEST)
    order = max(methods.likely_order(tolerance), 12)
    plan = replace(methods.series_plan(general, order, tolerance), span=asked.span, pinned=asked.pinned)
    error, substeps = judge.try_out(plan)
    magnified = min(4.0 * ROUND_OFF * growth, 1.0)
    if max(error, magnified) > asked.accuracy:
        raise refuse_accuracy(asked, max(error, magnified))
    what = " and ".join(sorted(asked.varying))
    held = f"{plan.method}: estimated errors of a run add up to at most {tolerance:.1e}, whatever {what} may be"
    pilot = f"error {error:.1e} in a pilot run with inputs at zero, judged in {judge.arithmetic}"
    reasons = (*what_formulas_read(asked, general), held, pilot)
    return replace(plan, error=error, cost=_cost(judge, plan, substeps), reasons=reasons)


def what_formulas_read(asked: Question, plan: Plan) -> tuple[str, ...]:
    """Return what is integrated for the formulas and outputs of a scene, and what is not."""
    formulas = plan.formulas
    assert formulas is not None
    kept = {name.partition("[")[0] for name in formulas.rates}
    parts = {"attitude": ("q", 4), "rates": ("omega", 3), "path": ("r_c", 3), "velocity": ("v_c", 3)}
    sizes = [f"{what} {size}" for what, (name, size) in parts.items() if name in kept]
    sizes += [f"{name} {len(row.start)}" for name, row in asked.scene.states.items() if f"{STATE}{name}" in kept]
    left = [what for what, (name, _) in parts.items() if name not in kept]
    lines = [f"states: {', '.join(sizes) or 'none'}"]
    if left:
        lines.append(f"left out: {', '.join(left)}, which no output shows and no formula reads that matters to one")
    return tuple(lines)
