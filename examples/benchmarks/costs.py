"""What communication steps cost beside what plans state, by model and by what is asked, all in one run, in turn.

`python -m examples.benchmarks.costs` prints the figures, and `rbfmu.planning.methods.NS` as this run has it, at the
speed that this module has for a substep of series, so that a machine that is busy or slower counts alike in all.
Exits with status 1 where what is stated and what is measured are more than 1.5 times apart. Last comes what a
scene would cost without its model, by the plan that there is then: the status is 1 as well where a model saves less
than 5 %.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numba import njit

import rbfmu
from examples.benchmarks.substeps import series, timed
from examples.benchmarks.support.goals import Goal, status
from rbfmu.extras import needed_of
from rbfmu.models import registry
from rbfmu.models.question import Question
from rbfmu.models.registry import ModelSpec
from rbfmu.planning.methods import NS, SPLITTING_COSTS, series_cost, terms, with_cost
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import QUANTITIES, Scene

with needed_of("bench"):
    from scipy.optimize import nnls

WITHIN, STEPS = 1.5, 100
FREE, ROUND = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}, {"mass": 2.0, "inertia": [1.0, 1.0, 0.5]}
BALL, HUNG = {"mass": 2.0, "inertia": [1.0, 1.0, 1.0]}, {"r_oc_b": [0.0, 0.0, -0.5], "pivot": True}
TUMBLING, SPINNING = {"omega_b": [0.3, 2.0, 0.1]}, {"omega_b": [0.0, 0.0, 2.0]}
SWINGING, AT_REST = {"omega_b": [1.0, 0.0, 0.0]}, {"velocity": [1.0, 0.0, 0.0]}
BODIES: dict[str, tuple[Any, Any, Any]] = {
    "standing": (FREE, AT_REST, {}),
    "spinning": (FREE, SPINNING, {}),
    "ball under torque_a": (BALL, TUMBLING, {"torque_a": [0.1, 0.2, 0.3]}),
    "spun up about its axis": (FREE, SPINNING, {"torque_b": [0.0, 0.0, 0.1], "damping_b": [0.0, 0.0, 0.1]}),
    "pendulum": (FREE | HUNG, SWINGING, {}),
    "damped pendulum": (FREE | HUNG, SWINGING, {"damping_b": [0.2, 0.0, 0.0]}),
    "symmetric, free": (ROUND, TUMBLING, {}),
    "symmetric, spun up": (ROUND, TUMBLING, {"torque_b": [0.0, 0.0, 0.1]}),
    "free": (FREE, TUMBLING, {}),
    "body force": (FREE, TUMBLING, {"force_b": [0.1, 0.2, 0.3]}),
    "top": (ROUND | HUNG, TUMBLING, {}),
    "fast top": (ROUND | HUNG, {"omega_b": [0.0, 0.0, 30.0], "attitude": {"rotvec": [2.0, 0.0, 0.0]}}, {}),
    "hung": (FREE | HUNG, TUMBLING, {}),
    "under torque_b": (FREE, TUMBLING, {"torque_b": [0.1, 0.2, 0.3]}),
    "under force_b beside c": (FREE | {"r_oc_b": [0.1, 0.2, 0.0]}, TUMBLING, {"force_b": [0.1, 0.2, 0.3]}),
}
ASKED = [*((name,) for name in QUANTITIES), ("quaternion", "omega_b"), ("position", "quaternion", "omega_b")]
ASKED.append(tuple(QUANTITIES))


WORTH = 1.05
"""What a scene costs without its model, over what it costs with it: at least."""
SERVED = {
    "constant rate": ("spinning", "quaternion"),
    "angular momentum": ("ball under torque_a", "angular_momentum_a"),
    "one axis": ("spun up about its axis", "omega_b"),
    "undamped pendulum": ("pendulum", "quaternion"),
    "one swinging axis": ("damped pendulum", "quaternion"),
    "torque-free symmetric body": ("symmetric, free", "quaternion"),
    "symmetric body spun up": ("symmetric, spun up", "omega_b"),
    "torque-free body": ("free", "quaternion"),
    "torque-free body, body force": ("body force", "position"),
    "symmetric top": ("fast top", "quaternion"),
}
"""By model: a body of those above and a quantity for which it is planned."""


class Figure(NamedTuple):
    """ns a communication step."""

    body: str
    asked: str
    planned: Plan
    terms: Sequence[str]
    stated: float
    measured: float


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _runs(step: Any, z: Any, start: Any, h: float, k: int) -> int:
    fault = 0
    for _ in range(k):
        z[:] = start
        for _ in range(STEPS):
            fault |= step(z, h)
    return fault


def scene_of(body: str, asked: Sequence[str], accuracy: float, step: float) -> Scene:
    """Of BODIES, no gravity unless it hangs."""
    what, initial, loads = BODIES[body]
    gravity = [0.0, 0.0, -9.81 if what.get("pivot") else 0.0]
    run = {"stop": STEPS * step, "step": step, "accuracy": accuracy}
    tables = {"body": what, "initial": initial, "loads": {"gravity_a": gravity} | loads, "run": run}
    return Scene.from_dict(tables | {"outputs": {"quantities": list(asked)}}, body)


def timer(scene: Scene, planned: Plan, k: int) -> Callable[[], float]:
    """Ns a step of k runs of a plan in a compiled loop."""
    kernels, start, h = planned.kernels, filled_buffer(scene, planned), scene.run.step
    initialize(scene, kernels, start)
    z = start.copy()
    assert _runs(kernels.step, z, start, h, k) == 0

    def once() -> float:
        before = perf_counter()
        _runs(kernels.step, z, start, h, k)
        return 1e9 * (perf_counter() - before) / (k * STEPS)

    return once


def planned_scenes(bodies: Sequence[str], asked: Sequence[Sequence[str]], settings: Any) -> list[tuple[Scene, Plan]]:
    """Scenes and their plans, at each accuracy and step of the settings."""
    scenes = [scene_of(body, wanted, *setting) for setting in settings for body in bodies for wanted in asked]
    return [(scene, rbfmu.plan(scene)) for scene in scenes]


def chosen_by_hand() -> list[tuple[Scene, Plan]]:
    """Of the models that no scene here gets."""
    rates = {"inputs": {"ports": ["omega_b"]}, "outputs": {"quantities": ["quaternion"]}}
    gyro = Scene.from_dict(rates | {"run": {"stop": 1.0, "step": 0.01}}, "prescribed")
    found = [(gyro, rbfmu.plan(gyro))]
    for asked in (("quaternion",), tuple(QUANTITIES)):
        top = scene_of("top", asked, 1e-6, 0.01)
        for order, ns in SPLITTING_COSTS.items():
            splitting = Plan("symmetric top", f"splitting of order {order}", 7, substep=0.01, order=order, cost=ns)
            found.append((top, with_cost(Question(top), splitting)))
    return found


def measured(plans: Sequence[tuple[Scene, Plan]], rounds: int, k: int) -> list[Figure]:
    """Return the least of many rounds, at the speed of the table of substeps."""
    found, orders = [], (8, 12, 16)
    for scene, planned in plans:
        wanted = scene.outputs.quantities
        what = ", ".join(wanted) if len(wanted) < len(QUANTITIES) else "all"
        about = f"{scene.name}, {scene.run.step:g} s, {scene.run.accuracy:g}"
        found.append(Figure(about, what, planned, terms(Question(scene), planned), planned.cost, 0.0))
    timers = [timer(scene, planned, k) for scene, planned in plans]
    known = [timed("c'", series(order)) for order in orders]
    least = np.full(len(timers) + len(known), np.inf)
    for _ in range(rounds):
        least = np.minimum(least, [once() for once in (*timers, *known)])
    speed = median(ns / series_cost(order, (1.0, 0.0)) for order, ns in zip(orders, least[len(timers) :], strict=True))
    return [figure._replace(measured=float(ns / speed)) for figure, ns in zip(found, least, strict=False)]


def table(figures: Sequence[Figure]) -> dict[str, float]:
    """`rbfmu.planning.methods.NS` by these figures: least squares of relative errors."""
    rest = np.array([f.measured - (f.stated - sum(NS[t] for t in f.terms)) for f in figures])
    use = np.array([[float(name in f.terms) for name in NS] for f in figures])
    weights = 1.0 / np.array([f.measured for f in figures])
    found, _ = nnls(use * weights[:, None], rest * weights)
    return {name: float(ns) for name, ns, used in zip(NS, found, use.any(axis=0), strict=True) if used}


@contextmanager
def without(model: str) -> Iterator[None]:
    """Plans do without a model."""

    def accepts(self: ModelSpec, scene: Scene) -> bool:
        return self.key != model and usual(self, scene)

    usual, rest = ModelSpec.accepts, tuple(spec for spec in registry.CLOSED_FORMS if spec.key != model)
    with patch.object(ModelSpec, "accepts", accepts), patch.object(registry, "CLOSED_FORMS", rest):
        yield


def served(model: str) -> Scene:
    """Return a scene for which the model is planned."""
    body, asked = SERVED[model]
    return scene_of(body, (asked,), 1e-4, 1.0)


def worth(model: str, rounds: int, k: int) -> float:
    """Return a scene's steps without the model that serves it, over those with it: the median of runs in turn."""
    scene = served(model)
    found = rbfmu.plan(scene)
    with without(model):
        other = rbfmu.plan(scene)
    one, two = timer(scene, found, k), timer(scene, other, k)
    ratio = median(two() / one() for _ in range(rounds))
    print(f"{ratio:6.2f}  without {model}: {other.model}, {other.method}: {scene.name}")
    return ratio


def goals(figures: Sequence[Figure]) -> list[Goal]:
    """Of each figure."""
    return [
        Goal(f"{f.body}, {f.asked}, stated / measured", f.stated / f.measured, 1.0 / WITHIN, WITHIN) for f in figures
    ]


def main() -> list[Figure]:
    """Measure and print."""
    figures = measured(planned_scenes(list(BODIES), ASKED, [(1e-9, 0.01)]) + chosen_by_hand(), 15, 10)
    driven = ["top", "hung", "under torque_b", "damped pendulum", "body force", "under force_b beside c"]
    settings = [(1e-4, 0.1), (1e-12, 0.1), (1e-4, 1.0), (1e-9, 1.0)]
    figures += measured(planned_scenes(driven, [("quaternion",), ("omega_b",), tuple(QUANTITIES)], settings), 15, 3)
    print(f"{'stated':>8} {'measured':>8} {'ratio':>6}  ns a step")
    for f in figures:
        ratio = f.stated / f.measured
        what = f"{f.planned.model}, {f.planned.method}: {f.body}: {f.asked}"
        print(f"{f.stated:8.0f} {f.measured:8.0f} {ratio:6.2f}  {what}")
    print("NS = {")
    for name, ns in table(figures).items():
        print(f'    "{name}": {ns:.0f}.0,')
    print("}")
    return figures


if __name__ == "__main__":
    figures = main()
    worths = [Goal(f"without {model} / with it", worth(model, 25, 50), WORTH) for model in SERVED]
    raise SystemExit(status(goals(figures) + worths))
