"""Numba's cache of compiled code on disk, stamped with all sources of the kernels."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from os.path import exists
from typing import Any

from .compiler import CalleeCache
from .numba_private import FunctionCache, IndexDataCacheFile, NullCache, global_compiler_lock, rtsys
from .stamp import SOURCES

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
            cache._cache_file = IndexDataCacheFile(cache._cache_path, name, SOURCES)
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
        with suppress(OSError, AttributeError):
            path = f"{kept._cache_file._index_path}.lock"
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
            fcntl.flock(handle, fcntl.LOCK_EX)
        try:
            yield
        finally:
            if handle is not None:
                with suppress(OSError):
                    os.unlink(path)  # who waits gets the lock still; who comes now makes a new file, and finds code
                os.close(handle)
