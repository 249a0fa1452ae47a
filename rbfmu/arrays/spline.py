"""Attitude, rates and accelerations from measured quaternions, by a smooth spline through them."""

import numpy as np

from rbfmu.arrays import from_kernel, normalize, omega_b_from_quaternion_rate
from rbfmu.extras import needed
from rbfmu.types import Array, ArrayLike

FEWEST = 4
"""The least number of times for a cubic spline without conditions at its ends."""


class AttitudeSpline:
    """A smooth attitude: `spline(t)` returns q_ab (..., 4), without changes of sign, at times t (...) in s.

    Times before the first or after the last given time raise ValueError.
    """

    def __init__(self, times: Array, q_ab: Array) -> None:
        """Make the spline of q_ab (m, 4), of length 1 and without changes of sign, at times (m) in s that increase."""
        self.times = times
        self._spline = needed("scipy.interpolate", "ensemble").CubicSpline(times, q_ab)

    def __call__(self, t: ArrayLike) -> Array:
        """Return q_ab (..., 4), of length 1."""
        return np.asarray(normalize(self._derivative(t, 0)))

    def omega_b(self, t: ArrayLike) -> Array:
        """Return omega_ab_b (..., 3), rad/s."""
        return self._turning(self._derivative(t, 0), self._derivative(t, 1))

    def alpha_b(self, t: ArrayLike) -> Array:
        """Return the angular acceleration d omega_ab_b / dt (..., 3), rad/s^2; smooth between the given times."""
        s, ds, dds = (self._derivative(t, order) for order in (0, 1, 2))
        growth = 2.0 * np.sum(s * ds, axis=-1, keepdims=True) / np.sum(s * s, axis=-1, keepdims=True)
        return np.asarray(self._turning(s, dds) - growth * self._turning(s, ds))

    @staticmethod
    def _turning(s: Array, ds: Array) -> Array:
        """Return the angular velocity of s / |s|; the part of ds along s drops out of the formula for unit q."""
        return np.asarray(omega_b_from_quaternion_rate(s, ds) / np.sum(s * s, axis=-1, keepdims=True))

    def _derivative(self, t: ArrayLike, order: int) -> Array:
        t = from_kernel.as_floats("attitude_spline", "t", t)
        first, last = self.times[0], self.times[-1]
        if outside := t[~((t >= first) & (t <= last))].tolist():
            raise ValueError(f"attitude_spline: t must be times from {first:g} to {last:g} s, got {outside[0]!r}")
        return np.asarray(self._spline(t, order))


def attitude_spline(times: ArrayLike, q_ab: ArrayLike) -> AttitudeSpline:
    """Return a spline through attitudes, with continuous rates and accelerations.

    It is SciPy's CubicSpline (not-a-knot) through quaternions whose signs are made continuous, scaled to length 1. It
    does not depend on the choice of frames. SciPy's RotationSpline is exact for a constant rate, but is far off at the
    ends, since it uses the mean rates of the first and of the last step there. Between two times the body must turn by
    less than half a turn, and by less than a quarter for good rates. Noise is not smoothed: random errors e of
    attitudes h apart cause errors of the rates of about 2 e / h, and of about 5 e / h at the ends.
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
    unit = normalize(q)
    if bad := np.flatnonzero(np.isnan(unit).any(axis=1)).tolist():
        raise ValueError(f"attitude_spline: q_ab[{bad[0]}] must be finite and not zero, got {q[bad[0]].tolist()}")
    turned = np.where(np.sum(unit[1:] * unit[:-1], axis=1) < 0.0, -1.0, 1.0)
    return AttitudeSpline(t, unit * np.cumprod([1.0, *turned])[:, np.newaxis])


def _numbers(argument: str, value: ArrayLike) -> Array:
    array = from_kernel.as_floats("attitude_spline", argument, value).copy()  # the caller may change its own
    if bad := np.argwhere(~np.isfinite(array)).tolist():
        place = ", ".join(map(str, bad[0]))
        raise ValueError(f"attitude_spline: {argument} must be finite numbers, got {array[*bad[0]]} at [{place}]")
    return array
