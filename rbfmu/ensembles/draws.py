"""The numbers that are drawn for members: points of the unit cube, and their values by the distribution of each number.

Points are random, or from a low-discrepancy sequence, a Latin hypercube or a grid. Correlated numbers have correlated
normal scores (a Gaussian copula).

Member i's row depends only on the ensemble's definition and i, whichever other members are drawn.
"""

import hashlib
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from statistics import NormalDist

import numpy as np

from rbfmu.extras import needed
from rbfmu.scene.ensemble import GRID, LATIN_HYPERCUBE, RANDOM, SOBOL, Correlation, Ensemble, lower_factor
from rbfmu.scene.variations import LOGNORMAL, NORMAL, RELATIVE, TRIANGULAR, UNIFORM, Marginal
from rbfmu.types import Array, NDArray

WORDS = 4
"""How many numbers Philox returns for one value of its counter.

Philox maps a counter and a key to random words without any state (Salmon, Moraes, Dror and Shaw, Parallel random
numbers: as easy as 1, 2, 3, SC11). So a member's numbers do not require those of the members before it.
"""
SOBOL_BITS = 30
"""The bits of a coordinate of Sobol's sequence: 2**30 different points, more than any ensemble has runs."""


def points(ensemble: Ensemble, first: int, count: int) -> Array:
    """Return points (count, n) inside the unit cube, of the members from `first` on; n is how many numbers vary."""
    return _DESIGNS[ensemble.design](ensemble, first, count)


def key_of(seed: int, name: str) -> NDArray[np.uint64]:
    """Return the key of Philox for the stream of a name."""
    digest = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return np.array([seed, int.from_bytes(digest, "little")], dtype=np.uint64)


def uniform(seed: int, name: str, first: int, count: int, attempt: int = 0) -> Array:
    """Return the numbers (count,) inside (0, 1) of members from `first` on, by Philox with the key of seed and name.

    attempt: a part of the counter; another attempt gives independent numbers. The stream of a number has its name in
    the key, so that it does not depend on which other numbers vary.
    """
    start = first // WORDS
    stream = np.random.Philox(key=key_of(seed, name), counter=np.array([start, attempt, 0, 0], dtype=np.uint64))
    raw = stream.random_raw((first + count + WORDS - 1) // WORDS * WORDS - start * WORDS)
    kept = raw[first - start * WORDS :][:count] >> np.uint64(11)
    # 53 bits are what a float holds; the middles of their cells are neither 0 nor 1, where normal scores are infinite.
    return (kept.astype(np.float64) + 0.5) * 2.0**-53


def at_random(ensemble: Ensemble, first: int, count: int, attempt: int = 0) -> Array:
    """Return members' random points (count, n), whatever the design; another attempt gives independent points."""
    columns = [uniform(ensemble.seed, marginal.name, first, count, attempt) for marginal in ensemble.varying]
    return np.column_stack(columns)


def _sobol(ensemble: Ensemble, first: int, count: int) -> Array:
    """Return points of Sobol's sequence, scrambled by a random matrix and shift (Matousek 1998), by SciPy.

    Half a cell is added: a point at 0, as any scrambled sequence may have, has no normal score.
    """
    qmc = needed("scipy.stats.qmc", "ensemble")
    sequence = qmc.Sobol(len(ensemble.varying), scramble=True, bits=SOBOL_BITS, rng=_generator(ensemble.seed))
    head = np.empty((0, sequence.d))
    if first:
        sequence.fast_forward(first)
    else:
        head = sequence.random(1)  # SciPy warns if the size of the first batch is not a power of 2
    return np.concatenate([head, sequence.random(count - len(head))]) + 0.5 ** (SOBOL_BITS + 1)


@lru_cache(maxsize=2)
def _hypercube(dimensions: int, runs: int, seed: int) -> Array:
    """Return all rows (runs, dimensions), as each depends on how many there are: 8 bytes for each number.

    Each number has one value in each of `runs` equal parts (McKay, Beckman and Conover, Technometrics 21, 1979).
    """
    cube: Array = needed("scipy.stats.qmc", "ensemble").LatinHypercube(dimensions, rng=_generator(seed)).random(runs)
    np.clip(cube, 2.0**-54, 1.0 - 2.0**-53, out=cube)
    cube.flags.writeable = False
    return cube


def _generator(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


def _grid(ensemble: Ensemble, first: int, count: int) -> Array:
    """Return points of a grid; the last number changes from each member to the next."""
    axes = [_places(marginal) for marginal in ensemble.varying]
    places = np.unravel_index(np.arange(first, first + count), [len(axis) for axis in axes])
    return np.column_stack([axis[place] for axis, place in zip(axes, places, strict=True)])


def _places(marginal: Marginal) -> Array:
    """Return a number's places in the grid: with both ends if it is uniform, else the middles of equal parts."""
    n = marginal.points
    return np.arange(n) / (n - 1) if marginal.kind == UNIFORM and n > 1 else (np.arange(n) + 0.5) / n


_DESIGNS: Mapping[str, Callable[[Ensemble, int, int], Array]] = {
    RANDOM: at_random,
    SOBOL: _sobol,
    LATIN_HYPERCUBE: lambda asked, i, n: _hypercube(len(asked.varying), asked.runs, asked.seed)[i : i + n],
    GRID: _grid,
}


def map_floats(function: Callable[[float], float], numbers: Array) -> Array:
    """Return a function of floats, evaluated for each number; unlike NumPy's, its bits do not depend on the array."""
    return np.fromiter(map(function, numbers.tolist()), np.float64, len(numbers))


_MIDDLE, _FAR = 0.425, 5.0
"""Where the algorithm below changes its rational function: a value of |u - 1/2|, and of sqrt(-ln p), p the tail."""
_MEDIAN, _TAILS, _FAR_TAILS = np.loadtxt(Path(__file__).with_name("normal_scores.csv"), delimiter=",").reshape(3, 2, 8)
"""The rational functions of M. J. Wichura's algorithm AS 241, Applied Statistics 37, 1988: numerator, denominator."""


def _ratio(part: Array, r: Array, factor: Array | float = 1.0) -> Array:
    above, below = part
    return np.asarray(np.polyval(above, r) * factor / np.polyval(below, r))


def normal_scores(u: Array) -> Array:
    """Return the inverse of the standard normal distribution function at u, 0 < u < 1; error <= 4 eps.

    It uses sums, products and square roots, which NumPy rounds correctly, and Python's logarithm, as the bits of
    NumPy's depend on the processor. The bits are those of `statistics.NormalDist`.
    """
    q = u - 0.5
    r = 0.180625 - q * q  # the square of _MIDDLE, as the algorithm has it
    found = _ratio(_MEDIAN, r, q)
    tails = np.flatnonzero(np.abs(q) > _MIDDLE)
    r = np.sqrt(-map_floats(math.log, np.where(q[tails] <= 0.0, u[tails], 1.0 - u[tails])))
    x = _ratio(_TAILS, r - 1.6)
    far = np.flatnonzero(r > _FAR)
    x[far] = _ratio(_FAR_TAILS, r[far] - _FAR)
    found[tails] = np.copysign(x, q[tails])
    return found


def probabilities(z: Array) -> Array:
    """Return the standard normal distribution function at z, kept inside (0, 1)."""
    return np.clip(map_floats(NormalDist().cdf, z), 2.0**-1000, 1.0 - 2.0**-53)


def values_of(marginal: Marginal, u: Array, z: Array | None = None) -> Array:
    """Return the values of a number where its distribution function is u, 0 < u < 1 (0 <= u <= 1 if it is bounded).

    z: normal scores to use in place of u. Values of a relative number are factors on the scene's number.
    """
    if marginal.kind in _SCORED:
        return _SCORED[marginal.kind](*marginal.arguments, normal_scores(u) if z is None else z)
    return _BOUNDED[marginal.kind](*marginal.arguments, u if z is None else probabilities(z))


def _uniform(low: float, high: float, u: Array) -> Array:
    return np.clip((1.0 - u) * low + u * high, low, high)


def _triangular(low: float, mode: float, high: float, u: Array) -> Array:
    width, rise = high - low, mode - low
    up = low + np.sqrt(u * width * rise)
    down = high - np.sqrt((1.0 - u) * width * (high - mode))
    return np.clip(np.where(u * width < rise, up, down), low, high)


_BOUNDED: Mapping[str, Callable[..., Array]] = {UNIFORM: _uniform, TRIANGULAR: _triangular}
"""The inverse of each bounded distribution function, by its arguments and u."""


def _exponential(x: float) -> float:
    """Return exp x, or infinity if it overflows: then this member is refused, and no other."""
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


_SCORED: Mapping[str, Callable[..., Array]] = {
    NORMAL: lambda mean, deviation, z: mean + deviation * z,
    RELATIVE: lambda deviation, z: 1.0 + deviation * z,
    LOGNORMAL: lambda median, deviation, z: median * map_floats(_exponential, deviation * z),
}
"""The values of each normal distribution, by its arguments and normal scores."""


def correlated_values(ensemble: Ensemble, cube: Array) -> dict[str, Array]:
    """Return the values (count,) of all numbers that vary, by name, at points (count, n) of the unit cube."""
    marginals = ensemble.varying
    scores = _scores_by_correlation(ensemble.correlation, {m.name: cube[:, k] for k, m in enumerate(marginals)})
    return {m.name: values_of(m, cube[:, k], scores.get(m.name)) for k, m in enumerate(marginals)}


def _scores_by_correlation(correlation: Correlation | None, places: dict[str, Array]) -> dict[str, Array]:
    """Return the normal scores of the correlated numbers.

    They are summed term by term, as a product of matrices may round differently in a larger chunk.
    """
    if correlation is None:
        return {}
    factor = lower_factor(correlation.correlations)
    assert factor is not None
    independent = [normal_scores(places[name]) for name in correlation.components]
    found = {}
    for name, row in zip(correlation.components, factor, strict=True):
        total = np.zeros(len(independent[0]))
        for share, z in zip(row, independent, strict=True):
            if share:
                total = total + share * z
        found[name] = total
    return found
