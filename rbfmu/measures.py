"""Errors between two results: attitude in rad, all else relative, as a scene's `accuracy` counts them."""

import numpy as np
from numpy.typing import NDArray

from rbfmu.arrays import angle_between as attitude_error

__all__ = ["attitude_error", "largest_error", "relative_error"]

Array = NDArray[np.float64]


def relative_error(a: Array, b: Array, floor: float) -> Array:
    """|a - b| over rows of (n, 3), relative to the largest |b| of the run, at least `floor`."""
    largest = max(float(np.max(np.linalg.norm(b, axis=-1), initial=0.0)), floor)
    error: Array = np.linalg.norm(a - b, axis=-1)
    return error if largest == 0.0 else error / largest


def largest_error(z_1: dict[str, Array], z_2: dict[str, Array]) -> float:
    """The largest error over a run in the quantities that `accuracy` speaks of; infinite where one is not finite."""
    errors = [
        attitude_error(z_1["quaternion"], z_2["quaternion"]),
        relative_error(z_1["omega_b"], z_2["omega_b"], 0.0),
        relative_error(z_1["position"], z_2["position"], 1.0),
        relative_error(z_1["velocity"], z_2["velocity"], 1.0),
    ]
    worst = float(np.max(np.concatenate(errors)))  # NaN if any is: Python's max would lose it
    return worst if np.isfinite(worst) else np.inf
