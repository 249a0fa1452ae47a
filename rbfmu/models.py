"""The models that a scene may get, and the plan that names one of them."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from rbfmu_kernels import (
    attitude_unit,
    axis_unit,
    body_unit,
    free_unit,
    momentum_unit,
    pendulum_unit,
    precession_unit,
    pushed_unit,
    spin_up_unit,
    steady_unit,
    taylor_unit,
    top_unit,
    translation_unit,
    undamped_pendulum_unit,
)


@dataclass(frozen=True)
class Plan:
    """What simulates a scene, and why.

    substep: s, infinite where the method chooses or needs none; tolerance: largest estimated error of a substep, or of
    all substeps of a run of `span` s together where that is not 0; 0 where none is estimated; order: of the kicks or of
    the series, 0 where there are none; held: parameters by whose values the model was judged, so that an importer must
    not change them; error: the largest that is expected, as the scene's `accuracy` counts; cost: ns a communication
    step in which the outputs asked for are computed, on `costs.MACHINE`.
    """

    model: str
    method: str
    states: int
    substep: float = math.inf
    tolerance: float = 0.0
    order: int = 0
    held: tuple[str, ...] = ()
    error: float = 0.0
    cost: float = 0.0
    span: float = 0.0
    reasons: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON: an infinite substep is None."""
        return asdict(self) | {"substep": self.substep if math.isfinite(self.substep) else None}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Plan":
        """The inverse of `to_dict`, also after JSON."""
        substep = math.inf if data["substep"] is None else data["substep"]
        lists = {"held": tuple(data["held"]), "reasons": tuple(data["reasons"])}
        return cls(**data | {"substep": substep} | lists)

    @property
    def unit(self) -> Any:
        """The unit (a module of `rbfmu_kernels`) that runs the model."""
        return UNITS[self.model]


UNITS = {
    "no rotation": translation_unit,
    "constant rate": steady_unit,
    "angular momentum": momentum_unit,
    "one axis": axis_unit,
    "undamped pendulum": undamped_pendulum_unit,
    "one swinging axis": pendulum_unit,
    "prescribed rates": attitude_unit,
    "torque-free symmetric body": precession_unit,
    "symmetric body spun up": spin_up_unit,
    "torque-free body": free_unit,
    "torque-free body, pushed": pushed_unit,
    "symmetric top": top_unit,
    "body under loads": body_unit,
    "body under loads, by series": taylor_unit,
}
"""From the smallest model to the largest."""
