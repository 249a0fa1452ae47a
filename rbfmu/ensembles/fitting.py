"""Series for an ensemble: the cheapest whose worst member is likely to meet the accuracy.

Orders and tolerances are fitted to a few pilots, followed to the end. Of the worst of many members these tell little:
scouts, up to a thousand members beside a far tighter tolerance, give the tail of the errors.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rbfmu.ensembles import draws, members, variables
from rbfmu.ensembles.chunks import MOST_BYTES, Work, run_samples
from rbfmu.ensembles.control import Control
from rbfmu.models.question import Question
from rbfmu.models.registry import LOADED_TAYLOR
from rbfmu.planning import methods
from rbfmu.planning.fitting import REACHED
from rbfmu.planning.judge import Judge
from rbfmu.planning.methods import TIGHTEST, likely_order, ratio_to, series_cost, series_of_all, series_plan
from rbfmu.runs.motion import FLOORS, NOISE, natural_sizes
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.integrators.taylor_coefficients import MAX_ORDER
from rbfmu_kernels.quantities import ANGLE, OUTPUT

PART, MOST, LOOSER = 0.15, 0.5, 2.0
"""The part of the accuracy up to which pilots' errors go, as those of other members scatter, and that where round-off
alone makes more: with half of it series were fitted twice in every third ensemble, to a tolerance no looser in the end.
And the loosest tolerance over the accuracy: with 14 the estimates overlooked one member in a thousand, which was off by
8.4 times the accuracy where all others were within 0.2, so that no tail told of it."""
TIGHT, LITTLE = 1e-16, 1e-3
"""The tolerance of the series by which pilots are judged; and the part of the accuracy by which two such may differ, or
of a tolerance, which that of a truth may be."""
HIGHEST = 20
"""The highest order of series."""
POINTS, INSIDE = 1_000, 16
"""The communication points, about, at which pilots and scouts are looked at: in longer runs, at one of some. And how
many times more their steps are than their series: a series that serves so many is the same one, whatever these are.
"""
SCOUTS, FEWEST, TAIL, HEAVY = 1024, 64, 32, 5.0
"""The most and the fewest members whose errors tell of those of others, and of how many the tail is taken; and how many
times larger than those seen others may be by that tail before more are looked at."""
MEMBERS = 10_000
"""The members whose worst error is estimated: a plan does not depend on the number of runs, which may be extended."""
SCATTER = 1.15
"""How much larger than estimated the exponent of the tail is taken, see `likely_worst`."""
NEAR, WITHIN, WORTH, DEARER = 0.3, 0.4, 3.0, 1.15
"""The part of the accuracy that the likely worst error is brought to, and that which it may come to; by how much a
tolerance is loosened if at all, as three times saves a twelfth of a run of order 14; and the cost over that of pilots'
tolerance from which on orders are tried again.

More than half of the accuracy is left to single members whose estimate of the error passes zero by chance in a step:
no tail tells of them. In one of 200 ensembles these were up to 3.4 times beyond the likely worst, in all others within.
"""
SECONDS, LONGER, TIGHTER, TINY = 0.03, 1.0, 1e-4, 1e-300
"""The time that scouts may take one by one, and where the first of them tell that no tolerance holds; the tolerance
that they are compared with, over the plan's; and what a quantity is relative to where it is zero."""
APART = (1 << 32) + 1
"""The attempt by whose numbers scouts are drawn, which no member and no pilot has."""


def parts_of_steps(judges: Sequence[Judge], general: Plan) -> int:
    """Return into how many steps of one length the time between two points is cut that pilots and scouts are looked at.

    As many as a run has there, or fewer, where series serve many of these.
    """
    one = judges[0]
    if one.stride == 1:
        return 1
    likely = series_plan(general, likely_order(one.asked.accuracy), one.asked.accuracy)
    substeps = max(judge.try_out(likely, parts=one.stride)[1] for judge in judges)
    return min(max(math.ceil(INSIDE * substeps / len(one.steps)), 1), one.stride)


def fit_of_members(judges: Sequence[Judge], general: Plan, parts: int, part: float) -> Plan | None:
    """Return the cheapest series whose errors in pilots are at most such a part of the accuracy.

    Orders are compared on the member of the largest error and on that which takes most substeps; then all are tried.
    parts: see `parts_of_steps`. None where no tolerance is tight enough.
    """
    asked = judges[0].asked
    looser, steps = replace(general, tolerance=LOOSER * asked.accuracy), asked.scene.run.count

    def worst(plan: Plan, of: Sequence[Judge]) -> tuple[float, float]:
        found = [judge.try_out(plan, parts=parts) for judge in of]
        return max(error for error, _ in found), max(substeps for _, substeps in found)

    likely = series_plan(looser, min(likely_order(asked.accuracy), HIGHEST), asked.accuracy)
    tried = [judge.try_out(likely, parts=parts) for judge in judges]
    hard = [judges[int(np.argmax(column))] for column in zip(*tried, strict=True)]
    bound = part * asked.accuracy
    best, least = None, math.inf
    for way in (2, -2):
        order, idle, tolerance = likely.order + min(way, 0), 0, likely.tolerance
        while 6 <= order <= HIGHEST and idle < 2:
            found, tolerance, substeps = _loosest(lambda plan: worst(plan, hard), looser, order, tolerance, bound)
            work = at_bound(found, bound, looser.tolerance, substeps, steps) if found else math.inf
            cost = methods.cost_in_lanes(work, steps, series_cost(order, asked.load_shares))
            idle = idle + 1 if cost >= least else 0
            if found is not None and cost < least:
                best, least = found, cost
            order += way
    if best is None:
        return None
    found, _, substeps = _loosest(lambda plan: worst(plan, judges), looser, best.order, best.tolerance, bound)
    if found is None:
        return None
    return replace(found, cost=series_cost(found.order, asked.load_shares) * substeps / steps)


def follow_in_doubles(judges: Sequence[Judge]) -> None:
    """Take tight series of two orders for the truth, where these agree: what they differ by is mostly round-off.

    Else all are followed in double-double arithmetic, which takes as long as all else here.
    """
    for judge in judges:
        judge.follow_by(series_of_all(judge.asked, MAX_ORDER - 4, TIGHT))
        if judge.try_out(series_of_all(judge.asked, MAX_ORDER - 8, TIGHT))[0] > LITTLE * judge.asked.accuracy:
            for one in judges:
                one.forget()
            return


def at_bound(found: Plan, bound: float, loosest: float, substeps: float, steps: int) -> float:
    """Return the substeps where the error is the bound, or the tolerance is the loosest.

    The error goes with their length^order. They are whole ones in each communication step, but for series that serve
    many of these.
    """
    if found.tolerance >= loosest:
        return substeps
    fewer: float = substeps * (max(found.error, TINY) / bound) ** (1.0 / found.order)
    return fewer if substeps < steps else steps * math.ceil(fewer / steps)


def _loosest(
    worst: Callable[[Plan], tuple[float, float]], general: Plan, order: int, tolerance: float, bound: float
) -> tuple[Plan | None, float, float]:
    """Return the plan of an order whose error is near a bound and not beyond, its tolerance, and its substeps."""
    kept, substeps = None, math.inf
    for _ in range(4):
        plan = series_plan(general, order, tolerance)
        error, taken = worst(plan)
        if error <= bound and (kept is None or taken <= substeps):
            kept, substeps = replace(plan, error=error), taken
        if 0.1 * bound <= error <= bound or (error <= bound and plan.tolerance >= general.tolerance):
            break
        tolerance = min(max(ratio_to(0.4 * bound, error), 1e-4), 1e2) * plan.tolerance
    return kept, kept.tolerance if kept else tolerance, substeps


class Scouts:
    """Many more members than pilots, whose errors tell of those of all: runs beside a far tighter tolerance.

    Errors of a few pilots say little of the worst of many members, which may come near to where nearly equal starts
    lead apart. Scouts run in lanes, at a cost of some members each.
    """

    def __init__(
        self, scene: Scene, plan: Plan, names: tuple[str, ...], parts: int | None = None, seconds: float = SECONDS
    ) -> None:
        """Follow them; parts: see `parts_of_steps`, as many as the run has where it is None."""
        steps = scene.run.count
        stride = math.ceil(steps / POINTS)
        self.scene = scene.replace({"outputs.quantities": names, "run.step": stride * scene.run.step})
        self.seconds, self.control = seconds, Control({}, None, parts=min(parts or stride, stride))
        self.at_rest = _sizes_at_rest(Question(scene))
        self.columns = variables.Columns(tuple(OUTPUT[n] for n in names))
        numbers = self.columns.width * (self.scene.run.count + 1)
        most = min(int(MOST_BYTES / (8.0 * numbers)), int(1e9 * seconds / (plan.cost * steps)))
        cube = draws.at_random(members.ensemble_of(scene), 0, max(min(most, SCOUTS), FEWEST), APART)
        self.samples = members.samples_at(self.scene, cube)
        order = plan.order + 2 if plan.order < MAX_ORDER else MAX_ORDER - 2  # of one order steps may be the same
        self.exact = replace(plan, tolerance=TIGHTER * plan.tolerance, order=order)
        self.truth = self._run(self.exact)
        self.are_too_few = False

    def tell_of(self, plan: Plan) -> bool:
        """Return whether they were followed by series much tighter than a plan."""
        return self.exact.tolerance <= LITTLE * plan.tolerance

    def _run(self, plan: Plan) -> Array:
        work = Work(self.scene, plan, len(self.samples), self.control)
        return run_samples(work, self.samples, ends_alone=False)[0]

    def likely_worst(self, plan: Plan) -> float:
        """Return what the errors of MEMBERS members are likely not to exceed; note whether few tell of far larger."""
        errors = _errors(self.columns, self._run(plan), self.truth, self.at_rest)
        likely = likely_worst(errors, MEMBERS)
        self.are_too_few = len(errors) < SCOUTS and likely > HEAVY * float(np.nanmax(errors, initial=0.0))
        return likely


def for_the_worst(scouts: Scouts, fitted: Plan) -> Plan | None:
    """Return series with their likely error, at a tolerance with which the worst of all members meets the accuracy.

    None where none is likely to.
    """
    accuracy, found, kept = scouts.scene.run.accuracy, fitted, None
    # nearer to the tolerance that they are compared with, differences would be those of both
    least, pilots = max(10.0 * scouts.exact.tolerance, TIGHTEST), max(found.error, TINY) / found.tolerance
    most = min(REACHED / pilots, LOOSER) * accuracy  # the farthest pilot meets it as well
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
    """Return series with the cost that they have of the pilot which takes most substeps."""
    asked = judges[0].asked
    substeps = max(judge.try_out(found, parts=judge.stride)[1] for judge in judges) / asked.scene.run.count
    return replace(found, cost=series_cost(found.order, asked.load_shares) * substeps)


def with_likely_error(scene: Scene, found: Plan, names: tuple[str, ...]) -> Plan:
    """Return the plan of series with the error that the worst of all members is likely to have."""
    if found.model != LOADED_TAYLOR.key:
        return found
    return replace(found, error=max(found.error, Scouts(scene, found, names).likely_worst(found)))


def likely_worst(errors: Array, runs: int) -> float:
    """Return what the largest of so many more errors will not exceed in 99 of 100 ensembles.

    The tail of errors is taken for a power law, whose exponent is Hill's estimate from the largest of them (B. M. Hill,
    Annals of Statistics 3, 1975; the quantile beyond all data is I. Weissman's, J. Am. Stat. Assoc. 73, 1978): errors
    grow as 1/d where members come to a distance d from a separatrix, and this is the heaviest tail met. The estimate
    scatters by 1/sqrt(TAIL), and is taken so much larger that 99 of 100 hold.
    """
    known = np.sort(errors[np.isfinite(errors)])[::-1]
    if not len(known) or known[0] == 0.0:
        return 0.0
    k = max(1, min(TAIL, len(known) - 1))
    base = max(known[min(k, len(known) - 1)], 1e-3 * known[0])
    exponent = SCATTER * float(np.mean(np.log(np.maximum(known[:k], base) / base)))
    return float(max(known[0], base * (100.0 * k * runs / len(known)) ** exponent))


def _sizes_at_rest(asked: Question) -> dict[str, tuple[float, float]]:
    """Return, by quantity, the size up to which it is round-off of a body at rest, and what errors are relative to."""
    sizes = natural_sizes(asked, {})
    return {name: (size * (NOISE**2 if OUTPUT[name].unit == "J" else NOISE), size) for name, size in sizes.items()}


def _errors(
    columns: variables.Columns, rows: Array, truth: Array, at_rest: Mapping[str, tuple[float, float]] = {}
) -> Array:
    """Return each member's largest error, as an accuracy counts it; NaN of those that fail.

    at_rest: see `_sizes_at_rest`. The judge's own errors are made a row at a time, which would take as long here as
    all scouts' motions.
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
