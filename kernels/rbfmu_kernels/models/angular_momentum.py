"""The angular momentum of a body that only a torque fixed in space changes, its attitude left out: h = h_0 + T t.

A sphere's rates in a follow from it. Its attitude stays the first one, and its omega_ab_b is that of h in it.
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, first_attitude, has_turning_torque, later, start_clocks
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import shows_more_than_momentum, skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..body.symmetry import is_sphere
from ..buffer import OK, STEP_REJECTED, places
from ..buffer_access import put_pair_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import angular_acceleration
from ..rotations.vec3 import add_scaled

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM | {"omega_0": 3, "alpha": 3, "since_alpha": 2})
"""After CLOSED_FORM: the rate when the torque last changed, what the torque adds to it in 1 s, and the time since."""

_OMEGA_0, _ALPHA, _SINCE_ALPHA = (BLOCKS[n].start for n in ("omega_0", "alpha", "since_alpha"))
_AT_REST = (0.0, 0.0, 0.0)
_MORE = 20
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    more = has_turning_torque(z) or shows_more_than_momentum(z, is_sphere(body_of(z).inertia))
    if more and not skips_model_checks(z):
        return _MORE
    put_pair_at(z, _SINCE_ALPHA, (0.0, 0.0))
    put_vec3_at(z, _OMEGA_0, rotation_of(z).omega_b)
    put_vec3_at(z, _ALPHA, _AT_REST)
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input turns in a."""
    if not skips_model_checks(z) and has_turning_torque(z):
        return STEP_REJECTED
    since, low, omega, q = 0.0, 0.0, vec3_at(z, _OMEGA_0), first_attitude(z)
    alpha = angular_acceleration(q, _AT_REST, body_of(z), loads_of(z))
    if alpha == vec3_at(z, _ALPHA):
        since, low = later(z, _SINCE_ALPHA, h)
    else:
        since, omega = h, rotation_of(z).omega_b
    status = finish_step(z, h, q, add_scaled(omega, since + low, alpha))
    if status == OK:
        put_pair_at(z, _SINCE_ALPHA, (since, low))
        put_vec3_at(z, _OMEGA_0, omega)
        put_vec3_at(z, _ALPHA, alpha)
    return status


initialize, step = entry_functions(__name__, _set_up, _advance)
