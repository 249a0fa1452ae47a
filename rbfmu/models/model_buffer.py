"""A model's buffer, filled with a scene's numbers, and properties of a body that kernels find before any model runs."""

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from rbfmu.scene.body import principal_axes, six_numbers
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Buffer, Indices, Motion
from rbfmu_kernels.body import closed_form, memory, outputs, principal
from rbfmu_kernels.buffer import CHANGED, FAULTS, NO_OUTPUTS
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.integrators import splitting
from rbfmu_kernels.models import unturned
from rbfmu_kernels.quantities import INITIAL_VALUES, LOADS, active_flags

T = TypeVar("T")
BLOCKS, SIZE = memory.LAYOUT
"""The blocks that all models of a body have, and the count of their numbers."""
_CACHE_LINE = 8
"""The numbers in a cache line."""


def aligned_zeros(size: int) -> Buffer:
    """Return zeros (size,) that begin at a cache line, as vectors that cross two lines take longer."""
    z = np.zeros(size + _CACHE_LINE)
    start = -z.ctypes.data // z.itemsize % _CACHE_LINE
    return z[start : start + size]


def put_scene(scene: Scene, blocks: dict[str, slice], z: Buffer, settings: Mapping[str, float] | None = None) -> None:
    """Set the numbers of the scene, and the settings of a method, for which a buffer has blocks."""
    for name, value in (_numbers(scene) | dict(settings or {})).items():
        if name in blocks:
            z[blocks[name]] = value


def places_of(blocks: Mapping[str, slice], names: Iterable[str]) -> Indices:
    """Return the places (p,) in a buffer of the blocks named, one block after the other."""
    return np.array([place for name in names for place in range(blocks[name].start, blocks[name].stop)], np.int64)


def by_block(blocks: Mapping[str, slice], names: Collection[str], rows: Array) -> Motion:
    """Return rows (n, p) of numbers of the blocks named, split into (n, k) by block."""
    ends = np.cumsum([size_of_block(blocks[name]) for name in names])[:-1]
    return dict(zip(names, np.split(rows, ends, axis=1), strict=True))


def refusal(scene: Scene, code: int, blocks: dict[str, slice], z: Buffer) -> SceneError:
    """Return the error for a start that a model refuses; code: a key of `buffer.FAULTS`."""
    block, expected = FAULTS[code]
    if code == NO_OUTPUTS:
        places = {f"outputs.{name}": name for name in scene.outputs.own}
        places |= {f"events.{name}": f"when.{name}" for name in scene.events}
        own = [key for key, name in places.items() if not np.isfinite(z[blocks.get(name, slice(0))]).all()]
        block = " and ".join(own) or block
    named = f"{block} = {z[blocks[block]].tolist()}" if block in blocks else block.strip(CHANGED) or "parameters"
    return SceneError(f"{named}: {expected}", scene.name, code)


def _numbers(scene: Scene) -> dict[str, Any]:
    initial, loads = scene.initial, scene.loads
    numbers: dict[str, Any] = {
        **{load.block: getattr(loads, load.name) for load in LOADS},
        **{row.name: getattr(initial, row.name.removesuffix("_0")) for row in INITIAL_VALUES},
        "ports": [float(name in scene.inputs.ports) for name in memory.INPUTS],
        "active": active_flags(scene.outputs.quantities),
    }
    numbers |= {f"constants.{name}": row.value for name, row in scene.constants.items()}
    numbers |= {f"states.{name}_0": row.start for name, row in scene.states.items()}
    numbers |= {name: port.start for name, port in scene.inputs.own.items()}
    numbers |= {"series.start_time": scene.run.start, "series.longest": scene.run.stop - scene.run.start}
    if (body := scene.body) is not None:
        numbers |= {"mass": body.mass, "inertia": six_numbers(body.M_c), "r_oc_b": body.r_oc_b}
        numbers["pivot"] = float(body.pivot)
    return numbers


def _by_kernel(
    predicate: Callable[..., T], of: Callable[["BodyAtStart"], tuple[Any, ...]] = lambda start: (start.z,)
) -> cached_property[T]:
    """Return a kernel's value for a `BodyAtStart`, run as plain Python; of: returns the kernel's arguments."""
    return cached_property(lambda start: interpreted(predicate)(*of(start)))


class BodyAtStart:
    """A body at the start of the run, with ports at zero, and its properties by the kernels that models compile.

    The kernels run as plain Python here. Planning chooses a model by these properties, so that only the chosen model is
    compiled.
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

    # What the outputs depend on

    has_pivot = _by_kernel(memory.has_pivot)
    """Whether o is fixed in space."""
    needs_translation = _by_kernel(memory.needs_translation)
    """Whether an output needs the position or velocity."""
    needs_attitude = _by_kernel(memory.needs_attitude)
    """Whether an output needs the attitude."""
    needs_rate = _by_kernel(memory.needs_rate)
    """Whether an output needs the body's rate."""
    shows_loads = _by_kernel(memory.shows_loads)
    """Whether an output changes at once when a load does."""

    # What changes the rotation

    body = _by_kernel(memory.body_of)
    """The body's constants in the equations of motion."""
    loads = _by_kernel(memory.loads_of)
    """The loads on the body."""
    rotation = _by_kernel(memory.rotation_of)
    """Attitude and rate."""
    begins_to_turn = _by_kernel(unturned.begins_to_turn)
    """Whether an output that depends on the rotation will change."""
    has_torque = _by_kernel(closed_form.has_torque)
    """Whether damping, a torque, or a force with an arm acts."""
    has_turning_torque = _by_kernel(closed_form.has_turning_torque)
    """Whether a torque acts that depends on the motion or rotates with the body."""
    is_driven = _by_kernel(closed_form.is_driven)
    """Whether a torque acts, or a force that rotates with the body while an output shows the path."""
    has_unknown_load = _by_kernel(memory.has_unknown_load)
    """Whether a load acts that models with a closed form cannot represent."""

    is_sphere = _by_kernel(principal.is_sphere, lambda start: (start.body.inertia,))
    """Whether all moments are equal."""
    shows_more_than_momentum = _by_kernel(memory.shows_more_than_momentum, lambda start: (start.z, start.is_sphere))
    """Whether an output depends on more than the angular momentum in a."""
    keeps_its_rate = _by_kernel(principal.keeps_its_rate, lambda start: (start.z, start.rotation[1]))
    """Whether the rate is constant without a torque."""
    turns_path = _by_kernel(principal.turns_path, lambda start: (start.z, start.rotation[1]))
    """Whether a force changes its direction with the body's rotation, while an output shows the path."""
    is_symmetric = _by_kernel(splitting.is_symmetric_top, lambda start: (start.body.inertia,))
    """Whether two moments are equal."""
    symmetric_frame = _by_kernel(principal.symmetric_frame, lambda start: (start.body.inertia,))
    """For a body that counts as symmetric: the moment of two equal axes, that of the third axis, and the axes."""
    leaves_third_axis = _by_kernel(unturned.leads_astray, lambda start: (start.z, start.symmetric_frame[2]))
    """Whether those two moments differ, a load depends on the attitude or acts across the third axis, or damping is
    uneven."""

    @property
    def is_slender(self) -> bool:
        """Whether a body that counts as symmetric has no moment about its third axis, such as a beam."""
        return self.symmetric_frame[1] == 0.0

    @cached_property
    def principal_axes(self) -> tuple[Array, Array]:
        """Return ascending moments (3,), kg m2, about o with a pivot, else the centre of mass, and R_bp (3, 3)."""
        assert self.scene.body is not None
        moments, R_bp = principal_axes(self.scene.body.M)
        return np.array(moments), np.array(R_bp)

    # A body that turns about one axis

    axis = _by_kernel(principal.main_axis)
    """The principal axis, in b, with the largest part of the rate; at rest, of the angular acceleration."""
    leaves_axis = _by_kernel(principal.leaves_axis, lambda start: (start.z, start.axis))
    """Whether anything turns the body about another axis."""
    swing = _by_kernel(principal.swing, lambda start: (start.z, start.axis))
    """(A, B), rad/s2: forces fixed in space accelerate the angle about the axis by A cos(angle) + B sin(angle)."""
    drive_and_damping = _by_kernel(principal.drive_and_damping_rate, lambda start: (start.z, start.axis))
    """(P, d), rad/s2 and 1/s: torques, forces that rotate with the body, and damping add P - d rate."""


def size_of_block(block: slice) -> int:
    """Return how many numbers a block has."""
    return int(block.stop - block.start)
