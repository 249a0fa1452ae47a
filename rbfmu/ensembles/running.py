"""Run an ensemble: chunks on threads, any executor or Dask, taken in their order and kept in a store."""

import errno
import logging
import os
import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import lru_cache, partial
from numbers import Integral
from pathlib import Path
from time import monotonic
from typing import Any

from rbfmu.ensembles import lock, members, planning, result
from rbfmu.ensembles.chunks import Chunk, Work, members_of_a_chunk, origin, run_chunk
from rbfmu.ensembles.control import control_of
from rbfmu.ensembles.store import Progress, Store, chunk_arrays, refuse_existing, results_of
from rbfmu.exceptions import SimulationError, named, path_of
from rbfmu.extras import needed
from rbfmu.progress import bar
from rbfmu.runs.plan import Plan, checked_plan
from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.simulation import simulate

AHEAD = 3
"""Chunks that are on their way or wait for an earlier one, for each worker: memory is bounded by that.

One runs, one is ready when that ends, and one more so that a slow chunk, whose turn it is, does not stop the others.
"""
WARMING = 64
"""Runs that compile what an ensemble needs."""
PATIENCE = "30s"
"""How long a scheduler is waited for."""

Submit = Callable[..., Any]


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
    inputs: Any = None,
    interpolate: str = "hold",
    controller: Any = None,
) -> result.EnsembleResult:
    """Run the ensemble of a scene, or of a scene file; run i has the same bits wherever and whenever it runs.

    store: a file .npz or a folder .zarr to keep it in, from which `resume` goes on after a stop of any kind; by default
    memory. executor: a number of threads (by default one for each processor), an executor of concurrent.futures, or a
    client of Dask. runs: in place of the scene's. progress: whether to show a bar on a terminal or in a notebook.
    planned: a plan, used as it is; without one a scene that was run lately keeps its plan. inputs: what drives the
    ports: for all members as in `simulate`, or a function of a member's number that returns that; interpolate: "hold",
    or "linear" between their times. controller: a `Controller`, or its function alone, which is called at each
    communication point, after the inputs. Raises SceneError, SimulationError where the executor fails, FileExistsError
    and ValueError where the store is there already or is of another ensemble, BlockingIOError where another program is
    writing to it.
    """
    check_store(store, resume)
    scene = members.with_runs(scene, runs)
    scene = scene if planned else members.for_ends(scene)
    plan = (checked_plan(planned) or planning.plan_once(scene)).of_scene(scene)
    control = control_of(scene, plan, inputs, controller, interpolate)
    work = Work(scene, plan, members_of_a_chunk(scene, plan, control), control)
    place = _store(work, store)
    with named(store), lock.store_lock(Path(store)) if store else nullcontext():
        if place.begin(resume) != work.runs:
            _run(work, place, executor, progress)
        return result.EnsembleResult(scene, place.arrays(), place.progress.failed)


def check_store(store: str | Path | None, resume: bool) -> None:
    """Refuse what cannot be a store or be resumed, or is one already, before anything is planned.

    Raises ValueError, ModuleNotFoundError without zarr, FileNotFoundError without its folder, FileExistsError.
    """
    if store is None:
        if resume:
            raise ValueError("resume = True: expected a store to go on with")
        return
    path = path_of(store, "store")
    if path.suffix not in (".npz", ".zarr"):
        raise ValueError(f"store = {str(store)!r}: expected a name that ends in .npz or .zarr")
    if path.suffix == ".zarr":
        needed("zarr", "ensemble")
    if not path.parent.is_dir():  # where no lock could stand beside it
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(path.parent))
    refuse_existing(path, resume)


def _store(work: Work, path: str | Path | None) -> Store:
    if path is None or Path(path).suffix != ".zarr":
        return Store(work, None if path is None else Path(path))
    from rbfmu.ensembles.zarr_store import ZarrStore

    return ZarrStore(work, Path(path))


def _run(work: Work, store: Store, executor: Any, shown: bool) -> None:
    """Run what is missing, and keep it."""
    first = store.progress.chunks
    done, begin = first * work.size, monotonic()
    with bar(work.scene.name, shown) as tell, closing(chunks_in_order(work, first, executor)) as chunks:
        try:
            for chunk in chunks:
                store.add(chunk)
                done += chunk.members
                speed = (done - first * work.size) / max(monotonic() - begin, 1e-9)
                tell(done, work.runs, f"{work.scene.name}: {done:,} of {work.runs:,} runs, {speed:,.0f} runs/s")
        except OSError:  # of the store, which stays as it was
            raise
        except BaseException:
            store.commit()
            raise
        store.finish()


# Where chunks run


@contextmanager
def workers_of(executor: Any) -> Iterator[tuple[Submit, int]]:
    """Yield `submit` and the number of workers of an executor; of None or a number of threads: threads of our own."""
    if executor is None or (isinstance(executor, Integral) and not isinstance(executor, bool)):
        number = processors() if executor is None else int(executor)
        if number < 1:
            raise ValueError(f"executor = {number!r}: expected at least one thread")
        with ThreadPoolExecutor(number, "rbfmu") as pool:
            yield pool.submit, number
    elif hasattr(executor, "scheduler_info"):  # a client of Dask, which runs the chunk of a worker that dies on another
        if executor.status == "closed":
            raise ValueError(f"executor = {executor!r}: expected a client of Dask that is open")
        with _losses():  # the scheduler may have died while the ensemble was planned
            number = max(1, sum(executor.nthreads().values()))
        yield partial(executor.submit, pure=False), number
    elif hasattr(executor, "submit"):
        yield executor.submit, int(getattr(executor, "_max_workers", 0)) or processors()
    else:
        expected = "a number of threads, an executor of concurrent.futures or a client of Dask"
        raise ValueError(f"executor = {executor!r}: expected {expected}")


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def dask_client(address: str) -> Iterator[Any]:
    """Yield a client of the scheduler at an address such as tcp://host:8786.

    Dask is kept from writing tracebacks of lost connections, of which an error says enough.
    """
    try:
        client = needed("distributed", "cluster").Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"no scheduler of Dask at {address!r}: {error}") from None
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with client:
            yield client
    finally:
        log.setLevel(level)


def chunks_in_order(work: Work, first: int, executor: Any) -> Generator[Chunk]:
    """Yield the chunks from the number `first` on in their order, of which few are on their way at a time."""
    # functions of any kind need no packing for threads of this process
    here = executor is None or isinstance(executor, Integral | ThreadPoolExecutor)
    task, given = (run_chunk, work) if here else (run_packed, packed(work))
    with workers_of(executor) as (submit, workers):
        waiting: deque[Any] = deque()
        try:
            for number in range(first, work.chunks):
                with _losses():
                    waiting.append(submit(task, given, number))
                if len(waiting) >= AHEAD * workers:
                    yield _result(waiting)
            while waiting:
                yield _result(waiting)
        finally:
            for future in waiting:
                future.cancel()


def _result(waiting: "deque[Any]") -> Chunk:
    """Return the chunk that comes next, and forget it."""
    with _losses():
        chunk: Chunk = waiting.popleft().result()
    return chunk


@contextmanager
def _losses() -> Iterator[None]:
    """Turn an error of an executor or of a connection, not of what it runs, into one that says so."""
    try:
        yield
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in ("concurrent", "distributed", "asyncio"):
            raise
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise SimulationError(f"the executor lost a chunk of the ensemble: {text}") from error


def packed(work: Work) -> bytes:
    """Return work as bytes, with what its bits rest on here; kernels of formulas are made again of the scene."""
    bare = replace(work, plan=replace(work.plan, formulas=None))
    with suppress(ImportError):  # Dask brings it; it also packs functions that stand in no module
        from cloudpickle import dumps

        return pickle.dumps((origin(), dumps(bare)))
    return pickle.dumps((origin(), pickle.dumps(bare)))


@lru_cache(maxsize=4)
def _unpacked(given: bytes) -> Work:
    work: Work = pickle.loads(given)
    return replace(work, plan=work.plan.of_scene(work.scene))


def run_packed(given: bytes, index: int) -> Chunk:
    """Run a chunk of packed work, which a worker unpacks once. Raises SimulationError where its bits may be others."""
    there, work = pickle.loads(given)
    if other := [name for name, value in there.items() if origin().get(name) != value]:
        raise SimulationError(f"a worker has another {', '.join(other)}, whose bits may be others: expected the same")
    return run_chunk(_unpacked(work), index)


def warm(scene: Scene, planned: Plan) -> None:
    """Compile what a run of a scene needs, and its ensemble, where that pays: the first of its runs tell."""
    simulate(scene, planned=planned)
    if scene.ensemble:
        scene = members.for_ends(members.with_runs(scene, None))
        work = Work(scene, planning.plan_once(scene).of_scene(scene), WARMING)
        chunk, done = run_chunk(work, 0), Progress.none(work)
        done.add(chunk, work)
        results_of(work, done.statistics, chunk_arrays(work, chunk))
