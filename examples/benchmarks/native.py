"""What a communication step of the native FMU costs: beside a Numba loop, C by hand, and the pythonfmu FMU.

Per step: fmi2DoStep and reading all outputs, from C (native.c); in the Numba loop the unit's `step` and a copy
of its outputs. By hand: the same series in plain C, -O3, behind the same C layer (native_by_hand.c), with AVX2
and without, chosen as the native FMU's step is. All in turn in one process: medians of ratios. First step: from the
start of a process to the end of its first step, beside an FMU that does nothing. `python -m examples.benchmarks.native`
prints the tables and exits with status 1 where a goal is missed; it needs a C compiler.
"""

import ctypes
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

import rbfmu
from examples.benchmarks.fmu import Fmu, _seconds_to_first_step
from examples.benchmarks.support.goals import Goal, status
from rbfmu.planning.select import plan
from rbfmu.runs.plan import Plan, filled_buffer, initialize
from rbfmu_fmu.builder import build, c_sources
from rbfmu_fmu.description import describe
from rbfmu_fmu.model_description import FMI2
from rbfmu_fmu.native.headers import headers
from rbfmu_fmu.native.object_code import ENTRIES, object_files
from rbfmu_fmu.native.platforms import FLAGS, compiler, link, source, this_platform

FOLDER = Path(__file__).parent
GOALS = {"numba loop": 1.2, "by hand": 1.0, "pythonfmu": 1.0, "first step": 1.1}
"""Largest ratios of the native FMU to the others."""
ROUND_OFF = 1e-11
"""Of C by hand and the native FMU, after 6e4 steps."""
STEP = 0.01
BODY = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5]}
RATES = {"omega_b": [0.1, 0.2, 0.3]}
TABLES = {
    "prescribed rates": {"inputs": {"ports": ["omega_b"]}},
    "torque-free body": {"body": BODY, "initial": RATES},
    "body under loads": {"body": BODY, "initial": RATES, "inputs": {"ports": ["torque_b"]}},
}
HAND = "series and by hand"
NOTHING = "#include <stdint.h>\n" + "".join(
    f"int64_t {name} {{ return 0; }}\n" for name in ("initialize(double *z)", "step(double *z, double h)",
                                                     "outputs(double *z)", "output_rates(double *z)",
                                                     "feedthrough(double *z, double *change)")
)  # fmt: skip

Timer = Callable[[int, int], float]
"""Seconds per step of so many steps from a first one on."""


def _scene(name: str) -> rbfmu.Scene:
    run = {"stop": 1e4, "step": STEP, "accuracy": 1e-6}
    tables = TABLES.get(name) or TABLES["body under loads"] | {
        "outputs": {"quantities": ["quaternion", "rpy", "omega_b"]}
    }
    return rbfmu.Scene.from_dict({"name": "bench", "run": run} | tables)


def _numba_timer(scene: rbfmu.Scene, planned: Plan) -> Timer:
    kernels, z = planned.kernels, filled_buffer(scene, planned)
    offsets = np.array([v.offset for v in describe(scene, planned).variables if v.causality == "output"])
    initialize(scene, kernels, z)
    step, taken = kernels.step, np.empty(len(offsets))

    @njit
    def steps_of(z: Any, taken: Any, h: float, steps: int) -> int:
        bad = 0
        for _ in range(steps):
            bad |= step(z, h)
            for i in range(len(offsets)):
                taken[i] = z[offsets[i]]
        return bad

    steps_of(z, taken, STEP, 1)

    def seconds(first: int, steps: int) -> float:
        begin = time.perf_counter()
        assert steps_of(z, taken, STEP, steps) == 0
        return (time.perf_counter() - begin) / steps

    return seconds


class Running:
    """An FMU's instance after one step, driven from C."""

    def __init__(self, fmu: Fmu, driver: ctypes.CDLL) -> None:
        library, guid, resources, _, outputs, _ = fmu.arguments
        self.lib, zero = ctypes.CDLL(library), ctypes.c_double(0.0)
        self.logger = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, ctypes.c_int, *[ctypes.c_void_p] * 2)(print)
        self.callbacks = (ctypes.c_void_p * 5)(ctypes.cast(self.logger, ctypes.c_void_p))
        self.lib.fmi2Instantiate.restype = ctypes.c_void_p
        texts = guid.encode(), resources.encode()
        it = ctypes.c_void_p(self.lib.fmi2Instantiate(b"it", 1, *texts, ctypes.byref(self.callbacks), 0, 0))
        self.lib.fmi2SetupExperiment(it, 0, zero, zero, 0, zero)
        self.lib.fmi2EnterInitializationMode(it)
        assert self.lib.fmi2ExitInitializationMode(it) == 0
        self.values = (ctypes.c_double * len(outputs))()
        self._instance = it
        self._arguments = it, (ctypes.c_uint * len(outputs))(*outputs), ctypes.c_size_t(len(outputs)), self.values
        self._driver = driver
        self.seconds(0, 1)

    def seconds(self, first: int, steps: int) -> float:
        """Return a `Timer`."""
        found: float = self._driver(
            self.lib.fmi2DoStep, self.lib.fmi2GetReal, *self._arguments, ctypes.c_double(STEP),
            ctypes.c_long(first), ctypes.c_long(steps),
        )  # fmt: skip
        assert found > 0.0
        return found

    def end(self) -> list[float]:
        """Free the instance; what was read last."""
        self.lib.fmi2FreeInstance(self._instance)
        return list(self.values)


def _compile(text: str, folder: Path, includes: dict[str, str], *flags: str) -> bytes:
    """Return a C source, compiled as the C layer is but for -O3."""
    (folder / "source.c").write_text(text)
    for name, content in includes.items():
        (folder / name).write_text(content)
    command = [*compiler(this_platform()), *FLAGS, "-O3", "-fPIC", *flags, "source.c", "-o", "result"]
    if "-c" in flags:
        command.remove("-shared")
        command.remove("-s")
    subprocess.run(command, cwd=folder, check=True)
    return (folder / "result").read_bytes()


def _driver(folder: Path) -> Any:
    _compile((FOLDER / "native.c").read_text(), folder, {}, "-fvisibility=default")
    function = ctypes.CDLL(str(folder / "result")).seconds_per_step
    function.restype = ctypes.c_double
    return function


def _objects(text: str, folder: Path, planned: Plan) -> dict[str, bytes]:
    """Return a C source compiled as `object_files` compiles a model."""
    places = planned.kernels.BLOCKS
    layout = "".join(f"#define AT_{name.upper()} {b.start}\n" for name, b in places.items())
    layout += "".join(f"#define SIZE_{name.upper()} {b.stop - b.start}\n" for name, b in places.items())
    folder.mkdir()
    includes = {"layout.h": layout}
    objects = {"model.o": _compile(text, folder, includes, "-c")}
    for feature in this_platform().features:
        renamed = [f"-Dstep=step_{feature}", *(f"-D{name}=other_{name}" for name in ENTRIES if name != "step")]
        objects[f"step_{feature}.o"] = _compile(text, folder, includes, "-c", f"-m{feature}", *renamed)
    return objects


def _with_other_unit(fmu: Fmu, place: Path, generated: dict[str, str], objects: dict[str, bytes]) -> Fmu:
    """Return the native FMU with these objects in its unit's place."""
    library, guid, *others = fmu.arguments
    place.mkdir()
    other = place / Path(library).name
    other.write_bytes(link(c_sources(FMI2), objects, this_platform(), other.stem, generated))
    found = Fmu.__new__(Fmu)
    found.names, found.arguments = fmu.names, [str(other), guid, *others]
    return found


def _row(text: str, costs: dict[str, list[float]]) -> dict[str, float]:
    """Print medians in ns and of the ratios of the native FMU to the others; return the ratios."""
    ratios = {
        other: statistics.median(a / b for a, b in zip(costs["native"], values, strict=True))
        for other, values in costs.items()
        if other != "native"
    }
    nanoseconds = {name: statistics.median(values) * 1e9 for name, values in costs.items()}
    print(f"{text:20}", *(f"{name} {value:9.1f}" for name, value in nanoseconds.items()), sep="  ")
    print(f"{'  native / other':20}", *(f"{name} {value:9.3f}" for name, value in ratios.items()), sep="  ")
    return ratios


def _costs(scene: rbfmu.Scene, planned: Plan, fmus: dict[str, Fmu], driver: Any, repeats: int, steps: int) -> Any:
    """Seconds per step by competitor, in turn; what each FMU read last."""
    running = {name: Running(fmu, driver) for name, fmu in fmus.items()}
    timers: dict[str, Timer] = {name: one.seconds for name, one in running.items()}
    timers["numba loop"] = _numba_timer(scene, planned)
    costs: dict[str, list[float]] = {name: [] for name in timers}
    for k in range(repeats):
        for name, timer in timers.items():
            costs[name].append(timer(1 + k * steps, steps))
    return costs, {name: one.end() for name, one in running.items()}


def _figures_of(text: str, folder: Path, driver: Any, repeats: int, steps: int, starts: int) -> dict[str, float]:
    folder.mkdir()
    scene = _scene(text)
    planned = plan(scene)
    fmus = {
        "native": Fmu(build(scene, folder / "native.fmu", "native", planned=planned), folder / "native"),
        "pythonfmu": Fmu(build(scene, folder / "python.fmu", planned=planned), folder / "python"),
    }
    described = describe(scene, planned)
    generated = headers(described, FMI2, fmus["native"].arguments[1])
    if text == HAND:
        fmus |= _others(fmus["native"], folder, generated, planned)
    costs, values = _costs(scene, planned, fmus, driver, repeats, steps)
    figures = _row(text, costs)
    if text == HAND:
        ratios = [a / b for a, b in zip(costs["without AVX2"], costs["by hand without AVX2"], strict=True)]
        figures["both without AVX2"] = statistics.median(ratios)
        print(f"  native / by hand, both without AVX2: {figures['both without AVX2']:.3f}")
        pairs = zip(values["native"], values["by hand"], strict=True)
        figures["difference"] = max(abs(a - b) for a, b in pairs)
        print(f"  by hand differs by {figures['difference']:.1e} after {repeats * steps} steps")
        nothing = _objects(NOTHING, folder / "nothing", planned)
        nothing = _with_other_unit(fmus["native"], folder / "idle", generated, nothing)
        figures["first step"] = _first_step(fmus["native"], nothing, starts)
    return figures


def _others(native: Fmu, folder: Path, generated: dict[str, str], planned: Plan) -> dict[str, Fmu]:
    """C by hand; and it and the native FMU without AVX2."""
    by_hand = _objects((FOLDER / "native_by_hand.c").read_text(), folder / "source", planned)
    baseline = generated | {"model.h": "#define USES_AVX2 0\n" + source("model.h").decode()}
    own = object_files(planned.kernels, this_platform())
    return {
        "by hand": _with_other_unit(native, folder / "hand", generated, by_hand),
        "without AVX2": _with_other_unit(native, folder / "baseline", baseline, own),
        "by hand without AVX2": _with_other_unit(native, folder / "hand baseline", baseline, by_hand),
    }


def _first_step(native: Fmu, nothing: Fmu, starts: int) -> float:
    times = [[_seconds_to_first_step(fmu) for fmu in (native, nothing)] for _ in range(starts)]
    ratio = statistics.median(a / b for a, b in times)
    milliseconds = statistics.median(a for a, _ in times) * 1e3
    print(f"first step of a process: {milliseconds:.1f} ms, {ratio:.3f} times that of an FMU that does nothing")
    return ratio


def main(
    repeats: int = 301, steps: int = 200, starts: int = 15, names: Sequence[str] = (*TABLES, HAND)
) -> dict[str, dict[str, float]]:
    """Print the table; ratios by scene. Many short blocks: each fits between the interruptions of a busy machine."""
    print(f"ns per step (fmi2DoStep, all outputs), medians; ratios at most: {GOALS}")
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        driver = _driver(place)
        return {
            text: _figures_of(text, place / str(number), driver, repeats, steps, starts)
            for number, text in enumerate(names)
        }


def goals(by_scene: dict[str, dict[str, float]]) -> list[Goal]:
    """Of the figures that `main` returns."""
    found = [
        Goal(f"{scene}, native / {other}", figures[other], most=most)
        for scene, figures in by_scene.items()
        for other, most in GOALS.items()
        if other in figures
    ]
    return [*found, Goal(f"{HAND}, difference", by_scene[HAND]["difference"], most=ROUND_OFF)]


if __name__ == "__main__":
    raise SystemExit(status(goals(main())))
