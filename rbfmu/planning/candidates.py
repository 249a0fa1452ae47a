"""Which models serve a scene exactly, whatever its ports supply and its listed parameters become."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rbfmu.planning.promises import conditioning_error
from rbfmu.runs.model_buffer import filled_buffer, initialize
from rbfmu.runs.models import MODELS, Plan
from rbfmu.scene.fields import flattened
from rbfmu.scene.scene import Loads, Scene
from rbfmu_kernels.body.memory import has_pivot
from rbfmu_kernels.body.needs import needs_attitude, needs_rate, needs_translation
from rbfmu_kernels.buffer import OK
from rbfmu_kernels.models import one_axis
from rbfmu_kernels.quantities import (
    ATTITUDE,
    DISSIPATIVE,
    FIXED_IN_SPACE,
    FORCES,
    IN_BUFFER_ORDER,
    LOADS_NOW,
    NOT_IN_CLOSED_FORMS,
    OUTPUTS,
    RATE,
    SPHERE_RATE,
    TORQUES,
    WEIGHTS,
    needing,
)
from rbfmu_kernels.rotations.vec3 import cross

CLOSED = (
    "no rotation", "constant rate", "angular momentum", "one axis", "undamped pendulum",
    "torque-free symmetric body", "symmetric body spun up", "torque-free body",
)  # fmt: skip
"""The models with a closed form, from the smallest."""
DROPPED = {
    **dict.fromkeys(CLOSED, NOT_IN_CLOSED_FORMS),
    "angular momentum": DISSIPATIVE | NOT_IN_CLOSED_FORMS,
    "undamped pendulum": TORQUES | NOT_IN_CLOSED_FORMS,
    **dict.fromkeys(("torque-free symmetric body", "torque-free body"), TORQUES | FORCES | WEIGHTS),
}
"""By model, the loads that do not turn it where they are too small to matter."""
OF_RATES, OF_ATTITUDE = needing(RATE), needing(ATTITUDE)
OF_INERTIA = {row.name for row in OUTPUTS if "inertia" in row.initially} - needing(LOADS_NOW)
"""Quantities that show them, whatever the loads."""
GROWING = {row.name for row in IN_BUFFER_ORDER if row.grows}
"""Loads and parameters with which positions, velocities, accelerations and energy grow."""


@dataclass(frozen=True)
class Needs:
    """What a scene's outputs, and what acts on them, make it necessary to model."""

    rotation: bool
    attitude: bool
    translation: bool

    @classmethod
    def of(cls, scene: Scene) -> "Needs":
        """By the kernels' own rules, and what ports and listed parameters may come to."""
        z = filled_buffer(scene, Plan("body under loads", "", 0))
        varying, free = varying_parameters(scene), not has_pivot(z)
        translation = bool(needs_translation(z)) and free
        watched = translation or (free and "acceleration" in scene.outputs.quantities)
        attitude = bool(needs_attitude(z)) or (watched and bool(varying & {"r_oc_b", "force_b"}))
        rotation = bool(needs_rate(z)) or attitude
        attitude = attitude or (rotation and bool(torques(scene) & FIXED_IN_SPACE))
        return cls(rotation, attitude, translation)


def varying_parameters(scene: Scene) -> set[str]:
    """Names of loads and parameters whose values are not known when the scene is planned."""
    return set(scene.inputs.ports) | set(scene.inputs.parameters)


def acting_loads(loads: Loads) -> set[str]:
    """Names of the known loads that are not zero."""
    return {name for name in type(loads).model_fields if any(flattened(getattr(loads, name)))}


def torques(scene: Scene) -> set[str]:
    """Names of the loads that act, or may come to act, and then turn the body; and of the arm that they act on."""
    body, loads, varying = scene.body, scene.loads, varying_parameters(scene)
    assert body is not None
    acting = acting_loads(loads) | varying
    levers = acting & (WEIGHTS if body.pivot else FORCES)
    arm = any(body.r_oc_b) or "r_oc_b" in varying
    if not varying & {"force_b", "r_oc_b"} and not any(cross(body.r_oc_b, loads.force_b)):
        levers -= {"force_b"}
    return acting & TORQUES | (levers | {"r_oc_b"} if arm and levers else set())


def rests_on(scene: Scene, needs: Needs) -> dict[str, set[str]]:
    """By model: what must not vary, or the model would not hold for every value."""
    body = scene.body
    assert body is not None
    twists = torques(scene) | TORQUES
    loads = twists | (FORCES - FIXED_IN_SPACE if needs.translation else set())
    turning = (loads | ({"r_oc_b"} if needs.translation else set())) - (TORQUES & FIXED_IN_SPACE)
    shape = {"inertia"} | ({"mass", "r_oc_b"} if body.pivot else set())
    a, b, c = (body.M[i][i] for i in range(3))
    sphere = a == b == c and not any(body.M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))
    start = {"quaternion_0", "omega_b_0"}
    return {
        "no rotation": (twists | start | shape) if needs.rotation else set(),
        "constant rate": loads | shape | (set() if sphere else {"omega_b_0"}),
        "angular momentum": turning | (shape if _shows_spin(scene) else set()),
        "one axis": loads | shape | start,
        "undamped pendulum": loads | shape | start,
        "one swinging axis": loads | shape | start,
        "torque-free symmetric body": loads | shape,
        "symmetric body spun up": loads | shape | ({"r_oc_b"} if needs.attitude else set()),
        "torque-free body": loads,
        "torque-free body, pushed": loads | shape | start | {"force_b", "mass"},
    }


def _shows_spin(scene: Scene) -> bool:
    """Whether a rate follows from the angular momentum."""
    return bool(needing(SPHERE_RATE) & set(scene.outputs.quantities))


def needed_parameters(scene: Scene, model: str) -> set[str]:
    """Names of the parameters on which an output depends in a model of the scene, or that are listed."""
    body, wanted, listed = scene.body, set(scene.outputs.quantities), set(scene.inputs.parameters)
    if body is None:
        return {"quaternion_0"}
    needs, ports = Needs.of(scene), set(scene.inputs.ports)
    beside = any(body.r_oc_b) or "r_oc_b" in listed
    moving = needs.translation or (not body.pivot and "acceleration" in wanted)
    angular = "alpha_b" in wanted or (moving and beside and "acceleration" in wanted)
    driven = needs.rotation and (angular or model not in ("no rotation", "constant rate"))
    twisting = torques(scene) - (set() if angular else DROPPED.get(model, set())) if driven else set()
    pushing = FORCES | WEIGHTS if moving else set()
    acting = acting_loads(scene.loads) & (twisting | pushing)
    names = listed | (acting - ports)
    if driven or wanted & OF_INERTIA:
        names |= {"inertia"}
        names |= {"mass"} if body.pivot and beside else set()
    turned = model != "no rotation" or wanted & {"position", "acceleration", "kinetic_energy"}
    swung = moving and beside and bool(turned)
    if needs.rotation and (swung or model != "no rotation" or wanted & OF_RATES):
        names |= {"omega_b_0"}
    pushed = moving and "force_b" in acting | ports | listed
    turning = twisting & FIXED_IN_SPACE
    if needs.attitude and (turning or swung or pushed or wanted & OF_ATTITUDE):
        names |= {"quaternion_0"}
    if needs.translation:
        names |= {"velocity_0"}
    if "position" in wanted:
        names |= {"position_0"}
    if (moving and (acting | ports | listed) & FORCES) or ("kinetic_energy" in wanted and moving):
        names |= {"mass"}
    if any(body.r_oc_b) and (swung or "r_oc_b" in twisting or (body.pivot and "inertia" in names)):
        names |= {"r_oc_b"}
    return names


def closed_forms(scene: Scene, needs: Needs) -> list[str]:
    """The models with a closed form that are exact for this scene, the smallest first."""
    needed, varying = rests_on(scene, needs), varying_parameters(scene)
    models = CLOSED[1:] if needs.attitude and any(scene.initial.omega_b) else CLOSED
    exact = [model for model in models if not needed[model] & varying and accepts(scene, model)]
    return [model for model in exact if conditioning_error(scene, model) <= 0.1 * scene.run.accuracy] or exact


def accepts(scene: Scene, model: str) -> bool:
    """Whether the model's own unit takes the scene's values."""
    return bool(MODELS[model].initialize(filled_buffer(scene, Plan(model, "", 0))) == OK)


def turning_axis(scene: Scene) -> NDArray[np.float64]:
    """The unit vector in b about which models of one angle turn the scene's body."""
    unit, z = one_axis, filled_buffer(scene, Plan("one axis", "", 0, held=("all",)))
    initialize(scene, unit, z)
    return z[unit.BLOCKS["axis"]]
