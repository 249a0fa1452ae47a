"""The methods that compete: one of them at one setting on one case is a `Run` with its states and its time.

One-step methods in equal steps, and what rbfmu offers: series, closed forms, DOP853, and its plans.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.models.question import Question
from rbfmu.models.registry import ModelSpec
from rbfmu.planning.methods import whole_series
from rbfmu.planning.select import plan
from rbfmu.runs.motion import substeps_counted
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies.chart.cases import MOST_RADIANS, Case, FormulaCase
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu.studies.one_step import OneStepMethod
from rbfmu.studies.reference_methods import midpoint
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State

PLANNING = 30.0
"""The processor time, s, after which no tighter plans are made."""


class NotFeasibleError(Exception):
    """The error of a method that cannot do a case at a setting; the message says why."""


@dataclass(frozen=True)
class Run:
    """A method at a setting: its states at the checkpoints, and the time of k solutions with all outputs.

    states: what the case's `error` takes; seconds: of the processor; evaluations: those of the right-hand side in one
    solution (0: none, NaN: not counted); detail: the method that a plan chose.
    """

    states: Callable[[], Any]
    seconds: Callable[[int], float]
    evaluations: float
    detail: str = ""


class Method:
    """A method that competes; those of a family share a colour, `setting` is the name and unit of what is varied."""

    name = ""
    family = "peer"
    setting = "step (s)"
    takes_formulas = False

    def suits(self, case: Case) -> bool:
        """Return whether the method applies to the case."""
        return True

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return values from coarse to fine, to try until the error no longer falls or a run takes too long."""
        return step_counts(case, quick)

    def run(self, case: Case, value: float) -> Run:
        """Return a run at a setting; raise NotFeasibleError."""
        raise NotImplementedError


def timer(repeat: Callable[[int], Any]) -> Callable[[int], float]:
    """Return a function that measures the processor time of `repeat(k)` in s; waiting does not count.

    The clock is the thread's: under a limit of processor time (`ulimit -t`, a cluster's queue) Linux moves that of the
    process in steps of 4 ms.
    """

    def seconds(k: int) -> float:
        start = thread_time()
        repeat(k)
        return thread_time() - start

    return seconds


def step_counts(case: Case, quick: bool, largest: float = 16.0) -> Iterator[float]:
    """Yield step sizes, from `largest` rad per step downwards by factors of 2 (quick: 4)."""
    n, last = max(1.0, case.interval * case.rate / largest), 0
    while True:
        if round(n) > last:
            last = round(n)
            yield case.interval / last
        n *= 4.0 if quick else 2.0


def tolerances(largest: int, smallest: int, quick: bool) -> Iterator[float]:
    """Yield powers of ten from large to small in half decades (quick: every three decades)."""
    for k in range(2 * largest, 2 * smallest - 1, -(6 if quick else 1)):
        yield 10.0 ** (k / 2)


def module(name: str) -> Any:
    """Return a peer's module."""
    try:
        return import_module(name)
    except ImportError as error:
        raise NotFeasibleError(f"{name} is installed but does not load: {error}") from None


# Fixed steps


class EqualSteps(NamedTuple):
    """Steps of a size h in s, n of them to each output."""

    h: float
    n: int
    outputs: int


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _repeated(loop: Any, y: Any, steps: EqualSteps, body: Body, loads: Loads, k: int) -> Any:
    """Solve k times; h depends formally (by 0 *) on the last solution, so that the compiler removes no solution."""
    z = y
    for _ in range(k):
        step = steps.h + 0.0 * z.omega_b[0]
        z = y
        for _ in range(steps.outputs):
            z = loop(z, step, steps.n, body, loads)
    return z


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _midpoint_rounds(loop: Any, y: Any, h: float, n: int, body: Body, loads: Loads) -> float:
    total = 0.0
    for _ in range(n):
        total += midpoint(y, h, body, loads)[1]
        y = loop(y, h, 1, body, loads)
    return total


class FixedSteps(Method):
    """A one-step method in equal steps, such as those of `rbfmu.studies.reference_methods`.

    applies: whether it suits a case; largest: the step that is tried first, rad.
    """

    def __init__(
        self, method: OneStepMethod, family: str, applies: Callable[[Case], bool] = lambda case: True,
        largest: float = 16.0,
    ) -> None:  # fmt: skip
        self.method, self.name, self.family = method, method.name, family
        self.applies, self.largest = applies, largest

    def suits(self, case: Case) -> bool:
        """Return whether the method applies."""
        return self.applies(case)

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return step sizes, which begin finer in a run of very many turns.

        The equation of Moser and Veselov has no solution for steps of more than 1 rad; near there each of millions of
        steps would take thousands of rounds.
        """
        many = case.rate * case.span > MOST_RADIANS
        return step_counts(case, quick, 0.25 * self.largest if many else self.largest)

    def run(self, case: Case, value: float) -> Run:
        """Return a run with steps of `value`."""
        method, body, loads = self.method, case.body, case.loads
        n, outputs = round(case.interval / value), case.outputs
        start = method.start(case.start)

        def states() -> list[State]:
            counts = [n * some for some in case.outputs_between]
            return [method.state_of(y) for y in method.path(case.start, value, counts, body, loads)]

        if hasattr(method.steps, "py_func"):
            seconds = timer(lambda k: _repeated(method.steps, start, EqualSteps(value, n, outputs), body, loads, k))
        else:  # the loop is not compiled: one long run, of which the calls are a small part
            seconds = timer(lambda k: method.steps(start, value, outputs * n * k, body, loads))
        evaluations = float(method.evaluations * outputs * n)
        if method.name == "implicit midpoint":
            evaluations = _midpoint_rounds(method.steps, start, value, outputs * n, body, loads)
        return Run(states, seconds, evaluations)


# The product's models, stepped from output to output


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _steps_repeated(step: Any, z: Any, start: Any, interval: float, at: Any, out: Any, k: int) -> int:
    """Make k runs, and store the buffer's elements `at` in `out` at every output; start: what a run begins with.

    Return 1 where a fault ends them: each further step could take as long to fail.
    """
    for _ in range(k):
        z[: len(start)] = start
        for i in range(len(out)):
            if step(z, interval):
                return 1
            for j in range(len(at)):
                out[i, j] = z[at[j]]
    return 0


def run_of_unit(case: Case, scene: Scene, chosen: Plan, per_substep: float = math.nan, fixed: float = 0.0) -> Run:
    """Return a run of a plan's model; per_substep: right-hand sides; fixed: substeps if it counts none."""
    kernels, start = chosen.kernels, start_run(scene, chosen)
    scratch = next((kernels.BLOCKS[name].start for name in ("work", "series.work") if name in kernels.BLOCKS), None)
    z, start = aligned_zeros(len(start)), start[:scratch]
    at = np.concatenate([np.arange(len(z))[kernels.BLOCKS[name]] for name in case.quantities])
    out = np.zeros((case.outputs, len(at)))
    if _steps_repeated(kernels.step, z, start, case.interval, at, out, 1):
        out[:] = math.nan
    sizes = [kernels.BLOCKS[name].stop - kernels.BLOCKS[name].start for name in case.quantities]
    parts = np.split(out[case.checkpoints], np.cumsum(sizes)[:-1], axis=1)
    found = dict(zip(case.quantities, parts, strict=True))
    evaluations = per_substep * (fixed or substeps_counted(kernels, z))
    seconds = timer(lambda k: _steps_repeated(kernels.step, z, start, case.interval, at, out, k))
    return Run(lambda: found, seconds, evaluations, chosen.method)


class Substeps(Method):
    """The series of a body under loads, with error control, or DOP853, with it or in equal steps.

    order: the order of the Taylor series, 0 for DOP853.
    """

    def __init__(self, order: int, controlled: bool = True) -> None:
        self.order, self.controlled, self.takes_formulas = order, controlled, order > 0
        steps = "error control" if controlled else "fixed steps"
        self.name = f"Taylor, order {order}" if order else f"DOP853, {steps}"
        self.family = "Taylor" if order else "DOP853"
        self.setting = "tolerance" if controlled else "step (s)"

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return tolerances or step sizes."""
        largest = -3 if isinstance(case, FormulaCase) else 0  # what is rougher may run away, in many substeps
        return tolerances(largest, -16 if self.order else -15, quick) if self.controlled else step_counts(case, quick)

    def run(self, case: Case, value: float) -> Run:
        """Return a run with a tolerance or step of `value`."""
        substep, tolerance = (math.inf, value) if self.controlled else (value, 0.0)
        chosen: Plan = Dop853Plan("body under loads", self.name, 13, substep, tolerance)
        if self.order:
            chosen = replace(whole_series(case.asked, self.order, value), method=self.name)
        fixed = 0.0 if self.controlled else float(case.outputs * round(case.interval / value))
        return run_of_unit(case, case.asking(1.0), chosen, self.order or 12.0, fixed)


class ClosedForm(Method):
    """A model with a closed form that is exact for the scene, whatever its ports supply."""

    family, setting = "exact", "outputs"

    def __init__(self, spec: ModelSpec) -> None:
        self.spec, self.name = spec, spec.key

    def suits(self, case: Case) -> bool:
        """Return whether the model is exact."""
        return self.spec.serves(Question(case.asked))

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return one setting: as many outputs as asked for."""
        yield float(case.outputs)

    def run(self, case: Case, value: float) -> Run:
        """Return a run of all outputs."""
        return run_of_unit(case, case.asked, Plan(self.spec.key, self.spec.method, 0))


class Planned(Method):
    """The plans that `rbfmu.plan` makes, with all of a model's outputs: for the accuracy asked, and each further digit.

    refusal: why no tighter plans are made.
    """

    name, family, setting = "rbfmu, as planned", "planned", "accuracy asked"

    def __init__(self) -> None:
        self.refusal = ""

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Yield the case's accuracies; if it names none, further digits until one is refused or takes too long."""
        if case.accuracies:
            yield from case.accuracies[: 2 if quick else None]
            return
        begin, accuracy = thread_time(), case.scene.run.accuracy
        while not self.refusal:
            yield accuracy
            accuracy = float(f"{0.1 * accuracy:.12g}")
            if thread_time() > begin + (0.0 if quick else PLANNING):
                self.refusal = f"{short(accuracy)}: not tried{'' if quick else ', as planning takes long'}"

    def run(self, case: Case, value: float) -> Run:
        """Return a run as planned for the accuracy."""
        scene = case.asking(value)
        try:
            chosen = plan(scene)
        except SceneError as error:
            self.refusal = f"{short(value)}: {error}"
            raise NotFeasibleError(str(error)) from None
        return run_of_unit(case, scene, chosen)


def short(number: float) -> str:
    """Return a number in its shortest form, such as 1e-9."""
    return f"{number:.0e}".replace("e-0", "e-")
