"""`@kernel`: compiles a scalar function on floats and tuples, callable from anyone's `@njit` code."""

from collections.abc import Callable
from functools import partial
from typing import Any, ParamSpec, TypeVar, overload

from .numba_private import MISSING

if MISSING:
    from .plain import code_for_callers as code_for_callers
    from .plain import plain_kernel as _compile
else:
    from .announcement import announce_compilation
    from .reduced import code_for_callers as code_for_callers
    from .reduced import reduced_kernel as _compile

    announce_compilation()

P = ParamSpec("P")
R = TypeVar("R")


@overload
def kernel(function: Callable[P, R], /) -> Callable[P, R]: ...
@overload
def kernel(*, inline: bool) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def kernel(function: Any = None, /, *, inline: bool = True) -> Any:
    """Compile at the first call, by strict IEEE rules (no fastmath), and cache on disk where that can be written.

    inline: whether to merge the kernel into its caller's code, for cores of up to some 30 lines; others stay calls.
    """
    return partial(_compile, inline=inline) if function is None else _compile(function, inline=inline)
