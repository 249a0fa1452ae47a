"""The models that a scene may get, and the plan that names one of them."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from rbfmu_kernels import attitude_unit, body_unit, free_unit, top_unit


@dataclass(frozen=True)
class Plan:
    """What simulates a scene, and why.

    substep: s, infinite where the method chooses or needs none; tolerance: largest estimated error of a substep, 0
    where none is estimated; order: of the kicks, 0 where there are none.
    """

    model: str
    method: str
    states: int
    substep: float = math.inf
    tolerance: float = 0.0
    order: int = 0
    reasons: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON: an infinite substep is None."""
        return asdict(self) | {"substep": self.substep if math.isfinite(self.substep) else None}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Plan":
        """The inverse of `to_dict`, also after JSON."""
        substep = math.inf if data["substep"] is None else data["substep"]
        return cls(**data | {"substep": substep, "reasons": tuple(data["reasons"])})

    @property
    def unit(self) -> Any:
        """The unit (a module of `rbfmu_kernels`) that runs the model."""
        return UNITS[self.model]


UNITS = {
    "prescribed rates": attitude_unit,
    "torque-free body": free_unit,
    "symmetric top": top_unit,
    "body under loads": body_unit,
}
