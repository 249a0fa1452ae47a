"""A body that turns about one principal axis, fixed in space, under forces fixed in space alone: a pendulum, exactly.

With damping or another torque, `one_axis_taylor` serves.
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, start_clocks, time_after
from ..body.fixed_axis import drive_and_damping_rate, leaves_axis, main_axis, swing
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import places
from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..exact.pendulum import (
    PENDULUM_SIZE,
    half_angle_rates,
    pendulum_at,
    pendulum_setup,
    put_pendulum,
    read_pendulum,
    sincos_of_half_angle,
)
from ..rotations.quaternion import compose_quaternions
from ..rotations.vec3 import dot, scale

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(CLOSED_FORM | {"q_hanging": 4, "axis": 3, "pendulum": PENDULUM_SIZE})
"""q_hanging: the attitude in stable equilibrium."""

_Q_HANGING, _AXIS, _PENDULUM = (BLOCKS[n].start for n in ("q_hanging", "axis", "pendulum"))
_MORE_AXES, _DRIVEN = 17, 18
"""The keys in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    axis = main_axis(q, omega, body, loads)
    if not skips_model_checks(z):
        if leaves_axis(z, axis, q, omega, body, loads):
            return _MORE_AXES
        drive, damping_rate = drive_and_damping_rate(z, axis, q, body, loads)
        if drive != 0.0 or damping_rate != 0.0:
            return _DRIVEN
    sine, cosine = half_angle_rates(*swing(z, axis))
    s, c = sincos_of_half_angle(sine, cosine)
    put_quaternion_at(z, _Q_HANGING, compose_quaternions(q, (c, -s * axis[0], -s * axis[1], -s * axis[2])))
    put_vec3_at(z, _AXIS, axis)
    put_pendulum(z, _PENDULUM, pendulum_setup(sine, (0.5 * dot(axis, omega), 0.0), cosine))
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    axis = vec3_at(z, _AXIS)
    motion = read_pendulum(z[_PENDULUM : _PENDULUM + PENDULUM_SIZE])
    s, c, rate = pendulum_at(motion, time_after(z, h))
    turn = (c, s * axis[0], s * axis[1], s * axis[2])
    return finish_step(z, h, compose_quaternions(quaternion_at(z, _Q_HANGING), turn), scale(rate, axis))


initialize, step = entry_functions(__name__, _set_up, _advance)
