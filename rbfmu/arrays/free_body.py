"""The array function of exact torque-free motion: one setup per body, however many times are asked for."""

import math
from typing import Any

import numpy as np

from rbfmu.arrays.argument_names import documented_by, in_order
from rbfmu.arrays.errors import clear_error
from rbfmu.arrays.from_kernel import array_function
from rbfmu_kernels.exact.free_rotation import free_rotation as _kernel
from rbfmu_kernels.exact.free_rotation import free_rotation_at, free_rotation_is_singular, free_rotation_setup

_impossible = "free_rotation: some of these moments are of no body (negative, infinite, or 0 beside two that differ)"
_one_time_per_body = array_function(_kernel, singular=free_rotation_is_singular, warning=_impossible)
_setup = array_function(free_rotation_setup, singular=free_rotation_is_singular, warning=_impossible)
_at = array_function(free_rotation_at)


@documented_by(_kernel)
def free_rotation(*args: Any, **kwargs: Any) -> Any:
    args, kwargs = in_order(_kernel, args, kwargs)
    try:
        if len(args) < 4 or np.ndim(args[3]) == 0 or not _times_exceed_bodies(*args[:4]):
            return _one_time_per_body(*args, **kwargs)
        return _at(_setup(*args[:3]), *args[3:], **kwargs)
    except (TypeError, ValueError) as error:
        raise clear_error(_kernel, args, kwargs, error) from None


def _times_exceed_bodies(moments: Any, q_0: Any, omega_b_0: Any, t: Any) -> bool:
    bodies = np.broadcast_shapes(*(np.shape(a)[:-1] for a in (moments, q_0, omega_b_0)))
    return math.prod(np.broadcast_shapes(bodies, np.shape(t))) > math.prod(bodies)
