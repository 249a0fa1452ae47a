"""The cost of an accuracy with each kind of method, read from the collected measurements."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, TypeVar

from rbfmu.studies.work_precision.collection import Point

DECADES = tuple(10.0**-k for k in range(2, 15))
OWN = ("exact", "DOP853", "Taylor", "splitting")
"""Families of the library's own methods; `planned` chooses among them."""
OUTSIDE = ("classic", "Moser-Veselov")


@dataclass(frozen=True)
class Offer:
    """A method, and the processor time in s of a run by which it reaches an accuracy."""

    method: str
    family: str
    cost: float


@dataclass(frozen=True)
class Answer:
    """The best offers for an accuracy (rad) on a case; None where no method reaches it."""

    case: str
    title: str
    outputs: int
    accuracy: float
    library: Offer | None
    planned: Offer | None
    integrator: Offer | None
    peer: Offer | None

    def row(self) -> dict[str, object]:
        """Return the answer as a row of a CSV file."""
        found: dict[str, object] = {"case": self.case, "title": self.title, "outputs": self.outputs}
        found["accuracy"] = self.accuracy
        for name in ("library", "planned", "integrator", "peer"):
            offer: Offer | None = getattr(self, name)
            found |= {name: offer.method if offer else "", f"{name}_cost": offer.cost if offer else math.nan}
        return found


class Measured(Protocol):
    """A method at a setting, its error and its cost."""

    @property
    def method(self) -> str:
        """Return the method's name."""

    @property
    def family(self) -> str:
        """Return the method's family."""

    @property
    def error(self) -> float:
        """Return the error by which methods are compared."""

    @property
    def seconds(self) -> float:
        """Return the cost, s of the processor."""


M = TypeVar("M", bound=Measured)


def error_of(point: Measured) -> float:
    """Return the error by which methods are compared."""
    return point.error


def front(points: Iterable[M], error: Callable[[M], float] = error_of, gain: float = 1.0) -> list[M]:
    """Return the Pareto front by rising cost: each error is below `gain` times that of the point before."""
    kept: list[M] = []
    for point in sorted(points, key=lambda p: p.seconds):
        if not kept or error(point) < gain * error(kept[-1]):
            kept.append(point)
    return kept


def cost_of(points: Iterable[Measured], accuracy: float) -> float | None:
    """Return the cost of an accuracy by one method's points, interpolated by a power law; None if out of reach."""
    best = front(points)
    if not best or best[-1].error > accuracy:
        return None
    if best[0].error <= accuracy:
        return best[0].seconds
    for coarse, fine in pairwise(best):
        if fine.error <= accuracy:
            if fine.family in ("exact", "planned"):
                return fine.seconds
            part = math.log(coarse.error / accuracy) / math.log(coarse.error / fine.error)
            return float(coarse.seconds * (fine.seconds / coarse.seconds) ** part)
    raise AssertionError


def cheapest(points: Sequence[Measured], families: Sequence[str], accuracy: float) -> Offer | None:
    """Return the cheapest method of some families."""
    offers = []
    for method in dict.fromkeys(p.method for p in points if p.family in families):
        mine = [p for p in points if p.method == method]
        if (cost := cost_of(mine, accuracy)) is not None:
            offers.append(Offer(method, mine[0].family, cost))
    return min(offers, key=lambda offer: offer.cost, default=None)


def answers(points: Sequence[Point], decades: Sequence[float] = DECADES) -> list[Answer]:
    """Return the answers, motion by motion, decade by decade."""
    found = []
    for motion in dict.fromkeys(p.motion for p in points):
        mine = [p for p in points if p.motion == motion]
        for accuracy in decades:
            offers = (cheapest(mine, families, accuracy) for families in (OWN, ("planned",), OUTSIDE, ("peer",)))
            found.append(Answer(mine[0].case, mine[0].title, mine[0].outputs, accuracy, *offers))
    return found


def text_of(seconds: float) -> str:
    """Return two digits and a unit: 0.41 µs, 8.1 µs, 170 µs, 1.4 ms."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= 0.9995 * size or unit == "µs":
            return f"{rounded(seconds / size)} {unit}"
    raise AssertionError


def rounded(number: float) -> str:
    """Return a number rounded to two significant digits, without an exponent."""
    number = float(f"{number:.1e}")
    return f"{number:,.{max(0, 1 - math.floor(math.log10(number)))}f}"
