"""What competes on a case: plans, this library's methods, one-step methods of others, peers; and models too small.

Which peers are installed, how to install the others, and why a method is not tried.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import takewhile
from operator import attrgetter

from rbfmu.extras import remedy
from rbfmu.models.question import Question
from rbfmu.models.registry import ANGULAR_MOMENTUM, CLOSED_FORMS, MODELS, ONE_AXIS_TAYLOR, SPIN_UP, ModelSpec
from rbfmu.runs.motion import Steps, record
from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import SceneError
from rbfmu.studies.chart.cases import FLOOR, MOST_RADIANS, ROTATION, Case, FormulaCase
from rbfmu.studies.chart.methods import ClosedForm, FixedSteps, Method, Planned, Substeps
from rbfmu.studies.chart.result import TAKES_NO, TooSmall
from rbfmu.studies.chart.simulators import Basilisk, Drake, MuJoCo
from rbfmu.studies.chart.solvers import Heyoka, Numbalsoda, Odeint, SolveIvp
from rbfmu.studies.reference_methods import REFERENCE_INTEGRATORS, SPLITTINGS, TORQUE_FREE_INTEGRATORS
from rbfmu_kernels.models.one_axis import ORDERS

MANY_RADIANS = 1e4
"""The angle that a body may turn by for programs that are called from Python at each step."""


# Peers


MUJOCO_INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")


def _package(name: str) -> str | None:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None


_PEERS: dict[str, tuple[str, str, Callable[[], Sequence[Method]]]] = {
    "SciPy": ("scipy", "bench", lambda: [
        *map(SolveIvp, ("DOP853", "RK45", "LSODA")), SolveIvp("LSODA", compiled=False), Odeint(),
    ]),
    "numbalsoda": ("numbalsoda", "bench-fortran", lambda: [Numbalsoda(m) for m in ("lsoda", "dop853")]),
    "heyoka.py": ("heyoka", "bench", lambda: [Heyoka()]),
    "MuJoCo": ("mujoco", "bench", lambda: [MuJoCo(m) for m in MUJOCO_INTEGRATORS]),
    "Basilisk": ("bsk", "bench-simulators", lambda: [Basilisk(m) for m in ("RK4", "RKF78")]),
    "Drake": ("drake", "bench-simulators", lambda: [Drake("runge_kutta3", "RK3"), Drake("runge_kutta5", "RK5")]),
}  # fmt: skip
"""For each peer: its package, the extra of this library that installs it, and its methods."""
ABSENT = "not installed"


@cache
def peers() -> tuple[tuple[Method, ...], dict[str, str]]:
    """Return the methods of the installed peers, and the version of each peer (`ABSENT` if it is not installed)."""
    found: list[Method] = []
    versions = {}
    for name, (package, _, methods) in _PEERS.items():
        installed = _package(package)
        versions[name] = installed or ABSENT
        found += methods() if installed else []
    return tuple(found), versions


def absent() -> list[str]:
    """Return a line for each peer that is not installed."""
    names = [name for name, found in peers()[1].items() if found == ABSENT]
    return [f"{name}: {ABSENT} ({remedy(_PEERS[name][1])})" for name in names]


# Who competes


@cache
def own_methods() -> tuple[Method, ...]:
    """Return the library's methods but the plan, and one-step methods in common use with the same right-hand sides."""
    free, top = attrgetter("turns_freely"), attrgetter("top")
    return (
        *map(ClosedForm, CLOSED_FORMS), Substeps(0), Substeps(0, False),
        *(Substeps(order) for order in (6, 8, 12, 16, 20, 24)),
        *(FixedSteps(method, "splitting", top) for method in SPLITTINGS.values()),
        *(FixedSteps(method, "classic") for method in REFERENCE_INTEGRATORS.values()),
        *(FixedSteps(method, "Moser-Veselov", free, 1.0) for method in TORQUE_FREE_INTEGRATORS.values()),
    )  # fmt: skip


def contestants(case: Case, peers: Sequence[Method]) -> list[Method]:
    """Return all methods that suit a case, the plan last."""
    if case.scene.body is None:
        return [Planned()]
    found = (*own_methods(), *peers)
    return [*(method for method in found if not why_not(method, case) and method.suits(case)), Planned()]


def why_not(method: Method, case: Case) -> str:
    """Return why a method that may suit the case is not tried on it, else nothing."""
    if isinstance(case, FormulaCase) and not method.takes_formulas:
        return "takes no formulas"
    if method.family != "peer":
        return ""
    if isinstance(case, FormulaCase) and not case.numbers:
        return "nothing is to be integrated"
    if isinstance(method, SolveIvp) and not method.compiled:
        if isinstance(case, FormulaCase):
            return "formulas are compiled"
        if case.numbers < ROTATION:
            return "written for attitude and rates"
    if isinstance(method, Heyoka) and isinstance(case, FormulaCase) and case.has_corners:
        return "formulas have corners or tables, over which its series would go on"
    most = MANY_RADIANS if method.name.startswith(("SciPy", "MuJoCo")) else MOST_RADIANS
    turned = case.rate * case.span
    return f"a turn by {turned:.1g} rad takes it too long" if turned > most else ""


# Models that are too small


def too_small(case: Case, planned: Plan) -> list[TooSmall]:
    """Return the models that stand before the plan's and miss the accuracy, from the smallest."""
    if case.scene.body is None or isinstance(case, FormulaCase):
        return []
    before = takewhile(lambda spec: spec.key != planned.model, MODELS.values())
    smaller = [spec for spec in before if spec.closed_form or spec is ONE_AXIS_TAYLOR]
    found = [TooSmall(spec.key, *_error_of(case, spec)) for spec in smaller]
    return [model for model in found if model.why or not model.error <= case.scene.run.accuracy]


def _error_of(case: Case, spec: ModelSpec) -> tuple[float, str]:
    """Return the error of a model that leaves something out, or why it has none."""
    scene, asked = case.asked, Question(case.asked)
    hidden = {ANGULAR_MOMENTUM.key: asked.attitude or asked.rotation, SPIN_UP.key: asked.attitude}
    if hidden.get(spec.key) and not spec.accepts(asked):
        return math.inf, "shows no attitude" if asked.attitude else "shows no rates in b"
    order = 0 if spec.closed_form else max(ORDERS)
    chosen = Plan(spec.key, spec.method, 0, tolerance=FLOOR if order else 0.0, order=order, pinned=("mass",))
    steps = [case.interval * n for n in case.outputs_between]
    try:
        motion = record(Steps(scene, chosen, steps, case.names), case.names)
    except SceneError as refusal:
        return math.inf, str(refusal)
    error = case.error({name: rows[1:] for name, rows in motion.items()})
    varying = spec.rests_on(asked) & asked.varying
    if error <= scene.run.accuracy and varying:
        return error, f"{TAKES_NO} {' or '.join(sorted(varying))}"
    return error, ""
