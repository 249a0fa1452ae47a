"""Run an ensemble: chunks run on threads, any executor or Dask, and are kept in a store in their order."""

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

from rbfmu import extras, simulation
from rbfmu.ensembles import lock, members, planning, result
from rbfmu.ensembles.chunks import Chunk, Work, members_of_a_chunk, origin, run_chunk
from rbfmu.ensembles.control import control_of
from rbfmu.ensembles.store import Progress, Store, refuse_existing, results_of
from rbfmu.exceptions import SimulationError, named, path_of
from rbfmu.progress import bar
from rbfmu.runs.plan import Plan, checked_plan
from rbfmu.scene.scene import Scene, of_scene_or_path

AHEAD = 3
"""Chunks for each worker that are submitted but not yet taken: this bounds the memory.

One runs, one can start when that ends, and one more is there so that a slow chunk that comes next does not stop others.
"""
WARMING = 64
"""The runs of a chunk that is run to compile what an ensemble needs."""
PATIENCE = "30s"
"""The longest time to wait for a scheduler."""

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

    store: a file .npz or a folder .zarr for the results, by default memory; `resume` continues a store after a stop of
    any kind. executor: a number of threads (by default one for each processor), an executor of concurrent.futures, or
    a client of Dask. runs: their number, in place of the scene's. progress: whether to show a bar on a terminal or in a
    notebook. planned: a plan that is used unchanged; without it a scene that was run lately keeps its plan. inputs:
    what drives the ports: for all members as in `simulate`, or a function of a member's number that returns its inputs;
    interpolate: "hold", or "linear" between their times. controller: a `Controller`, or only its function, which is
    called at each communication point, after the inputs are set. Raises SceneError; SimulationError if the executor
    fails; FileExistsError if the store exists; ValueError for a wrong argument, or a store of another ensemble;
    BlockingIOError if another program is writing to it.
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
    """Check before planning that a path can be a store, and that it exists only if it is to be resumed.

    Raises ValueError for a wrong name or nothing to resume, ModuleNotFoundError without zarr, FileNotFoundError if its
    folder is missing, FileExistsError if it exists and is not to be resumed.
    """
    if store is None:
        if resume:
            raise ValueError("resume = True: expected a store to go on with")
        return
    path = path_of(store, "store")
    if path.suffix not in (".npz", ".zarr"):
        raise ValueError(f"store = {str(store)!r}: expected a name that ends in .npz or .zarr")
    if path.suffix == ".zarr":
        extras.needed("zarr", "ensemble")
    if not path.parent.is_dir():  # no lock file could be written beside the store
        raise FileNotFoundError(errno.ENOENT, "there is no such folder", str(path.parent))
    refuse_existing(path, resume)


def _store(work: Work, path: str | Path | None) -> Store:
    if path is None or Path(path).suffix != ".zarr":
        return Store(work, None if path is None else Path(path))
    from rbfmu.ensembles.zarr_store import ZarrStore

    return ZarrStore(work, Path(path))


def _run(work: Work, store: Store, executor: Any, shown: bool) -> None:
    """Run the missing chunks, and keep them."""
    first = store.progress.chunks
    done, begin = first * work.size, monotonic()
    with bar(work.scene.name, shown) as tell, closing(chunks_in_order(work, first, executor)) as chunks:
        try:
            for chunk in chunks:
                store.add(chunk)
                done += chunk.members
                speed = (done - first * work.size) / max(monotonic() - begin, 1e-9)
                tell(done, work.runs, f"{work.scene.name}: {done:,} of {work.runs:,} runs, {speed:,.0f} runs/s")
        except OSError:  # the store cannot be written, and stays as it was
            raise
        except BaseException:
            store.commit()
            raise
        store.finish()


# Where chunks run


@contextmanager
def workers_of(executor: Any) -> Iterator[tuple[Submit, int]]:
    """Yield `submit` and the number of workers of an executor; for None or a number, an executor of new threads."""
    if executor is None or (isinstance(executor, Integral) and not isinstance(executor, bool)):
        number = processors() if executor is None else int(executor)
        if number < 1:
            raise ValueError(f"executor = {number!r}: expected at least one thread")
        with ThreadPoolExecutor(number, "rbfmu") as pool:
            yield pool.submit, number
    elif hasattr(executor, "scheduler_info"):  # a client of Dask; if a worker dies, Dask runs its chunk on another
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

    Dask's log of tracebacks for lost connections is switched off, as an error says enough. Raises ValueError if there
    is no scheduler.
    """
    try:
        client = extras.needed("distributed", "cluster").Client(address, timeout=PATIENCE, set_as_default=False)
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
    """Yield the chunks from number `first` on in their order; only a few are submitted at a time."""
    # threads of this process need no packing, so that functions of any kind can be used
    here = executor is None or isinstance(executor, Integral | ThreadPoolExecutor)
    task, given = (run_chunk, work) if here else (run_packed, pack(work))
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
    """Wait for the next chunk, remove it from the queue, and return it."""
    with _losses():
        chunk: Chunk = waiting.popleft().result()
    return chunk


@contextmanager
def _losses() -> Iterator[None]:
    """Turn an error of an executor or a connection, but not of the work that it runs, into a SimulationError."""
    try:
        yield
    except Exception as error:
        theirs = type(error).__module__.partition(".")[0] in ("concurrent", "distributed", "asyncio")
        if not theirs and "start new thread" not in str(error):  # which Python says where their number is bounded
            raise
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise SimulationError(f"the executor lost a chunk of the ensemble: {text}") from error


def pack(work: Work) -> bytes:
    """Return work as bytes, with its `origin`; a worker makes kernels of formulas again from the scene."""
    bare = replace(work, plan=replace(work.plan, formulas=None))
    with suppress(ImportError):  # it is installed with Dask, and also packs functions that are in no module
        from cloudpickle import dumps

        return pickle.dumps((origin(), dumps(bare)))
    return pickle.dumps((origin(), pickle.dumps(bare)))


@lru_cache(maxsize=4)
def _unpack(given: bytes) -> Work:
    work: Work = pickle.loads(given)
    return replace(work, plan=work.plan.of_scene(work.scene))


def run_packed(given: bytes, index: int) -> Chunk:
    """Run a chunk of packed work, which a worker unpacks once. Raises SimulationError if its bits may differ here."""
    there, work = pickle.loads(given)
    if other := [name for name, value in there.items() if origin().get(name) != value]:
        raise SimulationError(f"a worker has another {', '.join(other)}, whose bits may be others: expected the same")
    return run_chunk(_unpack(work), index)


def warm(scene: Scene, planned: Plan) -> None:
    """Compile what a run of a scene and its ensemble need, where that pays, by running the first members."""
    simulation.simulate(scene, planned=planned)
    if scene.ensemble:
        scene = members.for_ends(members.with_runs(scene, None))
        work = Work(scene, planning.plan_once(scene).of_scene(scene), WARMING)
        chunk, done = run_chunk(work, 0), Progress.none(work)
        done.add(chunk, work)
        results_of(work, done.statistics, chunk.arrays)
