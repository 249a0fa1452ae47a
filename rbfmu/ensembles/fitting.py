"""Series for an ensemble: the cheapest with which the worst member is likely to meet the accuracy.

Order and tolerance are fitted to a few pilots over their whole runs. A few pilots say little about the worst of many
members. Scouts, up to a thousand members that are compared with a far tighter tolerance, show the tail of the errors.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rbfmu.ensembles import control, draws, members, variables
from rbfmu.ensembles.chunks import MOST_BYTES, Work, run_samples
from rbfmu.models import question, registry
from rbfmu.planning import methods
from rbfmu.planning.fitting import REACHED
from rbfmu.planning.judge import Judge
from rbfmu.runs.motion import FLOORS, NOISE, natural_sizes
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.quantities import ANGLE, OUTPUT

PART, MOST, LOOSER = 0.15, 0.5, 2.0
"""PART: the largest error of a pilot, as a part of the accuracy, as errors of other members scatter. With 0.5, series
were fitted twice in every third ensemble, and the final tolerance was no looser. MOST: the same where round-off alone
exceeds PART. LOOSER: the loosest tolerance over the accuracy. With 14, the error estimates missed one member in a
thousand: it was off by 8.4 times the accuracy, all others by at most 0.2, so that no tail showed it."""
TIGHT, LITTLE = 1e-16, 1e-3
"""TIGHT: the tolerance of the series by which pilots are judged. LITTLE: the largest difference of two such series, in
parts of the accuracy; and the largest tolerance of the scouts' truth, as a part of the plan's tolerance."""
HIGHEST = 20
"""The highest order of series."""
POINTS = 1_000
"""About the number of communication points at which pilots and scouts are compared; longer runs skip some."""
SCOUTS, FEWEST, TAIL, HEAVY = 1024, 64, 32, 5.0
"""SCOUTS, FEWEST: the largest and the smallest number of scouts. TAIL: the number of largest errors from which the tail
is estimated. HEAVY: more scouts are run if the estimated worst error is more than HEAVY times the largest one seen."""
MEMBERS = 10_000
"""The number of members whose worst error is estimated, whatever the number of runs, which may be extended later."""
SCATTER = 1.15
"""The factor by which the estimated exponent of the tail is increased, see `likely_worst`."""
NEAR, WITHIN, WORTH, DEARER = 0.3, 0.4, 3.0, 1.15
"""NEAR: the likely worst error that is aimed at, as a part of the accuracy. WITHIN: the largest that is accepted.
WORTH: the least factor by which a tolerance is loosened: 3 saves a twelfth of a run of order 14. DEARER: orders are
tried again if the cost is more than DEARER times the cost at the pilots' tolerance.

More than half of the accuracy is left for single members whose error estimate passes zero by chance in a step, which
no tail shows. In one of 200 ensembles their errors were up to 3.4 times the likely worst, in all others below it.
"""
SECONDS, LONGER, TIGHTER, TINY = 0.03, 1.0, 1e-4, 1e-300
"""SECONDS: the time that all scouts may take, counted as if run one by one. LONGER: the same for more scouts, where the
first are too few or show that no tolerance is tight enough. TIGHTER: the tolerance of the scouts' truth over that of
the plan. TINY: the size that errors of a quantity are relative to if the quantity is zero."""
APART = (1 << 32) + 1
"""The number of the attempt (see `draws.at_random`) by which scouts are drawn; no member and no pilot has it."""


def fit_of_members(judges: Sequence[Judge], general: Plan, part: float) -> Plan | None:
    """Return the cheapest series whose errors in all pilots are at most `part` of the accuracy.

    Orders are compared on two pilots: the one with the largest error and the one with the most substeps. The tolerance
    of the best order is then fitted to all pilots. None if no tolerance is tight enough.
    """
    asked = judges[0].asked
    looser = replace(general, tolerance=LOOSER * asked.accuracy)

    def worst(plan: Plan, of: Sequence[Judge]) -> tuple[float, float]:
        found = [_tried(judge, plan) for judge in of]
        return max(error for error, _ in found), max(substeps for _, substeps in found)

    likely = methods.series_plan(looser, min(methods.likely_order(asked.accuracy), HIGHEST), asked.accuracy)
    results = [_tried(judge, likely) for judge in judges]
    hard = [judges[k] for k in {int(np.argmax(column)) for column in zip(*results, strict=True)}]
    bound = part * asked.accuracy
    best, least = None, math.inf
    for way in (2, -2):
        order, idle, tolerance = likely.order + min(way, 0), 0, likely.tolerance
        while 6 <= order <= HIGHEST and idle < 2:
            found, tolerance, substeps = _loosest(lambda plan: worst(plan, hard), looser, order, tolerance, bound)
            work = at_bound(found, bound, looser.tolerance, substeps) if found else math.inf
            cost = work * methods.series_cost(order, asked.load_shares)
            idle = idle + 1 if cost >= least else 0
            if found is not None and cost < least:
                best, least = found, cost
            order += way
    if best is None:
        return None
    found, _, substeps = _loosest(lambda plan: worst(plan, judges), looser, best.order, best.tolerance, bound)
    if found is None:
        return None
    return _costing(found, asked, substeps)


def _tried(judge: Judge, plan: Plan) -> tuple[float, float]:
    """Return what `Judge.try_out` does, in the run's own steps where substeps end at each."""
    return judge.try_out(plan, parts=1 if plan.interpolated else judge.stride)


def _costing(found: Plan, asked: question.Question, substeps: float) -> Plan:
    """Return the plan with the cost of a communication step's substeps, given their number in a run."""
    cost = methods.series_cost(found.order, asked.load_shares) * substeps / asked.scene.run.count
    return replace(found, cost=cost)


def follow_in_doubles(judges: Sequence[Judge]) -> None:
    """Let all judges use a tight series in doubles as the truth, if such series of two orders agree.

    Their difference is then mostly round-off. Otherwise all judges use double-double arithmetic, which takes as long
    as all other work here.
    """
    for judge in judges:
        judge.follow_by(methods.series_of_all(judge.asked, MAX_ORDER - 4, TIGHT))
        if judge.try_out(methods.series_of_all(judge.asked, MAX_ORDER - 8, TIGHT))[0] > LITTLE * judge.asked.accuracy:
            for each in judges:
                each.forget()
            return


def at_bound(found: Plan, bound: float, loosest: float, substeps: float) -> float:
    """Return the expected number of substeps at the tolerance whose error is the bound, or at the loosest tolerance.

    The error is proportional to (length of a substep)^order.
    """
    less: float = 1.0 if found.tolerance >= loosest else (max(found.error, TINY) / bound) ** (1.0 / found.order)
    return less * substeps


def _loosest(
    worst: Callable[[Plan], tuple[float, float]], general: Plan, order: int, tolerance: float, bound: float
) -> tuple[Plan | None, float, float]:
    """Return the plan of an order whose error is at or a little below a bound, its tolerance, and its substeps."""
    kept, substeps = None, math.inf
    for _ in range(4):
        plan = methods.series_plan(general, order, tolerance)
        error, count = worst(plan)
        if error <= bound and (kept is None or count <= substeps):
            kept, substeps = replace(plan, error=error), count
        if 0.1 * bound <= error <= bound or (error <= bound and plan.tolerance >= general.tolerance):
            break
        tolerance = min(max(methods.ratio_to(0.4 * bound, error), 1e-4), 1e2) * plan.tolerance
    return kept, kept.tolerance if kept else tolerance, substeps


class Scouts:
    """Many more members than pilots, from whose errors the worst error of all members is estimated.

    Each is run twice: at the plan's tolerance and at a far tighter one. Errors of a few pilots say little about the
    worst of many members, which may pass near a separatrix, where motions from nearly equal starts diverge.
    Scouts run in lanes, and each costs as much as a few members.
    """

    def __init__(self, scene: Scene, plan: Plan, names: tuple[str, ...], seconds: float = SECONDS) -> None:
        """Run the scouts at the far tighter tolerance.

        names: the quantities that are compared; seconds: the time that scouts may take, which limits their number.
        """
        steps = scene.run.count
        stride = math.ceil(steps / POINTS)
        self.scene = scene.replace({"outputs.quantities": names, "run.step": stride * scene.run.step})
        self.seconds, self.control = seconds, control.Control({}, None, parts=1 if plan.interpolated else stride)
        self.at_rest = _sizes_at_rest(question.Question(scene))
        self.columns = variables.Columns(tuple(OUTPUT[n] for n in names))
        numbers = self.columns.width * (self.scene.run.count + 1)
        most = min(int(MOST_BYTES / (8.0 * numbers)), int(1e9 * seconds / (plan.cost * steps)))
        cube = draws.at_random(members.ensemble_of(scene), 0, max(min(most, SCOUTS), FEWEST), APART)
        self.samples = members.samples_at(self.scene, cube)
        order = plan.order + 2 if plan.order < MAX_ORDER else MAX_ORDER - 2  # with equal orders, steps may be equal
        self.exact = replace(plan, tolerance=TIGHTER * plan.tolerance, order=order)
        self.truth = self._run(self.exact)
        self.are_too_few = False

    def serve(self, plan: Plan) -> bool:
        """Return whether the scouts' truth is much tighter than a plan."""
        return self.exact.tolerance <= LITTLE * plan.tolerance

    def _run(self, plan: Plan) -> Array:
        work = Work(self.scene, plan, len(self.samples), self.control)
        return run_samples(work, self.samples, ends_alone=False)[0]

    def likely_worst(self, plan: Plan) -> float:
        """Return the likely worst error of MEMBERS members; set `are_too_few` if it is far above the errors seen."""
        errors = _errors(self.columns, self._run(plan), self.truth, self.at_rest)
        likely = likely_worst(errors, MEMBERS)
        self.are_too_few = len(errors) < SCOUTS and likely > HEAVY * float(np.nanmax(errors, initial=0.0))
        return likely


def for_the_worst(scouts: Scouts, fitted: Plan) -> Plan | None:
    """Return the series at a tolerance with which the worst of all members is likely to meet the accuracy.

    Its error is the likely worst error. None if no tolerance is tight enough.
    """
    accuracy, found, kept = scouts.scene.run.accuracy, fitted, None
    # closer to the tolerance of the scouts' truth, differences would contain the errors of both
    least, pilots = max(10.0 * scouts.exact.tolerance, methods.TIGHTEST), max(found.error, TINY) / found.tolerance
    most = min(REACHED / pilots, LOOSER) * accuracy  # at which the worst pilot meets the accuracy as well
    while found.tolerance >= least:
        worst = scouts.likely_worst(found)
        ratio = min(max(NEAR * accuracy / max(worst, TINY), 1e-3), 1e2)
        if worst <= WITHIN * accuracy:
            kept = replace(found, error=max(worst, pilots * found.tolerance))
        else:
            most = found.tolerance
        tolerance = min(ratio * found.tolerance, most)
        if kept and (found.tolerance >= most or tolerance >= most):  # errors have not followed the tolerance
            tolerance = math.sqrt(kept.tolerance * most)
        if kept and tolerance < WORTH * kept.tolerance:
            break
        found = replace(found, tolerance=tolerance)
    return kept


def dearest(judges: Sequence[Judge], found: Plan) -> Plan:
    """Return the series with its cost for the pilot that takes most substeps."""
    return _costing(found, judges[0].asked, max(_tried(judge, found)[1] for judge in judges))


def with_likely_error(scene: Scene, found: Plan, names: tuple[str, ...]) -> Plan:
    """Return the plan with the likely worst error of all members; other plans than series keep their error."""
    if found.model != registry.LOADED_TAYLOR.key:
        return found
    return replace(found, error=max(found.error, Scouts(scene, found, names).likely_worst(found)))


def likely_worst(errors: Array, runs: int) -> float:
    """Return the bound that the largest of `runs` further errors does not exceed in 99 of 100 ensembles.

    The tail of the errors is modelled as a power law, whose exponent is Hill's estimate from the largest errors (B. M.
    Hill, Annals of Statistics 3, 1975); the quantile beyond all data is I. Weissman's (J. Am. Stat. Assoc. 73, 1978).
    The reason: errors grow as 1/d at a distance d from a separatrix, the heaviest tail met. The estimated exponent
    scatters by a relative 1/sqrt(TAIL), and is increased by SCATTER so that 99 of 100 ensembles stay within the bound.
    """
    known = np.sort(errors[np.isfinite(errors)])[::-1]
    if not len(known) or known[0] == 0.0:
        return 0.0
    k = max(1, min(TAIL, len(known) - 1))
    base = max(known[min(k, len(known) - 1)], 1e-3 * known[0])
    exponent = SCATTER * float(np.mean(np.log(np.maximum(known[:k], base) / base)))
    return float(max(known[0], base * (100.0 * k * runs / len(known)) ** exponent))


def _sizes_at_rest(asked: question.Question) -> dict[str, tuple[float, float]]:
    """Return for each quantity the largest size that is round-off of a body at rest, and its natural size.

    Errors of a quantity that is only round-off are relative to its natural size.
    """
    sizes = natural_sizes(asked, {})
    return {name: (size * (NOISE**2 if OUTPUT[name].unit == "J" else NOISE), size) for name, size in sizes.items()}


def _errors(
    columns: variables.Columns, rows: Array, truth: Array, at_rest: Mapping[str, tuple[float, float]] = {}
) -> Array:
    """Return each member's largest error (members,), as an accuracy counts it; NaN for members that fail.

    at_rest: see `_sizes_at_rest`. The judge's `largest_error` takes one motion at a time, which would take as long here
    as the scouts' runs.
    """
    found, true = columns.split(rows), columns.split(truth)
    worst = np.zeros(len(rows))
    for name in found:
        a, b = found[name].reshape(*rows.shape[:2], -1), true[name].reshape(*rows.shape[:2], -1)
        if OUTPUT[name].error == ANGLE:
            chord = np.minimum(np.linalg.norm(a - b, axis=2), np.linalg.norm(a + b, axis=2))
            half_turn = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))  # on the sphere of q, whose radius is 1
            apart = 2.0 * half_turn.max(axis=1)
        else:
            most, natural = at_rest.get(name, (0.0, 0.0))
            largest = np.linalg.norm(b, axis=2).max(axis=1)
            size = np.maximum(np.where(largest <= most, natural, largest), FLOORS.get(name, TINY))
            apart = np.linalg.norm(a - b, axis=2).max(axis=1) / size
        worst = np.maximum(worst, apart)
    return worst
