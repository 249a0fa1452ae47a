"""The entry functions that all models share: `initialize` and `step` around a model's own `set_up` and `advance`.

A model is a module with the layout of its buffer (BLOCKS, SIZE) and `initialize`, `step`, `outputs`, `output_rates`,
`feedthrough` over that buffer, its whole memory: a copy of its bytes is a snapshot.
"""

import math
from collections.abc import Callable
from types import FunctionType
from typing import Any

from ..buffer import STEP_REJECTED
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import State
from ..rotations.vec3 import dot
from .feedthrough import feedthrough
from .memory import initialize_body, put_motion
from .outputs import first_outputs, output_rates, outputs

__all__ = ["commit_motion", "entry_functions", "feedthrough", "output_rates", "outputs"]


def set_up(z: Any) -> int:
    """Stand for a model's own function in the template `initialize`."""
    raise NotImplementedError


def advance(z: Any, h: float) -> int:
    """Stand for a model's own function in the template `step`."""
    raise NotImplementedError


def initialize(z: Any) -> int:
    """Check the parameters, and set state and outputs; return 0 or a key of `buffer.FAULTS`."""
    return initialize_body(z) or set_up(z) or first_outputs(z)


def step(z: Any, h: float) -> int:
    """Advance by h, s; return STEP_REJECTED, with nothing changed, where that cannot be done within the model."""
    return advance(z, h) if h > 0.0 else STEP_REJECTED


def entry_functions(
    model: str, own_set_up: Callable[[Any], int], own_advance: Callable[[Any, float], int]
) -> tuple[Callable[[Any], int], Callable[[Any, float], int]]:
    """Return `initialize` and `step` of a model.

    model: its module's name; own_set_up: sets the model's own blocks, once the body has been taken, and returns 0 or a
    key of `buffer.FAULTS`; own_advance: takes a step h > 0 and refreshes the outputs, or returns STEP_REJECTED.
    """
    return _bound(initialize, model, set_up=own_set_up), step_function(model, own_advance)


def step_function(model: str, own_advance: Callable[[Any, float], int]) -> Callable[[Any, float], int]:
    """Return `step` of a model that has an `initialize` of its own."""
    return _bound(step, model, advance=own_advance)  # type: ignore[no-any-return]


@kernel
def commit_motion(z: Any, motion: State) -> int:
    """Set the state and refresh the outputs; return STEP_REJECTED, with nothing changed, where it is not finite."""
    r, v, q, w = motion
    if not math.isfinite(dot(r, r) + dot(v, v) + dot(w, w) + q[0] + q[1] + q[2] + q[3]):
        return STEP_REJECTED
    put_motion(z, motion)
    return outputs(z)


def _bound(template: Any, model: str, **own: Any) -> Any:
    """Compile a template with the model's functions as its globals.

    The result is not a closure, as Numba's cache on disk would not know one again in another process. The cache tells
    functions of one file apart by their qualified names.
    """
    function = FunctionType(template.__code__, template.__globals__ | own, template.__name__)
    function.__doc__, function.__annotations__ = template.__doc__, template.__annotations__
    function.__module__, function.__qualname__ = model, f"{model.rpartition('.')[2]}.{template.__name__}"
    return kernel(inline=False)(function)
