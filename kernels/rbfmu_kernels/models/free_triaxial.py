"""The model of a body on which no torque acts: exact rotation at any time, and position in closed form."""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, is_driven, start_clocks, time_after
from ..body.memory import put_rotation, rotation_of
from ..body.needs import needs_attitude, shows_rates, skips_model_checks
from ..body.outputs import output_rates as body_output_rates
from ..body.principal import exact_frame, rates_along, rounded
from ..body.shell import entry_functions, outputs
from ..buffer import OK, STEP_REJECTED, places
from ..buffer_access import matrix_at, put_matrix_at, put_quaternion_at, quaternion_at
from ..compile.decorator import kernel
from ..exact.free_rotation import (
    FREE_ROTATION_SIZE,
    FreeRotation,
    Place,
    free_attitude_at,
    free_rate_at,
    free_rotation_of,
    place_at,
    put_free_rotation,
    read_free_rotation,
    scaled_time,
    with_axes_turned,
)
from ..rotations.matrix import invert_matrix, quaternion_from_matrix, transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion
from ..types import Vec3

__all__ = ["BLOCKS", "SIZE", "initialize", "output_rates", "outputs", "step"]

FREE = CLOSED_FORM | {"axes": 9, "place": 4, "moved": 1, "constants": FREE_ROTATION_SIZE}
"""After CLOSED_FORM: principal axes, place on the polhode, 1 once a step was taken, constants of the exact motion."""
BLOCKS, SIZE = places(FREE)

_M, _AXES, _PLACE, _MOVED, _CONSTANTS = (BLOCKS[n].start for n in ("M", "axes", "place", "moved", "constants"))
_TORQUE = 11
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    if not skips_model_checks(z) and is_driven(z):
        return _TORQUE
    set_up_rotation(z)
    return 0


@kernel(inline=False)
def set_up_rotation(z: Any) -> None:
    """Set the exact motion's constants and the clocks."""
    moments, axes = exact_frame(z)
    R_bp = invert_matrix(rounded(axes))
    put_matrix_at(z, _AXES, R_bp)
    q_ab, omega_b = rotation_of(z)
    q_bp = quaternion_from_matrix(R_bp)
    q_ap = compose_quaternions(q_ab, q_bp)
    motion = free_rotation_of(moments, q_ap, rates_along(axes, omega_b))
    put_free_rotation(z, _CONSTANTS, with_axes_turned(motion, invert_quaternion(q_bp)))
    start_clocks(z)
    z[_MOVED] = 0.0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or an input makes a torque."""
    if not skips_model_checks(z) and is_driven(z):
        return STEP_REJECTED
    motion = free_motion_of(z)
    t = scaled_time(motion, time_after(z, h))
    place = place_at(motion, t)
    q = free_attitude_at(motion, t, place) if needs_attitude(z) else rotation_of(z).q_ab
    status = finish_step(z, h, q, shown_rates(z, place))
    if status == OK:
        keep_place(z, place)
    return status


@kernel
def shown_rates(z: Any, place: Place) -> Vec3:
    """Return omega_ab_b at a place on the polhode where an output needs it."""
    return _rates(z, place) if shows_rates(z) else rotation_of(z).omega_b


@kernel
def keep_place(z: Any, place: Place) -> None:
    """Keep where on the polhode the body is after a step."""
    put_quaternion_at(z, _PLACE, place)
    z[_MOVED] = 1.0


@kernel(inline=False)
def output_rates(z: Any) -> int:
    """Set the outputs' time derivatives at constant inputs, and first the rate, which may be an earlier step's."""
    if z[_MOVED] != 0.0:
        put_rotation(z, rotation_of(z).q_ab, _rates(z, quaternion_at(z, _PLACE)))
    return body_output_rates(z)


@kernel(inline=False)
def _rates(z: Any, place: Place) -> Vec3:
    """Return omega_ab_b at a place on the polhode."""
    return transform(matrix_at(z, _AXES), free_rate_at(free_motion_of(z), place))


@kernel
def free_motion_of(z: Any) -> FreeRotation:
    """Return what `set_up_rotation` has set up."""
    return read_free_rotation(z[_CONSTANTS : _CONSTANTS + FREE_ROTATION_SIZE])  # type: ignore[no-any-return]


initialize, step = entry_functions(__name__, _set_up, _advance)
