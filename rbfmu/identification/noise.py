"""The noise of measured data: its size, and whether the residuals of a fit look like noise."""

import math
from collections.abc import Mapping

import numpy as np

from rbfmu.identification.measured import QUATERNION, Measured
from rbfmu.scene.section import POSITIVE, Numbers
from rbfmu.types import Array
from rbfmu_kernels.quantities import elements

FOLLOWS = 4.0
"""The largest correlation of successive residuals that may be noise, in standard deviations.

Of a hundred thousand columns of normal noise with 20 to 1,000 rows none came to 4; one in a thousand came to 3, so that
one fit in a hundred to seven columns would be doubted for nothing.
"""
TOO_FEW = int(FOLLOWS**2)
"""The number of rows up to which no correlation can be so large."""
OF_DEVIATION = 1.17
"""The standard deviation of `deviation` of n normal numbers, times the square root of n."""
STILL = 1e-9
"""A column has no noise if its residuals are smaller than this part of the largest column's of its output."""
LEAST_LEFT = 0.5
"""The least number of degrees of freedom that a fit must leave in an output to estimate its noise."""
SIGMA = Numbers((), "", *POSITIVE)
"""The rule of a given standard deviation."""
PART_OF_DIRECTION, OF_ERROR = 0.02, 3.0
"""A number is not determined if its part of an undetermined direction is larger than the first, or than OF_ERROR of its
own errors; less, as of a number that is zero within its error, hardly changes it."""
SMALL, LARGE = 0.1, 0.5
"""The limits of the relative excess of residuals over given noise that is accepted: for many numbers, and for few."""


def given_deviations(sigma: float | Mapping[str, float] | None, data: Measured) -> dict[str, float]:
    """Return the given standard deviations by output. Raises ValueError for an unknown output or a wrong number."""
    given = dict.fromkeys(data.values, sigma) if not isinstance(sigma, Mapping) else dict(sigma)
    if unknown := [name for name in given if name not in data.values]:
        raise ValueError(f"sigma: {unknown[0]!r}: expected some of {', '.join(data.values)}")
    return {name: SIGMA.read(value, f"sigma: {name}") for name, value in given.items() if value is not None}


def largest(name: str, rows: Array) -> float:
    """Return the size of an output to which its errors are relative: its largest number, 1 for an attitude."""
    return 1.0 if name == QUATERNION else float(np.nanmax(np.abs(rows), initial=0.0))


def size_of(name: str, rows: Array) -> float:
    """Return a first guess of the noise's standard deviation."""
    return 0.01 * largest(name, rows) or 1.0


def noisy(rows: Array) -> Array:
    """Return the numbers of residuals (times, k) without gaps, and without columns of zeros, such as of a zero rate."""
    sizes = np.sqrt(np.nansum(rows * rows, axis=0))
    found = rows[:, sizes >= STILL * np.max(sizes)]
    return np.asarray(found[np.isfinite(found)])


def deviation(known: Array) -> float:
    """Return the standard deviation of noise by the median of absolute values, which is robust against outliers."""
    return max(float(1.4826 * np.median(np.abs(known))), 1e-15) if len(known) else 1.0


def estimated(name: str, rows: Array, followed: float) -> float:
    """Return the standard deviation of an output's noise; followed: the degrees of freedom that the fit uses.

    Raises ValueError if too few degrees of freedom are left.
    """
    known = noisy(rows)
    left = len(known) - followed
    if not len(known):  # only gaps
        return 1.0
    if left < LEAST_LEFT:
        reason = f"{np.isfinite(rows).sum()} numbers of {name}: the fit follows them, which tells no noise"
        raise ValueError(f"data: {reason}: expected its sigma, or more of them")
    return deviation(known) * math.sqrt(len(known) / left)


def scatter(f: Array, loss: str, n: int, is_known: bool) -> float:
    """Return the factor of the covariance over that of least squares with unit noise.

    P. J. Huber, Robust Statistics, 1981, ch. 7, with his correction for few data. It is 1 if there are not more data
    than numbers, n, and for least squares with known noise.
    """
    if len(f) <= n or (is_known and loss == "linear"):
        return 1.0
    z = f * f
    slope, bend = {
        "linear": (np.ones_like(z), np.zeros_like(z)),
        "soft_l1": ((1.0 + z) ** -0.5, -0.5 * (1.0 + z) ** -1.5),
        "huber": (np.where(z <= 1.0, 1.0, np.maximum(z, 1.0) ** -0.5),
                  np.where(z <= 1.0, 0.0, -0.5 * np.maximum(z, 1.0) ** -1.5)),
        "cauchy": (1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2),
    }[loss]  # fmt: skip
    follows = slope + 2.0 * z * bend  # the derivative of each residual's influence
    mean = np.mean(follows)
    few = 1.0 + n / len(f) * np.var(follows) / mean**2
    return float(few**2 * np.sum(slope * slope * z) / (len(f) - n) / mean**2)


def are_lost(unknown: list[Array], errors: Array, turned: float) -> Array:
    """Return which numbers (n,) are not determined, as they belong to a direction that is not.

    unknown: directions (n,) of length 1, in which the fit may be off by about 1; errors (n,): of the numbers apart from
    these; both relative to sizes. turned: how far errors of derivatives turn directions, over errors.
    """
    parts = np.abs(np.reshape(unknown, (-1, len(errors))))
    return np.asarray(np.any(parts > np.minimum(PART_OF_DIRECTION, max(OF_ERROR, turned) * errors), axis=0))


def trends(left: Mapping[str, Array], own: Mapping[str, float] = {}) -> list[str]:
    """Return messages about residuals that do not look like noise, as successive ones are correlated.

    own: the error of the motion itself by output; residuals that are never larger give no message.
    """
    found = []
    for name, rows in left.items():
        shown = "attitude" if name == QUATERNION else name  # its residuals are rotation vectors
        for element, column in zip(elements(shown, rows.shape[1]), rows.T, strict=True):
            x = column[np.isfinite(column)]
            if len(x) <= TOO_FEW or np.max(np.abs(x)) <= own.get(name, 0.0):
                continue
            far = 3.0 * deviation(x)
            x = np.clip(x - np.median(x), -far, far)
            r = float(np.sum(x[1:] * x[:-1]) / (np.sum(x * x) or 1.0))
            if r > FOLLOWS / math.sqrt(len(x)):
                found.append(f"residuals of {element} follow each other (correlation {r:.2f}): not noise alone")
    return found


def are_too_few(left: Mapping[str, Array]) -> bool:
    """Return whether no column of residuals has enough rows to detect that they follow each other."""
    return all(np.max(np.isfinite(rows).sum(axis=0)) <= TOO_FEW for rows in left.values())


def too_large(f: Array, given: Mapping[str, float]) -> list[str]:
    """Return a message if residuals f, over their standard deviation, are larger than the given noise; else none."""
    size, by_chance = deviation(f), FOLLOWS * OF_DEVIATION / math.sqrt(len(f))
    too_much = size - 1.0 > np.clip(by_chance, SMALL, LARGE)
    return [f"residuals are {size:.3g} times the noise that was given"] if given and too_much else []
