"""What a communication step costs by a plan: the model's own, and what the outputs asked for add to it."""

from dataclasses import replace

from rbfmu.models.body_at_start import body_at_start
from rbfmu.models.registry import MODELS
from rbfmu.planning.methods import load_shares, serves_many_steps
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import OUTPUT

MACHINE = "an Intel Xeon of 2026"
"""The machine whose ns all costs are, in a compiled loop over the library's own models on one idle core."""
ATTITUDE, CHANGING, TURNING_LOADS, EVALUATED = "attitude", "changing", "loads that turn", "evaluated"
"""The terms of a model's own costs besides what each step costs; see `ModelSpec.costs`."""


def term(model: str, name: str) -> str:
    """Return the key of NS for a model's own cost."""
    return f"{model}, {name}" if name else model


NS = {
    **{term(spec.key, name): ns for spec in MODELS.values() for name, ns in spec.costs.items()},
    "path": 18.0,
    "accelerations": 18.0,
    "rpy": 37.0,
    "omega_a": 8.0,
    "angular_momentum_a": 8.0,
    "kinetic_energy": 3.0,
}
"""The costs, ns, by term, as `python -m examples.benchmarks.costs` prints them."""


def stated(scene: Scene, plan: Plan) -> Plan:
    """Return the plan with its cost a communication step, ns; its cost before is that of a step's substeps alone."""
    return replace(
        plan, cost=_share_of_substeps(scene, plan) * plan.cost + sum(NS[name] for name in terms(scene, plan))
    )


def _share_of_substeps(scene: Scene, plan: Plan) -> float:
    turns = plan.spec.substep_without_attitude == 1.0 or body_at_start(scene).needs_attitude
    return 1.0 if turns or any(load_shares(scene)) else plan.spec.substep_without_attitude


def terms(scene: Scene, plan: Plan) -> list[str]:
    """Return keys of NS: what a step of the plan does besides its substeps."""
    spec = plan.spec
    if spec.computes_all_outputs:
        return [spec.key]
    start, wanted, shares = body_at_start(scene), set(scene.outputs.quantities), load_shares(scene)
    evaluated = serves_many_steps(plan, shares)
    changing = start.needs_translation or start.shows_loads
    if CHANGING in spec.costs and not changing:
        return [spec.key]  # its outputs never change
    parts = {
        term(spec.key, CHANGING): changing,
        term(spec.key, ATTITUDE): start.needs_attitude,
        term(spec.key, TURNING_LOADS): any(shares) and not evaluated,
        "path": start.needs_translation and not start.has_pivot and not spec.integrates_path,
        "accelerations": start.shows_loads,
        **{name: name in wanted for name in OUTPUT},
    }
    own = term(spec.key, EVALUATED) if evaluated else spec.key
    return [own, *(name for name, asked in parts.items() if asked and name in NS)]
