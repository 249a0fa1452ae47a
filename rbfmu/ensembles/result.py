"""The result of an ensemble: the values applied to each run, its end, statistics over time, what drives the ends."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu import exceptions, extras, notebook
from rbfmu.ensembles import attitudes, members, variables as names
from rbfmu.ensembles.store import Checkpoint
from rbfmu.scene import section, variations
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, Indices, NDArray
from rbfmu_kernels.quantities import Quantity, indices

MOST_RANKED, LEAST = 20_000, 3
"""The most runs that are ranked (the first ones), and the fewest."""
SURE = 3.0
"""A correlation counts if it is larger than this many standard deviations of that of independent numbers."""


def _checkpoint(store: Path) -> Path:
    return store if store.suffix == ".npz" else store / "resume" / "checkpoint.npz"


def kept_runs(store: Path) -> tuple[int, int]:
    """Return how many runs a store has, and how many it will have; zeros if it was not begun."""
    if not _checkpoint(store).exists():
        return 0, 0
    known = Checkpoint.read(_checkpoint(store))
    runs = members.ensemble_of(Scene.from_dict(known.identity["scene"], str(store))).runs
    return known.runs or known.progress.chunks * known.identity["members of a chunk"], runs


class Arrays(Mapping[str, Any]):
    """Arrays by name, each of which is read when it is first asked for."""

    def __init__(self, sources: Mapping[str, Any], missing: str) -> None:
        self._sources, self._missing = sources, missing
        self._read: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._sources:
            raise KeyError(f"{name}: {self._missing}; there is {', '.join(self._sources) or 'nothing'}")
        if name not in self._read:
            self._read[name] = np.asarray(self._sources[name])
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)

    def __repr__(self) -> str:
        return f"{{{', '.join(f'{name}: {tuple(source.shape)}' for name, source in self._sources.items())}}}"


class Drivers(NamedTuple):
    """Rank correlations (p, q) of p varying numbers with q numbers at the end; chance: the largest that may be chance.

    The numbers of a varying attitude are the vector part of the quaternion from the mean attitude to it.
    """

    varied: tuple[str, ...]
    ends: tuple[str, ...]
    correlations: Array
    chance: float

    @classmethod
    def between(cls, *columns: Mapping[str, Array]) -> "Drivers":
        """Return Spearman's rank correlations of two sets of columns (n,): varying numbers and ends of the runs.

        Columns that are the same in all runs are left out.
        """
        varied, ends = ({name: x for name, x in some.items() if np.ptp(x) > 0.0} for some in columns)
        if not varied or not ends:
            return cls((*varied,), (*ends,), np.empty((len(varied), len(ends))), 1.0)
        ranks = (np.column_stack([_ranks(x) for x in some.values()]) for some in (varied, ends))
        a, b = (x / np.linalg.norm(x, axis=0) for x in (x - x.mean(axis=0) for x in ranks))
        return cls((*varied,), (*ends,), a.T @ b, SURE / float(np.sqrt(len(a) - 1)))

    def __repr__(self) -> str:
        """Return for each number at the end the varying number that drives it most."""
        varied, ended = f"{len(self.varied)} numbers that vary", f"{len(self.ends)} at the end"
        lines = [f"Drivers({varied}, {ended}; the largest correlations:"]
        for end, column in zip(self.ends, self.correlations.T, strict=True):
            if len(column) and abs(column[k := int(np.argmax(np.abs(column)))]) > self.chance:
                lines.append(f"{end}: {column[k]:.2f} with {self.varied[k]}")
        return "\n  ".join(lines) + ")"


def _ranks(x: Array) -> Array:
    """Return the ranks of numbers (n,), counted from 1; equal numbers have the mean of their ranks.

    The same as `scipy.stats.rankdata`, which takes a second to load.
    """
    _, at, counts = np.unique(x, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[at])


def _columns(name: str, row: Quantity, values: Array) -> dict[str, Array]:
    """Return the numbers (n,) of a quantity (n, ...) by their names."""
    return {f"{name}{index}": column for index, column in zip(indices(row), names.flat(values).T, strict=True)}


class EnsembleResult:
    """The runs of an ensemble.

    time (n,): s. samples: key of the scene -> applied values (runs, ...), SI; attitudes as quaternions, inertia as
    matrices. final: quantity -> (runs, k). mean, std: quantity -> (n, k); covariance -> (n, k, k); quantiles -> (q, n,
    k) at the q `probabilities`. all: quantity -> (runs, n, k). What the scene's `ensemble.keep` does not name is empty.
    A quantity of one number has no last axis. failed: index of a run -> message; numbers of runs that failed are NaN,
    and in no statistics. redrawn (runs,): how often a run's numbers were drawn again. rank_error: the largest error of
    a quantile's rank, as a part of the runs, except for attitudes. counts, first (runs,): event -> how often it
    happened, and when first, s (NaN where it did not happen); an event with `stop` ends no run here.

    Attitudes q_i: the mean is the q (n, 4) with the largest sum (q q_i)^2. Covariance (n, 3, 3) and std (n, 3) are of
    twice the vector part of q* q_i, in body axes, which is the rotation vector of a small rotation. Quantiles (q, n)
    are of the angle from the mean, rad; unless all runs are kept, from about a thousand of them, so that ranks are off
    by 1 or 2 %, or from a million over the number of times, if that is fewer. Roll, pitch, yaw: the mean is the
    direction of the sum of unit vectors, the covariance is of the sines of deviations from it, and quantiles are of
    angles within half a turn of it.
    """

    def __init__(self, scene: Scene, arrays: Mapping[str, Any], failed: Mapping[int, str]) -> None:
        self.scene, self.failed, self._arrays = scene, dict(failed), arrays
        self.time: Array = np.asarray(arrays[names.TIMES])
        self.probabilities: Array = np.asarray(arrays[names.PROBABILITY])
        self.rows, keep = names.output_rows(scene), members.ensemble_of(scene).keep
        self.rank_error = float(np.asarray(arrays.get(names.RANK_ERROR, 0.0))) if names.STATISTICS in keep else 0.0
        applied = {name: arrays[name] for name in names.varied_rows(scene) if name in arrays}
        self.samples = Arrays(applied, "no key that varies")
        # do not look for what is not kept: a user's own output may have such a name
        ends, every, over_time = (
            scene.outputs.names if what in keep else () for what in (names.FINAL, names.ALL, names.STATISTICS)
        )
        self.final = self._of(ends, "_final", "the end of the runs is not kept")
        self.all = self._of(every, "", "not all of the runs is kept")
        parts, missing = ("_mean", "_std", "_covariance", "_quantiles"), "statistics are not kept"
        self.mean, self.std, self.covariance, self.quantiles = (self._of(over_time, part, missing) for part in parts)
        events, missing = (*scene.events,), "no event of that name"
        self.counts, self.first = (self._of(events, end, missing) for end in (names.COUNT, names.FIRST))

    def _of(self, shown: tuple[str, ...], end: str, missing: str) -> Arrays:
        return Arrays({n: self._arrays[n + end] for n in shown if n + end in self._arrays}, missing)

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"EnsembleResult({self.scene.name!r}: {self.runs} runs{failed}, {', '.join(self.rows)})"

    def _repr_html_(self) -> str:
        end = self.scene.run.text_of(self.time[-1])
        caption = f"{self.scene.name}: {self.runs:,} runs, {len(self.failed):,} failed; at t = {end} s"
        rows = ((name, self.rows[name].unit, *map(notebook.numbers_text, self.at_end(name))) for name in self.ended)
        return notebook.table(caption, ("quantity", "unit", "mean", "standard deviation"), rows)

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        return int(self._arrays[names.REDRAWN].shape[0])

    @cached_property
    def redrawn(self) -> Indices:
        """Return how often each run's numbers were drawn again because their inertia was impossible."""
        return np.asarray(self._arrays[names.REDRAWN])

    @property
    def good(self) -> NDArray[np.intp]:
        """Return the indices of the runs that did not fail."""
        return np.setdiff1d(np.arange(self.runs), np.array(sorted(self.failed), dtype=int))

    @property
    def ended(self) -> tuple[str, ...]:
        """Return the quantities whose values at the end of all runs are kept."""
        return tuple(name for name in self.rows if name in self.all or name in self.final)

    def member(self, number: int) -> Scene:
        """Return the scene of a run, counted from 0, to be simulated alone; no event ends it.

        If only ends are kept it has one step, as the run had; with `.replace({"run.step": ...})` it shows the motion.
        Raises SceneError if the member is refused.
        """
        number = section.whole(0, self.runs - 1).read(number, "number")
        return members.member(self.scene, members.draw(self.scene, number, 1), 0)

    def ends(self, name: str) -> Array:
        """Return a quantity at the end of all runs (runs, k), NaN for failed runs. Raises KeyError if not kept."""
        return np.asarray(self.all[name][:, -1] if name in self.all else self.final[name])

    def good_ends(self, name: str) -> Array:
        """Return a quantity at the end of the good runs (g, k); angles are within half a turn of their mean."""
        ends = self.ends(name)[self.good].reshape(len(self.good), -1)
        return attitudes.around(self.at_end(name)[0], ends) if name == attitudes.ANGLES else ends

    def first_of(self, name: str) -> Array:
        """Return the first times of an event, s, in the good runs in which it happened (n,)."""
        times = self.first[name][self.good]
        return np.asarray(times[np.isfinite(times)])

    def drivers(self) -> Drivers:
        """Return the rank correlations of the varying numbers with the runs' ends."""
        rows, applied, ended = self.good[:MOST_RANKED], dict[str, Array](), dict[str, Array]()
        if len(rows) >= LEAST:
            for key, values in self.samples.items():
                applied_to = attitudes.from_their_mean(values[rows]) if key == variations.ATTITUDE else values[rows]
                found = _columns(key, names.varied_rows(self.scene)[key], applied_to)
                applied |= dict([*found.items()][key == variations.ATTITUDE :])  # the vector part of its quaternion
            for name in self.ended:
                values = self.good_ends(name)[: len(rows)]
                found = _columns(name, self.rows[name], values)
                apart = names.differ(values)
                ended |= {one: found[one] for one, differs in zip(found, apart, strict=True) if differs}
        return Drivers.between(applied, ended)

    def at_end(self, name: str) -> tuple[Array, Array]:
        """Return mean and standard deviation (k,) of a quantity at the end of the good runs; NaN without good runs.

        The standard deviation of an attitude (3,) is that of the rotation from the mean, rad, body axes.
        """
        if name in self.mean:
            return np.atleast_1d(self.mean[name][-1]), np.atleast_1d(self.std[name][-1])
        ends = self.ends(name)[self.good].reshape(-1, self.rows[name].size)
        if name == attitudes.ANGLES:
            ends = np.stack([np.sin(ends), np.cos(ends)], axis=2).reshape(-1, 6)
        middle = ends.sum(axis=0) / max(len(ends), 1)
        apart = ends - middle
        mean, covariance = attitudes.moments_of(name, len(ends), middle[None], (apart.T @ apart)[None])
        return mean[0], np.sqrt(np.diagonal(covariance[0]))

    def to_xarray(self) -> Any:
        """Return an xarray.Dataset of all that is kept, with the names of components, units and frames."""
        known, found, named = names.variables_of(self.scene, self._arrays), {}, {}
        for name, variable in known.items():
            if name in self._arrays:
                found[name] = (variable.dims, np.asarray(self._arrays[name]), variable.attributes)
                row = self.rows.get(name) or self.rows.get(name.rpartition("_")[0])
                if row is not None and (axis := {"parameter", "angle", "axis"} & {*variable.dims}):
                    is_turn = name in (f"{attitudes.ATTITUDE}_std", f"{attitudes.ATTITUDE}_covariance")
                    named[axis.pop()] = [*"xyz"] if is_turn else list(row.components)
        return extras.needed("xarray", "ensemble").Dataset(found, names.coordinates(self.time) | named)

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw bands of quantiles, the runs' ends and what drives them; return the matplotlib.figure.Figure.

        path: a file to draw to, whose ending (.png, .svg, .pdf) sets the format.
        """
        from rbfmu.ensembles.pictures import plot_ensemble

        return plot_ensemble(self, path)

    @classmethod
    def load(cls, path: str | Path) -> "EnsembleResult":
        """Read a finished store, .npz or .zarr. Raises ValueError if it is not one, or if runs are missing."""
        path = exceptions.path_of(path)
        known = Checkpoint.read(_checkpoint(path))
        scene = Scene.from_dict(known.identity["scene"], str(path))
        if known.runs == 0:
            done, runs = kept_runs(path)
            raise ValueError(f"{path}: has {done} of {runs} runs: expected all, resume it")
        if path.suffix == ".npz":
            return cls(scene, {**known.rows, **known.results}, known.progress.failed)
        from rbfmu.ensembles.zarr_store import arrays_of_folder

        return cls(scene, arrays_of_folder(path, known.results), known.progress.failed)
