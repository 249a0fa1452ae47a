"""The library's methods as competitors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from rbfmu.contestants import Contestant
from rbfmu.ladder import CLOSED
from rbfmu.models import Plan
from rbfmu.planning import plan
from rbfmu.recording import substeps_counted
from rbfmu.scene import Scene, SceneError
from rbfmu.unit import aligned_zeros, filled_buffer, initialize
from rbfmu.work_precision.cases import CHECKPOINTS, Case
from rbfmu.work_precision.methods import FixedSteps, Method, NotFeasibleError, Run, step_counts, timed, tolerances
from rbfmu_kernels._kernel import kernel
from rbfmu_kernels.body_memory import motion_of
from rbfmu_kernels.dynamics import State, steady_acceleration
from rbfmu_kernels.free_rotation import free_rotation_at, free_rotation_setup
from rbfmu_kernels.kicked_top import rkn4_steps, rkn6_steps, strang_steps
from rbfmu_kernels.shapes import Quaternion, Vec3
from rbfmu_kernels.vec3 import add_scaled

# The product's units: stepped from checkpoint to checkpoint, with all outputs


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _unit_repeated(step: Any, z: Any, start: Any, interval: float, n: int, k: int) -> int:
    fault = 0
    for _ in range(k):
        z[:] = start
        for _ in range(n):
            fault += step(z, interval)
    return fault


def _run_of_unit(case: Case, scene: Scene, chosen: Plan, per_substep: float = math.nan, fixed: float = 0.0) -> Run:
    """A plan's unit; per_substep: right-hand sides; fixed: the number of substeps where the unit counts none."""
    unit, start = chosen.unit, filled_buffer(scene, chosen)
    initialize(scene, unit, start)
    z = aligned_zeros(len(start))
    z[:] = start
    _unit_repeated(unit.step, z, start, case.interval, 1, 1)  # compiled for each unit

    def states() -> list[State]:
        z[:], found = start, []
        for _ in range(CHECKPOINTS):
            if unit.step(z, case.interval):
                z[:] = math.nan
            found.append(motion_of(z))
        return found

    found = states()
    seconds = timed(lambda k: _unit_repeated(unit.step, z, start, case.interval, CHECKPOINTS, k))
    return Run(lambda: found, seconds, per_substep * (fixed or substeps_counted(unit, z)))


@dataclass(frozen=True)
class Substeps:
    """The units of a body under loads: with error control, or DOP853 in equal steps.

    order: of Taylor series, 0 for DOP853.
    """

    order: int
    controlled: bool = True

    @property
    def name(self) -> str:
        """By method and how its steps are chosen."""
        if self.order:
            return f"Taylor, order {self.order}"
        return "DOP853, error control" if self.controlled else "DOP853, fixed steps"

    @property
    def family(self) -> str:
        """By method."""
        return "Taylor" if self.order else "DOP853"

    @property
    def setting(self) -> str:
        """What is varied."""
        return "tolerance" if self.controlled else "step (s)"

    def suits(self, case: Case) -> bool:
        """All; of a long motion, fixed steps only."""
        return not (self.controlled and case.long)

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Tolerances or step sizes."""
        return tolerances(0, -16 if self.order else -15, quick) if self.controlled else step_counts(case, quick)

    def run(self, case: Case, value: float) -> Run:
        """With a tolerance or step of `value`."""
        model = "body under loads, by series" if self.order else "body under loads"
        substep, tolerance = (math.inf, value) if self.controlled else (value, 0.0)
        chosen = Plan(model, self.name, 13, substep, tolerance, self.order)
        fixed = 0.0 if self.controlled else float(CHECKPOINTS * round(case.interval / value))
        return _run_of_unit(case, case.scene, chosen, self.order or 12.0, fixed)


# Exact


@kernel(inline=False)
def _exact(out: Any, moments: Vec3, q: Quaternion, w: Vec3, span: float, n: int, k: int) -> float:
    """K times: set up, then n outputs; the checkpoints to out."""
    rest, every = 0.0, n // len(out)
    for _ in range(k):
        setup = free_rotation_setup(moments, q, (w[0] + 0.0 * rest, w[1], w[2]))
        for i in range(1, n + 1):
            q_ab, omega = free_rotation_at(setup, span * i / n)
            rest = omega[0] + q_ab[0]
            if i % every == 0:
                j = i // every - 1
                out[j, 0], out[j, 1], out[j, 2], out[j, 3] = q_ab
                out[j, 4], out[j, 5], out[j, 6] = omega
    return rest


def _moved(case: Case, row: Any, i: int) -> State:
    """A row (q, omega) with the centre of mass's path in closed form."""
    x, t, a = row.tolist(), (i + 1) * case.interval, steady_acceleration(case.body, case.loads)
    r, v = add_scaled(case.start[0], t, case.start[1]), case.start[1]
    return add_scaled(r, 0.5 * t * t, a), add_scaled(v, t, a), tuple(x[:4]), tuple(x[4:])


class Exact:
    """Exact torque-free motion."""

    name, family, setting = "exact", "exact", "outputs"

    def suits(self, case: Case) -> bool:
        """Where no load makes a torque."""
        return case.torque_free

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Outputs at the checkpoints only."""
        yield float(CHECKPOINTS)

    def run(self, case: Case, value: float) -> Run:
        """`value` outputs, a multiple of the checkpoints."""
        out = np.zeros((CHECKPOINTS, 7))
        _, _, q, w = case.start

        def repeat(k: int) -> None:
            _exact(out, case.moments, q, w, case.span, int(value), k)

        def states() -> list[State]:
            repeat(1)
            return [_moved(case, row, i) for i, row in enumerate(out)]

        return Run(states, timed(repeat), 0.0)


# The product: plan, then step its unit


class Planned:
    """What `rbfmu.plan` chooses for an accuracy, with all of a unit's outputs."""

    name, family, setting = "rbfmu, as planned", "planned", "accuracy asked"

    def suits(self, case: Case) -> bool:
        """All."""
        return True

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Accuracies."""
        return iter((1e-3, 1e-6, 1e-9, 1e-12)[:: 2 if quick else 1])

    def run(self, case: Case, value: float) -> Run:
        """Planned for the accuracy."""
        scene = case.asking(value)
        try:
            chosen = plan(scene)
        except SceneError as error:
            raise NotFeasibleError(str(error)) from None
        return _run_of_unit(case, scene, chosen)


class ClosedForm(Planned):
    """A closed form under torques: what a plan is then, whatever the accuracy."""

    name, family = "closed form", "exact"

    def suits(self, case: Case) -> bool:
        """Where a plan is one."""
        return not case.torque_free and plan(case.scene).model in CLOSED

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """One."""
        yield case.scene.run.accuracy


_KICKS = (
    Contestant("kicks, order 2 (Strang)", strang_steps, 2, 1),
    Contestant("kicks, order 4", rkn4_steps, 4, 6),
    Contestant("kicks, order 6", rkn6_steps, 6, 11),
)


@cache
def own_methods() -> tuple[Method, ...]:
    """The library's methods, the plan last."""
    kicks = [FixedSteps(kick, "kicks", _top) for kick in _KICKS]
    series = [Substeps(order) for order in (6, 8, 12, 16, 20, 24)]
    return Exact(), ClosedForm(), Substeps(0), Substeps(0, False), *series, *kicks, Planned()


def _top(case: Case) -> bool:
    return case.top
