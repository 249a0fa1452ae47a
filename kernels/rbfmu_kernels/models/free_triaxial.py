"""The model of a body on which no torque acts: exact rotation at any time, and position in closed form.

While steps are short, a series about an exact state serves many of them: see `integrators.free_series`.
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, is_driven, start_clocks, time_after
from ..body.memory import body_of, has_pivot, put_rotation, rotation_of
from ..body.needs import needs_attitude, shows_rates, skips_model_checks
from ..body.outputs import output_rates as body_output_rates
from ..body.principal import exact_frame, rates_along, rounded
from ..body.shell import entry_functions, feedthrough, outputs
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
from ..integrators.dense_output import NONE, reaches_over
from ..integrators.free_series import (
    FREE_SERIES,
    FREE_WORK,
    begin_free_series,
    motion_after,
    pass_time,
    series_pays,
    start_without_series,
)
from ..rotations.matrix import invert_matrix, quaternion_from_matrix, transform
from ..rotations.quaternion import compose_quaternions, invert_quaternion
from ..types import Vec3

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

FREE = CLOSED_FORM | {"axes": 9, "place": 4, "moved": 1, "constants": FREE_ROTATION_SIZE}
"""After CLOSED_FORM: principal axes, place on the polhode, 1 where the last step set it, constants of the motion."""
_, _BEFORE = places(FREE | FREE_SERIES)
BLOCKS, SIZE = places(FREE | FREE_SERIES | {"pad_3": -_BEFORE % 8, "work": FREE_WORK})

_M, _AXES, _PLACE, _MOVED, _CONSTANTS = (BLOCKS[n].start for n in ("M", "axes", "place", "moved", "constants"))
_SERIES, _WORK = BLOCKS[next(iter(FREE_SERIES))].start, BLOCKS["work"].start
_TORQUE = 11
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    if not skips_model_checks(z) and is_driven(z):
        return _TORQUE
    set_up_rotation(z)
    start_without_series(z, _SERIES, needs_attitude(z) and _has_exact_moments(z), rotation_of(z).omega_b)
    return 0


@kernel
def _has_exact_moments(z: Any) -> bool:
    """Return whether the body's own axes are principal, with moments as given, so that doubles lose nothing."""
    M = body_of(z).inertia
    return M[0][1] == 0.0 and M[0][2] == 0.0 and M[1][2] == 0.0 and not has_pivot(z)


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
    if not reaches_over(z, _SERIES, h):
        return _advance_exactly(z, h)
    q, omega = motion_after(z, _WORK, _SERIES, h)
    status = finish_step(z, h, q, omega)
    if status == OK:
        pass_time(z, _SERIES, h)
        z[_MOVED] = 0.0
    return status


@kernel(inline=False)
def _advance_exactly(z: Any, h: float) -> int:
    """Advance by h in closed form, and begin a series there if that pays."""
    motion = free_motion_of(z)
    t = scaled_time(motion, time_after(z, h))
    place = place_at(motion, t)
    q = free_attitude_at(motion, t, place) if needs_attitude(z) else rotation_of(z).q_ab
    status = finish_step(z, h, q, shown_rates(z, place))
    if status == OK:
        keep_place(z, place)
        if series_pays(z, _SERIES, h):
            begin_free_series(z, _WORK, _SERIES, h, q, _rates(z, place), body_of(z))
        else:
            z[_SERIES] = NONE
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
