"""Run an ensemble: chunks on any executor, taken in their order, kept in a store from time to time."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any

from rbfmu.ensembles.chunks import Chunk, Work, members_of_a_chunk
from rbfmu.ensembles.executors import chunks_in_order
from rbfmu.ensembles.members import with_runs
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.result import EnsembleResult
from rbfmu.ensembles.store import Checkpoint, Progress, Store, refuse_existing, store_lock
from rbfmu.exceptions import named
from rbfmu.extras import needed
from rbfmu.progress import bar
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene, of_scene_or_path

OFTEN, SHARE = 1.0, 0.05
"""The least time between two commits, s, and the largest share of time that they take."""


@of_scene_or_path
def run_ensemble(
    scene: Scene,
    store: str | Path | None = None,
    executor: Any = None,
    runs: int | None = None,
    resume: bool = False,
    progress: bool = True,
    *,
    planned: Plan | None = None,
) -> EnsembleResult:
    """Run the ensemble of a scene, or of a scene file; run i has the same bits wherever and whenever it runs.

    store: a file .npz or a folder .zarr to keep it in, from which `resume` goes on after a stop of any kind; by default
    memory. executor: a number of threads (by default one for each processor), an executor of concurrent.futures, or a
    client of Dask. runs: in place of the scene's. progress: whether to show a bar on a terminal or in a notebook.
    planned: a plan, used as it is. Raises SceneError, SimulationError where the executor fails, FileExistsError and
    ValueError where the store is there already or is of another ensemble, BlockingIOError where another program is
    writing to it.
    """
    check_store(store, resume)
    scene = with_runs(scene, runs)
    plan = plan_ensemble(scene) if planned is None else planned
    work = Work(scene, plan, members_of_a_chunk(scene, plan))
    place = _store(work, store)
    with named(store), store_lock(Path(store)) if store else nullcontext():
        known = place.begin(resume)
        if known is None or known.runs != work.runs:
            failed = _run(work, place, known, executor, progress)
        else:
            failed = known.progress.failed
        return EnsembleResult(scene, place.arrays(), failed)


def check_store(store: str | Path | None, resume: bool) -> None:
    """Refuse what cannot be a store, or is one already, before anything is planned.

    Raises ValueError, ModuleNotFoundError without zarr, FileExistsError.
    """
    if store is None:
        return
    if Path(store).suffix not in (".npz", ".zarr"):
        raise ValueError(f"store = {str(store)!r}: expected a name that ends in .npz or .zarr")
    if Path(store).suffix == ".zarr":
        needed("zarr", "ensemble")
    refuse_existing(Path(store), resume)


def _store(work: Work, path: str | Path | None) -> Store:
    if path is None or Path(path).suffix != ".zarr":
        return Store(work, None if path is None else Path(path))
    from rbfmu.ensembles.zarr_store import ZarrStore

    return ZarrStore(work, Path(path))


def _run(work: Work, store: Store, known: Checkpoint | None, executor: Any, shown: bool) -> dict[int, str]:
    """Run what is missing, and keep it; return what failed."""
    taken = _Taken(work, store, _begun(work, known))
    first = taken.progress.chunks
    done, begin = first * work.size, monotonic()
    with bar(work.scene.name, shown) as tell:
        try:
            for chunk in chunks_in_order(work, first, executor):
                taken.add(chunk)
                done += chunk.members
                speed = (done - first * work.size) / max(monotonic() - begin, 1e-9)
                tell(done, work.runs, f"{work.scene.name}: {done:,} of {work.runs:,} runs, {speed:,.0f} runs/s")
        except OSError:  # of the store, which stays as it was
            raise
        except BaseException:
            taken.commit()
            raise
        store.finish(replace(taken.whole, failed=taken.progress.failed), taken.progress.statistics)
    return taken.progress.failed


def _begun(work: Work, known: Checkpoint | None) -> Progress:
    """Return the progress in full chunks of what is there already."""
    if known is None:
        return Progress.none(work)
    members = known.progress.chunks * work.size
    failed = {index: text for index, text in known.progress.failed.items() if index < members}
    return Progress(known.progress.chunks, known.progress.statistics, failed)


class _Taken:
    """The chunks that are done, in their order, and the store that they are kept in from time to time."""

    def __init__(self, work: Work, store: Store, progress: Progress) -> None:
        self._work, self._store = work, store
        self.progress = self.whole = progress
        self._is_clean = True
        self._cost, self._last = 0.0, monotonic()

    def add(self, chunk: Chunk) -> None:
        """Take the next chunk."""
        self._is_clean = False  # an interrupt may come between any two lines
        if chunk.members < self._work.size:
            self.whole = self.progress.copied()
        self._store.put(chunk)
        self.progress.add(chunk, self._work)
        self._is_clean = chunk.members == self._work.size
        if monotonic() - self._last > max(OFTEN, self._cost / SHARE):
            self.commit()

    def commit(self) -> None:
        """Keep what was taken, if that is full chunks."""
        if not self._is_clean:
            return
        begin = monotonic()
        self._store.commit(self.progress)
        self._last = monotonic()
        self._cost = self._last - begin
