"""Many outputs: what a communication step costs beside heyoka.py's dense output, of quaternion and rate alone.

Each figure is the cost of a plan over that of `propagate_grid`, both on one thread, the least of runs in turn. heyoka's
tolerance is the loosest at which its true error is at most the plan's; of the torque-free body, which the plan knows
exactly, at most the accuracy that the plan was asked for. Errors are the attitude's at five points, against 40 digits.
`python -m examples.benchmarks.dense_output` prints all and exits with status 1 where a plan costs more.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numba import njit

import rbfmu
from examples.benchmarks.support.goals import Goal, status
from examples.benchmarks.support.least import least
from rbfmu.extras import needed_of
from rbfmu.models.model_buffer import aligned_zeros
from rbfmu.runs.plan import start_run
from rbfmu.studies.chart.cases import CASES, Case
from rbfmu.studies.chart.solvers import equations

MOTIONS, STEPS, ACCURACIES = ("a", "d", "c'", "c"), (0.1, 0.01), (1e-6, 1e-9, 1e-12)
TOLERANCES = [10.0 ** (-0.5 * k) for k in range(6, 32)]
SECONDS = 1e-3
GOAL = 1.0
"""The largest cost of a plan over heyoka's."""


@dataclass(frozen=True)
class Row:
    """A plan beside heyoka.py; ns: an output's; ratio: of the two."""

    motion: str
    step: float
    accuracy: float
    method: str
    error: float
    ns: float
    tolerance: float
    peer_error: float
    peer_ns: float

    @property
    def ratio(self) -> float:
        """Return the plan's cost over heyoka's; NaN where heyoka is nowhere as accurate."""
        return self.ns / self.peer_ns


@njit(error_model="numpy", nogil=True)  # type: ignore[untyped-decorator]
def _outputs(step: Any, z: Any, start: Any, kept: int, h: float, quaternion: int, omega: int, rows: Any) -> int:
    for i in range(kept):
        z[i] = start[i]
    fault = 0
    for k in range(1, len(rows)):
        fault |= step(z, h)
        for i in range(4):
            rows[k, i] = z[quaternion + i]
        for i in range(3):
            rows[k, 4 + i] = z[omega + i]
    return fault


def planned(case: Case, accuracy: float) -> tuple[str, float, Callable[[], None]]:
    """Return the method of the plan, its error, and its run."""
    scene = case.asking(accuracy)
    plan = rbfmu.plan(scene)
    start = start_run(scene, plan, scene.outputs.quantities)
    z, rows = aligned_zeros(len(start)), np.zeros((case.outputs + 1, 7))
    kept = plan.kernels.BLOCKS.get("work", slice(len(z), None)).start
    z[:] = start
    places = [plan.kernels.BLOCKS[name].start for name in ("quaternion", "omega_b")]

    def run() -> None:
        if _outputs(plan.kernels.step, z, start, kept, case.interval, *places, rows) != 0:
            raise ArithmeticError(f"{case.key}: a step was refused")

    run()
    return plan.method, case.error(case.motion_of(rows)), run


@cache
def _integrator(key: str, tolerance: float) -> Any:
    with needed_of("bench"):
        import heyoka
    case = CASES[key]
    return heyoka.taylor_adaptive(equations(case), list(case.integrated), tol=tolerance)


def _peer(case: Case, tolerance: float) -> tuple[float, Callable[[], Any]]:
    """Return the error of heyoka at a tolerance, and its run."""
    series, y, grid = _integrator(case.key, tolerance), case.integrated, case.times

    def run() -> Any:
        series.time = 0.0
        series.state[:] = y
        return series.propagate_grid(grid)

    return case.error(case.motion_of(run()[-1])), run


def _peer_within(case: Case, error: float) -> tuple[float, float, Callable[[], Any] | None]:
    """Return the loosest tolerance whose error is at most `error`, that error, and the run."""
    for tolerance in TOLERANCES:
        found, run = _peer(case, tolerance)
        if found <= error:
            return tolerance, found, run
    return math.nan, math.nan, None


def rows_of(key: str, step: float, accuracies: Sequence[float], rounds: int) -> Iterator[Row]:
    """Yield a row for each accuracy."""
    case = replace(CASES[key], outputs=round(CASES[key].span / step))
    for accuracy in accuracies:
        method, error, run = planned(case, accuracy)
        tolerance, peer_error, peer = _peer_within(case, accuracy if case.torque_free else error)
        own, other = least(rounds, {"plan": run, "peer": peer}, SECONDS).values() if peer else (math.nan, math.nan)
        ns = 1e9 / case.outputs
        yield Row(case.scene.name, step, accuracy, method, error, ns * own, tolerance, peer_error, ns * other)


def goals(rows: Sequence[Row]) -> list[Goal]:
    """Of each row."""
    return [
        Goal(f"{row.motion}, every {row.step:g} s, {row.accuracy:g}, plan / heyoka.py", row.ratio, most=GOAL)
        for row in rows
    ]


def main(
    motions: Sequence[str] = MOTIONS,
    steps: Sequence[float] = STEPS,
    accuracies: Sequence[float] = ACCURACIES,
    rounds: int = 200,
) -> list[Row]:
    """Print and return the rows."""
    print(f"{'motion':24} {'s':>5} {'asked':>6} {'error':>8} {'ns':>6} {'heyoka: error':>14} {'ns':>6} {'ratio':>6}")
    found = []
    for key in motions:
        for step in steps:
            for row in rows_of(key, step, accuracies, rounds):
                found.append(row)
                own = f"{row.motion:24} {row.step:5g} {row.accuracy:6.0e} {row.error:8.1e} {row.ns:6.0f}"
                print(f"{own} {row.peer_error:14.1e} {row.peer_ns:6.0f} {row.ratio:6.2f}  {row.method}", flush=True)
    return found


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
