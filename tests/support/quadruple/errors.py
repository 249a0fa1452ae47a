"""Errors against quadruple precision, counted as a scene's `accuracy` counts them."""

import numpy as np

FLOORS = {"position": 1.0, "velocity": 1.0}
ROUND_OFF = 64 * 2.0**-52
"""Of what a quantity is made of, whatever cancels in it: less than this is rest."""


def attitude_errors(q, high, low):
    """Angles in rad between rows q and high + low, exact to some 1e-16 of themselves."""
    q = q / np.linalg.norm(q, axis=1)[:, None]
    q = np.where(np.sum(q * high, axis=1)[:, None] < 0.0, -q, q)
    d = (q - high) - low
    w, v = high[:, :1], high[:, 1:]
    sine = w * d[:, 1:] - d[:, :1] * v - np.cross(v, d[:, 1:])
    return 2.0 * np.arcsin(np.minimum(np.linalg.norm(sine, axis=1), 1.0))


def quaternion_of_rpy(rpy):
    """Euler parameters of roll, pitch, yaw."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(0.5 * rpy.T), np.cos(0.5 * rpy.T)
    return np.stack([
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ], axis=1)  # fmt: skip


def least_size(name, truth):
    """What errors are relative to at least: of a quantity at rest, all that it is made of, whatever cancels in it."""
    rate, angular, linear, trace, mass, span = truth.scales
    turning = {
        "omega_b": rate, "omega_a": rate, "alpha_b": angular, "acceleration": linear,
        "angular_momentum_a": trace * rate, "kinetic_energy": trace * rate * rate + mass * (linear * span) ** 2,
    }  # fmt: skip
    size = turning.get(name, 0.0)
    rests = truth.sizes[name] <= (ROUND_OFF**2 if name == "kinetic_energy" else ROUND_OFF) * size
    return size if rests else FLOORS.get(name, 0.0)


def quantity_error(name, values, truth):
    """The largest error of rows of one quantity; infinite where one is not finite."""
    values = np.asarray(values, dtype=float).reshape(len(values), -1)
    if not np.all(np.isfinite(values)):
        return np.inf
    if name in ("quaternion", "rpy"):
        q = quaternion_of_rpy(values) if name == "rpy" else values
        return float(np.max(attitude_errors(q, truth.high["quaternion"], truth.low["quaternion"])))
    difference = np.linalg.norm((values - truth.high[name]) - truth.low[name], axis=1)
    size, error = max(truth.sizes[name], least_size(name, truth)), float(np.max(difference))
    return error / size if size > 0.0 else float(error > 0.0)


def errors(values, truth):
    """By quantity: name -> rows."""
    return {name: quantity_error(name, rows, truth) for name, rows in values.items()}
