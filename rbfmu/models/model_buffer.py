"""A model's buffer, filled with a scene's numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rbfmu.scene.body import six_numbers
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Buffer
from rbfmu_kernels.body.memory import INPUTS
from rbfmu_kernels.buffer import FAULTS
from rbfmu_kernels.quantities import INITIAL_VALUES, LOADS, active_flags

_CACHE_LINE = 8
"""The numbers in a cache line."""


def aligned_zeros(size: int) -> Buffer:
    """Return zeros that begin at a cache line, as vectors that lie across two lines take longer."""
    z = np.zeros(size + _CACHE_LINE)
    start = -z.ctypes.data // z.itemsize % _CACHE_LINE
    return z[start : start + size]


def put_scene(scene: Scene, blocks: dict[str, slice], z: Buffer, settings: Mapping[str, float] | None = None) -> None:
    """Set the numbers of the scene, and the settings of a method, as far as a buffer has blocks for them."""
    for name, value in (_numbers(scene) | dict(settings or {})).items():
        if name in blocks:
            z[blocks[name]] = value


def refusal(scene: Scene, code: int, blocks: dict[str, slice], z: Buffer) -> SceneError:
    """Return the error for parameters that a model refuses; code: a key of `buffer.FAULTS`."""
    block, expected = FAULTS[code]
    named = f"{block} = {z[blocks[block]].tolist()}" if block in blocks else "parameters"
    return SceneError(f"{named}: {expected}", scene.name)


def _numbers(scene: Scene) -> dict[str, Any]:
    initial, loads = scene.initial, scene.loads
    numbers: dict[str, Any] = {
        **{load.block: getattr(loads, load.name) for load in LOADS},
        **{row.name: getattr(initial, row.name.removesuffix("_0")) for row in INITIAL_VALUES},
        "ports": [float(name in scene.inputs.ports) for name in INPUTS],
        "active": active_flags(scene.outputs.quantities),
    }
    numbers |= {f"constants.{name}": row.value for name, row in scene.constants.items()}
    numbers |= {f"states.{name}_0": row.start for name, row in scene.states.items()}
    numbers |= {name: port.start for name, port in scene.inputs.own.items()}
    numbers |= {"series.start_time": scene.run.start, "series.longest": scene.run.stop - scene.run.start}
    if scene.body is not None:
        numbers |= {
            "mass": scene.body.mass,
            "inertia": six_numbers(scene.body.M_c),
            "r_oc_b": scene.body.r_oc_b,
            "pivot": float(scene.body.pivot),
        }
    return numbers
