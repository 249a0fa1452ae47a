"""What would be lost without four parts of rbfmu that are suspected of not being worth their lines.

`python -m examples.benchmarks.weighed [PART ...]`, of:
- dop853: a body under loads by DOP853, which no plan chooses, against plans of the same accuracy;
- free: the exact motion of a torque-free body, against Taylor series of the same accuracy;
- rates: the series of prescribed rates that change within a step, against rates held in ever shorter steps;
- interrupt: Ctrl-C at any moment of a run, with and without `rbfmu.__main__.interruptible`.
Times are of one run, taken in turn; below 1 the part is faster than what is left without it.
"""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

import rbfmu
from examples.benchmarks.support.goals import known
from rbfmu.models.registry import MODELS
from rbfmu.runs.plan import filled_buffer, initialize
from rbfmu.studies.chart.cases import CASES, Case
from rbfmu.studies.chart.methods import Method, NotFeasibleError, Run, closed_form, planned, substeps

ACCURACIES = (1e-3, 1e-6, 1e-9, 1e-12)
ORDERS = (6, 8, 12, 16, 20, 24)
ROUNDS, SECONDS = 9, 0.02
SCENE = Path(__file__).parents[1] / "scenes" / "top_precessing.toml"


def first_within(method: Method, case: Case, accuracy: float) -> Run | None:
    """Return the run of the coarsest setting whose error is within the accuracy."""
    for value in method.settings(case, False):
        run = method.run(case, value)
        if case.error(run.found) <= accuracy:
            return run
    return None


def least_seconds(runs: dict[str, Run]) -> dict[str, float]:
    """Return the least processor time of one solution of each, in interleaved rounds."""
    for run in runs.values():
        run.seconds(1)  # compiles
    counts = {name: max(1, round(SECONDS / max(run.seconds(1), 1e-7))) for name, run in runs.items()}
    least = dict.fromkeys(runs, np.inf)
    for _ in range(ROUNDS):
        for name, run in runs.items():
            least[name] = min(least[name], run.seconds(counts[name]) / counts[name])
    return least


def best_of(methods: Iterable[Method], case: Case, accuracy: float) -> dict[str, Run]:
    """Return the runs of methods that reach an accuracy, by name."""
    found = {method.name: first_within(method, case, accuracy) for method in methods}
    return {name: run for name, run in found.items() if run is not None}


def dop853(keys: Sequence[str] = ("c", "c'", "d", "f")) -> dict[str, float]:
    """Return DOP853's time over that of the plan, by motion and accuracy."""
    ratios = {}
    for key in keys:
        for accuracy in ACCURACIES:
            runs = best_of([substeps(0)], CASES[key], accuracy)
            try:
                runs["plan"] = planned().run(CASES[key], accuracy)
            except NotFeasibleError:
                continue
            least = least_seconds(runs)
            ratio = least.get("DOP853, error control", np.inf) / least["plan"]
            ratios[f"{CASES[key].scene.name}, {accuracy:g}: DOP853 / plan ({runs['plan'].detail})"] = ratio
    return ratios


def free(keys: Sequence[str] = ("a", "b")) -> dict[str, float]:
    """Return the exact motion's time over that of the fastest Taylor series, by motion and accuracy."""
    ratios = {}
    for key in keys:
        for accuracy in ACCURACIES[:3]:
            series = best_of(map(substeps, ORDERS), CASES[key], accuracy)
            least = least_seconds(series | {"exact": closed_form(MODELS["torque-free body"]).run(CASES[key], 5.0)})
            name = min(series, key=least.__getitem__)
            ratios[f"{CASES[key].scene.name}, {accuracy:g}: exact / {name}"] = least["exact"] / least[name]
    return ratios


def attitude_of_changing_rates(step: float, parts: int, slopes: bool) -> np.ndarray:
    """Return the attitude after 60 s; without slopes the rate of the middle of each of `parts` parts is held."""
    scene = rbfmu.Scene(
        inputs={"ports": ["omega_b"]}, outputs={"quantities": ["quaternion"]}, run={"stop": 60.0, "step": step}
    )
    planned = rbfmu.plan(scene)
    kernels, z = planned.kernels, filled_buffer(scene, planned)
    initialize(scene, kernels, z)
    h, phases = step / parts, np.arange(3.0)
    for k in range(round(60.0 / h)):
        t = k * h
        z[kernels.BLOCKS["omega_b"]] = np.sin(0.5 * (t if slopes else t + 0.5 * h) + phases)
        if slopes:
            z[kernels.BLOCKS["omega_b_rate"]] = 0.5 * np.cos(0.5 * t + phases)
            z[kernels.BLOCKS["omega_b_rate_2"]] = -0.25 * np.sin(0.5 * t + phases)
        assert kernels.step(z, h) == 0
    return z[kernels.BLOCKS["quaternion"]].copy()


def rates() -> dict[str, float]:
    """Return attitude errors in degrees, steps of 0.1 s: with two derivatives, and held in parts of the step."""
    true = attitude_of_changing_rates(0.001, 1, True)
    found = {"two derivatives, a step of 0.1 s": attitude_of_changing_rates(0.1, 1, True)}
    found |= {f"held at the middle, {n} parts": attitude_of_changing_rates(0.1, n, False) for n in (1, 10, 100)}
    return {f"{name}: deg off": float(np.degrees(rbfmu.angle_between(q, true))) for name, q in found.items()}


PROGRAM = """
import contextlib, sys
import rbfmu.__main__ as entry

if {without}:
    entry.interruptible = contextlib.nullcontext
print("started", flush=True)
sys.argv[1:] = ["run", {scene!r}, "--stop", "2000"]
entry.main()
"""


def struck(without: bool, seconds: float) -> str:
    """Return how a run ended that was interrupted so long after its start."""
    program = PROGRAM.format(without=without, scene=str(SCENE))
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout
    process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    said = process.communicate()[1]
    noisy = "Traceback" in said or "ignored" in said
    return f"status {process.returncode}" + (" with a traceback" if noisy else "")


def interrupt() -> dict[str, float]:
    """Return how many of 30 runs ended in which way: status 130 says that Ctrl-C was struck, 1 that a check failed."""
    found: dict[str, float] = {}
    for k in range(30):
        for without in (False, True):
            ending = f"{'without' if without else 'with'} interruptible: {struck(without, 0.1 * k)}"
            found[ending] = found.get(ending, 0.0) + 1.0
    return dict(sorted(found.items()))


PARTS: dict[str, Callable[[], dict[str, float]]] = {
    "dop853": dop853, "free": free, "rates": rates, "interrupt": interrupt,
}  # fmt: skip


def main(names: list[str]) -> None:
    """Print the figures of the parts named, or of all."""
    for name in known(names, PARTS) or PARTS:
        print(f"{name}: {(PARTS[name].__doc__ or '').splitlines()[0]}")
        for what, figure in PARTS[name]().items():
            print(f"  {what:80}{figure:12.3g}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
