"""Kernels as the plain Python functions that they are written as: nothing is compiled, and the bits are the same."""

from collections.abc import Callable
from functools import cache
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeGuard, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from .shapes import python_function

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


def _plain(value: Any) -> Any:
    """Return a kernel as a Python function, a module as one whose kernels are such, and most else as it is."""
    if isinstance(value, ModuleType):
        return _PlainModule(value)
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return memoryview(value.data)  # whose numbers are Python's
    return _plain_function(value) if hasattr(value, "py_func") else value


@cache
def _plain_function(value: Any) -> Any:
    function = cast(FunctionType, python_function(value))
    names, used = dict(function.__globals__), function.__code__.co_names
    names |= {name: _plain(names[name]) for name in used if name in names}
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__)


def on_buffer(function: Callable[P, R]) -> Callable[P, R]:
    """Return a kernel as a Python function that takes its buffers' numbers for Python's: twice as fast as NumPy's.

    Where these are divided by zero, what was done is undone, and done again with NumPy's.
    """

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        before = [(one, one.copy()) for one in args if is_buffer(one)]
        try:
            return function(*(memoryview(one) if is_buffer(one) else one for one in args), **kwargs)  # type: ignore
        except ZeroDivisionError:
            for one, numbers in before:
                one[:] = numbers
            return function(*args, **kwargs)

    return call


def is_buffer(value: Any) -> TypeGuard[NDArray[np.float64]]:
    """Return whether an argument is an array with one axis, of doubles."""
    return isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == np.float64


def size_of_code(kernel: Any) -> int:
    """Return the number of bytes of a kernel and of all that it calls, as Python's code."""
    found: dict[Any, int] = {}
    _measure(kernel, found)
    return sum(found.values())


def _measure(kernel: Any, found: dict[Any, int]) -> None:
    function = getattr(kernel, "py_func", None)
    if function is None or function in found:
        return
    code, known = function.__code__, function.__globals__
    found[function] = len(code.co_code)
    used = [known[name] for name in code.co_names if name in known]
    modules = [one for one in used if isinstance(one, ModuleType)]
    for one in [*used, *(getattr(module, name, None) for module in modules for name in code.co_names)]:
        _measure(one, found)


class _PlainModule:
    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        value = self.__dict__[name] = _plain(getattr(self._module, name))
        return value
