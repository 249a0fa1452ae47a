"""Where an ensemble's numbers are kept: in memory, or in one .npz. For zarr see `zarr_store`.

A checkpoint, one file that is replaced whole, says how far an ensemble is.
A store holds whole chunks from the first on. What stands beyond its checkpoint is written again, the same.
"""

import copy
import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from rbfmu.ensembles import attitudes, variables as names
from rbfmu.ensembles.chunks import Chunk, Work, origin
from rbfmu.ensembles.statistics import Statistics, exact_quantiles
from rbfmu.result import read_npz, write_npz
from rbfmu.runs.motion import attitude_error
from rbfmu.types import Array

EXTENDABLE = ("random", "sobol")
"""Designs of which more members may be asked for later."""
_HEAD, _STATISTICS = "resume/head", "resume/statistics/"


@contextmanager
def damage_of(store: Path, what: str = "", but: type[Exception] = ModuleNotFoundError) -> Iterator[None]:
    """Turn any error, of a checksum, a codec or JSON, into a ValueError that says that the store cannot be read."""
    try:
        yield
    except but:
        raise
    except Exception as error:
        raise ValueError(f"{store}: cannot be read ({what}{error}): expected what `rbfmu ensemble` writes") from None


@dataclass
class Progress:
    """What the chunks 0, 1, ... that were added have given."""

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
    """What a file holds: whose ensemble it is of, its progress in whole chunks, and arrays by variable.

    rows: arrays with a row a run, as far as they are not kept elsewhere; results: others, once all runs are done; runs:
    how many are done then, 0 before.
    """

    identity: Mapping[str, Any]
    progress: Progress
    rows: Mapping[str, Any] = field(default_factory=dict)
    results: Mapping[str, Any] = field(default_factory=dict)
    runs: int = 0

    def write(self, path: Path) -> None:
        """Write to a file beside, and put that in place of the file, or of that where a link leads: all or the old one.

        A rename is atomic (POSIX), and `fsync` before it keeps a crash of the machine from leaving an empty file.
        """
        statistics = self.progress.statistics.to_arrays() if self.progress.statistics else {}
        kept = {f"{_STATISTICS}{name}": array for name, array in statistics.items()}
        head = {"identity": self.identity, "chunks": self.progress.chunks, "runs": self.runs, "rows": [*self.rows]}
        head["failed"] = list(self.progress.failed.items())
        kept |= {_HEAD: np.array(json.dumps(head)), **self.rows, **self.results}
        path = Path(os.path.realpath(path))
        part = path.with_name(f"{path.name}.partial")
        try:
            with part.open("wb") as file:
                write_npz(file, kept)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Read a file. Raises ValueError where it is no checkpoint of an ensemble."""
        with damage_of(path, but=FileNotFoundError):
            arrays = read_npz(path)
            head = json.loads(str(arrays.pop(_HEAD)))
            of_statistics = [name for name in arrays if name.startswith(_STATISTICS)]
            kept = {name.removeprefix(_STATISTICS): arrays.pop(name) for name in of_statistics}
            progress = Progress(head["chunks"], Statistics.from_arrays(kept) if kept else None, dict(head["failed"]))
            rows = {name: arrays.pop(name) for name in head["rows"]}
            return cls(head["identity"], progress, rows, arrays, head["runs"])


def identity_of(work: Work) -> dict[str, Any]:
    """Return what tells an ensemble's bits from those of others, for JSON."""
    plan = {k: v for k, v in work.plan.to_dict().items() if k != "reasons"}
    found = {"scene": work.scene.to_dict(), "plan": plan, "members of a chunk": work.size, "origin": origin()}
    found |= work.control.identity if work.control else {}
    return json.loads(json.dumps(found))  # type: ignore[no-any-return]


def difference(there: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """Return what differs first between the ensemble of a store and one that is asked for; empty where nothing does.

    More runs are no difference where members do not depend on how many there are, nor is what is said about a scene.
    """
    is_extendable = asked["scene"]["ensemble"]["design"] in EXTENDABLE
    for path, old, new in _differences(there, asked, ""):
        is_more = path == ".scene.ensemble.runs" and is_extendable and new > old
        if not is_more and not path.startswith(".scene.about"):
            name = path.removeprefix(".scene").removeprefix(".")
            return f"{name} = {_short(new)}: expected {_short(old)}, with which the store was begun"
    return ""


def _differences(old: Any, new: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path and both values of what differs between two tables."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*old, *new]):
            yield from _differences(old.get(key), new.get(key), f"{path}.{key}")
    elif old != new:
        yield path, old, new


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


OFTEN, SHARE = 1.0, 0.05
"""The least time between two commits, s, and the largest share of time that they take."""
SORTED_AT_ONCE = 2e7
"""Numbers of all runs that are sorted at once."""


class Store:
    """The place of an ensemble's numbers: arrays in memory; with a path also a file, written anew at each commit.

    Chunks are added in their order, and those that are full are kept from time to time. Other stores hold rows
    elsewhere than in memory (`zarr_store`). file: that of the checkpoint, if it is not the path.
    """

    def __init__(self, work: Work, path: Path | None = None, file: Path | None = None) -> None:
        self._work, self._path, self._file = work, path, file or path
        self._identity = identity_of(work) if path else {}
        self.progress = self._whole = Progress.none(work)
        self._rows: dict[str, Any] = {}
        self._first = 0  # the run of the first of these rows
        self._results: Mapping[str, Any] = {}
        self._is_clean = True
        self._cost, self._last = 0.0, monotonic()

    def begin(self, resume: bool) -> int:
        """Make the store ready; return how many runs a finished one has, else 0. Raises FileExistsError, ValueError.

        `progress` is then that of full chunks, or of all runs where none is missing.
        """
        known = self._checkpoint(resume)
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
        """Return the checkpoint, None where there is none yet. Raises FileExistsError, ValueError."""
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
        """Take over what is there."""
        if known is not None:
            self._results = known.results
            for name, values in known.rows.items():
                self._put(name, 0, values)

    def _write(self, progress: Progress, rows: Mapping[str, Any], runs: int = 0) -> None:
        if self._file is not None:
            Checkpoint(self._identity, progress, rows, self._results if runs else {}, runs).write(self._file)

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        self._is_clean = False  # an interrupt may come between any two lines
        if self._file is not None and chunk.members < self._work.size:
            self._whole = copy.deepcopy(self.progress)
        self._keep(chunk, chunk_arrays(self._work, chunk))
        self.progress.add(chunk, self._work)
        self._is_clean = chunk.members == self._work.size
        if monotonic() - self._last > max(OFTEN, self._cost / SHARE):
            self.commit()

    def _keep(self, chunk: Chunk, arrays: Mapping[str, Any]) -> None:
        for name, values in arrays.items():
            self._put(name, chunk.first, values)

    def _put(self, name: str, first: int, values: Any) -> None:
        if name not in self._rows:
            self._rows[name] = np.empty((self._work.runs, *values.shape[1:]), values.dtype)
        self._rows[name][first : first + len(values)] = values

    def commit(self) -> None:
        """Keep the chunks that were taken, if they are full, even if the program is killed after that."""
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
        """Keep everything, also the progress in full chunks, from which more runs may go on."""
        self._whole.failed = self.progress.failed
        self._results = results_of(self._work, self.progress.statistics, self._rows)
        self._write(self._whole, self._rows, self._work.runs)

    def arrays(self) -> Mapping[str, Any]:
        """Return all variables by name."""
        return {**self._rows, **self._results}


def refuse_existing(store: Path, resume: bool) -> None:
    """Raise FileExistsError for a store that is there and is not to be resumed."""
    if not resume and store.exists():
        raise FileExistsError(errno.EEXIST, "exists already, and stays as it is; --resume goes on with it", str(store))


def chunk_arrays(work: Work, chunk: Chunk) -> dict[str, Any]:
    """Return a chunk's part of all variables that have a row a run."""
    arrays: dict[str, Any] = {**chunk.samples, names.REDRAWN: chunk.redrawn, **chunk.events}
    if work.keeps(names.FINAL):
        arrays |= {f"{name}_final": values for name, values in work.columns.split(chunk.rows[:, -1]).items()}
    if work.keeps(names.ALL):
        arrays |= work.columns.split(chunk.rows)
    return arrays


def results_of(work: Work, statistics: Statistics | None, rows: Mapping[str, Any]) -> dict[str, Array]:
    """Return the variables without a row a run: times, and statistics over time. rows: those with one."""
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
    """Return the quantiles over all runs (runs, n, ...), some times after others: those are read at once."""
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
