"""A NumPy gufunc with fixed core sizes whose loop takes sixteen items at a time to a tile, where LLVM vectorises.

The loop is generated as source and compiled as a C callback. Items go to the tile by transposing vectors where they are
packed in memory (or are one item, broadcast), number by number where they are not (slices, transposes). Large results
go past the caches.
"""

import math
import platform
import re
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numba import float64, intp, types

from ..types import Shape
from . import tile
from .code_cache import DiskCache, made_once
from .compiler import pipeline
from .numba_private import CFunc, fromfunc, trigger_event
from .shapes import Item, python_function

_LOOP_SIGNATURE = types.void(types.CPointer(types.CPointer(float64)), types.CPointer(intp), types.CPointer(intp), intp)
_ROW = 8 * tile.ITEMS  # bytes
_ALL_FLAGS = 0x3D  # FE_ALL_EXCEPT of x86; its bits contain those of the other platforms
_MOVES = (tile.to_tile, tile.from_tile, tile.stream_tile, tile.end_stream, tile.in_turn, tile.in_vectors)
_NAMES = {f.__name__: f for f in (tile.address, tile.tile_of, tile.read, tile.write, *_MOVES)}
_NAMES |= {"clear_float_flags": types.ExternalFunction("feclearexcept", types.int32(types.int32))}
if platform.machine() not in ("x86_64", "AMD64"):
    _NAMES |= {"stream_tile": tile.from_tile, "end_stream": tile.in_turn}

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
"""The loop over items, whole tiles of packed ones first. Branch-free code evaluates what it does not select, and its
flags would become NumPy warnings."""


def tiled_gufuncs(item: Item, *least: int) -> list[np.ufunc]:
    """Return gufuncs with a loop over tiles that is compiled now, or loaded from the cache.

    least: of each, the bytes from which on its results go past the caches.
    """
    compiled = _compiled(item.function("loop", "args, dims, steps, least", _loop_source(item), _NAMES))
    counts = len(item.inputs), len(item.results)
    name, text = python_function(item.kernel).__name__, item.kernel.__doc__ or ""
    kinds = [[np.dtype(np.float64).num] * sum(counts)]
    return [
        fromfunc(name, text, [compiled.address], kinds, *counts, [n], compiled, -1, item.layout(), ()) for n in least
    ]


def _compiled(loop: Callable[..., None]) -> CFunc:
    signature = _LOOP_SIGNATURE.args, _LOOP_SIGNATURE.return_type
    compiled = CFunc(loop, signature, {}, {"error_model": "numpy"}, pipeline_class=pipeline)
    compiled._cache = kept = DiskCache(loop)
    with made_once(kept), trigger_event("numba:compile", data={"dispatcher": SimpleNamespace(py_func=loop)}):
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


@dataclass(frozen=True)
class _Operand:
    """An argument or result, number k of a loop, as source text."""

    k: int
    shape: Shape
    axis: int  # where in `steps` the strides of its core axes begin
    row: int  # its first in the tile

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def strides(self) -> str:
        return "(" + "".join(f"steps[{self.axis + n}], " for n in range(len(self.shape))) + ")"

    @property
    def in_tile(self) -> str:
        """The address of item i, its shape and strides."""
        return f"address(tile, {_ROW * self.row} + 8 * i), {self.shape}, {tuple(self._apart(_ROW))}"

    @property
    def in_memory(self) -> str:
        """The same of the item that goes there, anywhere in memory."""
        return f"address(p{self.k}, (start + i) * s{self.k}), {self.shape}, c{self.k}"

    @property
    def is_packed(self) -> str:
        core = [f" and c{self.k}[{n}] == {bytes_}" for n, bytes_ in enumerate(self._apart(8))]
        return f"s{self.k} == {8 * self.size}" + "".join(core)

    @property
    def packed(self) -> str:
        """The tile, the address of items that are packed in memory, their first row and the size of one."""
        return f"tile, address(p{self.k}, start * {8 * self.size}), {self.row}, {self.size}"

    def _apart(self, number: int) -> list[int]:
        """Return the bytes between neighbours along each axis, where numbers are so many bytes apart."""
        return [number * math.prod(self.shape[axis + 1 :]) for axis in range(len(self.shape))]


def _operands(shapes: list[Shape]) -> list[_Operand]:
    operands: list[_Operand] = []
    axis, row = len(shapes), 0  # in `steps`, the core strides follow one outer stride for each operand
    for k, shape in enumerate(shapes):
        operands.append(_Operand(k, shape, axis, row))
        axis, row = axis + len(shape), row + operands[-1].size
    return operands
