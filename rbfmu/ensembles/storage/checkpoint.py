"""How far an ensemble is, and the one file that says so: it is replaced whole, or stays as it was."""

import copy
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.chunks import STATISTICS, Chunk, Work
from rbfmu.ensembles.origin import origin
from rbfmu.ensembles.statistics import Statistics
from rbfmu.runs.time_grid import communication_steps

Array = NDArray[np.float64]
EXTENDABLE = ("random", "sobol")
"""Designs of which more members may be asked for later."""
_HEAD, _KEPT = "resume/head", "resume/statistics/"


@dataclass
class Progress:
    """What the chunks 0, 1, ... that were added have given."""

    chunks: int
    statistics: Statistics | None
    failed: dict[int, str] = field(default_factory=dict)

    @classmethod
    def none(cls, work: Work) -> "Progress":
        """Return the progress at the start."""
        if not work.keeps(STATISTICS):
            return cls(0, None)
        points = communication_steps(work.scene) + 1
        return cls(0, Statistics.none(points, work.columns.width, len(work.columns.pairs)))

    def add(self, chunk: Chunk, work: Work) -> None:
        """Add the next chunk."""
        self.chunks += 1
        self.failed |= chunk.failed
        if self.statistics is not None and chunk.summary is not None:
            self.statistics.add(chunk.summary, work.columns.pairs)

    def copied(self) -> "Progress":
        """Return a copy that does not change with this one."""
        return copy.deepcopy(self)


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
        """Write to a file beside, and put that in place of the file: either all of it is there, or the old one."""
        statistics = self.progress.statistics
        kept: dict[str, Any] = {
            f"{_KEPT}{name}": a for name, a in (statistics.to_arrays() if statistics else {}).items()
        }
        kept |= {_HEAD: np.array(self._head()), **self.rows, **self.results}
        part = path.with_name(f"{path.name}.partial")
        try:
            with part.open("wb") as file:
                np.savez(file, **kept)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def _head(self) -> str:
        head = {"identity": self.identity, "chunks": self.progress.chunks, "runs": self.runs, "rows": [*self.rows]}
        return json.dumps(head | {"failed": list(self.progress.failed.items())})

    @classmethod
    def read(cls, path: Path) -> "Checkpoint":
        """Read a file. Raises ValueError where it is no checkpoint of an ensemble."""
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            head = json.loads(str(arrays.pop(_HEAD)))
            kept = {name.removeprefix(_KEPT): arrays.pop(name) for name in [*arrays] if name.startswith(_KEPT)}
            statistics = Statistics.from_arrays(kept) if kept else None
            progress = Progress(head["chunks"], statistics, dict(head["failed"]))
            rows = {name: arrays.pop(name) for name in head["rows"]}
            return cls(head["identity"], progress, rows, arrays, head["runs"])
        except FileNotFoundError:
            raise
        except Exception as error:
            raise ValueError(f"{path}: cannot be read ({error}): expected what `rbfmu ensemble` writes") from None


def identity_of(work: Work) -> dict[str, Any]:
    """Return what tells an ensemble's bits from those of others, for JSON."""
    plan = {k: v for k, v in work.plan.to_dict().items() if k != "reasons"}
    found = {"scene": work.scene.to_dict(), "plan": plan, "members of a chunk": work.size, "origin": origin()}
    return json.loads(json.dumps(found))  # type: ignore[no-any-return]


def difference(there: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """Return what differs first between the ensemble of a store and one that is asked for; empty where nothing does.

    More runs are no difference where members do not depend on how many there are, nor is what is said about a scene.
    """
    path, old, new = _first_difference(_without(there, "about"), _without(asked, "about"), ())
    if not path:
        return ""
    runs = path == ("scene", "ensemble", "runs")
    if runs and asked["scene"]["ensemble"]["design"] in EXTENDABLE and new > old:
        return difference(_without(there, "ensemble", "runs"), _without(asked, "ensemble", "runs"))
    name = ".".join(path[1:] if path[0] == "scene" else path)
    return f"{name} = {_short(new)}: expected {_short(old)}, with which the store was begun"


def _without(identity: Mapping[str, Any], *path: str) -> dict[str, Any]:
    """Return the identity without a key of its scene."""
    found: dict[str, Any] = copy.deepcopy(dict(identity))
    table = found["scene"]
    for name in path[:-1]:
        table = table[name]
    table.pop(path[-1], None)
    return found


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _first_difference(old: Any, new: Any, path: tuple[str, ...]) -> tuple[tuple[str, ...], Any, Any]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in dict.fromkeys([*old, *new]):
            if (found := _first_difference(old.get(key), new.get(key), (*path, str(key))))[0]:
                return found
        return (), None, None
    return (path, old, new) if old != new else ((), None, None)
