"""The model of a body that does not turn, or whose rotation no output needs: its position in closed form."""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, has_torque, start_clocks
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import needs_attitude, needs_rate, needs_translation, shows_loads, skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import OK, places
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import angular_acceleration
from ..rotations.vec3 import is_nonzero

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM)

_TURNS = 14
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    if needs_rate(z) and not skips_model_checks(z) and begins_to_turn(z):
        return _TURNS
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h at constant inputs; reject the step and change nothing where the result is not finite."""
    if not needs_translation(z):
        return outputs(z) if shows_loads(z) else OK
    q, omega = rotation_of(z)
    return finish_step(z, h, q, omega)


@kernel
def begins_to_turn(z: Any) -> bool:
    """Return whether an output that depends on the rotation would change."""
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    changes = is_nonzero(angular_acceleration(q, omega, body, loads))
    return changes or (is_nonzero(omega) and (needs_attitude(z) or has_torque(z)))


initialize, step = entry_functions(__name__, _set_up, _advance)
