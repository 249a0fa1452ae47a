"""The question that planning answers: what a scene asks, what varies, and the body at the start, each found once.

A question is made of a scene and passed on; who plans, judges or explains asks it and not the scene again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from rbfmu.models.model_buffer import put_scene, refusal
from rbfmu.scene.body import Body as SceneBody
from rbfmu.scene.scene import PARAMETERS, Scene
from rbfmu.scene.section import flattened
from rbfmu.types import Array, Buffer
from rbfmu_kernels.body import closed_form, fixed_axis, memory, outputs, principal
from rbfmu_kernels.buffer import places
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators import splitting
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.models import unturned
from rbfmu_kernels.quantities import FIXED_IN_SPACE, FORCES, IN_BUFFER_ORDER, OUTPUT, TORQUES, WEIGHTS
from rbfmu_kernels.rotations.vec3 import cross
from rbfmu_kernels.types import Vec3

T = TypeVar("T")
GROWING = {row.name for row in IN_BUFFER_ORDER if row.grows}
"""Loads and parameters with which positions, velocities, accelerations and energy grow."""
BLOCKS, SIZE = places(memory.COMMON)


@dataclass(frozen=True)
class Question:
    """What a scene asks of a model: quantities, an accuracy, and which inputs and parameters stay open.

    full: whether all degrees of freedom are to be integrated, whatever the outputs depend on.
    """

    scene: Scene
    full: bool = False

    @property
    def body(self) -> SceneBody:
        """Return the scene's body, which all have but those whose rates are prescribed."""
        assert self.scene.body is not None
        return self.scene.body

    @cached_property
    def start(self) -> "BodyAtStart":
        """Return the answers of the kernels about the body at the start."""
        return BodyAtStart(self.scene)

    # What is asked

    @property
    def accuracy(self) -> float:
        """Return the error that any quantity may have, rad or relative."""
        return self.scene.run.accuracy

    @property
    def span(self) -> float:
        """Return the length of the run, s."""
        return self.scene.run.stop - self.scene.run.start

    @cached_property
    def quantities(self) -> frozenset[str]:
        """Return the outputs asked for."""
        return frozenset(self.scene.outputs.quantities)

    @cached_property
    def judged(self) -> tuple[str, ...]:
        """Return blocks that show every quantity asked for, and what states of one's own these come of.

        Roll, pitch and yaw count as the attitude that they describe.
        """
        shown = self.scene.outputs
        known = dict.fromkeys(OUTPUT[name].judged_by or name for name in shown.quantities)
        known |= dict.fromkeys((*shown.own, *(f"when.{name}" for name in self.scene.events)))
        if not self.scene.states:
            return (*known,)
        from rbfmu.models.formulas import formulas_of  # which asks this module

        formulas = formulas_of(self.scene)
        return (*known, *(f"states.{name}" for name in (formulas.own_states if formulas else ())))

    # What varies

    @cached_property
    def varying(self) -> frozenset[str]:
        """Return the names of loads and parameters whose values are not known when the scene is planned."""
        return frozenset((*self.scene.inputs.ports, *self.scene.inputs.parameters))

    @property
    def pinned(self) -> tuple[str, ...]:
        """Return the parameters on whose values a pilot run or a comparison rests: all but those listed."""
        own = (*self.scene.constants, *(f"{name}_0" for name in self.scene.states))
        return tuple(name for name in (*PARAMETERS, *own) if name not in self.scene.inputs.parameters)

    # Degrees of freedom that the outputs depend on, by the kernels' own rules, and by what varies

    @cached_property
    def translation(self) -> bool:
        """Return whether the path is needed."""
        return self.start.needs_translation and not self.start.has_pivot

    @cached_property
    def rotation(self) -> bool:
        """Return whether the rates are needed."""
        return self.start.needs_rate or self._shows_attitude

    @cached_property
    def attitude(self) -> bool:
        """Return whether the attitude is needed: an output shows it, or a load fixed in space turns the body."""
        return self._shows_attitude or (self.rotation and bool(self.turning & FIXED_IN_SPACE))

    @property
    def _shows_attitude(self) -> bool:
        moved = self.translation or (not self.start.has_pivot and "acceleration" in self.quantities)
        return self.start.needs_attitude or (moved and bool(self.varying & {"r_oc_b", "force_b"}))

    # What acts

    @cached_property
    def acting(self) -> frozenset[str]:
        """Return the names of the known loads that are not zero."""
        loads = self.scene.loads
        return frozenset(name for name in type(loads).model_fields if any(flattened(getattr(loads, name))))

    @cached_property
    def turning(self) -> set[str]:
        """Return the names of loads that act, or may come to act, and then turn the body, and of the arm of these."""
        body, varying, acting = self.body, self.varying, self.acting | self.varying
        levers = acting & (WEIGHTS if body.pivot else FORCES)
        arm = any(body.r_oc_b) or "r_oc_b" in varying
        force = self.scene.loads.force_b
        if not varying & {"force_b", "r_oc_b"} and not any(interpreted(cross)(body.r_oc_b, force)):
            levers -= {"force_b"}
        return {*(acting & TORQUES), *(levers | {"r_oc_b"} if arm and levers else ())}

    @property
    def would_turn(self) -> set[str]:
        """Return the names of what would turn the body, or a force with it, if it came to act."""
        return self.turning | TORQUES | (FORCES - FIXED_IN_SPACE if self.translation else set())

    @property
    def shape(self) -> set[str]:
        """Return the names of the parameters that the moments about the centre of mass, or the pivot, follow from."""
        return {"inertia"} | ({"mass", "r_oc_b"} if self.body.pivot else set())

    @cached_property
    def load_shares(self) -> tuple[float, float]:
        """Return, as 0 or 1, whether loads may turn in b, and a force with a body whose path is asked for."""
        start, varying = self.start, self.varying
        levered = any(start.body.arm_b) and (any(start.loads.force_a) or "force_a" in varying)
        turned = levered or any(start.loads.torque_a) or "torque_a" in varying
        body_force = any(start.loads.force_b) or ("force_b" in varying and not start.has_pivot)
        return float(turned), float(body_force and start.needs_translation)


def _answer(predicate: Callable[[Any], T]) -> cached_property[T]:
    """Return what a kernel reads off the buffer of a `BodyAtStart`, run as plain Python."""
    return cached_property(lambda start: interpreted(predicate)(start.z))


class BodyAtStart:
    """A body at the start of the run, its ports at zero, asked in plain Python what models ask in compiled code.

    Whether a model serves a scene is decided by these answers, so that no model is compiled that is not chosen.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.z: Buffer = np.zeros(SIZE)
        put_scene(scene, BLOCKS, self.z)
        self.fault = interpreted(memory.initialize_body)(self.z) or interpreted(outputs.first_outputs)(self.z)
        """The fault for which every model refuses the body: a key of `buffer.FAULTS`, or 0."""

    def check(self) -> None:
        """Raise SceneError where every model refuses the body."""
        if self.fault:
            raise refusal(self.scene, self.fault, BLOCKS, self.z)

    # What the outputs need

    has_pivot = _answer(memory.has_pivot)
    """Whether o is fixed in space."""
    needs_translation = _answer(memory.needs_translation)
    """Whether an output needs the position or velocity."""
    needs_attitude = _answer(memory.needs_attitude)
    """Whether an output needs the attitude."""
    needs_rate = _answer(memory.needs_rate)
    """Whether an output needs the body's rate."""
    shows_loads = _answer(memory.shows_loads)
    """Whether an output changes at once when a load does."""

    @property
    def shows_more_than_momentum(self) -> bool:
        """Return whether an output does not follow from the angular momentum in a alone."""
        is_sphere = interpreted(principal.is_sphere)(self.body.inertia)
        return interpreted(memory.shows_more_than_momentum)(self.z, is_sphere)

    # What turns the body

    body = _answer(memory.body_of)
    """The body's constants in the equations of motion."""
    loads = _answer(memory.loads_of)
    """The loads on the body."""
    rotation = _answer(memory.rotation_of)
    """Attitude and rate."""
    begins_to_turn = _answer(unturned.begins_to_turn)
    """Whether an output that depends on the rotation would change."""
    has_torque = _answer(closed_form.has_torque)
    """Whether damping, a torque, or a force with an arm acts."""
    has_turning_torque = _answer(closed_form.has_turning_torque)
    """Whether a torque acts that depends on the motion or turns with the body."""
    is_driven = _answer(closed_form.is_driven)
    """Whether a torque acts, or a force that turns with the body on a path that an output shows."""
    has_unknown_load = _answer(memory.has_unknown_load)
    """Whether a load acts that models with a closed form do not know."""

    @property
    def is_damped(self) -> bool:
        """Return whether damping acts."""
        return any(self.body.damping_b)

    @property
    def keeps_its_rate(self) -> bool:
        """Return whether the rate stays as it is without a torque."""
        return interpreted(principal.keeps_its_rate)(self.z, self.rotation[1])

    @property
    def turns_path(self) -> bool:
        """Return whether a force that turns about the rate with the body bends a path that an output shows."""
        return interpreted(fixed_axis.turns_path)(self.z, self.rotation[1])

    @property
    def is_symmetric(self) -> bool:
        """Return whether two moments are equal."""
        return interpreted(splitting.is_symmetric_top)(self.body.inertia)

    @property
    def leaves_third_axis(self) -> bool:
        """Return whether the moments across an axis differ, or a torque or damping is not about that axis alone."""
        (q, _), (_, _, axes) = self.rotation, interpreted(principal.symmetric_frame)(self.body.inertia)
        return interpreted(unturned.leads_astray)(q, axes, self.body, self.loads)

    @cached_property
    def principal_axes(self) -> tuple[Array, Array]:
        """Return moments (3,), kg m2, about o with a pivot, else about the centre of mass, and R_bp (3, 3)."""
        assert self.scene.body is not None
        moments, R_bp = interpreted(inertia.principal_axes)(np.array(self.scene.body.M))  # type: ignore[arg-type]
        return np.array(moments), np.array(R_bp)

    # A body that turns about one axis

    @cached_property
    def axis(self) -> Vec3:
        """Return the principal axis of most of the rate, in b."""
        q, omega = self.rotation
        return interpreted(fixed_axis.main_axis)(q, omega, self.body, self.loads)

    @property
    def leaves_axis(self) -> bool:
        """Return whether anything turns the body about another axis."""
        q, omega = self.rotation
        return interpreted(fixed_axis.leaves_axis)(self.z, self.axis, q, omega, self.body, self.loads)

    @property
    def is_swung(self) -> bool:
        """Return whether forces fixed in space swing the body about the axis, by a torque that depends on its angle."""
        cosine, sine = interpreted(fixed_axis.swing)(self.z, self.axis)
        return cosine[0] != 0.0 or sine[0] != 0.0

    @property
    def is_driven_or_damped(self) -> bool:
        """Return whether anything else acts about the axis."""
        q, _ = self.rotation
        drive, damping = interpreted(fixed_axis.drive_and_damping_rate)(self.z, self.axis, q, self.body, self.loads)
        return drive != 0.0 or damping != 0.0
