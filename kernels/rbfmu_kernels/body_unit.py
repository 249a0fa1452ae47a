"""A body under any of the scene's loads as a co-simulation unit: DOP853 or Taylor series inside a communication step.

`initialize`, `step` and `outputs` work over one flat buffer (see BLOCKS), the unit's whole memory. `step` commits all
of a communication step or nothing. `order` is that of the Taylor series, 0 for DOP853; `tolerance` the largest
estimated error of a substep, 0 for substeps of size `substep` without error control (`rbfmu.fitting` chooses them).

An input may change within a step: u + u_rate t + u_rate_2 t^2 / 2, t from the step's begin. After the step the input
holds its last value, and the rates are 0, until they are set again.
"""

from typing import Any

from ._kernel import kernel
from .body_memory import (
    COMMON,
    STATE,
    STATE_SIZE,
    body_of,
    centre_of,
    first_outputs,
    has_pivot,
    initialize_body,
    is_finite,
    keep_state,
    loads_of,
    put_centre,
    restore_state,
    translate,
    vec3_at,
)
from .body_memory import INPUTS as INPUTS
from .body_memory import OUTPUTS as OUTPUTS
from .body_memory import PARAMETERS as PARAMETERS
from .body_memory import outputs as outputs
from .dop853 import ROTATION, TURNING, dop853_advance, dop853_march, first_step
from .dop853 import WORK as DOP853_WORK
from .dynamics import Body, Course, Loads, is_changing, steady_acceleration
from .layout import NOT_REACHED, places
from .taylor import WORK as TAYLOR_WORK
from .taylor import taylor_advance
from .vec3 import add_scaled, is_nonzero

RATES = {f"{name}_rate": size for name, size in INPUTS.items()}
RATES_2 = {f"{name}_rate_2": size for name, size in INPUTS.items()}
MEMORY = {"before": STATE_SIZE, "step_size": 1, "substeps": 1, "step_size_before": 1}
BLOCKS, SIZE = places(COMMON | {"order": 1} | RATES | RATES_2 | MEMORY | {"work": max(DOP853_WORK, TAYLOR_WORK)})

_TOLERANCE, _SUBSTEP, _ORDER = (BLOCKS[n].start for n in ("tolerance", "substep", "order"))
_BEFORE, _WORK = (BLOCKS[n].start for n in ("before", "work"))
_STEP_SIZE, _SIZE_BEFORE = BLOCKS["step_size"].start, BLOCKS["step_size_before"].start
_INPUTS, _RATES, _RATES_2 = (BLOCKS[next(iter(names))].start for names in (INPUTS, RATES, RATES_2))
_NUMBERS = sum(INPUTS.values())
_NONE = (0.0, 0.0, 0.0)


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = initialize_body(z)
    if fault != 0:
        return fault
    z[_STEP_SIZE] = first_step(z, STATE, body_of(z), loads_of(z))
    return first_outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h; NOT_REACHED (and nothing changed) where the motion cannot be followed."""
    if not h > 0.0:
        return NOT_REACHED
    keep_state(z, _BEFORE)
    z[_SIZE_BEFORE] = z[_STEP_SIZE]
    body, course = body_of(z), _course(z)
    pushes = is_nonzero(course[0][2]) or is_nonzero(course[1][2]) or is_nonzero(course[2][2])
    turning = pushes and not has_pivot(z)
    status = _advance(z, TURNING if turning else ROTATION, h, body, course)
    translate(z, h, 0.0 if turning else 1.0, body, course[0])
    if is_changing(course):
        _translate_further(z, h, body, course)
    if status != 0 or not is_finite(z):
        restore_state(z, _BEFORE)
        z[_STEP_SIZE] = z[_SIZE_BEFORE]
        return NOT_REACHED
    if is_changing(course):
        _hold_last_inputs(z, h)
    return outputs(z)


@kernel
def _advance(z: Any, n: int, h: float, body: Body, course: Course) -> int:
    order, tolerance = int(z[_ORDER]), z[_TOLERANCE]
    if order > 0:
        return taylor_advance(z, STATE, _WORK, _STEP_SIZE, n, order, h, tolerance, body, course)
    if tolerance > 0.0:
        return dop853_advance(z, STATE, _WORK, _STEP_SIZE, n, h, tolerance, body, course)
    return dop853_march(z, STATE, _WORK, n, h, z[_SUBSTEP], body, course)


@kernel
def _course(z: Any) -> Course:
    return loads_of(z), _load_rates(z, _RATES), _load_rates(z, _RATES_2)


@kernel
def _load_rates(z: Any, i: int) -> Loads:
    """Derivatives of the inputs that stand from z[i] on; a pivot takes the forces."""
    force_a, force_b = vec3_at(z, i), vec3_at(z, i + 3)
    if has_pivot(z):
        force_a = force_b = _NONE
    return _NONE, force_a, force_b, vec3_at(z, i + 6), vec3_at(z, i + 9)


@kernel
def _translate_further(z: Any, h: float, body: Body, course: Course) -> None:
    """What the change of the steady acceleration within the step adds to the centre of mass's motion."""
    r, v = centre_of(z)
    first, second = steady_acceleration(body, course[1]), steady_acceleration(body, course[2])
    r = add_scaled(add_scaled(r, h * h * h / 6.0, first), h * h * h * h / 24.0, second)
    put_centre(z, r, add_scaled(add_scaled(v, 0.5 * h * h, first), h * h * h / 6.0, second))


@kernel
def _hold_last_inputs(z: Any, h: float) -> None:
    for i in range(_NUMBERS):
        z[_INPUTS + i] += h * z[_RATES + i] + 0.5 * h * h * z[_RATES_2 + i]
        z[_RATES + i] = z[_RATES_2 + i] = 0.0
