"""Plans compared with the best of the library's own methods and with the best peer, at the same accuracy."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rbfmu.studies.work_precision.answers import OUTSIDE, OWN, Offer, cheapest
from rbfmu.studies.work_precision.cases import CHECKPOINTS
from rbfmu.studies.work_precision.collection import Collection, Point

DEAREST = 1.3
"""The largest cost of a plan relative to the best other method; a plan is made without knowing the true error."""
REFUSED = "refused"


@dataclass(frozen=True)
class Verdict:
    """A plan for an accuracy, the best other method at the plan's error, the best peer at that accuracy.

    cost: infinite where no plan is made; stopped: the peers that the time limit stopped before that accuracy; noise:
    the ratio within which costs count as equal.
    """

    case: str
    title: str
    outputs: int
    accuracy: float
    method: str
    error: float
    cost: float
    rival: Offer | None
    peer: Offer | None
    stopped: tuple[str, ...]
    noise: float

    @property
    def many(self) -> bool:
        """Return whether outputs are many."""
        return self.outputs > CHECKPOINTS

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


def verdicts(found: Collection) -> list[Verdict]:
    """Return a verdict for each motion and each accuracy that plans were asked for."""
    asked = sorted({p.value for p in found.points if p.family == "planned"}, reverse=True)
    noise, verdicts_found = found.noise, []
    for motion in dict.fromkeys(p.motion for p in found.points):
        mine = [p for p in found.points if p.motion == motion]
        for accuracy in asked:
            stopped = tuple(_stopped(found, motion, accuracy))
            verdicts_found.append(_verdict(mine, accuracy, stopped, noise))
    return verdicts_found


def _stopped(found: Collection, motion: tuple[str, int], accuracy: float) -> Iterator[str]:
    for ending in found.endings:
        mine = (ending.case, ending.outputs) == motion and ending.family == "peer"
        if mine and ending.stopped and ending.error > accuracy:
            yield ending.method


def _verdict(points: Sequence[Point], accuracy: float, stopped: tuple[str, ...], noise: float) -> Verdict:
    planned = next((p for p in points if p.family == "planned" and p.value == accuracy), None)
    error = planned.error if planned else math.inf
    made = (planned.detail, error, planned.seconds) if planned else (REFUSED, error, math.inf)
    rival = cheapest(points, (*OWN, *OUTSIDE), min(error, accuracy))
    peer = cheapest(points, ("peer",), accuracy)
    head = (points[0].case, points[0].title, points[0].outputs, accuracy)
    return Verdict(*head, *made, rival, peer, stopped, noise)
