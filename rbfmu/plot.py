"""Pictures of results."""

import io
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rbfmu import exceptions, on_disk
from rbfmu.types import Array
from rbfmu_kernels.quantities import OUTPUT, Output

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Colours of Okabe and Ito, which are also distinct for readers with a colour vision deficiency."""
MARKS, MOST_MARKS = ("#555555", "#e69f00", "#56b4e9"), 200
"""The colours of events, and the largest number of times of one event that is drawn."""
MOST_LETTERS = 32
"""How many letters stand beside a panel in one line."""


class Rows(Protocol):
    """What can be drawn: quantities at points in time, as in a `Result`."""

    time: Array
    quantities: dict[str, Array]
    rows: dict[str, Output]


def plain(words: str) -> str:
    """Return a user's text with dollar signs escaped, so that Matplotlib does not read mathematics into it."""
    return words.replace("$", r"\$")


class Picture(Figure):
    """A figure that a notebook shows as a picture, whatever its Matplotlib backend; its title has a scene's name."""

    def suptitle(self, t: str, **options: Any) -> Any:
        """Set the title literally, without mathematics in dollar signs."""
        return super().suptitle(plain(t), wrap=True, **options)

    def _repr_png_(self) -> bytes:
        return png_of(self, dpi=90)


def png_of(figure: Figure, **options: Any) -> bytes:
    """Return a figure as the bytes of a PNG."""
    file = io.BytesIO()
    figure.savefig(file, format="png", **options)
    return file.getvalue()


def plot_result(result: Rows, path: str | Path | None = None, title: str = "") -> Figure:
    """Draw one panel for each quantity over time, and return the figure; path: a file to write it to as well."""
    figure, panels = _panels(len(result.quantities), height=1.9)
    for axes, (name, values) in zip(panels, result.quantities.items(), strict=True):
        row = result.rows[name]
        turn = 2.0 * np.pi if row.unit == "rad" else np.inf
        draw_components(axes, result.time, values, row.components, turn)
        _name_axis(axes, quantity_label(row))
    _mark_events(panels, getattr(result, "events", {}))
    figure.suptitle(title, fontsize=11)
    return with_file(figure, path)


def plot_changes(
    time: Array, changes: Mapping[str, Mapping[str, Array]], path: str | Path | None, title: str
) -> Figure:
    """Draw a panel for each output: its change (times,) if the numbers of a key change by 1 %, on a log scale.

    changes: by output and key.
    """
    figure, panels = _panels(len(changes), height=2.2)
    for axes, (name, lines) in zip(panels, changes.items(), strict=True):
        for k, (key, sizes) in enumerate(lines.items()):
            style, moves = ("-", "--", ":")[k // len(COLORS) % 3], any(of[key].any() for of in changes.values())
            axes.plot(time, np.where(sizes > 0.0, sizes, np.nan), style, color=COLORS[k % len(COLORS)], linewidth=1.3,
                      label=key if moves else f"{key}: without effect")  # fmt: skip
        axes.set_yscale("log")
        row = OUTPUT.get(name)
        _name_axis(axes, "attitude (rad)" if name == "attitude" else quantity_label(row) if row else name)
        open_frame(axes, grid=True, legend=axes is panels[0])
        axes.margins(x=0.0)
    figure.suptitle(f"{title}: change by 1 % of each key's numbers (0.01 of what is zero)".lstrip(": "), fontsize=10)
    return with_file(figure, path)


def plot_residuals(time: Array, rows: Mapping[str, Array], path: str | Path | None, title: str) -> Figure:
    """Draw a panel for each output: the residuals (times, k), measured less fitted, over their standard deviation."""
    figure, panels = _panels(len(rows), height=2.0)
    for axes, (name, values) in zip(panels, rows.items(), strict=True):
        far = 6.0
        for k, column in enumerate(values.T):
            axes.plot(time, np.clip(column, -far, far), ".", markersize=3, color=COLORS[k % len(COLORS)],
                      label="xyz"[k] if values.shape[1] == 3 else name)  # fmt: skip
        axes.axhspan(-2.0, 2.0, color="#eeeeee", zorder=0)
        axes.set_ylim(-far - 0.5, far + 0.5)
        _name_axis(axes, "attitude" if name == "quaternion" else name)
        open_frame(axes, legend=True)
    figure.suptitle(f"{title}: measured less fitted, in standard deviations; beyond 6 at the edge", fontsize=10)
    return with_file(figure, path)


def _panels(count: int, height: float) -> tuple[Picture, list[Axes]]:
    """Return a figure and its panels, one below the other, with a common axis of time."""
    figure = Picture(figsize=(8.0, 1.2 + height * count), layout="constrained")
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()
    panels[-1].set_xlabel("time (s)")
    return figure, panels


def _name_axis(axes: Axes, name: str) -> None:
    axes.set_ylabel(textwrap.fill(name, MOST_LETTERS), fontsize=9)


def _mark_events(panels: Sequence[Axes], events: Mapping[str, Array]) -> None:
    """Draw a vertical line at each time of an event, with its name at the first; beyond MOST_MARKS times draw none."""
    shown = [(name, times) for name, times in events.items() if 0 < len(times) <= MOST_MARKS]
    for k, (name, times) in enumerate(shown):
        row = k % len(MARKS)
        for axes in panels:
            axes.vlines(times, 0, 1, transform=axes.get_xaxis_transform(), color=MARKS[row], linewidth=0.8,
                        linestyle=":")  # fmt: skip
        panels[0].annotate(name, (times[0], 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2 + 9 * row),
                           textcoords="offset points", fontsize=8, color=MARKS[row])  # fmt: skip


def with_file(figure: Figure, path: str | Path | None, dpi: float | str = 130) -> Figure:
    """Return the figure; if a path is given, write it there, in the format of its suffix (.png, .svg, .pdf)."""
    if path is not None:
        with on_disk.replacing(exceptions.path_of(path)) as file:
            figure.savefig(file, dpi=dpi, format=exceptions.path_of(path).suffix[1:] or None)
    return figure


def draw_components(axes: Axes, time: Array, values: Array, names: tuple[str, ...], turn: float = np.inf) -> None:
    """Draw values (n,) or (n, k) as named lines, with gaps where angles jump by a turn; turn: its size (inf: none)."""
    columns = values[:, None] if values.ndim == 1 else values
    for k, name in enumerate(names):
        axes.plot(*with_gaps(time, columns[:, k], turn), color=COLORS[k], linewidth=1.2, label=name)
    open_frame(axes, legend=len(names) > 1)
    axes.margins(x=0.0)


def with_gaps(time: Array, angles: Array, turn: float) -> tuple[Array, Array]:
    """Return time and angles of a line, with a NaN inserted between angles that are more than half a turn apart.

    Angles whose range is more than a turn get no gaps, since they count turns: a wheel may turn by any angle between
    two points.
    """
    most, least = np.fmax.reduce(angles, initial=-np.inf), np.fmin.reduce(angles, initial=np.inf)
    loses_turns = most - least <= turn * (1.0 + 1e-9)
    jumps = np.flatnonzero(loses_turns & (np.abs(np.diff(angles)) > 0.5 * turn)) + 1
    return np.insert(time, jumps, time[jumps]), np.insert(angles, jumps, np.nan)


def quantity_label(row: Output) -> str:
    """Return the label of a quantity's axis."""
    return with_unit(row.label, row.unit)


def with_unit(label: str, unit: str) -> str:
    """Return a label with its unit, if it has one."""
    return plain(label if unit == "1" else f"{label} ({unit.replace('m2', 'm²').replace('s2', 's²')})")


def open_frame(axes: Axes, grid: bool = False, legend: bool = False) -> None:
    """Show a frame only at the left and bottom; grid: a pale one behind the lines; legend: beside the axes."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(color="#e9e9e9", linewidth=0.6)
        axes.set_axisbelow(True)
    if legend:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
