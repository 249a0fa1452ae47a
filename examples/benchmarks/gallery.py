"""What the gallery's scenes cost: the planned model beside the full one, and beside MuJoCo, each with its error.

`python -m examples.benchmarks.gallery [FOLDER]` writes gallery_cost.csv and gallery_cost.png and prints the table. Cost
is processor time per communication step in a compiled loop (MuJoCo's own, in C), the median of interleaved repeats;
ports are at zero. Errors are those in the quantities that the scene asks for, at a fifth, two fifths, ... of the run,
against 40 digits. MuJoCo takes the largest step, a communication step or part of it, that meets the scene's accuracy.
Exits with status 1 where a goal is missed.
"""

import math
import statistics
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numba import njit

import rbfmu
from examples.benchmarks.support.goals import Goal, status
from examples.gallery.cost_chart import draw
from examples.gallery.page import PICTURES, scene_file
from examples.references.reference_motions import USUAL, Motion
from rbfmu.extras import needed_of
from rbfmu.planning.select import with_all_outputs
from rbfmu.runs.motion import attitude_error, relative_error
from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu.studies import write_rows
from rbfmu.studies.chart.cases import CHECKPOINTS, Case
from rbfmu.studies.chart.measure import PEERS, machine
from rbfmu.studies.chart.methods import Method, NotFeasibleError
from rbfmu.studies.chart.simulators import MUJOCO

with needed_of("bench"):
    import mpmath as mp

GOAL, ALLOWANCE = 5.0, 1.05
"""The full model's cost over the planned one's on the median scene, and what the planned one may cost on any."""
MAX_PARTS = 2**10
"""Into which MuJoCo cuts a communication step."""
FLOORS = {"position": 1.0, "velocity": 1.0}
Values = dict[str, Any]


@dataclass(frozen=True)
class Competitor:
    """A model ready to run; error: the largest at the checkpoints; repeat: runs the scene k times."""

    scene: str
    who: str
    what: str
    error: float
    repeat: Callable[[int], Any]

    def seconds(self, k: int) -> float:
        """Return the processor time of k runs, s, after one to warm up."""
        self.repeat(1)
        begin = process_time()
        self.repeat(k)
        return process_time() - begin


@dataclass(frozen=True)
class Row:
    """One line of the table; cost: ns a communication step; ratio: its cost over the planned model's."""

    scene: str
    who: str
    what: str
    accuracy: float
    error: float
    cost: float
    ratio: float


# The truth


def reference(scene: rbfmu.Scene) -> list[Values]:
    """Return quantities at the checkpoints, by 40-digit arithmetic; at rest where rates are prescribed (zero)."""
    count = range(1, CHECKPOINTS + 1)
    if scene.body is None:
        return [{"quaternion": np.array(scene.initial.quaternion)} for _ in count]
    with mp.workdps(60):
        motion = Motion(scene, USUAL)
        states = motion.states([Fraction(scene.run.stop) * k / CHECKPOINTS for k in count])
        rows = [np.array([float(x) for x in motion.numbers(state)]) for state in states]
    return [quantities(scene, row[0:4], row[4:7], row[7:10], row[10:13]) for row in rows]


def quantities(scene: rbfmu.Scene, q: Any, omega_b: Any, r_c: Any, v_c: Any = None) -> Values:
    """Return what the scene asks for, of a state; roll, pitch and yaw as the attitude that they are."""
    body = scene.body
    assert body is not None
    arm, held = np.array(body.r_oc_b), np.array(scene.initial.position)
    found: Values = {"quaternion": q, "rpy": q, "omega_b": omega_b}
    found["position"] = held if body.pivot else r_c - rbfmu.rotate(q, arm)
    found["kinetic_energy"] = np.atleast_1d(rbfmu.kinetic_energy(0.0, np.array(body.M), np.zeros(3), omega_b))
    if v_c is not None:
        found["velocity"] = v_c - rbfmu.rotate(q, np.cross(omega_b, arm))
    return {name: found[name] for name in scene.outputs.quantities if name in found}


def largest_error(found: list[Values], true: list[Values]) -> float:
    """Over all checkpoints and quantities that both have, as the scene's accuracy counts."""
    errors = []
    for name in found[0].keys() & true[0].keys():
        a, b = (np.array([values[name] for values in rows]) for rows in (found, true))
        attitude = name in ("quaternion", "rpy")
        errors.append(np.max(attitude_error(a, b) if attitude else relative_error(a, b, FLOORS.get(name, 0.0))))
    worst = float(np.max(errors))
    return worst if math.isfinite(worst) else math.inf


# This library's models


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _runs(step: Any, z: Any, start: Any, h: float, n: int, k: int) -> int:
    """K runs of n steps; 0 if all were done."""
    fault = 0
    for _ in range(k):
        z[:] = start
        for _ in range(n):
            fault |= step(z, h)
    return fault


def own(scene: rbfmu.Scene, who: str, planned: Any, true: list[Values]) -> Competitor:
    """Return a plan's kernels, stepped at the scene's communication step; the full model with all outputs."""
    kernels, start = planned.kernels, filled_buffer(with_all_outputs(scene) if who == "full" else scene, planned)
    initialize(scene, kernels, start)
    z, n, h = start.copy(), steps_of(scene), scene.run.step
    found = []
    for _ in range(CHECKPOINTS):
        assert all(kernels.step(z, h) == 0 for _ in range(n // CHECKPOINTS))
        found.append({name: z[kernels.BLOCKS[name]].copy() for name in scene.outputs.quantities})
    for values in found:
        if "rpy" in values:
            values["rpy"] = rbfmu.quaternion_from_euler("ZYX", values["rpy"][::-1])

    def repeat(k: int) -> None:
        assert _runs(kernels.step, z, start, h, n, k) == 0

    return Competitor(scene.name, who, f"{planned.model}: {planned.method}", largest_error(found, true), repeat)


def steps_of(scene: rbfmu.Scene) -> int:
    """Communication steps of the run, a multiple of the checkpoints."""
    n = round((scene.run.stop - scene.run.start) / scene.run.step)
    assert n % CHECKPOINTS == 0, scene.name
    return n


# MuJoCo


def mujoco(scene: rbfmu.Scene, true: list[Values]) -> Competitor | None:
    """Return the cheapest integrator and step that meet the accuracy, or the nearest; None: it has no such model."""
    tried = [found for method in MUJOCO for found in _refined(scene, method, true)]
    good = [found for found in tried if found.error <= scene.run.accuracy]
    if good:
        return min(good, key=lambda found: found.seconds(1))
    return min(tried, key=lambda found: found.error, default=None)


def _refined(scene: rbfmu.Scene, method: Method, true: list[Values]) -> Iterator[Competitor]:
    """In ever smaller steps, until the accuracy is met or errors grow."""
    parts, last = 1, math.inf
    while parts <= MAX_PARTS:
        try:
            found = _mujoco(scene, method, scene.run.step / parts, true)
        except (NotFeasibleError, ValueError):  # the latter: a body that MuJoCo does not accept
            return
        yield found
        if found.error <= scene.run.accuracy or not (found.error < 0.9 * last or found.error == math.inf):
            return
        parts, last = parts * 2, found.error


def _mujoco(scene: rbfmu.Scene, method: Method, h: float, true: list[Values]) -> Competitor:
    tables = scene.to_dict()
    tables["run"]["step"] = scene.run.stop / CHECKPOINTS
    run = method.run(Case(rbfmu.Scene.from_dict(tables, scene.name)), h)
    found = run.found | {"rpy": run.found["quaternion"]} if "quaternion" in run.found else run.found
    error = largest_error([{name: rows[k] for name, rows in found.items()} for k in range(CHECKPOINTS)], true)
    return Competitor(
        scene.name, "MuJoCo", f"{method.name.removeprefix('MuJoCo ')} in steps of {h:.3g} s", error, run.seconds
    )


def everywhere_accepted(scene: rbfmu.Scene) -> rbfmu.Scene:
    """Return the same motion by numbers that every simulator takes.

    A beam gets a moment about the axis about which it does not turn, and damping that acts about one axis acts alike
    about the others, about which there is no rate.
    """
    tables = scene.to_dict()
    if scene.body is not None and 0.0 in (moments := np.diag(scene.body.M_c).tolist()):
        tables["body"]["inertia"] = [m or 0.5 * max(moments) for m in moments]
    damping = scene.loads.damping_b
    if any(damping) and np.count_nonzero(scene.initial.omega_b) == 1:
        tables["loads"]["damping_b"] = [max(damping)] * 3
    return rbfmu.Scene.from_dict(tables, scene.name)


# The table


def competitors(name: str) -> list[Competitor]:
    """Planned, full, and MuJoCo if it is installed, of those that there are."""
    scene = rbfmu.load_scene(scene_file(name))
    true = reference(everywhere_accepted(scene))
    found = [own(scene, "planned", rbfmu.plan(scene), true)]
    if scene.body is None:
        return found
    found.append(own(scene, "full", rbfmu.plan(scene, full=True), true))
    other = mujoco(everywhere_accepted(scene), true) if PEERS["MuJoCo"].installed else None
    return found + ([other] if other else [])


def measured(name: str, repeats: int, least: float) -> list[Row]:
    """Return the scene's rows; each repeat takes some `least` seconds for each competitor, in turn."""
    scene, found = rbfmu.load_scene(scene_file(name)), competitors(name)
    for competitor in found:
        competitor.seconds(1)  # compiled
    counts = [max(1, math.ceil(least / competitor.seconds(1))) for competitor in found]
    times = [[c.seconds(k) / k for c, k in zip(found, counts, strict=True)] for _ in range(repeats)]
    rows = []
    for i, c in enumerate(found):
        cost = 1e9 * statistics.median(row[i] for row in times) / steps_of(scene)
        ratio = statistics.median(row[i] / row[0] for row in times)
        rows.append(Row(name, c.who, c.what, scene.run.accuracy, c.error, cost, ratio))
    return rows


def verdict(rows: list[Row]) -> str:
    """Return the full model's cost over the planned one's: on the median scene, and on the worst."""
    ratios = sorted((row.ratio, row.scene) for row in rows if row.who == "full")
    median = statistics.median(ratio for ratio, _ in ratios)
    (least, where), allowed = ratios[0], 1.0 / ALLOWANCE
    missed = [row.scene for row in rows if row.who != "MuJoCo" and row.error > row.accuracy]
    return (
        f"planned {median:.1f} times cheaper on the median scene (goal {GOAL:g}); least {least:.2f} on {where} "
        f"(goal {allowed:.2f}); accuracy missed by {', '.join(missed) if missed else 'none'}"
    )


def print_table(rows: list[Row]) -> None:
    """In fixed columns."""
    print(f"{'scene':22} {'who':8} {'ns/step':>9} {'ratio':>8} {'error':>8} {'asked':>7}  what")
    for r in rows:
        line = f"{r.scene:22} {r.who:8} {r.cost:9.1f} {r.ratio:8.2f} {r.error:8.1e} {r.accuracy:7.0e}"
        print(f"{line}  {r.what}")


def main(folder: Path, names: list[str] | None = None, repeats: int = 25, least: float = 0.004) -> list[Row]:
    """Measure, write, draw and print."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [row for name in names or PICTURES for row in measured(name, repeats, least)]
    write_rows(folder / "gallery_cost.csv", map(asdict, rows), machine())
    draw(rows, folder / "gallery_cost.png")
    print_table(rows)
    print(verdict(rows))
    return rows


def goals(rows: list[Row]) -> list[Goal]:
    """Of the rows that `main` returns; MuJoCo's accuracy is its own affair."""
    full = [row for row in rows if row.who == "full"]
    found = [Goal("full / planned, median scene", statistics.median(row.ratio for row in full), least=GOAL)]
    found += [Goal(f"full / planned, {row.scene}", row.ratio, least=1.0 / ALLOWANCE) for row in full]
    own = [row for row in rows if row.who != "MuJoCo"]
    return found + [Goal(f"error, {row.scene}, {row.who}", row.error, most=row.accuracy) for row in own]


if __name__ == "__main__":
    raise SystemExit(status(goals(main(Path(sys.argv[1] if len(sys.argv) > 1 else "bench")))))
