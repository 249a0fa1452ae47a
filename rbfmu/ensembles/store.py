"""Where an ensemble's numbers are kept: in memory, or in one .npz. For zarr see `zarr_store`.

A checkpoint, one file that is always replaced as a whole, says how far an ensemble has come. A store contains whole
chunks from the first on. Anything beyond its checkpoint is written again, with the same bits.
"""

import copy
import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from rbfmu import on_disk, result
from rbfmu.ensembles import attitudes, variables as names
from rbfmu.ensembles.chunks import Chunk, Work, origin
from rbfmu.ensembles.statistics import Statistics, exact_quantiles
from rbfmu.runs.motion import attitude_error
from rbfmu.types import Array

EXTENDABLE = ("random", "sobol")
"""Designs to which more members may be added later."""
_HEAD, _STATISTICS = "resume/head", "resume/statistics/"


@contextmanager
def damage_of(store: Path, what: str = "", but: type[Exception] = ModuleNotFoundError) -> Iterator[None]:
    """Turn any error, such as of a checksum, a codec or JSON, into a ValueError: the store cannot be read.

    but: errors of this type stay as they are.
    """
    try:
        yield
    except but:
        raise
    except Exception as error:
        raise ValueError(f"{store}: cannot be read ({what}{error}): expected what `rbfmu ensemble` writes") from None


@dataclass
class Progress:
    """How far an ensemble is: the number of chunks 0, 1, ... that were added, their statistics and failures."""

    chunks: int
    statistics: Statistics | None
    failed: dict[int, str] = field(default_factory=dict)

    @classmethod
    def none(cls, work: Work) -> "Progress":
        """Return the progress at the start."""
        if not work.keeps(names.STATISTICS):
            return cls(0, None)
        return cls(0, Statistics.none(work.scene.run.count + 1, work.columns, work.most_points))

    def add(self, chunk: Chunk, work: Work) -> None:
        """Add the next chunk."""
        self.chunks += 1
        self.failed |= chunk.failed
        if self.statistics is not None and chunk.summary is not None:
            self.statistics.add(chunk.summary, work.columns.pairs)


@dataclass(frozen=True)
class Checkpoint:
    """What a file contains: the ensemble's identity, its progress in whole chunks, and arrays by variable.

    rows: arrays with one row for each run, unless they are kept elsewhere; results: the other arrays, once all runs are
    done; runs: their number once all are done, 0 before.
    """

    identity: Mapping[str, Any]
    progress: Progress
    rows: Mapping[str, Any] = field(default_factory=dict)
    results: Mapping[str, Any] = field(default_factory=dict)
    runs: int = 0

    def write(self, path: Path) -> None:
        """Replace the file at the path, or the one that a link names, as a whole: no file is ever half written.

        A rename is atomic (POSIX), and `fsync` before it prevents that a crash of the machine leaves an empty file.
        """
        statistics = self.progress.statistics.to_arrays() if self.progress.statistics else {}
        kept = {f"{_STATISTICS}{name}": array for name, array in statistics.items()}
        head = {"identity": self.identity, "chunks": self.progress.chunks, "runs": self.runs, "rows": [*self.rows]}
        head["failed"] = list(self.progress.failed.items())
        kept |= {_HEAD: np.array(json.dumps(head)), **self.rows, **self.results}
        with on_disk.replacing(path) as file:
            result.write_npz(file, kept)
            file.flush()
            os.fsync(file.fileno())

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Read a file. Raises ValueError if it is no checkpoint of an ensemble, FileNotFoundError if there is none."""
        with damage_of(path, but=FileNotFoundError):
            arrays = result.read_npz(path)
            head = json.loads(str(arrays.pop(_HEAD)))
            of_statistics = [name for name in arrays if name.startswith(_STATISTICS)]
            kept = {name.removeprefix(_STATISTICS): arrays.pop(name) for name in of_statistics}
            progress = Progress(head["chunks"], Statistics.from_arrays(kept) if kept else None, dict(head["failed"]))
            rows = {name: arrays.pop(name) for name in head["rows"]}
            return cls(head["identity"], progress, rows, arrays, head["runs"])


def identity_of(work: Work) -> dict[str, Any]:
    """Return all that the bits of an ensemble depend on, as a table for JSON."""
    plan = {k: v for k, v in work.plan.to_dict().items() if k != "reasons"}
    found = {"scene": work.scene.to_dict(), "plan": plan, "members of a chunk": work.size, "origin": origin()}
    return json.loads(json.dumps(found | work.control.identity))  # type: ignore[no-any-return]


def difference(there: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """Return the first difference between the ensemble of a store and the one asked for, as a message; "" if none.

    More runs are no difference if members do not depend on the number of runs. Nor is the text about a scene.
    """
    is_extendable = asked["scene"]["ensemble"]["design"] in EXTENDABLE
    for path, old, new in _differences(there, asked, ""):
        is_more = path == ".scene.ensemble.runs" and is_extendable and new > old
        if not is_more and not path.startswith(".scene.about"):
            name = path.removeprefix(".scene").removeprefix(".")
            return f"{name} = {_short(new)}: expected {_short(old)}, with which the store was begun"
    return ""


def _differences(old: Any, new: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path and both values of each difference between two tables."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*old, *new]):
            yield from _differences(old.get(key), new.get(key), f"{path}.{key}")
    elif old != new:
        yield path, old, new


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


OFTEN, SHARE = 1.0, 0.05
"""The least time between two commits, s, and the largest part of the time that commits take."""
SORTED_AT_ONCE = 2e7
"""How many numbers of all runs are sorted at once."""


class Store:
    """Keeps an ensemble's numbers in arrays in memory; with a path also in a file, written anew at each commit.

    Chunks are added in their order, and full chunks are committed from time to time. `zarr_store` keeps rows elsewhere
    than in memory. file: the checkpoint, if it is not the path itself.
    """

    def __init__(self, work: Work, path: Path | None = None, file: Path | None = None) -> None:
        self._work, self._path, self._file = work, path, file or path
        self._identity = identity_of(work) if path else {}
        self.progress = self._whole = Progress.none(work)
        self._rows: dict[str, Any] = {}
        self._first = 0  # the number of the run in the first of these rows
        self._results: Mapping[str, Any] = {}
        self._is_clean = True
        self._cost, self._last = 0.0, monotonic()

    def begin(self, resume: bool) -> int:
        """Make the store ready; return the number of runs if it is finished, else 0.

        `progress` is then that of full chunks, or of all runs if none is missing. Raises FileExistsError for a store
        that exists and is not to be resumed, ValueError if it is damaged or of another ensemble.
        """
        known = self._checkpoint(resume)
        if self._file is not None:
            on_disk.remove_parts(self._file)
        self._open(known)
        if known is None:
            self._write(self.progress, {})
            return 0
        done, self.progress = known.runs, known.progress
        if done != self._work.runs:
            members = self.progress.chunks * self._work.size
            self.progress.failed = {run: text for run, text in self.progress.failed.items() if run < members}
        self._whole = self.progress
        return done

    def _checkpoint(self, resume: bool) -> Checkpoint | None:
        """Return the checkpoint, or None if there is none yet. Raises as `begin`."""
        if self._path is None or self._file is None:
            return None
        refuse_existing(self._path, resume)
        if not self._file.exists():
            return None
        known = Checkpoint.read(self._file)
        if found := difference(known.identity, self._identity):
            raise ValueError(f"{self._path}: of another ensemble: {found}")
        return known

    def _open(self, known: Checkpoint | None) -> None:
        """Take over the arrays of a checkpoint."""
        if known is not None:
            self._results = known.results
            for name, values in known.rows.items():
                self._put(name, 0, values)

    def _write(self, progress: Progress, rows: Mapping[str, Any], runs: int = 0) -> None:
        if self._file is not None:
            Checkpoint(self._identity, progress, rows, self._results if runs else {}, runs).write(self._file)

    def add(self, chunk: Chunk) -> None:
        """Add the next chunk, and commit if it is time."""
        self._is_clean = False  # an interrupt may come between any two lines
        if self._file is not None and chunk.members < self._work.size:
            self._whole = copy.deepcopy(self.progress)
        self._keep(chunk)
        self.progress.add(chunk, self._work)
        self._is_clean = chunk.members == self._work.size
        if monotonic() - self._last > max(OFTEN, self._cost / SHARE):
            self.commit()

    def _keep(self, chunk: Chunk) -> None:
        for name, values in chunk.arrays.items():
            self._put(name, chunk.first, values)

    def _put(self, name: str, first: int, values: Any) -> None:
        if name not in self._rows:
            self._rows[name] = np.empty((self._work.runs, *values.shape[1:]), values.dtype)
        self._rows[name][first : first + len(values)] = values

    def commit(self) -> None:
        """Write the chunks that were added, if all are full; they then survive if the program is killed."""
        if self._is_clean:
            begin = monotonic()
            self._write(self.progress, self._rows_of(self.progress))
            self._last = monotonic()
            self._cost = self._last - begin

    def _rows_of(self, progress: Progress) -> dict[str, Any]:
        """Return the rows of full chunks."""
        count = progress.chunks * self._work.size - self._first
        return {name: values[:count] for name, values in self._rows.items() if count > 0}

    def finish(self) -> None:
        """Write everything, also the progress in full chunks, from which the ensemble can be extended."""
        self._whole.failed = self.progress.failed
        self._results = results_of(self._work, self.progress.statistics, self._rows)
        self._write(self._whole, self._rows, self._work.runs)

    def arrays(self) -> Mapping[str, Any]:
        """Return all variables by name."""
        return {**self._rows, **self._results}


def refuse_existing(store: Path, resume: bool) -> None:
    """Raise FileExistsError for a store that exists and is not to be resumed."""
    if not resume and store.exists():
        raise FileExistsError(errno.EEXIST, "exists already, and stays as it is; --resume goes on with it", str(store))


def results_of(work: Work, statistics: Statistics | None, rows: Mapping[str, Any]) -> dict[str, Array]:
    """Return the variables without rows for runs: times, and statistics over time. rows: the variables with rows."""
    run, probabilities = work.scene.run, np.array(names.PROBABILITIES)
    found = {names.TIMES: run.grid(), names.PROBABILITY: probabilities}
    if statistics is None:
        return found
    columns, matrices = work.columns, work.columns.matrices(statistics.products)
    moments = {
        name: attitudes.moments_of(name, statistics.count, statistics.mean[:, own], matrices[name])
        for name, own in columns.summed.items()
    }
    middle = np.full((len(statistics.mean), columns.width), np.nan)
    if attitudes.ANGLES in moments:
        middle[:, columns.angles] = moments[attitudes.ANGLES][0]
    ranked, rank_error = statistics.quantiles(probabilities, middle[:, columns.ranked])
    quantiles = np.empty((len(probabilities), *middle.shape))
    quantiles[:, :, columns.ranked] = ranked
    found[names.RANK_ERROR] = np.array(rank_error)
    kept = {} if work.keeps(names.ALL) else columns.split(quantiles)
    for name, (mean, covariance) in moments.items():
        std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        if mean.shape[1] == 1:
            mean, std, covariance = mean[:, 0], std[:, 0], covariance[:, 0, 0]
        found |= {f"{name}_mean": mean, f"{name}_std": std, f"{name}_covariance": covariance}
        if name == attitudes.ATTITUDE and kept:
            kept[name] = exact_quantiles(attitude_error(mean, statistics.sample(work.share)), probabilities)
        found[f"{name}_quantiles"] = kept[name] if kept else _of_all(name, mean, rows[name], probabilities)
    return found


def _of_all(name: str, mean: Array, values: Any, probabilities: Array) -> Array:
    """Return the quantiles over all runs of values (runs, n, ...); a block of times is read and sorted at once."""
    times = max(1, int(SORTED_AT_ONCE // (values.size // values.shape[1] or 1)))
    parts = []
    for first in range(0, values.shape[1], times):
        some = slice(first, first + times)
        part = values[:, some]
        if name == attitudes.ATTITUDE:
            part = attitude_error(mean[some], part)
        elif name == attitudes.ANGLES:
            part = attitudes.around(mean[some], part)
        parts.append(exact_quantiles(part, probabilities))
    return np.concatenate(parts, axis=1)
