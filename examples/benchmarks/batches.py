"""Many bodies under loads: ours side by side in lanes, beside heyoka.py in batch mode, MuJoCo rollout and our own loop.

Bodies of a motion whose moments, mass, rates and torque differ by 1 %, from their parameters to their attitudes at the
end, on one thread. The tolerance of each, or MuJoCo's step, is the loosest at which the worst true error of an attitude
is at most the mark, against double-double arithmetic; our order is the plan's. Costs: the least CPU times in turn.
`python -m examples.benchmarks.batches` prints all and exits with status 1 where a goal is missed; with a seed and a
number, such as 7700 20, it measures whole calls of so many random motions; a third number is that of output times.
"""

import math
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rbfmu
from examples.benchmarks.support.goals import Goal, status
from examples.benchmarks.support.least import least
from rbfmu.ensembles.control import NOTHING, driven_members
from rbfmu.ensembles.loops import compile_lanes, run_alone, run_in_lanes
from rbfmu.ensembles.members import draw, member
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.ensembles.running import run_ensemble
from rbfmu.extras import needed_of
from rbfmu.planning.reference import reference_motion
from rbfmu.runs.motion import attitude_error
from rbfmu.runs.plan import Plan, filled_buffer
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import CASES, Case
from rbfmu.studies.chart.solvers import equations
from rbfmu_kernels.body.members import Members
from rbfmu_kernels.models.loaded import LOADED_TAYLOR

Array = NDArray[np.float64]
MOTIONS, MARKS, SPREAD, SEED = ("c", "c'", "d"), (1e-6, 1e-9), 0.01, 15
BODIES, CHECKED = 256, 64
"""BODIES: those of a row; of 64, done in 0.2 ms, more than half of our cost was that of the call, not of the bodies.
CHECKED: members of a whole call whose errors are known, and which heyoka.py runs."""
LOOSER = [10.0 ** (0.25 * k) for k in range(12, -12, -1)]
"""Our tolerances over the plan's."""
TOLERANCES = [10.0 ** (-0.25 * k) for k in range(12, 60)]
FEW, MOST_STEPS = 4, 2**17
"""The bodies that MuJoCo runs, each with its own model, and its steps, after each of which it keeps the state."""
SECONDS, MOST_SECONDS = 2e-3, 5.0
LANES, ALONE, FOUR, EIGHT, ROLLOUT = "lanes", "one by one", "heyoka.py, 4", "heyoka.py, 8", "MuJoCo rollout"
GOAL = 0.8
"""The largest cost over that of heyoka.py's batches of four, the number that it recommends."""
WHOLE = 0.6
"""The same of `run_ensemble` with many members, planning and drawing included."""

Run = Callable[[], Array]
"""Returns the attitudes at the end, (bodies, 4)."""


@dataclass(frozen=True)
class Row:
    """Worst errors (rad) and costs (us a body-second) of methods at a mark, of those that meet it."""

    motion: str
    mark: float
    errors: dict[str, float]
    costs: dict[str, float]

    def ratio(self, other: str) -> float:
        """Return our cost over the other's; NaN where it is not known."""
        return self.costs[LANES] / self.costs.get(other, math.nan)


class Batch:
    """Bodies of a motion with numbers of their own, and their true attitudes at the end."""

    def __init__(self, case: Case, bodies: int) -> None:
        self.case = case
        numbers = np.random.default_rng(SEED)
        self.scenes = [_dispersed(case, numbers) for _ in range(bodies)]

    @cached_property
    def truth(self) -> Array:
        """Return the attitudes at the end (bodies, 4)."""
        span = [self.case.span]
        return np.array([reference_motion(scene, span, 10**7)["quaternion"][-1] for scene in self.scenes])

    def error(self, q: Array) -> float:
        """Return the worst error of the attitudes (n, 4) of the first bodies, rad."""
        worst = float(np.max(attitude_error(q / np.linalg.norm(q, axis=1, keepdims=True), self.truth[: len(q)])))
        return worst if math.isfinite(worst) else math.inf


def _dispersed(case: Case, numbers: np.random.Generator) -> Scene:
    """Return the scene of a body; where a moment is above the sum of the others, it is drawn again."""
    tables = case.asking(MARKS[0]).to_dict()
    tables["run"]["step"] = case.span
    for table, name in (("body", "inertia"), ("body", "mass"), ("initial", "omega_b"), ("loads", "torque_b")):
        value = np.array(tables[table][name], dtype=float)
        factor = 1.0 + SPREAD * numbers.normal(size=value.shape[-1:])
        tables[table][name] = (value * factor).tolist()
    try:
        return Scene.from_dict(tables, case.key)
    except rbfmu.SceneError:
        return _dispersed(case, numbers)


# Contestants: by their settings, the loosest first


def _plan_of(batch: Batch, mark: float) -> Plan:
    tables = batch.scenes[0].to_dict()
    tables["run"]["accuracy"] = mark
    plan = rbfmu.plan(Scene.from_dict(tables, batch.case.key))
    assert plan.kernels is LOADED_TAYLOR
    return plan


def ours(batch: Batch, mark: float, run: Callable[..., Any]) -> Iterator[Run]:
    """Yield runs of our series."""
    plan = _plan_of(batch, mark)
    blocks = LOADED_TAYLOR.BLOCKS
    varied = [blocks[name] for name in ("inertia", "mass", "omega_b_0", "constant_torque_b")]
    places = np.concatenate([np.arange(block.start, block.stop) for block in varied])
    kept = np.arange(blocks["quaternion"].start, blocks["quaternion"].stop)
    count = len(batch.scenes)
    rows, ends, none = np.empty((count, 1, 4)), np.empty((count, 2), dtype=np.int64), np.empty(0, dtype=np.int64)
    control, driving = driven_members(NOTHING, batch.scenes[0], LOADED_TAYLOR, range(count))
    for looser in LOOSER:
        settings = replace(plan, tolerance=looser * plan.tolerance)
        filled = [filled_buffer(scene, settings) for scene in batch.scenes]
        values = np.array([z[places] for z in filled])

        def once(base: Array = filled[0], values: Array = values) -> Array:
            members = Members(base, places, values, kept, rows, ends, none, np.empty((count, 0)))
            run(LOADED_TAYLOR, members, control, driving, through=True)  # as ensembles do
            return rows[:, 0] if np.all(ends == (0, 1)) else np.full((count, 4), np.nan)

        yield once


def heyokas(batch: Batch, size: int, points: int = 1) -> Iterator[Run]:
    """Yield runs of heyoka.py, with so many bodies a vector and outputs a run: compiled once, with numbers to set."""
    with needed_of("bench"):
        import heyoka
    scenes, case = batch.scenes, batch.case
    moments = [np.diag(s.body.M_o if s.body.pivot else s.body.M_c) for s in scenes]
    loads = [[s.body.mass * s.loads.gravity_a[2]] if s.body.pivot else s.loads.torque_b for s in scenes]
    numbers = np.hstack([moments, loads]).T
    start = np.array([(*s.initial.quaternion, *s.initial.omega_b) for s in scenes]).T
    bodies = [np.ascontiguousarray(numbers[:, k : k + size]) for k in range(0, len(scenes), size)]
    states = [np.ascontiguousarray(start[:, k : k + size]) for k in range(0, len(scenes), size)]
    system = equations(case, _parameters(case, heyoka.par))
    times = np.repeat(np.linspace(0.0, case.span, points + 1)[:, None], size, axis=1)
    for tolerance in TOLERANCES:
        series = heyoka.taylor_adaptive_batch(system, states[0], tol=tolerance, pars=bodies[0])

        def once(series: Any = series) -> Array:
            found = []
            for own, state in zip(bodies, states, strict=True):
                series.set_time(0.0)
                series.pars[:], series.state[:] = own, state
                series.propagate_grid(times) if points > 1 else series.propagate_until(case.span)
                found.append(series.state[:4].T.copy())
            return np.concatenate(found)

        yield once


def _parameters(case: Case, par: Any) -> dict[str, Any]:
    """Return the parameters that stand for numbers of a scene in its equations: moments, and torque_b or weight."""
    moments = {f"M[{1 + 4 * i}]": par[i] for i in range(3)} | {
        f"M_inverse[{1 + 4 * i}]": 1.0 / par[i] for i in range(3)
    }
    if case.scene.body.pivot:
        return moments | {"mass": 1.0, "gravity_a[3]": par[3]}
    return moments | {f"constant_torque_b[{i + 1}]": par[3 + i] for i in range(3)}


_MUJOCO = """<mujoco><option timestep="{step!r}" integrator="RK4" gravity="{gravity}"><flag contact="disable"
constraint="disable"/></option><worldbody><body>{joint}<inertial pos="{at}" mass="{mass!r}" diaginertia="{moments}"/>
<site name="o"/></body></worldbody><actuator><motor site="o" gear="0 0 0 {torque}"/></actuator></mujoco>"""


def rollouts(batch: Batch) -> Iterator[Run]:
    """Yield runs of MuJoCo's rollout of a few of the bodies, from a radian a step on."""
    with needed_of("bench"):
        import mujoco
        from mujoco.rollout import Rollout
    mujoco.set_mju_user_warning(lambda text: None)  # else it writes a log to the working folder
    scenes, count = batch.scenes[:FEW], max(round(batch.case.span * batch.case.rate), 1)
    while (count := math.ceil(2.0**0.5 * count)) <= MOST_STEPS:
        models = [mujoco.MjModel.from_xml_string(_mujoco(scene, batch.case.span / count)) for scene in scenes]
        data, pivot = mujoco.MjData(models[0]), batch.case.scene.body.pivot
        position, velocity = ((), ()) if pivot else ((0.0,) * 3, (0.0,) * 3)
        start = [(0.0, *position, *s.initial.quaternion, *velocity, *s.initial.omega_b) for s in scenes]
        states, steps = np.array(start), count
        pool, control = Rollout(nthread=0), np.ones((1, 1, models[0].nu))
        out = np.empty((len(models), count, states.shape[1]))
        q = slice(1 + len(position), 5 + len(position))

        def once(
            models: Any = models, data: Any = data, states: Array = states, out: Array = out, steps: int = steps,
            pool: Any = pool, control: Array = control, q: slice = q,
        ) -> Array:  # fmt: skip
            pool.rollout(models, data, states, control, nstep=steps, state=out)
            return out[:, -1, q].copy()

        yield once


def _mujoco(scene: Scene, step: float) -> str:
    def text(numbers: Iterable[float]) -> str:
        return " ".join(map(repr, map(float, numbers)))

    body = scene.body
    return _MUJOCO.format(
        step=step, gravity=text(scene.loads.gravity_a), at=text(body.r_oc_b), mass=body.mass,
        moments=text(np.diag(np.array(body.M_c))), torque=text(scene.loads.torque_b),
        joint='<joint type="ball"/>' if body.pivot else '<freejoint align="false"/>',
    )  # fmt: skip


# Measurement


def within(batch: Batch, mark: float, runs: Iterable[Run]) -> tuple[Run, float] | None:
    """Return the first run whose worst error is at most the mark, and that error."""
    for run in runs:
        error = batch.error(run())
        if error <= mark:
            return run, error
    return None


def row_of(key: str, mark: float, bodies: int, rounds: int, others: Sequence[str]) -> Row:
    """Measure a motion at a mark, ours and others."""
    batch = Batch(CASES[key], bodies)
    contestants: dict[str, Callable[[], Iterator[Run]]] = {
        LANES: lambda: ours(batch, mark, run_in_lanes),
        ALONE: lambda: ours(batch, mark, run_alone),
        FOUR: lambda: heyokas(batch, 4),
        EIGHT: lambda: heyokas(batch, 8),
        ROLLOUT: lambda: rollouts(batch),
    }
    found = {name: within(batch, mark, contestants[name]()) for name in (LANES, *others)}
    runs = {name: one for name, one in found.items() if one is not None}
    seconds = least(rounds, {name: run for name, (run, _) in runs.items()}, SECONDS, MOST_SECONDS, process_time)
    errors = {name: error for name, (_, error) in runs.items()}
    costs = {name: 1e6 * seconds[name] / (len(run()) * batch.case.span) for name, (run, _) in runs.items()}
    return Row(batch.case.scene.name, mark, errors, costs)


# Whole calls


@dataclass(frozen=True)
class Call:
    """`run_ensemble` as users call it, on one thread with what is kept on disk, beside heyoka.py in batches.

    Costs are CPU times, us a body-second, heyoka.py's at the loosest tolerance with a third of the accuracy, and with
    outputs at the same times, but no statistics of them, where ours are kept. Drawing is in ours, and planning in what
    a call takes that is the first with its scene; very_first: what the first one took, which loads what is kept on
    disk; planned: ms before the first member. error: the worst of some members, over the accuracy.
    """

    motion: str
    mark: float
    runs: int
    error: float
    again: float
    cost: float
    very_first: float
    heyoka: dict[str, float]
    planned: float

    def __str__(self) -> str:
        ratios = ", ".join(
            f"{name} {self.ratio(name):.2f} ({self.again / self.heyoka[name]:.2f})" for name in self.heyoka
        )
        return (
            f"{self.motion}, {self.mark:.1e}, {self.runs:,} runs: {self.cost:.3g} us a body-second (very first call "
            f"{self.very_first:.3g}), error {self.error:.2g} of the accuracy; ours / {ratios}, in brackets of a scene "
            f"that was run before; {self.planned:.0f} ms before the first member"
        )

    def ratio(self, name: str = FOUR) -> float:
        """Return our cost over the other's, planning included."""
        return self.cost / self.heyoka[name]


def call_of(case: Case, mark: float, runs: int, rounds: int, keep: Sequence[str] = ("final",), points: int = 0) -> Call:
    """Measure a motion whose rates vary by 0.02 rad/s; points: of outputs after the start, by default the case's."""
    tables, rates = case.asking(mark).to_dict(), case.scene.initial.omega_b
    tables["run"]["step"] = case.span / points if points else tables["run"]["step"]
    vary = {"initial.omega_b": {"normal": [list(rates), [0.02] * 3]}}
    scene = Scene.from_dict(tables | {"ensemble": {"runs": runs, "keep": list(keep), "vary": vary}}, case.scene.name)
    if compiling := compile_lanes((planned := plan_ensemble(scene)).kernels, planned.runs_through):
        compiling.join()  # as it is where an ensemble ran before
    begin = process_time()
    result = run_ensemble(scene, executor=1, progress=False)
    first = process_time() - begin
    batch = Batch(case, 0)
    samples = draw(scene, 0, runs)
    batch.scenes = [member(scene, samples, k) for k in range(CHECKED)]
    points = scene.run.count if "statistics" in keep else 1
    found = {name: within(batch, mark / 3.0, heyokas(batch, size, points)) for name, size in ((FOUR, 4), (EIGHT, 8))}
    theirs = {name: one[0] for name, one in found.items() if one is not None}
    ours = {"ours": lambda: run_ensemble(scene, executor=1, progress=False), "planned": lambda: plan_ensemble(scene)}
    seconds = least(rounds, ours | theirs, SECONDS, MOST_SECONDS, process_time)
    unit = 1e6 / case.span
    return Call(
        case.scene.name, mark, runs, batch.error(result.final["quaternion"][:CHECKED]) / mark,
        unit * seconds["ours"] / runs, unit * (seconds["planned"] + seconds["ours"]) / runs, unit * first / runs,
        {name: unit * seconds[name] / CHECKED for name in theirs}, 1e3 * seconds["planned"],
    )  # fmt: skip


def calls(motions: Sequence[str] = ("c", "d"), marks: Sequence[float] = MARKS, rounds: int = 9) -> list[Call]:
    """Print and return whole calls, few and many members."""
    found = []
    for key in motions:
        for mark in marks:
            for runs in (4_096, 100_000):
                found.append(call_of(CASES[key], mark, runs, rounds))
                print(found[-1], flush=True)
    return found


def random_motion(seed: int) -> Case:
    """Return a body of random moments and start, under a torque or as a top, and seldom one that is symmetric."""
    r = np.random.default_rng(seed)
    a, b = np.sort(r.uniform(0.5, 3.0, 2))
    moments, span = [a, b, r.uniform(b - a + 0.05, a + b - 0.05)], r.uniform(1.0, 6.0)
    q = r.normal(size=4)
    top = {"pivot": True, "r_oc_b": [0.0, 0.0, r.uniform(0.1, 0.4)]} if r.random() < 0.5 else {}
    loads = {"gravity_a": [0.0, 0.0, -9.81]} if top else {"torque_b": r.normal(0.0, 0.5, 3).tolist()}
    tables = {
        "body": {"mass": 1.0, "inertia": moments, **top},
        "initial": {
            "attitude": {"quaternion": (q / np.linalg.norm(q)).tolist()},
            "omega_b": r.normal(0, 3, 3).tolist(),
        },
        "loads": {"gravity_a": [0.0, 0.0, 0.0]} | loads,
        "outputs": {"quantities": ["quaternion", "omega_b"]},
        "run": {"stop": span, "step": span},
    }
    return Case(Scene.from_dict(tables, f"seed {seed}, {'a top' if top else 'under a torque'}"))


def random_calls(seed: int, count: int = 20, points: int = 0) -> list[Call]:
    """Print and return whole calls of random motions at random accuracies, with what is kept by default."""
    found = []
    warnings.simplefilter("ignore", rbfmu.SceneWarning)  # of steps in which a body turns more than once
    for one in range(seed, seed + count):
        accuracy = 10.0 ** np.random.default_rng([one, 1]).uniform(-10.0, -5.0)
        found.append(call_of(random_motion(one), accuracy, 100_000, 3, ("final", "statistics"), points))
        print(found[-1], flush=True)
    for name in (FOUR, EIGHT):
        for said, ours in (("planned", lambda call: call.cost), ("run before", lambda call: call.again)):
            ratios = [ours(call) / call.heyoka[name] for call in found if name in call.heyoka]
            told = f"median {np.median(ratios):.2f}, largest {max(ratios):.2f} of {len(ratios)}"
            print(f"ours, {said} / {name}: {told}")
    return found


def goals(rows: Sequence[Row], whole: Sequence[Call] = ()) -> list[Goal]:
    """Of each row, and of calls with many members."""
    found = [Goal(f"{row.motion}, {row.mark:g}, ours / {FOUR}", row.ratio(FOUR), most=GOAL) for row in rows]
    many = (call for call in whole if call.runs > 10_000)
    return found + [
        Goal(f"{call.motion}, {call.mark:g}, {call.runs} runs, whole call / {FOUR}", call.ratio(), most=WHOLE)
        for call in many
    ]


def main(
    motions: Sequence[str] = MOTIONS,
    marks: Sequence[float] = MARKS,
    bodies: int = BODIES,
    rounds: int = 150,
    others: Sequence[str] = (ALONE, FOUR, EIGHT, ROLLOUT),
) -> list[Row]:
    """Print and return the rows."""
    found = []
    for key in motions:
        for mark in marks:
            found.append(row := row_of(key, mark, bodies, rounds, others))
            print(f"{row.motion}, {mark:g}:")
            for name, cost in row.costs.items():
                ratio = f"ours / it {row.ratio(name):.2g}" if name != LANES else ""
                print(f"  {name:16} error {row.errors[name]:.1e} {cost:9.3g} us a body-second  {ratio}", flush=True)
    return found


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:]]
    raise SystemExit(status(goals([], random_calls(*numbers)) if numbers else goals(main(), calls())))
