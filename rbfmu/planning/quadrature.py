"""The quadrature of least work for the path of a body that turns without torque, under a force fixed in b."""

import math
from dataclasses import replace

from rbfmu.models.scene_needs import GROWING, varying_parameters
from rbfmu.planning.judge import Judge
from rbfmu.planning.reasons import why_quadrature
from rbfmu.runs.plan import Plan
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.scene import Scene
from rbfmu_kernels.models.free_body_force import ORDERS

POINT_COST = 86.0
"""The cost of a point, ns, on `costs.MACHINE`."""
EXACT = 1e-14
MAX_TRIALS = 6
MAX_PANELS, MAX_POINTS = 1e6, 2e7
"""The most panels of a communication step, and points of a whole trial, some two seconds of work."""


def cheapest_quadrature(scene: Scene, general: Plan, judge: Judge) -> Plan | None:
    """Return the cheapest points of Gauss's rule and panels a communication step; None where they miss the accuracy.

    Panels are no longer in other communication steps, so that their error is no larger either.
    """
    grows = bool(varying_parameters(scene) & GROWING)
    if grows and "kinetic_energy" in judge.names:
        return None
    kept = EXACT + general.spec.conditioning(scene)
    bound = scene.run.accuracy / 3.0 - kept
    best: Plan | None = None
    for order in ORDERS:
        panels = 1
        for _ in range(MAX_TRIALS):
            cost = POINT_COST * order * panels
            if best and cost >= best.cost:
                break
            trial = _trial(scene, general, order, scene.run.step / panels)
            error, _ = judge.try_out(trial, absolute=grows)
            if error <= bound:
                best = replace(trial, error=error + kept, cost=cost)
                break
            ratio = (error / bound) ** (0.5 / order) if bound > 0.0 else math.inf
            if not ratio * panels < MAX_PANELS:
                break
            panels = max(panels + 1, math.ceil(ratio * panels))
            if panels * order * communication_steps(scene) > MAX_POINTS:
                break
    return replace(best, reasons=why_quadrature(scene, best)) if best else None


def _trial(scene: Scene, general: Plan, order: int, panel: float) -> Plan:
    method = f"elliptic functions, Gauss's rule of {order} point{'s' if order > 1 else ''}"
    return replace(general, method=method, order=order, substep=panel)
