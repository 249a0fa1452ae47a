"""Collects the figures of all methods on all cases, interleaved, into a CSV file."""

import csv
import os
import platform
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from rbfmu.work_precision.cases import CASES, Case
from rbfmu.work_precision.methods import Method, NotFeasibleError, Run, contestants
from rbfmu.work_precision.own import own_methods
from rbfmu.work_precision.peers import peers

Progress = Callable[[int, int, str], Any]
LARGEST_ERROR = 1.0
"""rad; what is worse is no answer and is not kept."""


MOST_IDLE = 5
"""Finer settings in a row that bring nothing, after which a method has given all."""


@dataclass
class Point:
    """One method at one setting on one case.

    errors: rad, and of the position relative to its size, at least 1 m; drifts relative; seconds: best time of a run;
    compiling: what the method's very first call took longer (compilation, or loading what was compiled).
    """

    case: str
    title: str
    method: str
    family: str
    setting: str
    value: float
    attitude_error: float
    position_error: float
    energy_drift: float
    momentum_drift: float
    vertical_momentum_drift: float
    right_hand_sides: float
    seconds: float
    simulated: float
    compiling: float

    @property
    def cost(self) -> float:
        """Time per simulated second."""
        return self.seconds / self.simulated


@dataclass(frozen=True)
class Extent:
    """How much to collect."""

    cases: Sequence[Case]
    methods: Sequence[Method]
    longest: float
    repeats: int
    shortest: float
    quick: bool


QUICK_CASES = ("a", "c", "d")
QUICK_METHODS = (
    "exact", "DOP853, error control", "Taylor, order 12", "kicks, order 4", "RK4, quaternion",
    "Moser-Veselov, order 10", "SciPy DOP853",
)  # fmt: skip


def extent(quick: bool) -> Extent:
    """All of it, or what a test has time for."""
    methods = (*own_methods(), *contestants(), *peers()[0])
    if not quick:
        return Extent(tuple(CASES.values()), methods, 0.1, 5, 2e-3, False)
    few = [method for method in methods if method.name in QUICK_METHODS]
    return Extent([CASES[key] for key in QUICK_CASES], few, 0.02, 2, 2e-4, True)


def collect(what: Extent, progress: Progress) -> tuple[list[Point], list[str]]:
    """Try each method's settings, then time them in turn, in an order that no method can profit from.

    Returns the points, and what could not be run.
    """
    pairs = [(case, method) for case in what.cases for method in what.methods if method.suits(case)]
    total = len(pairs) + what.repeats * len(what.cases)
    found: list[tuple[Point, Run]] = []
    first_calls: dict[str, float] = {}
    notes: dict[str, str] = {}
    for i, (case, method) in enumerate(pairs):
        progress(i, total, f"{case.title}: {method.name}")
        found += _explored(what, case, method, first_calls, notes)
    order = random.Random(1)
    for repeat in range(what.repeats):
        for j, case in enumerate(what.cases):
            progress(len(pairs) + repeat * len(what.cases) + j, total, f"{case.title}: timing {repeat + 1}")
            longest = what.longest * (3.0 if repeat < 2 else 0.1)
            again = [(p, run) for p, run in found if p.case == case.key and p.seconds < longest]
            order.shuffle(again)
            for point, run in again:
                k = max(1, round(what.shortest / point.seconds))
                point.seconds = min(point.seconds, run.seconds(k) / k)
    progress(total, total, "")
    return [point for point, _ in found], list(notes.values())


def _explored(
    what: Extent, case: Case, method: Method, first_calls: dict[str, float], notes: dict[str, str]
) -> Iterator[tuple[Point, Run]]:
    """Settings from coarse to fine until time or digits end."""
    least, last, idle = np.inf, np.inf, 0
    for value in method.settings(case, what.quick):
        start = perf_counter()
        try:
            run = method.run(case, value)
            errors = case.errors(run.states())
        except NotFeasibleError as error:
            notes.setdefault(f"{case.key} {method.name}", f"{case.key}, {method.name}, {value:g}: {error}"[:200])
            continue
        seconds = perf_counter() - start
        if method.name not in first_calls:
            run.seconds(1)
            first = perf_counter() - start
            seconds = run.seconds(1)
            first_calls[method.name] = max(0.0, first - 2.0 * seconds)
        elif not case.long:
            seconds = run.seconds(1)
        if errors["attitude"] <= LARGEST_ERROR:
            yield _point(case, method, value, run, errors, seconds, first_calls[method.name]), run
        idle = 0 if errors["attitude"] < 0.7 * least else idle + (errors["attitude"] != last)
        last = errors["attitude"]  # equal where both take one step to each checkpoint
        least = min(least, errors["attitude"])
        if (1.5 * seconds > what.longest and not case.long) or (idle >= MOST_IDLE and least < 1e-2):
            return


def _point(
    case: Case, method: Method, value: float, run: Run, errors: dict[str, float], seconds: float, compiling: float
) -> Point:
    drifts = (errors["energy"], errors["momentum"], errors["vertical momentum"])
    return Point(
        *(case.key, case.title, method.name, method.family, method.setting, value),
        *(errors["attitude"], errors["position"], *drifts, run.evaluations, seconds, case.span, compiling),
    )


def machine() -> list[str]:
    """What it ran on: lines for a file's head."""
    packages = ("numpy", "numba", "llvmlite")
    theirs = ", ".join(f"{name} {found}" for name, found in peers()[1].items())
    return [
        f"{_processor()}, {os.cpu_count()} processors, {platform.platform()}",
        f"Python {platform.python_version()}, " + ", ".join(f"{name} {version(name)}" for name in packages),
        theirs,
    ]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def write_rows(path: Path, rows: Iterable[dict[str, Any]], head: Iterable[str]) -> Path:
    """A CSV file whose first lines, after #, say where the figures come from."""
    rows = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {' '.join(line.split())}\n" for line in head)
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def write_points(path: Path, points: Sequence[Point], notes: Sequence[str] = ()) -> Path:
    """The collected figures; every digit."""
    return write_rows(path, map(asdict, points), [*machine(), *(f"not run: {note}" for note in notes)])


def read_points(path: Path) -> list[Point]:
    """What `write_points` wrote."""
    texts = {field.name for field in fields(Point) if field.type is str}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    values: list[dict[str, Any]] = [{name: x if name in texts else float(x) for name, x in row.items()} for row in rows]
    return [Point(**row) for row in values]
