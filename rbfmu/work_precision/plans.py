"""What plans promise on motions with torques, held against the collected figures."""

from collections.abc import Sequence
from dataclasses import dataclass

from rbfmu.planning import plan
from rbfmu.work_precision.answers import OUTSIDE, OWN, Offer, aligned, cheapest, text_of
from rbfmu.work_precision.cases import CASES
from rbfmu.work_precision.collection import Point

DEAREST, PEERS, PEERS_AT = 1.3, 100.0, 1e-9
"""A plan may cost so many times the best contestant; the best peer at an accuracy of 1e-9 at least so many times it."""


@dataclass(frozen=True)
class Verdict:
    """A plan for an accuracy, its error and cost, the best contestant at that error, the best peer at that accuracy."""

    case: str
    accuracy: float
    method: str
    error: float
    cost: float
    contestant: Offer | None
    peer: Offer | None

    @property
    def dearness(self) -> float:
        """The cost over the best contestant's, 0 where none is as accurate."""
        return self.cost / self.contestant.cost if self.contestant else 0.0

    @property
    def lead(self) -> float:
        """The best peer's cost over this one's, infinite where none is as accurate."""
        return self.peer.cost / self.cost if self.peer else float("inf")

    @property
    def kept(self) -> bool:
        """Whether error and cost are as they should be."""
        leads = self.lead >= PEERS or self.accuracy != PEERS_AT
        return self.error <= self.accuracy and self.dearness <= DEAREST and leads

    def row(self) -> tuple[str, ...]:
        """For a table."""
        rival = (self.contestant.method, f"{self.dearness:.2f}") if self.contestant else ("none", "")
        peer = (self.peer.method, f"{self.lead:.0f}") if self.peer else ("none", "")
        start = (self.case, f"{self.accuracy:.0e}", self.method, f"{self.error:.1e}", text_of(self.cost))
        return (*start, *rival, *peer, "kept" if self.kept else "MISSED")


HEAD = (
    *("case", "asked", "plan", "error", "cost a second", "best contestant at that error", "plan over it"),
    *("best peer at that accuracy", "over plan", f"<= {DEAREST:g}, at {PEERS_AT:.0e} >= {PEERS:g}"),
)


def verdicts(points: Sequence[Point]) -> list[Verdict]:
    """Of all plans of motions with torques among the points."""
    found = []
    for point in points:
        if point.family != "planned" or CASES[point.case].torque_free:
            continue
        mine = [p for p in points if p.case == point.case]
        method = plan(CASES[point.case].asking(point.value)).method
        rival = cheapest(mine, (*OWN, *OUTSIDE), point.attitude_error)
        peer = cheapest(mine, ("peer",), point.value)
        found.append(Verdict(point.case, point.value, method, point.attitude_error, point.cost, rival, peer))
    return found


def verdict_table(found: Sequence[Verdict]) -> str:
    """For the terminal."""
    return aligned([HEAD, *(verdict.row() for verdict in found)])
