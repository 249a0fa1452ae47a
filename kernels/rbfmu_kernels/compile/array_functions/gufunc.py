"""Array functions made from a scalar kernel's one definition."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import config

from ..numba_private import MISSING
from ..plain import plain_gufunc
from ..shapes import argument_shapes, core_shapes

STREAMED = 20 << 20
"""Bytes: results of this size or more go past the caches.

Below some 16 to 28 MB, where caches hold them and the arguments, that is 3 to 15 % slower; at 70 MB 1.1 to 1.4 times as
fast where others use the memory too.
"""


def gufuncs(kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None) -> list[Any]:
    """Return two gufuncs that map `kernel(*constants, ...)` over leading axes.

    The first is for whole arrays; the second for the pieces of a large one, which go past the caches however small.
    singular: a kernel of the first few arguments. The gufunc then takes a mark before its arguments: an array of shape
    (), zero, which becomes 1 where `singular` is true for an item.
    """
    if config.DISABLE_JIT:
        return [interpreted(kernel, *constants, singular=singular)] * 2
    if not MISSING:
        from .tiled_gufunc import tiled_gufuncs

        try:
            return tiled_gufuncs(kernel, *constants, singular=singular)
        except Exception:  # Numba's internals behave otherwise than where they were tried
            pass
    return [plain_gufunc(kernel, *constants, singular=singular)] * 2


def interpreted(kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None) -> Any:
    """Return such a gufunc, item by item, without compilation (for NUMBA_DISABLE_JIT=1)."""
    arguments, results = core_shapes(kernel)
    shapes = [*arguments.values()]
    checked = len(argument_shapes(singular)) if singular else 0

    def call(*args: Any, out: Any = None) -> Any:
        mark, args = (args[0], args[1:]) if checked else (np.zeros(()), args)
        if len(args) != len(shapes):
            raise TypeError(f"{len(shapes)} arguments are needed")
        arrays = [np.asarray(a) for a in args]
        if any(a.dtype.kind not in "biuf" for a in arrays):
            raise TypeError("not real numbers")
        if any(a.shape[a.ndim - len(s) :] != s for a, s in zip(arrays, shapes, strict=True)):
            raise ValueError("wrong trailing shape")
        leading = np.broadcast_shapes(*(a.shape[: a.ndim - len(s)] for a, s in zip(arrays, shapes, strict=True)))
        arrays = [np.broadcast_to(a, leading + s) for a, s in zip(arrays, shapes, strict=True)]
        given = out if isinstance(out, tuple) else (out,) * len(results)
        outs = [np.empty(leading + s) for s in results]  # not over an argument that is still to be read
        for index in np.ndindex(*leading):
            items = [_as_tuple(a[index]) for a in arrays]
            if singular and singular(*constants, *items[:checked]):
                mark[()] = 1.0
            value = kernel(*constants, *items)
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
