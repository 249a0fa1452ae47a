"""The library's methods as competitors."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.planning.select import plan
from rbfmu.runs.motion import substeps_counted
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies.dop853 import Dop853Plan
from rbfmu.studies.reference_methods import OneStepMethod
from rbfmu.studies.work_precision.cases import Case
from rbfmu.studies.work_precision.methods import (
    FixedSteps,
    Method,
    NotFeasibleError,
    Run,
    step_counts,
    timed,
    tolerances,
)
from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.exact.free_rotation import free_rotation_at, free_rotation_setup
from rbfmu_kernels.integrators.splitting import rkn4_steps, rkn6_steps, strang_steps
from rbfmu_kernels.types import Quaternion, Vec3

# The product's models, stepped from output to output


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _steps_repeated(step: Any, z: Any, start: Any, interval: float, at: Any, out: Any, k: int) -> int:
    """Make k runs, and store the buffer's elements `at` in `out` at every output; start: what a run begins with."""
    fault = 0
    for _ in range(k):
        z[: len(start)] = start
        for i in range(len(out)):
            fault += step(z, interval)
            for j in range(len(at)):
                out[i, j] = z[at[j]]
    return fault


def run_of_unit(case: Case, scene: Scene, chosen: Plan, per_substep: float = math.nan, fixed: float = 0.0) -> Run:
    """Return a run of a plan's model; per_substep: right-hand sides; fixed: substeps if it counts none."""
    kernels, start = chosen.kernels, filled_buffer(scene, chosen)
    initialize(scene, kernels, start)
    z, start = aligned_zeros(len(start)), start[: kernels.BLOCKS["work"].start if "work" in kernels.BLOCKS else None]
    at = np.concatenate([np.arange(len(z))[kernels.BLOCKS[name]] for name in case.quantities])
    out = np.zeros((case.outputs, len(at)))
    if _steps_repeated(kernels.step, z, start, case.interval, at, out, 1):
        out[:] = math.nan
    found = case.states_of(out)
    evaluations = per_substep * (fixed or substeps_counted(kernels, z))
    seconds = timed(lambda k: _steps_repeated(kernels.step, z, start, case.interval, at, out, k))
    return Run(lambda: found, seconds, evaluations, chosen.method)


@dataclass(frozen=True)
class Substeps:
    """The series of a body under loads, with error control, or DOP853, with it or in equal steps.

    order: the order of the Taylor series, 0 for DOP853.
    """

    order: int
    controlled: bool = True

    @property
    def name(self) -> str:
        """Return the name by method and by how its steps are chosen."""
        if self.order:
            return f"Taylor, order {self.order}"
        return "DOP853, error control" if self.controlled else "DOP853, fixed steps"

    @property
    def family(self) -> str:
        """Return the family by method."""
        return "Taylor" if self.order else "DOP853"

    @property
    def setting(self) -> str:
        """Return the name of the setting that is varied."""
        return "tolerance" if self.controlled else "step (s)"

    def suits(self, case: Case) -> bool:
        """Return whether the case suits: all do; of a long motion only fixed steps do."""
        return not (self.controlled and case.long)

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return tolerances or step sizes."""
        return tolerances(0, -16 if self.order else -15, quick) if self.controlled else step_counts(case, quick)

    def run(self, case: Case, value: float) -> Run:
        """Return a run with a tolerance or step of `value`."""
        substep, tolerance = (math.inf, value) if self.controlled else (value, 0.0)
        if self.order:
            chosen = Plan("body under loads, by series", self.name, 13, substep, tolerance, self.order)
        else:
            chosen = Dop853Plan("body under loads", self.name, 13, substep, tolerance)
        fixed = 0.0 if self.controlled else float(case.outputs * round(case.interval / value))
        return run_of_unit(case, case.asking(1.0), chosen, self.order or 12.0, fixed)


# Exact


@kernel(inline=False)
def _exact(out: Any, moments: Vec3, q: Quaternion, w: Vec3, span: float, k: int) -> float:
    """Set up the motion k times, and compute all outputs each time."""
    rest, n = 0.0, len(out)
    for _ in range(k):
        setup = free_rotation_setup(moments, q, (w[0] + 0.0 * rest, w[1], w[2]))
        for i in range(n):
            q_ab, omega = free_rotation_at(setup, span * (i + 1) / n)
            rest = omega[0] + q_ab[0]
            out[i, 0], out[i, 1], out[i, 2], out[i, 3] = q_ab
            out[i, 4], out[i, 5], out[i, 6] = omega
    return rest


class Exact:
    """Exact torque-free motion."""

    name, family, setting = "exact", "exact", "outputs"

    def suits(self, case: Case) -> bool:
        """Return whether no load makes a torque."""
        return case.torque_free

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return one setting: as many outputs as asked for."""
        yield float(case.outputs)

    def run(self, case: Case, value: float) -> Run:
        """Return a run of all outputs."""
        out = np.zeros((case.outputs, 7))
        q, w = case.start.q_ab, case.start.omega_b

        def repeat(k: int) -> None:
            _exact(out, case.moments, q, w, case.span, k)

        def states() -> Any:
            repeat(1)
            return case.states_of(out)

        return Run(states, timed(repeat), 0.0)


# The product: plan, then step its model


class Planned:
    """The plan that `rbfmu.plan` makes for an accuracy, with all of a model's outputs."""

    name, family, setting = "rbfmu, as planned", "planned", "accuracy asked"

    def suits(self, case: Case) -> bool:
        """Return that every case suits."""
        return True

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return accuracies."""
        return iter((1e-3, 1e-6, 1e-9, 1e-12)[:: 2 if quick else 1])

    def run(self, case: Case, value: float) -> Run:
        """Return a run as planned for the accuracy."""
        scene = case.asking(value)
        try:
            chosen = plan(scene)
        except SceneError as error:
            raise NotFeasibleError(str(error)) from None
        return run_of_unit(case, scene, chosen)


class ClosedForm(Planned):
    """A closed form under torques, which is the plan for such a case whatever the accuracy."""

    name, family = "closed form", "exact"

    def suits(self, case: Case) -> bool:
        """Return whether the plan of the case is a closed form under torques."""
        return not case.torque_free and plan(case.asking(1e-6)).spec.closed_form

    def settings(self, case: Case, quick: bool) -> Iterator[float]:
        """Return one setting."""
        yield 1e-6


_SPLITTINGS = (
    OneStepMethod("splitting, order 2 (Strang)", strang_steps, 2, 1),
    OneStepMethod("splitting, order 4", rkn4_steps, 4, 6),
    OneStepMethod("splitting, order 6", rkn6_steps, 6, 11),
)


@cache
def library_methods() -> tuple[Method, ...]:
    """Return the library's methods, the plan last."""
    splittings = [FixedSteps(one, "splitting", _top) for one in _SPLITTINGS]
    series = [Substeps(order) for order in (6, 8, 12, 16, 20, 24)]
    return Exact(), ClosedForm(), Substeps(0), Substeps(0, False), *series, *splittings, Planned()


def _top(case: Case) -> bool:
    return case.top
