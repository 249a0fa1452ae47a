"""The pictures of the laws, drawn from the rows of one table: predictions and measurements; and maps of verdicts."""

import math
from collections.abc import Callable, Mapping, Sequence
from decimal import ROUND_CEILING, Context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colors, patches
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rbfmu.plot import COLORS, open_frame, with_file
from rbfmu.studies import tables_of
from rbfmu.studies.chart.drawing import spread
from rbfmu.studies.stability import CURVE, LAWS, Study
from rbfmu.studies.stability.motions import ACCURACY, LARGEST_ERROR, LONG_TURN, OURS, TURN, VERDICTS, Row

_NAMED = dict(zip(("blue", "vermilion", "green", "purple"), COLORS, strict=True))
_NAMED |= {"orange": "#e69f00", "sky": "#56b4e9", "black": "#000000", "grey": "#777777"}
"""The colours of the Okabe-Ito palette by name, and a grey for all that is not a method."""
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY = _NAMED.values()
_INK = {ORANGE: "#b37700", SKY: "#2c7fb0", PURPLE: "#b0568c"}
"""Darker colours of the text for the pale colours of lines."""
_LARGEST = 1e3
"""A curve's name is beside its last value below this; larger values are outside the picture."""


class Curve(NamedTuple):
    """A column of a study as a curve.

    style, size: matplotlib's format, and the width of a line or the size of a marker; name: the text at the right edge,
    at the height of the last value; dots: about the number of values that are drawn (0: all).
    """

    column: str
    color: str
    style: str = "o"
    size: float = 3.0
    name: str = ""
    dots: int = 0


class Picture(NamedTuple):
    """A row of the table: the picture of one study. Colours are given by name.

    title, x, y: the texts of the picture and of its axes; set: limits and scales, as `axes.set` takes them (without
    limits of x, the first column gives them); curves: the columns drawn over the first column; floor: smaller values
    are drawn here, on logarithmic axes (0: none); notes: (x, y, text, colour[, alignment]); marks: vertical lines
    (x, text, height, alignment); levels: horizontal lines (y, colour); ticks: those of x and y, each with its text;
    edge: the right edge of the axes, which leaves room for names; explained: whether a note explains lines and dots;
    height: in inches.
    """

    title: str
    x: str
    y: str
    set: Mapping[str, Any] = {}
    curves: Sequence[Sequence[Any]] = ()
    floor: float = 0.0
    notes: Sequence[Sequence[Any]] = ()
    marks: Sequence[Sequence[Any]] = ()
    levels: Sequence[tuple[float, str]] = ()
    ticks: Mapping[str, Sequence[tuple[float, str]]] = {}
    edge: float = 0.97
    explained: bool = False
    height: float = 5.0


PICTURES = {name: Picture(**row) for name, row in tables_of("stability/pictures.toml").items()}
"""The pictures, by the study's name."""


def draw(study: Study, folder: Path) -> Path:
    """Draw the study's picture, a PNG file."""
    path = folder / f"{study.name}.png"
    with_file(figure_of(study), path)
    return path


def figure_of(study: Study) -> Figure:
    """Return the study's picture."""
    row = PICTURES[study.name]
    figure, left = Figure(figsize=(8.4, row.height)), 0.1
    axes = figure.add_axes((left, 0.12, row.edge - left, 0.74))
    axes.set_title(row.title, fontsize=11, loc="left", pad=10)
    open_frame(axes, grid=True)
    x = next(iter(study.columns.values()))
    if not isinstance(x[0], str):
        axes.set(xlim=(x[0], x[-1]))
    axes.set(xlabel=row.x, ylabel=row.y, **row.set)
    curves = [Curve(column, _NAMED[color], *rest) for column, color, *rest in row.curves]
    for curve in curves:
        every = max(len(x) // curve.dots, 1) if curve.dots else 1
        width = curve.size if "-" in curve.style and "o" not in curve.style else 1.0
        y = study.columns[curve.column]
        y = [max(float(v), row.floor) for v in y] if row.floor else y
        axes.plot(x[::every], y[::every], curve.style, color=curve.color, linewidth=width, markersize=curve.size)
    if CURVE in study.columns:
        axes.plot(x, study.columns[CURVE], "--", color=GREY, linewidth=2.0, label=CURVE)
        figure.legend(loc="lower left", frameon=False, fontsize=9)
    _annotate(axes, row)
    if study.name in _MORE:
        _MORE[study.name](axes, study)
    _name_ends(axes, [_end(curve, study.columns[curve.column], row.floor) for curve in curves if curve.name])
    return figure


def _annotate(axes: Axes, row: Picture) -> None:
    for x, y, text, name, *align in row.notes:
        color = _NAMED[name]
        axes.text(x, y, text, color=_INK.get(color, color), fontsize=9.5, ha=align[0] if align else "left")
    for x, text, y, align in row.marks:
        axes.axvline(x, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(text, (x, y), (4 if align == "left" else -4, 0), xycoords=("data", "axes fraction"), color=GREY,
                      textcoords="offset points", ha=align, va="top", fontsize=9)  # fmt: skip
    for level, name in row.levels:
        axes.axhline(level, color=_NAMED[name], linewidth=0.8)
    for axis, ticks in row.ticks.items():
        axes.set(**{f"{axis}ticks": [at for at, _ in ticks], f"{axis}ticklabels": [text for _, text in ticks]})
        axes.minorticks_off()
    if row.explained:
        axes.text(0.02, 0.95, "lines: predicted, dots: measured", transform=axes.transAxes, fontsize=9)


def _end(curve: Curve, values: Sequence[float], floor: float) -> tuple[float, str, str]:
    """Return (height, text, colour) of a curve's name; the text also says if the last value is not finite."""
    shown = [max(float(v), floor) for v in values if math.isfinite(v) and v < _LARGEST]
    return shown[-1], curve.name if math.isfinite(values[-1]) else f"{curve.name},\nthen not finite", curve.color


def _name_ends(axes: Axes, names: Sequence[tuple[float, str, str]]) -> None:
    """Write names, given as (value, name, colour), at the right edge; they are moved apart where they would overlap."""
    to_fraction = axes.transData + axes.transAxes.inverted()
    x = axes.get_xlim()[1]
    ends = sorted((to_fraction.transform((x, v))[1], name, color) for v, name, color in names)
    places = iter(spread([y for y, name, _ in ends for _ in name.split("\n")], 0.052))
    for _, name, color in ends:
        y = float(np.mean([next(places) for _ in name.split("\n")]))
        axes.text(1.01, y, name, color=_INK.get(color, color), transform=axes.transAxes, va="center", fontsize=9)


def _recorded_passages(axes: Axes, study: Study) -> None:
    """Mark the errors that were recorded when law 4 was written down."""
    x, errors = zip(*LAWS[4]["recorded"], strict=True)
    axes.plot(x, errors, "D", color=BLACK, markersize=6, markerfacecolor="none", clip_on=False)


def _period(axes: Axes, study: Study) -> None:
    """Draw the time between two flips as an arrow."""
    period = next(f.measured for f in study.findings if f.what == "time between flips, s")
    t, exact = study.columns["time"], study.columns["exact"]
    first = next(k for k, v in enumerate(exact) if float(v) < 0.0)
    start = 0.5 * (float(t[first - 1]) + float(t[first]))
    axes.annotate("", (start + period, 2.45), xytext=(start, 2.45), arrowprops={"arrowstyle": "<->", "color": BLACK})
    axes.text(start + 0.5 * period, 2.5, "ln(16 / mc) / λ", ha="center", va="bottom", fontsize=9)


def _models(axes: Axes, study: Study) -> None:
    """Draw a row of dots for each model, one for each error, with its bound as a bar."""
    columns = study.columns
    models = list(dict.fromkeys(columns["model"]))
    axes.set_position((0.41, 0.12, 0.54, 0.74))
    axes.set_title(axes.get_title(loc="left"), fontsize=11, x=-0.57, loc="left", pad=10)
    axes.set(ylim=(len(models) - 0.4, -0.6))
    axes.set_yticks(range(len(models)), models, fontsize=9)
    for model, error, bound in zip(columns["model"], columns["error"], columns["bound"], strict=True):
        y = models.index(model)
        axes.plot([bound, bound], [y - 0.3, y + 0.3], color=BLACK, linewidth=1.5)
        axes.plot([min(max(error, 1e-17), 1e-7)], [y], "o", color=BLUE if error <= bound else VERMILION, markersize=4)


def _orders(axes: Axes, study: Study) -> None:
    """Draw each method's errors, and through the first of them the line whose slope is the predicted order."""
    orders = {f.what.removesuffix(": order"): f.predicted for f in study.findings}
    halvings = study.columns["halvings of the step"]
    axes.set(xlim=(-0.1, halvings[-1] + 0.1), xticks=halvings)
    palette = (ORANGE, GREEN, BLUE, VERMILION, PURPLE, SKY, BLACK, GREY)
    for name, color in zip(list(study.columns)[1:], palette, strict=True):
        errors = study.columns[name]
        axes.plot(halvings, [errors[0] * 2.0 ** (-orders[name] * k) for k in halvings], color=color, linewidth=0.9)
        axes.plot(halvings, errors, "o", color=color, markersize=5, label=f"{name}: {orders[name]:g}")
    axes.legend(title="order", frameon=False, loc="upper right", fontsize=9, alignment="left", ncols=2)


_MORE: dict[str, Callable[[Axes, Study], None]] = {
    "gimbal_passage": _recorded_passages, "intermediate_axis": _period, "product_models": _models,
    "orders_and_error_control": _orders,
}  # fmt: skip
"""The functions that draw what only one picture has, by the study's name."""


# Maps: small multiples, one panel for each method

_COLORS = dict(zip(VERDICTS, (GREEN, ORANGE, BLACK, SKY), strict=True))
_COLUMNS, _UP = 4, Context(prec=1, rounding=ROUND_CEILING)


def draw_maps(rows: Sequence[Row], path: Path) -> Path:
    """Draw a panel for each method, in the order of the rows; the titles of rbfmu's methods are bold."""
    names = list(dict.fromkeys(row.method for row in rows))
    lines = math.ceil((len(names) + 1) / _COLUMNS)
    figure = Figure(figsize=(11.5, 1.5 + 2.25 * lines))
    panels = figure.subplots(lines, _COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(0.075, 0.62 / height, 0.99, 1.0 - 1.15 / height, wspace=0.11, hspace=0.3)
    for panel, name in zip(panels, names, strict=False):
        _draw_map(panel, name, [row for row in rows if row.method == name])
    for panel in panels[max(len(names) - _COLUMNS, 0) :]:  # these have no panel below
        panel.tick_params(labelbottom=True)
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    words, seen = PICTURES["maps"], {row.verdict for row in rows}
    handles = [patches.Patch(color=color, label=verdict) for verdict, color in _COLORS.items() if verdict in seen]
    panels[len(names)].legend(handles=handles, loc="center", frameon=False, fontsize=11)
    figure.supxlabel(words.x)
    figure.supylabel(words.y)
    numbers = {"asked": ACCURACY, "turn": TURN, "long_turn": LONG_TURN, "right": LARGEST_ERROR}
    worst = _worst([row for row in rows if row.method in OURS])
    figure.suptitle(words.title.format(worst=worst, **numbers), fontsize=12)
    with_file(figure, path, 110)
    return path


def _draw_map(panel: Axes, name: str, rows: Sequence[Row]) -> None:
    steps, ratios = sorted({row.h_omega for row in rows}), sorted({row.moment_ratio for row in rows})
    values = np.zeros((len(ratios), len(steps)))
    for _, h, ratio, verdict, _ in rows:
        values[ratios.index(ratio), steps.index(h)] = VERDICTS.index(verdict)
    map_of_colors = colors.ListedColormap([*_COLORS.values()])
    panel.pcolormesh(np.log10(steps), np.log10(ratios), values, cmap=map_of_colors, vmin=-0.5, vmax=3.5)
    panel.set_xticks([-2, -1, 0, 1], ["0.01", "0.1", "1", "10"], fontsize=8)
    panel.set_yticks([-2, -1, 0], ["0.01", "0.1", "1"], fontsize=8)
    right = sum(row.verdict == VERDICTS[0] for row in rows) / len(rows)
    summary = f"within {_worst(rows):.0e} rad" if name in OURS else f"{right:.0%} right"
    title, weight = name.replace("quaternion not", "q not"), "bold" if name in OURS else "normal"
    panel.set_title(f"{title}: {summary}", fontsize=9, fontweight=weight, loc="left")


def _worst(rows: Sequence[Row]) -> float:
    """Return the largest error, rounded up to one digit."""
    return float(_UP.create_decimal(repr(max(row.error for row in rows))))
