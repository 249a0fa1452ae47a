"""One rigid body, done right: rotations, Newton-Euler, scenes and their simulation.

Array functions by name (`rbfmu.rotate(q_ab, v_b)`), scenes (`load_scene`, `plan`, `simulate`). The same functions on
floats and tuples, for `@njit` code, are in `rbfmu_kernels`; co-simulation units in `rbfmu_fmu`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rbfmu.arrays import *  # noqa: F403
from rbfmu.arrays import __all__ as _ARRAY_FUNCTIONS

if TYPE_CHECKING:
    from rbfmu.planning import Plan, plan
    from rbfmu.scene import Body, Scene, SceneError, load_scene
    from rbfmu.simulation import Result, SimulationError, simulate

__version__ = "0.1.0"

_LAZY = {
    "Body": "scene", "Scene": "scene", "SceneError": "scene", "load_scene": "scene",
    "Plan": "planning", "plan": "planning",
    "Result": "simulation", "SimulationError": "simulation", "simulate": "simulation",
}  # fmt: skip
__all__ = [*_ARRAY_FUNCTIONS, *_LAZY]


def __getattr__(name: str) -> Any:
    """Scenes and their libraries load when first used: `import rbfmu` costs little more than `import numba`."""
    if name not in _LAZY:
        raise AttributeError(f"module 'rbfmu' has no attribute {name!r}")
    value = getattr(import_module(f"rbfmu.{_LAZY[name]}"), name)
    globals()[name] = value
    return value
