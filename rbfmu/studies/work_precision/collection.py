"""Collect measurements of all methods on all cases, interleaved, in a CSV file."""

import csv
import math
import os
import platform
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from rbfmu.studies.work_precision.cases import CASES, Case
from rbfmu.studies.work_precision.library_methods import library_methods
from rbfmu.studies.work_precision.methods import Method, NotFeasibleError, Run, reference_integrators
from rbfmu.studies.work_precision.peers import ABSENT, absent, peers

Progress = Callable[[int, int, str], Any]
LARGEST_ERROR = 1.0
"""The largest attitude error in rad that is recorded; a larger one is no answer."""


TIME_LIMIT = 0.3
"""The processor time in s that a run may take; a method whose finer settings would take more is stopped."""
MAX_REFUSED = 30
"""The number of settings in a row that a method does not run at, after which no more are tried."""
MAX_IDLE = 5
"""The number of finer settings in a row without a gain after which no more are tried."""


@dataclass
class Point:
    """One method at one setting on one case.

    outputs: the number of states that a run returns; detail: the method that a plan chose; error: that of the
    attitude, rad (of a scene of one's own: as its accuracy counts); position_error: relative to its size (at least 1
    m); drifts: relative; seconds: the least processor time of a run; spread: the ratio between the least times of
    every other repeat and of the repeats between; compiling: the additional time of the method's very first call,
    which compiles or loads compiled code.
    """

    case: str
    title: str
    outputs: int
    method: str
    detail: str
    family: str
    setting: str
    value: float
    error: float
    position_error: float
    energy_drift: float
    momentum_drift: float
    vertical_momentum_drift: float
    right_hand_sides: float
    seconds: float
    simulated: float
    compiling: float
    spread: float = 1.0

    @property
    def motion(self) -> tuple[str, int]:
        """Return the case and the number of outputs, for which methods are compared."""
        return self.case, self.outputs


@dataclass(frozen=True)
class Ending:
    """The smallest error that a method reached on a case (infinite: none below `LARGEST_ERROR`), and why it ended."""

    case: str
    outputs: int
    method: str
    family: str
    error: float
    why: str

    @property
    def stopped(self) -> bool:
        """Return whether the time limit stopped the method."""
        return self.why == STOPPED


STOPPED = "stopped: time limit"


@dataclass(frozen=True)
class Collection:
    """All measurements, where and why each method ended, and the time limit in s."""

    points: list[Point]
    endings: list[Ending]
    limit: float = TIME_LIMIT

    @property
    def noise(self) -> float:
        """Return the ratio within which costs count as equal: 19 of 20 points have a smaller spread."""
        return float(np.percentile([point.spread for point in self.points], 95.0))


@dataclass(frozen=True)
class Extent:
    """The cases, methods and limits of a collection; finest: the error below which nothing is told from round-off."""

    cases: Sequence[Case]
    methods: Sequence[Method]
    longest: float
    repeats: int
    shortest: float
    quick: bool
    finest: float = 0.0


QUICK_CASES = ("a", "c", "d")
QUICK_METHODS = (
    "exact", "DOP853, error control", "Taylor, order 12", "splitting, order 4", "RK4, quaternion",
    "Moser-Veselov, order 10", "SciPy DOP853", "SciPy odeint", "rbfmu, as planned",
)  # fmt: skip


def extent(quick: bool) -> Extent:
    """Return the full extent, or a small one for a quick run."""
    methods = (*library_methods(), *reference_integrators(), *peers()[0])
    if not quick:
        return Extent(tuple(few_and_many(CASES)), methods, TIME_LIMIT, 5, 2e-3, False)
    few = [method for method in methods if method.name in QUICK_METHODS]
    return Extent(tuple(few_and_many(QUICK_CASES)), few, 0.02, 2, 2e-4, True)


def few_and_many(keys: Iterable[str]) -> Iterator[Case]:
    """Yield each case with few and with many outputs; long ones with few only."""
    for key in keys:
        yield CASES[key]
        if not CASES[key].long:
            yield CASES[key].with_many_outputs()


def collect(what: Extent, progress: Progress) -> Collection:
    """Try each method's settings, then time them in turns, in a random order that favours no method."""
    pairs = [(case, method) for case in what.cases for method in what.methods if method.suits(case)]
    total = len(pairs) + what.repeats * len(what.cases)
    found: list[Tried] = []
    endings = [
        Ending(case.key, case.outputs, method.name, method.family, math.inf, STOPPED)
        for case in what.cases
        for method in what.methods
        if case.long and method.family == "peer"  # millions of steps
    ]
    first_calls: dict[str, float] = {}
    for i, (case, method) in enumerate(pairs):
        progress(i, total, f"{case.title}, {case.outputs} outputs: {method.name}")
        tried, ending = explored(what, case, method, first_calls)
        found += tried
        endings.append(ending)
    order = random.Random(1)
    for repeat in range(what.repeats):
        for j, case in enumerate(what.cases):
            progress(len(pairs) + repeat * len(what.cases) + j, total, f"{case.title}: timing {repeat + 1}")
            longest = what.longest * (3.0 if repeat < 2 else 0.1)
            again = [t for t in found if t.point.motion == (case.key, case.outputs) and t.point.seconds < longest]
            order.shuffle(again)
            for tried_one in again:
                tried_one.time(what.shortest)
    progress(total, total, "")
    return Collection([tried_one.point for tried_one in found], endings, what.longest)


@dataclass
class Tried:
    """A point that can be timed again."""

    point: Point
    run: Run
    times: list[float] = field(default_factory=list)

    def time(self, shortest: float) -> None:
        """Time once more, for about `shortest` s, and update the least time and the spread of the point."""
        k = max(1, round(shortest / self.point.seconds))
        self.times.append(self.run.seconds(k) / k)
        halves = [min(half) for half in (self.times[::2], self.times[1::2]) if half]
        self.point.seconds, self.point.spread = min(halves), max(halves) / min(halves)


def explored(what: Extent, case: Case, method: Method, first_calls: dict[str, float]) -> tuple[list[Tried], Ending]:
    """Try settings from coarse to fine until time or digits end; `first_calls` (s, by method) is filled here."""
    found: list[Tried] = []
    least, last, idle, refused, why = math.inf, math.inf, 0, 0, "all settings tried"
    for value in method.settings(case, what.quick):
        try:
            run, errors, seconds = _tried(case, method, value, first_calls)
        except NotFeasibleError as fault:
            why, refused = f"not run at {value:g}: {' '.join(str(fault).split())}"[:200], refused + 1
            if refused == MAX_REFUSED:
                break
            continue
        refused, why = 0, "all settings tried"
        error = case.judged(errors)
        if error <= LARGEST_ERROR:
            found.append(Tried(_point(case, method, value, run, errors, seconds, first_calls[method.name]), run))
        idle = 0 if error < 0.7 * least else idle + (error != last)
        last = error  # errors are equal where both settings take one step to each output
        least = min(least, error)
        if 1.5 * seconds > what.longest and not case.long:
            why = STOPPED
            break
        if (idle >= MAX_IDLE and least < 1e-2) or error < what.finest:
            why = "no more digits"
            break
    best = min((tried.point.error for tried in found), default=math.inf)
    return found, Ending(case.key, case.outputs, method.name, method.family, best, why)


def _tried(
    case: Case, method: Method, value: float, first_calls: dict[str, float]
) -> tuple[Run, dict[str, float], float]:
    """Return a run that is ready to be timed, its errors, and its time in s."""
    start = process_time()
    run = method.run(case, value)
    errors = case.errors(run.states())
    if method.name in first_calls:
        return run, errors, run.seconds(1)
    run.seconds(1)
    first = process_time() - start
    seconds = run.seconds(1)
    first_calls[method.name] = max(0.0, first - 2.0 * seconds)
    return run, errors, seconds


def _point(
    case: Case, method: Method, value: float, run: Run, errors: dict[str, float], seconds: float, compiling: float
) -> Point:
    drifts = (errors["energy"], errors["momentum"], errors["vertical momentum"])
    return Point(
        *(case.key, case.title, case.outputs, method.name, run.detail, method.family, method.setting, value),
        *(case.judged(errors), errors["position"], *drifts, run.evaluations, seconds, case.span, compiling),
    )


def machine() -> list[str]:
    """Return lines on the machine and the packages for a file's head."""
    packages = ("numpy", "numba", "llvmlite")
    theirs = ", ".join(f"{name} {found}" for name, found in peers()[1].items() if found != ABSENT)
    return [
        f"{_processor()}, {os.cpu_count()} processors, {platform.platform()}",
        f"Python {platform.python_version()}, " + ", ".join(f"{name} {version(name)}" for name in packages),
        *([theirs] if theirs else []),
        *absent(),
    ]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def write_rows(path: Path, rows: Iterable[dict[str, Any]], head: Iterable[str]) -> Path:
    """Write a CSV file whose first lines, after #, say where the figures come from."""
    rows = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {' '.join(line.split())}\n" for line in head)
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def write_points(path: Path, points: Sequence[Point]) -> Path:
    """Write the collected points with all digits."""
    return write_rows(path, map(asdict, points), machine())


def read_points(path: Path) -> list[Point]:
    """Return what `write_points` wrote."""
    texts = {name.name for name in fields(Point) if name.type is str}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    values: list[dict[str, Any]] = [{name: x if name in texts else float(x) for name, x in row.items()} for row in rows]
    return [Point(**row | {"outputs": int(row["outputs"])}) for row in values]
