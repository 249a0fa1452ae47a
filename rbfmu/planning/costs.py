"""What a communication step costs by a plan: the model's own, and what the outputs asked for add to it."""

from dataclasses import replace

from rbfmu.planning.fitting import load_shares
from rbfmu.runs.model_buffer import Buffer, filled_buffer, initialize
from rbfmu.runs.models import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body.memory import has_pivot
from rbfmu_kernels.body.needs import needs_attitude, needs_translation, shows_loads
from rbfmu_kernels.models import loaded_taylor
from rbfmu_kernels.quantities import OUTPUT

MACHINE = "an Intel Xeon of 2026"
"""Whose ns all costs are: one calm core, a compiled loop, the library's own units."""
NS = {
    "no rotation": 10.0,
    "no rotation, changing": 5.0,
    "constant rate": 43.0,
    "angular momentum": 35.0,
    "one axis": 57.0,
    "one axis, attitude": 40.0,
    "undamped pendulum": 57.0,
    "one swinging axis": 54.0,
    "prescribed rates": 96.0,
    "torque-free symmetric body": 46.0,
    "torque-free symmetric body, attitude": 14.0,
    "symmetric body spun up": 93.0,
    "torque-free body": 90.0,
    "torque-free body, pushed": 68.0,
    "symmetric top": 72.0,
    "body under loads, by series": 60.0,
    "series, loads that turn": 68.0,
    "path": 18.0,
    "accelerations": 18.0,
    "rpy": 37.0,
    "omega_a": 8.0,
    "angular_momentum_a": 8.0,
    "kinetic_energy": 3.0,
}
"""By term, as `python -m examples.benchmarks.costs` prints them."""
RATES_ALONE = 0.72
"""What a substep of series costs without the attitude, as a part of one with it."""
SERIES, TURNED = "body under loads, by series", "series, loads that turn"
INTEGRATED = ("symmetric top", SERIES)
"""Models whose path is part of their integration."""


def stated(scene: Scene, plan: Plan) -> Plan:
    """The plan with its cost a communication step, ns; its cost before: of a step's substeps alone."""
    found = terms(scene, plan)
    alone = plan.model == SERIES and TURNED not in found and not needs_attitude(filled_buffer(scene, plan))
    return replace(plan, cost=(RATES_ALONE if alone else 1.0) * plan.cost + sum(NS[term] for term in found))


def terms(scene: Scene, plan: Plan) -> list[str]:
    """Keys of NS: what a step of the plan does besides its substeps."""
    if plan.model == "prescribed rates":
        return [plan.model]  # all of its outputs are always computed
    wanted, z = set(scene.outputs.quantities), filled_buffer(scene, plan)
    if plan.model == "no rotation" and not needs_translation(z) and not shows_loads(z):
        return [plan.model]  # its outputs never change
    parts = {
        "no rotation, changing": plan.model == "no rotation",
        f"{plan.model}, attitude": needs_attitude(z),
        TURNED: plan.model == SERIES and _may_turn(scene, z),
        "path": needs_translation(z) and not has_pivot(z) and plan.model not in INTEGRATED,
        "accelerations": shows_loads(z),
        **{name: name in wanted for name in OUTPUT},
    }
    return [plan.model, *(name for name, asked in parts.items() if asked and name in NS)]


def _may_turn(scene: Scene, z: Buffer) -> bool:
    """Whether loads act, or may come to, that turn as the body sees them or push it as it turns."""
    initialize(scene, loaded_taylor, z)
    return any(load_shares(scene, z))
