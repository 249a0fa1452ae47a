"""A co-simulation unit, its buffer filled with a scene's numbers, its start."""

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.body.memory import INPUTS
from rbfmu_kernels.buffer import FAULTS
from rbfmu_kernels.quantities import INITIAL_VALUES, LOADS, active_flags

if TYPE_CHECKING:
    from rbfmu.runs.models import Plan

Buffer = NDArray[np.float64]
_CACHE_LINE = 8
"""Numbers in one."""


class Model(Protocol):
    """A unit's module in `rbfmu_kernels`: the layout of its buffer and its three entry functions."""

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
    """Return zeros from a cache line's begin on: vectors that lie across two take longer."""
    z = np.zeros(size + _CACHE_LINE)
    start = -z.ctypes.data // z.itemsize % _CACHE_LINE
    return z[start : start + size]


def filled_buffer(scene: Scene, plan: "Plan") -> Buffer:
    """Return the buffer of the plan's unit before `initialize`: parameters and settings of the scene, inputs zero."""
    unit = plan.unit
    z = aligned_zeros(unit.SIZE)
    for name, value in _numbers(scene, plan).items():
        if name in unit.BLOCKS:
            z[unit.BLOCKS[name]] = value
    return z


def initialize(scene: Scene, unit: Model, z: Buffer) -> None:
    """Set state and outputs from the parameters; SceneError where the unit refuses them."""
    if code := unit.initialize(z):
        block, expected = FAULTS[code]
        known = block in unit.BLOCKS
        named = f"{block} = {z[unit.BLOCKS[block]].tolist()}" if known else "parameters"
        raise SceneError(f"{named}: {expected}", scene.name)


def output_block(scene: Scene, unit: Model) -> slice:
    """Return where the outputs that the scene asks for stand in the unit's buffer, and what lies between them."""
    blocks = [unit.BLOCKS[name] for name in scene.outputs.quantities]
    return slice(min(block.start for block in blocks), max(block.stop for block in blocks))


def _numbers(scene: Scene, plan: "Plan") -> dict[str, Any]:
    initial, loads = scene.initial, scene.loads
    numbers: dict[str, Any] = {
        **{load.block: getattr(loads, load.name) for load in LOADS},
        **{row.name: getattr(initial, row.name.removesuffix("_0")) for row in INITIAL_VALUES},
        "substep": plan.substep if math.isfinite(plan.substep) else 0.0,
        "tolerance": plan.tolerance,
        "span": plan.span,
        "order": plan.order,
        "skip_model_checks": float(bool(plan.held)),
        "ports": [float(name in scene.inputs.ports) for name in INPUTS],
        "active": active_flags(scene.outputs.quantities),
    }
    if scene.body is not None:
        M = scene.body.M_c
        numbers |= {
            "mass": scene.body.mass,
            "inertia": (M[0][0], M[1][1], M[2][2], M[0][1], M[0][2], M[1][2]),
            "r_oc_b": scene.body.r_oc_b,
            "pivot": float(scene.body.pivot),
        }
    return numbers
