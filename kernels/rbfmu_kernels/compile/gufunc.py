"""NumPy gufuncs with fixed core sizes, made from the definition of a scalar kernel.

Their loop is generated as source, and compiled as a C callback. It moves sixteen items at a time to a tile, where LLVM
vectorises. Items packed in memory are transposed in vectors, an item broadcast to all is moved once, others (slices,
transposes) are moved number by number. Large results bypass the caches. Where Numba's internals cannot be used,
`guvectorize` makes the loop; without compiling, it is a loop in Python.
"""

import inspect
import math
import platform
import re
from collections.abc import Callable, Sequence
from functools import cache
from itertools import accumulate
from types import SimpleNamespace
from typing import Any, NamedTuple, get_args

import numpy as np
from numba import config, float64, guvectorize, intp, types

from ..types import SHAPES, Function, Shape, python_function
from . import numba_private as inside
from .code_cache import DiskCache, kept_on_disk, made_once

if not inside.MISSING:
    from . import compiler, tile

STREAMED = 20 << 20
"""The size, in bytes, from which results bypass the caches.

Below some 16 to 28 MB, where caches hold results and arguments, that is 3 to 15 % slower; at 70 MB it is 1.1 to 1.4
times as fast where other programs use the memory too.
"""


@cache
def core_shapes(kernel: Function) -> tuple[dict[str, Shape], list[Shape]]:
    """Return the arguments' core shapes by name, and the results' core shapes; arguments that are int are left out."""
    signature = inspect.signature(python_function(kernel))
    result, taken = signature.return_annotation, signature.parameters.items()
    results = [result] if result in SHAPES else get_args(result)
    return {name: SHAPES[p.annotation] for name, p in taken if p.annotation is not int}, [SHAPES[x] for x in results]


class Item(NamedTuple):
    """The computation for an item: `kernel(*constants, ...)`, after `singular` has tested the first few arguments."""

    kernel: Function
    constants: tuple[int, ...] = ()
    singular: Callable[..., bool] | None = None

    @property
    def checked(self) -> int:
        """Return how many arguments `singular` tests; 0 if there is no such function."""
        return len(core_shapes(self.singular)[0]) if self.singular else 0

    @property
    def inputs(self) -> list[Shape]:
        """Return the core shapes of the arguments, the first of which is the mark if there is one (see `gufuncs`)."""
        return [()] * bool(self.singular) + [*core_shapes(self.kernel)[0].values()]

    @property
    def results(self) -> list[Shape]:
        """Return the core shapes of results."""
        return core_shapes(self.kernel)[1]

    def layout(self, size: str = "") -> str:
        """Return the core shapes as NumPy writes them, such as (3,3),(3)->(3); size: a prefix of each number."""
        before, after = (
            ",".join(f"({','.join(f'{size}{n}' for n in shape)})" for shape in shapes)
            for shapes in (self.inputs, self.results)
        )
        return f"{before}->{after}"

    def lines(self, items: Sequence[str], found: str) -> list[str]:
        """Return source that sets r0, r1, ... to the results; items: the arguments; found: a statement if singular."""
        given = [*map(str, self.constants), *items]
        check = [f"if singular({', '.join(given[: len(self.constants) + self.checked])}): {found}"]
        names = ", ".join(f"r{k}" for k in range(len(self.results)))
        return check * bool(self.singular) + [f"{names} = kernel({', '.join(given)})"]

    def function(self, kind: str, head: str, lines: Sequence[str], names: dict[str, Any]) -> Function:
        """Return the function of this source as if the kernel's file defined it, beside which its code is cached."""
        function = python_function(self.kernel)
        name = "_".join([function.__name__, kind, *map(str, self.constants)])
        scope = {"__name__": function.__module__, "kernel": self.kernel, "singular": self.singular, **names}
        source = "\n    ".join([f"def {name}({head}):", *lines]) + "\n"
        exec(compile(source, inspect.getfile(function), "exec"), scope)
        return scope[name]  # type: ignore[no-any-return]


def gufuncs(item: Item) -> Sequence[Function]:
    """Return two gufuncs that compute an item's results for all items along leading axes.

    The first is for whole arrays; the second is for pieces of a large one, and its results always bypass the caches.
    If items may be singular, a mark comes before the arguments: an array of shape () that is 0, and is set to 1 if any
    item is singular.
    """
    if config.DISABLE_JIT:
        return [interpreted(item)] * 2
    if not inside.MISSING:
        try:
            return tiled_gufuncs(item, STREAMED, 0)
        except Exception:  # Numba's internals differ from those of the versions tried
            pass
    return [plain_gufunc(item)] * 2


def interpreted(item: Item) -> Function:
    """Return a function like such a gufunc, which loops over the items in Python (for NUMBA_DISABLE_JIT=1)."""
    shapes, results = item.inputs, item.results

    def call(*args: Any, out: Any = None) -> Any:
        if len(args) != len(shapes):
            raise TypeError(f"{len(shapes)} arguments are needed")
        arrays = [np.asarray(a) for a in args]
        if any(a.dtype.kind not in "biuf" for a in arrays):
            raise TypeError("not real numbers")
        if any(a.shape[a.ndim - len(s) :] != s for a, s in zip(arrays, shapes, strict=True)):
            raise ValueError("wrong trailing shape")
        leading = np.broadcast_shapes(*(a.shape[: a.ndim - len(s)] for a, s in zip(arrays, shapes, strict=True)))
        given = out if isinstance(out, tuple) else (out,) * len(results)
        outs = [np.empty(leading + s) for s in results]  # `out` may overlap an argument that is still to be read
        rows = [np.broadcast_to(a, leading + s) for a, s in zip(arrays, shapes, strict=True)]
        for index in np.ndindex(*leading):
            items = [*item.constants, *(_as_tuple(a[index]) for a in rows[bool(item.singular) :])]
            if item.singular and item.singular(*items[: len(item.constants) + item.checked]):
                arrays[0][()] = 1.0
            value = item.kernel(*items)
            for target, part in zip(outs, value if len(results) > 1 else (value,), strict=True):
                target[index] = part
        for target, found in zip(given, outs, strict=True):
            if target is not None:
                target[...] = found
        values = tuple(o[()] if g is None else g for o, g in zip(outs, given, strict=True))
        return values if len(values) > 1 else values[0]

    return call


def _as_tuple(array: Any) -> Any:
    return tuple(_as_tuple(a) for a in array) if np.ndim(array) else float(array)


def plain_gufunc(item: Item) -> Function:
    """Return such a gufunc whose loop is `guvectorize`'s, one item after the other.

    `guvectorize` knows core sizes by name only, so arrays of these sizes are passed as the first arguments.
    """
    shapes = item.inputs + item.results
    sizes, names = sorted({n for shape in shapes for n in shape}), [f"a{k}" for k in range(len(shapes))]
    given = [_source_of(name, shape) for name, shape in zip(names, item.inputs, strict=False)]
    lines = item.lines(given[bool(item.singular) :], "a0[0] = 1.0")
    for k, (name, shape) in enumerate(zip(names[len(item.inputs) :], item.results, strict=True)):
        for index in np.ndindex(*shape):
            lines += [f"{name}[{_comma(index)}] = r{k}{''.join(f'[{i}]' for i in index)}"]
    function = item.function("items", ", ".join([*(f"n{n}" for n in sizes), *names]), lines, {})
    types = [float64[(slice(None),) * max(1, len(shape))] for shape in [(0,)] * len(sizes) + shapes]
    layout = "".join(f"(n{n})," for n in sizes) + item.layout("n")
    loop = kept_on_disk(lambda cache: guvectorize([tuple(types)], layout, cache=cache)(function))
    first = [np.empty(n) for n in sizes]

    def call(*args: Any, **kwargs: Any) -> Any:
        if "axes" in kwargs:
            kwargs["axes"] = [(0,)] * len(first) + kwargs["axes"]
        with np.errstate(all="ignore"):  # branch-free code evaluates what it does not select
            return loop(*first, *args, **kwargs)

    return call


def _source_of(name: str, shape: Shape, index: tuple[int, ...] = ()) -> str:
    """Return the source of an item as a number or a (nested) tuple."""
    if len(index) == len(shape):
        return f"{name}[{_comma(index)}]"
    return "(" + "".join(_source_of(name, shape, (*index, i)) + ", " for i in range(shape[len(index)])) + ")"


def _comma(index: tuple[int, ...]) -> str:
    return ", ".join(map(str, index)) or "0"


# Over tiles


_LOOP_SIGNATURE = types.void(types.CPointer(types.CPointer(float64)), types.CPointer(intp), types.CPointer(intp), intp)
_ALL_FLAGS = 0x3D  # FE_ALL_EXCEPT of x86; its bits contain those of the other platforms

_LOOP = """\
n, start, found = dims[0], 0, 0
POINTERS
tile = tile_of(ROWS)
if PACKED:
    ONE_FOR_ALL
    streamed = n * BYTES >= least
    while start + ITEMS <= n:
        PACKED_TO_TILE
        for i in range(ITEMS):
            COMPUTE
            in_vectors()
        if streamed:
            STREAM
        else:
            PACKED_FROM_TILE
        start += ITEMS
    if streamed: end_stream()
while start < n:
    m = min(ITEMS, n - start)
    TO_TILE
    for i in range(m):
        COMPUTE
    FROM_TILE
    start += ITEMS
clear_float_flags(FLAGS)
MARK"""
"""The loop over items: whole tiles of packed items first, then the rest. It clears the floating-point flags, of which
NumPy would make warnings: branch-free code also evaluates values that it does not select."""


def tiled_gufuncs(item: Item, *least: int) -> list[np.ufunc]:
    """Return gufuncs with a loop over tiles that is compiled now, or loaded from the cache.

    least: for each gufunc, the size in bytes from which its results bypass the caches.
    """
    moves = {f.__name__: f for f in (tile.to_tile, tile.from_tile, tile.stream_tile, tile.end_stream)}
    if platform.machine() not in ("x86_64", "AMD64"):
        moves |= {"stream_tile": tile.from_tile, "end_stream": tile.in_turn}
    names = {f.__name__: f for f in (tile.address, tile.tile_of, tile.read, tile.write, tile.in_turn, tile.in_vectors)}
    names["clear_float_flags"] = types.ExternalFunction("feclearexcept", types.int32(types.int32))
    compiled = _compiled(item.function("loop", "args, dims, steps, least", _loop_source(item), names | moves))
    counts = len(item.inputs), len(item.results)
    name, text = python_function(item.kernel).__name__, item.kernel.__doc__ or ""
    kinds = [[np.dtype(np.float64).num] * sum(counts)]
    return [
        inside.fromfunc(name, text, [compiled.address], kinds, *counts, [n], compiled, -1, item.layout(), ())
        for n in least
    ]


def _compiled(loop: Callable[..., None]) -> "inside.CFunc":
    signature = _LOOP_SIGNATURE.args, _LOOP_SIGNATURE.return_type
    compiled = inside.CFunc(loop, signature, {}, {"error_model": "numpy"}, pipeline_class=compiler.pipeline)
    compiled._cache = kept = DiskCache(loop)
    with made_once(kept), inside.trigger_event("numba:compile", data={"dispatcher": SimpleNamespace(py_func=loop)}):
        compiled.compile()
    return compiled


def _loop_source(item: Item) -> list[str]:
    """Return the lines of the loop."""
    operands = _operands(item.inputs + item.results)
    inputs, outputs = operands[bool(item.singular) : len(item.inputs)], operands[len(item.inputs) :]
    packed = [*(f"(s{o.k} == 0 or {o.is_packed})" for o in inputs), *(o.is_packed for o in outputs)]
    to_tile = {o: f"write({o.in_tile}, read({o.in_memory})); in_turn()" for o in inputs}
    computed = item.lines([f"read({o.in_tile})" for o in inputs], "found += 1")
    parts: dict[str, list[str]] = {
        "POINTERS": [f"p{o.k} = args[{o.k}]; s{o.k} = steps[{o.k}]; c{o.k} = {o.strides}" for o in operands],
        "ONE_FOR_ALL": [f"for i in range(ITEMS if s{o.k} == 0 else 0): {move}" for o, move in to_tile.items()],
        "PACKED_TO_TILE": [f"if s{o.k} != 0: to_tile({o.packed})" for o in inputs],
        "COMPUTE": computed + [f"write({o.in_tile}, r{n})" for n, o in enumerate(outputs)],
        "STREAM": [f"stream_tile({o.packed})" for o in outputs],
        "PACKED_FROM_TILE": [f"from_tile({o.packed})" for o in outputs],
        "TO_TILE": [f"for i in range(m): {move}" for move in to_tile.values()],
        "FROM_TILE": [f"for i in range(m): write({o.in_memory}, read({o.in_tile})); in_turn()" for o in outputs],
        "MARK": ["if found > 0: write(p0, (), (), 1.0)"] * bool(item.singular),
    }
    lines = [
        line.replace(name, one)
        for line in _LOOP.splitlines()
        for name in [line.strip()]
        for one in parts.get(name, [name])
    ]
    numbers = {"ITEMS": tile.ITEMS, "FLAGS": _ALL_FLAGS, "PACKED": " and ".join(packed)}
    numbers |= {"ROWS": sum(o.size for o in operands), "BYTES": 8 * sum(o.size for o in outputs)}
    return [re.sub("|".join(numbers), lambda found: str(numbers[found[0]]), line) for line in lines]


class _Operand(NamedTuple):
    """An argument or result, the k-th of a loop, as source text; size: how many numbers an item has.

    strides: those of its core axes; in_tile: the address of item i in the tile, its shape and strides; in_memory: the
    same for this item in memory; is_packed: the condition that items are packed in memory; packed: the tile, the
    address of packed items, their first row in the tile and their size.
    """

    k: int
    size: int
    strides: str
    in_tile: str
    in_memory: str
    is_packed: str
    packed: str


def _operand(k: int, shape: Shape, axis: int, row: int) -> _Operand:
    """Return an operand; axis: the index in `steps` of its first core axis's stride; row: its first row in the tile."""
    size, in_row = math.prod(shape), 8 * tile.ITEMS
    apart = [math.prod(shape[n + 1 :]) for n in range(len(shape))]  # numbers between neighbours along each axis
    return _Operand(
        k,
        size,
        strides="(" + "".join(f"steps[{axis + n}], " for n in range(len(shape))) + ")",
        in_tile=f"address(tile, {in_row * row} + 8 * i), {shape}, {tuple(in_row * numbers for numbers in apart)}",
        in_memory=f"address(p{k}, (start + i) * s{k}), {shape}, c{k}",
        is_packed=" and ".join([f"s{k} == {8 * size}", *(f"c{k}[{n}] == {8 * x}" for n, x in enumerate(apart))]),
        packed=f"tile, address(p{k}, start * {8 * size}), {row}, {size}",
    )


def _operands(shapes: list[Shape]) -> list[_Operand]:
    axes = accumulate(map(len, shapes), initial=len(shapes))  # core strides come after the operands' outer strides
    rows = accumulate(map(math.prod, shapes), initial=0)
    return [*map(_operand, range(len(shapes)), shapes, axes, rows)]
