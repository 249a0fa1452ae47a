"""The question that planning answers: what a scene asks, what varies, and the body at the start, each worked out once.

A question is made from a scene and passed on: planning, judging and explaining use it instead of the scene.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.scene.scene import PARAMETERS, Body, Scene
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.quantities import FIXED_IN_SPACE, FORCES, IN_BUFFER_ORDER, OUTPUT, TORQUES, WEIGHTS
from rbfmu_kernels.rotations.vec3 import cross

if TYPE_CHECKING:
    from rbfmu.models.formulas import FormulaModel

GROWING = {row.name for row in IN_BUFFER_ORDER if row.grows}
"""Loads and parameters with which positions, velocities, accelerations and energy grow."""


@dataclass(frozen=True)
class Question:
    """What a scene asks of a model: quantities, an accuracy, and which inputs and parameters may vary."""

    scene: Scene

    @property
    def body(self) -> Body:
        """Return the scene's body; only scenes with prescribed rates have none."""
        assert self.scene.body is not None
        return self.scene.body

    @cached_property
    def start(self) -> BodyAtStart:
        """Return the properties of the body at the start, by the kernels."""
        return BodyAtStart(self.scene)

    @cached_property
    def formulas(self) -> "FormulaModel | None":
        """Return the model of the scene's formulas, or None if it has none."""
        if not self.scene.has_formulas:
            return None
        from rbfmu.models.formulas import equations_of  # only if needed, as it loads slowly

        return equations_of(self.scene)

    # What is asked

    @property
    def accuracy(self) -> float:
        """Return the largest error that any quantity may have, rad or relative."""
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
        """Return the blocks whose errors count: all quantities asked for, and the own states that these depend on.

        Roll, pitch and yaw are judged by the attitude.
        """
        shown = self.scene.outputs
        known = dict.fromkeys(OUTPUT[name].judged_by or name for name in shown.quantities)
        known |= dict.fromkeys((*shown.own, *(f"when.{name}" for name in self.scene.events)))
        read = self.formulas.own_states if self.scene.states and self.formulas else ()
        return (*known, *(f"states.{name}" for name in read))

    # What varies

    @cached_property
    def varying(self) -> frozenset[str]:
        """Return the names of loads and parameters whose values are not known when the scene is planned."""
        return frozenset((*self.scene.inputs.ports, *self.scene.inputs.parameters))

    @property
    def pinned(self) -> tuple[str, ...]:
        """Return the parameters on whose values a pilot run or a comparison depends: all that are not listed."""
        own = (*self.scene.constants, *(f"{name}_0" for name in self.scene.states))
        return tuple(name for name in (*PARAMETERS, *own) if name not in self.scene.inputs.parameters)

    # Degrees of freedom on which the outputs depend, by the kernels' own rules and by what varies

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

    # Loads

    @cached_property
    def acting(self) -> frozenset[str]:
        """Return the names of the known loads that are not zero."""
        return frozenset(name for name, size in self.scene.loads.sizes.items() if size > 0.0)

    @cached_property
    def turning(self) -> set[str]:
        """Return the names of loads that turn the body, or may do so if they vary, and "r_oc_b" if forces do."""
        body, varying, acting = self.body, self.varying, self.acting | self.varying
        levers = acting & (WEIGHTS if body.pivot else FORCES)
        arm = any(body.r_oc_b) or "r_oc_b" in varying
        if not varying & {"force_b", "r_oc_b"} and not any(interpreted(cross)(body.r_oc_b, self.scene.loads.force_b)):
            levers -= {"force_b"}
        return {*(acting & TORQUES), *(levers | {"r_oc_b"} if arm and levers else ())}

    @property
    def would_turn(self) -> set[str]:
        """Return the names of loads that would turn the body, or rotate with it on a needed path, if they acted."""
        return self.turning | TORQUES | (FORCES - FIXED_IN_SPACE if self.translation else set())

    @property
    def shape(self) -> set[str]:
        """Return the names of the parameters that determine the moments about the centre of mass, or the pivot."""
        return {"inertia"} | ({"mass", "r_oc_b"} if self.body.pivot else set())

    @cached_property
    def load_shares(self) -> tuple[float, float]:
        """Return, each as 0 or 1, whether loads may rotate in b, and whether a force in b may act on a needed path."""
        start, varying = self.start, self.varying
        levered = any(start.body.arm_b) and (any(start.loads.force_a) or "force_a" in varying)
        turned = levered or any(start.loads.torque_a) or "torque_a" in varying
        body_force = any(start.loads.force_b) or ("force_b" in varying and not start.has_pivot)
        return float(turned), float(body_force and start.needs_translation)
