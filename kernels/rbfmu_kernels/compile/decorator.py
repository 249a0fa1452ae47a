"""`@kernel`: compiles a scalar function on floats and tuples, callable from anyone's `@njit` code."""

import hashlib
from collections.abc import Callable
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, overload

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.runtime import rtsys

from .compiler import CalleeCache, CalleeCompiler, KernelCompiler


def _hash_of_sources(package: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = _hash_of_sources(Path(__file__).parents[1])
"""Stamp of cached code: Numba's own sees a function's file, not those of the functions that it calls."""

P = ParamSpec("P")
R = TypeVar("R")


class Cache:
    """Numba's cache of a function's compiled code on disk, none where no folder for it can be written.

    Looked for at the first use, and read without loading Numba's compiler first: it costs 0.2 s and is not needed.
    """

    def __init__(self, function: Callable[..., Any], kind: Any = FunctionCache) -> None:
        self._function, self._kind = function, kind

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return stored code, or None."""
        rtsys.initialize(context)  # object code names its functions, and must find all that it names
        return self._cache._load_overload(signature, context)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    @cached_property
    def _cache(self) -> Any:
        try:
            cache = self._kind(self._function)
        except RuntimeError:
            return _NoCache()
        name = cache._impl.filename_base + ("-callee" if self._kind is CalleeCache else "")
        cache._cache_file = IndexDataCacheFile(cache._cache_path, name, SOURCES)
        return cache


class _NoCache(NullCache):  # type: ignore[misc]
    def _load_overload(self, signature: Any, context: Any) -> None:
        return None


@overload
def kernel(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def kernel(*, inline: bool) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def kernel(function: Any = None, /, *, inline: bool = True) -> Any:
    """Compile lazily, strict IEEE (no fastmath: one result everywhere), cached on disk where that can be written.

    inline: merge into the caller's code, for cores of up to some 30 lines; others stay calls.
    """
    if function is None:
        return partial(_compile, inline=inline)
    return _compile(function, inline=inline)


def _compile(function: Callable[P, R], *, inline: bool) -> Callable[P, R]:
    # _nrt: kernels allocate nothing, and counting references to a buffer costs half of a small unit's step
    compile_ = partial(njit, error_model="numpy", nogil=True, forceinline=inline, _nrt=False)
    compiled = compile_(pipeline_class=KernelCompiler)(function)
    if hasattr(compiled, "_cache"):  # not where the JIT is disabled
        compiled._cache = Cache(function)
        _compile_callees_bare(compiled, compile_, inline)
    return compiled  # type: ignore[no-any-return]


def _compile_callees_bare(compiled: Any, compile_: Any, inline: bool) -> None:
    """Let compiled callers have the function without machine code of its own and what Python needs to call it."""

    @cache
    def bare() -> Any:
        options = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": CalleeCompiler}
        callee = compile_(**options)(compiled.py_func)
        if not inline:  # what is merged into its caller is sooner compiled than stored
            callee._cache = Cache(compiled.py_func, CalleeCache)
        return callee

    compiled.get_call_template = lambda args, kws: bare().get_call_template(args, kws)
    compiled.get_overload = lambda sig: bare().get_overload(sig)
