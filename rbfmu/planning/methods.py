"""Candidates, which are plans whose setting is still to be found; how settings follow from errors; costs of plans."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from rbfmu.models.question import Question
from rbfmu.models.registry import FORMULAS, LOADED_SPLITTING, LOADED_TAYLOR, MODELS, ONE_AXIS_TAYLOR
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators import splitting, taylor_coefficients
from rbfmu_kernels.models.one_axis import ORDERS
from rbfmu_kernels.quantities import OUTPUT

EXACT = 1e-14
"""The round-off error of closed forms, and of the exact rotation."""
TIGHTEST = 1e-15
"""The smallest tolerance that double precision can meet."""
FAR_BELOW_ROUND_OFF = 1e-3 * TIGHTEST
"""The tolerance at which rates of 1e-8 rad/s beside one of 3 rad/s keep digits of their own."""
ORDERS_OF_SERIES = range(6, taylor_coefficients.MAX_ORDER + 1, 2)
LOW_ORDER = 12
"""The order of series that stay finite where those of high orders overflow.

At a time d before the zero of a power its coefficients grow as d^-n, and d comes down to round-off: of a body at 1e5
rad/s, to 1e-20 s.
"""
SERIES_COSTS = ((58.0, 14.3), (10.0, 24.0), (41.0, 23.1))
"""(a, b) of a + b N ns a substep at order N, on `methods.MACHINE`; examples/benchmarks/substeps.py fits these lines.

The lines are for torques that are constant in b; for loads that rotate relative to b as well; and for a force that
rotates with the body.
"""
WITHOUT_ATTITUDE = 0.72
"""The cost of a substep without the attitude, as a part of that with it."""
KEPT_SERIES_COST = 1.6
"""The cost of a series that serves many communication steps over that of a substep of the same order.

It has the attitude up to its full order; a substep's two-point formula needs it only up to three eighths of the order.
"""
ONE_AXIS_COSTS = {4: 55.0, 8: 85.0, 16: 185.0}
SPLITTING_COSTS = {2: 76.0, 4: 470.0, 6: 864.0}
"""Ns a substep, by order."""
STUCK = 0.03
"""The largest factor by which the next setting is to change the error if the last setting did not change it.

If each communication step is one substep, a slightly smaller tolerance gives the same substeps again.
"""
RESONANCE = 0.45
"""The longest step, as a part of the step at which splitting resonates, or of the period that it resonates with.

The model refuses more than half of it, and an importer may set a somewhat faster rate than the scene's. At the
resonance of a torque fixed in b a top was off by 0.67 rad after 10 s, at 0.8 of that step by less than a hundredth of
it (`test_splitting`).
"""


# Candidates: plans with the loosest tolerance, or the longest step, that may be used


def whole_series(scene: Scene, order: int, tolerance: float) -> Plan:
    """Return the plan of the series that is valid for all loads of a scene; see `series_of_all`."""
    return series_of_all(Question(scene), order, tolerance)


def series_of_all(asked: Question, order: int, tolerance: float) -> Plan:
    """Return the plan of the series that is valid for all loads; order: 0 if it is still to be found."""
    model = FORMULAS if asked.formulas else LOADED_TAYLOR
    return Plan(model.key, _series(order), 0, tolerance=tolerance, order=order, formulas=asked.formulas)


def _series(order: int) -> str:
    return f"Taylor series of order {order}"


def series_plan(general: Plan, order: int, tolerance: float) -> Plan:
    """Return the plan of a series at a tolerance, but at most that of `general`, from which it has all else."""
    return at_setting(replace(general, method=_series(order), order=order), tolerance)


def one_axis_series(asked: Question) -> Iterator[Plan]:
    """Return the series of one angle, from the highest order."""
    return (Plan(ONE_AXIS_TAYLOR.key, _series(n), 0, tolerance=asked.accuracy, order=n) for n in reversed(ORDERS))


def likely_order(accuracy: float) -> int:
    """Return the order of the series that is likely to meet an accuracy at the least cost.

    A substep of order p costs about p^2, and reaches farther for higher p. The cost of a run is least near
    p = 1 - ln(tolerance) / 2 (Jorba, Zou: Experimental Mathematics 14 (2005) 99-117). Here it is one higher, and even,
    for a tolerance of a hundredth of the accuracy: orders are fitted from there up and down.
    """
    order = 2 * round(1.0 + 0.25 * math.log(100.0 / accuracy))
    return min(max(order, ORDERS_OF_SERIES[0]), ORDERS_OF_SERIES[-1])


def splittings(asked: Question) -> Iterator[Plan]:
    """Yield the splitting methods that are valid for the scene's body."""
    if not LOADED_SPLITTING.accepts(asked):
        return
    omega = asked.scene.initial.omega_b
    turn = math.inf if _spins_unseen(asked) else 2.0 * math.pi / max(math.hypot(*omega), 1e-300)
    resonant = interpreted(splitting.resonant_step)(asked.body.M, omega)
    longest = min(RESONANCE * resonant, RESONANCE * turn, asked.span)
    for order in SPLITTING_COSTS:
        yield Plan(LOADED_SPLITTING.key, f"splitting of order {order}", 0, substep=longest, order=order)


def _spins_unseen(asked: Question) -> bool:
    """Return whether a body's rotation about its symmetry axis does not change loads; otherwise it may resonate."""
    body, loads = asked.start.body, asked.start.loads
    M, arm = np.array(body.inertia), np.array(body.arm_b)
    axial = M - interpreted(splitting.transverse_moment)(body.inertia) * np.eye(3)  # (I_s - I_t) s s^T
    torque = np.array(loads.torque_b) + np.cross(arm, loads.force_b)
    norm = np.linalg.norm
    return all(norm(axial @ v) >= (1.0 - 1e-12) * norm(axial) * norm(v) for v in (arm, torque, np.array(loads.force_b)))


# Settings, one after another


def at_setting(candidate: Plan, value: float) -> Plan:
    """Return a candidate at a tolerance, or step, that is at most its own.

    Tolerances above the accuracy say little about errors in other communication steps: with 10 times the accuracy, a
    run in one step, with more substeps than `fitting` tries in shorter steps, was off by 7.4 times the accuracy in
    shorter steps.
    """
    if candidate.tolerance > 0.0:
        return replace(candidate, tolerance=min(max(value, FAR_BELOW_ROUND_OFF), candidate.tolerance))
    return replace(candidate, substep=min(value, candidate.substep))


def tighter(plan: Plan, ratio: float) -> Plan:
    """Return the plan at a setting that is likely to multiply its error by a ratio."""
    return at_setting(plan, (plan.tolerance or plan.substep) * ratio ** (1.0 / exponent(plan)))


def exponent(plan: Plan) -> int:
    """Return the power of a plan's setting to which its error is proportional."""
    return 1 if plan.tolerance > 0.0 else plan.order


def ever_tighter(tolerance: float) -> Iterator[float]:
    """Yield tolerances, each a tenth of the one before, down to the tightest."""
    while tolerance > TIGHTEST:
        tolerance = max(0.1 * tolerance, TIGHTEST)
        yield tolerance


def ratio_to(aim: float, error: float) -> float:
    """Return aim / error; 1000 if the error is zero, 1/1000 if it is not finite."""
    return aim / error if 0.0 < error < math.inf else (1e3 if error == 0.0 else 1e-3)


def climb(
    value: float,
    error_at: Callable[[float], float | None],
    band: tuple[float, float],
    aim: float,
    within: tuple[float, float],
    power: int = 1,
    tries: int = 8,
    caution: float = 1.0,
) -> float:
    """Try settings, each computed from the error of the last, until an error is in the band; return the last setting.

    error_at: returns a setting's error, or None to stop; aim: the error that the next setting aims at, after errors
    are multiplied by caution; within: the limits of the factor between two settings; power: the error is proportional
    to this power of the setting; tries: the largest number of settings.
    """
    (least, bound), last = band, math.inf
    for _ in range(tries):
        error = error_at(value)
        stuck = error == last  # each communication step is one substep, or the step is the shortest allowed
        if error is None or least <= error <= bound or (stuck and error <= bound):
            break
        ratio = ratio_to(aim, caution * error)
        ratio = float((min(ratio, STUCK) if stuck else ratio) ** (1.0 / power))
        value, last = value * min(max(ratio, within[0]), within[1]), error
    return value


# Costs


def series_cost(order: int, shares: tuple[float, float]) -> float:
    """Return the cost of a substep, ns; shares: `Question.load_shares`."""
    plain, *more = (a + b * order for a, b in SERIES_COSTS)
    return plain + sum(share * (cost - plain) for share, cost in zip(shares, more, strict=True))


def substep_cost(asked: Question, plan: Plan) -> float:
    """Return the cost of a plan's substep, ns."""
    known = {LOADED_SPLITTING.key: SPLITTING_COSTS, ONE_AXIS_TAYLOR.key: ONE_AXIS_COSTS}.get(plan.model)
    return known[plan.order] if known else series_cost(plan.order, asked.load_shares)


def work_of(substeps: float, steps: float) -> float:
    """Return the number of substeps that cost as much as a run; fewer substeps than steps are series for many steps."""
    return substeps if substeps >= steps else min(KEPT_SERIES_COST * substeps, steps)


MACHINE = "an Intel Xeon of 2026"
"""The machine on which costs in ns are measured, in a compiled loop over the library's models on one idle core.

Those of one axis, a body spun up and series were measured on an AMD EPYC, and scaled as the others compare there."""
ATTITUDE, CHANGING, TURNING_LOADS, EVALUATED_PATH = "attitude", "changing", "loads that turn", "evaluated path"
"""The terms of a model's own costs besides that of each step; see `ModelSpec.costs`."""


def term(model: str, name: str) -> str:
    """Return the key of NS for a model's own cost."""
    return f"{model}, {name}" if name else model


NS = {
    **{term(spec.key, name): ns for spec in MODELS.values() for name, ns in spec.costs.items()},
    "path": 23.0,
    "accelerations": 18.0,
    "rpy": 37.0,
    "omega_a": 8.0,
    "angular_momentum_a": 8.0,
    "kinetic_energy": 3.0,
}
"""The cost of each term, ns, as printed by `python -m examples.benchmarks.costs`."""


def with_cost(asked: Question, plan: Plan) -> Plan:
    """Return the plan with its number of states, if still open (0), and its cost of a communication step, ns.

    Before, the plan's cost is that of a step's substeps alone.
    """
    in_b_alone = plan.model == LOADED_TAYLOR.key and not (asked.start.needs_attitude or any(asked.load_shares))
    cost = (WITHOUT_ATTITUDE if in_b_alone else 1.0) * plan.cost + sum(NS[name] for name in terms(asked, plan))
    return replace(plan, states=plan.states or plan.spec.states_for(asked), cost=cost)


def terms(asked: Question, plan: Plan) -> list[str]:
    """Return keys of NS: the work of a communication step besides its substeps."""
    spec = plan.spec
    if asked.scene.body is None:  # prescribed rates: all outputs are computed, whatever is asked for
        return [spec.key]
    start, shares = asked.start, asked.load_shares
    # The plan's cost is that of its substeps alone: less than one series for each step, if a series serves several.
    serves_several = plan.interpolated or 0.0 < plan.cost < series_cost(plan.order, shares)
    evaluated = plan.model == LOADED_TAYLOR.key and serves_several
    changing = start.needs_translation or start.shows_loads
    if CHANGING in spec.costs and not changing:
        return [spec.key]  # its outputs never change
    parts = {
        term(spec.key, CHANGING): changing,
        term(spec.key, ATTITUDE): start.needs_attitude,
        term(spec.key, TURNING_LOADS): any(shares) and not evaluated,
        term(spec.key, EVALUATED_PATH): shares[1] > 0.0 and evaluated,
        "path": start.needs_translation and not start.has_pivot and not spec.integrates_path,
        "accelerations": start.shows_loads,
        **{name: name in asked.quantities for name in OUTPUT},
    }
    return [spec.key, *(name for name, is_needed in parts.items() if is_needed and name in NS)]
