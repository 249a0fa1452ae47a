"""From a scene to a plan: the model, the method and the substep that meet the scene's accuracy."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rbfmu.measures import largest_error
from rbfmu.scene import Scene, SceneError
from rbfmu.unit import filled_buffer, initialize, unit_of
from rbfmu_kernels.layout import FINE

CHECKPOINTS = 256
"""Most points of a pilot run at which two step sizes are compared."""
MOST_PILOT_STEPS = 2e8
"""Substeps that a pilot run may take before its scene counts as out of reach."""


@dataclass(frozen=True)
class Plan:
    """What simulates a scene: `substep` in s (infinite: one step whatever its size), and why."""

    model: str
    method: str
    substep: float
    states: int
    reasons: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON: an infinite substep is None."""
        return asdict(self) | {"substep": self.substep if math.isfinite(self.substep) else None}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Plan":
        """The inverse of `to_dict`, also after JSON."""
        substep = math.inf if data["substep"] is None else data["substep"]
        return cls(**data | {"substep": substep, "reasons": tuple(data["reasons"])})


def plan(scene: Scene) -> Plan:
    """Choose model, method and substep. Raises SceneError where the accuracy asked cannot be met."""
    if "omega_b" in scene.inputs.ports:
        reason = "port omega_b prescribes the body's rates: attitude only, exact for rates held over a step"
        return Plan("prescribed rates", "exact rotation", math.inf, 4, (reason,))
    substep, reason = _pilot_substep(scene)
    reasons = [reason]
    if scene.inputs.ports:
        reasons.append("the pilot run has the ports at zero: larger loads need a smaller substep (or accuracy)")
    assert scene.body is not None
    model = "rotation about a pivot" if scene.body.pivot else "free body, 6 degrees of freedom"
    return Plan(model, "RK4", substep, 7 if scene.body.pivot else 13, tuple(reasons))


def _pilot_substep(scene: Scene) -> tuple[float, str]:
    """The largest step/2^k whose run differs from that of half of it by no more than half the accuracy."""
    run = scene.run
    substep, coarse, previous = run.step, None, math.inf
    while run.stop - run.start <= MOST_PILOT_STEPS * substep:
        fine, fastest = _pilot(scene, 0.5 * substep)
        if coarse is not None and fastest * substep <= 1.0:  # above, RK4's turns alias and two runs can agree by chance
            error = largest_error(coarse, fine)
            if error <= 0.5 * run.accuracy:
                return substep, f"RK4 at {substep:.3g} s: error at most {error:.1e}, from a pilot run at half the step"
            if error > 0.25 * previous and error < 1e-6:
                break  # round-off has taken over: halving no longer helps
            previous = error
        coarse, substep = fine, 0.5 * substep
    reached = f"RK4 reaches {previous:.1e}" if math.isfinite(previous) else "RK4 reaches none"
    raise SceneError(f"run.accuracy = {run.accuracy!r}: expected one that this scene can meet; {reached}", scene.name)


def _pilot(scene: Scene, substep: float) -> tuple[dict[str, Any], float]:
    """The motion at up to CHECKPOINTS points of the scene's grid, inputs at zero, and the fastest rate seen."""
    unit, run = unit_of(scene), scene.run
    z = filled_buffer(scene, substep)
    initialize(scene, unit, z)
    steps = math.ceil((run.stop - run.start) / run.step * (1.0 - 1e-9))
    stride = math.ceil(steps / CHECKPOINTS)
    names = ("quaternion", "omega_b", "position", "velocity")
    rows: dict[str, list[Any]] = {n: [z[unit.BLOCKS[n]].copy()] for n in names}
    for k in range(0, steps, stride):
        status = unit.step(z, min(stride, steps - k) * run.step)
        for n in names:
            rows[n].append(z[unit.BLOCKS[n]].copy() if status == FINE else np.full_like(rows[n][0], np.nan))
        if status != FINE:
            break
    motion = {n: np.array(r + [np.full_like(r[0], np.nan)] * (0 if status == FINE else 1)) for n, r in rows.items()}
    fastest = float(np.max(np.linalg.norm(motion["omega_b"], axis=1)))
    return motion, fastest if math.isfinite(fastest) else math.inf
