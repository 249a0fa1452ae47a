"""What competes on a scene of one's own besides the methods of `work_precision`: plans, and models that are exact."""

from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time

import numpy as np

from rbfmu.models.question import Question
from rbfmu.models.registry import ANGULAR_MOMENTUM, CLOSED_FORMS, MODELS, ONE_AXIS_TAYLOR, SPIN_UP
from rbfmu.models.spec import ModelSpec
from rbfmu.runs.motion import Steps, record
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import SceneError
from rbfmu.studies.own_chart.case import FLOOR, OwnCase
from rbfmu.studies.work_precision.cases import ROTATION, Case
from rbfmu.studies.work_precision.library_methods import ClosedForm as PlannedClosedForm
from rbfmu.studies.work_precision.library_methods import Exact, Planned, library_methods, run_of_unit
from rbfmu.studies.work_precision.methods import Method, NotFeasibleError, Run, reference_integrators
from rbfmu.studies.work_precision.solvers import SolveIvp
from rbfmu.studies.work_precision.tables import short
from rbfmu_kernels.models.one_axis import ORDERS

TAKES_NO = "takes no"
"""How the reason begins why a model does not serve a scene with ports, or with parameters to be changed."""
PLANNING = 30.0
"""The processor time, s, after which no tighter plans are made."""


class Ladder(Planned):
    """The plans for the accuracy asked, and for each further digit."""

    def __init__(self) -> None:
        self.refusal = ""

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Yield accuracies until one is refused, or planning takes too long."""
        begin, accuracy = process_time(), case.scene.run.accuracy
        while not self.refusal:
            yield accuracy
            accuracy = float(f"{0.1 * accuracy:.12g}")
            if process_time() > begin + (0.0 if quick else PLANNING):
                self.refusal = f"{short(accuracy)}: not tried{'' if quick else ', as planning takes long'}"

    def run(self, case: Case, value: float) -> Run:
        """Return a run as planned for the accuracy."""
        try:
            return super().run(case, value)
        except NotFeasibleError as error:
            self.refusal = f"{short(value)}: {error}"
            raise


@dataclass(frozen=True)
class ClosedForm:
    """A model with a closed form that is exact for the scene, whatever its ports supply."""

    spec: ModelSpec
    family, setting = "exact", "outputs"

    @property
    def name(self) -> str:
        """Return the model's name."""
        return self.spec.key

    def suits(self, case: Case) -> bool:
        """Return whether the model is exact."""
        return case.scene.body is not None and self.spec.serves(Question(case.scene))

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return one setting: as many outputs as asked for."""
        yield float(case.outputs)

    def run(self, case: Case, value: float) -> Run:
        """Return a run of all outputs."""
        return run_of_unit(case, case.asking(case.scene.run.accuracy), Plan(self.spec.key, self.spec.method, 0))


def own_methods(case: OwnCase, peers: tuple[Method, ...]) -> list[Method]:
    """Return all methods that suit a scene of one's own, the plan last."""
    if case.scene.body is None:
        return [Ladder()]
    inside = [m for m in library_methods() if not isinstance(m, Exact | Planned | PlannedClosedForm)]
    found: list[Method] = [*map(ClosedForm, CLOSED_FORMS), *inside, *reference_integrators(), *peers, Ladder()]
    return [method for method in found if method.suits(case) and not why_not(method, case)]


def why_not(method: Method, case: OwnCase) -> str:
    """Return why a method that may suit the case is not tried on it, else nothing."""
    if isinstance(method, SolveIvp) and not method.compiled and case.numbers < ROTATION:
        return "written for attitude and rates"
    turned = case.rate * case.span
    if turned > MANY_RADIANS and method.name.startswith(("SciPy", "MuJoCo")):
        return f"a turn by {turned:.1g} rad takes it too long"
    return ""


MANY_RADIANS = 1e4
"""The angle that a body may turn by for programs that are called from Python at each step."""


# Models that are too small


@dataclass(frozen=True)
class TooSmall:
    """A model that is smaller than the plan's, and its error as the scene's accuracy counts it.

    why: why it has none, if so.
    """

    model: str
    error: float
    why: str = ""


def too_small(case: OwnCase, planned: Plan) -> list[TooSmall]:
    """Return the models that stand before the plan's and miss the accuracy, from the smallest."""
    if case.scene.body is None:
        return []
    found = []
    for spec in _before(planned):
        error, why = _error_of(case, spec)
        if why or not error <= case.scene.run.accuracy:
            found.append(TooSmall(spec.key, error, why))
    return found


def _before(planned: Plan) -> Iterator[ModelSpec]:
    for key, spec in MODELS.items():
        if key == planned.model:
            return
        if spec.closed_form or spec is ONE_AXIS_TAYLOR:
            yield spec


def _error_of(case: OwnCase, spec: ModelSpec) -> tuple[float, str]:
    """Return the error of a model that leaves something out, or why it has none."""
    scene, asked = case.scene, Question(case.scene)
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
    error = case.errors({name: rows[1:] for name, rows in motion.items()})["scene"]
    varying = spec.rests_on(asked) & asked.varying
    if error <= scene.run.accuracy and varying:
        return error, f"{TAKES_NO} {' or '.join(sorted(varying))}"
    return error, ""
