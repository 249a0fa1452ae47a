"""The compiled loops of ensembles: members one after the other or in lanes, and moments of what they gave.

They let go of the GIL, so that threads run side by side. A model's `initialize` and `step` are called by their
addresses: one loop serves all models, with the code that `simulate` calls. Lanes are those of a vector: some members
side by side, where their model knows how, with the same bits.
"""

import math
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
from rbfmu_kernels.numerics.elementary import sincos

_NUMBERS, _TABLE, _BLOCK = float64[::1], float64[:, ::1], float64[:, :, ::1]
_INDICES, _PAIRS = int64[::1], int64[:, ::1]
CONTROLLED = (float64, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
"""The types of a controller's arguments."""
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
    initialize: Any, step: Any, z: Any, base: Any, places: Any, values: Any, steps: Any, kept: Any, rows: Any,
    ends: Any, after: Any, noted: Any,
) -> int:  # fmt: skip
    """Run members by a model's `initialize` and `step`, one after the other.

    z, base (size,): the buffer to run in, and what it holds before a member's values (m, p) are put to places (p,).
    steps (n,): s. kept (K,): places of the outputs. rows (m, n + 1, K): outputs at each point; (m, 1, K): the last.
    ends (m, 2): what `initialize` returned, and the number of steps done. noted (m, E): what stands at the places after
    (E,) when a member's run is over.
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
        for j in range(len(after)):
            noted[i, j] = z[after[j]]
    return 0


def hold(t: float, outputs: Any, state: Any, inputs: Any, noise: Any) -> None:
    """Leave the inputs of members that no controller has as they are."""


def run_driven(
    initialize: Any, step: Any, control: Any, z: Any, base: Any, places: Any, values: Any, kept: Any, rows: Any,
    ends: Any, after: Any, noted: Any, ports: Any, rates: Any, time: Any, lengths: Any, counts: Any, given: Any,
    slopes: Any, start: Any, noise: Any,
) -> int:  # fmt: skip
    """Run members as `run_members` does, their ports driven by tables, and by a controller after these.

    ports (P,): their places. rates (P or 0,): those of their derivatives. time (n + 1,): the communication points, s.
    lengths (L,): s, of pieces of the run in which inputs are held, or linear with slopes (L, P); given (L, P): those of
    tables, NaN where there are none. counts (1 or m, n + 1): how many pieces lie before each point. start (k,): state
    of the controller. noise (m, n, q). Where an input is not finite, ends[i, 0] is -1 - its place among the ports.
    """
    steps, points, width = len(time) - 1, rows.shape[1], len(kept)
    outputs, inputs, state = np.empty(width), np.empty(len(ports)), np.empty(len(start))
    for i in range(len(values)):
        pieces, k = counts[min(i, len(counts) - 1)], 0
        z[:] = base
        for j in range(len(places)):
            z[places[j]] = values[i, j]
        for j in range(len(ports)):
            if not math.isnan(given[pieces[0], j]):
                z[ports[j]] = given[pieces[0], j]
        state[:] = start
        ends[i, 0] = initialize(z)
        fine = ends[i, 0] == 0
        while fine:
            if points > 1 or k == steps:
                for j in range(width):
                    rows[i, k if points > 1 else 0, j] = z[kept[j]]
            ends[i, 1] = k
            if k == steps:
                break
            for piece in range(pieces[k], pieces[k + 1]):
                for j in range(len(ports)):
                    inputs[j] = z[ports[j]] if math.isnan(given[piece, j]) else given[piece, j]
                if piece == pieces[k]:
                    for j in range(width):
                        outputs[j] = z[kept[j]]
                    control(time[k], outputs, state, inputs, noise[i, k])
                for j in range(len(ports)):
                    z[ports[j]] = inputs[j]
                    if len(rates):
                        z[rates[j]] = slopes[piece, j]
                    if fine and not math.isfinite(inputs[j]):
                        ends[i, 0], fine = -1 - j, False
                fine = fine and step(z, lengths[piece]) == 0
            k += 1
        for j in range(len(after)):
            noted[i, j] = z[after[j]]
    return 0


LANES, ROWS = 16, 8
"""Sums that are added up side by side, in an order that no processor changes; members that are read side by side."""


def moments(rows: Any, good: Any, first: int, angles: Any, pairs: Any, mean: Any, products: Any, x: Any) -> int:
    """Set the means (t, W) of members at t times and the sums (t, P) of products of two deviations from them.

    rows (m, n, K); good (g,): which of them; first: of the times. angles (a,): columns of which sine and cosine are
    taken as well; W = K + 2 a. pairs (P, 2): columns of the products. x (t W, more than g): the numbers of the good
    members, each column a row.
    """
    count, own, width = len(good), rows.shape[2], mean.shape[1]
    whole = count - count % LANES
    sums, starts = np.empty(LANES), np.empty(ROWS, np.uint64)
    flat, size = rows.reshape(rows.size), rows.shape[1] * own
    for begin in range(0, count, ROWS):  # so many rows at a time: what is read and written lies side by side
        for i in range(ROWS):  # beyond the last member it is once more that one
            starts[i] = np.uint64(good[min(begin + i, count - 1)] * size + first * own)
        for t in range(len(mean)):
            for j in range(own):
                row, place = x[t * width + j], np.uint64(t * own + j)
                for i in range(ROWS):
                    row[begin + i] = flat[starts[i] + place] + 0.0  # sorting leaves no order to -0 and 0
    for t in range(len(mean)):
        for j in range(len(angles)):
            for i in range(count):
                sine, cosine = sincos(x[t * width + angles[j], i])
                x[t * width + own + 2 * j, i], x[t * width + own + 2 * j + 1, i] = sine, cosine
        for j in range(width):
            row = x[t * width + j]
            sums[:] = 0.0
            for i in range(0, whole, LANES):
                for k in range(LANES):
                    sums[k] += row[i + k]
            total = 0.0
            for k in range(LANES):
                total += sums[k]
            for i in range(whole, count):
                total += row[i]
            mean[t, j] = total / max(count, 1)
        for p in range(len(pairs)):
            a, b = x[t * width + pairs[p, 0]], x[t * width + pairs[p, 1]]
            mean_a, mean_b = mean[t, pairs[p, 0]], mean[t, pairs[p, 1]]
            sums[:] = 0.0
            for i in range(0, whole, LANES):
                for k in range(LANES):
                    sums[k] += (a[i + k] - mean_a) * (b[i + k] - mean_b)
            total = 0.0
            for k in range(LANES):
                total += sums[k]
            for i in range(whole, count):
                total += (a[i] - mean_a) * (b[i] - mean_b)
            products[t, p] = total
    return 0


_SIGNATURES: dict[Callable[..., Any], Any] = {
    run_members: int64(
        _INITIALIZE,
        _STEP,
        _NUMBERS,
        _NUMBERS,
        _INDICES,
        _TABLE,
        _NUMBERS,
        _INDICES,
        _BLOCK,
        int64[:, ::1],
        _INDICES,
        _TABLE,
    ),
    run_driven: int64(
        _INITIALIZE,
        _STEP,
        types.FunctionType(types.void(*CONTROLLED)),
        _NUMBERS,
        _NUMBERS,
        _INDICES,
        _TABLE,
        _INDICES,
        _BLOCK,
        int64[:, ::1],
        _INDICES,
        _TABLE,
        _INDICES,
        _INDICES,
        _NUMBERS,
        _NUMBERS,
        int64[:, ::1],
        _TABLE,
        _TABLE,
        _NUMBERS,
        _BLOCK,
    ),
    moments: int64(_BLOCK, _INDICES, int64, _INDICES, _PAIRS, _TABLE, _TABLE, _TABLE),
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
