"""Kernels as plain Python until compiling them pays: the bits are the same, and a short run starts at once.

Compiling a model's step takes seconds, and a thousand steps in plain Python take a tenth of that. A kernel is compiled
once its calls have taken the time that compiling takes, or after its first where those to come will take it. Code that
is kept on disk from an earlier run serves from the first call.
"""

import math
from collections.abc import Callable
from functools import cache
from time import process_time
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import float64, typeof

from .interpreted import interpreted, is_buffer, on_buffer, size_of_code
from .shapes import python_function

P = ParamSpec("P")
R = TypeVar("R")

PATIENCE, PATIENCE_PER_BYTE = 0.3, 1.4e-4
"""The CPU time, s, that calls in plain Python may take before a kernel is compiled, and more per byte of its code:
measured, what compiling takes."""


def tiered(kernel: Callable[..., Any], calls: int = 1) -> Callable[..., Any]:
    """Return a kernel that is compiled where its calls in plain Python take longer.

    calls: how many are known to come.
    """
    if python_function(kernel) is kernel:  # the JIT is disabled
        return kernel
    tier = _tier(kernel)
    tier.calls = calls
    return tier


@cache
def _tier(kernel: Any) -> "Tiered":
    return Tiered(kernel, on_buffer(interpreted(kernel)))


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
        signature = tuple(map(_type_of, args))
        if signature in kernel.overloads:
            return True
        kept = kernel._cache.load_overload(signature, kernel.targetctx)
        if kept is not None:
            kernel.add_overload(kept)
        return kept is not None
    except Exception:  # Numba's internals behave otherwise than where they were tried
        return False


def _type_of(value: Any) -> Any:
    """Return Numba's type of an argument; to ask it about an array loads numpy.ma, which takes 10 ms."""
    return float64[::1] if is_buffer(value) and value.flags.carray else typeof(value)


class Tiered:
    """A kernel that is called in plain Python first, and compiled later; calls: how many are known to come."""

    def __init__(self, kernel: Any, plain: Callable[..., Any]) -> None:
        self._kernel, self._plain, self.calls = kernel, plain, 1
        self._patience = PATIENCE + PATIENCE_PER_BYTE * size_of_code(kernel)
        self._shortest = math.inf
        self._call = self._first

    def __call__(self, *args: Any) -> Any:
        """Return what the kernel returns."""
        return self._call(*args)

    @property
    def is_compiled(self) -> bool:
        """Return whether the next call is one of compiled code."""
        return self._call is self._kernel

    def _first(self, *args: Any) -> Any:
        self._call = self._kernel if is_kept(self._kernel, *args) else self._interpreted
        return self._call(*args)

    def _interpreted(self, *args: Any) -> Any:
        begin = process_time()
        found = self._plain(*args)
        taken = process_time() - begin
        self._patience -= taken
        self._shortest, self.calls = min(self._shortest, taken), max(self.calls - 1, 0)
        if self.calls * self._shortest > self._patience or self._kernel.overloads:  # others may have compiled it
            self._call = self._kernel
        return found
