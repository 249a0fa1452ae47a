"""What planning, FMUs and runs know of a model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rbfmu.models.body_at_start import BodyAtStart, body_at_start
from rbfmu.models.model_buffer import Model
from rbfmu.models.scene_needs import Needs, varying_parameters
from rbfmu.scene.scene import Scene

Array = NDArray[np.float64]
Names = set[str] | frozenset[str]


@dataclass(frozen=True)
class ModelSpec:
    """A model: the kernels that run it, what it serves, what it costs and why it is chosen.

    Only `key` and `module` are needed for a model that a plan names; planning itself chooses those with `holds`.

    key: the public name, `Plan.model`.
    module: that of its kernels in `rbfmu_kernels.models`, which is loaded when they are first asked for.
    method: how it is computed; empty where the plan's settings say it.
    states, rate_states: numbers that it keeps of the rotation, with and without the attitude.
    holds: whether it holds for the scene's values, ports at zero, as the kernels' `initialize` sees it.
    rests_on: the names of the loads and parameters that must not vary.
    drops: the loads that it leaves out where they are too small to matter.
    closed_form: whether a formula gives the motion at any time.
    stands_still, keeps_rate: whether attitude and rate, or the rate alone, stay as they begin.
    force_keeps_direction: whether a force fixed in b keeps its first direction in a.
    may_be_unstable: whether a disturbance of its motion may grow, which a reason then says.
    angle_round_off: whether its angle is a double, whose round-off grows with it.
    rates_from: its rates from those of a motion (n, 3), rad/s; None where only a run can tell.
    conditioning: the error, rad, that the round-off of the body's moments makes.
    costs: ns a communication step, by what makes it necessary, where "" always counts; see `planning.costs`.
    substep_without_attitude: the cost of a substep without attitude, as a part of that of one with it.
    integrates_path: whether the path is part of the integration, and costs nothing besides.
    computes_all_outputs: whether all outputs are computed whatever is asked for, so that none costs more.
    reason: why it is exact.
    """

    key: str
    module: str
    method: str = ""
    states: int = 7
    rate_states: int = 7
    holds: Callable[[BodyAtStart], bool] = lambda start: True
    rests_on: Callable[[Scene, Needs], Names] = lambda scene, needs: frozenset()
    drops: Names = frozenset()
    closed_form: bool = False
    stands_still: bool = False
    keeps_rate: bool = False
    force_keeps_direction: bool = False
    may_be_unstable: bool = False
    angle_round_off: bool = False
    rates_from: Callable[[Scene, Array], Array] | None = None
    conditioning: Callable[[Scene], float] = lambda scene: 0.0
    costs: Mapping[str, float] = field(default_factory=dict)
    substep_without_attitude: float = 1.0
    integrates_path: bool = False
    computes_all_outputs: bool = False
    reason: Callable[[Scene, Needs], str] = lambda scene, needs: ""

    @property
    def kernels(self) -> Model:
        """Return the kernels that run it."""
        return cast(Model, import_module(f"rbfmu_kernels.models.{self.module}"))

    def serves(self, scene: Scene, needs: Needs) -> bool:
        """Return whether the model is exact, whatever the ports supply and listed parameters become."""
        return not self.rests_on(scene, needs) & varying_parameters(scene) and self.accepts(scene)

    def accepts(self, scene: Scene) -> bool:
        """Return whether the model holds for the scene's values, as the kernels' `initialize` finds."""
        start = body_at_start(scene)
        return start.fault == 0 and self.holds(start)

    def states_for(self, needs: Needs) -> int:
        """Return how many numbers it keeps for what is needed."""
        rotation = self.states if needs.attitude else self.rate_states
        return rotation + (6 if needs.translation else 0)
