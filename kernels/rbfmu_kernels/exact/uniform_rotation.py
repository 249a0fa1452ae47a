"""Turns at a constant rate about a fixed axis: whole turns are dropped in double-double, so the error does not grow."""

from typing import NamedTuple

from ..buffer_access import record
from ..compile.decorator import kernel
from ..numerics import double_double as dd, elementary
from ..types import Buffer, Quaternion, Vec3

ONE_OVER_4PI: dd.DoubleDouble = (0.07957747154594767, -4.919669168795622e-18)


class Turning(NamedTuple):
    """A unit axis, and the rate about it over 4 pi, 1/s."""

    axis: Vec3
    rate: dd.DoubleDouble


TURNING_SIZE, put_turning, _read_turning, _ = record(Turning)


@kernel
def turning_at(z: Buffer, i: int) -> Turning:
    """Return the turning that begins at z[i]."""
    return _read_turning(z[i : i + TURNING_SIZE])


@kernel
def without_turns(a: dd.DoubleDouble, t: dd.DoubleDouble) -> dd.DoubleDouble:
    """Return the product a t minus an integer, within [-1, 1]."""
    high, low = dd.two_product(a[0], t[0])
    low += a[1] * t[0] + a[0] * t[1]
    high, low = dd.two_sum(high - elementary.round_to_integer(high), low)
    return (high - elementary.round_to_integer(high), low)


@kernel
def rotation_after(turning: Turning, t: dd.DoubleDouble) -> Quaternion:
    """Return the rotation of a turning after a time t, s."""
    axis, rate = turning
    high, low = without_turns(rate, t)
    s, c = elementary.sincos_half_turns(2.0 * high, 2.0 * low)
    return (c, s * axis[0], s * axis[1], s * axis[2])


@kernel
def power_for(v: dd.Vector) -> float:
    """Return a power of two that brings a vector to a size of about 1."""
    return elementary.power_of_two_for(max(max(abs(v[0][0]), abs(v[1][0])), abs(v[2][0])))


@kernel
def turning_about(omega: dd.Vector) -> Turning:
    """Return the turning of a constant rate omega, rad/s, of any size."""
    up = power_for(omega)
    v = dd.scale_vector(up, omega)
    rate = dd.root(dd.dot(v, v))
    inverse = 1.0 / rate[0] if rate[0] != 0.0 else 1.0
    axis = (inverse * v[0][0], inverse * v[1][0], inverse * v[2][0])
    return Turning(axis, dd.scale(1.0 / up, dd.multiply(rate, ONE_OVER_4PI)))


@kernel
def symmetric_turnings(i_t: dd.DoubleDouble, i_s: dd.DoubleDouble, omega: dd.Vector) -> tuple[Turning, Turning]:
    """Return (A, B) of a free body with moments i_t, i_t, i_s and rate omega: q(t) = q(0) A(t) B(t).

    A turns about the angular momentum by its size over i_t, B about the third axis by omega_3 (1 - i_s / i_t).
    i_t > 0. Moments in kg m^2 and omega in rad/s may have any size.
    """
    up = power_for(omega)
    shrink = elementary.power_of_two_for(max(i_t[0], i_s[0]))
    i_t, i_s = dd.scale(shrink, i_t), dd.scale(shrink, i_s)
    w_1, w_2, w_3 = dd.scale_vector(up, omega)
    m_1, m_2, m_3 = dd.multiply(i_t, w_1), dd.multiply(i_t, w_2), dd.multiply(i_s, w_3)
    axis, momentum = turning_about((m_1, m_2, m_3))
    own = dd.divide(dd.multiply(dd.subtract(i_t, i_s), w_3), i_t)
    own = dd.multiply(own, ONE_OVER_4PI)
    down = 1.0 / up
    return Turning(axis, dd.scale(down, dd.divide(momentum, i_t))), Turning((0.0, 0.0, 1.0), dd.scale(down, own))
