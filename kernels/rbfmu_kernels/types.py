"""Core types of kernels. A kernel's annotations are its shapes; array functions are made from them."""

from collections.abc import Callable
from typing import Any, NewType, Protocol, overload

import numpy as np
from numpy.typing import NDArray

__all__ = ["Matrix", "Quaternion", "Vec3"]

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Euler parameters (eta, eps_1, eps_2, eps_3): scalar first."""
Matrix = tuple[Vec3, Vec3, Vec3]
"""Rows: R[i][j] is row i, column j."""
Transform = tuple[Quaternion, Quaternion, Quaternion, Quaternion]
"""Rows of a homogeneous transform, of four numbers each: no quaternions, but the same type for Numba."""
Vec6 = tuple[float, float, float, float, float, float]
Matrix6 = tuple[Vec6, Vec6, Vec6, Vec6, Vec6, Vec6]
FreeRotationNumbers = NewType("FreeRotationNumbers", tuple[float, ...])
"""The constants of a free rotation, a flat tuple; a type of its own, so that no other tuple of floats has its shape."""
Array = NDArray[np.float64]
Indices = NDArray[np.int64]


Function = Callable[..., Any]
"""A kernel, or a function made from one; its own annotations name its arguments and results."""


def python_function(kernel: Function) -> Function:
    """Return the undecorated function of a kernel (the kernel itself where Numba's JIT is disabled)."""
    return getattr(kernel, "py_func", kernel)


class Buffer(Protocol):
    """Numbers in places from 0 on: an array of doubles, or of numbers of several bodies (`compile.simd`)."""

    @overload
    def __getitem__(self, i: int, /) -> float: ...
    @overload
    def __getitem__(self, i: slice, /) -> "Buffer": ...
    def __setitem__(self, i: int, value: float, /) -> None: ...


Shape = tuple[int, ...]
SHAPES: dict[object, Shape] = {
    float: (), bool: (), Vec3: (3,), Quaternion: (4,), Vec6: (6,), Matrix: (3, 3), Transform: (4, 4), Matrix6: (6, 6)
}  # fmt: skip
"""The core shape of an argument or a result by its annotation, such as (3, 3) for Matrix."""
