"""The accuracy of a control loop by how inputs are passed: an attitude loop, closed through an FMU's torque port."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rbfmu
from rbfmu.plot import COLORS, Picture, open_frame, with_file
from rbfmu.studies import Progress, write_rows
from rbfmu.studies.chart.measure import machine
from rbfmu.types import Array
from rbfmu_fmu import builder, description, verification

STIFFNESS, DAMPING = 2.0, 3.0
"""The gains of the controller: N m per unit of 2 eps, and N m s/rad."""
MAX_ROUNDS, SETTLED, LARGEST_CHANGE = 60, 1e-11, 1e2
"""Limits of the iteration: its rounds, the change of the torque (N m) at which it ends, and the one from which on it
diverges and the body would spin too fast to follow."""
SUBSTEPS = (1, 8)
SCENE = rbfmu.load_scene(Path(__file__).with_name("attitude_loop.toml"))
FINAL_TIME = SCENE.run.stop


def controller(state: Array) -> Array:
    """Return the torque of a PD law for (q_ab, omega_b); it turns the body to zero attitude by the shorter way."""
    return np.asarray(-STIFFNESS * 2.0 * np.copysign(1.0, state[0]) * state[1:4] - DAMPING * state[4:])


class Loop:
    """The FMU in the loop; it counts the FMU's steps."""

    def __init__(self, unit: verification.Unit) -> None:
        self.unit, self.calls = unit, 0

    def state(self) -> Array:
        """Return the FMU's outputs (q_ab, omega_b), 7 numbers."""
        return np.array(self.unit.outputs()[:-1])

    def step(self, t: float, H: float, n: int, torque: Callable[[float], Array]) -> Array:
        """Take a communication step of H s in n parts, and return the controller's torque for the state reached.

        torque: a function of the part of the step, 0 to 1; each part of the step has the torque at its middle.
        """
        for i in range(n):
            self.unit.set_inputs(torque((i + 0.5) / n).tolist())
            self.unit.fmu.doStep(t + i * H / n, H / n)
            self.calls += 1
        return controller(self.state())


Rule = Callable[[Array, Array, float], Array]
"""A function (before, now, part) that returns the torque, from the controller's last two torques and the part of the
step, 0 to 1."""
WAYS: dict[str, tuple[str, Rule | None]] = {
    "one step late": ("one step late (Jacobi)", lambda before, now, part: before),
    "held": ("held (zero order)", lambda before, now, part: now),
    "extrapolated": ("extrapolated", lambda before, now, part: now + part * (now - before)),
    "rolled back": ("rolled back, iterated", None),
}
"""The ways to pass a torque over a step, each with its label and its rule, or None if it iterates.

A torque held over H is wrong by its change within H, so the loop has order 1 in H, however exact the body's motion is.
A line through the controller's last two torques makes it order 2. The iteration (waveform relaxation) uses the line to
the torque at the end of the step, which has order 2 too, and diverges if H times the loop's gain is not small:
M. Arnold & M. Guenther, Preconditioned dynamic iteration for coupled differential-algebraic systems, BIT 41 (2001).
"""


def run_loop(loop: Loop, way: str, steps: int, n: int) -> Array:
    """Return the final (q_ab, omega_b) of the loop in equal communication steps; NaN if the iteration fails.

    way: a key of WAYS; n: the number of the FMU's steps in each communication step.
    """
    H, loop.calls = FINAL_TIME / steps, 0
    before, rule = controller(loop.state()), WAYS[way][1]
    now = before
    for k in range(steps):
        if rule is None:
            after = _iterate(loop, k * H, H, n, now)
            if np.isnan(after[0]):
                return np.full(7, np.nan)
        else:
            after = loop.step(k * H, H, n, partial(rule, before, now))
        before, now = now, after
    return loop.state()


def _iterate(loop: Loop, t: float, H: float, n: int, now: Array) -> Array:
    """Repeat the step until its torque, linear in time, ends at the controller's torque; return that, or NaN."""
    saved, after, change = loop.unit.fmu.getFMUState(), now, np.inf

    def line(part: float) -> Array:
        return now + part * (after - now)

    for _ in range(MAX_ROUNDS):
        loop.unit.fmu.setFMUState(saved)
        guess, after = after, loop.step(t, H, n, line)
        change = float(np.max(np.abs(after - guess)))
        if change <= SETTLED or not change < LARGEST_CHANGE:
            break
    loop.unit.fmu.freeFMUState(saved)
    return after if change <= SETTLED else np.full(3, np.nan)


def reference() -> Array:
    """Return the final (q_ab, omega_b) of the continuous loop, whose controller is a formula of the scene."""
    eps, towards = "[q_ab[2], q_ab[3], q_ab[4]]", "where(q_ab[1] > 0, 1, -1)"  # by the shorter way
    law = f"-{2.0 * STIFFNESS!r}*{towards}*{eps} - {DAMPING!r}*omega_b"
    found = rbfmu.simulate(SCENE.replace({"loads.torque_b": law, "inputs.ports": []}))
    return np.append(found.quaternion[-1], found.omega_b[-1])


@contextmanager
def attitude_loop() -> Iterator[Loop]:
    """Build and start the FMU of `SCENE` in a temporary folder, and yield its loop."""
    plan = rbfmu.plan(SCENE)
    with tempfile.TemporaryDirectory(prefix="rbfmu_") as folder:
        path = builder.build(SCENE, Path(folder) / "attitude_loop.fmu", planned=plan)
        with verification.unit_of(path, description.describe(SCENE, plan)) as unit:
            unit.start(0.0, FINAL_TIME, [0.0, 0.0, 0.0])
            yield Loop(unit)
            unit.fmu.terminate()


class Point(NamedTuple):
    """The loop's attitude error at the final time, rad, and the number of the FMU's steps."""

    way: str
    substeps: int
    communication_step: float
    attitude_error: float
    steps_of_the_fmu: int


def collect(step_counts: Sequence[int], progress: Progress) -> list[Point]:
    """Return the points of all ways at all communication steps; step_counts: their numbers in the run."""
    truth, points = reference(), []
    settings = [(way, n, steps) for way in WAYS for n in SUBSTEPS for steps in step_counts]
    with attitude_loop() as loop:
        start = loop.unit.fmu.getFMUState()
        for i, (way, n, steps) in enumerate(settings):
            progress(i, len(settings), f"attitude loop: {way}, {FINAL_TIME / steps:g} s")
            loop.unit.fmu.setFMUState(start)
            final = run_loop(loop, way, steps, n)
            error = float(rbfmu.angle_between(final[:4], truth[:4])) if np.all(np.isfinite(final)) else np.inf
            points.append(Point(way, n, FINAL_TIME / steps, error, loop.calls))
        loop.unit.fmu.freeFMUState(start)
    progress(len(settings), len(settings), "")
    return points


def run_cosimulation_chart(folder: Path, quick: bool, progress: Progress) -> list[Path]:
    """Run all loops, write the figures as CSV and the chart, and return the files."""
    counts = (8, 16, 32) if quick else (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256, 512, 1024)
    points = collect(counts, progress)
    folder.mkdir(parents=True, exist_ok=True)
    loop = f"torque = -{STIFFNESS:g} * 2 eps sign(eta) - {DAMPING:g} omega, inertia 1, 2, 3, t = {FINAL_TIME:g} s"
    figures = write_rows(folder / "cosimulation.csv", (point._asdict() for point in points), [*machine(), loop])
    return [figures, draw(points, folder / "cosimulation.png")]


def draw(points: Sequence[Point], path: Path) -> Path:
    """Draw the error against the communication step, and against the number of the FMU's steps."""
    figure = Picture(figsize=(11.5, 5.8), layout="constrained")
    by_step, by_work = figure.subplots(1, 2, sharey=True)
    for color, way in zip(COLORS, WAYS, strict=True):
        for n in SUBSTEPS:
            chosen = [p for p in points if p.way == way and p.substeps == n and p.attitude_error < 1.0]
            errors, steps = [p.attitude_error for p in chosen], [p.communication_step for p in chosen]
            work = [p.steps_of_the_fmu / FINAL_TIME for p in chosen]
            by_step.loglog(steps, errors, "-" if n == 1 else "x", color=color, linewidth=1.8, markersize=6)
            by_work.loglog(work, errors, "-" if n == 1 else ":", color=color, linewidth=1.8 if n == 1 else 1.2)
            if n == 1:
                white = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
                by_step.annotate(WAYS[way][0], (steps[-1], errors[-1]), (6, 0), color=color, fontsize=10, bbox=white,
                                 textcoords="offset points", va="center")  # fmt: skip
    by_step.invert_xaxis()
    by_step.set(xlabel="communication step (s), finer to the right", ylabel=f"attitude error at {FINAL_TIME:g} s (rad)")
    by_step.set_title("Lines: one step of the FMU per communication step; crosses: eight", fontsize=10)
    by_work.set_xlabel("steps of the FMU per simulated second")
    by_work.set_title("The same lines and colours by work; dotted: eight steps", fontsize=10)
    for axes in (by_step, by_work):
        open_frame(axes, grid=True)
        left, right = axes.get_xlim()
        axes.set_xlim(left, right * (right / left) ** (0.3 if axes is by_step else 0.05))
    figure.suptitle(
        "Eight substeps buy nothing: how the torque reaches the FMU sets the error of an attitude loop.\n"
        "Held inputs leave order 1 in the communication step; extrapolated ones reach order 2 at the same cost.",
        fontsize=12,
    )
    with_file(figure, path)
    return path
