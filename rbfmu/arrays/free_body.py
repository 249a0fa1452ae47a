"""The array function of exact torque-free motion: one setup per body, however many times are asked for.

Several times of many bodies are computed for some bodies at once, in the lanes of a vector, to the same bits.
"""

import math
from typing import Any

import numpy as np
from numba import config
from numpy.typing import ArrayLike

from rbfmu.arrays.from_kernel import array_function, clear_error, documented_by, in_order, warn_of_singular
from rbfmu.types import Array
from rbfmu_kernels.compile.simd import widest
from rbfmu_kernels.exact.free_rotation import (
    SCRATCH,
    free_rotation_at,
    free_rotation_is_singular,
    free_rotation_setup,
    free_rotations_in_eight,
    free_rotations_in_four,
)
from rbfmu_kernels.exact.free_rotation import free_rotation as _kernel
from rbfmu_kernels.types import Shape

_FEW = 8
"""Bodies from which on lanes pay."""
_impossible = "free_rotation: some of these moments are of no body (negative, infinite, or 0 beside two that differ)"
_one_time_per_body = array_function(_kernel, singular=free_rotation_is_singular, warning=_impossible)
_setup = array_function(free_rotation_setup, singular=free_rotation_is_singular, warning=_impossible)
_at = array_function(free_rotation_at)


@documented_by(_kernel)
def free_rotation(*args: Any, **kwargs: Any) -> Any:
    args, kwargs = in_order(_kernel, args, kwargs)
    try:
        if not kwargs and (found := _in_lanes(*args)):
            return found
        if len(args) < 4 or np.ndim(args[3]) == 0 or not _times_exceed_bodies(*args[:4]):
            return _one_time_per_body(*args, **kwargs)
        return _at(_setup(*args[:3]), *args[3:], **kwargs)
    except (TypeError, ValueError) as error:
        raise clear_error(_kernel, args, kwargs, error) from None


def _times_exceed_bodies(moments: ArrayLike, q_0: ArrayLike, omega_b_0: ArrayLike, t: ArrayLike) -> bool:
    bodies = np.broadcast_shapes(*(np.shape(a)[:-1] for a in (moments, q_0, omega_b_0)))
    return math.prod(np.broadcast_shapes(bodies, np.shape(t))) > math.prod(bodies)


def _in_lanes(*args: ArrayLike) -> tuple[Array, Array] | None:
    """Return the motions (..., n, 4) and (..., n, 3) of bodies (..., 1) at n times; None where they are not such."""
    arrays = [np.asarray(a) for a in args]
    if config.DISABLE_JIT or len(arrays) != 4 or any(a.dtype.kind not in "iuf" for a in arrays):
        return None
    if any(a.shape[-1:] != (n,) for a, n in zip(arrays, (3, 4, 3), strict=False)):
        return None
    bodies, t = np.broadcast_shapes(*(a.shape[:-1] for a in arrays[:3])), arrays[3]
    shape = np.broadcast_shapes(bodies, t.shape)
    if bodies[-1:] != (1,) or len(shape) != len(bodies) or math.prod(bodies) < _FEW or shape[-1:] < (2,):
        return None
    moments, q_0, omega_b_0 = (_flat(a, (*shape[:-1], 1, a.shape[-1]), a.shape[-1]) for a in arrays[:3])
    t = _flat(t, t.shape if math.prod(t.shape) == shape[-1] else shape, shape[-1])
    q, omega = np.empty((len(moments), t.shape[-1], 4)), np.empty((len(moments), t.shape[-1], 3))
    motions = free_rotations_in_eight if widest() == 8 else free_rotations_in_four
    if motions(moments, q_0, omega_b_0, t, np.zeros(SCRATCH), q, omega):
        warn_of_singular(_impossible)
    return q.reshape(*shape, 4), omega.reshape(*shape, 3)


def _flat(a: Array, shape: Shape, width: int) -> Array:
    """Return an array broadcast to a shape as rows of `width` numbers."""
    rows = np.broadcast_to(a, shape).reshape(-1, width)
    return np.require(rows, float, ("C", "W"))
