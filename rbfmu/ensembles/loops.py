"""The compiled loops of ensembles: members run one after the other or in lanes, and moments of their outputs.

They release the GIL, so that threads run in parallel. A model's `initialize` and `step` are called by their addresses:
one loop runs all models, with the code that `simulate` calls. Lanes are those of a vector register: several members are
stepped side by side, if their model has lanes, with the same bits.
"""

import math
from collections.abc import Callable
from functools import cache, lru_cache
from threading import Thread
from typing import Any

import numpy as np
from numba import config, float64, int64, typeof, types

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.types import Array, Indices
from rbfmu_kernels.body.lanes import MARKS
from rbfmu_kernels.body.members import Driving, Members, Room, Run, begin, drive, note, pieces_before, record
from rbfmu_kernels.compile.decorator import kernel, loop
from rbfmu_kernels.compile.simd import WIDEST, add_lanes, lanes, lanes_at, multiply_lanes, numbers, put_lanes
from rbfmu_kernels.compile.tiered import has_code
from rbfmu_kernels.mechanics.equations_of_motion import ROTATION
from rbfmu_kernels.numerics.elementary import sincos

_NUMBERS, _TABLE, _BLOCK = float64[::1], float64[:, ::1], float64[:, :, ::1]
_INDICES, _PAIRS = int64[::1], int64[:, ::1]
CONTROLLED = (float64, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS)
"""The types of a controller's arguments."""
_INITIALIZE, _STEP = types.FunctionType(int64(_NUMBERS)), types.FunctionType(int64(_NUMBERS, float64))
_THROUGH = (_NUMBERS, _NUMBERS, _INDICES, _TABLE, _TABLE)
"""The types of the arguments of a model's `run_through`."""


@cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a loop of this module as machine code, kept on disk, if that can be written, until a kernel changes."""
    return loop(function, _SIGNATURES[function])  # type: ignore[no-any-return]


def entries(model: Any, through: bool = False) -> tuple[Any, Any]:
    """Return `initialize` and `step` of a model, or `run_through`, compiled for `run_members` and `run_through`."""
    second = (model.run_through, _THROUGH) if through else (model.step, (_NUMBERS, float64))
    for entry, arguments in ((model.initialize, (_NUMBERS,)), second):
        if hasattr(entry, "compile"):  # not where the JIT is disabled
            entry.compile(arguments)
    return model.initialize, second[0]


def run_members(
    initialize: Any, step: Any, control: Any, members: Members, driving: Driving, room: Room, z: Any, state: Any
) -> int:
    """Run members by a model's `initialize` and `step`, one after the other: see `body.members`.

    z (SIZE,), state (k,): work space for one member.
    """
    run, steps = Run(control, members, driving, room), len(driving.time) - 1
    for i in range(len(members.values)):
        begin(z, state, i, len(members.base), run)
        members.ends[i, 0], k = initialize(z), 0
        fine = members.ends[i, 0] == 0
        while fine:
            record(z, i, k, run)
            if k == steps:
                break
            for piece in range(pieces_before(driving, i, k), pieces_before(driving, i, k + 1)):
                fine = fine and drive(z, state, i, k, piece, run)
                fine = fine and step(z, driving.lengths[piece]) == 0
            k += 1
        note(z, i, run)
    return 0


def run_through(
    initialize: Any, through: Any, which: Any, control: Any, members: Members, driving: Driving, room: Room, z: Any,
    state: Any,
) -> int:  # fmt: skip
    """Run the members of the numbers `which`, one after the other, by a model's `run_through`; see `run_members`."""
    run = Run(control, members, driving, room)
    for i in which:
        begin(z, state, i, len(members.base), run)
        members.ends[i, 0] = initialize(z)
        if members.ends[i, 0] == 0:
            record(z, i, 0, run)
            members.ends[i, 1] = through(z, driving.time, members.kept, members.rows[i], room.states[0])
    return 0


LANES = 16
"""The number of partial sums of a sum; the order of additions is the same on every processor."""


@kernel
def _put_columns(rows: Any, good: Any, first: int, at: Any, x: Any) -> None:
    """Put number p of each good member, counted from a time on, one member after another to x from place at[p] on.

    See `moments`. Four members are put at a time; behind the last member its number is repeated.
    """
    count, own = len(good), rows.shape[2]
    size, last = rows.shape[1] * own, count - 1
    flat, to = rows.reshape(rows.size), x.reshape(x.size)
    zero = lanes(0.0, 0.0, 0.0, 0.0)  # added to turn -0 into 0, which sorting cannot tell apart
    for top in range(0, count, 4):
        i = good[top] * size + first * own
        j = good[min(top + 1, last)] * size + first * own
        k = good[min(top + 2, last)] * size + first * own
        m = good[min(top + 3, last)] * size + first * own
        for p in range(len(at)):
            four = lanes(flat[i + p], flat[j + p], flat[k + p], flat[m + p])
            put_lanes(to, at[p] + top, add_lanes(four, zero))


@kernel
def _products(a: Any, c: float, b: Any, d: float, count: int) -> float:
    """Return the sum of (a + c) (b + d) over `count` numbers: in vectors that stay in registers, then the rest."""
    c_4, d_4 = lanes(c, c, c, c), lanes(d, d, d, d)
    s_0 = s_1 = s_2 = s_3 = lanes(0.0, 0.0, 0.0, 0.0)
    whole = count - count % LANES
    for i in range(0, whole, LANES):
        s_0 = add_lanes(s_0, multiply_lanes(add_lanes(lanes_at(a, i), c_4), add_lanes(lanes_at(b, i), d_4)))
        s_1 = add_lanes(s_1, multiply_lanes(add_lanes(lanes_at(a, i + 4), c_4), add_lanes(lanes_at(b, i + 4), d_4)))
        s_2 = add_lanes(s_2, multiply_lanes(add_lanes(lanes_at(a, i + 8), c_4), add_lanes(lanes_at(b, i + 8), d_4)))
        s_3 = add_lanes(s_3, multiply_lanes(add_lanes(lanes_at(a, i + 12), c_4), add_lanes(lanes_at(b, i + 12), d_4)))
    total = 0.0
    for four in (s_0, s_1, s_2, s_3):
        for number in numbers(four):
            total += number
    for i in range(whole, count):
        total += (a[i] + c) * (b[i] + d)
    return total


def moments(rows: Any, good: Any, first: int, angles: Any, pairs: Any, mean: Any, products: Any, x: Any) -> int:
    """Set the means (t, W) of members at t times and the sums (t, P) of products of two deviations from the means.

    rows (m, n, K): outputs; good (g,): the members that count; first: index of the first time. angles (a,): columns
    whose sines and cosines are appended as columns; W = K + 2 a. pairs (P, 2): columns of the products. x (t W, more
    than g): work space; row by row the good members' numbers of one time and column.
    """
    count, own, width = len(good), rows.shape[2], mean.shape[1]
    ones, at = np.ones(count), np.empty(len(mean) * own, np.int64)
    for p in range(len(at)):
        at[p] = (p // own * width + p % own) * x.shape[1]
    _put_columns(rows, good, first, at, x)
    for t in range(len(mean)):
        for j in range(len(angles)):
            for i in range(count):
                sine, cosine = sincos(x[t * width + angles[j], i])
                x[t * width + own + 2 * j, i], x[t * width + own + 2 * j + 1, i] = sine, cosine
        for j in range(width):
            mean[t, j] = _products(x[t * width + j], 0.0, ones, 0.0, count) / max(count, 1)  # a sum of products with 1
        for p in range(len(pairs)):
            a, b = pairs[p]
            products[t, p] = _products(x[t * width + a], -mean[t, a], x[t * width + b], -mean[t, b], count)
    return 0


RUN = 256
"""The largest count of numbers that NumPy sorts by a network in registers, 2 ns for each. Beyond it sorting takes seven
to twelve times more on a processor that stores chosen lanes of a vector slowly, such as AMD's Zen 4."""


@kernel
def _put_smaller(x: Any, i: Any, j: Any, y: Any, to: Any) -> tuple[Any, Any]:
    """Put the smaller of x[i] and x[j] to y[to]; return the next places i and j."""
    a, b = x[i], x[j]
    y[to] = a if a < b else b
    taken = np.uint64(a <= b)
    return i + taken, j + (np.uint64(1) - taken)


@kernel
def _put_larger(x: Any, i: Any, j: Any, y: Any, to: Any) -> tuple[Any, Any]:
    """Put the larger of x[i] and x[j] to y[to]; return the next places i and j."""
    a, b = x[i], x[j]
    y[to] = a if a > b else b
    taken = np.uint64(a <= b)
    return i - (np.uint64(1) - taken), j - taken


@kernel
def _merge(x: Any, at: Any, beside: Any, half: Any, y: Any, to: Any, other: Any) -> None:
    """Merge the two sorted halves from x[at] on to y[to], and those from x[beside] on to y[other].

    Each merge runs from both ends, so that no half can end too soon. Two run at once, so that neither waits for the
    other's comparison.
    """
    one = np.uint64(1)
    i, j, end = at + half - one, at + half + half - one, to + half + half - one
    m, n, last = beside + half - one, beside + half + half - one, other + half + half - one
    a, b, c, d = at, at + half, beside, beside + half
    for k in range(half):
        a, b = _put_smaller(x, a, b, y, to + k)
        c, d = _put_smaller(x, c, d, y, other + k)
        i, j = _put_larger(x, i, j, y, end - k)
        m, n = _put_larger(x, m, n, y, last - k)


def merged(x: Any, ranks: Any, found: Any, room: Any) -> int:
    """Set `found` (r, p) to the integers of given ranks (p,) in each of r rows x (r n,), whose runs are sorted.

    room (2 n,): work space; see `in_order`.
    """
    zero, whole = np.uint64(0), np.uint64(len(room) // 2)
    for r in range(0, len(found), 2):
        s = min(r + 1, len(found) - 1)
        source, at, beside = x, np.uint64(r) * whole, np.uint64(s) * whole
        target, to, other = room, zero, whole
        half = np.uint64(RUN)
        while half < whole:
            for k in range(zero, whole, half + half):
                _merge(source, at + k, beside + k, half, target, to + k, other + k)
            half = half + half
            source, at, beside, target, to, other = target, to, other, source, at, beside
        for p in range(len(ranks)):
            found[r, p], found[s, p] = source[at + np.uint64(ranks[p])], source[beside + np.uint64(ranks[p])]
    return 0


def in_order(values: Array, ranks: Indices) -> Array:
    """Return the numbers (..., p) of given ranks (p,), counted from 0, among values (..., n).

    Runs of RUN numbers are sorted, then merged two by two. Rows are filled up with infinity to a power of 2 of runs.
    Integers are sorted in place of numbers: merging waits for comparisons, and those of integers take half as long.
    """
    *shape, count = values.shape
    size = max(count, 1) if count <= RUN else RUN << (-(-count // RUN) - 1).bit_length()
    x = np.full((math.prod(shape), size), np.inf)
    x[:, :count] = values.reshape(len(x), count)
    keys, found = _as_keys(x.view(np.int64)), np.empty((len(x), len(ranks)), np.int64)
    keys.reshape(-1, min(size, RUN)).sort(axis=1)
    compiled(merged)(keys.ravel(), ranks, found, np.empty(2 * size, np.int64))
    return _as_keys(found).view(np.float64).reshape(*shape, len(ranks))


def _as_keys(bits: Indices) -> Indices:
    """Turn, in place, the bits of numbers into integers in the order of the numbers, or such integers into the bits."""
    bits ^= (bits >> 63) & np.iinfo(np.int64).max  # the less a negative number, the larger are its other bits
    return bits


_GIVEN = (
    types.FunctionType(types.void(*CONTROLLED)),
    types.NamedTuple((_NUMBERS, _INDICES, _TABLE, _INDICES, _BLOCK, _PAIRS, _INDICES, _TABLE), Members),
    types.NamedTuple((_INDICES, _INDICES, _NUMBERS, _NUMBERS, _PAIRS, _TABLE, _TABLE, _NUMBERS, _BLOCK), Driving),
    types.NamedTuple((_NUMBERS, _NUMBERS, _BLOCK), Room),
)
_SIGNATURES: dict[Callable[..., Any], Any] = {
    run_members: int64(_INITIALIZE, _STEP, *_GIVEN, _NUMBERS, _NUMBERS),
    run_through: int64(_INITIALIZE, types.FunctionType(int64(*_THROUGH)), _INDICES, *_GIVEN, _NUMBERS, _NUMBERS),
    moments: int64(_BLOCK, _INDICES, int64, _INDICES, _PAIRS, _TABLE, _TABLE, _TABLE),
    merged: int64(_INDICES, _INDICES, _PAIRS, _INDICES),
}


AT_ONCE = 64
"""Members whose buffers are filled at a time: the parts in use fit into a processor's own cache."""
_CACHE_LINE = 8
"""The numbers in a cache line."""
MOST_MODELS = 16
"""Models whose lanes are remembered: a user's loop that writes numbers into formulas makes a new model each time."""


def run_alone(
    kernels: Any, members: Members, control: Any, driving: Driving, through: bool = False, which: Any = None
) -> None:
    """Run members of a model one after the other; through: by `run_through`, only those of the numbers `which`."""
    given = control, members, driving, _room(members, driving, 1, through)
    room = aligned_zeros(kernels.SIZE), np.empty(len(driving.start))
    if through:
        which = np.arange(len(members.values), dtype=np.int64) if which is None else which
        compiled(run_through)(*entries(kernels, through), which, *given, *room)
    else:
        compiled(run_members)(*entries(kernels), *given, *room)


def _room(members: Members, driving: Driving, lanes: int, through: bool) -> Room:
    states = np.empty((lanes, len(driving.time) - 1 if through else 0, ROTATION))
    return Room(np.empty(len(members.kept)), np.empty(len(driving.ports)), states)


def run_in_lanes(
    kernels: Any, members: Members, control: Any, driving: Driving, through: bool = False, compile_now: bool = True
) -> bool:
    """Do what `run_alone` does, with the same bits; return False, with nothing done, where lanes cannot be used.

    compile_now: whether to compile lanes; otherwise they are used only if their code is loaded or kept on disk.
    """
    if not kernels.lanes or config.DISABLE_JIT or len(members.values) < 2:
        return False
    run, signature = _lanes_of(kernels, through)
    if not (compile_now or has_code(run, signature)):
        return False
    _compile(run, signature)
    run.disable_compile()  # the controller is called by its address, so that another one needs no other code
    room = _room_of_lanes(kernels, min(AT_ONCE, len(members.values)), len(driving.start), through)
    run(control, members, driving, _room(members, driving, WIDEST, through), *room)
    if through and len(left := np.flatnonzero((members.ends[:, 0] == 0) & (members.ends[:, 1] < 0))):
        run_alone(kernels, members, control, driving, through, left)
    return True


@lru_cache(2 * MOST_MODELS)
def _lanes_of(kernels: Any, through: bool) -> tuple[Any, tuple[Any, ...]]:
    """Return the function that runs members side by side, and its arguments' types."""
    lanes = kernels.lanes()
    room = map(typeof, _room_of_lanes(kernels, 2, 0, through))
    return lanes.through if through else lanes.run, (*_GIVEN, *room)


def _room_of_lanes(kernels: Any, count: int, states: int, through: bool) -> tuple[Array, ...]:
    """Return work space for `count` members at a time, whose controllers have `states` numbers each."""
    size, count = -(-kernels.SIZE // _CACHE_LINE) * _CACHE_LINE, WIDEST if through else max(count, WIDEST)
    buffers = aligned_zeros(count * size).reshape(count, size)[:, : kernels.SIZE]
    marks = () if through else (np.zeros((count, MARKS)),)
    return buffers, np.empty((count, states)), *marks, aligned_zeros(kernels.lanes().SCRATCH)


def _compile(run: Any, signature: tuple[Any, ...]) -> None:
    try:
        if not has_code(run, signature):
            run.compile(signature)
    except RuntimeError:  # meanwhile another thread found code on disk and disabled compilation
        if not has_code(run, signature):
            raise


@lru_cache(2 * MOST_MODELS)
def compile_lanes(kernels: Any, through: bool = False) -> Thread | None:
    """Compile lanes in a thread of their own, once in a process; return the thread, or None without lanes.

    A process waits for it before it ends: the code is kept on disk for later processes.
    """
    if not kernels.lanes or config.DISABLE_JIT:
        return None
    compiling = Thread(target=_compile, args=_lanes_of(kernels, through))
    compiling.start()
    return compiling
