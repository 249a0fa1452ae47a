"""Models of one scene's formulas: templates bound to generated kernels and to places of a buffer, one body or several.

`run_in_lanes` and the functions that it calls are templates too, for members of an ensemble side by side in lanes. Most
of the time goes into making series, the same operations for every body: they are done for several bodies at once. All
else (step sizes, corners, events, outputs) is done for each body in its own buffer by the code of single runs. Each
lane follows its own body, whatever the times of the others, until that needs its next series.

`initialize_over`, `step_over` and `outputs_over` are for outputs of your own over a closed form; such outputs are
functions of its motion and of the time.
"""

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any

from ..body import lanes
from ..body.lanes import MEMBER, PIECE, STATUS, begin_next, run_on
from ..body.members import Control, Driving, Members, Room, Run
from ..body.shell import Lanes, Model, bind, make_model
from ..buffer import OK, STEP_REJECTED, Layout
from ..buffer_access import copy_numbers, pair_at, put_pair_at
from ..compile.simd import WIDEST, lane_at, put_lane_at, wide_at, width_of
from ..numerics import double_double as dd
from ..types import Array, Buffer
from . import formulas
from .formulas import begin_step, evaluate_at_end, go_on_by_series, prepare_series, reaches_over, settle_sides

SETTLED = STATUS + 1
"""The mark that says whether all sides agree with the last series of a lane."""

# What templates are bound to, see `formulas`.
_missing: Any = None
initialize = wide_constants = wide_first = wide_further = values = loads = begin = advance = refresh = _missing
_places: tuple[int, ...] = ()
INPUTS = RATES = RATES_2 = STATES = _places
SHOWN: tuple[float, ...] = ()
NUMBER_OF_INPUTS = NUMBER_OF_SIDES = NUMBER_TOUCHING = NUMBER_RISING = SIDES = ORDER = WORK = ROWS = ROW = 0
WIDE_ROW = RESTING = TIME = STARTS = ACTIVE = KEPT = MEMORY = MEMORY_SIZE = 0


def put_head_in_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Copy all numbers of a body but its work space into a lane."""
    for i in range(WORK):
        put_lane_at(c, i, lane, z[i])


def put_starts_in_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Copy what changes from series to series into a lane: states, inputs, sides, roots that count as zero."""
    for i in range(len(STATES)):
        put_lane_at(c, ROWS + i, lane, z[ROWS + i])
    for i in range(NUMBER_OF_INPUTS):
        put_lane_at(c, INPUTS[i], lane, z[INPUTS[i]])
        put_lane_at(c, RATES[i], lane, z[RATES[i]])
        put_lane_at(c, RATES_2[i], lane, z[RATES_2[i]])
    for i in range(NUMBER_OF_SIDES):
        put_lane_at(c, SIDES + i, lane, z[SIDES + i])
    for i in range(NUMBER_TOUCHING):
        put_lane_at(c, RESTING + i, lane, z[RESTING + i])


def take_series_of_lane(z: Buffer, c: Buffer, lane: int) -> None:
    """Copy a body's series, of its states and of the numbers that end series, out of a lane."""
    for k in range(int(z[ORDER]) + 1):
        for i in range(len(STATES) + NUMBER_OF_SIDES + 2 * NUMBER_TOUCHING + NUMBER_RISING):
            z[ROWS + k * ROW + i] = lane_at(c, ROWS + k * WIDE_ROW + i, lane)


def make_series_of_lanes(c: Buffer, buffers: Array, marks: Array) -> None:
    """Make the series of all lanes, again where sides change; the series of other lanes then get the same bits."""
    n = 0
    for lane in range(width_of(c)):
        z = buffers[lane]
        marks[lane, SETTLED] = 1.0
        if marks[lane, MEMBER] >= 0.0:
            n = int(z[ORDER])
            prepare_series(z)
            marks[lane, SETTLED] = 0.0
    for _ in range(3 * NUMBER_OF_SIDES + NUMBER_TOUCHING + 1):
        for lane in range(width_of(c)):
            if marks[lane, SETTLED] == 0.0:
                put_starts_in_lane(buffers[lane], c, lane)
        wide_constants(c, WORK)
        wide_first(c, WORK)
        for k in range(1, n):
            wide_further(c, WORK, k)
        all_settled = True
        for lane in range(width_of(c)):
            if marks[lane, SETTLED] == 0.0:
                take_series_of_lane(buffers[lane], c, lane)
                marks[lane, SETTLED] = 1.0 if settle_sides(buffers[lane]) else 0.0
                all_settled = all_settled and marks[lane, SETTLED] != 0.0
        if all_settled:
            break


def go_on(z: Buffer, h: float) -> int:
    """Begin a step and advance as far as the present series reaches; return a status, or PENDING."""
    return evaluate_at_end(z, h) if reaches_over(z, h) else begin_step(z, h)


def run_in_lanes(
    control: Control, members: Members, driving: Driving, room: Room, buffers: Array, states: Array, marks: Array,
    scratch: Array,
) -> None:  # fmt: skip
    """Run members of an ensemble side by side: see `body.members`.

    buffers (b, SIZE), states (b, k), marks (b, MARKS): one row for each lane; scratch: for all lanes.
    """
    run, c, i, busy = Run(control, members, driving, room), wide_at(scratch, 0, WIDEST), 0, 0
    for lane in range(width_of(c)):
        i = begin_in_lane(buffers[lane], states[lane], marks[lane], c, lane, i, run)
        busy += 1 if marks[lane, MEMBER] >= 0.0 else 0
    while busy > 0:
        make_series_of_lanes(c, buffers, marks)
        for lane in range(width_of(c)):
            z, state, mark = buffers[lane], states[lane], marks[lane]
            if mark[MEMBER] < 0.0:
                continue
            mark[STATUS] = go_on_by_series(z, driving.lengths[int(mark[PIECE])], mark[SETTLED] != 0.0)
            if not run_on(z, state, mark, run):
                i = begin_in_lane(z, state, mark, c, lane, i, run)
                busy -= 1 if mark[MEMBER] < 0.0 else 0


def begin_in_lane(z: Buffer, state: Array, mark: Array, c: Buffer, lane: int, i: int, run: Run) -> int:
    """Begin in a lane the next member, from number i on, that needs a series; return the number of the one after it."""
    i = begin_next(z, state, mark, i, run)
    if mark[MEMBER] >= 0.0:
        put_head_in_lane(z, c, lane)
    return i


# Outputs of your own over a closed form


def initialize_over(z: Buffer) -> int:
    """Set up the closed form, with the quantities that own outputs read among its outputs, then own outputs."""
    loads(z)
    for i in range(len(SHOWN)):
        z[ACTIVE + i] = max(z[ACTIVE + i], SHOWN[i])
    put_pair_at(z, TIME, (z[STARTS], 0.0))
    return begin(z) or values(z)  # type: ignore[no-any-return]


def step_over(z: Buffer, h: float) -> int:
    """Advance the closed form by h; reject the step and change nothing where an output is not finite."""
    copy_numbers(z, MEMORY, KEPT, MEMORY_SIZE)
    if advance(z, h) == OK:
        put_pair_at(z, TIME, dd.add_float(pair_at(z, TIME), h))
        if values(z) == 0:
            return OK
    copy_numbers(z, KEPT, MEMORY, MEMORY_SIZE)
    return STEP_REJECTED


def outputs_over(z: Buffer) -> int:
    """Refresh the outputs."""
    return refresh(z) or values(z)  # type: ignore[no-any-return]


# Binding

Kernels = Mapping[str, Callable[..., Any]]
_HOME = formulas.__name__
"""The module of all that is bound."""
_TEMPLATES = f"{__package__}.formula", lanes.__name__
"""The beginnings of the names of modules whose functions are templates."""


def _bound(template: Callable[..., Any], constant: str, own: dict[str, Any]) -> Any:
    """Return a template's kernel with `own` as its globals, to which the templates that it calls are added, bound
    first.

    constant: a name that no other scene's kernels have.
    """
    assert isinstance(template, FunctionType)
    for name in template.__code__.co_names:
        called = template.__globals__.get(name)
        if isinstance(called, FunctionType) and called.__module__.startswith(_TEMPLATES) and name not in own:
            own[name] = _bound(called, constant, own)
    return bind(template, _HOME, constant, **own)


def make_formulas(constant: str, layout: Layout, generated: Kernels, places: Mapping[str, Any]) -> Model:
    """Return the model of one scene's formulas.

    constant: a name that no other scene's formulas have; generated: its kernels, by name; places: the values of the
    templates' globals.
    """
    own = {**places, **generated}
    advance = _bound(formulas.advance_formulas, constant, own)
    set_up = _bound(formulas.set_up_formulas, constant, own)
    shown = {"outputs": _bound(formulas.outputs_now, constant, own), "feedthrough": generated["feedthrough"]}
    return make_model(constant, layout, set_up, advance, ORDERS=formulas.ORDERS, **shown)


def make_over(constant: str, base: Model, layout: Layout, generated: Kernels, places: Mapping[str, Any]) -> Model:
    """Return the model of own outputs over a closed form; further arguments: see `make_formulas`.

    base: the closed form's model, with whose blocks the layout begins.
    """
    own = {**places, **generated, "begin": base.initialize, "advance": base.step, "refresh": base.outputs}
    return Model(
        f"formulas.{constant}",
        *layout,
        initialize=_bound(initialize_over, constant, own),
        step=_bound(step_over, constant, own),
        outputs=_bound(outputs_over, constant, own),
        output_rates=base.output_rates,
        feedthrough=generated["feedthrough"],
    )


def make_lanes(model: Model, own: Mapping[str, Any], constant: str, wide: Mapping[str, Any]) -> Lanes:
    """Return the function that runs many bodies of a model at once, and its work space.

    own: the kernels and places that `make_formulas` was given; constant: a name that no other kernels have; wide: the
    kernels of series over wide numbers, by name, and WIDE_ROW, the length of a row of their coefficients.
    """
    found = {**own}
    _bound(formulas.advance_formulas, model.name.partition(".")[2], found)  # functions that lanes call as well
    found |= {**wide, "initialize": model.initialize, "go_on": _bound(go_on, constant, found)}
    scratch = own["ROWS"] + wide["WIDE_ROW"] * (max(formulas.ORDERS) + 1)
    return Lanes(_bound(run_in_lanes, constant, found), WIDEST * scratch)
