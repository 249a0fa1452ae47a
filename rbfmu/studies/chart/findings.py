"""What charts say: the cost of an accuracy, by kind of method; plans beside the best of the others."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rbfmu.studies.chart.cases import FLOOR
from rbfmu.studies.chart.result import KINDS, Chart, Row

SIDES = {
    "library": ("exact", "DOP853", "Taylor", "splitting"),
    "planned": ("planned",),
    "integrator": ("classic", "Moser-Veselov"),
    "peer": ("peer",),
}
"""Who offers families of methods: the library, its plans, which choose among them, integrators in common use, peers."""
DEAREST = 1.3
"""The largest cost of a plan relative to the best other method; a plan is made without knowing the true error."""
REFUSED = "refused"


@dataclass(frozen=True)
class Offer:
    """A method, and the processor time in s by which it reaches an accuracy, for a simulated second."""

    method: str
    family: str
    cost: float


def error_of(row: Row) -> float:
    """Return the error by which methods are compared."""
    return row.error


def front(rows: Iterable[Row], error: Callable[[Row], float] = error_of, gain: float = 1.0) -> list[Row]:
    """Return the Pareto front by rising cost: each error is below `gain` times that of the row before."""
    kept: list[Row] = []
    for row in sorted(rows, key=lambda row: row.seconds):
        if not kept or error(row) < gain * error(kept[-1]):
            kept.append(row)
    return kept


def cost_of(rows: Iterable[Row], accuracy: float) -> float | None:
    """Return the cost of an accuracy by one method's rows, interpolated by a power law; None if out of reach.

    Between two settings the error of a method of order p falls as its cost^-p; plans and closed forms have no setting
    between.
    """
    best = front(rows)
    if not best or best[-1].error > accuracy:
        return None
    if best[0].error <= accuracy:
        return best[0].seconds
    coarse, fine = next(pair for pair in pairwise(best) if pair[1].error <= accuracy)
    if fine.family in ("exact", "planned"):
        return fine.seconds
    part = math.log(coarse.error / accuracy) / math.log(coarse.error / fine.error)
    return float(coarse.seconds * (fine.seconds / coarse.seconds) ** part)


def cheapest(rows: Sequence[Row], families: Sequence[str], accuracy: float) -> Offer | None:
    """Return the cheapest method of some families."""
    offers = []
    for method in dict.fromkeys(row.method for row in rows if row.family in families):
        mine = [row for row in rows if row.method == method]
        if (cost := cost_of(mine, accuracy)) is not None:
            offers.append(Offer(method, mine[0].family, cost))
    return min(offers, key=lambda offer: offer.cost, default=None)


def above_round_off(chart: Chart) -> list[Row]:
    """Return the measurements with errors of at least `FLOOR`."""
    return [replace(row, error=max(row.error, FLOOR)) for row in chart.rows]


def noise(chart: Chart) -> float:
    """Return the ratio within which costs count as equal: 19 of 20 points that may be compared have a smaller spread.

    These cost at most ten times as much as the plan; dear runs are timed less often.
    """
    return float(np.percentile([row.spread for row in chart.rows if row.seconds <= 10.0 * chart.plan.seconds], 95.0))


# What the accuracy asked costs, by kind


@dataclass(frozen=True)
class Reach:
    """The cheapest way to the accuracy asked by a kind of method.

    cost: s for a simulated second, infinite where none meets the accuracy; least: the smallest error of the kind, by
    `best`, and why that ended; stopped: whether the time limit stopped one, which might else come further.
    """

    kind: str
    method: str
    cost: float
    least: float
    best: str
    why: str
    stopped: bool = False


def reaches(chart: Chart) -> list[Reach]:
    """Return what each kind of method costs at the accuracy asked, the cheapest first."""
    rows = above_round_off(chart)
    found = [_reach(chart, kind, [row for row in rows if row.kind == kind]) for kind in KINDS]
    return sorted((reach for reach in found if reach), key=lambda reach: (reach.cost, reach.least))


def _reach(chart: Chart, kind: str, rows: Sequence[Row]) -> Reach | None:
    ends = [end for end in chart.ends if end.kind == kind and not end.why.startswith("not run")]
    if not rows and not ends:
        return None
    if kind == "rbfmu's plan":
        plan = chart.plan
        return Reach(kind, plan.detail, plan.seconds, plan.error, plan.detail, "")
    offer = cheapest(rows, [row.family for row in rows], max(chart.accuracy, FLOOR))
    end = min(ends, key=lambda end: end.error, default=None)
    least, best, why = (end.error, end.method, end.why) if end else (rows[0].error, rows[0].method, "")
    stopped = any(end.stopped for end in ends)
    return Reach(kind, offer.method if offer else "", offer.cost if offer else math.inf, least, best, why, stopped)


# Each plan beside the best of the others


@dataclass(frozen=True)
class Verdict:
    """A plan for an accuracy, the best other method at the plan's error, the best peer at that accuracy.

    plan: None where it is refused; stopped: the peers that the time limit stopped before that accuracy; noise: the
    ratio within which costs count as equal.
    """

    chart: Chart
    accuracy: float
    plan: Row | None
    rival: Offer | None
    peer: Offer | None
    stopped: tuple[str, ...]
    noise: float

    @property
    def method(self) -> str:
        """Return what the plan chose."""
        return self.plan.detail if self.plan else REFUSED

    @property
    def error(self) -> float:
        """Return the plan's error; infinite where there is none."""
        return self.plan.error if self.plan else math.inf

    @property
    def cost(self) -> float:
        """Return the plan's cost for a simulated second; infinite where there is none."""
        return self.plan.seconds if self.plan else math.inf

    @property
    def dearness(self) -> float:
        """Return the cost relative to the best other method's, 0 where none is as accurate."""
        return self.cost / self.rival.cost if self.rival else 0.0

    @property
    def lead(self) -> float:
        """Return the best peer's cost over the plan's: infinite if no peer is as accurate, 0 if there is no plan."""
        return self.peer.cost / self.cost if self.peer else math.inf

    @property
    def even(self) -> bool:
        """Return whether both costs are equal within the noise."""
        return 1.0 / self.noise <= self.lead <= self.noise

    @property
    def kept(self) -> bool:
        """Return whether the plan keeps its accuracy and costs no more than `DEAREST` allows."""
        return self.error <= self.accuracy and self.dearness <= DEAREST * self.noise


def verdicts(charts: Sequence[Chart]) -> list[Verdict]:
    """Return a verdict for each chart and each accuracy that plans were asked for."""
    asked = {row.value for chart in charts for row in chart.rows if row.family == "planned"}
    return [_verdict(chart, accuracy) for chart in charts for accuracy in sorted(asked, reverse=True)]


def _verdict(chart: Chart, accuracy: float) -> Verdict:
    plan = next((row for row in chart.rows if row.family == "planned" and row.value == accuracy), None)
    rows, peers = above_round_off(chart), {row.method for row in chart.rows if row.family == "peer"}
    others, error = SIDES["library"] + SIDES["integrator"], min(plan.error if plan else math.inf, accuracy)
    rival = cheapest(rows, others, max(error, FLOOR))
    stopped = tuple(e.method for e in chart.ends if e.stopped and e.method in peers and e.error > accuracy)
    return Verdict(chart, accuracy, plan, rival, cheapest(rows, SIDES["peer"], accuracy), stopped, noise(chart))
