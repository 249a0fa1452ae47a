"""Models of a body that turns about one principal axis, fixed in space.

`ONE_AXIS`: under constant torque and damping, in closed form. `PENDULUM`: under forces fixed in space alone, in closed
form. `ONE_AXIS_TAYLOR`: under such forces, torque and damping, by Taylor series.
"""

import math

from ..body import closed_form, memory, principal, shell
from ..buffer import MAX_SUBSTEPS, MORE_AXES, NO_PENDULUM, OK, STEP_REJECTED, places
from ..buffer_access import pair_at, put_pair_at, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..exact import pendulum as exact
from ..integrators.polynomials import polynomial
from ..integrators.substeps import LONGEST_STEP, substeps_in
from ..numerics.elementary import relaxed, sincos
from ..rotations.quaternion import compose_quaternions
from ..rotations.rotation_vector import quaternion_about
from ..rotations.vec3 import dot, scale
from ..types import Buffer

_ONE_AXIS_LAYOUT = places(closed_form.CLOSED_FORM | {"axis": 3, "rate": 1, "drive": 1, "damping_rate": 1})
_STEADY = _ONE_AXIS_LAYOUT.at


@kernel
def _set_up_one_axis(z: Buffer) -> int:
    axis = principal.main_axis(z)
    cosine, sine = principal.swing(z, axis)
    if not memory.skips_model_checks(z) and (cosine[0] != 0.0 or sine[0] != 0.0 or principal.leaves_axis(z, axis)):
        return MORE_AXES
    put_vec3_at(z, _STEADY.axis, axis)
    z[_STEADY.rate] = dot(axis, memory.rotation_of(z).omega_b)
    drive, z[_STEADY.damping_rate] = principal.drive_and_damping_rate(z, axis)
    z[_STEADY.drive] = drive + cosine[0]
    return closed_form.start_clocks(z)


@kernel
def _advance_one_axis(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    high, low = closed_form.time_after(z, h)
    t = high + low
    axis, q = vec3_at(z, _STEADY.axis), closed_form.first_attitude(z)
    angle, rate = relaxed(z[_STEADY.rate], z[_STEADY.drive], z[_STEADY.damping_rate], t)
    if memory.needs_attitude(z):
        q = compose_quaternions(q, quaternion_about(axis, angle))
    return closed_form.finish_step(z, h, q, scale(rate, axis))


ONE_AXIS = shell.make_model("ONE_AXIS", _ONE_AXIS_LAYOUT, _set_up_one_axis, _advance_one_axis)


_PENDULUM_LAYOUT = places(closed_form.CLOSED_FORM | {"q_hanging": 4, "axis": 3, "pendulum": exact.PENDULUM_SIZE})
"""q_hanging: the attitude in stable equilibrium."""
_HANGING = _PENDULUM_LAYOUT.at


@kernel
def _set_up_pendulum(z: Buffer) -> int:
    (q, omega), axis = memory.rotation_of(z), principal.main_axis(z)
    if not memory.skips_model_checks(z):
        if principal.leaves_axis(z, axis):
            return MORE_AXES
        drive, damping_rate = principal.drive_and_damping_rate(z, axis)
        if drive != 0.0 or damping_rate != 0.0:
            return NO_PENDULUM
    sine, cosine = exact.half_angle_rates(*principal.swing(z, axis))
    s, c = exact.sincos_of_half_angle(sine, cosine)
    put_quaternion_at(z, _HANGING.q_hanging, compose_quaternions(q, (c, *scale(-s, axis))))
    put_vec3_at(z, _HANGING.axis, axis)
    exact.put_pendulum(z, _HANGING.pendulum, exact.pendulum_setup(sine, (0.5 * dot(axis, omega), 0.0), cosine))
    return closed_form.start_clocks(z)


@kernel
def _advance_pendulum(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    axis = vec3_at(z, _HANGING.axis)
    motion = exact.read_pendulum(z[_HANGING.pendulum : _HANGING.pendulum + exact.PENDULUM_SIZE])
    s, c, rate = exact.pendulum_at(motion, closed_form.time_after(z, h))
    q = compose_quaternions(quaternion_at(z, _HANGING.q_hanging), (c, *scale(s, axis)))
    return closed_form.finish_step(z, h, q, scale(rate, axis))


PENDULUM = shell.make_model("PENDULUM", _PENDULUM_LAYOUT, _set_up_pendulum, _advance_pendulum)


ORDERS = (4, 8, 16)
"""The orders of the series: powers of two, so that n-th roots are repeated square roots."""
_TERMS = ORDERS[-1] + 1
_ONE_AXIS_TAYLOR_LAYOUT = places(
    closed_form.CLOSED_FORM
    | {"order": 1, "substeps": 1, "axis": 3, "angle": 1, "drive": 1, "damping_rate": 1, "swing": 2}
    | {"rate_series": _TERMS, "sine_series": _TERMS, "cosine_series": _TERMS}
)
_AT = _ONE_AXIS_TAYLOR_LAYOUT.at
_RATE_SERIES, _SINE_SERIES, _COSINE_SERIES = _AT.rate_series, _AT.sine_series, _AT.cosine_series


@kernel
def _set_up_one_axis_taylor(z: Buffer) -> int:
    axis = principal.main_axis(z)
    if not memory.skips_model_checks(z) and principal.leaves_axis(z, axis):
        return MORE_AXES
    cosine, sine = principal.swing(z, axis)
    put_vec3_at(z, _AT.axis, axis)
    z[_AT.angle] = z[_AT.substeps] = 0.0
    put_pair_at(z, _AT.swing, (cosine[0], sine[0]))
    z[_AT.drive], z[_AT.damping_rate] = principal.drive_and_damping_rate(z, axis)
    return closed_form.start_clocks(z)


@kernel
def _advance_one_axis_taylor(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or needs too many substeps."""
    axis, angle = vec3_at(z, _AT.axis), z[_AT.angle]
    rate = dot(axis, memory.rotation_of(z).omega_b)
    rest, steps, order = h, 0, int(z[_AT.order])
    while rest > 0.0:
        steps += 1
        if order == 4:
            longest = _expand(z, angle, rate, 4)
        elif order == 8:
            longest = _expand(z, angle, rate, 8)
        else:
            longest = _expand(z, angle, rate, 16)
        count = substeps_in(rest, longest)
        if count == 0 or steps >= MAX_SUBSTEPS:
            return STEP_REJECTED
        part = rest / count
        angle, rate = _angle_after(z, angle, part, order), polynomial(z, _RATE_SERIES, 1, order, part)
        rest = 0.0 if count == 1 else rest - part
    q = compose_quaternions(closed_form.first_attitude(z), quaternion_about(axis, angle))
    status = closed_form.finish_step(z, h, q, scale(rate, axis))
    if status == OK:
        z[_AT.angle] = angle
        z[_AT.substeps] += steps
    return status


@kernel
def _expand(z: Buffer, angle: float, rate: float, order: int) -> float:
    """Set the series of the rate, and of sine and cosine of the angle; return the longest step.

    They follow from sin' = rate cos and cos' = -rate sin. order: a literal, so that the loops unroll.
    """
    drive, damping_rate, (cosine, sine) = z[_AT.drive], z[_AT.damping_rate], pair_at(z, _AT.swing)
    s, c = sincos(angle)
    z[_RATE_SERIES], z[_SINE_SERIES], z[_COSINE_SERIES] = rate, s, c
    for k in range(order):
        d_sine, d_cosine = 0.0, 0.0
        for j in range(k + 1):
            d_sine += z[_RATE_SERIES + j] * z[_COSINE_SERIES + k - j]
            d_cosine -= z[_RATE_SERIES + j] * z[_SINE_SERIES + k - j]
        d_rate = cosine * z[_COSINE_SERIES + k] + sine * z[_SINE_SERIES + k] - damping_rate * z[_RATE_SERIES + k]
        share = 1.0 / (k + 1.0)
        z[_RATE_SERIES + k + 1] = share * (d_rate + (drive if k == 0 else 0.0))
        z[_SINE_SERIES + k + 1] = share * d_sine
        z[_COSINE_SERIES + k + 1] = share * d_cosine
    return _longest_step(z, rate, order)


@kernel
def _longest_step(z: Buffer, rate: float, order: int) -> float:
    """Return the step whose last terms, of the angle (rad) and of the rate (relative), are within the tolerance."""
    scale_of_rate = max(abs(rate), abs(z[_RATE_SERIES + 1]), 1e-300)
    last = max(abs(z[_RATE_SERIES + order]) / scale_of_rate, abs(z[_RATE_SERIES + order - 1]) / order)
    if last == 0.0:
        return LONGEST_STEP
    root = math.sqrt(math.sqrt(z[_AT.tolerance] / last))
    root = math.sqrt(root) if order > 4 else root
    return math.sqrt(root) if order > 8 else root


@kernel
def _angle_after(z: Buffer, angle: float, h: float, order: int) -> float:
    total = 0.0
    for k in range(order - 1, -1, -1):
        total = total * h + z[_RATE_SERIES + k] / (k + 1.0)
    return angle + total * h


ONE_AXIS_TAYLOR = shell.make_model(
    "ONE_AXIS_TAYLOR", _ONE_AXIS_TAYLOR_LAYOUT, _set_up_one_axis_taylor, _advance_one_axis_taylor, ORDERS=ORDERS
)
