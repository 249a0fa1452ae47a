"""Runs kernels as plain Python functions, as they are written, until compiling them pays; the bits are the same.

Compiling a model's step takes seconds; a thousand steps in plain Python take a tenth of that. A kernel is compiled once
its calls, including those of earlier processes, have taken as long as compiling takes; or earlier, if the known further
calls would. So at most twice the necessary time is spent (ski rental; Karlin, Manasse, Rudolph and Sleator 1988).
A single call that takes longer is given up, and done again by compiled code.
Code that an earlier run has cached on disk is used from the first call on.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock, local
from time import process_time
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeGuard, TypeVar, cast
from weakref import finalize

import numpy as np
from numba import float64, typeof, types

from ..types import Array, Function, python_function
from .code_cache import reached

P = ParamSpec("P")
R = TypeVar("R")


def interpreted(kernel: Callable[P, R]) -> Callable[P, R]:
    """Return the kernel as a Python function, which calls other kernels as Python functions too.

    Numbers that may be divided by zero must be NumPy's, as a buffer's are: Python's own raise ZeroDivisionError.
    """
    function: Callable[P, R] = _plain(kernel)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return function(*args, **kwargs)

    return call


def _plain(value: Any) -> Any:
    """Return a kernel as a Python function, a module with its kernels as such, and most other values unchanged."""
    if isinstance(value, ModuleType):
        return _PlainModule(value)
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return memoryview(value.data)  # its items are Python's numbers
    if value is math.sqrt:  # raises an error below zero, where compiled code returns NaN
        return lambda x: math.nan if x < 0.0 else math.sqrt(x)
    return _plain_function(value) if hasattr(value, "py_func") else value


def _kept_with(kernel: Any, name: str, make: Callable[[], R]) -> R:
    """Return the result of `make`, called once for a kernel, which stores it: it is freed with the kernel."""
    known = vars(kernel)
    return known[name] if name in known else known.setdefault(name, make())  # type: ignore[no-any-return]


def _plain_function(value: Any) -> Any:
    return _kept_with(value, "_plain", lambda: _made_plain(value))


def _made_plain(value: Any) -> Any:
    function = cast(FunctionType, python_function(value))
    names, used = dict(function.__globals__), function.__code__.co_names
    names |= {name: _plain(names[name]) for name in used if name in names}
    plain = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    merged = getattr(value, "targetoptions", {}).get("forceinline", True)  # called too often to check the time
    return plain if merged else _given_up_in_time(plain)


class _TooLongError(Exception):
    """A call in plain Python takes longer than compiling it."""


class _Limit(local):
    """The process's CPU time, s, at which this thread's call is given up."""

    at = math.inf


_LIMIT = _Limit()


def _given_up_in_time(function: Function) -> Function:
    def call(*args: Any) -> Any:
        if process_time() > _LIMIT.at:
            raise _TooLongError
        return function(*args)

    return call


def on_buffer(function: Callable[P, R], kernel: Callable[P, R]) -> Callable[P, R]:
    """Return a function that runs `function` on Python's numbers in its buffers: twice as fast as on NumPy's.

    If such a number is divided by zero, the buffers are restored and `function` runs again, on NumPy's numbers. If a
    number outside the buffers is divided by zero, as one of `where`, or if the call takes too long, the compiled kernel
    runs instead. Any other error, and Ctrl-C, also restores the buffers.
    """

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        before = [(one, one.copy()) for one in args if is_buffer(one)]
        python: Any = (memoryview(one.data) if is_buffer(one) else one for one in args)
        for numbers in (python, args):
            try:
                return function(*numbers, **kwargs)
            except BaseException as error:
                for one, kept in before:
                    one[:] = kept
                if not isinstance(error, ZeroDivisionError | _TooLongError):
                    raise
        return kernel(*args, **kwargs)

    return call


def is_buffer(value: object) -> TypeGuard[Array]:
    """Return whether an argument is an array with one axis, of doubles."""
    return isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype == np.float64


def size_of_code(kernel: Function) -> int:
    """Return the size, in bytes, of Python's bytecode of a kernel and of all kernels that it calls."""
    return sum(len(function.__code__.co_code) for function in reached(python_function(kernel)))


class _PlainModule:
    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        value = self.__dict__[name] = _plain(getattr(self._module, name))
        return value


PATIENCE, PATIENCE_PER_BYTE = 0.2, 8e-5
"""The CPU time, s, that calls in plain Python may take before a kernel is compiled: a constant, and a part per byte of
its bytecode. They are the measured time of compiling where the kernels that many others call are cached."""
TYPICAL = 0.1
"""The part of that time after which further calls are expected to take as long as the calls so far did on average.
Before that the average is too high: the first calls prepare what later ones use."""

HASTE = 0.1
"""The factor on the time that calls in plain Python may take, within `in_haste`."""


def tiered(kernel: Function, calls: int = 1) -> Function:
    """Return the kernel as one that runs in plain Python and is compiled once that pays.

    calls: how many calls are known to come.
    """
    if python_function(kernel) is kernel:  # the JIT is disabled
        return kernel
    tier: Tiered = _kept_with(kernel, "_tier", lambda: Tiered(kernel, on_buffer(interpreted(kernel), kernel)))
    tier.calls = calls
    return tier


@contextmanager
def in_haste() -> Iterator[None]:
    """Compile kernels sooner, for later processes, which find the code but may be slower or run longer."""
    Tiered.share = HASTE
    try:
        yield
    finally:
        Tiered.share = 1.0


def evaluated(kernel: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Return a kernel's result for Python's numbers and tuples, as such; the kernel is compiled if that pays."""
    found: R = _each(tiered(kernel)(*(_each(value, float, np.float64) for value in args)), np.generic, np.generic.item)
    return found  # inside the kernel the numbers are NumPy's, which can be divided by zero


def _each(value: Any, kind: type, convert: Function) -> Any:
    """Return numbers in nested tuples, with those of type `kind` converted."""
    if isinstance(value, tuple | list):
        return tuple(_each(one, kind, convert) for one in value)
    return convert(value) if isinstance(value, kind) else value


def is_kept(kernel: Any, *args: object) -> bool:
    """Return whether a kernel is compiled for such arguments, or its code is on disk, which is then loaded."""
    # `typeof` of an array would load numpy.ma, which takes 10 ms.
    return has_code(kernel, tuple(float64[::1] if is_buffer(x) and x.flags.carray else typeof(x) for x in args))


_LOADING = Lock()
"""Held by the one thread that loads code: to Numba, code that is loaded twice would be two ambiguous overloads."""


def has_code(kernel: Any, signature: tuple[types.Type, ...]) -> bool:
    """Return what `is_kept` does, for arguments of these types."""
    try:
        if signature in kernel.overloads:
            return True
        with _LOADING:
            kept = None if signature in kernel.overloads else kernel._cache.load_overload(signature, kernel.targetctx)
            if kept is not None and signature not in kernel.overloads:
                kernel.add_overload(kept)
        return signature in kernel.overloads
    except Exception:  # Numba's internals differ from those of the versions tried
        return False


def _file_of_time(kernel: Any) -> Path:
    """Return the file, beside a kernel's cached code, with the time, s, that its calls in plain Python have taken."""
    return Path(f"{kernel._cache._cache_file._index_path}.time")


class _Taken:
    """The time, s, of a kernel's calls in plain Python: `now` is in this process, `before` in earlier ones."""

    now, before = 0.0, 0.0

    def keep(self, file: Path, least: float) -> None:
        """Write the sum for later processes, if `now` is above `least`: many short runs then compile in the end."""
        if self.now > least:
            with suppress(OSError):
                file.write_text(str(self.before + self.now), encoding="utf-8")


class Tiered:
    """A kernel that is called in plain Python first, and compiled later; calls: how many calls are known to come."""

    share = 1.0
    """The factor on the patience of all kernels; see `in_haste`."""

    def __init__(self, kernel: Any, plain: Function) -> None:
        self._kernel, self._plain, self.calls = kernel, plain, 1
        self._patience = PATIENCE + PATIENCE_PER_BYTE * size_of_code(kernel)
        self._taken, self._done = _Taken(), 0
        self._call = self._first

    def __call__(self, *args: Any) -> Any:
        """Return what the kernel returns."""
        return self._call(*args)

    @property
    def is_compiled(self) -> bool:
        """Return whether the next call runs compiled code."""
        return self._call is self._kernel

    @property
    def _bound(self) -> float:
        """Return the CPU time, s, that calls in plain Python may take now."""
        return Tiered.share * self._patience

    def _first(self, *args: Any) -> Any:
        self._call = self._kernel if is_kept(self._kernel, *args) else self._interpreted
        if not self.is_compiled:
            with suppress(OSError, AttributeError, ValueError):  # there is no such file, or no cache at all
                file = _file_of_time(self._kernel)
                finalize(self, self._taken.keep, file, TYPICAL * self._patience)  # when it is freed, or at exit
                self._taken.before = float(file.read_text(encoding="utf-8"))
                self._call = self._kernel if self._taken.before > self._bound else self._interpreted
        return self._call(*args)

    def _interpreted(self, *args: Any) -> Any:
        begin = process_time()
        _LIMIT.at = begin + self._bound
        try:
            found = self._plain(*args)
        finally:
            _LIMIT.at = math.inf
        self._done, self.calls = self._done + 1, max(self.calls - 1, 0)
        self._taken.now += process_time() - begin
        now = self._taken.now
        to_come = self.calls * now / self._done if now > TYPICAL * self._bound else 0.0
        if self._taken.before + now + to_come > self._bound or self._kernel.overloads:  # others may have compiled it
            self._call, self._taken.now = self._kernel, 0.0  # later processes will find the code, and need no time
        return found
