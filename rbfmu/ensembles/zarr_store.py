"""A folder of zarr, which xarray and others can read: rows of runs are written once, in whole chunks of zarr."""

import errno
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu.ensembles import chunks, store, variables as names
from rbfmu.extras import needed

ROWS = 16384
"""The least number of runs in a chunk of zarr of variables without time; fewer are kept in the checkpoint."""
NUMBERS = 262144
"""How many numbers a chunk of zarr has, of variables with time."""
PART = ".partial"
"""The ending of files that zarr has not yet renamed to their final name."""
LAYOUT = f"{names.RESUME}/layout"
"""In the checkpoint: the digest of zarr's metadata of the arrays. The chunks themselves have checksums."""


def _is_ours(path: Path) -> bool:
    return path.name in (names.RESUME, "zarr.json") or path.suffix == PART


class StoredArray:
    """An array of a folder of zarr, of which parts are read when they are used. Raises ValueError if it is damaged."""

    def __init__(self, path: Path, array: Any) -> None:
        self._path, self._array = path, array
        self.shape, self.dtype, self.ndim, self.size = array.shape, array.dtype, array.ndim, array.size

    def __getitem__(self, part: Any) -> Any:
        with store.damage_of(self._path, f"{self._array.basename}: "):
            return self._array[part]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.asarray(self[...], dtype)


def arrays_of_folder(path: Path, known: Mapping[str, Any]) -> dict[str, StoredArray]:
    """Return the arrays of a finished store by name. Raises ValueError if it is damaged.

    known: the checkpoint's results; they contain no LAYOUT if the store was written without checksums.
    """
    with store.damage_of(path):
        arrays = dict(needed("zarr", "ensemble").open_group(path, mode="r").arrays())
        lost = [name for name, array in arrays.items() if array.nchunks_initialized != array.nchunks]
        if LAYOUT in known and (lost or known[LAYOUT] != _layout(arrays)):
            raise ValueError(f"{lost[0]}: chunks are missing" if lost else "the arrays are not those that were written")
    return {name: StoredArray(path, array) for name, array in arrays.items()}


def _layout(arrays: Mapping[str, Any]) -> str:
    """Return a digest of names, shapes and codecs, but not of attributes, which may change."""
    found = {name: array.metadata.to_dict() | {"attributes": None} for name, array in arrays.items()}
    return hashlib.sha256(json.dumps(found, sort_keys=True, default=str).encode()).hexdigest()


class ZarrStore(store.Store):
    """A store in a folder of zarr, format 3; rows that do not yet fill a chunk of zarr are in the checkpoint."""

    def __init__(self, work: chunks.Work, path: Path) -> None:
        super().__init__(work, path, path / names.RESUME / "checkpoint.npz")
        self._zarr, self._folder = needed("zarr", "ensemble"), path
        self._length = work.size * max(1, ROWS // work.size)
        self._group: Any = None

    def _open(self, known: store.Checkpoint | None) -> None:
        """Open or make the folder. Raises FileExistsError if it contains something else than an ensemble."""
        if known is None:
            self._refuse_others()
        for part in self._folder.rglob(f"*{PART}"):  # left by a program that was killed
            part.unlink()
        with store.damage_of(self._folder, but=OSError):
            self._group = self._zarr.open_group(self._folder, mode="a", zarr_format=3)
            there = dict(self._group.arrays())  # zarr leaves out what it does not know as an array
            if known and known.progress.chunks and (lost := self._work.rows_of_runs - there.keys()):
                raise ValueError(f"{min(lost)}: is missing, or is no array")
        if known is None:
            self._group.require_group(names.RESUME)
            return
        self._rows, self._results = dict(known.rows), known.results
        self._first = known.progress.chunks * self._work.size - len(self._rows.get(names.REDRAWN, ()))
        if known.runs != self._work.runs:
            self._write(known.progress, known.rows)  # no result until all is done
            self._give_each_run_a_row()

    def _refuse_others(self) -> None:
        """Refuse a folder with other content than that of a store that was killed before its first checkpoint."""
        if self._folder.exists() and not (self._folder.is_dir() and all(map(_is_ours, self._folder.iterdir()))):
            raise FileExistsError(errno.EEXIST, "is no store of an ensemble, and stays as it is", str(self._folder))

    def _give_each_run_a_row(self) -> None:
        """Resize arrays of another length: zarr silently drops what is written beyond the end of an array."""
        for _, array in self._group.arrays():
            if (array.metadata.dimension_names or ())[:1] == ("run",) and array.shape[0] != self._work.runs:
                array.resize((self._work.runs, *array.shape[1:]))

    def _keep(self, chunk: chunks.Chunk) -> None:
        if chunk.first == 0:
            self._create(chunk.arrays)
        for name, values in chunk.arrays.items():
            if name in self._work.columns.slices:  # with all times
                self._set(name, np.s_[chunk.first : chunk.first + chunk.members], values)
            else:
                self._rows[name] = np.concatenate([self._rows.get(name, values[:0]), values])
        if len(self._rows[names.REDRAWN]) >= self._length:
            self._write_rows()

    def _create(self, arrays: Mapping[str, Any]) -> None:
        """Create the arrays with one row for each run, with the types of the first chunk."""
        for variable in names.variables_of(self._work.scene, arrays).values():
            if variable.dims[:1] == ("run",):
                values = arrays[variable.name]
                self._array(variable, (self._work.runs, *values.shape[1:]), values.dtype)

    def _array(self, variable: names.Variable, shape: tuple[int, ...], dtype: Any) -> None:
        self._group.create_array(
            variable.name, shape=shape, chunks=self._chunks(variable, shape), dtype=dtype, overwrite=True,
            fill_value=np.nan if dtype.kind == "f" else 0, dimension_names=variable.dims,
            attributes=variable.attributes,
            compressors=(self._zarr.codecs.ZstdCodec(level=0), self._zarr.codecs.Crc32cCodec()),
        )  # fmt: skip

    def _chunks(self, variable: names.Variable, shape: tuple[int, ...]) -> tuple[int, ...]:
        if variable.dims[:2] == ("run", "time"):
            times = max(1, NUMBERS // (self._work.size * int(np.prod(shape[2:]))))
            return (self._work.size, min(times, shape[1]), *shape[2:])
        return (self._length, *shape[1:]) if variable.dims[:1] == ("run",) else shape

    def _set(self, name: str, part: Any, values: Any) -> None:
        with self._zarr.config.set({"array.write_empty_chunks": True}):  # so that a missing chunk was lost
            self._group[name][part] = values

    def _write_rows(self) -> None:
        for name, values in self._rows.items():
            self._set(name, np.s_[self._first : self._first + len(values)], values)
        self._first += len(self._rows.get(names.REDRAWN, ()))
        self._rows = {}

    def finish(self) -> None:
        """Write everything, also the progress in full chunks, from which the ensemble can be extended."""
        self._whole.failed = self.progress.failed
        last = self._rows_of(self._whole)
        self._write_rows()
        rows = {name: StoredArray(self._folder, array) for name, array in self._group.arrays()}
        results = store.results_of(self._work, self.progress.statistics, rows)
        known = [(variable, results.get(variable.name)) for variable in names.variables(self._work.scene, {})]
        for name, (dimension, values, said) in names.coordinates(results[names.TIMES]).items():
            known.append((names.Variable(name, (dimension,), said), values))
        for variable, values in known:
            if values is not None:
                self._array(variable, values.shape, values.dtype)
                self._set(variable.name, ..., values)
        self._group.attrs.update({
            "title": self._work.scene.name,
            "scene": self._work.scene.to_dict(),
            "model": f"{self._work.plan.model}: {self._work.plan.method}",
            "failed": {str(index): text for index, text in self.progress.failed.items()},
        })  # fmt: skip
        self._results = {LAYOUT: np.array(_layout(dict(self._group.arrays())))}
        self._write(self._whole, last, self._work.runs)

    def arrays(self) -> Mapping[str, Any]:
        """Return all variables by name; they are read when they are used."""
        return arrays_of_folder(self._folder, self._results)
