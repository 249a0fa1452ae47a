"""A body that turns about one principal axis, fixed in space, under constant torque and damping: a closed form."""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, first_attitude, start_clocks, time_after
from ..body.fixed_axis import drive_and_damping_rate, leaves_axis, main_axis, swing
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import needs_attitude, skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import places
from ..buffer_access import put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..numerics.phi_functions import relaxed
from ..rotations.quaternion import compose_quaternions
from ..rotations.rotation_vector import quaternion_about
from ..rotations.vec3 import dot, scale

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM | {"axis": 3, "rate": 1, "drive": 1, "damping_rate": 1})

_AXIS, _RATE, _DRIVE, _DAMPING_RATE = (BLOCKS[n].start for n in ("axis", "rate", "drive", "damping_rate"))
_MORE_AXES = 17
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    axis = main_axis(q, omega, body, loads)
    cosine, sine = swing(z, axis)
    if not skips_model_checks(z) and (
        cosine[0] != 0.0 or sine[0] != 0.0 or leaves_axis(z, axis, q, omega, body, loads)
    ):
        return _MORE_AXES
    put_vec3_at(z, _AXIS, axis)
    z[_RATE] = dot(axis, omega)
    drive, z[_DAMPING_RATE] = drive_and_damping_rate(z, axis, q, body, loads)
    z[_DRIVE] = drive + cosine[0]
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    high, low = time_after(z, h)
    t = high + low
    axis, q = vec3_at(z, _AXIS), first_attitude(z)
    angle, rate = relaxed(z[_RATE], z[_DRIVE], z[_DAMPING_RATE], t)
    if needs_attitude(z):
        q = compose_quaternions(q, quaternion_about(axis, angle))
    return finish_step(z, h, q, scale(rate, axis))


initialize, step = entry_functions(__name__, _set_up, _advance)
