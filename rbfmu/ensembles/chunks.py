"""A chunk of an ensemble: its members are drawn, run in compiled code and summed up. Also what its bits depend on."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rbfmu.ensembles import variables as names
from rbfmu.ensembles.control import NOTHING, Control, driven_members, errors_named, wrong_input
from rbfmu.ensembles.loops import compile_lanes, run_alone, run_in_lanes
from rbfmu.ensembles.members import Samples, draw, ensemble_of, member, refusals
from rbfmu.ensembles.statistics import MOST_NUMBERS, MOST_SAMPLED, Summary, most_points, sample_of, summary_of
from rbfmu.extras import version_of
from rbfmu.models.model_buffer import places_of, refusal
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.runs.steps import refused_step
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Indices
from rbfmu_kernels.body.members import Members
from rbfmu_kernels.compile.code_cache import SOURCES, hash_of_sources

SECONDS, MOST_MEMBERS, MOST_BYTES, SUMMED_BYTES = 0.1, 16384, 8e6, 64e6
"""SECONDS: the time of a chunk, s, by its plan's cost. The others: the most members of a chunk, and bytes of their
outputs, where these are all returned (MOST_BYTES) or summed up at once (SUMMED_BYTES).

A tenth of a second is a thousand times the time to hand a chunk to a worker, and little is lost if the run is stopped.
The more members are summed up together, the less is left to merge.
"""
SET_UP, STATISTICS_OF_ONE = 1e-5, 5e-9
"""The time of a member besides its steps, and the time of statistics of one number, s."""
GAIN_FROM, LANES_GAIN = 300.0, 3.0
"""LANES_GAIN: how many times faster steps are in lanes than one by one, from a cost of GAIN_FROM ns a step on.

It counts only for a model that has lanes: chunks of others took up to three times the tenth of a second that they
should. With formulas a run costs 1.1 to 2.9 times less in lanes.
"""
LANES_FROM, WORTH_COMPILING = 100.0, 2.0
"""LANES_FROM: the cost of a step, ns, from which on lanes are compiled, and are used with formulas. Cheaper steps, of a
series that serves several, take as long one by one, unless outputs are interpolated. WORTH_COMPILING: the time of all
members one by one, s, from which on lanes are compiled, once, while the first members run: this takes four to ten
seconds of a processor, which pay at the next call if not at this one.
"""


@dataclass(frozen=True)
class Work:
    """What all chunks of an ensemble have in common. size: of a chunk, in members; control: what drives the ports."""

    scene: Scene
    plan: Plan
    size: int
    control: Control = NOTHING

    @property
    def columns(self) -> names.Columns:
        """Return the columns of the outputs."""
        return names.columns_of(self.scene)

    @property
    def runs(self) -> int:
        """Return the number of members."""
        return ensemble_of(self.scene).runs

    @property
    def chunks(self) -> int:
        """Return the number of chunks."""
        return -(-self.runs // self.size)

    @property
    def most_points(self) -> int:
        """Return how many points represent the members' values at each time; 0 where all members are kept."""
        return 0 if self.keeps(names.ALL) else most_points((self.scene.run.count + 1) * self.columns.width)

    @property
    def share(self) -> float:
        """Return the part of the members whose attitudes are sampled for quantiles; 0 where all members are kept."""
        points = self.scene.run.count + 1
        return 0.0 if self.keeps(names.ALL) else min(MOST_SAMPLED, MOST_NUMBERS // (4 * points)) / self.runs

    @property
    def rows_of_runs(self) -> set[str]:
        """Return the names of the variables with one row for each run."""
        known = names.variables_of(self.scene, draw(self.scene, 0, 1).applied).values()
        return {variable.name for variable in known if variable.dims[:1] == (names.RUN,)}

    def keeps(self, what: str) -> bool:
        """Return whether `what` (FINAL, STATISTICS or ALL) is kept."""
        return what in ensemble_of(self.scene).keep


class Chunk(NamedTuple):
    """The results of a chunk of members, the first of which has the number `first`.

    arrays: its part of each variable that has one row for each run, by name; outputs of members that failed are NaN;
    failed: message by the number of the member.
    """

    first: int
    arrays: Mapping[str, Any]
    failed: dict[int, str]
    summary: Summary | None

    @property
    def members(self) -> int:
        """Return the number of members."""
        return len(self.arrays[names.REDRAWN])


def members_of_a_chunk(scene: Scene, plan: Plan, control: Control = NOTHING) -> int:
    """Return the number of members of a chunk, a power of 2 that depends on the ensemble but not on its number of runs.

    Sums are merged chunk by chunk, so that other chunks would give other bits. This allows adding runs to a store.
    """
    steps = scene.run.count
    keep = ensemble_of(scene).keep
    numbers = names.columns_of(scene).width * (steps + 1 if set(keep) - {names.FINAL} else 1)
    numbers += steps * control.numbers(scene)
    # with formulas or a control, chunks stay as before these had lanes, so that sums keep their bits
    gains = plan.kernels.lanes and plan.cost >= GAIN_FROM and not plan.formulas and control is NOTHING
    cost = plan.cost / (LANES_GAIN if gains else 1.0)
    seconds = cost * 1e-9 * steps + SET_UP
    seconds += STATISTICS_OF_ONE * numbers if names.STATISTICS in keep else 0.0
    bytes_of_outputs = MOST_BYTES if names.ALL in keep else SUMMED_BYTES
    most = max(1, int(min(SECONDS / seconds, bytes_of_outputs / (8.0 * numbers), MOST_MEMBERS)))
    return 1 << (most.bit_length() - 1)


def run_chunk(work: Work, index: int) -> Chunk:
    """Draw and run the members of a chunk. Their bits are those of `simulate(member(scene, samples, row), plan)`.

    With a controller, their bits are those of a `Simulator` whose ports the controller sets before each step.
    """
    first = index * work.size
    samples = draw(work.scene, first, min(work.size, work.runs - first))
    count = len(samples)
    ends_alone = not (work.keeps(names.STATISTICS) or work.keeps(names.ALL))
    rows, events, failed = run_samples(work, samples, ends_alone, np.empty if work.keeps(names.ALL) else _same_room)
    good = _all_but(failed, count)
    summary = None
    if work.keeps(names.STATISTICS):
        sample = sample_of(rows, good, first, work.columns, work.share)
        full = count == work.size
        summary = summary_of(rows, good, work.columns, work.most_points, index, full)._replace(sample=sample)
    arrays: dict[str, Any] = {**samples.applied, names.REDRAWN: samples.redrawn, **events}
    if work.keeps(names.FINAL):
        arrays |= {f"{name}_final": values for name, values in work.columns.split(rows[:, -1].copy()).items()}
    if work.keeps(names.ALL):
        arrays |= work.columns.split(rows)
    return Chunk(first, arrays, {first + i: text for i, text in sorted(failed.items())}, summary)


_ROOM = threading.local()


def _same_room(shape: tuple[int, ...]) -> Array:
    """Return an array of this shape in memory that each thread reuses: its rows are not used after their chunk.

    Allocating new memory for each chunk takes as long as filling it.
    """
    size = int(np.prod(shape))
    if not hasattr(_ROOM, "numbers") or _ROOM.numbers.size < size:
        _ROOM.numbers = np.empty(size)
    room: Array = _ROOM.numbers[:size]
    return room.reshape(shape)


def _all_but(failed: Mapping[int, str], count: int) -> Indices:
    """Return the rows of the members that did not fail."""
    return np.delete(np.arange(count), [*failed])


def run_samples(
    work: Work, samples: Samples, ends_alone: bool, room: Callable[[tuple[int, ...]], Array] = np.empty
) -> tuple[Array, dict[str, Any], dict[int, str]]:
    """Return the outputs (m, n, K) of members, their events by variable, and messages of failures by row.

    ends_alone: outputs at the end only, n = 1; room: makes the array of outputs, given its shape. Rows of members that
    failed are NaN, without events. The first time of an event that did not happen is NaN.
    """
    steps, count = np.diff(work.scene.run.grid()), len(samples)
    points = 1 if ends_alone else len(steps) + 1
    failed = refusals(work.scene, samples)
    which = _all_but(failed, count)
    rows, noted = room((count, points, work.columns.width)), np.zeros((count, 2 * len(work.scene.events)))
    if len(which):
        noted[which], messages = _outputs(work, samples, which, steps, rows[: len(which)])
        if failed:
            rows[which] = rows[: len(which)].copy()
        failed |= messages
    rows[list(failed)], noted[list(failed)] = np.nan, 0.0
    return rows, _events(work.scene, noted), failed


def _events(scene: Scene, noted: Array) -> dict[str, Any]:
    """Return the events' variables, given counts and first times (m, 2 E) of E events."""
    counts, firsts = np.hsplit(noted, 2)
    found = {}
    for e, name in enumerate(scene.events):
        found[f"{name}{names.COUNT}"] = counts[:, e].astype(np.int64)
        found[f"{name}{names.FIRST}"] = np.where(counts[:, e] > 0.0, firsts[:, e], np.nan)
    return found


def _outputs(work: Work, samples: Samples, which: Indices, steps: Array, rows: Array) -> tuple[Array, dict[int, str]]:
    """Set the outputs (m, n, K) of the members in rows `which` (m,) of the samples.

    Return the counts and first times (m, 2 E) of E events, and messages of refused members by row.
    """
    plan, kernels = work.plan, work.plan.kernels
    places, values = varied_numbers(work.scene, samples.applied, kernels.BLOCKS)
    ends = np.empty((len(which), 2), dtype=np.int64)
    after = places_of(kernels.BLOCKS, ("events.counts", "events.earliest") if work.scene.events else ())
    noted = np.zeros((len(which), len(after)))
    base, kept = filled_buffer(work.scene, plan), work.columns.places(kernels.BLOCKS)
    members = Members(base, places, values[which], kept, rows, ends, after, noted)
    numbers = (samples.first + which).tolist()
    given = kernels, members, *driven_members(work.control, work.scene, kernels, numbers)
    with errors_named(work.scene, work.control):
        goes_in_lanes, through = plan.cost >= LANES_FROM or not plan.formulas, plan.runs_through
        alone = not (goes_in_lanes and run_in_lanes(*given, through, compile_now=False))
        if alone:
            run_alone(*given, through)
    if alone and compiling_pays(work, len(steps)):  # while the next members run; bits are the same either way
        compile_lanes(kernels, through)
    bad = np.flatnonzero((ends[:, 0] != 0) | (ends[:, 1] < len(steps)))
    return noted, {int(which[k]): _message(work.scene, plan, samples, int(which[k]), ends[k]) for k in bad}


def compiling_pays(work: Work, steps: int) -> bool:
    """Return whether lanes, if the model has any, finish sooner, with the time to compile them."""
    plan = work.plan
    gains = plan.cost >= LANES_FROM or plan.runs_through
    return gains and work.runs * steps * plan.cost * 1e-9 >= WORTH_COMPILING


def varied_numbers(scene: Scene, applied: Mapping[str, Array], blocks: dict[str, slice]) -> tuple[Indices, Array]:
    """Return places (p,) in a model's buffer and the members' values (m, p) there; keys without a block are omitted."""
    count, rows = len(next(iter(applied.values()))), names.varied_rows(scene)
    known = {key: rows[key].block for key in applied if rows[key].block in blocks}
    values = np.hstack([np.empty((count, 0)), *(names.flat(applied[key]) for key in known)])
    return places_of(blocks, known.values()), np.ascontiguousarray(values)


def _message(scene: Scene, plan: Plan, samples: Samples, row: int, end: Indices) -> str:
    """Return the message for a refused member: that of its scene's checks, or that of `simulate`."""
    try:
        own = member(scene, samples, row)
    except SceneError as error:
        return str(error)
    if end[0] < 0:
        return wrong_input(own, end.tolist())
    if end[0]:
        return str(refusal(own, int(end[0]), plan.kernels.BLOCKS, filled_buffer(own, plan)))
    return str(refused_step(own.name, own.run.grid()[int(end[1])]))


LIBRARIES = ("numpy", "scipy")
"""Packages that drawn numbers depend on."""


@cache
def origin() -> dict[str, str]:
    """Return hashes of sources and versions of libraries, by name: where all are equal, the bits are the same."""
    sources = {"rbfmu": hash_of_sources(Path(__file__).parents[1]), "rbfmu_kernels": SOURCES}
    return sources | {name: version_of(name) or "absent" for name in LIBRARIES}
