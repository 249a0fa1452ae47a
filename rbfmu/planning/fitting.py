"""The method, and its step or tolerance, that meet a scene's accuracy at the least cost, found by pilot runs.

The error of a run is neither its tolerance nor the error of a substep: errors of substeps add up, cancel, and grow with
the motion. So a setting is tried, the judge measures the error, and the next setting follows from it, as the error goes
with a power of the setting: of a step with the method's order (Hairer, Norsett, Wanner: Solving Ordinary Differential
Equations I, II.3), of a tolerance about with the first. Costs are substeps counted times ns a substep and never a
clock's, so that a scene has the same plan on every machine.

An importer may take other communication steps than the scene's. These cut substeps short, or leave long ones uncut
whose estimates hold less well, so that what was fitted in the scene's own steps is tried in others as well.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from rbfmu.models.question import GROWING, Question
from rbfmu.models.registry import LOADED_TAYLOR, moments_of
from rbfmu.planning import methods
from rbfmu.planning import reasons as say
from rbfmu.planning.judge import Judge
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.scene import SceneError
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.integrators.substeps import ROUND_OFF, substeps_in
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.models.free import ORDERS

AT_REST = 0.01
"""The part of the accuracy up to which an error shows that whatever would grow has not begun to."""
SMALLEST = 1e-14
"""The accuracy that any motion is promised at best: outputs have round-off of their own."""
AIM, REACHED = 1.0 / 3.0, 0.8
"""Parts of the accuracy: to which settings are fitted, and up to which an error is accepted where none is smaller."""
MAX_WORK = 1e7
"""Substeps of all pilot runs (some five seconds), after which nothing cheaper is looked for."""
HIGHER = 2
"""The number of orders that series may have beyond the likely one."""
LEAST_ORDER_OF_INPUTS = 8
"""The least order of series with inputs: pilot runs do not see what ports supply, or what parameters are set to."""
UNCUT = 20.0
"""The number of substeps in a communication step from which on longer steps change little."""
LONGER, SHORTER = (2, 4, 10, 25, 50, 100), (2, 3, 4, 6, 10)
"""Numbers of communication steps that an importer may take as one, besides the whole run, and of parts of one."""
POINT_COST = 86.0
"""The cost of a point, ns, on `methods.MACHINE`."""
MAX_TRIALS = 6
MAX_PANELS, MAX_POINTS = 1e6, 2e7
"""The most panels of a communication step, and points of a whole trial, some two seconds of work."""


@dataclass(frozen=True)
class _Fit:
    plan: Plan
    error: float
    substeps: float
    cost: float
    order: int
    """The power of the plan's tolerance (1) or step that the error goes with."""
    other: float = 0.0
    """The error in other communication steps."""


def cheapest_fit(judge: Judge, general: Plan, others: Iterable[tuple[methods.Method, float]] = ()) -> Plan:
    """Return Taylor series of some order, or another method: the cheapest that meets the accuracy.

    general: the plan whose method and settings are to be found, with the scene's accuracy as its tolerance.
    others: methods besides series, with the longest step of each, s. Raises SceneError where none is accurate enough.
    """
    if judge.asked.accuracy < SMALLEST:
        raise refuse_accuracy(judge.asked, REACHED * SMALLEST)
    search = _Search(judge, general)
    return search.plan_of_varying() if judge.asked.varying else search.plan(others)


def swinging_fit(judge: Judge, general: Plan) -> Plan | None:
    """Return series of one angle that meet the accuracy at the least cost; None where none does."""
    search = _Search(judge, general)
    for method in methods.one_axis_series(general):
        search.fit(method, 0.1 * search.accuracy)
    return search.whatever_the_step(search.bound) if search.met else None


def refuse_accuracy(asked: Question, error: float) -> SceneError:
    """Return the error for an accuracy below what methods reach."""
    reached = error / REACHED
    expected = f"expected one that this scene can meet; the methods here reach {reached:.1e} here"
    if 1e-3 < reached < math.inf:
        expected += "; the motion magnifies round-off: see `rbfmu stability`, or ask for a shorter run"
    return SceneError(f"run.accuracy = {asked.accuracy!r}: {expected}", asked.scene.name)


def tolerance_of_varying(asked: Question, growth: float) -> float:
    """Return the tolerance of a whole run whose errors, so magnified, make a quarter of the accuracy."""
    return max(0.25 * asked.accuracy / growth, methods.TIGHTEST)


def magnified_round_off(growth: float) -> float:
    """Return what a motion makes of four units in the last place."""
    return min(4.0 * ROUND_OFF * growth, 1.0)


class _Search:
    """Pilot runs of one scene, and the best that they found."""

    def __init__(self, judge: Judge, general: Plan) -> None:
        self.judge, self.general = judge, general
        self.scene, self.asked, self.accuracy = judge.scene, judge.asked, judge.asked.accuracy
        self.bound = AIM * self.accuracy
        self.steps = communication_steps(self.scene)
        self.best: _Fit | None = None
        self.met: list[_Fit] = []
        self.work = 0.0
        self.asked.start.check()
        self.shares = self.asked.load_shares

    def plan(self, others: Iterable[tuple[methods.Method, float]]) -> Plan:
        """Return the cheapest plan; raise SceneError where none is accurate enough."""
        self._try_tightest()
        self._fit_series()
        for method, longest in others:  # from the longest step down, where they are cheapest
            self.fit(method, longest)
        assert self.best
        if not self.met:
            raise refuse_accuracy(self.asked, self.best.error)
        return self.whatever_the_step(self.bound)

    def plan_of_varying(self) -> Plan:
        """Return the cheapest plan whose substeps' errors, magnified by the motion, make a quarter of the accuracy.

        What ports supply, or parameters become, no pilot run has seen. The tolerance is therefore one of the whole run,
        of which each substep may use its share in time: whatever the inputs, the estimates add up to it at most. The
        rest of the accuracy is for what estimates miss, and for inputs under which errors grow faster than without.
        Where the motion makes more than the accuracy of round-off, four units in the last place, no tolerance helps.
        """
        growth = self.judge.growth()
        loosest = tolerance_of_varying(self.asked, growth)
        for tolerance in (loosest, *methods.ever_tighter(loosest)):
            found = self._cheapest_over(tolerance)
            if found.error <= REACHED * self.accuracy:
                break
        magnified = magnified_round_off(growth)
        if magnified <= self.accuracy and found.error <= self.accuracy:
            return self._with_reasons(found)
        if magnified > self.accuracy and (self.scene.inputs.ports or found.error <= AT_REST * self.accuracy):
            grown = f"with inputs at zero the motion magnifies an error {growth:.1e} times"
            held = "round-off beyond the accuracy: only the errors of substeps are held to it"
            return self._with_reasons(found, f"{grown}, {held}")
        raise refuse_accuracy(self.asked, max(found.error, magnified))

    def _with_reasons(self, found: _Fit, *more: str) -> Plan:
        why = say.why_held_whatever(self.asked, found.plan, found.error, self.judge.arithmetic)
        return replace(found.plan, error=found.error, cost=found.cost / self.steps, reasons=(*why, *more))

    # What is accurate enough whatever the communication step

    def whatever_the_step(self, bound: float) -> Plan:
        """Return the cheapest of the plans that meet the accuracy whatever the communication step."""
        best: _Fit | None = None
        for fit in sorted(self.met, key=lambda fit: fit.cost):
            if best and fit.cost >= best.cost:
                break
            other = self._tighten_for_other_steps(fit)
            best = other if best is None or other.cost < best.cost else best
        assert best
        error = self.judge.try_all_steps(best.plan, best.error)
        if error > self.accuracy:
            raise refuse_accuracy(self.asked, error)
        reasons = [say.why_fitted(best.plan, error, self.judge.arithmetic)]
        if best.other > self.accuracy:
            reasons.append(f"in other communication steps than the scene's the error is up to {best.other:.1e}")
        return replace(best.plan, error=error, cost=best.cost / self.steps, reasons=tuple(reasons))

    def _tighten_for_other_steps(self, fit: _Fit) -> _Fit:
        """Return the fit, its tolerance or step such that other communication steps meet the accuracy as well."""
        while fit.substeps <= UNCUT * self.steps:
            worst = max(self._errors_in_other_steps(fit))
            fit = replace(fit, other=worst)
            if worst <= REACHED * self.accuracy:
                return fit
            ratio = max(0.3 * self.accuracy / worst, 1e-3) if math.isfinite(worst) else 1e-3
            tighter = methods.tighter_plan(fit.plan, ratio ** (1.0 / fit.order))
            if tighter == fit.plan:
                return fit
            error, substeps = self._try_out(tighter)
            fit = replace(fit, plan=tighter, error=error, substeps=substeps, cost=fit.cost / fit.substeps * substeps)
        return fit

    def _errors_in_other_steps(self, fit: _Fit) -> Iterator[float]:
        """Yield errors in longer communication steps, and in shorter ones if the scene's do not cut substeps yet."""
        count = len(self.judge.steps)
        for at_once in (*LONGER, count):
            if at_once <= count:
                yield self.judge.try_out(fit.plan, at_once)[0]
        if fit.substeps > self.steps:
            yield from (self.judge.try_out(fit.plan, parts=parts)[0] for parts in SHORTER)

    # Methods

    def _try_tightest(self) -> None:
        """Find whether the accuracy can be met at all, and accept an error near it where none is much smaller."""
        reached = math.inf
        for order, part in [(k, p) for p in (1.0, 1e-3) for k in (MAX_ORDER - 8, MAX_ORDER)]:  # 1e-3: small rates
            method = methods.series(self.general, order, self.shares)
            found = self._try_method(method, method.plan_of(part * methods.TIGHTEST))
            self._note(found, REACHED * self.accuracy)
            reached = min(reached, found.error)
            if found.error <= self.bound:
                return
        if reached > REACHED * self.accuracy:
            raise refuse_accuracy(self.asked, reached)
        self.bound = REACHED * self.accuracy

    def _fit_series(self) -> None:
        """Fit from a likely order up and down, until two in a row are no cheaper.

        Orders go up no further than HIGHER, as estimates for long steps of a high order do not hold in other steps,
        except where no step is cut: of a higher order a series may come to serve many steps.
        """
        order = methods.likely_order(self.accuracy)
        first = self.fit(methods.series(self.general, order, self.shares), self.accuracy / 8.0)
        for way in (2, -2):
            other, value, idle = order + way, first, 0
            while other in methods.ORDERS_OF_SERIES and idle < 2:
                before = self.best
                if other > order + HIGHER and not (before and before.substeps <= self.steps):
                    break
                value = self.fit(methods.series(self.general, other, self.shares), value)
                idle = idle + 1 if self.best is before else 0
                other += way

    def _cheapest_over(self, tolerance: float) -> _Fit:
        """Return the cheapest series at a tolerance for the whole run, among those that meet it if any do."""
        best: _Fit | None = None
        least = methods.likely_order(tolerance) if self.judge.is_slow else LEAST_ORDER_OF_INPUTS
        for order in range(least, MAX_ORDER + 1, 2):
            method = methods.series(self.general, order, self.shares)
            plan = replace(method.plan_of(tolerance), span=self.asked.span)
            if best is None or best.error > self.bound or self._least_cost(method, plan) < best.cost:
                found = self._try_method(method, plan)
                best = found if best is None or _better(found, best, REACHED * self.accuracy) else best
        assert best
        return best

    # Values

    def fit(self, method: methods.Method, value: float) -> float:
        """Fit a method's setting to cost at most 10 % more than it need, while it may be the best; return the last.

        The cost goes with 1 / step and the error with step^order: an error above bound / 1.1^order costs no more than
        10 % too much. The next setting aims at the middle between the two on a logarithmic scale.
        """
        bound, error = self.bound, math.inf
        least = bound * max(1.1**-method.order, 0.1)
        for _ in range(8):
            plan, last = method.plan_of(value), error
            if self._is_dearer(self._least_cost(method, plan)) or (self.met and self.work > MAX_WORK):
                break
            found = self._try_method(method, plan)
            error = found.error
            self._note(found, bound)
            stuck = error == last  # each communication step is one substep, or the step is as short as may be
            enough = error <= bound and (stuck or error >= least)
            if enough or (error > bound and self._is_dearer(found.cost)):
                break
            ratio = methods.ratio_to(math.sqrt(least * bound), error)
            value = methods.nearer(value, min(ratio, 0.03) if stuck else ratio, 1e3, method.exponent)
        return value

    def _try_method(self, method: methods.Method, plan: Plan) -> _Fit:
        error, substeps = self._try_out(plan)
        return _Fit(plan, error, substeps, method.cost * substeps, method.exponent)

    def _try_out(self, plan: Plan) -> tuple[float, float]:
        """Return error and number of substeps of a pilot run: less than steps where a series serves many of them."""
        error, counted = self.judge.try_out(plan)
        taken = counted
        if math.isfinite(plan.substep):
            taken = self.steps * (evaluated(substeps_in, self.scene.run.step, plan.substep) or math.inf)
        if counted < self.steps:
            kept = self._may_keep_series(plan)
            taken = methods.work_of(counted, float(self.steps)) if kept else max(taken, float(self.steps))
        self.work += min(max(taken, float(self.steps)), MAX_WORK)
        return error, taken

    def _may_keep_series(self, plan: Plan) -> bool:  # ports may change at each step
        return plan.model == LOADED_TAYLOR.key and not self.scene.inputs.ports

    def _note(self, found: _Fit, bound: float) -> None:
        if self.best is None or _better(found, self.best, bound):
            self.best = found
        if found.error <= bound:
            self.met.append(found)

    def _least_cost(self, method: methods.Method, plan: Plan) -> float:
        """Return the cost as far as it is known before a pilot run."""
        if self._may_keep_series(plan):
            return 0.0
        known = float(self.steps)
        if math.isfinite(plan.substep):
            known *= evaluated(substeps_in, self.scene.run.step, plan.substep) or math.inf
        return method.cost * known

    def _is_dearer(self, cost: float) -> bool:
        """Return whether something that costs less meets the accuracy already."""
        return bool(self.met) and self.best is not None and cost >= self.best.cost


def _better(a: _Fit, b: _Fit, bound: float) -> bool:
    if a.error <= bound and b.error <= bound:
        return a.cost < b.cost
    return a.error < b.error


# Quadrature


def cheapest_quadrature(judge: Judge, general: Plan) -> Plan | None:
    """Return the cheapest points of Gauss's rule and panels a communication step; None where they miss the accuracy.

    The rotation is exact, and the path an integral over time alone, of a smooth function: with n points a panel of
    length h, Gauss's rule has an error that goes with h^(2 n). Panels are no longer in other communication steps, so
    that their error is no larger either.
    """
    asked, scene = judge.asked, judge.scene
    grows = bool(asked.varying & GROWING)
    if grows and "kinetic_energy" in judge.names:
        return None
    kept = methods.EXACT + general.spec.conditioning(asked)
    bound = asked.accuracy / 3.0 - kept
    best: Plan | None = None
    for order in ORDERS:
        panels = 1
        for _ in range(MAX_TRIALS):
            cost = POINT_COST * order * panels
            if best and cost >= best.cost:
                break
            method = f"elliptic functions, {_rule(order)}"
            trial = replace(general, method=method, order=order, substep=scene.run.step / panels)
            error, _ = judge.try_out(trial, absolute=grows)
            if error <= bound:
                best = replace(trial, error=error + kept, cost=cost)
                break
            ratio = (error / bound) ** (0.5 / order) if bound > 0.0 else math.inf
            if not ratio * panels < MAX_PANELS:
                break
            panels = max(panels + 1, math.ceil(ratio * panels))
            if panels * order * communication_steps(scene) > MAX_POINTS:
                break
    if best is None:
        return None
    rotation = f"rotation: no torque, moments {moments_of(asked)} kg m2: elliptic functions"
    path = f"path: {_rule(best.order)} in panels of {best.substep:.3g} s: error {best.error:.1e}"
    return replace(best, reasons=(rotation, f"{path}, {asked.accuracy:g} asked"))


def _rule(order: int) -> str:
    return f"Gauss's rule of {order} point{'s' if order > 1 else ''}"
