"""Which models serve a scene exactly, whatever its ports supply and its listed parameters become."""

from dataclasses import dataclass

from rbfmu.models import UNITS, Plan
from rbfmu.promises import conditioning_error
from rbfmu.scene import Scene
from rbfmu.unit import filled_buffer
from rbfmu_kernels.body_memory import has_pivot, moves, spins, turns
from rbfmu_kernels.layout import FINE

CLOSED = (
    "no rotation", "constant rate", "one axis", "undamped pendulum", "torque-free symmetric body",
    "symmetric body spun up", "torque-free body",
)  # fmt: skip
"""The models with a closed form, from the smallest."""


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
        translation = bool(moves(z)) and free
        watched = translation or (free and "acceleration" in scene.outputs.quantities)
        attitude = bool(turns(z)) or (watched and bool(varying & {"r_oc_b", "force_b"}))
        rotation = bool(spins(z)) or attitude
        attitude = attitude or (rotation and bool(torques(scene) & {"torque_a", "force_a", "gravity_a"}))
        return cls(rotation, attitude, translation)


def varying_parameters(scene: Scene) -> set[str]:
    """Names of loads and parameters whose values are not known when the scene is planned."""
    return set(scene.inputs.ports) | set(scene.inputs.parameters)


def torques(scene: Scene) -> set[str]:
    """Names of the loads that act, or may come to act, and then turn the body; and of the arm that they act on."""
    body, loads, varying = scene.body, scene.loads, varying_parameters(scene)
    assert body is not None
    acting = {n for n in type(loads).model_fields if any(getattr(loads, n))} | varying
    levers = acting & ({"gravity_a"} if body.pivot else {"force_a", "force_b"})
    arm = any(body.r_oc_b) or "r_oc_b" in varying
    return acting & {"torque_a", "torque_b", "damping_b"} | (levers | {"r_oc_b"} if arm and levers else set())


def rests_on(scene: Scene, needs: Needs) -> dict[str, set[str]]:
    """By model: what must not vary, or the model would not hold for every value."""
    body = scene.body
    assert body is not None
    twists = {"torque_a", "torque_b", "damping_b"} | torques(scene)
    loads = twists | ({"force_b"} if needs.translation else set())
    shape = {"inertia"} | ({"mass", "r_oc_b"} if body.pivot else set())
    a, b, c = (body.M[i][i] for i in range(3))
    sphere = a == b == c and not any(body.M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))
    start = {"quaternion_0", "omega_b_0"}
    return {
        "no rotation": (twists | start | shape) if needs.rotation else set(),
        "constant rate": loads | shape | (set() if sphere else {"omega_b_0"}),
        "one axis": loads | shape | start,
        "undamped pendulum": loads | shape | start,
        "one swinging axis": loads | shape | start,
        "torque-free symmetric body": loads | shape,
        "symmetric body spun up": loads | shape | ({"r_oc_b"} if needs.attitude else set()),
        "torque-free body": loads,
    }


def needed_parameters(scene: Scene, model: str) -> set[str]:
    """Names of the parameters that a model of the scene depends on, or that are listed; loads that are zero are not."""
    body, loads = scene.body, scene.loads
    if body is None:
        return {"quaternion_0"}
    needs, wanted, turning = Needs.of(scene), set(scene.outputs.quantities), torques(scene)
    moving = needs.translation or (not body.pivot and "acceleration" in wanted)
    pushing = {"gravity_a", "force_a", "force_b"} if moving else set()
    acting = {n for n in type(loads).model_fields if any(getattr(loads, n))} & (turning | pushing)
    names = set(scene.inputs.parameters) | (acting - set(scene.inputs.ports))
    if needs.rotation:
        names |= {"omega_b_0"}
        still = model in ("no rotation", "constant rate")
        names |= {"inertia"} if not still or wanted & {"angular_momentum_a", "kinetic_energy"} else set()
    if needs.attitude:
        names |= {"quaternion_0"}
    if needs.translation:
        names |= {"position_0", "velocity_0"}
    if body.pivot and "position" in wanted:
        names |= {"position_0"}
    forced = (turning | pushing) & (acting | set(scene.inputs.ports)) - {"gravity_a"}
    if (needs.rotation and body.pivot) or (moving and forced) or (not body.pivot and "kinetic_energy" in wanted):
        names |= {"mass"}
    if any(body.r_oc_b) and (moving or turning or body.pivot):
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
    return bool(UNITS[model].initialize(filled_buffer(scene, Plan(model, "", 0))) == FINE)
