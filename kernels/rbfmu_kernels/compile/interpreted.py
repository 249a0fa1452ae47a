"""Kernels as the plain Python functions that they are written as: nothing is compiled, and the bits are the same."""

from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

from .shapes import python_function
from .simd import IN_PYTHON

P = ParamSpec("P")
R = TypeVar("R")


def interpreted(kernel: Callable[P, R]) -> Callable[P, R]:
    """Return the kernel as a Python function that calls other kernels as such too.

    Numbers that are to be divided by zero must be NumPy's, as those of a buffer are: Python's own raise an error.
    """
    function: Callable[P, R] = _plain(kernel)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return function(*args, **kwargs)

    return call


class NotInterpretableError(TypeError):
    """The error of a kernel that calls one that is compiled at once."""


_COMPILED_AT_ONCE: list[Any] = []


def compiled_at_once(kernel: Callable[P, R]) -> Callable[P, R]:
    """Mark a kernel that does so much that plain Python would only delay it."""
    _COMPILED_AT_ONCE.append(kernel)
    return kernel


def _plain(value: Any) -> Any:
    """Return a kernel as a Python function, a module as one whose kernels are such, and anything else as it is."""
    if isinstance(value, ModuleType):
        return _PlainModule(value)
    if any(value is one for one in _COMPILED_AT_ONCE):
        raise NotInterpretableError(value)
    value = next((plain for machine, plain in IN_PYTHON if value is machine), value)
    return _plain_function(value) if hasattr(value, "py_func") else value


@cache
def _plain_function(value: Any) -> Any:
    function = cast(FunctionType, python_function(value))
    names, used = dict(function.__globals__), function.__code__.co_names
    names |= {name: _plain(names[name]) for name in used if name in names}
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__)


class _PlainModule:
    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        value = self.__dict__[name] = _plain(getattr(self._module, name))
        return value
