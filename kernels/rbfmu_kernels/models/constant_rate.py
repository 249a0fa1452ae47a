"""The model of a free body that turns at a constant rate: a sphere, or a spin about a principal axis."""

from typing import Any

from ..body.closed_form import (
    CLOSED_FORM,
    finish_step,
    first_attitude,
    has_torque,
    start_clocks,
    time_after,
)
from ..body.fixed_axis import turns_path
from ..body.memory import rotation_of
from ..body.needs import skips_model_checks
from ..body.principal import keeps_its_rate
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import STEP_REJECTED, places
from ..compile.decorator import kernel
from ..exact.uniform_rotation import TURNING_SIZE, put_turning, read_turning, turned, turning_about
from ..numerics.double_double import dd_vector
from ..rotations.quaternion import compose_quaternions

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM | {"turning": TURNING_SIZE})

_TURNING = BLOCKS["turning"].start
_UNSTEADY = 15
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    omega = rotation_of(z).omega_b
    if not skips_model_checks(z) and (not keeps_its_rate(z, omega) or _is_disturbed(z)):
        return _UNSTEADY
    put_turning(z, _TURNING, turning_about(dd_vector(omega)))
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not skips_model_checks(z) and _is_disturbed(z):
        return STEP_REJECTED
    t = time_after(z, h)
    q = compose_quaternions(first_attitude(z), turned(read_turning(z[_TURNING : _TURNING + TURNING_SIZE]), t))
    return finish_step(z, h, q, rotation_of(z).omega_b)


@kernel
def _is_disturbed(z: Any) -> bool:
    """Return whether a torque acts, or a turning force bends the body's path; one along the rate does not turn."""
    return has_torque(z) or turns_path(z, rotation_of(z).omega_b)


initialize, step = entry_functions(__name__, _set_up, _advance)
