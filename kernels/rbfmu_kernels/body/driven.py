"""What the models of a body under loads share: inputs that change within a step, and a step that may be rejected.

An input may change within a step as u + u_rate t + u_rate_2 t^2 / 2, where t counts from the step's begin. After the
step the input keeps its last value, and its rates are 0 until they are set again.
"""

from typing import Any

from ..buffer import STEP_REJECTED, places
from ..buffer_access import copy_numbers
from ..compile.decorator import kernel
from ..integrators.rigid_body_state import RATE_ONLY, ROTATION, STATE_SIZE, WHOLE_STATE
from ..mechanics.equations_of_motion import (
    Body,
    LoadPolynomial,
    Loads,
    acting_loads,
    is_changing,
    steady_acceleration,
)
from ..rotations.vec3 import add_scaled, is_nonzero
from .memory import (
    COMMON,
    INPUTS,
    body_of,
    centre_of,
    has_pivot,
    is_finite,
    keep_state,
    loads_at,
    loads_of,
    put_centre,
    restore_state,
)
from .needs import PORTS, has_port, needs_attitude, needs_translation
from .outputs import outputs

RATES = {f"{name}_rate": size for name, size in INPUTS.items()}
RATES_2 = {f"{name}_rate_2": size for name, size in INPUTS.items()}
DRIVEN = COMMON | RATES | RATES_2 | {"before": STATE_SIZE, "step_size": 1, "substeps": 1, "step_size_before": 1}
"""The buffer of such a model begins with these blocks."""
BLOCKS, _ = places(DRIVEN)

STEP_SIZE = BLOCKS["step_size"].start
"""The place of the step size; the count of substeps stands next to it."""
_BEFORE, _SIZE_BEFORE = BLOCKS["before"].start, BLOCKS["step_size_before"].start
_INPUTS, _RATES, _RATES_2 = (BLOCKS[next(iter(names))].start for names in (INPUTS, RATES, RATES_2))
NUMBER_OF_INPUTS = sum(INPUTS.values())
_PORT_FORCE_A, _PORT_TORQUE_A = PORTS["force_a"], PORTS["torque_a"]


@kernel
def load_polynomial_of(z: Any) -> LoadPolynomial:
    """Return the sum of known and supplied loads, and the derivatives of the supplied ones."""
    pivot = has_pivot(z)
    return LoadPolynomial(loads_of(z), loads_at(z, _RATES, pivot), loads_at(z, _RATES_2, pivot))


@kernel
def integrated(z: Any, body: Body, loads: LoadPolynomial) -> int:
    """Return how many numbers of the state need integration: see `rigid_body_state`."""
    acting = acting_loads(loads)
    if acting.force_b and needs_translation(z) and not has_pivot(z):
        return WHOLE_STATE
    levered = (acting.force_a or has_port(z, _PORT_FORCE_A)) and is_nonzero(body.arm_b)
    turned = acting.torque_a or has_port(z, _PORT_TORQUE_A) or levered
    return ROTATION if turned or needs_attitude(z) else RATE_ONLY


@kernel
def holds_inputs(z: Any, held: int) -> bool:
    """Return whether the inputs are those that were kept from z[held] on, and do not change within the step."""
    same = True
    for i in range(NUMBER_OF_INPUTS):
        same &= bool(z[_INPUTS + i] == z[held + i])
        same &= bool(z[_RATES + i] == 0.0) & bool(z[_RATES_2 + i] == 0.0)
    return same


@kernel
def keep_inputs(z: Any, held: int) -> None:
    """Copy the inputs to z[held:], for `holds_inputs`."""
    copy_numbers(z, _INPUTS, held, NUMBER_OF_INPUTS)


@kernel
def keep(z: Any) -> None:
    """Keep what `finish` restores where the step is rejected."""
    keep_state(z, _BEFORE)
    z[_SIZE_BEFORE] = z[STEP_SIZE]


@kernel
def finish(z: Any, n: int, h: float, status: int, body: Body, loads: LoadPolynomial) -> int:
    """Move the centre of mass as far as in closed form, set outputs; or return STEP_REJECTED with all as it was."""
    _translate(z, h, 0.0 if n == WHOLE_STATE else 1.0, body, loads.value)
    changing = is_changing(loads)
    if changing:
        _translate_further(z, h, body, loads)
    if status != 0 or not is_finite(z):
        restore_state(z, _BEFORE)
        z[STEP_SIZE] = z[_SIZE_BEFORE]
        return STEP_REJECTED
    if changing:
        _hold_last_inputs(z, h)
    return outputs(z)


@kernel
def finish_steadily(z: Any, n: int, h: float) -> int:
    """Do what `finish` does where no input changes within the step."""
    _translate(z, h, 0.0 if n == WHOLE_STATE else 1.0, body_of(z), loads_of(z))
    if not is_finite(z):
        restore_state(z, _BEFORE)
        return STEP_REJECTED
    return outputs(z)


@kernel
def _translate(z: Any, h: float, drift: float, body: Body, loads: Loads) -> None:
    """Move the centre of mass by h under its steady acceleration; drift: 0 where v_c h is added already, else 1."""
    if not needs_translation(z):
        return
    (r_c, v_c), a = centre_of(z), steady_acceleration(body, loads)
    put_centre(z, add_scaled(add_scaled(r_c, drift * h, v_c), 0.5 * h * h, a), add_scaled(v_c, h, a))


@kernel
def _translate_further(z: Any, h: float, body: Body, loads: LoadPolynomial) -> None:
    """Add what the change of the steady acceleration within the step adds to the centre of mass's motion."""
    r, v = centre_of(z)
    first, second = steady_acceleration(body, loads.rate), steady_acceleration(body, loads.rate_2)
    r = add_scaled(add_scaled(r, h * h * h / 6.0, first), h * h * h * h / 24.0, second)
    put_centre(z, r, add_scaled(add_scaled(v, 0.5 * h * h, first), h * h * h / 6.0, second))


@kernel
def _hold_last_inputs(z: Any, h: float) -> None:
    for i in range(NUMBER_OF_INPUTS):
        z[_INPUTS + i] += h * z[_RATES + i] + 0.5 * h * h * z[_RATES_2 + i]
        z[_RATES + i] = z[_RATES_2 + i] = 0.0
