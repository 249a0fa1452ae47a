"""The plan of an ensemble: models and methods that hold for every member."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.samples import Samples, ensemble_of
from rbfmu.planning import plan
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene


@dataclass(frozen=True)
class EnsemblePlan:
    """What simulates the members of an ensemble, and why; `plans` has one plan for all, or a few."""

    plans: tuple[Plan, ...]
    reasons: tuple[str, ...] = ()

    def plan_of(self, samples: Samples) -> NDArray[np.int64]:
        """Return for each member the place (count,) of its plan in `plans`."""
        return np.zeros(len(samples), dtype=np.int64)


def plan_ensemble(scene: Scene, progress: Callable[[float], Any] | None = None) -> EnsemblePlan:
    """Choose model, method and step for all members: the plan of the scene with the parameters listed that vary.

    Raises SceneError without an ensemble, and where the accuracy asked cannot be met.
    """
    found = plan(with_listed(scene), progress=progress)
    return EnsemblePlan((found,), found.reasons)


def with_listed(scene: Scene) -> Scene:
    """Return the single scene whose plan holds for every value of what varies."""
    names = dict.fromkeys((*scene.inputs.parameters, *ensemble_of(scene).parameters))
    listed = [name for name in names if name not in scene.inputs.ports]
    return scene.replace({"ensemble": None, "inputs.parameters": listed})
