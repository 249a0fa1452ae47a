"""Mean, covariance and quantiles over time, merged chunk by chunk: the same bits whatever ran where.

Sums are merged in the order of the chunks, as floating-point sums depend on their order. Quantiles come of a sketch:
sorted points of equal weight stand for the values, those of 1, 2, 4, ... chunks, and two of a level are merged into one
of the next (Munro and Paterson 1980; Manku, Rajagopalan and Lindsay 1998). Its memory grows with the logarithm of the
runs, and the largest error of a rank is known. `loops.add_moments` is Welford's recurrence (Technometrics 4, 1962),
which does not lose the digits that a sum of squares less the square of the sum loses.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.loops import add_moments, compiled, merge_points

Array = NDArray[np.float64]

MOST_POINTS, LEAST_POINTS = 256, 32
"""Points that stand for the values of many members at one instant."""
MOST_NUMBERS = 4_000_000
"""The largest number of numbers in one table of points; of such tables there is one for each doubling of the runs."""


class Points(NamedTuple):
    """Sorted values (c, p) of c numbers, each of which stands for `weight` members; error: of their ranks, at most."""

    values: Array
    weight: float
    error: float

    @property
    def members(self) -> float:
        """Return how many members the points stand for."""
        return self.weight * float(self.values.shape[1])


class Summary(NamedTuple):
    """What is known of the members of a chunk: mean (n, K), sums of products of deviations (n, P), points."""

    members: int
    mean: Array
    products: Array
    points: Points


def most_points(numbers: int) -> int:
    """Return how many points are kept of each of n K numbers: fewer where there are many."""
    fitting = MOST_NUMBERS // max(numbers, 1)
    return min(max(1 << max(fitting.bit_length() - 1, 0), LEAST_POINTS), MOST_POINTS)


def summary_of(rows: Array, good: NDArray[np.int64], pairs: NDArray[np.int64], chunk: int) -> Summary:
    """Return the summary of those rows (m, n, K) of a chunk that are good."""
    _, points, width = rows.shape
    mean, products = np.zeros((points, width)), np.zeros((points, len(pairs)))
    compiled(add_moments)(rows, good, pairs, mean, products, 0)
    values = np.ascontiguousarray(rows[good].reshape(len(good), points * width).T)
    values.sort(axis=1)
    whole = Points(values, 1.0, 0.0)
    return Summary(len(good), mean, products, merged_points(whole, None, most_points(points * width), chunk))


def merged_points(a: Points, b: Points | None, most: int, turn: int) -> Points:
    """Return the points of both together, at most so many.

    turn: an even one takes early points of the merged ones, an odd one late points, so that errors cancel.
    """
    other = b or Points(np.empty((len(a.values), 0)), 1.0, 0.0)
    p, q = a.values.shape[1], other.values.shape[1]
    exact = p + q <= most and (q == 0 or p == 0 or a.weight == other.weight)
    count = p + q if exact else min(most, p + q)
    values = np.empty((len(a.values), count))
    # A point at the phase 0.25 or 0.75 of its part is off by up to 0.75 of the part's weight, early or late in turn.
    phase = 0.5 if exact else (0.25, 0.75)[turn % 2]
    compiled(merge_points)(a.values, a.weight, other.values, other.weight, phase, values)
    weight = (a.members + other.members) / max(count, 1)
    return Points(values, weight, a.error + other.error + (0.0 if exact else 0.75 * weight))


@dataclass
class Statistics:
    """The statistics of the members of chunks 0, 1, ... that were added; levels: points of 1, 2, 4, ... chunks."""

    count: int
    chunks: int
    mean: Array
    products: Array
    levels: list[Points | None] = field(default_factory=list)

    @classmethod
    def none(cls, points: int, width: int, pairs: int) -> "Statistics":
        """Return the statistics of no member."""
        return cls(0, 0, np.zeros((points, width)), np.zeros((points, pairs)))

    def add(self, new: Summary, pairs: NDArray[np.int64]) -> None:
        """Add the next chunk.

        Mean and products are merged as Chan, Golub and LeVeque do (The American Statistician 37, 1983): the deviation
        of the means is what both groups add to the products besides their own.
        """
        self.chunks += 1
        if new.members:
            both = self.count + new.members
            apart = new.mean - self.mean
            share = self.count * (new.members / both)
            self.products += new.products + share * (apart[:, pairs[:, 0]] * apart[:, pairs[:, 1]])
            self.mean += apart * (new.members / both)
            self.count = both
        self._add_points(new.points)

    def _add_points(self, new: Points) -> None:
        most = most_points(self.mean.size)
        for level, there in enumerate(self.levels):
            if there is None:
                self.levels[level] = new
                return
            self.levels[level] = None
            new = merged_points(there, new, most, self.chunks >> (level + 1))
        self.levels.append(new)

    def means(self) -> Array:
        """Return the means (n, K), NaN of no member."""
        return self.mean if self.count else np.full_like(self.mean, np.nan)

    def covariance(self) -> Array:
        """Return the covariances (n, P) of the pairs, NaN of fewer than two members."""
        return self.products / (self.count - 1) if self.count > 1 else np.full_like(self.products, np.nan)

    def quantiles(self, probabilities: Array) -> Array:
        """Return the quantiles (q, n, K): values at which so large a part of the members is passed."""
        values, weights = self._weighted()
        found = np.full((len(probabilities), *self.mean.shape), np.nan)
        if not values.shape[1]:
            return found
        for first in range(0, len(values), 1024):
            block = slice(first, first + 1024)
            order = np.argsort(values[block], axis=1, kind="stable")
            sorted_values = np.take_along_axis(values[block], order, axis=1)
            ranks = np.cumsum(weights[order], axis=1) - 0.5 * weights[order]
            wanted = probabilities * weights.sum()
            interpolated = [np.interp(wanted, r, v) for v, r in zip(sorted_values, ranks, strict=True)]
            found.reshape(len(found), -1)[:, block] = np.array(interpolated).T
        return found

    def _weighted(self) -> tuple[Array, Array]:
        held = [points for points in self.levels if points is not None and points.values.shape[1]]
        if not held:
            return np.empty((self.mean.size, 0)), np.empty(0)
        weights = np.concatenate([np.full(points.values.shape[1], points.weight) for points in held])
        return np.concatenate([points.values for points in held], axis=1), weights

    @property
    def rank_error(self) -> float:
        """Return by which part of all members the ranks of quantiles are wrong at most; 0 where all values are kept."""
        return sum(points.error for points in self.levels if points is not None) / max(self.count, 1)

    def to_arrays(self) -> dict[str, Any]:
        """Return arrays from which `from_arrays` makes the same."""
        arrays: dict[str, Any] = {"counts": np.array([self.count, self.chunks, len(self.levels)])}
        arrays |= {"mean": self.mean, "products": self.products}
        for level, points in enumerate(self.levels):
            if points is not None:
                arrays |= {f"points_{level}": points.values, f"weight_{level}": np.array([points.weight, points.error])}
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> "Statistics":
        """Return the inverse of `to_arrays`."""
        count, chunks, levels = (int(n) for n in arrays["counts"])
        points = [_points(arrays, level) for level in range(levels)]
        return cls(count, chunks, np.array(arrays["mean"]), np.array(arrays["products"]), points)


def _points(arrays: Mapping[str, Any], level: int) -> Points | None:
    if f"points_{level}" not in arrays:
        return None
    weight, error = arrays[f"weight_{level}"].tolist()
    return Points(np.ascontiguousarray(arrays[f"points_{level}"]), weight, error)


def exact_quantiles(values: Array, probabilities: Array) -> Array:
    """Return the quantiles (q, ...) over the first axis, NaN left out: as those of the points of all members.

    Value i of n has the rank (i - 1/2) / n (Hazen), as a point in the middle of its weight has above.
    """
    good = values[~np.isnan(values).reshape(len(values), -1).any(axis=1)]
    if not len(good):
        return np.full((len(probabilities), *values.shape[1:]), np.nan)
    return np.quantile(good, probabilities, axis=0, method="hazen")
