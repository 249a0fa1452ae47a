"""`@kernel`: compiles a scalar function on floats and tuples, callable from anyone's `@njit` code.

Where Numba's internals cannot be used, its documented `njit` compiles: the first call is slower, the bits are the same.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, ParamSpec, TypeVar, overload

from numba import njit

from ..types import Function
from . import codegen, numba_private
from .code_cache import kept_on_disk, named as named

P = ParamSpec("P")
R = TypeVar("R")


def _plain_kernel(function: Function, *, inline: bool) -> Any:
    """Return the kernel of a function.

    Compiled callers use a twin without a wrapper for Python and without reference counts of buffers, which halves the
    time of a first call. Where Numba lacks these options, they use the kernel itself.
    """
    compiled = kept_on_disk(
        lambda cache: njit(error_model="numpy", nogil=True, forceinline=inline, cache=cache)(function)
    )
    with suppress(Exception):
        twin = njit(nogil=True, forceinline=inline, _nrt=False, **numba_private.CALLED_BY_CODE)(function)
        compiled.get_call_template, compiled.get_overload = twin.get_call_template, twin.get_overload
    return compiled


def _plain_code_for_callers(function: Function, signature: codegen.Signature) -> object:
    """Return the function compiled for one signature, for compiled callers only."""
    return njit(signature, **numba_private.CALLED_BY_CODE)(function)


def _plain_loop(function: Function, signature: object) -> Any:
    return kept_on_disk(lambda cache: njit(signature, error_model="numpy", nogil=True, cache=cache)(function))


if numba_private.MISSING:
    _compile, code_for_callers, loop = _plain_kernel, _plain_code_for_callers, _plain_loop
else:
    from .compiler import code_for_callers as code_for_callers, loop as loop, reduced_kernel as _compile
    from .said import Announcer

    numba_private.register("numba:compile", Announcer())


@overload
def kernel(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def kernel(*, inline: bool) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def kernel(function: Any = None, /, *, inline: bool = True) -> Any:
    """Return a kernel that compiles at its first call, by strict IEEE rules (no fastmath), cached on disk if possible.

    inline: whether the kernel is merged into its callers' code, for up to some 30 lines; longer kernels stay calls.
    """
    return partial(_compile, inline=inline) if function is None else _compile(function, inline=inline)
