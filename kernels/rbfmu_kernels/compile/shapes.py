"""The core shapes of a kernel's arguments and results, from its annotations."""

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

from ..types import Shape, shape_of, shapes_of_result


def python_function(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return the undecorated function of a kernel (the kernel itself where Numba's JIT is disabled)."""
    return getattr(kernel, "py_func", kernel)


@cache
def core_shapes(kernel: Callable[..., Any]) -> tuple[dict[str, Shape], list[Shape]]:
    """Return argument names with core shapes, and result shapes (arguments that are int are left out)."""
    return argument_shapes(kernel), shapes_of_result(inspect.signature(python_function(kernel)).return_annotation)


def argument_shapes(kernel: Callable[..., Any]) -> dict[str, Shape]:
    """Return argument names with core shapes."""
    parameters = inspect.signature(python_function(kernel)).parameters
    return {name: shape_of(p.annotation) for name, p in parameters.items() if p.annotation is not int}
