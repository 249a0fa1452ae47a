"""The array functions beside their peers and beside a plain copy of the same data: ratios measured in one run.

`python -m examples.benchmarks.kernels [FOLDER]` writes kernels.csv, kernels.png and prints a table. SciPy is needed;
quaternionic, numpy-quaternion (package `quaternion`) and MuJoCo are measured where installed (extra `bench`). Exits
with status 1 where a goal is missed.
"""

import csv
import importlib
import importlib.metadata
import platform
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from examples.benchmarks.support.array_tasks import PEERS, absent, copy_of, tasks
from examples.benchmarks.support.call_costs import one_item, starts, threads
from examples.benchmarks.support.goals import Goal, status

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
