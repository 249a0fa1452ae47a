"""Array functions from scalar kernels: NumPy broadcasting, `out=`, compiled at the first call."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from rbfmu_kernels._batch import core_shapes, gufunc, python_function
from rbfmu_kernels.euler_angles import sequence


def array_function(kernel: Callable[..., Any], *constants: int) -> Callable[..., Any]:
    """The array function of a scalar kernel: same name, arguments and docstring, any leading axes."""
    compiled: Any = None

    @wraps(python_function(kernel))
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal compiled
        try:
            return compiled(*args, **kwargs)
        except TypeError:
            if compiled is not None:
                raise _clear_error(kernel, args, kwargs) from None
        except ValueError:
            raise _clear_error(kernel, args, kwargs) from None
        compiled = gufunc(kernel, *constants)
        return call(*args, **kwargs)

    return call


def sequence_function(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """The array function of a kernel whose first argument is an Euler sequence: compiled once per sequence."""
    functions: dict[str, Callable[..., Any]] = {}

    @wraps(python_function(kernel))
    def call(seq: str, *args: Any, **kwargs: Any) -> Any:
        try:
            function = functions[seq]
        except KeyError:
            function = functions[seq] = array_function(kernel, sequence(seq))
        return function(*args, **kwargs)

    return call


def _clear_error(kernel: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Exception:
    """Name the argument that NumPy refused."""
    shapes, _ = core_shapes(kernel)
    name = python_function(kernel).__name__
    if unknown := set(kwargs) - {"out", "where", "axes", "order", "subok", "casting", "dtype"}:
        return TypeError(f"{name}: unexpected keyword {sorted(unknown)[0]!r}; arguments are {', '.join(shapes)}, out")
    if not len(shapes) <= len(args) <= len(shapes) + 2:
        return TypeError(f"{name} takes {len(shapes)} arguments ({', '.join(shapes)}), got {len(args)}")
    for (argument, shape), value in zip(shapes.items(), args, strict=False):
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            return ValueError(f"{name}: {argument} must be numbers, got {value!r}")
        if array.shape[array.ndim - len(shape) :] != shape or array.ndim < len(shape):
            return ValueError(f"{name}: {argument} must have trailing shape {shape}, got {array.shape}")
    leading = {n: np.shape(v)[: np.ndim(v) - len(s)] for (n, s), v in zip(shapes.items(), args, strict=False)}
    return ValueError(f"{name}: leading shapes {leading} do not broadcast (or do not fit out)")
