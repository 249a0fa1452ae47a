"""Mean, covariance and quantiles over time, made chunk by chunk: the same bits whatever ran where.

Who runs a chunk sums it up; what is merged after that is small. Sums are merged in the order of the chunks, as
floating-point sums depend on their order. Quantiles come of a sketch: of the sorted values of a chunk every w-th stands
for w of them, and eight such sets are sorted together and thinned out to one of the next level (Munro and Paterson
1980; Manku, Rajagopalan and Lindsay 1998). Its memory grows with the logarithm of the runs, and the largest error of a
rank is known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rbfmu.ensembles.attitudes import ATTITUDE, around
from rbfmu.ensembles.loops import LANES, compiled, in_order, moments
from rbfmu.ensembles.variables import Columns
from rbfmu.types import Array, Indices

MOST_POINTS, LEAST_POINTS = 256, 32
"""Points that stand for the values of many members at one instant."""
MOST_NUMBERS = 4_000_000
"""The largest number of numbers in one table of points, of which there are SETS for each level."""
MOST_SAMPLED = 1024
"""Members of whose attitudes some are kept as they are, on average, for their angles from a mean that all make."""
SETS = 8
"""Sets of points of a level that become one of the next."""
LEAST_WEIGHT = 8
"""For how many members a point stands where not all fit: what is left to merge is so much less than what was run."""
SUMMED_AT_ONCE = 100_000
"""Numbers that are summed up and sorted together: more lie side by side where rows are long, fewer stay in a cache."""


class Points(NamedTuple):
    """Sorted values (c, p) of c numbers; each stands for `weight` of so many members.

    members: those that failed are counted as well, so that all sets of a level have the same weight. error: of ranks,
    at most.
    """

    values: Array
    weight: int
    members: int
    error: float


class Sample(NamedTuple):
    """Attitudes (s, n, 4) of members that are taken by chance, and what decides whether they are: keys (s,)."""

    keys: Array
    values: Array


class Summary(NamedTuple):
    """What is known of the members of a chunk: mean (n, W), sums of products of deviations (n, P), points, sample."""

    members: int
    mean: Array
    products: Array
    points: Points
    sample: Sample | None = None


def most_points(numbers: int) -> int:
    """Return how many points are kept of each of n K numbers: fewer where there are many."""
    fitting = MOST_NUMBERS // max(numbers, 1)
    return min(max(1 << max(fitting.bit_length() - 1, 0), LEAST_POINTS), MOST_POINTS)


def weight_of(members: int, most: int, least: int = LEAST_WEIGHT) -> int:
    """Return for how many of so many members a point stands: 1 where all fit, else a power of 2 from the least on."""
    return 1 if members <= most else max(least, 1 << (-(-members // most) - 1).bit_length())


def keys_of(members: Indices) -> Array:
    """Return numbers below 1 as if by chance, by the number of each member: a sample takes those that are small.

    That of more runs is so a part of that of fewer. Steele, Lea and Flood, splitmix64 (OOPSLA 2014).
    """
    z = (members.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray((z ^ (z >> np.uint64(31))) * 2.0**-64)


def sample_of(rows: Array, good: Indices, first: int, columns: Columns, share: float) -> Sample | None:
    """Return the attitudes of such a share of those rows of a chunk that are good; first: the number of its first."""
    if ATTITUDE not in columns.slices:
        return None
    keys = keys_of(first + good)
    taken = keys < share
    return Sample(keys[taken], rows[good[taken], :, columns.slices[ATTITUDE]])


def summary_of(rows: Array, good: Indices, columns: Columns, most: int, turn: int, full: bool = True) -> Summary:
    """Return the summary of those rows (m, n, K) of a chunk that are good, with at most so many points.

    full: whether it has as many members as a chunk may have; one that has not is the last, or alone, and is merged with
    no other, so that it keeps all points that fit.
    """
    (members, points, _), angles, pairs, ranked = rows.shape, columns.angles, columns.pairs, columns.ranked
    width = columns.width + 2 * len(angles)
    mean, products = np.zeros((points, width)), np.zeros((points, len(pairs)))
    weight = weight_of(members, most, LEAST_WEIGHT if full else 1) if most else 1
    chosen, error = _every(weight, len(good) if most else 0, turn)
    values = np.empty((points, len(ranked), len(chosen)))
    at_once = max(1, SUMMED_AT_ONCE // (width * max(len(good), 1)))
    padded = -(-len(good) // LANES) * LANES + LANES  # rows whose lengths are powers of 2 share their places in a cache
    x = np.empty((at_once * width, padded))
    for first in range(0, points, at_once):
        times = slice(first, first + at_once)
        compiled(moments)(rows, good, first, angles, pairs, mean[times], products[times], x)
        if most:
            block = x.reshape(at_once, width, padded)[: len(mean[times]), ranked, : len(good)]
            values[times] = in_order(block, chosen)
    table = values.reshape(points * len(ranked), values.shape[2])
    return Summary(len(good), mean, products, Points(table, weight, members, error))


def _every(step: int, count: int, turn: int) -> tuple[Indices, float]:
    """Return the places of the points that stand for `step` of so many sorted ones each, and the error of ranks.

    They lie a quarter of equal parts from their beginning or end, in turns, so that errors cancel, and the ends of all
    are seen. Where members failed, parts are of other lengths, lest one end is left out.
    """
    parts = -(-(count - step // 2) // step) if count > step else min(count, 1)
    places = (4 * np.arange(parts) + (1, 3)[turn % 2]) * count // max(4 * parts, 1)
    return places, step * (1.25 if count % step else 0.75) if step > 1 else 0.0


def _weight(points: Points) -> int:
    return points.weight


def _thinned(sets: Sequence[Points], weight: int, turn: int) -> Points:
    """Return the points of sets of one weight, sorted, so few that each stands for so many members."""
    old, count, rows = sets[0].weight, sum(points.values.shape[1] for points in sets), len(sets[0].values)
    chosen, error = _every(weight // old, count, turn)
    thinned = np.empty((rows, len(chosen)))
    at_once = max(1, SUMMED_AT_ONCE // max(count, 1))
    for first in range(0, rows, at_once):
        values = np.concatenate([points.values[first : first + at_once] for points in sets], axis=1)
        thinned[first : first + at_once] = in_order(values, chosen)
    members, before = sum(points.members for points in sets), sum(points.error for points in sets)
    return Points(thinned, weight, members, before + old * error)


@dataclass
class Statistics:
    """The statistics of the members of chunks 0, 1, ... that were added; levels: sets of points of 1, 8, ... chunks.

    most: points of each number, at most; none are taken where it is 0.
    """

    count: int
    chunks: int
    mean: Array
    products: Array
    most: int
    levels: list[list[Points]] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)

    @classmethod
    def none(cls, points: int, columns: Columns, most: int) -> "Statistics":
        """Return the statistics of no member."""
        width, pairs = columns.width + 2 * len(columns.angles), len(columns.pairs)
        return cls(0, 0, np.zeros((points, width)), np.zeros((points, pairs)), most)

    def add(self, new: Summary, pairs: Indices) -> None:
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
        if self.most:
            self._add_points(new.points)
        if new.sample:
            self.samples.append(new.sample)

    def _add_points(self, new: Points) -> None:
        """Add a set of the first level. One that is full is thinned out when the next comes, not before.

        The last chunk, which may be smaller than the others, so is never merged with them.
        """
        for level, sets in enumerate(self.levels):
            if len(sets) < SETS:
                sets.append(new)
                return
            self.levels[level] = [new]
            weight = weight_of(sum(points.members for points in sets), self.most)
            new = _thinned(sets, weight, self.chunks // SETS ** (level + 1))
        self.levels.append([new])

    def sample(self, share: float) -> Array:
        """Return the attitudes (s, n, 4) of such a share of all members, at most that which was taken."""
        taken = [one.values[one.keys < share] for one in self.samples]
        return np.concatenate(taken) if taken else np.empty((0, len(self.mean), 4))

    def quantiles(self, probabilities: Array, middle: Array) -> tuple[Array, float]:
        """Return the quantiles (q, n, R): values at which so large a part of the members is passed.

        middle (n, R): of angles their mean, around which they are taken; NaN of numbers. And by which part of all
        members their ranks are wrong at most: 0 where all values are kept.
        """
        sets = sorted((one for sets in self.levels for one in sets), key=_weight)
        if not any(points.values.shape[1] for points in sets):
            return np.full((len(probabilities), *middle.shape), np.nan), 0.0
        levels = [_thinned([*group], sets[-1].weight, turn) for turn, (_, group) in enumerate(groupby(sets, _weight))]
        points = _thinned(levels, sets[-1].weight, 0) if len(levels) > 1 else levels[0]
        angles = ~np.isnan(middle.ravel())
        points.values[angles] = around(middle.ravel()[angles, None], points.values[angles])
        found = _quantiles(points.values, probabilities)
        return found.reshape(len(probabilities), *middle.shape), points.error / self.count

    def to_arrays(self) -> dict[str, Any]:
        """Return arrays from which `from_arrays` makes the same."""
        arrays: dict[str, Any] = {"counted": np.array([self.count, self.chunks, self.most])}
        arrays |= {"mean": self.mean, "products": self.products}
        for level, sets in enumerate(self.levels):
            for k, points in enumerate(sets):
                arrays[f"points/{level}/{k}"] = points.values
                arrays[f"weight/{level}/{k}"] = np.array(points[1:])
        if self.samples:
            arrays["keys"], arrays["sample"] = map(np.concatenate, zip(*self.samples, strict=True))
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> "Statistics":
        """Return the inverse of `to_arrays`. Raises ValueError for what others wrote."""
        if "counted" not in arrays:
            raise ValueError("an older rbfmu made its statistics, in another way")
        count, chunks, most = (int(n) for n in arrays["counted"])
        found = cls(count, chunks, np.array(arrays["mean"]), np.array(arrays["products"]), most)
        found.samples = [Sample(arrays["keys"], arrays["sample"])] if "keys" in arrays else []
        for name in arrays:
            if name.startswith("points/"):  # in the order in which they were written
                _, level, k = name.split("/")
                found.levels += [[]] if k == "0" else []
                weight, members, error = arrays[f"weight/{level}/{k}"].tolist()
                found.levels[int(level)].append(Points(arrays[name], int(weight), int(members), error))
        return found


def exact_quantiles(values: Array, probabilities: Array) -> Array:
    """Return the quantiles (q, ...) over the first axis, NaN left out."""
    good = values[~np.isnan(values).any(axis=tuple(range(1, values.ndim)))]
    if not len(good):
        return np.full((len(probabilities), *values.shape[1:]), np.nan)
    return _quantiles(np.moveaxis(good, 0, -1), probabilities)


def _quantiles(values: Array, probabilities: Array) -> Array:
    """Return the quantiles (q, ...) of n numbers: values (..., n), of which each has the rank of its middle.

    Value i of n has the rank (i - 1/2) / n (Hazen), as has a point in the middle of its weight.
    """
    count = values.shape[-1]
    ranks = np.clip(probabilities * count - 0.5, 0.0, count - 1.0)
    low = ranks.astype(int)
    below, above = np.split(in_order(values, np.append(low, np.minimum(low + 1, count - 1))), 2, axis=-1)
    return np.moveaxis(below + (ranks - low) * (above - below), -1, 0)
