"""What the measurements on a scene say: the cost of the accuracy asked, by kind of method."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rbfmu.studies.own_chart.case import FLOOR
from rbfmu.studies.work_precision.answers import cheapest, rounded
from rbfmu.studies.work_precision.collection import STOPPED
from rbfmu.studies.work_precision.drawing import GROUPS
from rbfmu.studies.work_precision.tables import short

if TYPE_CHECKING:
    from rbfmu.studies.own_chart.result import Chart, Row

UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (1e-12, "ps"), (1e-15, "fs"))
KINDS = {name: {"exact": "closed form"}.get(name, name) for name in GROUPS}
"""How the kinds of methods are called."""


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


def clipped(chart: "Chart") -> list["Row"]:
    """Return the measurements with errors of at least `FLOOR`."""
    return [replace(row, error=max(row.error, FLOOR)) for row in chart.rows]


def reaches(chart: "Chart") -> list[Reach]:
    """Return what each kind of method costs at the accuracy asked, the cheapest first."""
    rows = clipped(chart)
    found = [_reach(chart, kind, [row for row in rows if row.kind == kind]) for kind in GROUPS]
    return sorted((reach for reach in found if reach), key=lambda reach: (reach.cost, reach.least))


def _reach(chart: "Chart", kind: str, rows: Sequence["Row"]) -> Reach | None:
    ends = [end for end in chart.ends if end.kind == kind and not end.why.startswith("not run")]
    if not rows and not ends:
        return None
    if kind == "rbfmu's plan":
        plan = chart.plan
        return Reach(kind, plan.detail, plan.seconds, plan.error, plan.detail, "")
    offer = cheapest(rows, [row.family for row in rows], max(chart.accuracy, FLOOR))
    end = min(ends, key=lambda end: end.error, default=None)
    least, best, why = (end.error, end.method, end.why) if end else (rows[0].error, rows[0].method, "")
    stopped = any(end.why == STOPPED for end in ends)
    return Reach(kind, offer.method if offer else "", offer.cost if offer else math.inf, least, best, why, stopped)


def noise(chart: "Chart") -> float:
    """Return the ratio within which costs count as equal: 19 of 20 points that may be compared have a smaller spread.

    These cost at most ten times as much as the plan; dear runs are timed less often.
    """
    return float(np.percentile([row.spread for row in chart.rows if row.seconds <= 10.0 * chart.plan.seconds], 95.0))


def headline(chart: "Chart") -> Iterator[str]:
    """Yield two lines: which method costs least at the accuracy asked, and what is beside it."""
    plan, first = chart.plan, reaches(chart)[0]
    asked = f"{chart.scene} at {short_number(chart.accuracy)}{', ports at zero' if chart.ports else ''}"
    ratio = plan.seconds / first.cost
    if ratio <= noise(chart):
        yield f"{asked}: use rbfmu's plan, {cost_text(plan.seconds)} per simulated second"
        yield f"{planned_method(chart)}; {_beside(chart)}"
    else:
        yield f"{asked}: cheapest is {first.method}, {cost_text(first.cost)} per simulated second"
        yield f"rbfmu's plan costs {times(ratio)} that ({planned_method(chart)})"


def planned_method(chart: "Chart") -> str:
    """Return the plan's model and how it is computed."""
    return f"{chart.model}: {chart.plan.detail}"


def _beside(chart: "Chart") -> str:
    peer = cheapest(clipped(chart), ("peer",), max(chart.accuracy, FLOOR))
    if peer is None:
        return "no peer meets that" if any(row.family == "peer" for row in chart.rows) else "no peer is charted"
    ratio = peer.cost / chart.plan.seconds
    return f"{peer.method} is even" if ratio <= noise(chart) else f"best peer {peer.method}, {times(ratio)} that"


def cost_text(seconds: float) -> str:
    """Return two digits and a unit: 0.41 fs, 8.1 ps, 170 ns, 1.4 ms."""
    size, unit = next(((size, unit) for size, unit in UNITS if seconds >= 0.9995 * size), UNITS[-1])
    return f"{rounded(seconds / size)} {unit}"


def times(ratio: float) -> str:
    """Return a ratio of costs with two digits: 0.41 x, 3.0 x, 1,200 x; beyond 1e5 with one."""
    return f"{rounded(ratio) if ratio < 1e5 else short(ratio)} x"


def short_number(number: float) -> str:
    """Return an error or accuracy in its shortest form: 1e-6, 2e-16, 3."""
    if number == 0.0:
        return "0"
    return short(number) if number < 0.095 else rounded(number).removesuffix(".0")


def digits(chart: "Chart") -> Iterator[tuple["Row", float]]:
    """Yield each plan and its cost relative to that for the accuracy asked."""
    for row in chart.plans:
        yield row, row.seconds / chart.plan.seconds


def exhausted(chart: "Chart") -> str:
    """Return why there are no plans for further digits than those that `digits` yields."""
    if chart.refusal:
        return chart.refusal
    return "the error is round-off, so further digits cost nothing" if chart.plans[-1].error < FLOOR else ""
