"""The chart of what the gallery's scenes cost, with errors beside."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from examples.gallery.axes import save
from rbfmu.plot import COLORS

MARKS = {"planned": (COLORS[0], "o", 8), "full": ("#777777", "s", 6), "MuJoCo": (COLORS[1], "D", 5)}
"""Colour, marker and its size."""
LEAST_ERROR = 1e-17
"""Drawn for an error of 0."""


def draw(rows: Sequence[Any], path: Path) -> None:
    """Cost at the left, error at the right, a line for each scene; from `benchmarks.gallery.Row`s."""
    scenes = list(dict.fromkeys(row.scene for row in rows))
    figure = Figure(figsize=(9.6, 1.3 + 0.33 * len(scenes)), layout="constrained")
    cost, error = figure.subplots(1, 2, sharey=True, width_ratios=(1.25, 1.0))
    for y, scene in enumerate(scenes):
        _draw_scene(cost, error, -y, [row for row in rows if row.scene == scene])
    cost.set_yticks([-y for y in range(len(scenes))], [scene.replace("_", " ") for scene in scenes])
    cost.set_ylim(0.6 - len(scenes), 0.6)
    cost.set_xlabel("ns a communication step (less is better)")
    error.set_xlabel("largest error; |: accuracy asked")
    for axes in (cost, error):
        axes.set_xscale("log")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(axis="x", color="#e6e6e6", linewidth=0.6)
        axes.tick_params(axis="y", length=0)
        axes.set_axisbelow(True)
    handles = [
        cost.plot([], [], marker, color=color, markersize=size, label=who)[0]
        for who, (color, marker, size) in MARKS.items()
        if any(row.who == who for row in rows)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    title = "Models no larger than the scene needs (at the full ones: how many times more they cost)"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    save(figure, path)


def _draw_scene(cost: Any, error: Any, y: float, rows: Sequence[Any]) -> None:
    costs = [row.cost for row in rows]
    cost.plot([min(costs), max(costs)], [y, y], color="#cccccc", linewidth=1.0, zorder=1)
    for row in rows:
        color, marker, size = MARKS[row.who]
        cost.plot([row.cost], [y], marker, color=color, markersize=size)
        if row.who == "full":
            text = f"{row.ratio:.0f}×" if row.ratio >= 10.0 else f"{row.ratio:.1f}×"
            cost.annotate(
                text, (row.cost, y), xytext=(0, 5), textcoords="offset points", ha="center", fontsize=8, color=color
            )
        error.plot([max(row.error, LEAST_ERROR)], [y], marker, color=color, markersize=size)
    error.plot([rows[0].accuracy], [y], "|", color="black", markersize=12)
