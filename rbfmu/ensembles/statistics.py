"""Mean, covariance and quantiles over time, computed chunk by chunk: the same bits wherever chunks run.

The worker that runs a chunk also sums it up, so that little is left to merge. Sums are merged in the order of the
chunks, as floating-point sums depend on their order. Quantiles are from a sketch: every w-th of the sorted values of a
chunk is a point of weight w, which represents w values. Eight such sets are sorted together and thinned out to one set
of the next level (Munro and Paterson 1980; Manku, Rajagopalan and Lindsay 1998). The memory grows with the logarithm of
the number of runs, and the largest error of a rank is known.
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
"""The largest and the smallest limit on the points that represent the values of many members at one time."""
MOST_NUMBERS = 4_000_000
"""The largest size of one table of points; each level has up to SETS tables."""
MOST_SAMPLED = 1024
"""The average number of members whose attitudes are kept for quantiles of the angle from the mean of all members."""
SETS = 8
"""The number of sets of points of a level that are merged into one set of the next level."""
LEAST_WEIGHT = 8
"""The least weight of a point if not all values fit: it divides the work of merging."""
SUMMED_AT_ONCE, OF_A_MEMBER = 100_000, 24
"""SUMMED_AT_ONCE: how many numbers are summed up and sorted together: more have longer contiguous rows, fewer stay in a
cache. OF_A_MEMBER: at least so many of each member, as fewer leave most of a cache line that is read unused."""


class Points(NamedTuple):
    """p sorted values (c, p) of each of c numbers; each value represents `weight` members.

    members: all that are represented, with those that failed, so that all sets of a level have the same weight. error:
    the largest error of a rank, in members.
    """

    values: Array
    weight: int
    members: int
    error: float


class Sample(NamedTuple):
    """Attitudes (s, n, 4) of randomly chosen members, and the keys (s,) by which they were chosen: see `keys_of`."""

    keys: Array
    values: Array


class Summary(NamedTuple):
    """The summary of a chunk's members: mean (n, W), sums of products of deviations (n, P), points, sample."""

    members: int
    mean: Array
    products: Array
    points: Points
    sample: Sample | None = None


def most_points(numbers: int) -> int:
    """Return the largest number of points for each of n K numbers; it is smaller if there are many numbers."""
    fitting = MOST_NUMBERS // max(numbers, 1)
    return min(max(1 << max(fitting.bit_length() - 1, 0), LEAST_POINTS), MOST_POINTS)


def weight_of(members: int, most: int, least: int = LEAST_WEIGHT) -> int:
    """Return the weight of a point if `most` points represent `members`: 1 if all fit, else a power of 2 >= least."""
    return 1 if members <= most else max(least, 1 << (-(-members // most) - 1).bit_length())


def keys_of(members: Indices) -> Array:
    """Return a pseudo-random key in [0, 1) for each member's number; a sample contains the members with small keys.

    So the sample of more runs contains only members of the sample of fewer runs, and new ones. Steele, Lea and Flood,
    splitmix64 (OOPSLA 2014).
    """
    z = (members.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return np.asarray((z ^ (z >> np.uint64(31))) * 2.0**-64)


def sample_of(rows: Array, good: Indices, first: int, columns: Columns, share: float) -> Sample | None:
    """Return the attitudes of a share of a chunk's good rows, None if they are no output; first: its first member."""
    if ATTITUDE not in columns.slices:
        return None
    keys = keys_of(first + good)
    chosen = keys < share
    return Sample(keys[chosen], rows[good[chosen], :, columns.slices[ATTITUDE]])


def summary_of(rows: Array, good: Indices, columns: Columns, most: int, turn: int, full: bool = True) -> Summary:
    """Return the summary of the good rows (m, n, K) of a chunk, with at most `most` points; turn: the chunk's number.

    full: whether the chunk has the full number of members. A smaller one is the last or the only one. Its points are
    merged with no others, so that it keeps all that fit.
    """
    (members, points, own), angles, pairs, ranked = rows.shape, columns.angles, columns.pairs, columns.ranked
    width = columns.width + 2 * len(angles)
    mean, products = np.zeros((points, width)), np.zeros((points, len(pairs)))
    weight = weight_of(members, most, LEAST_WEIGHT if full else 1) if most else 1
    chosen, error = _every(weight, len(good) if most else 0, turn)
    values = np.empty((points, len(ranked), len(chosen)))
    at_once = max(-(-OF_A_MEMBER // own), SUMMED_AT_ONCE // (width * max(len(good), 1)))
    padded = -(-len(good) // LANES) * LANES + LANES  # no power of 2: such rows would share places of a cache
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
    """Return the places of points among `count` sorted ones, each for `step` of them, and the largest error of a rank.

    The sorted ones are cut into equal parts. A point is a quarter of a part from its beginning, or, in every other
    turn, from its end, so that errors cancel and both ends are represented. If members failed, the parts have another
    length than `step`, so that no end is left out.
    """
    parts = -(-(count - step // 2) // step) if count > step else min(count, 1)
    places = (4 * np.arange(parts) + (1, 3)[turn % 2]) * count // max(4 * parts, 1)
    return places, step * (1.25 if count % step else 0.75) if step > 1 else 0.0


def _weight(points: Points) -> int:
    return points.weight


def _thin_out(sets: Sequence[Points], weight: int, turn: int) -> Points:
    """Return one set of points of a larger weight, made from sets that have one and the same weight."""
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
    """The statistics of the members of chunks 0, 1, ... that were added.

    count: of members that did not fail; mean, products: as in `Summary`; most: the largest number of points for each
    number, 0 for no quantiles; levels: sets of points of 1, 8, ... chunks.
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
        """Add the next chunk; pairs (P, 2): columns of the products.

        Mean and products are merged as by Chan, Golub and LeVeque (The American Statistician 37, 1983): the products of
        both groups are added, and a product of the difference of their means.
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
        """Add a set to the first level. A full level is thinned out only when the next set comes.

        So the last chunk, which may be smaller than the others, is never merged with them.
        """
        for level, sets in enumerate(self.levels):
            if len(sets) < SETS:
                sets.append(new)
                return
            self.levels[level] = [new]
            weight = weight_of(sum(points.members for points in sets), self.most)
            new = _thin_out(sets, weight, self.chunks // SETS ** (level + 1))
        self.levels.append([new])

    def sample(self, share: float) -> Array:
        """Return the attitudes (s, n, 4) of a share of all members, at most the share that was sampled."""
        chosen = [sample.values[sample.keys < share] for sample in self.samples]
        return np.concatenate(chosen) if chosen else np.empty((0, len(self.mean), 4))

    def quantiles(self, probabilities: Array, middle: Array) -> tuple[Array, float]:
        """Return the quantiles (q, n, R) at probabilities (q,), and the largest error of their ranks.

        middle (n, R): for angles the mean, about which quantiles are taken; NaN for other numbers. The error is a part
        of all members, 0 if all values are kept. Ranks of angles count from half a turn below the mean, whose own rank
        has the same error, so that both add up. Quantiles are NaN without members.
        """
        sets = sorted((points for sets in self.levels for points in sets), key=_weight)
        if not any(points.values.shape[1] for points in sets):
            return np.full((len(probabilities), *middle.shape), np.nan), 0.0
        levels = [_thin_out([*group], sets[-1].weight, turn) for turn, (_, group) in enumerate(groupby(sets, _weight))]
        points = _thin_out(levels, sets[-1].weight, 0) if len(levels) > 1 else levels[0]
        angles = ~np.isnan(middle.ravel())
        points.values[angles] = around(middle.ravel()[angles, None], points.values[angles])
        found = _quantiles(points.values, probabilities)
        error = points.error * (2.0 if angles.any() else 1.0)
        return found.reshape(len(probabilities), *middle.shape), error / self.count

    def to_arrays(self) -> dict[str, Any]:
        """Return the statistics as arrays, for `from_arrays`."""
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
        """Return the statistics from what `to_arrays` returned. Raises ValueError for arrays of an older rbfmu."""
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
    """Return the quantiles (q, ...) over the first axis; entries with a NaN are left out."""
    good = values[~np.isnan(values).any(axis=tuple(range(1, values.ndim)))]
    if not len(good):
        return np.full((len(probabilities), *values.shape[1:]), np.nan)
    return _quantiles(np.moveaxis(good, 0, -1), probabilities)


def _quantiles(values: Array, probabilities: Array) -> Array:
    """Return the quantiles (q, ...) of values (..., n), interpolated linearly between ranks.

    Value i of n, i = 1, 2, ..., has the rank (i - 1/2) / n (Hazen), the middle of the members that it represents.
    """
    count = values.shape[-1]
    ranks = np.clip(probabilities * count - 0.5, 0.0, count - 1.0)
    low = ranks.astype(int)
    below, above = np.split(in_order(values, np.append(low, np.minimum(low + 1, count - 1))), 2, axis=-1)
    return np.moveaxis(below + (ranks - low) * (above - below), -1, 0)
