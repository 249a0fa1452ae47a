"""The demonstration: NASA's tumbling brick, simulated by the kernels, by FMPy's API and by the command `fmpy`.

NASA/TM-2015-218675, "Check-Cases for Verification of 6-Degree-of-Freedom Flight Vehicle Simulations", atmospheric
case 2 (tumbling brick, no damping). Simulations 01 and 04 agree with Euler's equations to their printed digits.
"""

import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import fmpy
import numpy as np
from rich.console import Console
from rich.table import Table

import rbfmu
from rbfmu import Plan, Result, Scene
from rbfmu.plot import COLORS, Picture, draw_components, open_frame, with_file
from rbfmu.types import Array, NDArray
from rbfmu_fmu import builder, verification
from rbfmu_kernels import ZYX, Quaternion, compose_quaternions, euler_from_quaternion, quaternion_from_euler
from rbfmu_kernels.compile.tiered import evaluated, tiered
from rbfmu_kernels.rotations.quaternion import angle_between

RATE_BOUND, ATTITUDE_BOUND = 1e-9, 1e-4
"""Bounds in deg/s and deg. NASA's simulations 01 and 04 agree with Euler's equations to 4e-10 and 6e-5, that is, to
their printed digits."""

FMPY_ROUNDS = tuple(map(int, fmpy.__version__.split(".")[:3])) < (0, 3, 24)
"""Whether runs in this FMPy differ by round-off: older ones write 16 digits, or compute steps from rounded times."""
ROUND_OFF = 1e-13 if FMPY_ROUNDS else 0.0

Columns = dict[str, Array]


class Way(NamedTuple):
    """One way of simulating: its columns by FMU variable name, and its cost per communication step in s."""

    name: str
    columns: Columns
    cost: float


def scene_file(name: str) -> Path:
    """Return the path of a scene of the gallery: in the installed package, or in `examples/scenes` of a clone."""
    package = Path(rbfmu.__file__).parent
    for folder in (package / "scenes", package.parent / "examples" / "scenes"):
        if (folder / name).exists():
            return folder / name
    raise FileNotFoundError(2, "no such scene in this installation", name)


def run_demo(folder: Path, console: Console) -> bool:
    """Run the demonstration, write its files to `folder` and print tables; return whether all results agree."""
    verification.check_plain(tempfile.gettempdir())
    folder.mkdir(parents=True, exist_ok=True)
    with _stage(console, "planning"):
        scene = rbfmu.load_scene(scene_file("tumbling_brick.toml"))
        planned = rbfmu.plan(scene)
    with _stage(console, "simulating with the kernels"):
        result, kernels = _by_kernels(scene, planned)
        result.save(folder / "kernels.csv")
    with _stage(console, "building the FMU"):
        fmu = builder.build(scene, folder / "tumbling_brick.fmu", planned=planned)
    with _stage(console, "simulating the FMU through FMPy's API"):
        by_api = _by_api(fmu, list(kernels.columns)[1:])
    with _stage(console, "simulating the FMU through the fmpy command"):
        by_command = _by_command(fmu, folder / "fmpy_command.csv", list(kernels.columns)[1:])
    with _stage(console, "verifying the FMU against the kernels"):
        verified = verification.verify(fmu)
    with _stage(console, "drawing"):
        draw(result, folder / "tumbling_brick.png")
    passed = _report(console, scene, planned, result, [kernels, by_api, by_command], verified)
    names = ("tumbling_brick.png", "tumbling_brick.fmu", "kernels.csv", "kernels.units.csv", "fmpy_command.csv")
    console.print(f"written to {folder}/: {', '.join(names)}")
    return passed


def _by_kernels(scene: Scene, planned: Plan) -> tuple[Result, Way]:
    start = perf_counter()
    result = rbfmu.simulate(scene, planned=planned)
    seconds = perf_counter() - start
    compiled = getattr(tiered(planned.kernels.step), "is_compiled", False)  # for so short a run, compiling does not pay
    name = "compiled kernels" if compiled else "kernels, plain Python"
    return result, Way(name, result.columns(), seconds / (len(result.time) - 1))


def _by_api(fmu: Path, outputs: list[str]) -> Way:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        fmpy.extract(str(fmu), folder)
        for _ in range(2):  # the first run also loads the code
            start = perf_counter()
            recorded = fmpy.simulate_fmu(folder, validate=False, output=outputs)
            seconds = perf_counter() - start
    return _way("FMU, FMPy's API", recorded, seconds)


def _by_command(fmu: Path, target: Path, outputs: list[str]) -> Way:
    command = [sys.executable, "-m", "fmpy", "simulate", str(fmu), "--output-file", str(target)]
    asked = [*command, "--output-variables", *outputs]
    start = perf_counter()
    done = subprocess.run(asked, capture_output=True, check=False, encoding="utf-8", errors="replace")
    seconds = perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return _way("FMU, fmpy command", fmpy.read_csv(target), seconds)


def _way(name: str, recorded: NDArray[np.void], seconds: float) -> Way:
    return Way(name, {n: recorded[n] for n in recorded.dtype.names or ()}, seconds / (len(recorded) - 1))


def _largest_difference(a: Columns, b: Columns) -> float:
    """Return the largest difference over all columns; infinite if a point or a column is missing."""
    if a.keys() != b.keys() or any(len(a[n]) != len(b[n]) for n in a):
        return float("inf")
    return max(float(np.max(np.abs(a[n] - b[n]))) for n in a)


def _report(
    console: Console, scene: Scene, planned: Plan, result: Result, ways: list[Way], verified: verification.Verification
) -> bool:
    """Print the tables of errors and costs, and the verdict; return whether all results agree."""
    console.print(f"\nNASA's tumbling brick, {scene.run.stop:g} s: {planned.method}, {planned.reasons[-1]}")
    heads = [f"{what}\nagainst {s}" for s in NASA for what in ("rates, deg/s", "attitude, deg")]
    against = Table("t (s)", *heads, title="errors against NASA/TM-2015-218675, case 2")
    found = {s: errors_against_nasa(s, result.time, result.quaternion, result.omega_b) for s in NASA}
    for rows in zip(*found.values(), strict=True):
        against.add_row(f"{rows[0][0]:g}", *(f"{x:.1e}" for row in rows for x in row[1:]))
    console.print(against)
    costs = Table("way", "difference to the kernels", "µs a step")
    differences = [_largest_difference(way.columns, ways[0].columns) for way in ways]
    for way, difference in zip(ways, differences, strict=True):
        note = " (with the process's start)" if "command" in way.name else ""
        costs.add_row(way.name, repr(difference), f"{1e6 * way.cost:.3g}{note}")
    costs.add_row("verify, seeded inputs", repr(max(verified.differences.values())), "")
    console.print(costs)
    for problem in verified.problems:
        console.print(f"problem: {problem}")
    errors = [row for rows in found.values() for row in rows]
    near = all(rate <= RATE_BOUND and attitude <= ATTITUDE_BOUND for _, rate, attitude in errors)
    same = all(d <= ROUND_OFF for d in differences)
    agreement = f"the same but for what FMPy {fmpy.__version__} rounds" if FMPY_ROUNDS else "the same bits"
    verdict = f"{agreement} in all three ways" if same else "the ways DIFFER"
    bound = f"rates within {RATE_BOUND:g} deg/s, attitude within {ATTITUDE_BOUND:g} deg"
    console.print(f"{verdict}; NASA: {bound}: {'yes' if near else 'NO'}")
    return near and verified.passed and same


def draw(result: Result, path: Path) -> None:
    """Draw the brick's motion and its errors against NASA's simulations; marks that coincide differ in size."""
    figure = Picture(figsize=(8.4, 7.2), layout="constrained")
    rates, angles, error = figure.subplots(3, 1, sharex=True, height_ratios=(1.1, 1.1, 1.0))
    draw_components(rates, result.time, np.degrees(result.omega_b), ("p", "q", "r"))
    turned = np.degrees(local_angles(result.time, result.quaternion))
    draw_components(angles, result.time, turned, ("yaw", "pitch", "roll"), turn=360.0)
    nasa = np.array(NASA["01"])
    for k in range(3):
        for axes, first in ((rates, 1), (angles, 4)):
            axes.plot(nasa[:, 0], nasa[:, first + k], "o", color=COLORS[k], markersize=10 - 3 * k, fillstyle="none")
    marks = {"01": {"marker": "o", "markersize": 10, "fillstyle": "none"}, "04": {"marker": "s", "markersize": 4}}
    for simulation, mark in marks.items():
        found = np.array(errors_against_nasa(simulation, result.time, result.quaternion, result.omega_b))
        for k, label in ((1, f"rates against {simulation}, deg/s"), (2, f"attitude against {simulation}, deg")):
            error.semilogy(found[:, 0], found[:, k], linestyle="", color=COLORS[k - 1], label=label, **mark)
    for bound, k in ((RATE_BOUND, 0), (ATTITUDE_BOUND, 1)):
        error.axhline(bound, color=COLORS[k], linewidth=0.8, linestyle="--")
    error.set(xlabel="time (s)", ylabel="error against NASA\n(dashed: bound)", ylim=(1e-13, 1e-2))
    open_frame(error, legend=True)
    rates.set_ylabel("body rates (deg/s)")
    angles.set_ylabel("attitude in\nnorth-east-down (deg)")
    figure.suptitle("NASA's tumbling brick: rbfmu (lines) and NASA's simulation 01 (circles)", fontsize=11)
    with_file(figure, path)


@contextmanager
def _stage(console: Console, text: str) -> Iterator[None]:
    """Show a spinner on a terminal during a stage, and then print the time that it took."""
    start = perf_counter()
    with console.status(text + " ..."):
        yield
    console.print(f"{text}: {perf_counter() - start:.1f} s")


# --- NASA's figures

EARTH_RATE = 7.292115e-5
"""The rate of the earth, rad/s, which turns under the brick about the north axis of the local frame at the equator."""


_TABLE = Path(__file__).with_name("nasa_brick.csv").read_text(encoding="ascii").splitlines()
_, *_ROWS = csv.reader(line for line in _TABLE if not line.startswith("#"))
NASA = {name: tuple(tuple(map(float, row[1:])) for row in rows) for name, rows in groupby(_ROWS, lambda row: row[0])}
"""The rows of nasa_brick.csv by simulation: time (s), three rates (deg/s), and yaw, pitch and roll (deg)."""


def errors_against_nasa(simulation: str, time: Array, q_ab: Array, omega_b: Array) -> list[tuple[float, float, float]]:
    """Return (time in s, largest rate error in deg/s, attitude error in deg) at NASA's times that the motion has."""
    found = []
    for row in NASA[simulation]:
        k = int(np.argmin(np.abs(time - row[0])))
        if abs(time[k] - row[0]) < 1e-9:
            rate = float(np.max(np.abs(np.degrees(omega_b[k]) - row[1:4])))
            yaw, pitch, roll = np.radians(row[4:7]).tolist()
            q_nb = evaluated(quaternion_from_euler, ZYX, (yaw, pitch, roll))
            (local,) = _local_attitudes(np.array([row[0]]), q_ab[k : k + 1])
            found.append((row[0], rate, float(np.degrees(evaluated(angle_between, local, q_nb)))))
    return found


def local_angles(time: Array, q_ab: Array) -> Array:
    """Return yaw, pitch and roll (n, 3), rad, relative to north-east-down; frame a is that frame at time 0, fixed."""
    return np.array([evaluated(euler_from_quaternion, ZYX, q) for q in _local_attitudes(time, q_ab)])


def _local_attitudes(time: Array, q_ab: Array) -> list[Quaternion]:
    half = 0.5 * EARTH_RATE * time
    q_na = np.stack([np.cos(half), -np.sin(half), 0.0 * half, 0.0 * half], axis=-1)
    return [evaluated(compose_quaternions, *both) for both in zip(q_na.tolist(), q_ab.tolist(), strict=True)]
