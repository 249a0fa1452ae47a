"""What ensembles cost: by the number of runs, by two threads beside one, and on Dask beside threads.

`python -m examples.benchmarks.ensembles [FOLDER]` prints it, draws cost and memory against the number of runs to
`ensembles.png`, and exits with status 1 where a goal is missed. Costs against the number of runs are CPU times, each of
a process of its own; the others are ratios of times taken in turn, the least of rounds.
"""

import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

import rbfmu
from examples.benchmarks.support.goals import Goal, status
from examples.benchmarks.support.least import least
from rbfmu.ensembles.planning import plan_ensemble
from rbfmu.plot import COLORS, Picture, open_frame

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "detumbling.toml"
RUNS = (1_000, 10_000, 100_000, 1_000_000)
MANY = (*RUNS, 10_000_000)
"""Of what has a closed form."""
LEAST_OF_THREADS, LEAST_OF_DASK, MOST_SECONDS, MOST_GROWTH, MOST_MB = 1.8, 0.85, 60.0, 1.25, 100.0
"""Two threads over one; Dask over threads; of the example, s; of the cost of a run and of memory, from 1e4 runs on."""
MOST_BYTES = 200.0
"""Of a run in memory: its 20 numbers, applied and at the end, and a quarter more."""
_VARY = {
    "body.inertia": {"relative": 0.02},
    "initial.omega_b": {"normal": [[0.1, -0.2, 0.15], [0.02, 0.02, 0.02]]},
}
_COMMON = {
    "body": {"mass": 50.0, "inertia": [2.0, 2.6, 3.1]},
    "initial": {"omega_b": [0.1, -0.2, 0.15]},
    "outputs": {"quantities": ["quaternion", "omega_b"]},
}
_DAMPED = {"gravity_a": [0.0, 0.0, 0.0], "damping_b": [0.02, 0.02, 0.02]}
IN_MEMORY = "free, ends alone, in memory"
SHAPES = {
    "free, ends alone": _COMMON | {
        "loads": {"gravity_a": [0.0, 0.0, 0.0]}, "run": {"stop": 60.0, "step": 20.0},
        "ensemble": {"vary": _VARY, "keep": ["final"]}},
    "damped, statistics at 13 times": _COMMON | {
        "loads": _DAMPED, "run": {"stop": 60.0, "step": 5.0}, "ensemble": {"vary": _VARY}},
}  # fmt: skip
SHAPES[IN_MEMORY] = SHAPES["free, ends alone"]
LONG = _COMMON | {
    "initial": {"omega_b": [0.6, -1.0, 0.8]},
    "loads": {"gravity_a": [0.0, 0.0, 0.0], "damping_b": [1e-5, 1e-5, 1e-5]},
    "run": {"stop": 2000.0, "step": 10.0},
    "ensemble": {"vary": {"body.inertia": {"relative": 0.02}}},
}
"""Runs of some milliseconds."""


class Cost(NamedTuple):
    """The CPU time (s) and the most memory (MB) of so many runs."""

    shape: str
    runs: int
    seconds: float
    megabytes: float


def scene_of(tables: dict[str, Any]) -> rbfmu.Scene:
    """Return a scene of these tables."""
    return rbfmu.Scene.from_dict({"name": "satellite"} | tables)


def cost_here(shape: str, runs: int) -> tuple[float, float]:
    """Return CPU time (s) and memory (MB) of runs in this process that are kept in a store, or in memory."""
    scene = scene_of(SHAPES[shape])
    plan = plan_ensemble(scene)
    with tempfile.TemporaryDirectory() as folder:

        def run(number: int, name: str) -> Any:
            store = None if shape == IN_MEMORY else Path(folder) / f"{name}.zarr"
            return rbfmu.run_ensemble(scene, store, runs=number, planned=plan)

        # more than 10,000 runs take other functions to draw: those of both are loaded
        for number in (100, 20_000):
            run(number, str(number))
        begin = process_time()
        run(runs, "store")
        taken = process_time() - begin
    return taken, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def costs(counts: tuple[int, ...] = ()) -> list[Cost]:
    """Return the costs of all shapes, each in a process of its own."""
    found = []
    for shape in SHAPES:
        for runs in counts or (MANY if shape.startswith("free") else RUNS):
            command = [sys.executable, "-m", "examples.benchmarks.ensembles", "--one", shape, str(runs)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
            seconds, megabytes = map(float, done.stdout.split())
            found.append(Cost(shape, runs, seconds, megabytes))
            each = 1e6 * seconds / runs
            print(f"{shape}: {runs:,} runs {seconds:.2f} s of CPU, {each:.1f} us a run, {megabytes:.0f} MB")
    return found


def executors(rounds: int = 5, runs: int = 4096, overhead: int = 64) -> dict[str, float]:
    """Return ratios of throughputs, and what a chunk costs besides, ms."""
    from distributed import Client, LocalCluster

    scene = scene_of(LONG).replace({"ensemble.runs": runs})
    plan = plan_ensemble(scene)
    short = scene.replace({"run.stop": 20.0, "ensemble.runs": overhead, "ensemble.keep": ["final"]})
    alone = replace(plan, cost=1e9)  # chunks of one run

    def run(executor: Any) -> Callable[[], Any]:
        return lambda: rbfmu.run_ensemble(scene, executor=executor, planned=plan)

    def run_alone(executor: Any) -> Callable[[], Any]:
        return lambda: rbfmu.run_ensemble(short, executor=executor, planned=alone)

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        long = {"one": run(1), "two": run(2), "dask": run(client)}
        for call in (*long.values(), run_alone(client), run_alone(2)):
            call()  # workers compile or load
        times = least(rounds, long)
        besides = least(rounds, {"threads": run_alone(2), "dask": run_alone(client)})
    print(f"{1e3 * times['one'] / runs:.2f} ms a run; two threads {times['one'] / times['two']:.2f} times one, "
          f"two workers of Dask {times['two'] / times['dask']:.2f} times two threads")  # fmt: skip
    per_chunk = {name: 1e3 * seconds / overhead for name, seconds in besides.items()}
    print(f"a chunk of one short run: {per_chunk['threads']:.2f} ms by threads, {per_chunk['dask']:.2f} ms by Dask")
    return {
        "threads": times["one"] / times["two"],
        "dask": times["two"] / times["dask"],
        "overhead of threads": per_chunk["threads"],
        "overhead of dask": per_chunk["dask"],
    }


def example(runs: int | None = None) -> float:
    """Return what the example's ten thousand runs and their picture take, s, in a process of their own."""
    code = f"import rbfmu; rbfmu.run_ensemble({str(EXAMPLE)!r}, runs={runs!r}).plot('detumbling.png')"
    with tempfile.TemporaryDirectory() as folder:
        begin = perf_counter()
        subprocess.run([sys.executable, "-c", code], cwd=folder, check=True)
        taken = perf_counter() - begin
    print(f"the example with its picture: {taken:.1f} s")
    return taken


def draw(found: list[Cost], path: Path) -> None:
    """Draw cost and memory against the number of runs."""
    figure = Picture(figsize=(8.0, 3.6), layout="constrained")
    panels = figure.subplots(1, 2)
    for shape, color in zip(SHAPES, COLORS, strict=False):
        rows = [row for row in found if row.shape == shape]
        runs = [row.runs for row in rows]
        panels[0].loglog(runs, [row.seconds for row in rows], "o-", color=color, label=shape)
        panels[1].loglog(runs, [row.megabytes for row in rows], "o-", color=color)
        if shape == IN_MEMORY:
            grown = (rows[-1].megabytes - rows[0].megabytes) / (rows[-1].runs - rows[0].runs)
            panels[1].loglog(runs, [grown * n for n in runs], "--", color=color, linewidth=0.8)
        each = rows[-1].seconds / rows[-1].runs
        panels[0].loglog(runs, [each * n for n in runs], "--", color=color, linewidth=0.8)
    panels[0].set_ylabel("CPU time (s); dashed: proportional")
    panels[1].set_ylabel("memory (MB); dashed: of the runs alone")
    panels[1].set_ylim(0.05 * min(row.megabytes for row in found), 2.0 * max(row.megabytes for row in found))
    for axes in panels:
        axes.set_xlabel("runs")
        open_frame(axes, grid=True)
    panels[0].legend(frameon=False, fontsize=8)
    figure.suptitle("Many runs cost at most in proportion to their number, and in a store hardly memory", fontsize=11)
    figure.savefig(path, dpi=130)


def main(folder: Path, counts: tuple[int, ...] = (), **few: int) -> dict[str, Any]:
    """Print and return all figures."""
    folder.mkdir(parents=True, exist_ok=True)
    found = costs(counts)
    draw(found, folder / "ensembles.png")
    return {"costs": found, "example": example(), **executors(**few)}


def goals(figures: dict[str, Any]) -> list[Goal]:
    """Of what `main` returns."""
    named = [
        Goal("two threads / one", figures["threads"], least=LEAST_OF_THREADS),
        Goal("Dask / threads", figures["dask"], least=LEAST_OF_DASK),
        Goal("seconds of the example", figures["example"], most=MOST_SECONDS),
    ]
    for shape in SHAPES:
        rows = {row.runs: row for row in figures["costs"] if row.shape == shape}
        few, many = rows[RUNS[1]], rows[max(rows)]
        growth = (many.seconds / many.runs) / (few.seconds / few.runs)
        named.append(Goal(f"{shape}: cost of a run, {many.runs:,} / {few.runs:,}", growth, most=MOST_GROWTH))
        grown = many.megabytes - few.megabytes
        if shape == IN_MEMORY:
            named.append(Goal(f"{shape}: bytes a run", 1e6 * grown / (many.runs - few.runs), most=MOST_BYTES))
        else:
            named.append(Goal(f"{shape}: MB more for {many.runs:,}", grown, most=MOST_MB))
    return named


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(*cost_here(sys.argv[2], int(sys.argv[3])))
    else:
        raise SystemExit(status(goals(main(Path(sys.argv[1] if len(sys.argv) > 1 else "bench")))))
