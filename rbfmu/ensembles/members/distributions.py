"""From points of the unit cube to values: the inverse distribution function of each number."""

import math
from collections.abc import Callable, Mapping
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene.marginals import LOGNORMAL, NORMAL, RELATIVE, TRIANGULAR, UNIFORM, Marginal

Array = NDArray[np.float64]
_STANDARD = NormalDist()
SCORED = (NORMAL, RELATIVE, LOGNORMAL)
"""Kinds whose values are made of normal scores."""


def mapped(function: Callable[[float], float], numbers: Array) -> Array:
    """Return a function of Python's floats of each number; unlike NumPy's, its bits do not depend on the array."""
    return np.fromiter(map(function, numbers.tolist()), np.float64, len(numbers))


def normal_scores(u: Array) -> Array:
    """Return where the standard normal distribution function is u, 0 < u < 1; error <= 4 eps."""
    return mapped(_STANDARD.inv_cdf, u)


def probabilities(z: Array) -> Array:
    """Return the standard normal distribution function inside (0, 1)."""
    return np.clip(mapped(_STANDARD.cdf, z), 2.0**-1000, 1.0 - 2.0**-53)


def values_of(marginal: Marginal, u: Array) -> Array:
    """Return the values of a number at places u of its distribution function, 0 < u < 1 (0 and 1 if it is bounded).

    Those of a number that is relative are factors of the scene's.
    """
    if marginal.kind in SCORED:
        return of_scores(marginal, normal_scores(u))
    return _BOUNDED[marginal.kind](*marginal.arguments, u)


def of_scores(marginal: Marginal, z: Array) -> Array:
    """Return the values of a number whose standard normal score is z."""
    if marginal.kind == NORMAL:
        mean, deviation = marginal.arguments
        return mean + deviation * z
    if marginal.kind == RELATIVE:
        return 1.0 + marginal.arguments[0] * z
    if marginal.kind == LOGNORMAL:
        median, deviation = marginal.arguments
        return median * mapped(math.exp, deviation * z)
    return values_of(marginal, probabilities(z))


def _uniform(low: float, high: float, u: Array) -> Array:
    return np.clip((1.0 - u) * low + u * high, low, high)


def _triangular(low: float, mode: float, high: float, u: Array) -> Array:
    width, rise = high - low, mode - low
    up = low + np.sqrt(u * width * rise)
    down = high - np.sqrt((1.0 - u) * width * (high - mode))
    return np.clip(np.where(u * width < rise, up, down), low, high)


_BOUNDED: Mapping[str, Callable[..., Array]] = {UNIFORM: _uniform, TRIANGULAR: _triangular}
