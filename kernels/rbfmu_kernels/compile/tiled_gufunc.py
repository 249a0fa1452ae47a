"""A NumPy gufunc with fixed core sizes whose loop takes sixteen items at a time to a tile, where LLVM vectorises.

The loop is generated as source and compiled as a C callback. Items go to the tile by transposing vectors where they are
packed in memory (or are one item, broadcast), number by number where they are not (slices, transposes). Large results
go past the caches.
"""

import inspect
import math
import platform
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import float64, intp, types

from ..types import Shape
from . import tile
from .gufunc import STREAMED
from .numba_private import CFunc, fromfunc, trigger_event
from .reduced import DiskCache, made_once, pipeline
from .shapes import argument_shapes, core_shapes, python_function

_LOOP_SIGNATURE = types.void(types.CPointer(types.CPointer(float64)), types.CPointer(intp), types.CPointer(intp), intp)
_clear_float_flags = types.ExternalFunction("feclearexcept", types.int32(types.int32))
_X86 = platform.machine() in ("x86_64", "AMD64")
_ALL_FLAGS = 0x3D  # FE_ALL_EXCEPT of x86; its bits contain those of the other platforms
_MOVES = (tile.to_tile, tile.from_tile, tile.item_to_tile, tile.item_from_tile, tile.stream_tile, tile.end_stream)
_NAMES = {f.__name__: f for f in (tile.address, tile.tile_of, tile.read, tile.write, tile.in_vectors, *_MOVES)}
_NAMES |= {"clear_float_flags": _clear_float_flags}


def tiled_gufuncs(
    kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None
) -> list[Any]:
    """Return what `gufuncs` returns, with a loop over tiles that is compiled now, or loaded from the cache."""
    arguments, results = core_shapes(kernel)
    name = python_function(kernel).__name__
    checked = len(argument_shapes(singular)) if singular else 0
    source = _loop_source(name, constants, [*arguments.values()], results, checked)
    filename = inspect.getfile(python_function(kernel))  # so that the cache is kept beside the kernel's
    scope = {"__name__": python_function(kernel).__module__, "kernel": kernel, "singular": singular, **_NAMES}
    exec(compile(source, filename, "exec"), scope)
    compiled = _compiled(scope[_loop_name(name, constants)])
    inputs = [*_marks(checked), *arguments.values()]
    layout = _layout(inputs) + "->" + _layout(results)
    double = [np.dtype(np.float64).num] * (len(inputs) + len(results))
    return [
        fromfunc(
            name, kernel.__doc__ or "", [compiled.address], [double], len(inputs), len(results), [least], compiled,
            -1, layout, (),
        )
        for least in (STREAMED, 0)
    ]  # fmt: skip


def _compiled(loop: Callable[..., Any]) -> Any:
    signature = _LOOP_SIGNATURE.args, _LOOP_SIGNATURE.return_type
    compiled = CFunc(loop, signature, {}, {"error_model": "numpy"}, pipeline_class=pipeline)
    compiled._cache = kept = DiskCache(loop)
    with made_once(kept), trigger_event("numba:compile", data={"dispatcher": SimpleNamespace(py_func=loop)}):
        compiled.compile()
    return compiled


def _marks(checked: int) -> list[Shape]:
    """Return the core shape of the mark, where there is one."""
    return [()] if checked else []


def _layout(shapes: list[Shape]) -> str:
    return ",".join("(" + ",".join(map(str, s)) + ")" for s in shapes)


def _loop_name(name: str, constants: tuple[int, ...]) -> str:
    return "_".join([name, "loop", *map(str, constants)])


def _loop_source(
    name: str, constants: tuple[int, ...], arguments: list[Shape], results: list[Shape], checked: int
) -> str:
    """Return the source of the loop over items; checked: how many arguments `singular` takes, 0 for no check."""
    operands = _operands(_marks(checked) + arguments + results)
    inputs, outputs = operands[-len(arguments + results) : -len(results)], operands[-len(results) :]
    compute = _computation([*map(str, constants)], inputs, outputs, checked)
    lines = ["n, start, found, m = dims[0], 0, 0, ITEMS"]
    lines += [f"p{o.k} = args[{o.k}]; s{o.k} = steps[{o.k}]; c{o.k} = {o.strides()}" for o in operands]
    lines += [f"tile = tile_of({sum(o.size for o in operands)})"]
    lines += [*_packed_items(inputs, outputs, compute), *_any_items(inputs, outputs, compute)]
    # Branch-free code evaluates what it does not select; its flags would become NumPy warnings.
    lines += [f"clear_float_flags({_ALL_FLAGS})"]
    lines += ["if found > 0: write(p0, 0, (), 1.0)"] if checked else []
    header = f"def {_loop_name(name, constants)}(args, dims, steps, least):"
    return "\n".join([header, *_indented(1, lines)]).replace("ITEMS", str(tile.ITEMS)) + "\n"


def _computation(fixed: list[str], inputs: list["_Operand"], outputs: list["_Operand"], checked: int) -> list[str]:
    """Return the lines that compute from the tile's item i to the tile."""
    items = [f"read(address(tile, 8 * i), {o.row}, {o.shape})" for o in inputs]
    parts = [f"r[{n}]" for n in range(len(outputs))] if len(outputs) > 1 else ["r"]
    check = [f"found += 1 if singular({', '.join([*fixed, *items[:checked]])}) else 0"] if checked else []
    call = f"r = kernel({', '.join([*fixed, *items])})"
    writes = [f"write(address(tile, 8 * i), {o.row}, {o.shape}, {r})" for o, r in zip(outputs, parts, strict=True)]
    return [*check, call, *writes]


def _packed_items(inputs: list["_Operand"], outputs: list["_Operand"], compute: list[str]) -> list[str]:
    """Return the lines for whole tiles of items that are packed in memory, or one item for all."""
    lines = [f"if {' and '.join([*(o.packed_or_one() for o in inputs), *(o.packed() for o in outputs)])}:"]
    for o in inputs:
        lines += [f"    if s{o.k} == 0:", *_indented(2, o.moves("item_to_tile"))]
    lines += [f"    streamed = n * {8 * sum(o.size for o in outputs)} >= least"]
    lines += ["    while start + ITEMS <= n:"]
    lines += [f"        if s{o.k} != 0: {o.move('to_tile')}" for o in inputs]
    lines += ["        for i in range(ITEMS):", *_indented(3, [*compute, "in_vectors()"])]
    lines += _indented(2, _streamed_or_not(outputs) if _X86 else [o.move("from_tile") for o in outputs])
    lines += ["        start += ITEMS"]
    return lines + ["    if streamed: end_stream()"] * _X86


def _streamed_or_not(outputs: list["_Operand"]) -> list[str]:
    streamed, kept = ([o.move(f) for o in outputs] for f in ("stream_tile", "from_tile"))
    return ["if streamed:", *_indented(1, streamed), "else:", *_indented(1, kept)]


def _any_items(inputs: list["_Operand"], outputs: list["_Operand"], compute: list[str]) -> list[str]:
    """Return the lines for the other items, anywhere in memory."""
    lines = ["while start < n:", "    m = min(ITEMS, n - start)"]
    lines += _indented(1, [line for o in inputs for line in o.moves("item_to_tile")])
    lines += ["    for i in range(m):", *_indented(2, compute)]
    lines += _indented(1, [line for o in outputs for line in o.moves("item_from_tile")])
    return [*lines, "    start += ITEMS"]


def _indented(levels: int, lines: list[str]) -> list[str]:
    return ["    " * levels + line for line in lines]


@dataclass(frozen=True)
class _Operand:
    """An argument or result, number k of a loop, as source text."""

    k: int
    shape: Shape
    axes: range  # where `steps` has the strides of its core axes
    row: int  # its first in the tile

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def packed(self) -> str:
        strides = [8 * math.prod(self.shape[i + 1 :]) for i in range(len(self.shape))]
        core = [f" and c{self.k}[{n}] == {stride}" for n, stride in enumerate(strides)]
        return f"s{self.k} == {8 * self.size}" + "".join(core)

    def packed_or_one(self) -> str:
        return f"(s{self.k} == 0 or {self.packed()})"

    def strides(self) -> str:
        return "(" + "".join(f"steps[{axis}], " for axis in self.axes) + ")"

    def move(self, function: str) -> str:
        """Return the call that moves a tile's items where they are packed in memory."""
        return f"{function}(tile, address(p{self.k}, start * {8 * self.size}), {self.row}, {self.size})"

    def moves(self, function: str) -> list[str]:
        """Return the lines that move a tile's items from or to anywhere in memory."""
        item = f"address(p{self.k}, (start + i) * s{self.k})"
        call = f"{function}(address(tile, 8 * i), {item}, {self.row}, {self.shape}, c{self.k})"
        return ["for i in range(m):", f"    {call}"]


def _operands(shapes: list[Shape]) -> list[_Operand]:
    operands: list[_Operand] = []
    axis, row = len(shapes), 0  # in `steps`, the core strides follow one outer stride for each operand
    for k, shape in enumerate(shapes):
        operands.append(_Operand(k, shape, range(axis, axis + len(shape)), row))
        axis, row = axis + len(shape), row + operands[-1].size
    return operands
