"""Which model with a closed form serves a scene exactly, and on which parameters the outputs of a model depend."""

from rbfmu.models.registry import CLOSED_FORMS, MODELS
from rbfmu.models.scene_needs import Needs, acting_loads, torques
from rbfmu.models.spec import ModelSpec
from rbfmu.scene.scene import Scene
from rbfmu_kernels.quantities import (
    ATTITUDE,
    FIXED_IN_SPACE,
    FORCES,
    LOADS_NOW,
    OUTPUTS,
    RATE,
    WEIGHTS,
    needing,
)

OF_RATES, OF_ATTITUDE = needing(RATE), needing(ATTITUDE)
OF_INERTIA = {row.name for row in OUTPUTS if "inertia" in row.initially} - needing(LOADS_NOW)
"""Quantities that depend on moments of inertia at the start, whatever the loads."""
CONDITIONED = 0.1
"""The part of the accuracy that a model may lose by its conditioning where another one serves as well."""


def exact_closed_form(scene: Scene, needs: Needs) -> ModelSpec | None:
    """Return the smallest model with a closed form that is exact for this scene, and well conditioned if any is."""
    exact = [spec for spec in CLOSED_FORMS if spec.serves(scene, needs)]
    good = (spec for spec in exact if spec.conditioning(scene) <= CONDITIONED * scene.run.accuracy)
    return next(good, exact[0] if exact else None)


def needed_parameters(scene: Scene, model: str) -> set[str]:
    """Return the names of the parameters that are listed, or on which an output depends in a model of the scene."""
    spec = MODELS[model]
    body, wanted, listed = scene.body, set(scene.outputs.quantities), set(scene.inputs.parameters)
    if body is None:
        return {"quaternion_0"}
    needs, ports = Needs.of(scene), set(scene.inputs.ports)
    beside = any(body.r_oc_b) or "r_oc_b" in listed
    moving = needs.translation or (not body.pivot and "acceleration" in wanted)
    angular = "alpha_b" in wanted or (moving and beside and "acceleration" in wanted)
    driven = needs.rotation and (angular or not spec.keeps_rate)
    turning = torques(scene) - (set() if angular else spec.drops) if driven else set()
    pushing = FORCES | WEIGHTS if moving else set()
    acting = acting_loads(scene.loads) & (turning | pushing)
    names = listed | (acting - ports)
    if driven or wanted & OF_INERTIA:
        names |= {"inertia"}
        names |= {"mass"} if body.pivot and beside else set()
    turned = not spec.stands_still or wanted & {"position", "acceleration", "kinetic_energy"}
    swung = moving and beside and bool(turned)
    if needs.rotation and (swung or not spec.stands_still or wanted & OF_RATES):
        names |= {"omega_b_0"}
    body_force = moving and "force_b" in acting | ports | listed
    if needs.attitude and (turning & FIXED_IN_SPACE or swung or body_force or wanted & OF_ATTITUDE):
        names |= {"quaternion_0"}
    if needs.translation:
        names |= {"velocity_0"}
    if "position" in wanted:
        names |= {"position_0"}
    if (moving and (acting | ports | listed) & FORCES) or ("kinetic_energy" in wanted and moving):
        names |= {"mass"}
    if any(body.r_oc_b) and (swung or "r_oc_b" in turning or (body.pivot and "inertia" in names)):
        names |= {"r_oc_b"}
    return names
