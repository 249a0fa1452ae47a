"""Methods with a setting to be found, and what plans cost."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.models.question import Question
from rbfmu.models.registry import FORMULAS, LOADED_SPLITTING, LOADED_TAYLOR, MODELS
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators.splitting import resonant_step, transverse_moment
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.models.one_axis import ORDERS
from rbfmu_kernels.quantities import OUTPUT

EXACT = 1e-14
"""What closed forms lose by round-off, the exact rotation among them."""
TIGHTEST = 1e-15
"""The smallest tolerance that double precision serves."""
LOOSEST = 1.0
"""The largest tolerance over the accuracy.

Looser estimates say little of the errors in other communication steps: with 10, a run in one step of more substeps than
`fitting` tries in shorter ones was off by 7.4 times the accuracy in these.
"""
ORDERS_OF_SERIES = range(6, MAX_ORDER + 1, 2)
SERIES_COSTS = ((58.0, 14.3), (10.0, 24.0), (41.0, 23.1))
"""(a, b) of a + b N ns a substep at order N, on `methods.MACHINE`; examples/benchmarks/substeps.py fits these lines.

The lines are for torques that are known in b alone, for loads that turn in b as well, and for a force that turns with
the body.
"""
KEPT_SERIES_COST = 1.6
"""The cost of a series that serves many communication steps over that of a substep of the same order."""
ONE_AXIS_COSTS = {4: 55.0, 8: 85.0, 16: 185.0}
SPLITTING_COSTS = {2: 76.0, 4: 470.0, 6: 864.0}
"""Ns a substep, by order."""
RESONANCE = 0.45
"""The longest step, as a part of that at which splitting resonates, or of the turn that it resonates with."""


@dataclass(frozen=True)
class Method:
    """A method with a setting to be found: its plan at a value, ns a substep, and order.

    steps: whether the value is a step, with whose power `order` the error goes; else it is a tolerance.
    """

    plan_of: Callable[[float], Plan]
    cost: float
    order: int
    steps: bool = False

    @property
    def exponent(self) -> int:
        """Return the power of the setting that the error goes with."""
        return self.order if self.steps else 1


# Taylor series


def series(general: Plan, order: int, shares: tuple[float, float]) -> Method:
    """Return the series of an order; shares: `Question.load_shares`."""
    return Method(partial(series_plan, general, order), series_cost(order, shares), order)


def one_axis_series(general: Plan) -> Iterator[Method]:
    """Yield the series of one angle, from the highest order."""
    for order in reversed(ORDERS):
        yield Method(partial(series_plan, general, order), ONE_AXIS_COSTS[order], order)


def whole_series(scene: Scene, order: int, tolerance: float) -> Plan:
    """Return the plan of the series that serves whatever acts in a scene; see `series_of_all`."""
    return series_of_all(Question(scene), order, tolerance)


def series_of_all(asked: Question, order: int, tolerance: float) -> Plan:
    """Return the plan of the series that serves whatever acts; order: 0 where it is still to be found."""
    model = FORMULAS if asked.formulas else LOADED_TAYLOR
    return Plan(model.key, "", 0, tolerance=tolerance, order=order, formulas=asked.formulas)


def likely_order(accuracy: float) -> int:
    """Return the order of the series that is likely to meet an accuracy at the least cost.

    A substep of order p costs p^2, and reaches the further the higher p: the cost of a run is least near
    p = 1 - ln(tolerance) / 2 (Jorba, Zou: Experimental Mathematics 14 (2005) 99-117).
    """
    order = 2 * round(1.0 + 0.25 * math.log(100.0 / accuracy))
    return min(max(order, ORDERS_OF_SERIES[0]), ORDERS_OF_SERIES[-1])


def series_plan(general: Plan, order: int, tolerance: float) -> Plan:
    """Return the plan of a series; general: a plan with the scene's accuracy as its tolerance."""
    value = min(max(tolerance, 1e-3 * TIGHTEST), LOOSEST * general.tolerance)
    return replace(general, method=f"Taylor series of order {order}", order=order, tolerance=value)


def series_cost(order: int, shares: tuple[float, float]) -> float:
    """Return ns a substep; shares: `Question.load_shares`."""
    plain, *more = (a + b * order for a, b in SERIES_COSTS)
    return plain + sum(share * (cost - plain) for share, cost in zip(shares, more, strict=True))


def work_of(substeps: float, steps: float) -> float:
    """Return the substeps that cost as much, where fewer than steps are series that serve many of these."""
    return substeps if substeps >= steps else min(KEPT_SERIES_COST * substeps, steps)


def serves_many_steps(plan: Plan, shares: tuple[float, float]) -> bool:
    """Return whether the plan, whose cost is that of its substeps alone, makes less than a series a step."""
    return plan.model == LOADED_TAYLOR.key and 0.0 < plan.cost < series_cost(plan.order, shares)


# Splitting


def splittings(asked: Question, general: Plan) -> Iterator[tuple[Method, float]]:
    """Yield the splitting methods that serve the scene's body, and the longest step of each, s."""
    if not LOADED_SPLITTING.accepts(asked):
        return
    omega = asked.scene.initial.omega_b
    turn = math.inf if _spins_unseen(asked.start) else 2.0 * math.pi / max(math.hypot(*omega), 1e-300)
    resonant = interpreted(resonant_step)(asked.body.M, omega)
    longest = min(RESONANCE * resonant, RESONANCE * turn, asked.span)
    for order, cost in SPLITTING_COSTS.items():
        yield Method(partial(_splitting_plan, general, order, longest), cost, order, True), longest


def _spins_unseen(start: BodyAtStart) -> bool:
    """Return whether a symmetric body's turn about its axis leaves loads as they are; else that turn resonates."""
    body, loads = start.body, start.loads
    M, arm = np.array(body.inertia), np.array(body.arm_b)
    axial = M - interpreted(transverse_moment)(body.inertia) * np.eye(3)  # (I_s - I_t) s s^T
    torque = np.array(loads.torque_b) + np.cross(arm, loads.force_b)
    return all(
        np.linalg.norm(axial @ v) >= (1.0 - 1e-12) * np.linalg.norm(axial) * np.linalg.norm(v)
        for v in (arm, torque, np.array(loads.force_b))
    )


def _splitting_plan(general: Plan, order: int, longest: float, substep: float) -> Plan:
    method, step = f"splitting of order {order}", min(substep, longest)
    return replace(general, model=LOADED_SPLITTING.key, method=method, tolerance=0.0, order=order, substep=step)


# Settings, one after another


def ever_tighter(tolerance: float) -> Iterator[float]:
    """Yield tolerances, each a tenth of the one before, down to the tightest."""
    while tolerance > TIGHTEST:
        tolerance = max(0.1 * tolerance, TIGHTEST)
        yield tolerance


def ratio_to(aim: float, error: float) -> float:
    """Return what an error is to be multiplied by; a thousand, or a thousandth, where it is none or not finite."""
    return aim / error if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)


def nearer(value: float, ratio: float, widest: float, power: int = 1) -> float:
    """Return the next setting where an error, which goes with a power of it, is to be multiplied by a ratio.

    widest: how many times larger, or smaller, it may become at once.
    """
    return value * min(max(float(ratio ** (1.0 / power)), 1.0 / widest), widest)


def tighter_plan(plan: Plan, ratio: float) -> Plan:
    """Return the plan with a smaller tolerance, or step."""
    if plan.tolerance > 0.0:
        return replace(plan, tolerance=min(plan.tolerance, max(ratio * plan.tolerance, 1e-3 * TIGHTEST)))
    return replace(plan, substep=ratio * plan.substep)


# Costs


MACHINE = "an Intel Xeon of 2026"
"""The machine whose ns all costs are, in a compiled loop over the library's own models on one idle core."""
ATTITUDE, CHANGING, TURNING_LOADS, EVALUATED = "attitude", "changing", "loads that turn", "evaluated"
"""The terms of a model's own costs besides what each step costs; see `ModelSpec.costs`."""


def term(model: str, name: str) -> str:
    """Return the key of NS for a model's own cost."""
    return f"{model}, {name}" if name else model


NS = {
    **{term(spec.key, name): ns for spec in MODELS.values() for name, ns in spec.costs.items()},
    "path": 18.0,
    "accelerations": 18.0,
    "rpy": 37.0,
    "omega_a": 8.0,
    "angular_momentum_a": 8.0,
    "kinetic_energy": 3.0,
}
"""The costs, ns, by term, as `python -m examples.benchmarks.costs` prints them."""


def with_cost(asked: Question, plan: Plan) -> Plan:
    """Return the plan with its states, if these are still open (0), and its cost a communication step, ns.

    Its cost before is that of a step's substeps alone.
    """
    share = plan.spec.substep_without_attitude
    if share != 1.0 and (asked.start.needs_attitude or any(asked.load_shares)):
        share = 1.0
    cost = share * plan.cost + sum(NS[name] for name in terms(asked, plan))
    return replace(plan, states=plan.states or plan.spec.states_for(asked), cost=cost)


def terms(asked: Question, plan: Plan) -> list[str]:
    """Return keys of NS: what a step of the plan does besides its substeps."""
    spec = plan.spec
    if spec.computes_all_outputs:
        return [spec.key]
    start = asked.start
    evaluated = serves_many_steps(plan, asked.load_shares)
    changing = start.needs_translation or start.shows_loads
    if CHANGING in spec.costs and not changing:
        return [spec.key]  # its outputs never change
    parts = {
        term(spec.key, CHANGING): changing,
        term(spec.key, ATTITUDE): start.needs_attitude,
        term(spec.key, TURNING_LOADS): any(asked.load_shares) and not evaluated,
        "path": start.needs_translation and not start.has_pivot and not spec.integrates_path,
        "accelerations": start.shows_loads,
        **{name: name in asked.quantities for name in OUTPUT},
    }
    own = term(spec.key, EVALUATED) if evaluated else spec.key
    return [own, *(name for name, asked in parts.items() if asked and name in NS)]
