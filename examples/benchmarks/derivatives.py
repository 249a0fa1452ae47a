"""Derivatives of motions: what they cost over the run alone, and beside heyoka.py's variational equations.

Numbers are the rates and the attitude at the start: six, of which heyoka.py has seven, as a quaternion has four. Both
make a thousand rows on one thread; whole calls, medians of nine in turn; what compiles first is left out.
`python -m examples.benchmarks.derivatives` prints all.
"""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import rbfmu
from rbfmu.extras import needed_of
from rbfmu.runs.inputs import HOLD, drive_of
from rbfmu.sensitivities import Varied
from rbfmu.studies.chart.cases import Case
from rbfmu.studies.chart.solvers import equations

SCENES = ("tumbling_brick", "top_precessing", "formulas/gravity_gradient", "formulas/spring_pendulum")
ACCURACY, ROWS, ROUNDS = 1e-9, 1000, 9
BY = ("initial.omega_b", "initial.attitude")


def seconds(run: Callable[[], Any]) -> float:
    """Return the CPU time of a call."""
    begin = time.process_time()
    run()
    return time.process_time() - begin


def of_heyoka(scene: rbfmu.Scene) -> Callable[[], Any]:
    """Return a run of the motion with its variational equations at heyoka's tolerance of the same size."""
    with needed_of("bench"):
        import heyoka
    case = Case(scene)
    system = equations(case)
    series = heyoka.taylor_adaptive(
        heyoka.var_ode_sys(system, heyoka.var_args.vars, order=1), case.integrated, tol=ACCURACY, compact_mode=True
    )
    start, grid = series.state.copy(), np.linspace(0.0, scene.run.stop - scene.run.start, ROWS + 1)

    def once() -> Any:
        series.time, series.state[:] = 0.0, start
        return series.propagate_grid(grid)[-1]

    return once


def main() -> None:
    """Print a row a scene: milliseconds of a run, of one with derivatives, of heyoka's; and ratios."""
    print("scene                      run   with derivatives   over the run   heyoka.py   over heyoka.py")
    for name in SCENES:
        scene = rbfmu.load_scene(Path(__file__).parents[1] / "scenes" / f"{name}.toml")
        step = (scene.run.stop - scene.run.start) / ROWS
        shown = {"outputs.quantities": ["quaternion", "omega_b"]}
        scene = scene.replace({"run.step": step, "run.accuracy": ACCURACY, **shown})
        planned, varied = rbfmu.plan(scene), Varied(scene, BY)
        for model in (planned.kernels, varied.model.model):
            model.step(np.zeros(model.SIZE), 0.0)  # compiled, as after some runs
        drive = drive_of(scene, {}, HOLD)
        runs = [lambda s=scene, p=planned: rbfmu.simulate(s, planned=p)]
        runs.append(lambda v=varied, s=scene, d=drive: v.along(s, d))
        runs.append(of_heyoka(scene))
        for run in runs * 2:
            run()
        times = np.array([[seconds(run) for run in runs] for _ in range(ROUNDS)])
        ours, derived, theirs = (1e3 * median(column) for column in times.T)
        print(f"{name:24s} {ours:5.2f} {derived:13.2f} {derived / ours:14.1f} {theirs:16.2f} {derived / theirs:12.2f}")


if __name__ == "__main__":
    main()
