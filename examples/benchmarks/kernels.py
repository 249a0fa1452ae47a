"""The array functions beside their peers and beside a plain copy of the same data: ratios measured in one run.

`python -m examples.benchmarks.kernels [FOLDER]` writes kernels.csv, kernels.png and prints a table. SciPy is needed;
quaternionic, numpy-quaternion (package `quaternion`) and MuJoCo are measured where installed (extra `bench`). Exits
with status 1 where a goal is missed.
"""

import csv
import importlib
import importlib.metadata
import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numba import njit

import rbfmu
import rbfmu_kernels as k
from examples.benchmarks.goals import Goal, status
from rbfmu.extras import needed_of, remedy
from rbfmu_kernels.compile.plain import plain_gufunc
from rbfmu_kernels.compile.shapes import core_shapes
from rbfmu_kernels.rotations.euler_angles import sequence

with needed_of("bench"):
    from scipy.spatial.transform import Rotation

GOALS = {  # name: (times faster than SciPy, share of the copy's speed)
    "compose quaternions": (40.0, 0.9),
    "rotate": (8.0, 0.9),
    "quaternion to matrix": (3.0, 0.9),
    "matrix to quaternion": (4.0, 0.9),
    "compose matrices": (2.5, 0.9),
    "ZYX to quaternion": (50.0, 0.5),
    "rotation vector to quaternion": (4.0, 0.5),
    "slerp": (50.0, 0.25),
    "quaternion to ZYX": (5.0, 0.25),
}
ROUNDS = 7
IMPORTS = 15


@dataclass(frozen=True)
class Task:
    """One operation on arrays: ours, and what it takes and gives (numbers per item)."""

    name: str
    ours: Callable[[], Any]
    arrays: tuple[Any, ...]
    out: Any


def copy_of(task: Task) -> Callable[[], Any]:
    """Return a compiled loop that reads and writes the same rows and computes (next to) nothing."""
    rows = [a.reshape(len(a), -1) for a in task.arrays if a.ndim > 1][:2]
    out = task.out.reshape(len(task.out), -1)
    widths = [a.shape[1] for a in rows]
    key = (tuple(widths), out.shape[1])
    if key not in _COPIES:
        _COPIES[key] = _specialised(*key)
    loop = _COPIES[key]
    return lambda: loop(*rows, out)


_COPIES: dict[Any, Any] = {}


def _specialised(widths: tuple[int, ...], width: int) -> Any:
    """Return the copy with its widths as constants, as the array functions have them."""
    names = [f"a{n}" for n in range(len(widths))]
    used = range(max(*widths, width))
    cells = [" + ".join(f"{a}[i, {j % w}]" for a, w in zip(names, widths, strict=True)) for j in used]
    sums: list[str] = [""] * width
    for j, cell in enumerate(cells):  # what the result has no cell for is read all the same
        sums[j % width] = f"{sums[j % width]} + {cell}" if sums[j % width] else cell
    lines = [f"def loop({', '.join(names)}, out):", "    for i in range(out.shape[0]):"]
    scope: dict[str, Any] = {}
    exec("\n".join(lines + [f"        out[i, {j}] = {s}" for j, s in enumerate(sums)]), scope)
    return njit(scope["loop"])


def tasks(n: int) -> tuple[list[Task], dict[str, Any]]:
    """Return the operations on n items, and the arrays they share."""
    random = np.random.default_rng(1)
    q = rbfmu.normalize(random.normal(size=(n, 4)))
    p = rbfmu.normalize(random.normal(size=(n, 4)))
    data = {"q": q, "p": p, "v": random.normal(size=(n, 3)), "s": random.uniform(size=n)}
    data |= {"R": rbfmu.matrix_from_quaternion(q), "S": rbfmu.matrix_from_quaternion(p)}
    data |= {"angles": rbfmu.euler_from_quaternion("ZYX", q), "u": rbfmu.rotvec_from_quaternion(q)}
    q4, v3, m9 = np.empty_like(q), np.empty_like(data["v"]), np.empty_like(data["R"])
    d = data

    def task(name: str, call: Callable[[], Any], arrays: str, out: Any) -> Task:
        return Task(name, call, tuple(d[a] for a in arrays.split()), out)

    return [
        task("compose quaternions", lambda: rbfmu.compose_quaternions(q, p, out=q4), "q p", q4),
        task("rotate", lambda: rbfmu.rotate(q, d["v"], out=v3), "q v", v3),
        task("quaternion to matrix", lambda: rbfmu.matrix_from_quaternion(q, out=m9), "q", m9),
        task("matrix to quaternion", lambda: rbfmu.quaternion_from_matrix(d["R"], out=q4), "R", q4),
        task("compose matrices", lambda: rbfmu.compose_matrices(d["R"], d["S"], out=m9), "R S", m9),
        task("ZYX to quaternion", lambda: rbfmu.quaternion_from_euler("ZYX", d["angles"], out=q4), "angles", q4),
        task("rotation vector to quaternion", lambda: rbfmu.quaternion_from_rotvec(d["u"], out=q4), "u", q4),
        task("slerp", lambda: rbfmu.slerp(q, p, d["s"], out=q4), "q p s", q4),
        task("quaternion to ZYX", lambda: rbfmu.euler_from_quaternion("ZYX", q, out=v3), "q", v3),
    ], data


def scipy_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """Return the same operations by SciPy (scalar-last quaternions, made outside the measured call)."""
    a, b = (Rotation.from_quat(d[x][:, [1, 2, 3, 0]]) for x in "qp")
    out = np.empty_like(d["R"])
    return {
        "compose quaternions": lambda: a * b,
        "rotate": lambda: a.apply(d["v"]),
        "quaternion to matrix": a.as_matrix,
        "matrix to quaternion": lambda: Rotation.from_matrix(d["R"], assume_valid=True).as_quat(),
        "compose matrices": lambda: np.matmul(d["R"], d["S"], out=out),
        "ZYX to quaternion": lambda: Rotation.from_euler("ZYX", d["angles"]).as_quat(),
        "rotation vector to quaternion": lambda: Rotation.from_rotvec(d["u"]).as_quat(),
        "slerp": lambda: a * Rotation.from_rotvec(d["s"][:, None] * (a.inv() * b).as_rotvec()),
        "quaternion to ZYX": lambda: a.as_euler("ZYX"),
    }


def quaternion_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By numpy-quaternion."""
    quaternion = importlib.import_module("quaternion")
    a, b = quaternion.as_quat_array(d["q"]), quaternion.as_quat_array(d["p"])
    return {
        "compose quaternions": lambda: a * b,
        "quaternion to matrix": lambda: quaternion.as_rotation_matrix(a),
        "matrix to quaternion": lambda: quaternion.from_rotation_matrix(d["R"], nonorthogonal=False),
        "rotation vector to quaternion": lambda: quaternion.from_rotation_vector(d["u"]),
        "slerp": lambda: np.slerp_vectorized(a, b, d["s"]),  # type: ignore[attr-defined]
    }


def quaternionic_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By quaternionic."""
    quaternionic = importlib.import_module("quaternionic")
    a, b = quaternionic.array(d["q"]), quaternionic.array(d["p"])
    return {
        "compose quaternions": lambda: a * b,
        "quaternion to matrix": lambda: a.to_rotation_matrix,
        "matrix to quaternion": lambda: quaternionic.array.from_rotation_matrix(d["R"], nonorthogonal=False),
        "rotation vector to quaternion": lambda: quaternionic.array.from_rotation_vector(d["u"]),
        "slerp": lambda: quaternionic.slerp(a, b, d["s"]),
    }


def mujoco_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By MuJoCo's functions of one item, in a Python loop over the first thousand; scaled to all."""
    mujoco = importlib.import_module("mujoco")
    q, p, v, u = (np.ascontiguousarray(d[x][:1000]) for x in "qpvu")
    q4, v3, m9 = np.empty(4), np.empty(3), np.empty(9)

    def loop(call: Callable[[int], Any]) -> Callable[[], Any]:
        return lambda: [call(i) for i in range(len(q))]

    return {
        "compose quaternions": loop(lambda i: mujoco.mju_mulQuat(q4, q[i], p[i])),
        "rotate": loop(lambda i: mujoco.mju_rotVecQuat(v3, v[i], q[i])),
        "quaternion to matrix": loop(lambda i: mujoco.mju_quat2Mat(m9, q[i])),
        "rotation vector to quaternion": loop(lambda i: mujoco.mju_axisAngle2Quat(q4, u[i], 1.0)),
    }


def plain_calls(d: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """By our own kernels in Numba's `guvectorize`, one item after the other: what tiles and their transposing gain."""
    zyx = sequence("ZYX")
    kernels = {
        "compose quaternions": (k.compose_quaternions, "q p"),
        "rotate": (k.rotate, "q v"),
        "quaternion to matrix": (k.matrix_from_quaternion, "q"),
        "matrix to quaternion": (k.quaternion_from_matrix, "R"),
        "compose matrices": (k.compose_matrices, "R S"),
        "ZYX to quaternion": (k.quaternion_from_euler, "angles", zyx),
        "rotation vector to quaternion": (k.quaternion_from_rotvec, "u"),
        "slerp": (k.slerp, "q p s"),
        "quaternion to ZYX": (k.euler_from_quaternion, "q", zyx),
    }
    loop = cache(plain_gufunc)  # compiled in the first round, which is not counted

    def call(kernel: Any, arrays: str, *constants: int) -> Callable[[], Any]:
        out = np.empty((len(d["q"]), *core_shapes(kernel)[1][0]))
        return lambda: loop(kernel, *constants)(*(d[a] for a in arrays.split()), out=out)

    return {name: call(*given) for name, given in kernels.items()}


PEERS = {
    "plain loop": ("numba", plain_calls),
    "SciPy": ("scipy", scipy_calls),
    "numpy-quaternion": ("quaternion", quaternion_calls),
    "quaternionic": ("quaternionic", quaternionic_calls),
    "MuJoCo, one by one": ("mujoco", mujoco_calls),
}


def measure(n: int) -> list[dict[str, Any]]:
    """Return ns an item of every competitor, best of interleaved rounds."""
    ours, data = tasks(n)
    peers = {}
    for peer, (module, calls) in PEERS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                importlib.import_module(module)
            except ImportError:
                continue
            peers[peer] = calls(data)
    rows = []
    for task in ours:
        competitors = {"rbfmu": task.ours, "copy": copy_of(task)}
        competitors |= {peer: calls[task.name] for peer, calls in peers.items() if task.name in calls}
        best = dict.fromkeys(competitors, np.inf)
        for done in range(ROUNDS + 1):  # the first round compiles and is not counted
            for name, call in competitors.items():
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    start = time.perf_counter()
                    call()
                    seconds = time.perf_counter() - start
                items = min(n, 1000) if name.startswith("MuJoCo") else n
                if done:
                    best[name] = min(best[name], 1e9 * seconds / items)
        rows.append({"operation": task.name, **best})
    return rows


def one_item() -> dict[str, float]:
    """Return us of one call on one item, and what a call costs in a compiled loop beside the same lines by hand."""
    q, v = np.array([0.5, 0.5, 0.5, 0.5]), np.array([1.0, 2.0, 3.0])
    tq, tv = (0.5, 0.5, 0.5, 0.5), (1.0, 2.0, 3.0)
    figures = {
        "array function, us": _best(lambda: rbfmu.rotate(q, v), 20_000) * 1e6,
        "scalar kernel, us": _best(lambda: k.rotate(tq, tv), 20_000) * 1e6,
    }
    n = 2_000_000
    by_kernel, by_hand = np.inf, np.inf
    for _ in range(9):
        by_kernel = min(by_kernel, _best(lambda: _loop_of_kernels(tq, tq, n), 1))
        by_hand = min(by_hand, _best(lambda: _loop_by_hand(tq, tq, n), 1))
    return figures | {"loop of kernels / loop by hand": by_kernel / by_hand}


@njit
def _loop_of_kernels(q: Any, p: Any, n: int) -> Any:
    for _ in range(n):
        q = k.compose_quaternions(q, p)
    return q


@njit
def _loop_by_hand(q: Any, p: Any, n: int) -> Any:
    a, b, c, d = q
    e, f, g, h = p
    for _ in range(n):
        a, b, c, d = (
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        )
    return a, b, c, d


def _best(call: Callable[[], Any], times: int) -> float:
    call()
    best = np.inf
    for _ in range(7):
        start = time.perf_counter()
        for _ in range(times):
            call()
        best = min(best, (time.perf_counter() - start) / times)
    return best


def threads(n: int) -> dict[str, float]:
    """Speed of two threads as a ratio to one: at n items, and below the size from which on threads are used."""
    angles, out = np.random.default_rng(1).uniform(-3.0, 3.0, size=(n, 3)), np.empty((n, 4))
    ratios = {}
    for items, rounds in ((n, 25), (10_000, 1000)):
        some, into = angles[:items], out[:items]
        seconds: dict[int, list[float]] = {1: [], 2: []}
        for _ in range(rounds):
            for count in (1, 2):
                rbfmu.set_threads(count)
                rbfmu.quaternion_from_euler("ZYX", some, out=into)  # threads are started by the first call
                start = time.perf_counter()
                rbfmu.quaternion_from_euler("ZYX", some, out=into)
                seconds[count].append(time.perf_counter() - start)
        one, two = (float(np.median(seconds[count])) for count in (1, 2))
        ratios[f"ZYX to quaternion, {items:,} items, two threads / one"] = one / two
    rbfmu.set_threads(1)
    return ratios


FIRST_CALLS = {
    "quaternion to ZYX": "euler_from_quaternion('ZYX', [1.0, 0, 0, 0])",
    "free_rotation (the largest)": "free_rotation([1.0, 2.0, 3.0], [1.0, 0, 0, 0], [0.1, 0.2, 0.3], 1.0)",
}


def starts() -> dict[str, float]:
    """Return imports as a ratio; s for the first call of a function, with a cold and a warm cache of compiled code."""
    figures = {}
    with tempfile.TemporaryDirectory() as cache:
        timed = "import time; t = time.perf_counter(); import {}; print(time.perf_counter() - t)"
        calls = [timed.format(module) for module in ("rbfmu.arrays", "numba")]
        ours, numba = np.median([[_python(call, cache) for call in calls] for _ in range(IMPORTS)], axis=0)
        figures["import of all array functions / import numba"] = ours / numba
        for name, call in FIRST_CALLS.items():
            first = (
                f"import time, rbfmu; rbfmu.compose_matrices; t = time.process_time(); rbfmu.{call};"
                "print(time.process_time() - t)"
            )
            for state in ("cold", "warm"):
                figures[f"first call of {name}, {state} cache, s of CPU"] = _python(first, cache)
    return figures


def _python(code: str, cache: str) -> float:
    """Return what the code prints, run with the bytecode on disk that an installed package has."""
    environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONDONTWRITEBYTECODE": ""}
    command = [sys.executable, "-c", code]
    return float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw ns an item of every competitor, a line of dots for each operation."""
    marks = {
        "rbfmu": ("#d55e00", "o"),
        "copy": ("#000000", "|"),
        "SciPy": ("#0072b2", "s"),
        "plain loop": ("#d55e00", "x"),
    }
    marks |= {
        "numpy-quaternion": ("#009e73", "^"),
        "quaternionic": ("#cc79a7", "v"),
        "MuJoCo, one by one": ("#999999", "D"),
    }
    figure = Figure(figsize=(8.4, 4.6), layout="constrained")
    axes = figure.subplots()
    for name, (color, marker) in marks.items():
        points = [(row[name], -i) for i, row in enumerate(rows) if name in row]
        if points:
            label = "copy of the same data" if name == "copy" else name
            size = 14 if name == "copy" else 7
            axes.plot(*zip(*points, strict=True), marker, color=color, markersize=size, label=label, linestyle="none")
    axes.set_xscale("log")
    axes.set_yticks([-i for i in range(len(rows))], [row["operation"] for row in rows])
    axes.set_xlabel("ns an item (a million items, one thread; less is better)")
    axes.grid(axis="x", alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
    axes.set_title("rbfmu works at the speed of memory where there is no trigonometry", fontsize=11)
    figure.savefig(path, dpi=130)


def main(folder: Path, n: int = 1_000_000) -> list[dict[str, Any]]:
    """Measure, write, print; returns the rows."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = measure(n)
    names = ["rbfmu", "copy", *PEERS]
    with (folder / "kernels.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, ["operation", *names, "machine", "versions"])
        writer.writeheader()
        packages = ("numba", "numpy", "scipy", "quaternionic", "numpy-quaternion", "mujoco")
        versions = " ".join(f"{p} {v}" for p in packages if (v := _version(p)))
        writer.writerows(
            row | {"machine": platform.processor() or platform.machine(), "versions": versions} for row in rows
        )
    draw(rows, folder / "kernels.png")
    print(f"{'ns an item, ' + str(n) + ' items':32}" + "".join(f"{x[:16]:>17}" for x in names))
    for row in rows:
        print(f"{row['operation']:32}" + "".join(f"{row[x]:17.2f}" if x in row else " " * 17 for x in names))
    print(f"\n{'':32}{'SciPy / rbfmu':>17}{'goal':>8}{'copy / rbfmu':>17}{'goal':>8}")
    for row in rows:
        peer, share = GOALS[row["operation"]]
        ratio, of_copy = row["SciPy"] / row["rbfmu"], row["copy"] / row["rbfmu"]
        print(f"{row['operation']:32}{ratio:17.1f}{peer:8.1f}{of_copy:17.2f}{share:8.2f}")
    print("".join(absent()), end="")
    for name, value in {**one_item(), **threads(n), **starts()}.items():
        print(f"{name:60}{value:10.3f}")
    return rows


def absent() -> list[str]:
    """Return a line for each peer that is not installed."""
    missing = [peer for peer, (module, _) in PEERS.items() if importlib.util.find_spec(module) is None]
    return [f"{peer}: not installed ({remedy('bench')})\n" for peer in missing]


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def goals(rows: list[dict[str, Any]]) -> list[Goal]:
    """Of the rows that `main` returns."""
    found = []
    for row in rows:
        name, (peer, share) = row["operation"], GOALS[row["operation"]]
        found.append(Goal(f"{name}, SciPy / rbfmu", row["SciPy"] / row["rbfmu"], least=peer))
        found.append(Goal(f"{name}, copy / rbfmu", row["copy"] / row["rbfmu"], least=share))
    return found


if __name__ == "__main__":
    raise SystemExit(status(goals(main(Path(sys.argv[1] if len(sys.argv) > 1 else "bench")))))
