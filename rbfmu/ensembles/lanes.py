"""Members of an ensemble side by side in the lanes of a vector, where their model knows how: the bits are the same."""

from typing import Any

import numpy as np
from numba import config

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu_kernels.compile.wide_arrays import widest
from rbfmu_kernels.models import loaded_taylor, loaded_taylor_lanes

AT_ONCE = 64
"""Members whose buffers are filled at a time: their part that is used lies in a processor's own cache."""
_CACHE_LINE = 8
"""The numbers in a cache line."""


def lanes_serve(kernels: Any) -> bool:
    """Return whether a model, given its module, knows how."""
    return kernels is loaded_taylor


def advance_lanes(
    kernels: Any, base: Any, places: Any, values: Any, steps: Any, kept: Any, rows: Any, ends: Any
) -> bool:
    """Do what `loops.run_members` does, with the same bits; return False, with nothing done, where lanes do not serve.

    kernels: the model's module; base (size,): its filled buffer. places (p,), values (m, p): what a member has of its
    own, and where. steps (n,): s. kept (K,): places of the outputs. rows (m, n + 1, K) or (m, 1, K): outputs at each
    point, or the last. ends (m, 2): what `initialize` returned, and the number of steps done.
    """
    if not lanes_serve(kernels) or config.DISABLE_JIT or len(values) < 2:
        return False
    count = min(AT_ONCE, len(values))
    size = -(-len(base) // _CACHE_LINE) * _CACHE_LINE
    buffers = aligned_zeros(count * size).reshape(count, size)[:, : len(base)]
    statuses = np.zeros(count, dtype=np.int64)
    run = loaded_taylor_lanes.run_in_eight if widest() == 8 else loaded_taylor_lanes.run_in_four
    scratch = aligned_zeros(loaded_taylor_lanes.SCRATCH)
    run(base, places, values, steps, kept, rows, ends, buffers, statuses, scratch)
    return True
