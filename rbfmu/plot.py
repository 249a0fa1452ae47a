"""Pictures of results."""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rbfmu.exceptions import path_of
from rbfmu.on_disk import replacing
from rbfmu.types import Array
from rbfmu_kernels.quantities import OUTPUT, Output

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Okabe and Ito's: told apart by everyone."""
MARKS, MOST_MARKS = ("#555555", "#e69f00", "#56b4e9"), 200
"""The colours of events, and the most of one that a picture can show."""


class Rows(Protocol):
    """What is drawn: quantities at points in time, such as a `Result` has."""

    time: Array
    quantities: dict[str, Array]
    rows: dict[str, Output]


def plain(words: str) -> str:
    """Return words of a user such that Matplotlib takes no dollars of them for mathematics."""
    return words.replace("$", r"\$")


class Picture(Figure):
    """A figure that a notebook shows, whichever way it shows other figures; in its title stands a scene's name."""

    def suptitle(self, t: str, **options: Any) -> Any:
        """Set the title, as it is spelled."""
        return super().suptitle(plain(t), **options)

    def _repr_png_(self) -> bytes:
        return png_of(self, dpi=90)


def png_of(figure: Figure, **options: Any) -> bytes:
    """Return a figure as the bytes of a PNG."""
    file = io.BytesIO()
    figure.savefig(file, format="png", **options)
    return file.getvalue()


def plot_result(result: Rows, path: str | Path | None = None, title: str = "") -> Figure:
    """Draw one panel for each quantity over time, to a file too where a path is given; return the figure."""
    figure, panels = _panels(len(result.quantities), height=1.9)
    for axes, (name, values) in zip(panels, result.quantities.items(), strict=True):
        row = result.rows[name]
        turn = 2.0 * math.pi if row.unit == "rad" else math.inf
        draw_components(axes, result.time, values, row.components, turn)
        axes.set_ylabel(quantity_label(row), fontsize=9)
    _mark_events(panels, getattr(result, "events", {}))
    figure.suptitle(title, fontsize=11)
    return with_file(figure, path)


def plot_changes(
    time: Array, changes: Mapping[str, Mapping[str, Array]], path: str | Path | None, title: str
) -> Figure:
    """Draw a panel for each output: how far it moves (times,) as each key's numbers change by 1 %, on a log scale."""
    figure, panels = _panels(len(changes), height=2.2)
    for axes, (name, lines) in zip(panels, changes.items(), strict=True):
        for k, (key, sizes) in enumerate(lines.items()):
            style, moves = ("-", "--", ":")[k // len(COLORS) % 3], any(of[key].any() for of in changes.values())
            axes.plot(time, np.where(sizes > 0.0, sizes, np.nan), style, color=COLORS[k % len(COLORS)], linewidth=1.3,
                      label=key if moves else f"{key}: without effect")  # fmt: skip
        axes.set_yscale("log")
        row = OUTPUT.get(name)
        axes.set_ylabel("attitude (rad)" if name == "attitude" else quantity_label(row) if row else name, fontsize=9)
        open_frame(axes, grid=True, legend=axes is panels[0])
        axes.margins(x=0.0)
    figure.suptitle(f"{title}: change by 1 % of each key's numbers (0.01 of what is zero)".lstrip(": "), fontsize=10)
    return with_file(figure, path)


def plot_residuals(time: Array, rows: Mapping[str, Array], path: str | Path | None, title: str) -> Figure:
    """Draw a panel for each output: what was measured less what was fitted (times, k), over its noise."""
    figure, panels = _panels(len(rows), height=2.0)
    for axes, (name, values) in zip(panels, rows.items(), strict=True):
        far = 6.0
        for k, column in enumerate(values.T):
            axes.plot(time, np.clip(column, -far, far), ".", markersize=3, color=COLORS[k % len(COLORS)],
                      label="xyz"[k] if values.shape[1] == 3 else name)  # fmt: skip
        axes.axhspan(-2.0, 2.0, color="#eeeeee", zorder=0)
        axes.set_ylim(-far - 0.5, far + 0.5)
        axes.set_ylabel("attitude" if name == "quaternion" else name, fontsize=9)
        open_frame(axes, legend=True)
    figure.suptitle(f"{title}: measured less fitted, in standard deviations; beyond 6 at the edge", fontsize=10)
    return with_file(figure, path)


def _panels(count: int, height: float) -> tuple[Picture, list[Axes]]:
    """Return a figure, and its panels one below the other, which share the axis of time."""
    figure = Picture(figsize=(8.0, 1.2 + height * count), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()
    panels[-1].set_xlabel("time (s)")
    return figure, panels


def _mark_events(panels: Sequence[Axes], events: Mapping[str, Array]) -> None:
    """Draw a vertical line at each event, named at its first; those of more than MOST_MARKS are left out."""
    shown = [(name, times) for name, times in events.items() if 0 < len(times) <= MOST_MARKS]
    for k, (name, times) in enumerate(shown):
        for axes in panels:
            axes.vlines(times, 0, 1, transform=axes.get_xaxis_transform(), color=MARKS[k % len(MARKS)],
                        linewidth=0.8, linestyle=":")  # fmt: skip
        panels[0].annotate(name, (times[0], 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2 + 9 * (k % 2)),
                           textcoords="offset points", fontsize=8, color=MARKS[k % len(MARKS)])  # fmt: skip


def with_file(figure: Figure, path: str | Path | None) -> Figure:
    """Return the figure, written to a file where a path is given; its ending (.png, .svg, .pdf) sets the format."""
    if path is not None:
        with replacing(path_of(path)) as file:
            figure.savefig(file, dpi=130, format=path_of(path).suffix[1:] or None)
    return figure


def draw_components(axes: Axes, time: Array, values: Array, names: tuple[str, ...], turn: float = math.inf) -> None:
    """Draw values (n,) or (n, k) as named lines; those of angles have gaps where they lose a turn."""
    columns = values[:, None] if values.ndim == 1 else values
    for k, name in enumerate(names):
        axes.plot(*with_gaps(time, columns[:, k], turn), color=COLORS[k], linewidth=1.2, label=name)
    open_frame(axes, legend=len(names) > 1)
    axes.margins(x=0.0)


def with_gaps(time: Array, angles: Array, turn: float) -> tuple[Array, Array]:
    """Return the points (n,) of a line with a gap between those that are more than half a turn apart.

    Angles that take up more than a turn count on, and have no gaps: a wheel may turn by any angle between two points.
    """
    most, least = np.fmax.reduce(angles, initial=-np.inf), np.fmin.reduce(angles, initial=np.inf)
    loses_turns = most - least <= turn * (1.0 + 1e-9)
    jumps = np.flatnonzero(loses_turns & (np.abs(np.diff(angles)) > 0.5 * turn)) + 1
    return np.insert(time, jumps, time[jumps]), np.insert(angles, jumps, np.nan)


def quantity_label(row: Output) -> str:
    """Return what an axis says of a quantity."""
    return with_unit(row.label, row.unit)


def with_unit(label: str, unit: str) -> str:
    """Return a label with its unit, if it has one."""
    return plain(label if unit == "1" else f"{label} ({unit.replace('m2', 'm²').replace('s2', 's²')})")


def open_frame(axes: Axes, grid: bool = False, legend: bool = False) -> None:
    """Show axes at the left and bottom only, a pale grid behind what is drawn, and what lines are called beside it."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(color="#e9e9e9", linewidth=0.6)
        axes.set_axisbelow(True)
    if legend:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
