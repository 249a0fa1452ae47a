"""What a chart holds, and what it says.

All measurements on a case, how far each method came, and the models that are too small; the cost of an accuracy, by
kind of method; plans beside the best of the others.
"""

import csv
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rbfmu.studies.chart.cases import FLOOR

Progress = Callable[[int, int, str], object]
"""What is called with (done, total, text)."""
TAKES_NO = "takes no"
"""How the reason begins why a model does not serve a scene with ports, or with parameters to be changed."""
STOPPED = "stopped: time limit"
YOURS = "your method"
KINDS = {
    "rbfmu's plan": "#000000",
    "exact": "#009e73",
    "Taylor series": "#56b4e9",
    "DOP853": "#0072b2",
    "splitting": "#cc79a7",
    "Moser-Veselov": "#8a7500",
    "heyoka.py": "#d55e00",
    "numbalsoda": "#e69f00",
    "SciPy odeint": "#a0522d",
    "SciPy solve_ivp": "#c97b63",
    "MuJoCo": "#7b3294",
    "Basilisk": "#b58ac2",
    "Drake": "#5e3c99",
    "RK4, Euler and others": "#8c8c8c",
    YOURS: "#e7298a",
}
"""The kinds of methods, the library's own first, and the colour of the line that is the best of each."""
OWN_KINDS = tuple(KINDS)[:5]
_FAMILIES = {"planned": "rbfmu's plan", "Taylor": "Taylor series", "classic": "RK4, Euler and others"}


def kind_of(method: str, family: str) -> str:
    """Return the kind of a method of a family."""
    if family != "peer":
        return _FAMILIES.get(family, family)
    if method.startswith("SciPy") and method != "SciPy odeint":
        return "SciPy solve_ivp"
    return next(name for name in KINDS if method.startswith(name))


@dataclass(frozen=True)
class Row:
    """One method at one setting, or a plan at the accuracy that it was made for.

    detail: what a plan chose; error: as the scene's accuracy counts; seconds: of the processor, for a simulated second;
    run_seconds: for the whole run; spread: the ratio between the least times of two halves of the repeats;
    right_hand_sides: evaluations in a run (0: none, NaN: not counted); compiling: the additional time of the method's
    very first call, s; drifts: of what the motion conserves, relative (NaN: it does not).
    """

    kind: str
    method: str
    detail: str
    family: str
    setting: str
    value: float
    error: float
    seconds: float
    run_seconds: float
    spread: float
    right_hand_sides: float
    compiling: float = 0.0
    energy_drift: float = math.nan
    momentum_drift: float = math.nan
    vertical_momentum_drift: float = math.nan


class End(NamedTuple):
    """The smallest error that a method reached (infinite: none below 1), and why no finer setting was tried."""

    kind: str
    method: str
    error: float
    why: str

    @property
    def stopped(self) -> bool:
        """Return whether the time limit stopped the method."""
        return self.why == STOPPED


class TooSmall(NamedTuple):
    """A model that is smaller than the plan's, and its error as the scene's accuracy counts it.

    why: why it has none, if so.
    """

    model: str
    error: float
    why: str = ""


@dataclass(frozen=True)
class Measured:
    """Accuracy against cost on a scene: what a chart shows.

    model: the plan's; accuracy: the one asked; span, outputs: of the charted run, s; ports: those that are at zero;
    rows: all measurements; ends: how far each method came; too_small: models that the plan's is larger than; absent:
    lines on peers that are not charted; refusal: why no tighter plan is made; machine: what it was measured on; whole:
    the length of the scene's run, s (0: `span`); key, many: which of the eight motions, and of its numbers of outputs.
    """

    scene: str
    model: str
    accuracy: float
    span: float
    outputs: int
    ports: tuple[str, ...]
    rows: tuple[Row, ...]
    ends: tuple[End, ...]
    too_small: tuple[TooSmall, ...]
    absent: tuple[str, ...]
    refusal: str
    machine: tuple[str, ...]
    whole: float = 0.0
    key: str = ""
    many: bool = False

    @property
    def plans(self) -> tuple[Row, ...]:
        """Return the plans, first that for the accuracy asked, then for each further digit."""
        return tuple(row for row in self.rows if row.family == "planned" and row.value <= self.accuracy)

    @property
    def plan(self) -> Row:
        """Return the plan for the accuracy asked."""
        return self.plans[0]

    @cached_property
    def above_round_off(self) -> list[Row]:
        """Return the measurements with errors of at least `FLOOR`."""
        return [replace(row, error=max(row.error, FLOOR)) for row in self.rows]

    @cached_property
    def noise(self) -> float:
        """Return the ratio within which costs count as equal: 19 of 20 points that are compared have a smaller spread.

        These cost at most ten times as much as the plan; dear runs are timed less often.
        """
        return float(np.percentile([row.spread for row in self.rows if row.seconds <= 10.0 * self.plan.seconds], 95.0))

    def cheapest(self, families: Sequence[str], accuracy: float) -> "Offer | None":
        """Return the cheapest method of some families that reaches an accuracy."""
        return cheapest([row for row in self.above_round_off if row.family in families], accuracy)

    @cached_property
    def reaches(self) -> "list[Reach]":
        """Return what each kind of method costs at the accuracy asked, the cheapest first."""
        found = filter(None, map(self._reach, KINDS))
        return sorted(found, key=lambda reach: (reach.cost, reach.end.error))

    def _reach(self, kind: str) -> "Reach | None":
        rows = [row for row in self.above_round_off if row.kind == kind]
        ends = [end for end in self.ends if end.kind == kind and not end.why.startswith("not run")]
        if not rows and not ends:
            return None
        if kind == "rbfmu's plan":
            return Reach(kind, self.plan.detail, self.plan.seconds, End(kind, self.plan.detail, self.plan.error, ""))
        offer = cheapest(rows, max(self.accuracy, FLOOR)) or Offer("", math.inf)
        end = min(ends, key=lambda end: end.error) if ends else End(kind, rows[0].method, rows[0].error, "")
        return Reach(kind, offer.method, offer.cost, end, any(end.stopped for end in ends))


def write_rows(path: Path, rows: Iterable[Mapping[str, object]], head: Iterable[str]) -> Path:
    """Write a CSV file whose first lines, after #, say where the figures come from."""
    rows = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {' '.join(line.split())}\n" for line in head)
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


# What charts say: the cost of an accuracy, by kind of method; plans beside the best of the others

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


def front(rows: Iterable[Row], gain: float = 1.0) -> list[Row]:
    """Return the Pareto front by rising cost: each error is below `gain` times that of the row before."""
    kept: list[Row] = []
    for row in sorted(rows, key=lambda row: row.seconds):
        if not kept or row.error < gain * kept[-1].error:
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


class Offer(NamedTuple):
    """A method, and the processor time in s by which it reaches an accuracy, for a simulated second."""

    method: str
    cost: float


def cheapest(rows: Sequence[Row], accuracy: float) -> Offer | None:
    """Return the cheapest method of these rows that reaches an accuracy."""
    names = dict.fromkeys(row.method for row in rows)
    costs = ((name, cost_of([row for row in rows if row.method == name], accuracy)) for name in names)
    offers = [Offer(name, cost) for name, cost in costs if cost is not None]
    return min(offers, key=lambda offer: offer.cost, default=None)


class Reach(NamedTuple):
    """The cheapest way to the accuracy asked by a kind of method.

    cost: s for a simulated second, infinite where none meets the accuracy; end: that with the smallest error of the
    kind; stopped: whether the time limit stopped one, which might else come further.
    """

    kind: str
    method: str
    cost: float
    end: End
    stopped: bool = False

    @property
    def name(self) -> str:
        """Return how the kind is called."""
        return "closed form" if self.kind == "exact" else self.kind


# Each plan beside the best of the others


@dataclass(frozen=True)
class Verdict:
    """A plan for an accuracy, the best other method at the plan's error, the best peer at that accuracy.

    method: what the plan chose; error, cost: its own, for a simulated second, infinite where it is refused; stopped:
    whether the time limit stopped a peer before that accuracy.
    """

    chart: Measured
    accuracy: float
    method: str
    error: float
    cost: float
    rival: Offer | None
    peer: Offer | None
    stopped: bool

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
        return 1.0 / self.chart.noise <= self.lead <= self.chart.noise

    @property
    def kept(self) -> bool:
        """Return whether the plan keeps its accuracy and costs no more than `DEAREST` allows."""
        return self.error <= self.accuracy and self.dearness <= DEAREST * self.chart.noise


def verdicts(charts: Sequence[Measured]) -> list[Verdict]:
    """Return a verdict for each chart and each accuracy that plans were asked for."""
    asked = {row.value for chart in charts for row in chart.rows if row.family == "planned"}
    return [_verdict(chart, accuracy) for chart in charts for accuracy in sorted(asked, reverse=True)]


def _verdict(chart: Measured, accuracy: float) -> Verdict:
    plan = next((row for row in chart.rows if row.family == "planned" and row.value == accuracy), None)
    chosen = (plan.detail, plan.error, plan.seconds) if plan else (REFUSED, math.inf, math.inf)
    error = max(min(chosen[1], accuracy), FLOOR)
    peers = {row.method for row in chart.rows if row.family == "peer"}
    stopped = any(e.stopped and e.method in peers and e.error > accuracy for e in chart.ends)
    rival = chart.cheapest(SIDES["library"] + SIDES["integrator"], error)
    return Verdict(chart, accuracy, *chosen, rival, chart.cheapest(SIDES["peer"], accuracy), stopped)
