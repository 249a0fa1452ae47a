"""What NumPy refused in a call of an array function, in words that name the argument."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rbfmu_kernels.compile.shapes import core_shapes, python_function
from rbfmu_kernels.types import Shape


def clear_error(
    kernel: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any], refused: Exception
) -> Exception:
    """Return the error to raise in place of NumPy's."""
    shapes, results = core_shapes(kernel)
    name = python_function(kernel).__name__
    if not len(shapes) <= len(args) <= len(shapes) + len(results):
        return TypeError(f"{name} takes {len(shapes)} arguments ({', '.join(shapes)}), got {len(args)}")
    if error := _of_arguments(name, shapes, args) or _of_keywords(name, next(iter(shapes)), kwargs):
        return error
    leading = {n: np.shape(v)[: np.ndim(v) - len(s)] for (n, s), v in zip(shapes.items(), args, strict=False)}
    try:
        common = np.broadcast_shapes(*leading.values())
    except ValueError:
        return ValueError(f"{name}: leading shapes {leading} do not broadcast")
    out = args[len(shapes) :] or kwargs.get("out")
    if error := _of_out(name, results, common, out):
        return error
    return refused if str(refused).startswith(f"{name}: ") else type(refused)(f"{name}: {refused}")


def _of_arguments(name: str, shapes: dict[str, Shape], args: tuple[Any, ...]) -> Exception | None:
    for (argument, shape), value in zip(shapes.items(), args, strict=False):
        try:
            array = np.asarray(value)
        except ValueError:
            return ValueError(f"{name}: {argument} must be a regular array of numbers, got {value!r}")
        if array.dtype.kind not in "biuf":
            return ValueError(f"{name}: {argument} must be real numbers, got {value!r}")
        if array.shape[array.ndim - len(shape) :] != shape or array.ndim < len(shape):
            hint = "; of principal moments give np.diag(moments)" if _are_moments(argument, array) else ""
            return ValueError(f"{name}: {argument} must have trailing shape {shape}, got {array.shape}{hint}")
    return None


def _are_moments(argument: str, array: Any) -> bool:
    """Return whether three numbers are given for an inertia matrix, such as M_c."""
    return argument.partition("_")[0] == "M" and array.shape == (3,)


def _of_keywords(name: str, first: str, kwargs: dict[str, Any]) -> Exception | None:
    if "where" in kwargs:
        return TypeError(f"{name}: where is not supported; choose the items by an index, such as {first}[mask]")
    dtype = kwargs.get("dtype")
    if dtype is not None and dtype not in (float, np.float64, "d", "float64"):
        given = getattr(dtype, "__name__", dtype)
        return TypeError(f"{name}: dtype = {given}: all is computed in float64; use .astype on the result")
    return None


def _of_out(name: str, results: list[Shape], leading: tuple[int, ...], out: Any) -> Exception | None:
    outs = out if isinstance(out, tuple) else () if out is None else (out,)
    if outs and len(outs) != len(results):
        wanted = f"a tuple of {len(results)} arrays" if len(results) > 1 else "one array"
        return ValueError(f"{name}: out must be {wanted}, got {len(outs)}")
    for k, (array, core) in enumerate(zip(outs, results, strict=False)):
        label = f"{name}: out[{k}]" if len(results) > 1 else f"{name}: out"
        if array is None:
            continue
        if not isinstance(array, np.ndarray):
            return TypeError(f"{label} must be an array, got {array!r}")
        if not _holds(array.shape, leading, core):
            return ValueError(f"{label} must have shape {leading + core}, got {array.shape}")
        if not np.can_cast(np.float64, array.dtype, "same_kind"):
            return TypeError(f"{label} must hold floats, got {array.dtype}")
        if not array.flags.writeable:
            return ValueError(f"{label} must be an array that can be written")
    return None


def _holds(shape: tuple[int, ...], leading: tuple[int, ...], core: Shape) -> bool:
    """Return whether results fit into an array: NumPy repeats them along further leading axes."""
    axes = len(shape) - len(core)
    if axes < len(leading) or shape[axes:] != core:
        return False
    last = shape[axes - len(leading) : axes]
    return all(n in (1, m) for n, m in zip(leading, last, strict=True))
