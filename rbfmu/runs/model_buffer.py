"""A model's buffer, filled with a scene's numbers, and its start."""

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene.body import six_numbers
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.body.memory import INPUTS
from rbfmu_kernels.buffer import FAULTS
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import INITIAL_VALUES, LOADS, active_flags

if TYPE_CHECKING:
    from rbfmu.runs.plan import Plan

Buffer = NDArray[np.float64]
_CACHE_LINE = 8
"""The numbers in a cache line."""


class Model(Protocol):
    """A model's module in `rbfmu_kernels`: the layout of its buffer and its three entry functions."""

    __name__: str
    BLOCKS: dict[str, slice]
    SIZE: int

    def initialize(self, z: Any) -> int:
        """Return 0, or a key of `buffer.FAULTS`."""

    def step(self, z: Any, h: float) -> int:
        """Return `buffer.OK` or `buffer.STEP_REJECTED`."""

    def outputs(self, z: Any) -> int:
        """Refresh the outputs."""


def aligned_zeros(size: int) -> Buffer:
    """Return zeros that begin at a cache line, as vectors that lie across two lines take longer."""
    z = np.zeros(size + _CACHE_LINE)
    start = -z.ctypes.data // z.itemsize % _CACHE_LINE
    return z[start : start + size]


def filled_buffer(scene: Scene, plan: "Plan") -> Buffer:
    """Return the buffer of the plan's model before `initialize`: parameters and settings of the scene, inputs zero.

    Raises ValueError where the plan cannot be run.
    """
    plan.check()
    kernels = plan.kernels
    z = aligned_zeros(kernels.SIZE)
    put_scene(scene, kernels.BLOCKS, z)
    _put(_settings(plan), kernels.BLOCKS, z)
    return z


def put_scene(scene: Scene, blocks: dict[str, slice], z: Buffer) -> None:
    """Set the scene's numbers, as far as a buffer has blocks for them."""
    _put(_numbers(scene), blocks, z)


def _put(numbers: dict[str, Any], blocks: dict[str, slice], z: Buffer) -> None:
    for name, value in numbers.items():
        if name in blocks:
            z[blocks[name]] = value


def initialize(scene: Scene, kernels: Model, z: Buffer) -> None:
    """Set state and outputs from the parameters; raise SceneError where the model refuses them."""
    if code := tiered(kernels.initialize)(z):
        raise refusal(scene, code, kernels.BLOCKS, z)


def refusal(scene: Scene, code: int, blocks: dict[str, slice], z: Buffer) -> SceneError:
    """Return the error for parameters that a model refuses; code: a key of `buffer.FAULTS`."""
    block, expected = FAULTS[code]
    named = f"{block} = {z[blocks[block]].tolist()}" if block in blocks else "parameters"
    return SceneError(f"{named}: {expected}", scene.name)


def output_block(scene: Scene, kernels: Model) -> slice:
    """Return where the outputs that the scene asks for stand in the model's buffer, and what lies between them."""
    blocks = [kernels.BLOCKS[name] for name in scene.outputs.quantities]
    return slice(min(block.start for block in blocks), max(block.stop for block in blocks))


def _settings(plan: "Plan") -> dict[str, float]:
    return {
        "substep": plan.substep if math.isfinite(plan.substep) else 0.0,
        "tolerance": plan.tolerance,
        "span": plan.span,
        "order": plan.order,
        "skip_model_checks": float(bool(plan.pinned)),
    }


def _numbers(scene: Scene) -> dict[str, Any]:
    initial, loads = scene.initial, scene.loads
    numbers: dict[str, Any] = {
        **{load.block: getattr(loads, load.name) for load in LOADS},
        **{row.name: getattr(initial, row.name.removesuffix("_0")) for row in INITIAL_VALUES},
        "ports": [float(name in scene.inputs.ports) for name in INPUTS],
        "active": active_flags(scene.outputs.quantities),
    }
    if scene.body is not None:
        numbers |= {
            "mass": scene.body.mass,
            "inertia": six_numbers(scene.body.M_c),
            "r_oc_b": scene.body.r_oc_b,
            "pivot": float(scene.body.pivot),
        }
    return numbers
