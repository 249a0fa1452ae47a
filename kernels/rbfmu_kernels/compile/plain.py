"""Kernels and array functions by Numba's documented `njit` and `guvectorize` alone.

They serve where Numba's internals do not: the first call is slower, and the bits are the same.
"""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import config, float64, guvectorize, njit

from ..types import Shape
from .shapes import argument_shapes, core_shapes, python_function
from .stamp import SOURCES

CALLED_BY_CODE = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of what is not called from Python."""


def plain_kernel(function: Callable[..., Any], *, inline: bool) -> Any:
    """Return the kernel of a function."""
    return _cached(lambda cache: njit(error_model="numpy", nogil=True, forceinline=inline, cache=cache)(function))


def code_for_callers(function: Callable[..., Any], signature: Any) -> Any:
    """Return what Numba compiles of a function that is called by compiled code only."""
    return njit(signature, **CALLED_BY_CODE)(function)


def _cached(compiled: Callable[[bool], Any]) -> Any:
    """Compile with a cache in a folder of these sources, as Numba's stamp does not see what a function calls."""
    folder = config.CACHE_DIR
    config.CACHE_DIR = str(Path(folder or Path(__file__).parents[1] / "__pycache__") / SOURCES)
    try:
        return compiled(True)
    except RuntimeError:  # no folder can be written
        return compiled(False)
    finally:
        config.CACHE_DIR = folder


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
    loop = _cached(lambda cache: guvectorize([tuple(types)], layout, cache=cache)(scope[name]))
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
