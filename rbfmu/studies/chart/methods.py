"""The methods that compete: one of them at one setting on one case is a `Run` with its states and its time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from time import thread_time
from typing import Any

from numba import njit

from rbfmu.studies.chart.cases import MOST_RADIANS, Case
from rbfmu.studies.reference_methods import OneStepMethod, midpoint
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State


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


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _repeated(loop: Any, y: Any, h: float, n: int, outputs: int, body: Body, loads: Loads, k: int) -> Any:
    """Solve k times; h depends formally (by 0 *) on the last solution, so that the compiler removes no solution."""
    z = y
    for _ in range(k):
        step = h + 0.0 * z.omega_b[0]
        z = y
        for _ in range(outputs):
            z = loop(z, step, n, body, loads)
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
            seconds = timer(lambda k: _repeated(method.steps, start, value, n, outputs, body, loads, k))
        else:  # the loop is not compiled: one long run, of which the calls are a small part
            seconds = timer(lambda k: method.steps(start, value, outputs * n * k, body, loads))
        evaluations = float(method.evaluations * outputs * n)
        if method.name == "implicit midpoint":
            evaluations = _midpoint_rounds(method.steps, start, value, outputs * n, body, loads)
        return Run(states, seconds, evaluations)
