"""A body that turns about one principal axis fixed in space, under forces fixed in space, by Taylor series."""

import math
from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, first_attitude, start_clocks
from ..body.fixed_axis import drive_and_damping_rate, leaves_axis, main_axis, swing
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..buffer import MAX_SUBSTEPS, OK, STEP_REJECTED, places
from ..buffer_access import pair_at, put_pair_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..integrators.dop853 import LONGEST_STEP
from ..integrators.substeps import substeps_in
from ..numerics.elementary import sincos
from ..rotations.quaternion import compose_quaternions
from ..rotations.rotation_vector import quaternion_about
from ..rotations.vec3 import dot, scale

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

ORDERS = (4, 8, 16)
"""The orders of the series: powers of two, as their roots are repeated square roots."""
_TERMS = ORDERS[-1] + 1
BLOCKS, SIZE = places(
    CLOSED_FORM
    | {"order": 1, "substeps": 1, "axis": 3, "angle": 1, "drive": 1, "damping_rate": 1, "swing": 2}
    | {"rate_series": _TERMS, "sine_series": _TERMS, "cosine_series": _TERMS}
)

_AXIS, _ANGLE, _DRIVE, _DAMPING_RATE, _SWING = (
    BLOCKS[n].start for n in ("axis", "angle", "drive", "damping_rate", "swing")
)
_TOLERANCE, _ORDER, _SUBSTEPS = (BLOCKS[n].start for n in ("tolerance", "order", "substeps"))
_RATE, _SINE, _COSINE = (BLOCKS[n].start for n in ("rate_series", "sine_series", "cosine_series"))
_MORE_AXES = 17
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    axis = main_axis(q, omega, body, loads)
    if not skips_model_checks(z) and leaves_axis(z, axis, q, omega, body, loads):
        return _MORE_AXES
    cosine, sine = swing(z, axis)
    put_vec3_at(z, _AXIS, axis)
    z[_ANGLE] = z[_SUBSTEPS] = 0.0
    put_pair_at(z, _SWING, (cosine[0], sine[0]))
    z[_DRIVE], z[_DAMPING_RATE] = drive_and_damping_rate(z, axis, q, body, loads)
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or needs too many substeps."""
    axis, angle = vec3_at(z, _AXIS), z[_ANGLE]
    rate = dot(axis, rotation_of(z).omega_b)
    rest, steps, order = h, 0, int(z[_ORDER])
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
        angle, rate = _angle_after(z, angle, part, order), _rate_after(z, part, order)
        rest = 0.0 if count == 1 else rest - part
    q = compose_quaternions(first_attitude(z), quaternion_about(axis, angle))
    status = finish_step(z, h, q, scale(rate, axis))
    if status == OK:
        z[_ANGLE] = angle
        z[_SUBSTEPS] += steps
    return status


@kernel
def _term(z: Any, series: int, k: int) -> float:
    """Return the k-th coefficient of a series."""
    return z[series + k]  # type: ignore[no-any-return]


@kernel
def _put_term(z: Any, series: int, k: int, x: float) -> None:
    """Set the k-th coefficient of a series."""
    z[series + k] = x


@kernel
def _expand(z: Any, angle: float, rate: float, order: int) -> float:
    """Set the series of the rate, and of sine and cosine of the angle; return the longest step.

    They follow from sin' = rate cos and cos' = -rate sin. order: a literal, so that the loops unroll.
    """
    drive, damping_rate, (cosine, sine) = z[_DRIVE], z[_DAMPING_RATE], pair_at(z, _SWING)
    s, c = sincos(angle)
    _put_term(z, _RATE, 0, rate)
    _put_term(z, _SINE, 0, s)
    _put_term(z, _COSINE, 0, c)
    for k in range(order):
        d_sine, d_cosine = 0.0, 0.0
        for j in range(k + 1):
            d_sine += _term(z, _RATE, j) * _term(z, _COSINE, k - j)
            d_cosine -= _term(z, _RATE, j) * _term(z, _SINE, k - j)
        d_rate = cosine * _term(z, _COSINE, k) + sine * _term(z, _SINE, k) - damping_rate * _term(z, _RATE, k)
        share = 1.0 / (k + 1.0)
        _put_term(z, _RATE, k + 1, share * (d_rate + (drive if k == 0 else 0.0)))
        _put_term(z, _SINE, k + 1, share * d_sine)
        _put_term(z, _COSINE, k + 1, share * d_cosine)
    return _longest_step(z, rate, order)


@kernel
def _longest_step(z: Any, rate: float, order: int) -> float:
    """Return the step whose last terms, of the angle (rad) and of the rate (relative), are within the tolerance."""
    scale_of_rate = max(abs(rate), abs(_term(z, _RATE, 1)), 1e-300)
    last = max(abs(_term(z, _RATE, order)) / scale_of_rate, abs(_term(z, _RATE, order - 1)) / order)
    if last == 0.0:
        return LONGEST_STEP
    root = math.sqrt(math.sqrt(z[_TOLERANCE] / last))
    root = math.sqrt(root) if order > 4 else root
    return math.sqrt(root) if order > 8 else root


@kernel
def _rate_after(z: Any, h: float, order: int) -> float:
    total = 0.0
    for k in range(order, -1, -1):
        total = total * h + _term(z, _RATE, k)
    return total


@kernel
def _angle_after(z: Any, angle: float, h: float, order: int) -> float:
    total = 0.0
    for k in range(order - 1, -1, -1):
        total = total * h + _term(z, _RATE, k) / (k + 1.0)
    return angle + total * h


initialize, step = entry_functions(__name__, _set_up, _advance)
