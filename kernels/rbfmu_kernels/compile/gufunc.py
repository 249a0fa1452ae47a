"""Array functions made from a scalar kernel's one definition."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import config, float64, guvectorize

from ..types import Function, Shape
from .code_cache import kept_on_disk
from .numba_private import MISSING
from .shapes import Item

STREAMED = 20 << 20
"""Bytes: results of this size or more go past the caches.

Below some 16 to 28 MB, where caches hold them and the arguments, that is 3 to 15 % slower; at 70 MB 1.1 to 1.4 times as
fast where others use the memory too.
"""


def gufuncs(item: Item) -> Sequence[Function]:
    """Return two gufuncs that do for all items along leading axes what is done for one.

    The first is for whole arrays; the second for the pieces of a large one, which go past the caches however small.
    Where an item may be singular, they take a mark before the arguments: an array of shape (), zero, which becomes 1
    where one is.
    """
    if config.DISABLE_JIT:
        return [interpreted(item)] * 2
    if not MISSING:
        from .tiled_gufunc import tiled_gufuncs

        try:
            return tiled_gufuncs(item, STREAMED, 0)
        except Exception:  # Numba's internals behave otherwise than where they were tried
            pass
    return [plain_gufunc(item)] * 2


def interpreted(item: Item) -> Function:
    """Return such a gufunc, item by item, without compilation (for NUMBA_DISABLE_JIT=1)."""
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
        outs = [np.empty(leading + s) for s in results]  # not over an argument that is still to be read
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
    """Return what `gufuncs` returns one of, with a loop that takes one item after the other.

    `guvectorize` knows core sizes by name only: the first arguments are arrays of these sizes.
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
