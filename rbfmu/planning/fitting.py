"""The cheapest method, with its step or tolerance, that meets a scene's accuracy, found by pilot runs.

The error of a run is neither its tolerance nor the error of a substep: errors of substeps add up, cancel, and grow with
the motion. So a setting is tried, the judge measures the error, and the next setting follows from it: the error is
proportional to a power of the setting, step^order (Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I,
II.3), or about tolerance^1. The cost is the number of substeps times ns a substep, and never measured by a clock, so
that a scene has the same plan on every machine.

An importer may take other communication steps than the scene's. Shorter ones cut substeps; longer ones leave long
substeps uncut, whose error estimates are less reliable. So a plan is also tried in other communication steps.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from rbfmu.models.question import GROWING, Question
from rbfmu.models.registry import FREE_BODY_FORCE, FREE_TRIAXIAL, LOADED_TAYLOR, ONE_AXIS_TAYLOR
from rbfmu.planning import methods
from rbfmu.planning.judge import Judge, magnified_round_off, refuse_below, what_is_reached
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import SceneError
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.integrators.substeps import substeps_in
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.models.free import ORDERS

AT_REST = 0.01
"""An error below this part of the accuracy shows that no disturbance has begun to grow, as in an exact equilibrium.

Such a plan is accepted with a reason that says so; before, it was refused as soon as a parameter was listed.
"""
SMALLEST = 1e-14
"""The smallest accuracy that is promised for any motion, as outputs have round-off of their own."""
AIM, REACHED = 1.0 / 3.0, 0.8
"""AIM: the error to which settings are fitted; REACHED: the largest accepted if none is smaller; parts of the accuracy.

Errors change in jumps, as a communication step has whole substeps: four in place of five make an error of order 8 six
times larger. The rest is for what pilot runs do not contain: other communication steps, and errors of the truth.
Of twenty plans (five motions at 1e-4 to 1e-10) in four communication steps that planning does not try, the worst error
was 1.1 of the accuracy where AIM is 0.1, 2.6 where it is a third, and 4.4 where it is 0.8. Costs are alike to 5 %.
"""
MAX_WORK = 1e7
"""Substeps of all pilot runs (some five seconds), after which no cheaper plan is tried."""
HIGHER = 2
"""How far the order of series may be above the likely one, see `_Search._fit_series`."""
LEAST_ORDER_OF_INPUTS = 8
"""The least order of series with inputs: pilot runs do not contain what ports supply or parameters are set to."""
UNCUT = 20.0
"""With more substeps in a communication step, other communication steps change little: the last substep is cut at the
step's end, which shortens all of them by a twentieth at most."""
AS_SUBSTEPS = (0.3, 1.0, 3.0)
"""With more than UNCUT: numbers of shorter steps, over that of substeps, in which the error is measured and reported.

A series then serves several steps, or is cut by each, and reaches farther than in the scene's own steps. Of 40 tops in
one to three steps, at 1e-6 to 1e-1, the errors of 10 were then 1.2 to 26 times the accuracy.
"""
LONGER, SHORTER = (2, 4, 10, 25, 50, 100), (2, 3, 4, 6, 10)
"""LONGER: numbers of communication steps that an importer may take as one, besides the whole run. SHORTER: numbers of
parts into which it may cut one."""
POINT_COST = 86.0
"""The cost of a point, ns, on `methods.MACHINE`.

The whole quadrature costs 0.54 to 0.95 of series in steps over which the body turns by 0.01 to 1 rad, as measured once.
"""
MAX_TRIALS = 6
"""How many numbers of panels are tried of a rule: twice the most, 3, of 118 fits to random forces."""
MAX_PANELS, MAX_POINTS = 1e6, 2e7
"""The most panels of a communication step, and points of a whole trial, some two seconds of work."""


class Trial(NamedTuple):
    """A candidate with its error and cost in a pilot run, its substeps, and its error in other communication steps."""

    plan: Plan
    substeps: float
    other_error: float = 0.0


def cheapest_fit(asked: Question, judge: Judge, full: bool = False) -> Plan:
    """Return the cheapest plan that integrates all degrees of freedom, by series or splitting, within the accuracy.

    full: only series, which integrate all that is judged. Raises SceneError if none is accurate enough.
    """
    refuse_below(asked, SMALLEST)
    search = _Search(asked, judge)
    return search.plan_of_varying() if asked.varying else search.plan(() if full else methods.splittings(asked))


def of_one_angle(asked: Question, judge: Judge) -> Plan | None:
    """Return the cheapest plan of one angle under forces fixed in space, by series, or None if none is accurate."""
    if not ONE_AXIS_TAYLOR.serves(asked):
        return None
    search = _Search(asked, judge)
    for candidate in methods.one_axis_series(asked):
        search.fit(candidate, 0.1 * search.accuracy)
    if not search.accurate_trials:
        return None
    found = search.cheapest_in_any_step()
    why = "rotation: one angle, every load turns the body about one principal axis; 2 of 7 states"
    return replace(found, reasons=(why, *found.reasons))


def of_path_alone(asked: Question, judge: Judge) -> Plan | None:
    """Return the plan of exact rotation with a quadrature for the path, or None if it cannot be used.

    For a symmetric body, return an integration instead if it costs less.
    """
    if not any(asked.scene.loads.force_b) or not asked.translation or not FREE_BODY_FORCE.serves(asked):
        return None
    found = cheapest_quadrature(asked, judge)
    if found is None or not asked.start.is_symmetric:
        return found
    try:
        return min(cheapest_fit(asked, judge), found, key=lambda plan: methods.with_cost(asked, plan).cost)
    except SceneError:
        return found


def accuracy_error(asked: Question, error: float, why: str = "") -> SceneError:
    """Return the error for an accuracy below what methods reach; why: the quantities that miss it, if known."""
    reached = error / REACHED
    expected = f"expected one that this scene can meet; {what_is_reached(reached)}{why}"
    if not why and 1e-3 < reached < math.inf:
        expected += "; perhaps the motion magnifies round-off (see `rbfmu stability`, or ask for a shorter run)"
        expected += ", or a formula has a pulse (give it edges by where(...))" if asked.scene.loads.formulas else ""
    return SceneError(f"run.accuracy = {asked.accuracy!r}: {expected}", asked.scene.name)


def tolerance_of_varying(asked: Question, growth: float) -> float:
    """Return the tolerance of a whole run, such that its errors, magnified by growth, are a quarter of the accuracy."""
    return max(0.25 * asked.accuracy / growth, methods.TIGHTEST)


class _Search:
    """Pilot runs of one scene, and the best that they found."""

    def __init__(self, asked: Question, judge: Judge) -> None:
        self.asked, self.judge, self.accuracy = asked, judge, asked.accuracy
        self.bound = AIM * self.accuracy
        self.steps = asked.scene.run.count
        self.best: Trial | None = None
        self.accurate_trials: list[Trial] = []
        self.work = 0.0
        self.asked.start.check()

    def plan(self, others: Iterable[Plan]) -> Plan:
        """Return the cheapest plan. Raises SceneError if none is accurate enough."""
        self._try_tightest()
        self._fit_series()
        for candidate in others:  # from the longest step down, where they are cheapest
            self.fit(candidate, candidate.substep)
        return self.cheapest_in_any_step()

    def plan_of_varying(self) -> Plan:
        """Return the cheapest plan whose substeps' errors, magnified by the motion, are a quarter of the accuracy.

        Pilot runs do not contain what ports will supply, or what parameters will be. The tolerance is therefore for the
        whole run, and each substep may use its share in time: whatever the inputs, the estimates add up to it at most.
        The rest of the accuracy is for what estimates miss, and for inputs under which errors grow faster than without.
        If the motion magnifies round-off beyond the accuracy, only an error that shows it at rest is accepted.
        """
        ports, growth = self.asked.scene.inputs.ports, self.judge.growth()
        loosest = tolerance_of_varying(self.asked, growth)
        at_last = () if ports else (methods.FAR_BELOW_ROUND_OFF,)
        bound = REACHED if ports or magnified_round_off(growth) <= self.accuracy else AT_REST
        for tolerance in (loosest, *methods.ever_tighter(loosest), *at_last):
            found = self._cheapest_over(tolerance, bound * self.accuracy).plan
            if found.error <= bound * self.accuracy:
                break
        return replace(found, reasons=why_held_whatever(self.asked, found, growth, self.judge.arithmetic))

    # Accuracy in any communication step

    def cheapest_in_any_step(self) -> Plan:
        """Return the cheapest of the plans that meet the accuracy whatever the communication step."""
        cheapest, *others = sorted(self.accurate_trials, key=lambda trial: trial.plan.cost)
        best = self._tighten_for_other_steps(cheapest)
        for trial in others:
            if trial.plan.cost >= best.plan.cost:
                break
            best = min(best, self._tighten_for_other_steps(trial), key=lambda trial: trial.plan.cost)
        if best.plan.error > self.accuracy:  # by round-off of shorter substeps
            best = cheapest._replace(other_error=max(self._errors_in_other_steps(cheapest)))
        found = replace(best.plan, error=self.judge.try_all_steps(best.plan))
        if found.error > self.accuracy:
            raise accuracy_error(self.asked, found.error)
        reasons = [why_fitted(found, self.judge.arithmetic)]
        if UNCUT * self.steps < best.substeps < 0.1 * MAX_WORK:
            pieces = [part * best.substeps for part in AS_SUBSTEPS]
            best = best._replace(other_error=max(self.judge.try_between(found, n) for n in pieces))
        if best.other_error > self.accuracy:
            reasons.append(f"in other communication steps than the scene's the error is up to {best.other_error:.1e}")
        return replace(found, reasons=tuple(reasons))

    def _tighten_for_other_steps(self, trial: Trial) -> Trial:
        """Return the candidate at a tolerance or step that meets the accuracy also in other communication steps."""
        while trial.substeps <= UNCUT * self.steps:
            worst = max(self._errors_in_other_steps(trial))
            trial = trial._replace(other_error=worst)
            ratio = max(0.3 * self.accuracy / worst, 1e-3) if 0.0 < worst < math.inf else 1e-3
            tighter = methods.tighter(trial.plan, ratio)
            if worst <= REACHED * self.accuracy or tighter == trial.plan:
                break
            trial = self._trial(tighter)._replace(other_error=worst)
        return trial

    def _errors_in_other_steps(self, trial: Trial) -> Iterator[float]:
        """Yield errors in longer communication steps, and in shorter ones if the scene's have several substeps."""
        count = len(self.judge.steps)
        for at_once in (*LONGER, count):
            if at_once <= count:
                yield self.judge.try_out(trial.plan, at_once)[0]
        if trial.substeps > self.steps:
            yield from (self.judge.try_out(trial.plan, parts=parts)[0] for parts in SHORTER)

    # Methods

    def _try_tightest(self) -> None:
        """Check that the accuracy can be met at all; if no error is below the bound, accept one of up to REACHED.

        With the tightest tolerance alone rates of 1e-8 rad/s were off by 46 times the accuracy, and nothing said so.
        """
        reached = math.inf
        tolerances = (methods.TIGHTEST, methods.FAR_BELOW_ROUND_OFF)
        for order, tolerance in [(k, x) for x in tolerances for k in (MAX_ORDER - 8, MAX_ORDER)]:
            tightest = methods.series_of_all(self.asked, order, tolerance)
            reached = min(reached, self._keep(self._trial(tightest), REACHED * self.accuracy))
            if reached <= self.bound:
                return
        if reached > REACHED * self.accuracy:
            raise accuracy_error(self.asked, reached)
        self.bound = REACHED * self.accuracy

    def _fit_series(self) -> None:
        """Fit orders from the likely one up and down, until two in a row are no cheaper.

        Orders go at most HIGHER up, as error estimates of long substeps of a high order are not valid in other steps,
        unless no communication step has several substeps: then a series of higher order may serve many steps.
        """
        order = methods.likely_order(self.accuracy)
        first = self.fit(methods.series_of_all(self.asked, order, self.accuracy), self.accuracy / 8.0)
        for change in (2, -2):
            other, value, idle = order + change, first, 0
            while other in methods.ORDERS_OF_SERIES and idle < 2:
                before = self.best
                if other > order + HIGHER and not (before and before.substeps <= self.steps):
                    break
                value = self.fit(methods.series_of_all(self.asked, other, self.accuracy), value)
                idle = idle + 1 if self.best is before else 0
                other += change

    def _cheapest_over(self, tolerance: float, bound: float) -> Trial:
        """Return the cheapest series at a tolerance for the whole run, if possible among those within a bound."""
        best: Trial | None = None
        span = self.asked.span if tolerance >= methods.TIGHTEST else 0.0  # a share of less would be below round-off
        least = methods.likely_order(tolerance) if self.judge.is_slow else LEAST_ORDER_OF_INPUTS
        for order in range(MAX_ORDER, least - 1, -2):  # down, as low orders take very many substeps
            if best and self.work > MAX_WORK:
                break
            plan = replace(methods.series_of_all(self.asked, order, tolerance), span=span)
            if best is None or best.plan.error > min(bound, self.bound) or self._cost(plan) < best.plan.cost:
                found = self._trial(plan)
                best = found if best is None or _is_better(found, best, bound) else best
        assert best
        return best

    # Values

    def fit(self, candidate: Plan, value: float) -> float:
        """Fit a candidate's setting so that it costs at most 10 % more than necessary; return the last setting tried.

        Stop once it cannot be the cheapest. The cost is proportional to 1 / step, the error to step^order: an error
        above bound / 1.1^order costs at most 10 % too much. The next setting aims at the geometric mean of these.
        """
        least = self.bound * max(1.1**-candidate.order, 0.1)

        def error_at(value: float) -> float | None:
            plan = methods.at_setting(candidate, value)
            if self._is_dearer(self._cost(plan)) or (self.accurate_trials and self.work > MAX_WORK):
                return None
            found = self._trial(plan)
            error = self._keep(found, self.bound)
            return None if error > self.bound and self._is_dearer(found.plan.cost) else error

        aim, power = math.sqrt(least * self.bound), methods.exponent(candidate)
        return methods.climb(value, error_at, (least, self.bound), aim, (1e-3, 1e3), power)

    def _trial(self, plan: Plan) -> Trial:
        error, counted = self.judge.try_out(plan)
        substeps, steps = self._substeps(plan, counted), float(self.steps)
        self.work += min(max(substeps, steps), MAX_WORK)
        return Trial(replace(plan, error=error, cost=self._cost(plan, counted)), substeps)

    def _cost(self, plan: Plan, counted: float = 0.0) -> float:
        """Return the cost of a communication step, ns; counted: substeps of a pilot run, 0 before one."""
        return methods.substep_cost(self.asked, plan) * self._substeps(plan, counted) / self.steps

    def _substeps(self, plan: Plan, counted: float) -> float:
        """Return the number of substeps that cost as much as the run; counted: by a pilot run, 0 before one."""
        steps, scene = float(self.steps), self.asked.scene
        if math.isfinite(plan.substep):
            return steps * (evaluated(substeps_in, scene.run.step, plan.substep) or math.inf)
        if plan.model == LOADED_TAYLOR.key and not scene.inputs.ports:  # ports may change at each step
            return methods.work_of(counted, steps)
        return max(counted, steps)

    def _keep(self, found: Trial, bound: float) -> float:
        """Keep a candidate that is the best or meets a bound; return its error."""
        if self.best is None or _is_better(found, self.best, bound):
            self.best = found
        if found.plan.error <= bound:
            self.accurate_trials.append(found)
        return found.plan.error

    def _is_dearer(self, cost: float) -> bool:
        """Return whether a cheaper candidate already meets the accuracy."""
        return bool(self.accurate_trials) and self.best is not None and cost >= self.best.plan.cost


def _is_better(a: Trial, b: Trial, bound: float) -> bool:
    both_accurate = a.plan.error <= bound and b.plan.error <= bound
    return a.plan.cost < b.plan.cost if both_accurate else a.plan.error < b.plan.error


# Quadrature


def cheapest_quadrature(asked: Question, judge: Judge) -> Plan | None:
    """Return the cheapest plan by Gauss's rule in panels of a communication step; None if all miss the accuracy.

    The rotation is exact, and the path an integral of a smooth function of time: with n points a panel of length h, the
    error is proportional to h^(2 n). Panels are never longer in other communication steps, so that it is not larger.
    """
    run, best = asked.scene.run, None
    grows = bool(asked.varying & GROWING)
    if grows and "kinetic_energy" in asked.judged:
        return None
    round_off = methods.EXACT + FREE_BODY_FORCE.conditioning(asked)
    bound = asked.accuracy / 3.0 - round_off
    for order in ORDERS:
        panels = 1
        for _ in range(MAX_TRIALS):
            cost = POINT_COST * order * panels
            if best and cost >= best.cost:
                break
            rule = f"Gauss's rule of {order} point{'s' if order > 1 else ''}"
            method, length = f"elliptic functions, {rule}", run.step / panels
            trial = Plan(FREE_BODY_FORCE.key, method, 0, substep=length, order=order, pinned=asked.pinned)
            error, _ = judge.try_out(trial, absolute=grows)
            if error <= bound:
                path = f"path: {rule} in panels of {length:.3g} s: error {error + round_off:.1e}"
                reasons = (FREE_TRIAXIAL.reason(asked), f"{path}, {asked.accuracy:g} asked")
                best = replace(trial, error=error + round_off, cost=cost, reasons=reasons)
                break
            ratio = (error / bound) ** (0.5 / order) if bound > 0.0 else math.inf
            if not ratio * panels < MAX_PANELS:
                break
            panels = max(panels + 1, math.ceil(ratio * panels))
            if panels * order * asked.scene.run.count > MAX_POINTS:
                break
    return best


# Why


def why_fitted(plan: Plan, arithmetic: str) -> str:
    """Return a plan's setting and its error in a pilot run as a reason; arithmetic: of the judge."""
    how = f"at tolerance {plan.tolerance:.1e}" if plan.tolerance else f"in steps of {plan.substep:.3g} s"
    return f"{plan.method} {how}: error {plan.error:.1e} in a pilot run, judged in {arithmetic}"


def held_over_a_run(plan: Plan) -> str:
    """Return the part of a reason that says what the tolerance bounds: errors of a run, or of substeps."""
    added = "a run add up to" if plan.span else "substeps are"
    return f"{plan.method}: estimated errors of {added} at most {plan.tolerance:.1e}"


def why_held_whatever(
    asked: Question, plan: Plan, growth: float, arithmetic: str, missed: Callable[[], str] = str
) -> tuple[str, ...]:
    """Return the reasons why a plan is valid for inputs and parameters that no pilot run contained.

    Raises SceneError if it misses the accuracy; missed: returns `why` of `accuracy_error`.
    """
    first = f"{held_over_a_run(plan)}, whatever {' and '.join(sorted(asked.varying))} may be"
    start, magnified = asked.scene.inputs.at_start, magnified_round_off(growth)
    reasons = (first, f"error {plan.error:.1e} in a pilot run with {start}, judged in {arithmetic}")
    named = missed() if plan.error > asked.accuracy else ""
    round_off_is_allowed = asked.scene.inputs.ports or plan.error <= AT_REST * asked.accuracy
    if magnified > asked.accuracy and round_off_is_allowed and not named:
        grown = f"with {start} the motion magnifies an error {growth:.1e} times"
        return (*reasons, f"{grown}, round-off beyond the accuracy: only the errors of substeps are held to it")
    if (worst := max(plan.error, magnified)) > asked.accuracy:
        raise accuracy_error(asked, worst, named)
    return reasons
