"""The models that a scene may get, and the plan that names one of them."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from rbfmu_kernels.models import (
    angular_momentum,
    constant_rate,
    free_body_force,
    free_symmetric,
    free_triaxial,
    loaded_dop853,
    loaded_splitting,
    loaded_taylor,
    no_rotation,
    one_axis,
    one_axis_taylor,
    pendulum,
    prescribed_rates,
    spin_up,
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
        return MODELS[self.model]


MODELS = {
    "no rotation": no_rotation,
    "constant rate": constant_rate,
    "angular momentum": angular_momentum,
    "one axis": one_axis,
    "undamped pendulum": pendulum,
    "one swinging axis": one_axis_taylor,
    "prescribed rates": prescribed_rates,
    "torque-free symmetric body": free_symmetric,
    "symmetric body spun up": spin_up,
    "torque-free body": free_triaxial,
    "torque-free body, pushed": free_body_force,
    "symmetric top": loaded_splitting,
    "body under loads": loaded_dop853,
    "body under loads, by series": loaded_taylor,
}
"""From the smallest model to the largest."""
