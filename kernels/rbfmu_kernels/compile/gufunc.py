"""Array functions made from a scalar kernel's one definition."""

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import config, float64, guvectorize

from ..types import Shape
from .decorator import kept_on_disk
from .numba_private import MISSING
from .shapes import argument_shapes, core_shapes, python_function

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


def plain_gufunc(
    kernel: Callable[..., Any], *constants: int, singular: Callable[..., bool] | None = None
) -> Callable[..., Any]:
    """Return what `gufuncs` returns one of, with a loop that takes one item after the other."""
    arguments, results = core_shapes(kernel)
    checked = len(argument_shapes(singular)) if singular else 0
    inputs = [()] * bool(checked) + [*arguments.values()]
    sizes = sorted({n for shape in inputs + results for n in shape})
    source = _loop_source(constants, [f"n{n}" for n in sizes], [*arguments.values()], results, checked)
    name = "_".join([python_function(kernel).__name__, "items", *map(str, constants)])
    scope = {"__name__": python_function(kernel).__module__, "kernel": kernel, "singular": singular}
    exec(compile(source.replace("LOOP", name), inspect.getfile(python_function(kernel)), "exec"), scope)
    types = [float64[(slice(None),) * max(1, len(shape))] for shape in [(0,)] * len(sizes) + inputs + results]
    layout = ",".join([*(f"(n{n})" for n in sizes), *map(_layout, inputs)]) + "->" + ",".join(map(_layout, results))
    loop = kept_on_disk(lambda cache: guvectorize([tuple(types)], layout, cache=cache)(scope[name]))
    return _with_sizes(loop, [np.empty(n) for n in sizes])


def _layout(shape: Shape) -> str:
    return "(" + ",".join(f"n{n}" for n in shape) + ")"


def _with_sizes(loop: Any, sizes: list[Any]) -> Callable[..., Any]:
    """Bind core sizes to their numbers by first arguments, as `guvectorize` knows sizes by name only."""

    def call(*args: Any, **kwargs: Any) -> Any:
        if "axes" in kwargs:
            kwargs["axes"] = [(0,)] * len(sizes) + kwargs["axes"]
        with np.errstate(all="ignore"):  # branch-free code evaluates what it does not select
            return loop(*sizes, *args, **kwargs)

    return call


def _loop_source(
    constants: tuple[int, ...], sizes: list[str], arguments: list[Shape], results: list[Shape], checked: int
) -> str:
    """Return the source of the function LOOP on one item; checked: how many arguments `singular` takes."""
    names = [f"a{k}" for k in range(len(arguments))]
    outs = [f"r{k}" for k in range(len(results))]
    items = [_item(name, shape) for name, shape in zip(names, arguments, strict=True)]
    fixed = [*map(str, constants)]
    parts = [f"r[{k}]" for k in range(len(results))] if len(results) > 1 else ["r"]
    lines = [f"def LOOP({', '.join(sizes + ['mark'] * bool(checked) + names + outs)}):"]
    lines += [f"    if singular({', '.join(fixed + items[:checked])}): mark[0] = 1.0"] * bool(checked)
    lines += [f"    r = kernel({', '.join(fixed + items)})"]
    for out, shape, part in zip(outs, results, parts, strict=True):
        for index in np.ndindex(*shape):
            lines += [f"    {out}[{_comma(index) or 0}] = {part}{''.join(f'[{i}]' for i in index)}"]
    return "\n".join(lines) + "\n"


def _item(name: str, shape: Shape, index: tuple[int, ...] = ()) -> str:
    """Return the source of an item as a number or a (nested) tuple."""
    if len(index) == len(shape):
        return f"{name}[{_comma(index) or 0}]"
    return "(" + "".join(_item(name, shape, (*index, i)) + ", " for i in range(shape[len(index)])) + ")"


def _comma(index: tuple[int, ...]) -> str:
    return ", ".join(map(str, index))
