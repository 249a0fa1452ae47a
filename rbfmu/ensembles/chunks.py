"""A chunk of an ensemble: its members' numbers drawn, run in compiled code, and summed up; what its bits rest on."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.loops import advance_lanes, compile_lanes, compiled, entries, run_members
from rbfmu.ensembles.members import Samples, draw, ensemble_of, member, refusals
from rbfmu.ensembles.statistics import Summary, summary_of
from rbfmu.ensembles.variables import ALL, FINAL, KEYS, STATISTICS, Columns, flat, output_rows
from rbfmu.exceptions import SceneError
from rbfmu.models.model_buffer import aligned_zeros, refusal
from rbfmu.runs.inputs import HOLD, drive_of
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu.scene.variations import CONSTANTS, STATES
from rbfmu.simulation import refused_step
from rbfmu_kernels.compile.stamp import SOURCES, hash_of_sources

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SECONDS, MOST_MEMBERS, MOST_BYTES = 0.1, 16384, 8e6
"""What a chunk takes by its plan; the most members, and bytes of their outputs, that it has.

A tenth of a second is a thousand times what handing a chunk to a worker takes, and little to lose by a stop; 8 MB of
outputs stay in a processor's last cache until they are summed up.
"""
SET_UP, STATISTICS_OF_ONE = 1e-5, 2e-8
"""What a member takes besides its steps, and what statistics of one number take, s."""
LANES_FROM, LANES_GAIN, WORTH_COMPILING = 300.0, 3.0, 2.0
"""The cost of a step, ns, from which on lanes take less time for it than one member does, how many times less; and the
time of all members one by one, s, from which on lanes are compiled, once, beside the first of them: ten seconds of a
processor, which pay at the next call if not at this one."""


@dataclass(frozen=True)
class Work:
    """What all chunks of an ensemble have in common. size: members of a chunk."""

    scene: Scene
    plan: Plan
    size: int

    @property
    def columns(self) -> Columns:
        """Return the columns of the outputs."""
        return Columns((*output_rows(self.scene).values(),))

    @property
    def runs(self) -> int:
        """Return the number of members."""
        return ensemble_of(self.scene).runs

    @property
    def chunks(self) -> int:
        """Return the number of chunks."""
        return -(-self.runs // self.size)

    def keeps(self, what: str) -> bool:
        """Return whether this is kept of the runs."""
        return what in ensemble_of(self.scene).keep


class Chunk(NamedTuple):
    """What a chunk of members gave. rows (m, n, K): outputs at all points or the last, NaN of members that failed."""

    first: int
    samples: Mapping[str, Array]
    redrawn: Indices
    rows: Array
    failed: dict[int, str]
    summary: Summary | None

    @property
    def members(self) -> int:
        """Return the number of members."""
        return len(self.rows)


def members_of_a_chunk(scene: Scene, plan: Plan) -> int:
    """Return how many members a chunk has, a power of 2 that depends on the ensemble alone, not on its runs.

    Sums are merged chunk by chunk: with other chunks their bits would be others. A store can so be extended by runs.
    """
    steps = len(drive_of(scene, {}, HOLD).lengths)
    keep = ensemble_of(scene).keep
    numbers = Columns((*output_rows(scene).values(),)).width * (steps + 1 if set(keep) - {FINAL} else 1)
    cost = plan.cost / (LANES_GAIN if _has_lanes(plan) else 1.0)
    seconds = cost * 1e-9 * steps + SET_UP
    seconds += STATISTICS_OF_ONE * numbers if STATISTICS in keep else 0.0
    most = max(1, int(min(SECONDS / seconds, MOST_BYTES / (8.0 * numbers), MOST_MEMBERS)))
    return 1 << (most.bit_length() - 1)


def run_chunk(work: Work, index: int) -> Chunk:
    """Draw and run the members of a chunk. Their bits are those of `simulate(member(scene, samples, row), plan)`."""
    first = index * work.size
    samples = draw(work.scene, first, min(work.size, work.runs - first))
    count = len(samples)
    rows, failed = run_samples(work, samples, ends_alone=not (work.keeps(STATISTICS) or work.keeps(ALL)))
    good = np.array([i for i in range(count) if i not in failed], dtype=np.int64)
    summary = summary_of(rows, good, work.columns.pairs, index) if work.keeps(STATISTICS) else None
    kept = rows if work.keeps(ALL) else np.ascontiguousarray(rows[:, -1:])
    messages = {first + i: text for i, text in sorted(failed.items())}
    return Chunk(first, samples.applied, samples.redrawn, kept, messages, summary)


def run_samples(work: Work, samples: Samples, ends_alone: bool) -> tuple[Array, dict[int, str]]:
    """Return outputs (m, n, K) of members, at all points or at the end alone, and what is said of those that failed.

    Their rows are NaN.
    """
    steps, count = drive_of(work.scene, {}, HOLD).lengths, len(samples)
    points = 1 if ends_alone else len(steps) + 1
    rows = np.full((count, points, work.columns.width), np.nan)
    failed = refusals(work.scene, samples)
    which = np.array([i for i in range(count) if i not in failed], dtype=np.int64)
    if len(which):
        rows[which], said = _outputs(work, samples, which, steps, points)
        failed |= said
    rows[list(failed)] = np.nan
    return rows, failed


def _outputs(work: Work, samples: Samples, which: Indices, steps: Array, points: int) -> tuple[Array, dict[int, str]]:
    """Return the outputs (m, n, K) of the members named, by row, and what is said of those that were refused."""
    plan, kernels = work.plan, work.plan.kernels
    places, values = varied_numbers(samples.applied, kernels.BLOCKS)
    rows = np.empty((len(which), points, work.columns.width))
    ends = np.empty((len(which), 2), dtype=np.int64)
    of_all = filled_buffer(work.scene, plan), places, values[which], steps, work.columns.places(kernels.BLOCKS)
    if not (_has_lanes(plan) and advance_lanes(kernels, *of_all, rows, ends, compile_now=False)):
        compiled(run_members)(*entries(kernels), aligned_zeros(kernels.SIZE), *of_all, rows, ends)
        if compiling_pays(work, len(steps)):  # beside the members to come, of which each has the same bits either way
            compile_lanes(kernels)
    bad = np.flatnonzero((ends[:, 0] != 0) | (ends[:, 1] < len(steps)))
    return rows, {int(which[k]): _message(work.scene, plan, samples, int(which[k]), ends[k]) for k in bad}


def compiling_pays(work: Work, steps: int) -> bool:
    """Return whether members side by side are sooner done, compiling that included."""
    return _has_lanes(work.plan) and work.runs * steps * work.plan.cost * 1e-9 >= WORTH_COMPILING


def _has_lanes(plan: Plan) -> bool:
    return plan.cost >= LANES_FROM and bool(plan.kernels.lanes)


def varied_numbers(applied: Mapping[str, Array], blocks: dict[str, slice]) -> tuple[Indices, Array]:
    """Return places (p,) in a model's buffer and the members' values (m, p) there; what it has no block for is left."""
    count = len(next(iter(applied.values())))
    names = {key: _block_of(key) for key in applied}
    known = {key: blocks[name] for key, name in names.items() if name in blocks}
    places = [place for block in known.values() for place in range(block.start, block.stop)]
    values = np.hstack([np.empty((count, 0)), *(flat(applied[key]) for key in known)])
    return np.array(places, dtype=np.int64), np.ascontiguousarray(values)


def _block_of(key: str) -> str:
    if key.startswith((f"{CONSTANTS}.", f"{STATES}.")):
        return key if key.startswith(CONSTANTS) else f"{key}_0"
    return getattr(KEYS[key], "block", KEYS[key].name)


def _message(scene: Scene, plan: Plan, samples: Samples, row: int, end: Indices) -> str:
    """Return what `simulate` says of a member that was refused, or the checks of its scene say."""
    try:
        own = member(scene, samples, row)
    except SceneError as error:
        return str(error)
    if end[0]:
        return str(refusal(own, int(end[0]), plan.kernels.BLOCKS, filled_buffer(own, plan)))
    return str(refused_step(own, drive_of(own, {}, HOLD).time[int(end[1])]))


PACKAGES = ("ensembles", "runs", "scene")
"""Parts of this package by which members are drawn and run."""
LIBRARIES = ("numpy", "scipy")
"""Packages that drawn numbers rest on."""


@cache
def origin() -> dict[str, str]:
    """Return hashes of sources and versions of libraries by their names: the same bits are made where all are equal."""
    here = Path(__file__).parents[1]
    sources = {f"rbfmu.{name}": hash_of_sources(here / name) for name in PACKAGES}
    return {"rbfmu_kernels": SOURCES} | sources | {name: _version(name) for name in LIBRARIES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
