"""Kernels as the plain Python functions that they are written as, until compiling them pays: the bits are the same.

Compiling a model's step takes seconds, and a thousand steps in plain Python take a tenth of that. A kernel is compiled
once its calls have taken the time that compiling takes, those of earlier processes too, or after its first where those
to come will take it: so at most twice what is needed is spent (ski rental; Karlin, Manasse, Rudolph and Sleator 1988).
A call that alone takes longer is given up, and done again by compiled code.
Code that is kept on disk from an earlier run serves from the first call.
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
    if value is math.sqrt:  # which raises an error below zero, where compiled code has NaN
        return lambda x: math.nan if x < 0.0 else math.sqrt(x)
    return _plain_function(value) if hasattr(value, "py_func") else value


def _kept_with(kernel: Any, name: str, make: Callable[[], R]) -> R:
    """Return what is made of a kernel once, and goes when the kernel goes."""
    known = vars(kernel)
    return known[name] if name in known else known.setdefault(name, make())  # type: ignore[no-any-return]


def _plain_function(value: Any) -> Any:
    return _kept_with(value, "_plain", lambda: _made_plain(value))


def _made_plain(value: Any) -> Any:
    function = cast(FunctionType, python_function(value))
    names, used = dict(function.__globals__), function.__code__.co_names
    names |= {name: _plain(names[name]) for name in used if name in names}
    plain = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
    merged = getattr(value, "targetoptions", {}).get("forceinline", True)  # into its caller: there are many such calls
    return plain if merged else _given_up_in_time(plain)


class _TooLongError(Exception):
    """A call in plain Python takes longer than compiling it."""


class _Limit(local):
    """The CPU time of the process, s, at which this thread's call is given up."""

    at = math.inf


_LIMIT = _Limit()


def _given_up_in_time(function: Function) -> Function:
    def call(*args: Any) -> Any:
        if process_time() > _LIMIT.at:
            raise _TooLongError
        return function(*args)

    return call


def on_buffer(function: Callable[P, R], kernel: Callable[P, R]) -> Callable[P, R]:
    """Return a kernel as a Python function that takes its buffers' numbers for Python's: twice as fast as NumPy's.

    Where these are divided by zero, what was done is undone, and done again with NumPy's; where a number that is no
    buffer's is, as one of `where`, and where it takes too long, by the kernel itself. What Ctrl-C stops is undone.
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
    """Return the number of bytes of a kernel and of all that it calls, as Python's code."""
    return sum(len(function.__code__.co_code) for function in reached(python_function(kernel)))


class _PlainModule:
    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        value = self.__dict__[name] = _plain(getattr(self._module, name))
        return value


PATIENCE, PATIENCE_PER_BYTE = 0.2, 8e-5
"""The CPU time, s, that calls in plain Python may take before a kernel is compiled, and more per byte of its code:
measured, what compiling takes where what many kernels call is kept."""
TYPICAL = 0.1
"""The part of that time after which calls to come are taken to last as long as those before on average: the first ones
prepare what later ones use."""

HASTE = 0.1
"""The part of the time that calls in plain Python may take `in_haste`."""


def tiered(kernel: Function, calls: int = 1) -> Function:
    """Return a kernel that is compiled where its calls in plain Python take longer.

    calls: how many are known to come.
    """
    if python_function(kernel) is kernel:  # the JIT is disabled
        return kernel
    tier: Tiered = _kept_with(kernel, "_tier", lambda: Tiered(kernel, on_buffer(interpreted(kernel), kernel)))
    tier.calls = calls
    return tier


@contextmanager
def in_haste() -> Iterator[None]:
    """Compile kernels sooner: for processes to come, which find their code, though they may be slower or run longer."""
    Tiered.share = HASTE
    try:
        yield
    finally:
        Tiered.share = 1.0


def evaluated(kernel: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """Return what a kernel makes of Python's numbers and tuples, in such; it is compiled if that pays."""
    found: R = _each(tiered(kernel)(*(_each(value, float, np.float64) for value in args)), np.generic, np.generic.item)
    return found  # inside the kernel they are NumPy's, which can be divided by zero


def _each(value: Any, kind: type, convert: Function) -> Any:
    """Return numbers in nested tuples, those of a kind converted."""
    if isinstance(value, tuple | list):
        return tuple(_each(one, kind, convert) for one in value)
    return convert(value) if isinstance(value, kind) else value


def is_kept(kernel: Any, *args: object) -> bool:
    """Return whether a kernel's code for such arguments is compiled already, or is kept on disk; it is loaded then."""
    # To ask Numba about an array loads numpy.ma, which takes 10 ms.
    return has_code(kernel, tuple(float64[::1] if is_buffer(x) and x.flags.carray else typeof(x) for x in args))


_LOADING = Lock()
"""Of two threads that load the same code one waits: Numba takes code that is there twice for two that both serve."""


def has_code(kernel: Any, signature: tuple[types.Type, ...]) -> bool:
    """Return the same for arguments of these types."""
    try:
        if signature in kernel.overloads:
            return True
        with _LOADING:
            kept = None if signature in kernel.overloads else kernel._cache.load_overload(signature, kernel.targetctx)
            if kept is not None and signature not in kernel.overloads:
                kernel.add_overload(kept)
        return signature in kernel.overloads
    except Exception:  # Numba's internals behave otherwise than where they were tried
        return False


def _file_of_time(kernel: Any) -> Path:
    """Return where it is kept, beside a kernel's code, what its calls in plain Python have taken, s."""
    return Path(f"{kernel._cache._cache_file._index_path}.time")


class _Taken:
    """What calls of a kernel in plain Python have taken, s: of this process, and of those before."""

    now, before = 0.0, 0.0

    def keep(self, file: Path, least: float) -> None:
        """Keep it for later processes, so that who runs scene after scene compiles at last; not what is little."""
        if self.now > least:
            with suppress(OSError):
                file.write_text(str(self.before + self.now), encoding="utf-8")


class Tiered:
    """A kernel that is called in plain Python first, and compiled later; calls: how many are known to come."""

    share = 1.0
    """The part of their patience that all have, see `in_haste`."""

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
        """Return whether the next call is one of compiled code."""
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
                finalize(self, self._taken.keep, file, TYPICAL * self._patience)  # when it goes, or the process ends
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
            self._call, self._taken.now = self._kernel, 0.0  # which nobody has to know any more
        return found
