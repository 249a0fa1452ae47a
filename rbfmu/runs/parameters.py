"""Parameters of a run by their names in FMUs, of which a plan may rest on the values."""

from typing import Any

from rbfmu.exceptions import SceneError
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import PARAMETERS, Scene
from rbfmu.scene.section import as_toml, fault
from rbfmu_kernels.quantities import IN_BUFFER_ORDER, INITIAL_VALUES, LOADS

KEYS = (
    {name: f"body.{name}" for name in PARAMETERS}
    | {load.name: f"loads.{load.name}" for load in LOADS}
    | {row.name: f"initial.{row.name.removesuffix('_0')}" for row in INITIAL_VALUES}
    | {"quaternion_0": "initial.attitude.quaternion"}
)
"""The scene's keys by the names of parameters."""
BLOCK_OF = {row.name: row.block for row in IN_BUFFER_ORDER}


def with_parameters(scene: Scene, planned: Plan, parameters: dict[str, Any]) -> Scene:
    """Return the scene with other values. Raises SceneError for an unknown name, or one on which the plan rests."""
    if not parameters:
        return scene
    own = scene.own_parameters
    keys = KEYS | {row.name: key for key, row in own.items()}
    block_of = BLOCK_OF | {row.name: row.block for row in own.values()}
    for name in parameters:
        if name not in keys or (scene.body is None and name != "quaternion_0"):
            whole = name.partition("[")[0]
            meant = next((key for key in (whole, f"{whole}_0") if key in keys and key != name), "")
            expected = f"{meant}, with all of its numbers" if meant else f"one of {', '.join(keys)}"
            raise SceneError(f"parameter {name!r}: expected {expected}", scene.name)
    changed = scene.replace({keys[name]: _plain(value) for name, value in parameters.items()})
    blocks, old, new = planned.kernels.BLOCKS, filled_buffer(scene, planned), filled_buffer(changed, planned)
    for name in parameters:
        place = blocks[block_of[name]]
        values = old[place].tolist()
        if name in planned.pinned and values != new[place].tolist():
            made_for = f"{as_toml(values if len(values) > 1 else values[0])}, for which the model was planned"
            expected = f"{made_for}; list {name!r} in inputs.parameters to vary it"
            raise SceneError(fault(name, parameters[name], expected), scene.name)
    return changed


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value
