"""The method and its step or tolerance that meet a scene's accuracy at the least cost, found by pilot runs."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from rbfmu.measures import largest_error
from rbfmu.models import Plan
from rbfmu.pilot import Motion, pilot_run, references
from rbfmu.scene import Scene, SceneError
from rbfmu.unit import filled_buffer, initialize
from rbfmu_kernels.body_memory import body_of, loads_of
from rbfmu_kernels.kicked_top import is_symmetric_top, resonant_step

TIGHTEST = 1e-15
"""The smallest tolerance that double precision serves."""
LEAST_ORDER_OF_PORTS = 8
"""Of series: pilot runs do not see what comes through ports."""
TAYLOR_COSTS = {
    6: (163.0, 259.0, 237.0), 8: (181.0, 306.0, 257.0), 10: (224.0, 386.0, 324.0), 12: (267.0, 466.0, 394.0),
    14: (314.0, 582.0, 477.0), 16: (347.0, 656.0, 516.0), 18: (396.0, 750.0, 589.0), 20: (468.0, 878.0, 682.0),
    22: (529.0, 1018.0, 804.0), 24: (563.0, 1115.0, 841.0),
}  # fmt: skip
"""ns a substep by order, measured in one run as the next; only ratios count.

Torques that are known in b; also loads that turn in b; also a force that turns with the body.
"""
DOP853_COSTS, UNCONTROLLED_COSTS = (517.0, 624.0, 819.0), (413.0, 503.0, 625.0)
KICK_COSTS = {2: 121.0, 4: 520.0, 6: 913.0}


@dataclass(frozen=True)
class _Family:
    """A method with a setting to be found: its plan at a value, the error's power of the value, ns a substep."""

    plan_of: Callable[[float], Plan]
    power: float
    cost: float


@dataclass(frozen=True)
class _Fit:
    plan: Plan
    value: float
    error: float
    cost: float


def cheapest_fit(scene: Scene, general: Plan) -> Plan:
    """DOP853, Taylor series of some order, or kicks for a symmetric top: the cheapest that meets the accuracy.

    general: the plan for a body under loads, whose method and settings are to be found.
    """
    return _Search(scene, general).plan()


class _Search:
    """Pilot runs of one scene, judged by the same references; what was found so far."""

    def __init__(self, scene: Scene, general: Plan) -> None:
        self.scene, self.general, self.best = scene, general, None
        self.accuracy, self.ports = scene.run.accuracy, bool(scene.inputs.ports)
        self.known = not self.ports and not scene.inputs.parameters
        self.kind = _kind(scene)
        tightest = replace(_series(general, 20, 0.0), tolerance=1e-3 * min(TIGHTEST, self.accuracy))
        self.references: list[Motion] = references(scene, tightest)

    best: _Fit | None

    def plan(self) -> Plan:
        """The cheapest plan; SceneError where none is accurate enough."""
        apart = largest_error(*self.references)
        if apart > self.accuracy / 3.0:
            raise self._out_of_reach(apart)
        start = self._series()
        others = [_Family(partial(_controlled, self.general), 1.0, self._cost(DOP853_COSTS))]
        if self.known:
            others += [_Family(partial(_uncontrolled, self.general), 0.125, self._cost(UNCONTROLLED_COSTS))]
            others += _kicks(self.scene, self.general)
        for family in others:
            self._fit(family, start)
        assert self.best
        if self.best.error > self.accuracy / 3.0:
            raise self._out_of_reach(self.best.error)
        return self._explained(self.best)
