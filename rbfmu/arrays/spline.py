"""Attitude and rates from measured quaternions, by a smooth spline through them."""

import numpy as np

from rbfmu.arrays import from_kernel, normalize, omega_b_from_quaternion_rate
from rbfmu.extras import needed
from rbfmu.types import Array, ArrayLike

FEWEST = 4
"""Times that a cubic spline without conditions at its ends needs."""


class AttitudeSpline:
    """A smooth attitude: `spline(t)` is q_ab (..., 4) at times t (...) in s, of one sign throughout.

    Times before the first or after the last that it was made of raise ValueError.
    """

    def __init__(self, times: Array, q_ab: Array) -> None:
        """q_ab: unit, and without jumps of sign."""
        self.times = times
        self._spline = needed("scipy.interpolate", "ensemble").CubicSpline(times, q_ab)

    def __call__(self, t: ArrayLike) -> Array:
        """Return q_ab (..., 4)."""
        return np.asarray(normalize(self._derivative(t, 0)))

    def omega_b(self, t: ArrayLike) -> Array:
        """Return omega_ab_b (..., 3), rad/s."""
        return self._turning(self._derivative(t, 0), self._derivative(t, 1))

    def alpha_b(self, t: ArrayLike) -> Array:
        """Return the angular acceleration d omega_ab_b / dt (..., 3), rad/s^2; between two times it is smooth."""
        s, ds, dds = (self._derivative(t, order) for order in (0, 1, 2))
        growth = 2.0 * np.sum(s * ds, axis=-1, keepdims=True) / np.sum(s * s, axis=-1, keepdims=True)
        return np.asarray(self._turning(s, dds) - growth * self._turning(s, ds))

    @staticmethod
    def _turning(s: Array, ds: Array) -> Array:
        """Return the angular velocity of s / |s|: what changes the length of s drops out of the formula for unit q."""
        return np.asarray(omega_b_from_quaternion_rate(s, ds) / np.sum(s * s, axis=-1, keepdims=True))

    def _derivative(self, t: ArrayLike, order: int) -> Array:
        t = from_kernel.as_floats("attitude_spline", "t", t)
        first, last = self.times[0], self.times[-1]
        if not np.all((t >= first) & (t <= last)):
            raise ValueError(f"attitude_spline: t must be times from {first:g} to {last:g} s, those that it is made of")
        return np.asarray(self._spline(t, order))


def attitude_spline(times: ArrayLike, q_ab: ArrayLike) -> AttitudeSpline:
    """Return a spline through attitudes, whose rates and accelerations are continuous.

    It is SciPy's CubicSpline (not-a-knot) through quaternions whose signs are made continuous, scaled to length 1; so
    it is the same in any frames. SciPy's RotationSpline, which is exact for a constant rate, takes the mean rate of
    the first and of the last step for the rates at the ends, and is far off there. Between two times the body must
    turn by less than half a turn, and by less than a quarter for good rates. Noise is not smoothed: random errors e of
    attitudes h apart give the rates errors of some 2 e / h, at the ends of some 5 e / h.
    Shapes: times (m), q_ab (m, 4), m >= 4.
    Units: times in s, increasing; q_ab has either sign and any length.  Frames: q_ab takes coordinates in b to a; rates
    are those of b relative to a, in b.
    Error: without noise, of attitudes as h^4, of rates as h^3.  Source: C. de Boor, A Practical Guide to Splines, IV.
    """
    t, q = _numbers("times", times), _numbers("q_ab", q_ab)
    expected = f"attitude_spline: times must be {FEWEST} or more in one row that increase"
    if t.ndim != 1 or len(t) < FEWEST:
        raise ValueError(f"{expected}, got shape {t.shape}")
    if back := np.flatnonzero(np.diff(t) <= 0.0).tolist():
        raise ValueError(f"{expected}, got times[{back[0] + 1}] = {t[back[0] + 1]} after {t[back[0]]}")
    if q.shape != (len(t), 4):
        raise ValueError(f"attitude_spline: q_ab must have shape ({len(t)}, 4), one for each time, got {q.shape}")
    q = normalize(q)
    if bad := np.flatnonzero(np.isnan(q).any(axis=1)).tolist():
        raise ValueError(f"attitude_spline: q_ab[{bad[0]}] must be finite and not zero")
    turned = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    return AttitudeSpline(t, q * np.cumprod([1.0, *turned])[:, np.newaxis])


def _numbers(argument: str, value: ArrayLike) -> Array:
    array = from_kernel.as_floats("attitude_spline", argument, value).copy()  # the caller may change its own
    if bad := np.argwhere(~np.isfinite(array)).tolist():
        place = ", ".join(map(str, bad[0]))
        raise ValueError(f"attitude_spline: {argument} must be finite numbers, got {array[*bad[0]]} at [{place}]")
    return array
