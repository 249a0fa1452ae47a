"""Measure a case: find the methods that suit it, run each at settings from coarse to fine, then time all in turns."""

import math
import os
import platform
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path
from time import thread_time
from typing import NamedTuple

from rbfmu.extras import remedy, version_of
from rbfmu.models import registry
from rbfmu.planning.select import plan
from rbfmu.runs.plan import Plan
from rbfmu.runs.steps import motion_of
from rbfmu.scene.scene import SceneError
from rbfmu.studies import Progress, one_step, tables_of
from rbfmu.studies.chart import simulators, solvers
from rbfmu.studies.chart.cases import FLOOR, Case, few_and_many
from rbfmu.studies.chart.methods import MOST_RADIANS, Method, NotFeasibleError, Run, fixed_steps, own_methods, planned
from rbfmu.studies.chart.result import STOPPED, TAKES_NO, YOURS, Chart, End, Row, TooSmall, kind_of
from rbfmu_kernels.models.one_axis import ORDERS

LARGEST_ERROR = 1.0
"""The largest error that is recorded; a larger one is no useful result."""
MAX_REFUSED = 30
"""After so many settings in a row at which a method cannot run, no more are tried."""
MAX_IDLE = 5
"""After so many finer settings in a row without a smaller error, no more are tried."""
_NOT_OWN = "it has attitude and rates, and the scene asks for more, or has formulas"


# The methods that are compared


class Peer(NamedTuple):
    """Another program: its package, the extra of this library that installs it, and its methods.

    most: the largest angle in rad that a body may turn by in a run; it is smaller for programs that are called from
    Python at each step.
    """

    package: str
    extra: str
    methods: Sequence[Method]
    most: float = MOST_RADIANS

    @property
    def installed(self) -> str:
        """Return the version that is installed; empty if none is."""
        return version_of(self.package)


PEERS = {
    "SciPy": Peer("scipy", "bench", solvers.SCIPY, 1e4),
    "numbalsoda": Peer("numbalsoda", "bench-fortran", solvers.NUMBALSODA),
    "heyoka.py": Peer("heyoka", "bench", [solvers.HEYOKA]),
    "MuJoCo": Peer("mujoco", "bench", simulators.MUJOCO, 1e4),
    "Basilisk": Peer("bsk", "bench-simulators", simulators.BASILISK),
    "Drake": Peer("drake", "bench-simulators", simulators.DRAKE),
}
"""The peers by name."""


def peers() -> list[Method]:
    """Return the methods of the peers that are installed."""
    return [method for peer in PEERS.values() if peer.installed for method in peer.methods]


def absent() -> list[str]:
    """Return a line for each peer that is not installed."""
    return [f"{name}: not installed ({remedy(peer.extra)})" for name, peer in PEERS.items() if not peer.installed]


def contestants(case: Case) -> list[Method]:
    """Return all methods that can be used for a case, the plan last."""
    found = [] if case.scene.body is None else [*own_methods(), *peers()]
    return [*(method for method in found if not why_not(method, case)), planned()]


def why_not(method: Method, case: Case) -> str:
    """Return why a method is not tried on a case; empty if it is."""
    if method.only and case.key not in method.only:
        return "set up for the motions of `rbfmu chart` alone"
    if case.scene.has_formulas and not method.takes_formulas:
        return "takes no formulas"
    if reason := method.why_not(case):
        return reason
    peer = PEERS.get(_program(method.name))
    return f"a turn by {case.turned:.1g} rad takes it too long" if peer and case.turned > peer.most else ""


# Measuring


@dataclass(frozen=True)
class Extent:
    """The limits of a measurement.

    longest: the processor time of a run, s; a method is stopped when its finer settings would take more. Each run is
    timed `repeats` times, each time for about `shortest` s. quick: few settings; only: the names of the methods that
    are measured (none: all), besides `own`, a user's method.
    """

    longest: float = 0.1
    repeats: int = 9
    shortest: float = 1e-3
    quick: bool = False
    only: tuple[str, ...] = ()
    own: one_step.OneStepMethod | None = None


QUICK = Extent(0.02, 2, 2e-4, quick=True, only=tuple(tables_of("chart/kinds.toml")["quick"]))


def extent(quick: bool, method: str | Path | None) -> Extent:
    """Return the limits; method: a file with a user's method. Raises ValueError if something is wrong with that."""
    return replace(QUICK if quick else Extent(), own=None if method is None else one_step.method_of_file(method))


def measure(case: Case, what: Extent, progress: Progress, first_calls: dict[str, float] | None = None) -> Chart:
    """Return the chart of a case. Raises SceneError if there is no plan.

    first_calls: the times in s that methods take to compile, by name; new ones are added.
    """
    name, chosen = case.scene.name, plan(case.asked)
    methods = [m for m in contestants(case) if not what.only or m.name in what.only]
    takes_step = "" if case.scene.body is not None and case.only_turns else _NOT_OWN
    own = [] if what.own is None else [fixed_steps(what.own, YOURS, lambda case: takes_step)]
    methods += [method for method in own if not why_not(method, case)]
    first_calls, total = {} if first_calls is None else first_calls, len(methods) + what.repeats
    found, ends = list[Trial](), list[End]()
    for i, method in enumerate(methods):
        progress(i, total, f"{name}, {case.outputs} outputs: {method.name}")
        trials, end = explore(what, case, method, first_calls)
        found += trials
        ends.append(end)
    order = random.Random(1)  # no method has an advantage by its place
    for repeat in range(what.repeats):
        progress(len(methods) + repeat, total, f"{name}: timing {repeat + 1}")
        again = [t for t in found if t.row.run_seconds < what.longest * (3.0 if repeat < 2 else 0.1)]
        order.shuffle(again)
        for trial in again:
            trial.time(what.shortest)
    progress(total, total, "")
    return Chart(
        name, chosen.model, case.scene.run.accuracy, case.span, case.outputs, tuple(case.scene.inputs.ports),
        tuple(trial.row for trial in found), tuple(ends), tuple(too_small(case, chosen)),
        (*_not_charted(case, ends), *(f"{m.name}: {_NOT_OWN}" for m in own if m not in methods)),
        next((m.refusal for m in methods if m.refusal), ""),
        tuple(line for line in machine() if line not in absent()), key=case.key, many=case.many,
        held=case.scene.inputs.at_start.removeprefix("inputs "),
    )  # fmt: skip


def charts_of(keys: Sequence[str], what: Extent, progress: Progress) -> list[Chart]:
    """Return two charts of each of the eight motions named: with few and with many outputs."""
    cases, first_calls = few_and_many(keys), dict[str, float]()
    share = 1000

    def part(i: int) -> Progress:
        return lambda done, total, text: progress(i * share + done * share // total, len(cases) * share, text)

    return [measure(case, what, part(i), first_calls) for i, case in enumerate(cases)]


@dataclass
class Trial:
    """A row of a chart with its run, which can be timed again; span: the simulated time, s.

    The row has the least time so far. Its spread is the ratio, at least 1, of the least odd and the least even time.
    """

    row: Row
    run: Run
    span: float
    times: list[float] = field(default_factory=list)

    def time(self, shortest: float) -> None:
        """Time the run once more, for about `shortest` s."""
        k = max(1, round(shortest / self.row.run_seconds))
        self.times.append(self.run.seconds(k) / k)
        halves = [min(half) for half in (self.times[::2], self.times[1::2]) if half]
        least = min(halves)
        self.row = replace(self.row, seconds=least / self.span, run_seconds=least, spread=max(halves) / least)


def explore(what: Extent, case: Case, method: Method, first_calls: dict[str, float]) -> tuple[list[Trial], End]:
    """Try settings from coarse to fine, until a run takes too long or errors no longer fall.

    first_calls: times to compile, s, by method; new ones are added. If an error is below round-off, no finer setting
    is tried, unless the case names accuracies.
    """
    found: list[Trial] = []
    least, last, idle, refused, why = math.inf, math.inf, 0, 0, "all settings tried"
    finest = 0.0 if case.accuracies else FLOOR
    for value in method.settings(case, what.quick):
        try:
            trial = _first_run(case, method, value, first_calls)
        except NotFeasibleError as fault:
            why, refused = f"not run at {value:g}: {' '.join(str(fault).split())}"[:200], refused + 1
            if refused == MAX_REFUSED:
                break
            continue
        refused, why, error = 0, "all settings tried", trial.row.error
        if error <= LARGEST_ERROR:
            found.append(trial)
        idle = 0 if error < 0.7 * least else idle + (error != last)
        last = error  # two errors are equal if both settings take one step to each output
        least = min(least, error)
        if 1.5 * trial.row.run_seconds > what.longest:
            why = STOPPED
            break
        if (idle >= MAX_IDLE and least < 1e-2) or error < finest:
            why = "no more digits"
            break
    best = min((trial.row.error for trial in found), default=math.inf)
    return found, End(kind_of(method.name, method.family), method.name, best, why)


def _first_run(case: Case, method: Method, value: float, first_calls: dict[str, float]) -> Trial:
    """Return a run with its error and one time; the first run of a method compiles, which is timed separately."""
    start = thread_time()
    run = method.run(case, value)
    error, drifts = case.error(run.found), case.drifts(run.found)
    if method.name not in first_calls:
        run.seconds(1)
        first_calls[method.name] = max(0.0, thread_time() - start - 2.0 * run.seconds(1))
    seconds = run.seconds(1)
    row = Row(
        kind_of(method.name, method.family), method.name, run.detail, method.family, method.setting, value, error,
        seconds / case.span, seconds, 1.0, run.evaluations, first_calls[method.name], **drifts,
    )  # fmt: skip
    return Trial(row, run, case.span)


def _not_charted(case: Case, ends: Sequence[End]) -> Iterator[str]:
    """Yield a line for each peer that is not in the chart, with the reason."""
    if case.scene.body is None:
        yield "Peers: the scene has no body, and prescribed rates are theirs to supply"
        return
    reasons = {m.name if m.takes_formulas else _program(m.name): why for m in peers() if (why := why_not(m, case))}
    names = {method.name for method in peers()}
    for end in ends:
        if end.method in names and end.never_ran:
            reasons[_program(end.method)] = end.why.split(": ", 1)[1]
    yield from (f"{name}: {why}" for name, why in reasons.items())
    yield from absent()


def _program(method: str) -> str:
    """Return the name of the program that a peer's method belongs to."""
    return method.split()[0]


# Models that are too small


def too_small(case: Case, chosen: Plan) -> list[TooSmall]:
    """Return the models smaller than the plan's that miss the accuracy or cannot be used, the smallest first."""
    if case.scene.body is None or case.scene.has_formulas:
        return []
    before = takewhile(lambda spec: spec.key != chosen.model, registry.MODELS.values())
    smaller = [spec for spec in before if spec.closed_form or spec is registry.ONE_AXIS_TAYLOR]
    found = [TooSmall(spec.key, *_error_of(case, spec)) for spec in smaller]
    return [model for model in found if model.why or not model.error <= case.scene.run.accuracy]


def _error_of(case: Case, spec: registry.ModelSpec) -> tuple[float, str]:
    """Return (error, reason) of a smaller model; reason: why it cannot be used, empty if only its error counts."""
    scene, asked = case.asked, case.question
    hidden = {registry.ANGULAR_MOMENTUM.key: asked.attitude or asked.rotation, registry.SPIN_UP.key: asked.attitude}
    if hidden.get(spec.key) and not spec.accepts(asked):
        return math.inf, "shows no attitude" if asked.attitude else "shows no rates in b"
    order = 0 if spec.closed_form else max(ORDERS)
    chosen = Plan(spec.key, spec.method, 0, tolerance=FLOOR if order else 0.0, order=order, pinned=("mass",))
    steps = [case.interval * n for n in case.outputs_between]
    try:
        motion = motion_of(scene, chosen, steps, case.names)
    except SceneError as refusal:
        return math.inf, str(refusal)
    error = case.error({name: rows[1:] for name, rows in motion.items()})
    varying = spec.rests_on(asked) & asked.varying
    if error <= scene.run.accuracy and varying:
        return error, f"{TAKES_NO} {' or '.join(sorted(varying))}"
    return error, ""


# The machine


def machine() -> list[str]:
    """Return lines about the machine and the packages, for the head of a file."""
    packages = ", ".join(f"{name} {version_of(name)}" for name in ("numpy", "numba", "llvmlite"))
    theirs = ", ".join(f"{name} {peer.installed}" for name, peer in PEERS.items() if peer.installed)
    processors = f"{_processor()}, {os.cpu_count()} processors, {platform.platform()}"
    return [*filter(None, (processors, f"Python {platform.python_version()}, {packages}", theirs)), *absent()]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.machine())
