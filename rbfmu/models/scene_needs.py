"""What a scene's outputs, and the loads that act or may come to act, make it necessary to model."""

from dataclasses import dataclass

from rbfmu.models.body_at_start import body_at_start
from rbfmu.scene.fields import flattened
from rbfmu.scene.scene import Loads, Scene
from rbfmu_kernels.compile.interpreted import interpreted
from rbfmu_kernels.quantities import FIXED_IN_SPACE, FORCES, IN_BUFFER_ORDER, TORQUES, WEIGHTS
from rbfmu_kernels.rotations.vec3 import cross

GROWING = {row.name for row in IN_BUFFER_ORDER if row.grows}
"""Loads and parameters with which positions, velocities, accelerations and energy grow."""


@dataclass(frozen=True)
class Needs:
    """Degrees of freedom that a scene's outputs depend on."""

    rotation: bool
    attitude: bool
    translation: bool

    @classmethod
    def of(cls, scene: Scene) -> "Needs":
        """Return the needs by the kernels' own rules, and by what ports and listed parameters may become."""
        start, varying = body_at_start(scene), varying_parameters(scene)
        free = not start.has_pivot
        translation = start.needs_translation and free
        watched = translation or (free and "acceleration" in scene.outputs.quantities)
        attitude = start.needs_attitude or (watched and bool(varying & {"r_oc_b", "force_b"}))
        rotation = start.needs_rate or attitude
        attitude = attitude or (rotation and bool(torques(scene) & FIXED_IN_SPACE))
        return cls(rotation, attitude, translation)


def varying_parameters(scene: Scene) -> set[str]:
    """Return the names of loads and parameters whose values are not known when the scene is planned."""
    return set(scene.inputs.ports) | set(scene.inputs.parameters)


def acting_loads(loads: Loads) -> set[str]:
    """Return the names of the known loads that are not zero."""
    return {name for name in type(loads).model_fields if any(flattened(getattr(loads, name)))}


def torques(scene: Scene) -> set[str]:
    """Return the names of loads that act, or may come to act, and then turn the body, and of the arm they act on."""
    body, loads, varying = scene.body, scene.loads, varying_parameters(scene)
    assert body is not None
    acting = acting_loads(loads) | varying
    levers = acting & (WEIGHTS if body.pivot else FORCES)
    arm = any(body.r_oc_b) or "r_oc_b" in varying
    if not varying & {"force_b", "r_oc_b"} and not any(interpreted(cross)(body.r_oc_b, loads.force_b)):
        levers -= {"force_b"}
    return acting & TORQUES | (levers | {"r_oc_b"} if arm and levers else set())


def turning_loads(scene: Scene, needs: Needs) -> set[str]:
    """Return the names of what would turn the body, or a force with it, if it came to act."""
    return torques(scene) | TORQUES | (FORCES - FIXED_IN_SPACE if needs.translation else set())


def shape(scene: Scene) -> set[str]:
    """Return the names of the parameters that the moments about the centre of mass, or the pivot, follow from."""
    assert scene.body is not None
    return {"inertia"} | ({"mass", "r_oc_b"} if scene.body.pivot else set())
