"""Numba kernels of one rigid body: scalar functions on floats and tuples, callable from anyone's `@njit` code.

Vectors are 3-tuples, quaternions 4-tuples (scalar first), matrices tuples of rows; Euler sequences are integer
constants: `euler_from_quaternion(ZYX, q_ab)`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# ruff: noqa: F403
if TYPE_CHECKING:
    from .exact.free_rotation import *
    from .mechanics.inertia import *
    from .mechanics.kinematics import *
    from .mechanics.newton_euler import *
    from .mechanics.spatial import *
    from .numerics.elementary import *
    from .rotations.euler_angles import *
    from .rotations.matrix import *
    from .rotations.quaternion import *
    from .rotations.rodrigues import *
    from .rotations.rotation_vector import *
    from .rotations.vec3 import *
    from .types import *

_MODULES = (
    "rotations.vec3", "rotations.matrix", "rotations.quaternion", "rotations.euler_angles",
    "rotations.rotation_vector", "mechanics.kinematics", "mechanics.inertia", "mechanics.newton_euler",
    "numerics.elementary", "types", "rotations.rodrigues", "mechanics.spatial", "exact.free_rotation",
)  # fmt: skip
"""The modules with public names, listed in their `__all__`; those seldom needed and slow to load are last."""


if not TYPE_CHECKING:  # otherwise a type checker would accept any name as the module's

    def __getattr__(name: str) -> Any:
        """Load modules until one has the name; `__all__` is that of all."""
        loaded = (import_module(f".{module}", __name__) for module in _MODULES)
        if name == "__all__":
            return sorted(public for module in loaded for public in module.__all__)
        found = None if name.startswith("__") else next((module for module in loaded if name in module.__all__), None)
        if found is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(found, name)
        return value

    def __dir__() -> list[str]:
        return [*globals(), *__getattr__("__all__")]
