"""What competes on a case: plans, this library's methods, one-step methods of others, peers; and models too small."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from time import thread_time
from typing import Any

import numpy as np
from numba import njit

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.models.question import Question
from rbfmu.models.registry import ANGULAR_MOMENTUM, CLOSED_FORMS, MODELS, ONE_AXIS_TAYLOR, SPIN_UP
from rbfmu.models.spec import ModelSpec
from rbfmu.planning.methods import whole_series
from rbfmu.planning.select import plan
from rbfmu.runs.motion import Steps, record, substeps_counted
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies.chart.cases import FLOOR, MOST_RADIANS, RATES, ROTATION, Case
from rbfmu.studies.chart.formulas import FormulaCase
from rbfmu.studies.chart.methods import FixedSteps, Method, NotFeasibleError, Run, step_counts, timer, tolerances
from rbfmu.studies.chart.solvers import Heyoka, SolveIvp, Solver
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS, SPLITTINGS, TORQUE_FREE_INTEGRATORS
from rbfmu_kernels.models.one_axis import ORDERS

TAKES_NO = "takes no"
"""How the reason begins why a model does not serve a scene with ports, or with parameters to be changed."""
PLANNING = 30.0
"""The processor time, s, after which no tighter plans are made."""
MANY_RADIANS = 1e4
"""The angle that a body may turn by for programs that are called from Python at each step."""


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
    found = case.states_of(out)
    evaluations = per_substep * (fixed or substeps_counted(kernels, z))
    seconds = timer(lambda k: _steps_repeated(kernels.step, z, start, case.interval, at, out, k))
    return Run(lambda: found, seconds, evaluations, chosen.method)


class Substeps(Method):
    """The series of a body under loads, with error control, or DOP853, with it or in equal steps.

    order: the order of the Taylor series, 0 for DOP853.
    """

    def __init__(self, order: int, controlled: bool = True) -> None:
        self.order, self.controlled = order, controlled
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


# Who competes


@cache
def _series() -> tuple[Method, ...]:
    return tuple(Substeps(order) for order in (6, 8, 12, 16, 20, 24))


@cache
def library_methods() -> tuple[Method, ...]:
    """Return the library's methods but the plan."""
    split = [FixedSteps(method, "splitting", _is_top) for method in SPLITTINGS.values()]
    return *map(ClosedForm, CLOSED_FORMS), Substeps(0), Substeps(0, False), *_series(), *split


def _is_top(case: Case) -> bool:
    return case.top


@cache
def reference_integrators() -> tuple[Method, ...]:
    """Return one-step methods in common use, with the same right-hand sides."""
    any_torque = [FixedSteps(method, "classic") for method in REFERENCE_INTEGRATORS.values()]
    free = [FixedSteps(method, "Moser-Veselov", _turns_freely, 1.0) for method in TORQUE_FREE_INTEGRATORS.values()]
    return (*any_torque, *free)


def _turns_freely(case: Case) -> bool:
    """Return whether attitude and rates of a torque-free body in principal axes are all that is asked for."""
    mixed = [x for i, row in enumerate(case.body.inertia) for j, x in enumerate(row) if i != j]
    return case.torque_free and case.numbers in (RATES, ROTATION) and not any(mixed) and all(case.moments)


def contestants(case: Case, peers: Sequence[Method]) -> list[Method]:
    """Return all methods that suit a case, the plan last."""
    if case.scene.body is None:
        return [Planned()]
    own = _series() if isinstance(case, FormulaCase) else (*library_methods(), *reference_integrators())
    found = (*own, *peers)
    return [*(method for method in found if method.suits(case) and not why_not(method, case)), Planned()]


def why_not(method: Method, case: Case) -> str:
    """Return why a method that may suit the case is not tried on it, else nothing."""
    if isinstance(case, FormulaCase) and method.family == "peer" and (why := _why_no_formulas(method, case)):
        return why
    if isinstance(method, SolveIvp) and not method.compiled and case.numbers < ROTATION:
        return "written for attitude and rates"
    turned, interpreted = case.rate * case.span, method.name.startswith(("SciPy", "MuJoCo"))
    if method.family == "peer" and turned > (MANY_RADIANS if interpreted else MOST_RADIANS):
        return f"a turn by {turned:.1g} rad takes it too long"
    return ""


def _why_no_formulas(method: Method, case: FormulaCase) -> str:
    if not isinstance(method, Solver):
        return "takes no formulas"
    if not case.numbers:
        return "nothing is to be integrated"
    if isinstance(method, SolveIvp) and not method.compiled:
        return "formulas are compiled"
    if isinstance(method, Heyoka) and case.has_corners:
        return "formulas have corners or tables, over which its series would go on"
    return ""


# Models that are too small


@dataclass(frozen=True)
class TooSmall:
    """A model that is smaller than the plan's, and its error as the scene's accuracy counts it.

    why: why it has none, if so.
    """

    model: str
    error: float
    why: str = ""


def too_small(case: Case, planned: Plan) -> list[TooSmall]:
    """Return the models that stand before the plan's and miss the accuracy, from the smallest."""
    if case.scene.body is None or isinstance(case, FormulaCase):
        return []
    found = [TooSmall(spec.key, *_error_of(case, spec)) for spec in _before(planned)]
    return [model for model in found if model.why or not model.error <= case.scene.run.accuracy]


def _before(planned: Plan) -> Iterator[ModelSpec]:
    for key, spec in MODELS.items():
        if key == planned.model:
            return
        if spec.closed_form or spec is ONE_AXIS_TAYLOR:
            yield spec


def _error_of(case: Case, spec: ModelSpec) -> tuple[float, str]:
    """Return the error of a model that leaves something out, or why it has none."""
    scene, asked = case.asked, Question(case.asked)
    hidden = {ANGULAR_MOMENTUM.key: asked.attitude or asked.rotation, SPIN_UP.key: asked.attitude}
    if hidden.get(spec.key) and not spec.accepts(asked):
        return np.inf, "shows no attitude" if asked.attitude else "shows no rates in b"
    order = 0 if spec.closed_form else max(ORDERS)
    chosen = Plan(spec.key, spec.method, 0, tolerance=FLOOR if order else 0.0, order=order, pinned=("mass",))
    steps = [case.interval * n for n in case.outputs_between]
    try:
        motion = record(Steps(scene, chosen, steps, case.names), case.names)
    except SceneError as refusal:
        return np.inf, str(refusal)
    error = case.error({name: rows[1:] for name, rows in motion.items()})
    varying = spec.rests_on(asked) & asked.varying
    if error <= scene.run.accuracy and varying:
        return error, f"{TAKES_NO} {' or '.join(sorted(varying))}"
    return error, ""
