"""Kernels by Numba's compiler with fewer passes, cached on disk with a stamp of all sources of the kernels."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property, partial
from os.path import exists
from typing import Any

from numba import njit, types

from .compiler import CalleeCache, CalleeCompiler, KernelCompiler
from .numba_private import (
    CALLED_BY_CODE,
    Compiler,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
    global_compiler_lock,
    rtsys,
)
from .stamp import stamp_of

try:
    import fcntl
except ImportError:  # Windows: each process compiles for itself
    fcntl = None  # type: ignore[assignment]


class DiskCache:
    """The cache of one function; none where no folder for it can be written, or where Numba's cannot be used.

    It is looked for at the first use, and read without loading Numba's compiler, which costs 0.2 s and is not needed.
    """

    def __init__(self, function: Callable[..., Any], kind: Any = FunctionCache) -> None:
        self._function, self._kind = function, kind

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return stored code, or None where there is none."""
        try:
            if not exists(self._cache._cache_file._index_path):
                return None  # before what follows, which takes 25 ms the first time
            rtsys.initialize(context)  # object code names its functions, and must find all that it names
            return self._cache._load_overload(signature, context)
        except Exception:  # Numba's internals behave otherwise than where they were tried
            return None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    @cached_property
    def _cache(self) -> Any:
        try:
            cache = self._kind(self._function)
            name = cache._impl.filename_base + ("-callee" if self._kind is CalleeCache else "")
            cache._cache_file = IndexDataCacheFile(cache._cache_path, name, stamp_of(self._function))
        except (RuntimeError, AttributeError, TypeError):
            return NullCache()
        return cache


@contextmanager
def made_once(kept: Any) -> Iterator[None]:
    """Let one process at a time compile what a cache keeps, so that those which wait find what the first has made.

    Where files cannot be locked, each compiles. Threads wait at Numba's own lock, which comes first: one that had the
    file's lock and waited for Numba's would be waited for by the one that has Numba's and compiles a caller.
    """
    with global_compiler_lock:
        handle, path = None, ""
        with suppress(OSError, AttributeError):  # the latter also without fcntl: then no file is left behind
            locked = fcntl.flock
            path = f"{kept._cache_file._index_path}.lock"
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            locked(handle, fcntl.LOCK_EX)
        try:
            yield
        finally:
            if handle is not None:
                with suppress(OSError):
                    os.unlink(path)  # who waits gets the lock still; who comes now makes a new file, and finds code
                os.close(handle)


def reduced_kernel(function: Callable[..., Any], *, inline: bool) -> Any:
    """Return the kernel of a function."""
    compiled = _njit(inline)(pipeline_class=pipeline)(function)
    if hasattr(compiled, "_cache"):  # not where the JIT is disabled
        _keep_on_disk(compiled, DiskCache(function))
        _compile_callees_bare(compiled, inline)
    return compiled


def _njit(inline: bool) -> Any:
    # _nrt: kernels allocate nothing, and counting references to a buffer costs half of a small model's step
    return partial(njit, error_model="numpy", nogil=True, forceinline=inline, _nrt=False)


def _keep_on_disk(dispatcher: Any, kept: DiskCache) -> None:
    compiled = dispatcher.compile

    def compile_once(signature: Any) -> Any:
        with made_once(kept):
            return compiled(signature)

    dispatcher._cache, dispatcher.compile = kept, compile_once


def _compile_callees_bare(compiled: Any, inline: bool) -> None:
    """Let compiled callers have the function without machine code of its own and what Python needs to call it."""
    as_numba_does = compiled.get_call_template, compiled.get_overload

    @cache
    def bare() -> Any:
        callee = _bare(compiled.py_func, inline)
        if not inline:  # what is merged into its caller is sooner compiled than stored
            _keep_on_disk(callee, DiskCache(compiled.py_func, CalleeCache))
        return callee.get_call_template, callee.get_overload

    def template_and_overload() -> Any:
        return bare() if internals_serve() else as_numba_does

    @cache
    def template(args: Any) -> Any:
        return template_and_overload()[0](args, {})

    def template_of(args: Any, kws: Any) -> Any:
        args = tuple(map(types.unliteral, args))
        return template_and_overload()[0](args, kws) if kws else template(args)

    # a number that is known at compile time is no type of its own: one function serves all, and LLVM merges numbers
    compiled.get_call_template = template_of
    compiled.get_overload = lambda sig: template_and_overload()[1](sig)


def _bare(function: Callable[..., Any], inline: bool) -> Any:
    return _njit(inline)(pipeline_class=CalleeCompiler, **CALLED_BY_CODE)(function)


def code_for_callers(function: Callable[..., Any], signature: Any) -> Any:
    """Return what Numba compiles of a function that is called by compiled code only: the same on every processor."""
    compiler = CalleeCompiler if internals_serve() else Compiler
    return njit(signature, pipeline_class=compiler, **CALLED_BY_CODE)(function)


def pipeline(*state: Any) -> Any:
    """Return the compiler of a function: that of kernels, or Numba's own where the internals behave otherwise."""
    return (KernelCompiler if internals_serve() else Compiler)(*state)


@cache
def internals_serve() -> bool:
    """Tell whether Numba's internals make right code of a small kernel and of one that it calls.

    This is asked before anything is compiled.
    """
    callee = _bare(lambda x: x + 1.0, False)
    try:
        return bool(_njit(False)(pipeline_class=KernelCompiler)(lambda x: 2.0 * callee(x))(2.0) == 6.0)
    except Exception:
        return False
