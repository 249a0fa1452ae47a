"""The method and its step or tolerance that meet a scene's accuracy at the least cost, found by pilot runs."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rbfmu.planning import reasons as say
from rbfmu.planning.candidates import acting_loads, varying_parameters
from rbfmu.planning.judge import Judge
from rbfmu.runs.model_buffer import Buffer, filled_buffer, initialize
from rbfmu.runs.models import Plan
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.body.memory import body_of, has_pivot, loads_of
from rbfmu_kernels.body.needs import needs_translation
from rbfmu_kernels.integrators.splitting import is_symmetric_top, resonant_step, transverse_moment
from rbfmu_kernels.integrators.substeps import ROUND_OFF, substeps_in
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.models.one_axis_taylor import ORDERS
from rbfmu_kernels.quantities import DISSIPATIVE, NOT_IN_CLOSED_FORMS

TIGHTEST = 1e-15
"""The smallest tolerance that double precision serves."""
AT_REST = 0.01
"""Of the accuracy: the error of a motion in which what would grow has not begun to."""
LOOSEST = 10.0
"""Times the accuracy: the largest tolerance, as looser estimates say little of the errors in other steps."""
SMALLEST = 1e-14
"""The accuracy that any motion is promised at best: outputs have round-off of their own."""
KEPT, REACHED = 1.0 / 3.0, 0.8
"""Of the accuracy: the error that settings are fitted to, and the largest that is accepted where none is smaller."""
MAX_WORK = 1e7
"""Substeps of all pilot runs (some five seconds), after which nothing cheaper is looked for."""
HIGHER = 2
"""Orders that series may have beyond the likely one."""
LEAST_ORDER_OF_INPUTS = 8
"""Of series: pilot runs do not see what comes through ports, or what parameters are set to."""
UNCUT = 20.0
"""Substeps in a communication step from which on longer ones change little."""
LONGER, SHORTER = (2, 4, 10, 25, 50, 100), (2, 3, 4, 6, 10)
"""Communication steps that an importer may take as one, besides all of the run's; parts that it may take of one."""
ORDERS_OF_SERIES = range(6, MAX_ORDER + 1, 2)
SERIES_COSTS = ((58.0, 14.3), (10.0, 24.0), (41.0, 23.1))
"""(a, b) of a + b N ns a substep at order N, on `costs.MACHINE`; examples/benchmarks/substeps.py fits these lines.

Torques that are known in b; also loads that turn in b; also a force that turns with the body.
"""
SWING_COSTS = {4: 55.0, 8: 85.0, 16: 185.0}
KICK_COSTS = {2: 76.0, 4: 470.0, 6: 864.0}


@dataclass(frozen=True)
class _Family:
    """A method with a setting to be found: its plan at a value, ns a substep, order.

    steps: whether the value is a step, to whose power `order` the error goes; else a tolerance.
    """

    plan_of: Callable[[float], Plan]
    cost: float
    order: int
    steps: bool = False


@dataclass(frozen=True)
class _Fit:
    plan: Plan
    error: float
    substeps: float
    cost: float
    order: int
    """Of the error in the plan's tolerance (1) or step."""
    other: float = 0.0
    """The error in other communication steps."""


def cheapest_fit(scene: Scene, general: Plan, judge: Judge, kicks: bool = True) -> Plan:
    """Taylor series of some order, or kicks for a symmetric top: the cheapest that meets the accuracy.

    general: the plan whose method and settings are to be found, its tolerance the scene's accuracy; kicks: whether they
    may be.
    Raises SceneError where none is accurate enough.
    """
    search = _Search(scene, judge, general)
    if scene.run.accuracy < SMALLEST:
        raise search.out_of_reach(REACHED * SMALLEST)
    return search.plan_of_varying() if varying_parameters(scene) else search.plan(kicks)


def swinging_fit(scene: Scene, general: Plan, judge: Judge) -> Plan | None:
    """Series of one angle that meet the accuracy at the least cost; None where none does."""
    search = _Search(scene, judge, general)
    for order in reversed(ORDERS):
        plan_of = partial(_swing, general, order)
        search.fit(_Family(plan_of, SWING_COSTS[order], order), 0.1 * scene.run.accuracy)
    return search.settled(search.bound) if search.is_met() else None


class _Search:
    """Pilot runs of one scene, and the best that they found."""

    def __init__(self, scene: Scene, judge: Judge, general: Plan) -> None:
        self.scene, self.judge, self.general = scene, judge, general
        self.accuracy = scene.run.accuracy
        self.bound = KEPT * self.accuracy
        self.steps = communication_steps(scene)
        self.best: _Fit | None = None
        self.met: list[_Fit] = []
        self.work = 0.0
        some = _series(general, 8, 1.0)
        self.start = filled_buffer(scene, some)
        initialize(scene, some.unit, self.start)
        self.shares = load_shares(scene, self.start)

    def plan(self, kicks: bool) -> Plan:
        """The cheapest plan; SceneError where none is accurate enough."""
        self._try_tightest()
        self._fit_series()
        if kicks:
            self._fit_kicks()
        assert self.best
        if not self.is_met():
            raise self.out_of_reach(self.best.error)
        return self.settled(self.bound)

    def plan_of_varying(self) -> Plan:
        """The cheapest whose substeps' errors, as the motion magnifies them, add up to a quarter of the accuracy."""
        span, growth = self.scene.run.stop - self.scene.run.start, self.judge.growth()
        tolerance = max(0.25 * self.accuracy / growth, TIGHTEST)
        found = self._cheapest_over(span, tolerance)
        while found.error > REACHED * self.accuracy and tolerance > TIGHTEST:
            tolerance = max(0.1 * tolerance, TIGHTEST)
            found = self._cheapest_over(span, tolerance)
        magnified = min(4.0 * ROUND_OFF * growth, 1.0)
        if magnified <= self.accuracy and found.error <= self.accuracy:
            return self._explained_varying(found)
        if magnified > self.accuracy and (self.scene.inputs.ports or found.error <= AT_REST * self.accuracy):
            return self._explained_varying(found, say.unstable_at_zero_inputs(growth))
        raise self.out_of_reach(max(found.error, magnified))

    def is_met(self) -> bool:
        """Whether something is accurate enough."""
        return bool(self.met)

    def out_of_reach(self, error: float) -> SceneError:
        """What is said where no method's error is smaller."""
        reached = error / REACHED
        expected = f"expected one that this scene can meet; the methods here reach {reached:.1e} here"
        if reached > 1e-3:
            expected += "; the motion magnifies round-off: see `rbfmu stability`, or ask for a shorter run"
        return SceneError(f"run.accuracy = {self.accuracy!r}: {expected}", self.scene.name)

    def _explained_varying(self, found: _Fit, *more: str) -> Plan:
        plan, what = found.plan, " and ".join(sorted(varying_parameters(self.scene)))
        held = (
            f"{plan.method}: estimated errors of a run add up to at most {plan.tolerance:.1e}, whatever {what} may be"
        )
        pilot = f"error {found.error:.1e} in a pilot run with inputs at zero, judged in double-double arithmetic"
        reasons = (held, pilot, *more)
        return replace(plan, error=found.error, cost=found.cost / self.steps, reasons=reasons)

    # What is accurate enough whatever the communication step

    def settled(self, bound: float) -> Plan:
        """The cheapest of those that meet the accuracy whatever the communication step."""
        best: _Fit | None = None
        for fit in sorted(self.met, key=lambda fit: fit.cost):
            if best and fit.cost >= best.cost:
                break
            other = self._whatever_the_step(fit)
            best = other if best is None or other.cost < best.cost else best
        assert best
        error = self.judge.try_all_steps(best.plan, best.error)
        if error > self.accuracy:
            raise self.out_of_reach(error)
        found = best.plan
        how = f"at tolerance {found.tolerance:.1e}" if found.tolerance else f"in steps of {found.substep:.3g} s"
        reason = f"{found.method} {how}: error {error:.1e} in a pilot run, judged in double-double arithmetic"
        more = () if best.other <= self.accuracy else (say.only_in_own_steps(best.other),)
        return replace(found, error=error, cost=best.cost / self.steps, reasons=(reason, *more))

    def _whatever_the_step(self, fit: _Fit) -> _Fit:
        """The fit, its tolerance or step such that other communication steps meet the accuracy as well."""
        while fit.substeps <= UNCUT * self.steps:
            worst = max(self._errors_in_other_steps(fit))
            fit = replace(fit, other=worst)
            if worst <= REACHED * self.accuracy:
                return fit
            ratio = max(0.3 * self.accuracy / worst, 1e-3) if math.isfinite(worst) else 1e-3
            tighter = _tightened(fit.plan, ratio ** (1.0 / fit.order))
            if tighter == fit.plan:
                return fit
            error, substeps = self._tried(tighter)
            fit = replace(fit, plan=tighter, error=error, substeps=substeps, cost=fit.cost / fit.substeps * substeps)
        return fit

    def _errors_in_other_steps(self, fit: _Fit) -> Iterator[float]:
        """In longer communication steps; in shorter ones where those of the scene do not yet cut substeps short."""
        count = len(self.judge.steps)
        for at_once in (*LONGER, count):
            if at_once <= count:
                yield self.judge.try_out(fit.plan, at_once)[0]
        if fit.substeps > self.steps:
            yield from (self.judge.try_out(fit.plan, parts=parts)[0] for parts in SHORTER)

    # Families

    def _of_order(self, order: int) -> _Family:
        return _Family(partial(_series, self.general, order), series_cost(order, self.shares), order)

    def _try_tightest(self) -> None:
        """What can be reached at all: where that is little, it is accepted, and nothing is looked for in vain."""
        reached = math.inf
        for order in (MAX_ORDER - 8, MAX_ORDER):
            plan = _series(self.general, order, TIGHTEST)
            error, substeps = self._tried(plan)
            self._note(_Fit(plan, error, substeps, self._of_order(order).cost * substeps, 1), REACHED * self.accuracy)
            reached = min(reached, error)
            if error <= self.bound:
                return
        if reached > REACHED * self.accuracy:
            raise self.out_of_reach(reached)
        self.bound = REACHED * self.accuracy

    def _fit_series(self) -> None:
        """From a likely order up and down, until two in a row are no cheaper.

        Up no further than HIGHER: what estimates say of long steps of a high order does not hold in other steps.
        """
        likely = 2 * round(1.0 + 0.25 * math.log(100.0 / self.accuracy))
        order = min(max(likely, ORDERS_OF_SERIES[0]), ORDERS_OF_SERIES[-1])
        first = self.fit(self._of_order(order), self.accuracy / 8.0)
        for way in (2, -2):
            other, value, idle = order + way, first, 0
            while other in ORDERS_OF_SERIES and idle < 2 and other <= order + HIGHER:
                before = self.best
                value = self.fit(self._of_order(other), value)
                idle = idle + 1 if self.best is before else 0
                other += way

    def _cheapest_over(self, span: float, tolerance: float) -> _Fit:
        """The cheapest series at a tolerance for the whole run; of those that meet it, if any do."""
        best: _Fit | None = None
        for family in map(self._of_order, range(LEAST_ORDER_OF_INPUTS, MAX_ORDER + 1, 2)):
            if best is None or best.error > self.bound or family.cost * self.steps < best.cost:
                plan = replace(family.plan_of(tolerance), span=span)
                error, substeps = self._tried(plan)
                found = _Fit(plan, error, substeps, family.cost * substeps, 1)
                best = found if best is None or _better(found, best, REACHED * self.accuracy) else best
        assert best
        return best

    def _fit_kicks(self) -> None:
        """From the longest step down, where kicks are cheapest; with a bound on the step by their resonances."""
        body, run, omega = self.scene.body, self.scene.run, self.scene.initial.omega_b
        assert body is not None
        unserved = acting_loads(self.scene.loads) & (DISSIPATIVE | NOT_IN_CLOSED_FORMS)
        if unserved or not is_symmetric_top(body.M):
            return
        turn = math.inf if self._spins_unseen() else 2.0 * math.pi / max(math.hypot(*omega), 1e-300)
        longest = min(0.45 * resonant_step(body.M, omega), 0.45 * turn, run.stop - run.start)
        for order, cost in KICK_COSTS.items():
            self.fit(_Family(partial(_kicks, self.general, order, longest), cost, order, True), longest)

    def _spins_unseen(self) -> bool:
        """Whether a symmetric body's loads stay as they are when it turns about its axis: else that turn resonates."""
        body, loads = body_of(self.start), loads_of(self.start)
        M, arm = np.array(body.inertia), np.array(body.arm_b)
        axial = M - transverse_moment(body.inertia) * np.eye(3)  # (I_s - I_t) s s^T
        torque = np.array(loads.torque_b) + np.cross(arm, loads.force_b)
        return all(
            np.linalg.norm(axial @ v) >= (1.0 - 1e-12) * np.linalg.norm(axial) * np.linalg.norm(v)
            for v in (arm, torque, np.array(loads.force_b))
        )

    # Values

    def fit(self, family: _Family, value: float) -> float:
        """Bring a family's error to where it costs 10 % at most, as long as it may become the best; the last value."""
        bound, error = self.bound, math.inf
        least = bound * max(1.1**-family.order, 0.1)
        for _ in range(8):
            plan, last = family.plan_of(value), error
            if self._is_dearer(self._least_cost(family, plan)) or (self.is_met() and self.work > MAX_WORK):
                break
            error, substeps = self._tried(plan)
            found = _Fit(plan, error, substeps, family.cost * substeps, family.order if family.steps else 1)
            self._note(found, bound)
            stuck = error == last  # each communication step is one substep, or the step is as short as may be
            enough = error <= bound and (stuck or error >= least)
            if enough or (error > bound and self._is_dearer(found.cost)):
                break
            ratio = math.sqrt(least * bound) / error if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)
            ratio = min(ratio, 0.03) if stuck else ratio
            value *= min(max(ratio ** (1.0 / family.order if family.steps else 1.0), 1e-3), 1e3)
        return value

    def _tried(self, plan: Plan) -> tuple[float, float]:
        """Error and substeps of a pilot run."""
        error, counted = self.judge.try_out(plan)
        taken = counted
        if math.isfinite(plan.substep):
            taken = self.steps * (substeps_in(self.scene.run.step, plan.substep) or math.inf)
        taken = max(taken, float(self.steps))
        self.work += min(taken, MAX_WORK)
        return error, taken

    def _note(self, found: _Fit, bound: float) -> None:
        if self.best is None or _better(found, self.best, bound):
            self.best = found
        if found.error <= bound:
            self.met.append(found)

    def _least_cost(self, family: _Family, plan: Plan) -> float:
        """As far as it is known before a pilot run."""
        known = float(self.steps)
        if math.isfinite(plan.substep):
            known *= substeps_in(self.scene.run.step, plan.substep) or math.inf
        return family.cost * known

    def _is_dearer(self, cost: float) -> bool:
        """Than what meets the accuracy already."""
        return self.is_met() and self.best is not None and cost >= self.best.cost


def _better(a: _Fit, b: _Fit, bound: float) -> bool:
    if a.error <= bound and b.error <= bound:
        return a.cost < b.cost
    return a.error < b.error


def series_cost(order: int, shares: tuple[float, float]) -> float:
    """Ns a substep; shares: as `load_shares`."""
    plain, *more = (a + b * order for a, b in SERIES_COSTS)
    return plain + sum(share * (cost - plain) for share, cost in zip(shares, more, strict=True))


def load_shares(scene: Scene, z: Buffer) -> tuple[float, float]:
    """Whether there may be loads that turn in b, and a force that turns with a body whose path is asked, as 0 or 1."""
    loads = loads_of(z)
    varying = {*scene.inputs.ports, *scene.inputs.parameters}
    levered = any(body_of(z).arm_b) and (any(loads.force_a) or "force_a" in varying)
    turned = levered or any(loads.torque_a) or "torque_a" in varying
    pushed = any(loads.force_b) or ("force_b" in varying and not has_pivot(z))
    return float(turned), float(pushed and needs_translation(z))


# Plans


def _tightened(plan: Plan, ratio: float) -> Plan:
    """With a smaller tolerance, or step."""
    if plan.tolerance > 0.0:
        return replace(plan, tolerance=min(plan.tolerance, max(ratio * plan.tolerance, 1e-3 * TIGHTEST)))
    return replace(plan, substep=ratio * plan.substep)


def _series(general: Plan, order: int, tolerance: float) -> Plan:
    value = min(max(tolerance, 1e-3 * TIGHTEST), LOOSEST * general.tolerance)
    method = f"Taylor series of order {order}"
    return replace(general, method=method, order=order, tolerance=value)


def _swing(general: Plan, order: int, tolerance: float) -> Plan:
    value = min(max(tolerance, 1e-3 * TIGHTEST), LOOSEST * general.tolerance)
    return replace(general, method=f"Taylor series of order {order}", order=order, tolerance=value)


def _kicks(general: Plan, order: int, longest: float, substep: float) -> Plan:
    method, step = f"kicks of order {order}", min(substep, longest)
    return replace(general, model="symmetric top", method=method, tolerance=0.0, order=order, substep=step)
