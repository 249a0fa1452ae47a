"""`@kernel`: compiles a scalar function on floats and tuples, callable from anyone's `@njit` code."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, overload

from numba import njit


def _hash_of_sources() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


SOURCES = _hash_of_sources()
"""Stamp of cached code: Numba's own sees a function's file, not those of the functions that it calls."""

P = ParamSpec("P")
R = TypeVar("R")


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
    options: dict[str, Any] = {"error_model": "numpy", "nogil": True, "forceinline": inline, "_nrt": False}
    try:
        compiled = njit(cache=True, **options)(function)
    except RuntimeError:  # no folder for the cache can be written
        return njit(**options)(function)  # type: ignore[no-any-return]
    if hasattr(compiled, "_cache"):  # not where the JIT is disabled
        compiled._cache._cache_file._source_stamp = SOURCES
    return compiled  # type: ignore[no-any-return]
