"""Pictures of results."""

import io
import math
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rbfmu.exceptions import named
from rbfmu_kernels.quantities import Output

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Okabe and Ito's: told apart by everyone."""


class Rows(Protocol):
    """What is drawn: quantities at points in time, such as a `Result` has."""

    time: NDArray[np.float64]
    quantities: dict[str, NDArray[np.float64]]
    rows: dict[str, Output]


class Picture(Figure):
    """A figure that a notebook shows, whichever way it shows other figures."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=90)
        return file.getvalue()


def plot_result(result: Rows, path: str | Path | None = None, title: str = "") -> Figure:
    """Draw one panel for each quantity over time, to a file too where a path is given; return the figure."""
    figure = Picture(figsize=(8.0, 1.2 + 1.9 * len(result.quantities)), layout="constrained")
    panels = figure.subplots(len(result.quantities), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, values) in zip(panels, result.quantities.items(), strict=True):
        row = result.rows[name]
        turn = 2.0 * math.pi if row.unit == "rad" else math.inf
        draw_components(axes, result.time, values, row.components, turn)
        axes.set_ylabel(quantity_label(row), fontsize=9)
    panels[-1].set_xlabel("time (s)")
    figure.suptitle(title, fontsize=11)
    return with_file(figure, path)


def with_file(figure: Figure, path: str | Path | None) -> Figure:
    """Return the figure, written to a file where a path is given; its ending (.png, .svg, .pdf) sets the format."""
    if path is not None:
        with named(path):
            figure.savefig(path, dpi=130)
    return figure


def draw_components(axes: Any, time: Any, values: Any, names: tuple[str, ...], turn: float = math.inf) -> None:
    """Draw values (n,) or (n, k) as named lines; those of angles are with_gaps where they lose a turn."""
    columns = values[:, None] if values.ndim == 1 else values
    for k, name in enumerate(names):
        axes.plot(*with_gaps(time, columns[:, k], turn), color=COLORS[k], linewidth=1.2, label=name)
    if len(names) > 1:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    open_frame(axes)
    axes.margins(x=0.0)


def with_gaps(time: Any, angles: Any, turn: float) -> tuple[Any, Any]:
    """Return the points (n,) of a line with a gap between those that are more than half a turn apart."""
    jumps = np.flatnonzero(np.abs(np.diff(angles)) > 0.5 * turn) + 1
    return np.insert(time, jumps, time[jumps]), np.insert(angles, jumps, np.nan)


def quantity_label(row: Output) -> str:
    """Return what an axis says of a quantity."""
    return row.label if row.unit == "1" else f"{row.label} ({row.unit.replace('m2', 'm²').replace('s2', 's²')})"


def open_frame(axes: Any, grid: bool = False) -> None:
    """Show axes at the left and bottom only, and a pale grid behind what is drawn."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(color="#e9e9e9", linewidth=0.6)
        axes.set_axisbelow(True)
