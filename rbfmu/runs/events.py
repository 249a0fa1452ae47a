"""Events of a run: the times when formulas came to zero, as the model lists them over a step."""

from typing import NamedTuple

import numpy as np

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Buffer
from rbfmu_kernels.models.formula_events import NOT_ASKED, TOUCH


class Happened(NamedTuple):
    """An event that happened; touched: what is watched came to zero and went back."""

    name: str
    time: float
    touched: bool


class Events:
    """What a model lists of its last step, and what was taken of the steps before."""

    def __init__(self, scene: Scene, plan: Plan, z: Buffer) -> None:
        blocks = plan.kernels.BLOCKS
        self._names, self._z = (*scene.events,), z
        self._ending = {name for name, event in scene.events.items() if event.stop}
        self._count, self._list = z[blocks["events.listed"]], z[blocks["events.list"]].reshape(-1, 3)
        self._taken: list[Happened] = []

    @property
    def may_end(self) -> bool:
        """Return whether an event may end the run."""
        return bool(self._ending)

    def of_last_step(self) -> list[Happened]:
        """Return what happened in the last step, in its order."""
        rows = self._list[: int(self._count[0])]
        found = [Happened(self._names[int(e)], float(t), kind == TOUCH) for e, t, kind in rows if kind != NOT_ASKED]
        return sorted(found, key=lambda event: event.time)

    def times_of_last_step(self) -> dict[str, Array]:
        """Return the times of each event of the last step, s."""
        return times_of(self._names, self.of_last_step())

    def take(self) -> float | None:
        """Keep what happened in the last step, up to what ends the run; return the time of that, or None."""
        for event in self.of_last_step():
            self._taken.append(event)
            if event.name in self._ending and not event.touched:
                return event.time
        return None

    @property
    def last(self) -> str:
        """Return the name of the event that was taken last."""
        return self._taken[-1].name

    def times(self, touched: bool = False) -> dict[str, Array]:
        """Return the times of each event that were taken, s."""
        return times_of(self._names, self._taken, touched)


def times_of(names: tuple[str, ...], happened: list[Happened], touched: bool = False) -> dict[str, Array]:
    """Return the times of each event, s."""
    return {
        name: np.array([one.time for one in happened if (one.name, one.touched) == (name, touched)]) for name in names
    }
