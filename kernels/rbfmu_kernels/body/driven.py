"""Common to models of a body under loads: inputs that change within a step, and steps that may be rejected.

An input may change within a step as u + u_rate t + u_rate_2 t^2 / 2, with t from the step's beginning. After the step
the input keeps its last value, and its rates are 0 until they are set again.
"""

from ..buffer import OK, STEP_REJECTED, places
from ..buffer_access import are_equal, are_zero, copy_numbers
from ..compile.decorator import kernel
from ..mechanics import equations_of_motion as motion
from ..mechanics.equations_of_motion import RATE_ONLY, ROTATION, STATE_SIZE, WHOLE_STATE, Body, LoadPolynomial, Loads
from ..rotations.vec3 import add_scaled, is_nonzero
from ..types import Buffer
from . import memory, outputs

RATES = {f"{name}_rate": size for name, size in memory.INPUTS.items()}
RATES_2 = {f"{name}_rate_2": size for name, size in memory.INPUTS.items()}
DRIVEN = memory.COMMON | RATES | RATES_2 | {"before": STATE_SIZE, "step_size": 1, "substeps": 1, "step_size_before": 1}
"""The buffer of such a model begins with these blocks."""
_LAYOUT = places(DRIVEN)
_AT = _LAYOUT.at
STEP_SIZE, SUBSTEPS = _AT.step_size, _AT.substeps
"""The places of the step size and, next to it, of the count of substeps."""
RATES_START, RATES_2_START = (_LAYOUT.blocks[next(iter(names))].start for names in (RATES, RATES_2))
NUMBER_OF_INPUTS = sum(memory.INPUTS.values())


@kernel
def load_polynomial_of(z: Buffer) -> LoadPolynomial:
    """Return the sum of known and supplied loads, and the derivatives of the supplied ones."""
    pivot = memory.has_pivot(z)
    return LoadPolynomial(
        memory.loads_of(z), memory.loads_at(z, RATES_START, pivot), memory.loads_at(z, RATES_2_START, pivot)
    )


@kernel
def part_to_integrate(z: Buffer, body: Body, loads: LoadPolynomial) -> int:
    """Return how many numbers of the state need integration: see `equations_of_motion`."""
    acting = motion.acting_loads(loads)
    if acting.force_b and memory.needs_translation(z) and not memory.has_pivot(z):
        return WHOLE_STATE
    levered = (acting.force_a or memory.is_set(z, memory.PORTS.force_a)) and is_nonzero(body.arm_b)
    turned = acting.torque_a or memory.is_set(z, memory.PORTS.torque_a) or levered
    return ROTATION if turned or memory.needs_attitude(z) else RATE_ONLY


@kernel
def holds_inputs(z: Buffer, held: int) -> bool:
    """Return whether the inputs equal those kept from z[held] on, and are constant over the step."""
    return are_equal(z, memory.INPUTS_START, held, NUMBER_OF_INPUTS) and not inputs_change(z)


@kernel
def keep_inputs(z: Buffer, held: int) -> None:
    """Copy the inputs to z[held:], for `holds_inputs`."""
    copy_numbers(z, memory.INPUTS_START, held, NUMBER_OF_INPUTS)


@kernel
def keep(z: Buffer) -> None:
    """Keep the numbers that `finish` restores where a step is rejected."""
    copy_numbers(z, memory.STATE_START, _AT.before, STATE_SIZE)
    z[_AT.step_size_before] = z[STEP_SIZE]


@kernel
def restore(z: Buffer) -> None:
    """Restore the numbers that `keep` has kept."""
    copy_numbers(z, _AT.before, memory.STATE_START, STATE_SIZE)
    z[STEP_SIZE] = z[_AT.step_size_before]


@kernel
def finish(z: Buffer, n: int, h: float, status: int, body: Body, loads: LoadPolynomial) -> int:
    """Add the centre of mass's motion in closed form and set outputs; or return STEP_REJECTED and change nothing."""
    return _finish(z, n, h, status, body, loads, inputs_change(z))


@kernel
def finish_steadily(z: Buffer, n: int, h: float) -> int:
    """Finish a step as `finish` does, at constant inputs."""
    return _finish(z, n, h, OK, memory.body_of(z), motion.constant_loads(memory.loads_of(z)), False)


@kernel(inline=False)
def translate_steadily(z: Buffer, n: int, h: float) -> None:
    """Add the centre of mass's motion as `finish_steadily` does."""
    _translate(z, h, 0.0 if n == WHOLE_STATE else 1.0, memory.body_of(z), memory.loads_of(z))


@kernel
def inputs_change(z: Buffer) -> bool:
    """Return whether any input changes within the step, including a force at a pivot, which the loads leave out."""
    return not are_zero(z, RATES_START, RATES_2_START + NUMBER_OF_INPUTS)  # the second rates follow the first


@kernel
def _finish(z: Buffer, n: int, h: float, status: int, body: Body, loads: LoadPolynomial, changing: bool) -> int:
    _translate(z, h, 0.0 if n == WHOLE_STATE else 1.0, body, loads.value)
    if changing:
        _translate_further(z, h, body, loads)
    if status != 0 or not memory.is_finite(z):
        restore(z)
        return STEP_REJECTED
    if changing:
        hold_last_inputs(z, h)
    return outputs.outputs(z)


@kernel
def _translate(z: Buffer, h: float, drift: float, body: Body, loads: Loads) -> None:
    """Move the centre of mass by h under its steady acceleration; drift: 0 where v_c h is added already, else 1."""
    if not memory.needs_translation(z):
        return
    (r_c, v_c), a = memory.centre_of(z), motion.steady_acceleration(body, loads)
    memory.put_centre(z, add_scaled(add_scaled(r_c, drift * h, v_c), 0.5 * h * h, a), add_scaled(v_c, h, a))


@kernel
def _translate_further(z: Buffer, h: float, body: Body, loads: LoadPolynomial) -> None:
    """Add the part of the centre of mass's motion that comes from the acceleration's change within the step."""
    r, v = memory.centre_of(z)
    first, second = motion.steady_acceleration(body, loads.rate), motion.steady_acceleration(body, loads.rate_2)
    r = add_scaled(add_scaled(r, h * h * h / 6.0, first), h * h * h * h / 24.0, second)
    memory.put_centre(z, r, add_scaled(add_scaled(v, 0.5 * h * h, first), h * h * h / 6.0, second))


@kernel
def hold_last_inputs(z: Buffer, h: float) -> None:
    """Set the inputs to their values at the end of a step h, and their rates to zero."""
    for i in range(NUMBER_OF_INPUTS):
        z[memory.INPUTS_START + i] += h * z[RATES_START + i] + 0.5 * h * h * z[RATES_2_START + i]
        z[RATES_START + i] = z[RATES_2_START + i] = 0.0
