"""Where an ensemble's numbers are kept: in memory, or in one .npz. For zarr see `zarr_store`.

A store holds whole chunks from the first on. What stands beyond its checkpoint is written again, the same.
"""

import errno
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rbfmu.ensembles.chunks import Chunk, Work
from rbfmu.ensembles.storage.checkpoint import Checkpoint, Progress, difference, identity_of
from rbfmu.ensembles.storage.variables import arrays_of_chunk, results_of


class Store(Protocol):
    """A place for the numbers of an ensemble."""

    def begin(self, resume: bool) -> Checkpoint | None:
        """Make the store ready, and return what it holds already. Raises FileExistsError, ValueError."""

    def put(self, chunk: Chunk) -> None:
        """Take the next chunk."""

    def commit(self, progress: Progress) -> None:
        """Keep the chunks that were taken, all of them full, even if the program is killed after that."""

    def finish(self, whole: Progress, progress: Progress) -> None:
        """Keep everything. whole: the progress in full chunks, from which more runs may go on."""

    def arrays(self) -> Mapping[str, Any]:
        """Return all variables by name."""


class MemoryStore:
    """Arrays in memory; with a path also a file, which is written anew at each commit."""

    def __init__(self, work: Work, path: Path | None = None) -> None:
        self._work, self._path = work, path
        self._identity = identity_of(work)
        self._rows: dict[str, Any] = {}
        self._results: Mapping[str, Any] = {}

    def begin(self, resume: bool) -> Checkpoint | None:
        """Make the store ready, and return what it holds already. Raises FileExistsError, ValueError."""
        if self._path is None:
            return None
        known = checkpoint_of(self._path, self._path, self._identity, resume)
        if known is None:
            Checkpoint(self._identity, Progress.none(self._work)).write(self._path)
            return None
        for name, values in known.rows.items():
            self._put(name, 0, values)
        self._results = known.results
        return known

    def put(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        for name, values in arrays_of_chunk(self._work, chunk).items():
            self._put(name, chunk.first, values)

    def _put(self, name: str, first: int, values: Any) -> None:
        if name not in self._rows:
            self._rows[name] = np.empty((self._work.runs, *values.shape[1:]), values.dtype)
        self._rows[name][first : first + len(values)] = values

    def commit(self, progress: Progress) -> None:
        """Keep the chunks that were taken, all of them full, even if the program is killed after that."""
        if self._path is not None:
            members = progress.chunks * self._work.size
            rows = {name: values[:members] for name, values in self._rows.items()}
            Checkpoint(self._identity, progress, rows).write(self._path)

    def finish(self, whole: Progress, progress: Progress) -> None:
        """Keep everything. whole: the progress in full chunks, from which more runs may go on."""
        self._results = results_of(self._work, progress.statistics, self._rows)
        if self._path is not None:
            progress = Progress(whole.chunks, whole.statistics, progress.failed)
            Checkpoint(self._identity, progress, self._rows, self._results, self._work.runs).write(self._path)

    def arrays(self) -> Mapping[str, Any]:
        """Return all variables by name."""
        return {**self._rows, **self._results}


def checkpoint_of(store: Path, file: Path, identity: Mapping[str, Any], resume: bool) -> Checkpoint | None:
    """Return the checkpoint of a store, None where there is none yet. Raises FileExistsError, ValueError."""
    refuse_existing(store, resume)
    if not file.exists():
        return None
    known = Checkpoint.read(file)
    if found := difference(known.identity, identity):
        raise ValueError(f"{store}: of another ensemble: {found}")
    return known


def refuse_existing(store: Path, resume: bool) -> None:
    """Raise FileExistsError for a store that is there and is not to be resumed."""
    if not resume and store.exists():
        raise FileExistsError(errno.EEXIST, "exists already, and stays as it is; --resume goes on with it", str(store))
