"""A model, and the entry functions that all share: `initialize` and `step` around its own `set_up` and `advance`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, NamedTuple

from ..buffer import STEP_REJECTED, Layout
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import State
from ..rotations.vec3 import dot
from ..types import Array, Buffer, Indices, python_function
from .memory import initialize_body, put_centre, put_rotation
from .outputs import feedthrough, first_outputs, output_rates, outputs

Entry = Callable[[Buffer], int]
Step = Callable[[Buffer, float], int]


class Lanes(NamedTuple):
    """The function that runs members of an ensemble (`body.members`) side by side, `simd.WIDEST` at a time.

    SCRATCH: how many numbers of work space it needs, which begins at a cache line. through: the same function for runs
    whose outputs are interpolated, see `Model.run_through`.
    """

    run: Callable[..., None]
    SCRATCH: int
    through: Callable[..., None] | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """A model: the layout of its buffer, and kernels over that buffer, its whole memory: a copy of it is a snapshot.

    name: module and constant, as `models.model_named` takes it. BLOCKS, SIZE: the places of the buffer's blocks, and
    its size. initialize: returns 0, or a key of `buffer.FAULTS`. step: takes the buffer and h, s; returns `buffer.OK`
    or `buffer.STEP_REJECTED`. outputs, output_rates: refresh the outputs, or their time derivatives. feedthrough: see
    `outputs.feedthrough`. ORDERS: the orders that a plan may set, if any. lanes: a function that returns the functions
    for many bodies at once, if there are any. run_through: takes a whole run, whose outputs are interpolated between
    substeps, if it can: see `loaded.run_through`.
    """

    name: str
    BLOCKS: dict[str, slice]
    SIZE: int
    initialize: Entry
    step: Step
    outputs: Entry = outputs
    output_rates: Entry = output_rates
    feedthrough: Callable[[Buffer, Buffer], int] = feedthrough
    ORDERS: Sequence[int] = ()
    lanes: Callable[[], Lanes] | None = None
    run_through: Callable[[Buffer, Array, Indices, Array, Array], int] | None = None


# What templates are bound to, see `bind`: a model's own functions.
_missing: Any = None
set_up: Entry = _missing
advance: Step = _missing


def initialize(z: Buffer) -> int:
    """Check the parameters, and set state and outputs; return 0 or a key of `buffer.FAULTS`."""
    return initialize_body(z) or set_up(z) or first_outputs(z)


def step(z: Buffer, h: float) -> int:
    """Advance by h, s; return STEP_REJECTED, with nothing changed, where that cannot be done within the model."""
    return advance(z, h) if h > 0.0 else STEP_REJECTED


def make_model(constant: str, layout: Layout, own_set_up: Entry, own_advance: Step, **fields: Any) -> Model:
    """Return a model of a body.

    constant: the model's name in the module of its functions. own_set_up: sets the model's own blocks after
    `initialize_body`, and returns 0 or a key of `buffer.FAULTS`. own_advance: takes a step h > 0 and refreshes the
    outputs, or returns STEP_REJECTED. fields: further fields of `Model`.
    """
    module = python_function(own_advance).__module__
    return Model(
        f"{module.rpartition('.')[2]}.{constant}",
        *layout,
        initialize=bind(initialize, module, constant, set_up=own_set_up),
        step=bind(step, module, constant, advance=own_advance),
        **fields,
    )


@kernel
def commit_motion(z: Buffer, motion: State) -> int:
    """Set the state and refresh the outputs; return STEP_REJECTED, with nothing changed, where it is not finite."""
    r, v, q, w = motion
    if not math.isfinite(dot(r, r) + dot(v, v) + dot(w, w) + q[0] + q[1] + q[2] + q[3]):
        return STEP_REJECTED
    put_centre(z, r, v)
    put_rotation(z, q, w)
    return outputs(z)


def bind(template: Any, module: str, constant: str, inline: bool = False, **own: Any) -> Any:
    """Compile a template with a model's functions as its globals.

    The result is no closure, because Numba's cache on disk does not recognise a closure in another process. The cache
    distinguishes functions of one file by their qualified names.
    """
    function = FunctionType(template.__code__, template.__globals__ | own, template.__name__)
    function.__doc__, function.__annotations__ = template.__doc__, template.__annotations__
    function.__module__, function.__qualname__ = module, f"{constant}.{template.__name__}"
    return kernel(inline=inline)(function)
