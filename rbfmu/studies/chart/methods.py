"""The methods that charts compare; a `Run` is one method at one setting on one case, with its states and its time.

Here are one-step methods in equal steps, and those of rbfmu: series, closed forms, DOP853, and its plans.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from time import thread_time
from typing import Any, NamedTuple

import numpy as np

from rbfmu.models import model_buffer, registry
from rbfmu.planning import methods, select
from rbfmu.runs.plan import Plan, start_run
from rbfmu.runs.steps import substeps_counted
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies import dop853, short
from rbfmu.studies.chart.cases import Case
from rbfmu.studies.one_step import Form, OneStepMethod, kept
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS, SPLITTINGS, TORQUE_FREE_INTEGRATORS, midpoint
from rbfmu.types import Array, Indices, Motion
from rbfmu_kernels.compile.decorator import named
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State

MOST_RADIANS = 1e6
"""The angle beyond which a motion has so many turns that peers take too long."""
MOST_STEPS = 1e12
"""The number of steps between two outputs from which on no more are tried. A compiled loop that does nothing takes no
time, so that the time limit would not end the search."""
PLANNING = 30.0
"""The processor time, s, after which no tighter plans are made."""


class NotFeasibleError(Exception):
    """The error of a method that cannot run a case at a setting; the message says why."""


class Run(NamedTuple):
    """A method at one setting on one case.

    found: the judged quantities at the checkpoints; seconds: measures the processor time of k solutions with all
    outputs, s; evaluations: of the right-hand side in one solution (0: none, NaN: not counted); detail: the method that
    a plan chose.
    """

    found: Motion
    seconds: Callable[[int], float]
    evaluations: float
    detail: str = ""


@dataclass
class Method:
    """A method that charts compare.

    setting: the name and unit of what is varied; settings: yields its values from coarse to fine for a case (and
    `quick`: few of them), which are tried until the error no longer falls or a run takes too long; run: makes a run at
    such a value, or raises NotFeasibleError; why_not: returns why the method cannot be used for a case, else nothing;
    takes_formulas: whether it can integrate formulas; only: the keys of the motions that it is set up for (none: any);
    refusal: why no finer setting was tried.
    """

    name: str
    family: str
    setting: str
    settings: Callable[[Case, bool], Iterator[float]]
    run: Callable[[Case, float], Run]
    why_not: Callable[[Case], str] = lambda case: ""
    takes_formulas: bool = False
    only: tuple[str, ...] = ()
    refusal: str = ""


def timer(repeat: Callable[[int], object]) -> Callable[[int], float]:
    """Return a function that measures the processor time of `repeat(k)` in s; waiting does not count.

    The clock is that of the thread: under a limit of processor time (`ulimit -t`, a cluster's queue), Linux advances
    the clock of the process in steps of 4 ms.
    """

    def seconds(k: int) -> float:
        start = thread_time()
        repeat(k)
        return thread_time() - start

    return seconds


def step_counts(case: Case, quick: bool, largest: float = 16.0) -> Iterator[float]:
    """Yield step sizes in s, from `largest` rad per step downwards by factors of 2 (quick: 4).

    Each divides the time between two outputs into a whole number of steps.
    """
    n = max(1.0, case.interval * case.rate / largest)
    while n < MOST_STEPS:
        yield case.interval / round(n)
        n *= 4.0 if quick else 2.0


def tolerances(largest: int, smallest: int, quick: bool) -> Iterator[float]:
    """Return the values from 10^largest down to 10^smallest in half decades (quick: in steps of three decades)."""
    return (10.0 ** (k / 2) for k in range(2 * largest, 2 * smallest - 1, -(6 if quick else 1)))


def module(name: str) -> Any:
    """Return a peer's module. Raises NotFeasibleError if it is installed but cannot be imported."""
    try:
        return import_module(name)
    except ImportError as error:
        raise NotFeasibleError(f"{name} is installed but does not load: {error}") from None


# Fixed steps


def _steps(y: Form, h: float, n: int, body: Body, loads: Loads) -> Form:
    raise NotImplementedError


def _repeat(y: Form, h: float, n: int, outputs: int, body: Body, loads: Loads, k: int) -> Form:
    """Solve k times, with n steps to each output.

    By 0 *, each solution formally depends on the one before, so that the compiler cannot drop any of them.
    """
    z = y
    for _ in range(k):
        step = h + 0.0 * z.omega_b[0]
        z = y
        for _ in range(outputs):
            z = _steps(z, step, n, body, loads)
    return z


def _midpoint_rounds(y: State, h: float, n: int, body: Body, loads: Loads) -> float:
    total = 0.0
    for _ in range(n):
        total += midpoint(y, h, body, loads)[1]
        y = _steps(y, h, 1, body, loads)
    return total


@cache
def _around(template: Callable[..., Any], name: str, compiler: Callable[[Any], Any], **steps: Any) -> Any:
    """Return a template, filled in with the steps of a method or a model, and compiled."""
    return compiler(named(template, f"{template.__name__} {name}", **steps))


def fixed_steps(method: OneStepMethod, family: str, why_not: Callable[[Case], str], largest: float = 16.0) -> Method:
    """Return a one-step method in equal steps, such as those of `rbfmu.studies.reference_methods`.

    largest: the angle per step that is tried first, rad. For very many turns the first one is a quarter of that: the
    equation of Moser and Veselov has no solution for steps of more than 1 rad, and near this limit each of millions of
    steps would take thousands of iterations.
    """

    def settings(case: Case, quick: bool) -> Iterator[float]:
        return step_counts(case, quick, 0.25 * largest if case.turned > MOST_RADIANS else largest)

    return Method(method.name, family, "step (s)", settings, partial(_run_of_steps, method), why_not)


def _run_of_steps(method: OneStepMethod, case: Case, h: float) -> Run:
    body, loads, n, outputs = case.body, case.loads, round(case.interval / h), case.outputs
    start = method.start(case.start)
    path = method.path(case.start, h, [n * some for some in case.outputs_between], body, loads)
    around = partial(_around, name=method.name, compiler=method.compiler, _steps=method.steps)
    if hasattr(method.steps, "py_func"):
        seconds = timer(lambda k: around(_repeat)(start, h, n, outputs, body, loads, k))
    else:  # the loop is not compiled: one long run, in which the calls take a small part of the time
        seconds = timer(lambda k: method.steps(start, h, outputs * n * k, body, loads))
    evaluations = float(method.evaluations * outputs * n)
    if method.name == "implicit midpoint":
        evaluations = around(_midpoint_rounds)(start, h, outputs * n, body, loads)
    states = ((*q, *omega, *r, *v) for r, v, q, omega in map(method.state_of, path))
    return Run(case.at_checkpoints(states), seconds, evaluations)


# The library's models, stepped from output to output


def _step(z: Array, interval: float) -> int:
    raise NotImplementedError


def _steps_repeated(z: Array, start: Array, interval: float, at: Indices, out: Array, k: int) -> int:
    """Make k runs; each starts with the numbers `start`, and stores the buffer's elements `at` in `out` at each output.

    Return 1 after the first step that fails, as each further step could take as long to fail; else 0.
    """
    for _ in range(k):
        for i in range(len(start)):  # for a slice, Numba would compile an error message as well, which takes 2 s
            z[i] = start[i]
        for i in range(len(out)):
            if _step(z, interval):
                return 1
            for j in range(len(at)):
                out[i, j] = z[at[j]]
    return 0


def run_of_unit(case: Case, scene: Scene, chosen: Plan, per_substep: float = math.nan, fixed: float = 0.0) -> Run:
    """Return a run of a plan's model.

    per_substep: evaluations of the right-hand side in a substep; fixed: the number of substeps, if the model does not
    count them.
    """
    kernels, start = chosen.kernels, start_run(scene, chosen)
    scratch = next((kernels.BLOCKS[name].start for name in ("work", "series.work") if name in kernels.BLOCKS), None)
    z, start = model_buffer.aligned_zeros(len(start)), start[:scratch]
    at = model_buffer.places_of(kernels.BLOCKS, case.quantities)
    out = np.zeros((case.outputs, len(at)))
    runs = _around(_steps_repeated, kernels.name, kept, _step=kernels.step)
    solve = partial(runs, z, start, case.interval, at, out)
    if solve(1):
        out[:] = math.nan
    found = model_buffer.by_block(kernels.BLOCKS, case.quantities, out[case.checkpoints])
    return Run(found, timer(solve), per_substep * (fixed or substeps_counted(kernels, z)), chosen.method)


def substeps(order: int, controlled: bool = True) -> Method:
    """Return the method of series with error control, or DOP853 with error control or in equal steps.

    order: the order of the Taylor series, 0 for DOP853; controlled: whether there is error control.
    """
    name = f"Taylor, order {order}" if order else f"DOP853, {'error control' if controlled else 'fixed steps'}"

    def settings(case: Case, quick: bool) -> Iterator[float]:
        largest = -3 if case.scene.has_formulas else 0  # a looser tolerance may diverge, in many substeps
        return tolerances(largest, -16 if order else -15, quick) if controlled else step_counts(case, quick)

    def run(case: Case, value: float) -> Run:
        substep, tolerance = (math.inf, value) if controlled else (value, 0.0)
        chosen: Plan = dop853.Dop853Plan("body under loads", name, 13, substep, tolerance)
        if order:
            chosen = replace(methods.whole_series(case.asked, order, value), method=name)
        fixed = 0.0 if controlled else float(case.outputs * round(case.interval / value))
        return run_of_unit(case, case.asking(1.0), chosen, order or 12.0, fixed)

    family, setting = "Taylor" if order else "DOP853", "tolerance" if controlled else "step (s)"
    return Method(name, family, setting, settings, run, takes_formulas=order > 0)


def closed_form(spec: registry.ModelSpec) -> Method:
    """Return the method of a closed form; it is used for scenes for which it is exact, whatever their ports supply."""
    return Method(
        spec.key, "exact", "outputs",
        lambda case, quick: iter([float(case.outputs)]),
        lambda case, value: run_of_unit(case, case.asked, Plan(spec.key, spec.method, 0)),
        lambda case: "" if spec.serves(case.question) else "it is not exact",
    )  # fmt: skip


def planned() -> Method:
    """Return the method that runs the plans of `rbfmu.plan`; its runs compute all outputs of the case.

    Plans are made for the accuracies that the case names. If it names none, they are made for that of its scene and for
    each further digit, until one is refused or planning takes too long.
    """

    def settings(case: Case, quick: bool) -> Iterator[float]:
        if case.accuracies:
            yield from case.accuracies[: 2 if quick else None]
            return
        begin, accuracy = thread_time(), case.scene.run.accuracy
        while not method.refusal:
            yield accuracy
            accuracy = float(f"{0.1 * accuracy:.12g}")
            if thread_time() > begin + (0.0 if quick else PLANNING):
                method.refusal = f"{short(accuracy)}: not tried{'' if quick else ', as planning takes long'}"

    def run(case: Case, value: float) -> Run:
        scene = case.asking(value)
        try:
            chosen = select.plan(scene)
        except SceneError as error:
            method.refusal = f"{short(value)}: {error}"
            raise NotFeasibleError(str(error)) from None
        return run_of_unit(case, scene, chosen)

    method = Method("rbfmu, as planned", "planned", "accuracy asked", settings, run)
    return method


@cache
def own_methods() -> tuple[Method, ...]:
    """Return the library's methods except plans, and one-step methods in common use with the same right-hand sides."""
    return (
        *map(closed_form, registry.CLOSED_FORMS), substeps(0), substeps(0, controlled=False),
        *map(substeps, (6, 8, 12, 16, 20, 24)),
        *(fixed_steps(m, "splitting", lambda case: "" if case.top else "no top") for m in SPLITTINGS.values()),
        *(fixed_steps(m, "classic", lambda case: "") for m in REFERENCE_INTEGRATORS.values()),
        *(fixed_steps(m, "Moser-Veselov", lambda case: "" if case.turns_freely else "under torques", 1.0)
          for m in TORQUE_FREE_INTEGRATORS.values()),
    )  # fmt: skip
