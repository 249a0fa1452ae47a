"""The method and its step or tolerance that meet a scene's accuracy at the least cost, found by pilot runs."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rbfmu.measures import largest_error
from rbfmu.models import Plan
from rbfmu.pilot import pilot_run, references, substeps_taken, whole_run
from rbfmu.recording import Motion
from rbfmu.scene import Scene, SceneError
from rbfmu.times import communication_steps
from rbfmu.unit import Buffer, filled_buffer, initialize
from rbfmu_kernels.body_memory import body_of, loads_of
from rbfmu_kernels.kicked_top import is_symmetric_top, resonant_step, transverse_moment
from rbfmu_kernels.taylor_series import MOST_ORDER

TIGHTEST = 1e-15
"""The smallest tolerance that double precision serves."""
HIGHEST_ORDER_BESIDE_DOP853 = 8
"""Of series, where they are cheapest: beyond it DOP853 costs 1.2 to 13 times as much, measured on four motions."""
LEAST_ORDER_OF_INPUTS = 8
"""Of series: pilot runs do not see what comes through ports, or what parameters are set to."""
TAYLOR_COSTS = {
    6: (154.0, 154.0, 202.0), 8: (168.0, 179.0, 210.0), 10: (201.0, 226.0, 261.0), 12: (220.0, 272.0, 313.0),
    14: (253.0, 326.0, 366.0), 16: (276.0, 374.0, 387.0), 18: (301.0, 440.0, 449.0), 20: (353.0, 510.0, 517.0),
    22: (398.0, 584.0, 592.0), 24: (423.0, 649.0, 620.0),
}  # fmt: skip
"""ns a substep by order, as the next by examples/bench_substeps.py in one run; only ratios count.

Torques that are known in b; also loads that turn in b; also a force that turns with the body.
"""
DOP853_COSTS, UNCONTROLLED_COSTS = (481.0, 582.0, 774.0), (364.0, 475.0, 621.0)
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


def cheapest_fit(scene: Scene, general: Plan, kicks: bool = True) -> Plan:
    """DOP853, Taylor series of some order, or kicks for a symmetric top: the cheapest that meets the accuracy.

    general: the plan for a body under loads, whose method and settings are to be found; kicks: whether they may be.
    """
    return _Search(scene, general).plan(kicks)


class _Search:
    """Pilot runs of one scene, judged by the same references, and the best that they found."""

    def __init__(self, scene: Scene, general: Plan) -> None:
        self.scene, self.general = scene, general
        self.accuracy = scene.run.accuracy
        self.known = not scene.inputs.ports and not scene.inputs.parameters
        self.steps = communication_steps(scene)
        self.best: _Fit | None = None
        self.met: list[_Fit] = []
        some = _series(general, 8, 1.0)
        self.start = filled_buffer(scene, some)
        initialize(scene, some.unit, self.start)
        self.shares = _load_shares(scene, self.start)
        self.references = references(scene, tightest(general))

    def plan(self, kicks: bool) -> Plan:
        """The cheapest plan; SceneError where none is accurate enough."""
        one, other = self.references
        apart = largest_error(one, other, one)
        if apart > self.accuracy / 3.0:
            motion, _ = pilot_run(self.scene, tightest(self.general))
            raise self._out_of_reach(max(apart, _largest_of(motion, self.references)))
        self._fit_series()
        if not self._is_met() or self._order() <= HIGHEST_ORDER_BESIDE_DOP853:
            self._fit(self._dop853(), self.accuracy / 8.0)
            if self.known:
                self._fit_uncontrolled()
        if self.known and kicks:
            self._fit_kicks()
        assert self.best
        if not self._is_met():
            raise self._out_of_reach(self.best.error)
        return self._explained(self._settled())

    def _is_met(self) -> bool:
        return self.best is not None and self.best.error <= self.accuracy / 3.0

    def _order(self) -> int:
        return self.best.plan.order if self.best else 0

    def _out_of_reach(self, error: float) -> SceneError:
        expected = f"expected one that this scene can meet; the methods here reach {3.0 * error:.1e} here"
        return SceneError(f"run.accuracy = {self.accuracy!r}: {expected}", self.scene.name)

    def _explained(self, best: _Fit) -> Plan:
        found, cost = best.plan, best.cost / self.steps
        how = f"at tolerance {found.tolerance:.1e}" if found.tolerance else f"in steps of {found.substep:.3g} s"
        reason = f"{found.method} {how}: error {best.error:.1e} rad in a pilot run, judged by two tighter ones"
        if self.known:
            return replace(found, error=best.error, cost=cost, reasons=(reason,))
        run = self.scene.run
        share = 0.25 * self.accuracy * run.step / (run.stop - run.start)
        share = max(min(found.tolerance, share), TIGHTEST)
        cheapest, work = self._cheapest_at(share)
        held = f"{cheapest.method}: substeps' estimated errors at most {share:.1e}, a quarter of a step's share"
        pilot = f"inputs at zero, {reason}"
        return replace(cheapest, error=best.error, cost=work / self.steps, reasons=(held, pilot))

    def _settled(self) -> _Fit:
        """The cheapest of those that meet the accuracy whatever the communication step."""
        best: _Fit | None = None
        for fit in sorted(self.met, key=lambda fit: fit.cost):
            if best and fit.cost >= best.cost:
                break
            other = self._whatever_the_step(fit)
            best = other if best is None or other.cost < best.cost else best
        assert best
        return best

    def _whatever_the_step(self, best: _Fit) -> _Fit:
        """The fit, its tolerance such that one communication step for the whole run meets the accuracy as well.

        That is looked at where the communication step has cut substeps short, so that the tolerance says little.
        """
        fit, per_substep = best, best.cost / best.substeps
        if best.substeps > 3.0 * self.steps:
            return best
        ends = [{name: rows[[0, -1]] for name, rows in reference.items()} for reference in self.references]
        while fit.plan.tolerance > TIGHTEST:
            whole = _largest_of(whole_run(self.scene, fit.plan), ends)
            if whole <= self.accuracy and fit.error <= self.accuracy / 3.0:
                break
            plan = replace(fit.plan, tolerance=0.3 * fit.plan.tolerance)
            motion, substeps = pilot_run(self.scene, plan)
            error = _largest_of(motion, self.references)
            fit = replace(fit, plan=plan, error=error, cost=per_substep * substeps, substeps=substeps)
        return fit

    # Families

    def _cost(self, costs: tuple[float, float, float]) -> float:
        plain, *more = costs
        return plain + sum(share * (cost - plain) for share, cost in zip(self.shares, more, strict=True))

    def _of_order(self, order: int) -> _Family:
        return _Family(partial(_series, self.general, order), self._cost(TAYLOR_COSTS[order]), order)

    def _dop853(self) -> _Family:
        return _Family(partial(_controlled, self.general), self._cost(DOP853_COSTS), 8)

    def _fit_series(self) -> None:
        """From a likely order up and down, until two in a row are no cheaper."""
        likely = 2 * round(1.0 + 0.25 * math.log(100.0 / self.accuracy))
        order = min(max(likely, min(TAYLOR_COSTS)), max(TAYLOR_COSTS))
        first = self._fit(self._of_order(order), self.accuracy / 8.0)
        for way in (2, -2):
            other, value, idle = order + way, first, 0
            while other in TAYLOR_COSTS and idle < 2:
                before = self.best
                value = self._fit(self._of_order(other), value)
                idle = idle + 1 if self.best is before else 0
                other += way

    def _cheapest_at(self, tolerance: float) -> tuple[Plan, float]:
        """The cheapest method of error control at a tolerance, and its cost (ns)."""
        families = [self._of_order(order) for order in TAYLOR_COSTS if order >= LEAST_ORDER_OF_INPUTS]
        families.append(self._dop853())
        best, least = None, math.inf
        for family in families:
            if family.cost * self.steps < least:
                trial = family.plan_of(tolerance)
                cost = family.cost * pilot_run(self.scene, trial)[1]
                best, least = (trial, cost) if cost < least else (best, least)
        assert best
        return best, least

    def _fit_uncontrolled(self) -> None:
        """DOP853 in equal steps, from the shortest that would be cheaper than what was found."""
        family = _Family(partial(_uncontrolled, self.general), self._cost(UNCONTROLLED_COSTS), 8, True)
        if self.best and self.best.cost > family.cost * self.steps:
            span = self.scene.run.stop - self.scene.run.start
            self._fit(family, 1.01 * span * family.cost / self.best.cost)

    def _fit_kicks(self) -> None:
        """From the longest step down, where kicks are cheapest; with a bound on the step by their resonances."""
        body, run, omega = self.scene.body, self.scene.run, self.scene.initial.omega_b
        assert body is not None
        if any(self.scene.loads.damping_b) or not is_symmetric_top(body.M):
            return
        turn = math.inf if self._spins_unseen() else 2.0 * math.pi / max(math.hypot(*omega), 1e-300)
        longest = min(0.45 * resonant_step(body.M, omega), 0.45 * turn, run.stop - run.start)
        for order, cost in KICK_COSTS.items():
            self._fit(_Family(partial(_kicks, self.general, order, longest), cost, order, True), longest)

    def _spins_unseen(self) -> bool:
        """Whether a symmetric body's loads stay as they are when it turns about its axis: else that turn resonates."""
        body, loads = body_of(self.start), loads_of(self.start)
        M, arm = np.array(body[1]), np.array(body[3])
        axial = M - transverse_moment(body[1]) * np.eye(3)  # (I_s - I_t) s s^T
        torque = np.array(loads[4]) + np.cross(arm, loads[2])
        return all(
            np.linalg.norm(axial @ v) >= (1.0 - 1e-12) * np.linalg.norm(axial) * np.linalg.norm(v)
            for v in (arm, torque, np.array(loads[2]))
        )

    # Values

    def _fit(self, family: _Family, value: float) -> float:
        """Bring a family's error to where it costs 10 % at most, as long as it may become the best; the last value."""
        bound, error = self.accuracy / 3.0, math.inf
        least = bound * max(1.1**-family.order, 0.1)
        for _ in range(8):
            plan, last = family.plan_of(value), error
            if self._is_dearer(self._least_cost(family, plan)):
                break
            motion, substeps = pilot_run(self.scene, plan)
            error = _largest_of(motion, self.references)
            found = _Fit(plan, error, substeps, family.cost * substeps)
            if self.best is None or _better(found, self.best, bound):
                self.best = found
            if error <= bound:
                self.met.append(found)
            stuck = error == last  # each communication step is one substep, or the step is as short as may be
            enough = error <= bound and (stuck or error >= least)
            if enough or (error > bound and self._is_dearer(found.cost)):
                break
            ratio = math.sqrt(least * bound) / error if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)
            ratio = min(ratio, 0.03) if stuck else ratio
            value *= min(max(ratio ** (1.0 / family.order if family.steps else 1.0), 1e-3), 1e3)
        return value

    def _least_cost(self, family: _Family, plan: Plan) -> float:
        """As far as it is known before a pilot run."""
        known = substeps_taken(self.scene, plan.substep) if math.isfinite(plan.substep) else self.steps
        return family.cost * known

    def _is_dearer(self, cost: float) -> bool:
        """Than what meets the accuracy already."""
        return self._is_met() and self.best is not None and cost >= self.best.cost


def _largest_of(motion: Motion, references: list[Motion]) -> float:
    return max(largest_error(motion, reference, reference) for reference in references)


def _better(a: _Fit, b: _Fit, bound: float) -> bool:
    if a.error <= bound and b.error <= bound:
        return a.cost < b.cost
    return a.error < b.error


def _load_shares(scene: Scene, z: Buffer) -> tuple[float, float]:
    """Whether there may be loads that turn in b, and a force that turns with a free body, as 0 or 1."""
    _, force_a, force_b, torque_a, _ = loads_of(z)
    varying = {*scene.inputs.ports, *scene.inputs.parameters}
    lifted = any(body_of(z)[3]) and (any(force_a) or "force_a" in varying)
    turned = lifted or any(torque_a) or "torque_a" in varying
    pushed = any(force_b) or ("force_b" in varying and body_of(z)[0] > 0.0)
    return float(turned), float(pushed)


# Plans


def tightest(general: Plan) -> Plan:
    """The plan that judges others."""
    return _series(general, MOST_ORDER - 4, 1e-3 * TIGHTEST)


def _series(general: Plan, order: int, tolerance: float) -> Plan:
    value = min(max(tolerance, 1e-3 * TIGHTEST), 0.1)
    method = f"Taylor series of order {order}"
    return replace(general, model="body under loads, by series", method=method, order=order, tolerance=value)


def _controlled(general: Plan, tolerance: float) -> Plan:
    return replace(general, method="DOP853", tolerance=min(max(tolerance, TIGHTEST), 0.1))


def _uncontrolled(general: Plan, substep: float) -> Plan:
    return replace(general, method="DOP853 in equal steps", tolerance=0.0, substep=substep)


def _kicks(general: Plan, order: int, longest: float, substep: float) -> Plan:
    method, step = f"kicks of order {order}", min(substep, longest)
    return replace(general, model="symmetric top", method=method, tolerance=0.0, order=order, substep=step)
