"""The model of a free body with two equal moments: two steady turns by elementary functions only."""

from typing import Any

from ..body.closed_form import (
    CLOSED_FORM,
    finish_step,
    first_attitude,
    is_driven,
    start_clocks,
    time_after,
)
from ..body.memory import body_of, rotation_of
from ..body.needs import needs_attitude, skips_model_checks
from ..body.principal import rates_along, rounded
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..body.symmetry import exact_symmetric_frame
from ..buffer import STEP_REJECTED, places
from ..buffer_access import put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..exact.uniform_rotation import TURNING_SIZE, Turning, put_turning, read_turning, symmetric_turnings, turned
from ..integrators.splitting import is_symmetric_top
from ..rotations.matrix import invert_matrix, transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion, rotate

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM | {"omega_0": 3, "about_momentum": TURNING_SIZE, "about_axis": TURNING_SIZE})

_OMEGA_0, _ABOUT_MOMENTUM, _ABOUT_AXIS = (BLOCKS[n].start for n in ("omega_0", "about_momentum", "about_axis"))
_TORQUE, _NOT_SYMMETRIC = 11, 16
"""The keys in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    omega, body = rotation_of(z).omega_b, body_of(z)
    if not skips_model_checks(z):
        if is_driven(z):
            return _TORQUE
        if not is_symmetric_top(body.inertia):
            return _NOT_SYMMETRIC
    mean, moment, exact_axes = exact_symmetric_frame(z)
    momentum, own = symmetric_turnings(mean, moment, rates_along(exact_axes, omega))
    axes = rounded(exact_axes)
    put_vec3_at(z, _OMEGA_0, omega)
    put_turning(z, _ABOUT_MOMENTUM, Turning(transform(invert_matrix(axes), momentum.axis), momentum.rate))
    put_turning(z, _ABOUT_AXIS, Turning(axes[2], own.rate))
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not skips_model_checks(z) and is_driven(z):
        return STEP_REJECTED
    t = time_after(z, h)
    q, back = first_attitude(z), turned(read_turning(z[_ABOUT_AXIS : _ABOUT_AXIS + TURNING_SIZE]), t)
    if needs_attitude(z):
        about_momentum = read_turning(z[_ABOUT_MOMENTUM : _ABOUT_MOMENTUM + TURNING_SIZE])
        q = compose_quaternions(compose_quaternions(q, turned(about_momentum, t)), back)
    return finish_step(z, h, q, rotate(invert_quaternion(back), vec3_at(z, _OMEGA_0)))


initialize, step = entry_functions(__name__, _set_up, _advance)
