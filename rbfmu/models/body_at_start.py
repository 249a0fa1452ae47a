"""A scene's body at the start of the run, asked in plain Python what the kernels' models ask in compiled code.

Whether a model serves a scene is decided by these answers, so that no model is compiled that is not chosen.
"""

from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rbfmu.models.model_buffer import Buffer, put_scene, refusal
from rbfmu.scene.scene import Scene
from rbfmu_kernels.body import closed_form, fixed_axis, memory, needs, outputs, principal, symmetry
from rbfmu_kernels.buffer import places
from rbfmu_kernels.compile.interpreted import interpreted
from rbfmu_kernels.integrators import splitting
from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads
from rbfmu_kernels.models import no_rotation, spin_up
from rbfmu_kernels.types import Quaternion, Vec3

BLOCKS, SIZE = places(memory.COMMON)


class BodyAtStart:
    """Answers about a scene with a body, its ports at zero."""

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

    @property
    def has_pivot(self) -> bool:
        """Return whether o is fixed in space."""
        return interpreted(memory.has_pivot)(self.z)

    @property
    def needs_translation(self) -> bool:
        """Return whether an output needs the position or velocity."""
        return interpreted(needs.needs_translation)(self.z)

    @property
    def needs_attitude(self) -> bool:
        """Return whether an output needs the attitude."""
        return interpreted(needs.needs_attitude)(self.z)

    @property
    def needs_rate(self) -> bool:
        """Return whether an output needs the body's rate."""
        return interpreted(needs.needs_rate)(self.z)

    @property
    def shows_loads(self) -> bool:
        """Return whether an output changes at once when a load does."""
        return interpreted(needs.shows_loads)(self.z)

    @property
    def shows_more_than_momentum(self) -> bool:
        """Return whether an output does not follow from the angular momentum in a alone."""
        is_sphere = interpreted(symmetry.is_sphere)(self.body.inertia)
        return interpreted(needs.shows_more_than_momentum)(self.z, is_sphere)

    # What turns the body

    @cached_property
    def body(self) -> Body:
        """Return the body's constants in the equations of motion."""
        return interpreted(memory.body_of)(self.z)

    @cached_property
    def loads(self) -> Loads:
        """Return the loads on the body."""
        return interpreted(memory.loads_of)(self.z)

    @property
    def begins_to_turn(self) -> bool:
        """Return whether an output that depends on the rotation would change."""
        return interpreted(no_rotation.begins_to_turn)(self.z)

    @property
    def has_torque(self) -> bool:
        """Return whether damping, a torque, or a force with an arm acts."""
        return interpreted(closed_form.has_torque)(self.z)

    @property
    def has_turning_torque(self) -> bool:
        """Return whether a torque acts that depends on the motion or turns with the body."""
        return interpreted(closed_form.has_turning_torque)(self.z)

    @property
    def is_driven(self) -> bool:
        """Return whether a torque acts, or a force that turns with the body on a path that an output shows."""
        return interpreted(closed_form.is_driven)(self.z)

    @property
    def is_damped(self) -> bool:
        """Return whether damping acts."""
        return any(self.body.damping_b)

    @property
    def keeps_its_rate(self) -> bool:
        """Return whether the rate stays as it is without a torque."""
        return interpreted(principal.keeps_its_rate)(self.z, self._rotation[1])

    @property
    def turns_path(self) -> bool:
        """Return whether a force that turns about the rate with the body bends a path that an output shows."""
        return interpreted(fixed_axis.turns_path)(self.z, self._rotation[1])

    @property
    def is_symmetric(self) -> bool:
        """Return whether two moments are equal."""
        return interpreted(splitting.is_symmetric_top)(self.body.inertia)

    @property
    def has_unknown_load(self) -> bool:
        """Return whether a load acts that models with a closed form do not know."""
        return interpreted(needs.has_unknown_load)(self.z)

    @property
    def leaves_third_axis(self) -> bool:
        """Return whether the moments across an axis differ, or a torque or damping is not about that axis alone."""
        (q, _), (_, _, axes) = self._rotation, interpreted(symmetry.symmetric_frame)(self.body.inertia)
        return interpreted(spin_up.leads_astray)(q, axes, self.body, self.loads)

    @cached_property
    def principal_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return moments (3,), kg m2, about o with a pivot, else about the centre of mass, and R_bp (3, 3)."""
        assert self.scene.body is not None
        moments, R_bp = interpreted(inertia.principal_axes)(np.array(self.scene.body.M))  # type: ignore[arg-type]
        return np.array(moments), np.array(R_bp)

    # A body that turns about one axis

    @cached_property
    def axis(self) -> Vec3:
        """Return the principal axis of most of the rate, in b."""
        q, omega = self._rotation
        return interpreted(fixed_axis.main_axis)(q, omega, self.body, self.loads)

    @property
    def leaves_axis(self) -> bool:
        """Return whether anything turns the body about another axis."""
        q, omega = self._rotation
        return interpreted(fixed_axis.leaves_axis)(self.z, self.axis, q, omega, self.body, self.loads)

    @property
    def is_swung(self) -> bool:
        """Return whether forces fixed in space swing the body about the axis, by a torque that depends on its angle."""
        cosine, sine = interpreted(fixed_axis.swing)(self.z, self.axis)
        return cosine[0] != 0.0 or sine[0] != 0.0

    @property
    def is_driven_or_damped(self) -> bool:
        """Return whether anything else acts about the axis."""
        q, _ = self._rotation
        drive, damping = interpreted(fixed_axis.drive_and_damping_rate)(self.z, self.axis, q, self.body, self.loads)
        return drive != 0.0 or damping != 0.0

    @property
    def _rotation(self) -> tuple[Quaternion, Vec3]:
        return interpreted(memory.rotation_of)(self.z)


@lru_cache(maxsize=8)
def body_at_start(scene: Scene) -> BodyAtStart:
    """Return the answers about a scene, the same object as long as they are asked of one scene."""
    return BodyAtStart(scene)
