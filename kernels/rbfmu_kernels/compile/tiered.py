"""Kernels as plain Python until compiling them pays: the bits are the same, and a short run starts at once.

Compiling a model's step takes a second or more, and a thousand steps in plain Python take a tenth of that. Code that is
kept on disk from an earlier run serves from the first call.
"""

from collections.abc import Callable
from functools import cache
from time import process_time
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import typeof

from .interpreted import NotInterpretableError, interpreted
from .shapes import python_function

P = ParamSpec("P")
R = TypeVar("R")

PATIENCE = 0.3
"""The CPU time, s, that calls in plain Python may take before the kernel is compiled: a small one takes about that."""


@cache
def tiered(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel that is compiled once its calls in plain Python have taken some time, or from the first call."""
    if python_function(kernel) is kernel:  # the JIT is disabled
        return kernel
    try:
        return Tiered(kernel, interpreted(kernel))
    except NotInterpretableError:
        return kernel


def evaluated(kernel: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Return what a kernel makes of Python's numbers and tuples, in such; it is compiled if that pays."""
    found: R = _in_python(tiered(kernel)(*map(_in_numpy, args)))
    return found


def _in_numpy(value: Any) -> Any:
    """Return NumPy's numbers, which can be divided by zero."""
    if isinstance(value, tuple | list):
        return tuple(map(_in_numpy, value))
    return np.float64(value) if isinstance(value, float) else value


def _in_python(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_in_python, value))
    return value.item() if isinstance(value, np.generic) else value


def is_kept(kernel: Any, *args: Any) -> bool:
    """Return whether a kernel's code for such arguments is compiled already, or is kept on disk; it is loaded then."""
    try:
        signature = tuple(map(typeof, args))
        if signature in kernel.overloads:
            return True
        kept = kernel._cache.load_overload(signature, kernel.targetctx)
        if kept is not None:
            kernel.add_overload(kept)
        return kept is not None
    except Exception:  # Numba's internals behave otherwise than where they were tried
        return False


class Tiered:
    """A kernel that is called in plain Python first, and compiled later."""

    def __init__(self, kernel: Any, plain: Callable[..., Any]) -> None:
        self._kernel, self._plain, self._spent = kernel, plain, 0.0
        self._call = self._first

    def __call__(self, *args: Any) -> Any:
        """Return what the kernel returns."""
        return self._call(*args)

    def _first(self, *args: Any) -> Any:
        self._call = self._kernel if is_kept(self._kernel, *args) else self._interpreted
        return self._call(*args)

    def _interpreted(self, *args: Any) -> Any:
        begin = process_time()
        found = self._plain(*args)
        self._spent += process_time() - begin
        if self._spent > PATIENCE or self._kernel.overloads:  # it may be compiled for others meanwhile
            self._call = self._kernel
        return found
