"""The compiled loops of ensembles: members one after the other or in lanes, moments of what they gave, merged points.

They let go of the GIL, so that threads run side by side. A model's `initialize` and `step` are called by their
addresses: one loop serves all models, with the code that `simulate` calls. Lanes are those of a vector: some members
side by side, where their model knows how, with the same bits.
"""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from threading import Thread
from typing import Any

import numpy as np
from numba import config, float64, int64, njit, typeof, types

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu_kernels.compile.simd import widest
from rbfmu_kernels.compile.tiered import is_kept

_NUMBERS, _TABLE, _BLOCK = float64[::1], float64[:, ::1], float64[:, :, ::1]
_INDICES, _PAIRS = int64[::1], int64[:, ::1]
_INITIALIZE, _STEP = types.FunctionType(int64(_NUMBERS)), types.FunctionType(int64(_NUMBERS, float64))


@cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a loop of this module as machine code, kept on disk where that can be written."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return njit(_SIGNATURES[function], cache=True, **options)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder can be written
        return njit(_SIGNATURES[function], **options)(function)  # type: ignore[no-any-return]


def entries(model: Any) -> tuple[Any, Any]:
    """Return `initialize` and `step` of a model, compiled for `run_members`."""
    for kernel, arguments in ((model.initialize, (_NUMBERS,)), (model.step, (_NUMBERS, float64))):
        if hasattr(kernel, "compile"):  # not where the JIT is disabled
            kernel.compile(arguments)
    return model.initialize, model.step


def run_members(
    initialize: Any, step: Any, z: Any, base: Any, places: Any, values: Any, steps: Any, kept: Any, rows: Any, ends: Any
) -> int:
    """Run members by a model's `initialize` and `step`, one after the other.

    z, base (size,): the buffer to run in, and what it holds before a member's values (m, p) are put to places (p,).
    steps (n,): s. kept (K,): places of the outputs. rows (m, n + 1, K): outputs at each point; (m, 1, K): the last.
    ends (m, 2): what `initialize` returned, and the number of steps done.
    """
    size, points, width = len(base), rows.shape[1], len(kept)
    for i in range(len(values)):
        for j in range(size):
            z[j] = base[j]
        for j in range(len(places)):
            z[places[j]] = values[i, j]
        ends[i, 0] = initialize(z)
        ends[i, 1] = 0
        if ends[i, 0] == 0:
            for j in range(width):
                rows[i, 0, j] = z[kept[j]]
            for k in range(len(steps)):
                if step(z, steps[k]) != 0:
                    break
                ends[i, 1] = k + 1
                point = k + 1 if points > 1 else 0
                for j in range(width):
                    rows[i, point, j] = z[kept[j]]
    return 0


def add_moments(rows: Any, good: Any, pairs: Any, mean: Any, products: Any, before: int) -> int:
    """Add members (m, n, K) to mean (n, K) and to sums (n, P) of products of two deviations, by Welford's recurrence.

    good (g,): which of the rows; pairs (P, 2): columns of the products; before: how many members are in already.
    """
    count, width = before, rows.shape[2]
    for i in good:
        count += 1
        for t in range(rows.shape[1]):
            for p in range(len(pairs)):
                a, b = pairs[p, 0], pairs[p, 1]
                after = mean[t, b] + (rows[i, t, b] - mean[t, b]) / count
                products[t, p] += (rows[i, t, a] - mean[t, a]) * (rows[i, t, b] - after)
            for j in range(width):
                mean[t, j] += (rows[i, t, j] - mean[t, j]) / count
    return count


def merge_points(a: Any, weight_a: float, b: Any, weight_b: float, phase: float, out: Any) -> int:
    """Merge two tables of points, sorted along their rows, into fewer of equal weight.

    a (c, p), b (c, q): each point weighs weight_a or weight_b. Point r of out (c, o) is that at which the weight of all
    before it passes r + phase of o equal parts.
    """
    p, q, o = a.shape[1], b.shape[1], out.shape[1]
    part = (p * weight_a + q * weight_b) / o
    for c in range(out.shape[0]):
        i, j, passed, r = 0, 0, 0.0, 0
        while r < o and i + j < p + q:
            if j == q or (i < p and a[c, i] <= b[c, j]):
                value, passed, i = a[c, i], passed + weight_a, i + 1
            else:
                value, passed, j = b[c, j], passed + weight_b, j + 1
            while r < o and (passed > (r + phase) * part or i + j == p + q):
                out[c, r] = value
                r += 1
    return 0


_SIGNATURES: dict[Callable[..., Any], Any] = {
    run_members: int64(
        _INITIALIZE, _STEP, _NUMBERS, _NUMBERS, _INDICES, _TABLE, _NUMBERS, _INDICES, _BLOCK, int64[:, ::1]
    ),
    add_moments: int64(_BLOCK, _INDICES, _PAIRS, _TABLE, _TABLE, int64),
    merge_points: int64(_TABLE, float64, _TABLE, float64, float64, _TABLE),
}


AT_ONCE = 64
"""Members whose buffers are filled at a time: their part that is used lies in a processor's own cache."""
_CACHE_LINE = 8
"""The numbers in a cache line."""


def advance_lanes(
    kernels: Any, base: Any, places: Any, values: Any, steps: Any, kept: Any, rows: Any, ends: Any,
    compile_now: bool = True,
) -> bool:  # fmt: skip
    """Do what `loops.run_members` does, with the same bits; return False, with nothing done, where lanes do not serve.

    kernels: the model; base (size,): its filled buffer. places (p,), values (m, p): what a member has of its
    own, and where. steps (n,): s. kept (K,): places of the outputs. rows (m, n + 1, K) or (m, 1, K): outputs at each
    point, or the last. ends (m, 2): what `initialize` returned, and the number of steps done. compile_now: else lanes
    serve where their code is there already, or kept on disk.
    """
    if not kernels.lanes or config.DISABLE_JIT or len(values) < 2:
        return False
    (run, scratch), count = _lanes_of(kernels), min(AT_ONCE, len(values))
    given = base, places, values, steps, kept, rows, ends, _buffers(count, kernels), np.zeros(count, np.int64), scratch
    if not (compile_now or is_kept(run, *given)):
        return False
    run(*given)
    return True


def _lanes_of(kernels: Any) -> tuple[Any, Any]:
    """Return the function that runs members side by side, and its scratch space."""
    lanes = import_module(kernels.lanes)
    return lanes.run_in_eight if widest() == 8 else lanes.run_in_four, aligned_zeros(lanes.SCRATCH)


def _buffers(count: int, kernels: Any) -> Any:
    size = -(-kernels.SIZE // _CACHE_LINE) * _CACHE_LINE
    return aligned_zeros(count * size).reshape(count, size)[:, : kernels.SIZE]


_COMPILING: dict[Any, Thread] = {}


def compile_lanes(kernels: Any) -> Thread | None:
    """Compile lanes beside what else is done, once in a process; return the thread that does, None without lanes.

    A process that ends sooner waits for it: the code is kept for all that come.
    """
    if not kernels.lanes or config.DISABLE_JIT:
        return None
    run, _ = _lanes_of(kernels)
    if run not in _COMPILING:
        buffers = typeof(_buffers(2, kernels))
        signature = (_NUMBERS, _INDICES, _TABLE, _NUMBERS, _INDICES, _BLOCK, int64[:, ::1], buffers, _INDICES, _NUMBERS)
        _COMPILING[run] = Thread(target=run.compile, args=(signature,))
        _COMPILING[run].start()
    return _COMPILING[run]
