"""How far two plans of one scene lie apart, in the quantities that the scene asks for."""

from rbfmu.models import Plan
from rbfmu.recording import Motion, begun, recorded, substeps_counted
from rbfmu.scene import Scene
from rbfmu.times import thinned_steps

MOST_STEPS = 4000
GOLDEN = 0.6180339887498949
"""Where a step is cut in two, so that a motion whose period is the step does not look like rest."""


def compared_steps(scene: Scene) -> list[float]:
    """The scene's communication steps, s (several at once where there are too many), each cut in two."""
    return [part * h for h in thinned_steps(scene, MOST_STEPS) for part in (GOLDEN, 1.0 - GOLDEN)]


def watched(scene: Scene) -> tuple[str, ...]:
    """Blocks that show every quantity asked for; roll, pitch and yaw count as the attitude that they describe."""
    return tuple(dict.fromkeys("quaternion" if q == "rpy" else q for q in scene.outputs.quantities))


def motion(scene: Scene, plan: Plan, steps: list[float], names: tuple[str, ...]) -> tuple[Motion, float]:
    """Blocks of the plan's unit over the run, its ports at zero, and the substeps counted, where they are."""
    z = begun(scene, plan, names)
    return recorded(plan.unit, z, steps, names), substeps_counted(plan.unit, z)
