"""Errors between two results: attitude in rad, all else relative, as a scene's `accuracy` counts them."""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from rbfmu import arrays
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.quantities import ANGLE, OUTPUT, OUTPUTS
from rbfmu_kernels.rotations.quaternion import angle_between

__all__ = ["attitude_error", "largest_error", "relative_error"]

Array = NDArray[np.float64]
FEW = 20_000
"""The number of rows up to which the array function is not worth its compilation."""
FLOORS: Mapping[str, float] = {row.name: row.floor for row in OUTPUTS if row.floor}
"""The least size, m or m/s, that an error is relative to, by the quantity's name."""


def attitude_error(a: Array, b: Array) -> Array:
    """Return the angles, rad, between attitudes: unit quaternions (..., 4)."""
    if np.ndim(a) != 2 or np.shape(a) != np.shape(b) or len(a) > FEW:
        return arrays.angle_between(a, b)  # type: ignore[no-any-return]
    angle = tiered(angle_between)
    return np.array([angle(tuple(p), tuple(q)) for p, q in zip(a, b, strict=True)])


def relative_error(a: Array, b: Array, floor: float) -> Array:
    """Return |a - b| over rows of (n, 3), relative to the largest |b| of the run, at least `floor`."""
    return sizes(a - b, max(largest_size(b), floor) or 1.0)


def largest_size(rows: Array) -> float:
    """Return the largest length of a row, without overflow."""
    unit = float(np.max(np.abs(rows), initial=0.0))
    return unit * float(np.max(sizes(rows, unit))) if 0.0 < unit < math.inf else unit


def sizes(rows: Array, unit: float) -> Array:
    """Return the lengths of rows, in units of one."""
    lengths: Array = np.linalg.norm(rows / unit, axis=-1)
    return lengths


def largest_error(
    a: Mapping[str, Array], b: Mapping[str, Array], names: Iterable[str], floors: Mapping[str, float] = FLOORS
) -> float:
    """Return the largest error of a run in the quantities named; infinite where one is not finite.

    floors: the least size that an error is relative to, by the quantity's name and in its unit.
    """
    worst = 0.0
    for name in names:
        if OUTPUT[name].error == ANGLE:
            errors = attitude_error(a[name], b[name])
        else:
            errors = relative_error(a[name], b[name], floors.get(name, 0.0))
        largest = float(np.max(errors))
        worst = max(worst, largest) if math.isfinite(largest) else math.inf
    return worst
