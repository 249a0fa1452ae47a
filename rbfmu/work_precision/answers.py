"""For accuracy X, use method Y, it costs Z: read off the collected figures."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rbfmu.work_precision.collection import Point

DECADES = tuple(10.0**-k for k in range(2, 15))
OWN = ("exact", "DOP853", "Taylor", "kicks")
"""Families of the library's own methods; `planned` chooses among them."""
NOTABLE = 1.3
"""How much cheaper a contestant must be to be named."""
OUTSIDE = ("classic", "Moser-Veselov")


@dataclass(frozen=True)
class Offer:
    """A method's cost to reach an accuracy, s per simulated second."""

    method: str
    family: str
    cost: float


@dataclass(frozen=True)
class Answer:
    """The best offers for an accuracy (rad) on a case; None where nobody reaches it."""

    case: str
    title: str
    accuracy: float
    own: Offer | None
    planned: Offer | None
    contestant: Offer | None
    peer: Offer | None

    def row(self) -> dict[str, object]:
        """For a CSV file."""
        found: dict[str, object] = {"case": self.case, "title": self.title, "accuracy": self.accuracy}
        for name in ("own", "planned", "contestant", "peer"):
            offer: Offer | None = getattr(self, name)
            found |= {name: offer.method if offer else "", f"{name}_cost": offer.cost if offer else math.nan}
        return found


def _attitude_error(point: Point) -> float:
    return point.attitude_error


def front(points: Iterable[Point], error: Callable[[Point], float] = _attitude_error, gain: float = 1.0) -> list[Point]:
    """The points that no cheaper one beats, by falling error; each below `gain` times the last one's."""
    kept: list[Point] = []
    for point in sorted(points, key=lambda p: p.seconds):
        if not kept or error(point) < gain * error(kept[-1]):
            kept.append(point)
    return kept


def cost_of(points: Iterable[Point], accuracy: float) -> float | None:
    """What one method's points make an accuracy cost: between two points, by the power law through them."""
    best = front(points)
    if not best or best[-1].attitude_error > accuracy:
        return None
    if best[0].attitude_error <= accuracy:
        return best[0].cost
    for coarse, fine in pairwise(best):
        if fine.attitude_error <= accuracy:
            if fine.family in ("exact", "planned"):
                return fine.cost
            part = math.log(coarse.attitude_error / accuracy) / math.log(coarse.attitude_error / fine.attitude_error)
            return float(coarse.cost * (fine.cost / coarse.cost) ** part)
    raise AssertionError


def cheapest(points: Sequence[Point], families: Sequence[str], accuracy: float) -> Offer | None:
    """The cheapest method of some families."""
    offers = []
    for method in dict.fromkeys(p.method for p in points if p.family in families):
        mine = [p for p in points if p.method == method]
        if (cost := cost_of(mine, accuracy)) is not None:
            offers.append(Offer(method, mine[0].family, cost))
    return min(offers, key=lambda offer: offer.cost, default=None)


def answers(points: Sequence[Point], decades: Sequence[float] = DECADES) -> list[Answer]:
    """Case by case, decade by decade."""
    found = []
    for case in dict.fromkeys(p.case for p in points):
        mine = [p for p in points if p.case == case]
        for accuracy in decades:
            offers = (cheapest(mine, families, accuracy) for families in (OWN, ("planned",), OUTSIDE, ("peer",)))
            found.append(Answer(case, mine[0].title, accuracy, *offers))
    return found


def text_of(seconds: float) -> str:
    """Two digits and a unit: 1.2 µs."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (1e-12, "ps"), (1e-15, "fs")):
        if seconds >= 0.9995 * size:
            number = seconds / size
            return f"{number:.0f} {unit}" if number >= 9.95 else f"{number:.1f} {unit}"
    return f"{seconds:.1e} s"


def rival(answer: Answer) -> Offer | None:
    """A contestant that is notably cheaper than the library's own methods, or does what they cannot."""
    other = answer.contestant
    return None if other and answer.own and other.cost * NOTABLE > answer.own.cost else other


def advice(found: Sequence[Answer]) -> str:
    """Of one case: the cheapest method, up to which accuracy."""
    offers = [(rival(answer) or answer.own, answer.accuracy) for answer in found]
    names = [(_general(offer), accuracy) for offer, accuracy in offers if offer]
    best = list(dict.fromkeys(name for name, _ in names))
    if len(best) == 1 and len(names) == len(found):
        return f"{best[0]}, at every accuracy"
    finest = {name: min(accuracy for other, accuracy in names if other == name) for name in best}
    return "; ".join(f"{name} to {finest[name]:.0e} rad" for name in best).replace("e-0", "e-") or "no method"


def _general(offer: Offer) -> str:
    """DOP853 however its steps, Taylor series of any order; else the method's name."""
    return {"DOP853": "DOP853", "Taylor": "Taylor series"}.get(offer.family, offer.method)


def answer_table(found: Sequence[Answer], decades: Sequence[float] = (1e-3, 1e-6, 1e-9, 1e-12)) -> str:
    """For the terminal: method, cost per simulated second, how much more the best peer costs."""
    head = ["attitude error at most"] + [f"{x:.0e} rad".replace("e-0", "e-") for x in decades]
    rows = []
    for case in dict.fromkeys(answer.case for answer in found):
        mine = {answer.accuracy: answer for answer in found if answer.case == case}
        title = next(iter(mine.values())).title
        cells = [_cell(mine[x]) if x in mine else ("", "") for x in decades]
        rows += [[title, *(cell[0] for cell in cells)], ["", *(cell[1] for cell in cells)]]
    return aligned([head, *rows])


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Columns of equal width, a line below the first row."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _cell(answer: Answer) -> tuple[str, str]:
    if answer.own is None:
        return "-", ""
    ratio = f", best peer {answer.peer.cost / answer.own.cost:.0f} x" if answer.peer else ""
    return answer.own.method, f"{text_of(answer.own.cost)} a second{ratio}"
