"""The pictures of charts: the method to use on a scene, drifts, and plans compared with peers on many scenes."""

import math
import textwrap
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from statistics import mean

from matplotlib import patches, ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rbfmu.plot import open_frame, with_file
from rbfmu.studies import cost_text, short_number, times
from rbfmu.studies.chart import Verdict, cases
from rbfmu.studies.chart.result import KINDS, OWN_KINDS, STOPPED, TAKES_NO, Chart, Row, front

DPI = 120
GAIN = 0.8
"""A point is drawn only if its error is below GAIN times that of the point before: a line ends where errors stop
falling."""
LEAST_DRIFT = 1e-17
PALE, DARK = "#f3f3f3", "#333333"
_HOW = (
    "Lines: the best of each kind; at their names: the cost at the accuracy asked, by the setting that just meets it, "
    "which nobody knows beforehand. Large star: the plan, made beforehand. Small stars: plans for other "
    "accuracies. Arrowheads: stopped, as finer runs take too long."
)


def figure_of(chart: Chart) -> Figure:
    """Return the picture of a chart: error against cost."""
    figure = Figure(figsize=(10.5, 8.0), dpi=DPI)
    axes = figure.add_axes((0.085, 0.235, 0.635, 0.555))
    lines = lines_of(chart.above_round_off)
    if chart.model in (row.method for row in lines.get("exact", ())):  # this point is the plan itself
        del lines["exact"]
    draw_lines(axes, lines, {end.method for end in chart.ends if end.stopped})
    _limits(axes, chart, [row for line in lines.values() for row in line])
    _accuracy_asked(axes, chart)
    plan = replace(chart.plan, error=max(chart.plan.error, cases.FLOOR))
    axes.plot([plan.error], [plan.seconds], marker="*", markersize=24, color="#000000",
              markeredgecolor="white", markeredgewidth=1.2, zorder=6, clip_on=False)  # fmt: skip
    labels = {}
    for reach in chart.reaches:
        missed = "stopped" if reach.stopped else "misses"
        labels[reach.kind] = f"{reach.name}  {cost_text(reach.cost) if math.isfinite(reach.cost) else missed}"
    name_lines(axes, lines | {"rbfmu's plan": [plan]}, labels.__getitem__, 0.062)
    _words(figure, chart)
    return figure


def _limits(axes: Axes, chart: Chart, rows: Sequence[Row]) -> None:
    errors = [row.error for row in rows] + [chart.accuracy]
    axes.set_xlim(min(3.0 * max(errors), 3.0), 0.3 * min(*errors, cases.FLOOR))
    costs = [row.seconds for row in rows]
    axes.set_ylim(min(costs) / 2.5, max(costs) * 2.5)
    _name_ticks(axes)
    axes.set_xlabel(f"error, more accurate to the right ({short_number(cases.FLOOR)}: round-off)")
    axes.set_ylabel("processor time for a simulated second")


def _name_ticks(axes: Axes) -> None:
    axes.yaxis.set_major_formatter(lambda cost, _: cost_text(cost).replace(".0 ", " "))
    axes.xaxis.set_major_formatter(lambda error, _: short_number(error))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter("")  # else ticks within a decade get numbers


def _accuracy_asked(axes: Axes, chart: Chart) -> None:
    """Shade where the accuracy is missed, and say so."""
    left, _ = axes.get_xlim()
    axes.axvspan(left, chart.accuracy, color=PALE, linewidth=0, zorder=-1)
    axes.axvline(chart.accuracy, color=DARK, linewidth=1.2, linestyle=(0, (5, 3)))
    axes.annotate(f"asked: {short_number(chart.accuracy)}", (chart.accuracy, 1.0), (0, 4),
                  xycoords=("data", "axes fraction"), textcoords="offset points", ha="center", va="bottom",
                  fontsize=11, weight="bold", color=DARK)  # fmt: skip


def _words(figure: Figure, chart: Chart) -> None:
    first, second = chart.headline
    title = textwrap.wrap(first, 84)
    below = 0.966 - 0.036 * len(title)
    figure.text(0.015, 0.98, "\n".join(title), fontsize=13.5, weight="bold", va="top", parse_math=False)
    figure.text(0.015, below, second, fontsize=11.5, va="top")
    figure.text(0.015, below - 0.036, "\n".join(textwrap.wrap(_HOW, 150)), fontsize=8.5, color="#555555", va="top")
    paragraphs = (f"Run: {chart.conditions}.", _further(chart), _small(chart))
    lines = [line for text in paragraphs for line in textwrap.wrap(text, 132)]
    figure.text(0.015, 0.15, "\n".join(lines[:6]), fontsize=9.5, va="top", color=DARK, linespacing=1.35)


def _further(chart: Chart) -> str:
    more = [(times(row.seconds / chart.plan.seconds), short_number(row.value)) for row in chart.plans[1:]]
    why = chart.why_no_further
    if not more:
        return f"Further digits: {why}" if why else ""
    spans = [(ratio, [value for _, value in group]) for ratio, group in groupby(more, lambda pair: pair[0])]
    costs = [f"{' to '.join(dict.fromkeys((values[0], values[-1])))}: {ratio}" for ratio, values in spans]
    end = [f"no plan at {why.split(':')[0]}"] if chart.refusal else []
    return "Further digits, and their cost by that of the plan: " + ", ".join([*costs, *end])


def _small(chart: Chart) -> str:
    wrong = [f"{m.model} {short_number(m.error)}" for m in chart.too_small if not m.why]
    sentences = [f"Models that are too small, and their errors: {', '.join(wrong)}."] if wrong else []
    for why in dict.fromkeys(m.why for m in chart.too_small if m.why.startswith(TAKES_NO)):
        names = ", ".join(m.model for m in chart.too_small if m.why == why)
        sentences.append(f"Models without {why.removeprefix(TAKES_NO).strip()}: {names}.")
    return " ".join(sentences)


# Lines and their names


def lines_of(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the Pareto front of each kind."""
    lines = {kind: front([row for row in rows if row.kind == kind and row.seconds > 0.0], GAIN) for kind in KINDS}
    return {kind: line for kind, line in lines.items() if line}


def draw_lines(axes: Axes, lines: dict[str, list[Row]], stopped: Collection[str] = ()) -> None:
    """Draw a line for each kind, those of the library on top; stopped: methods whose line ends with an arrowhead."""
    for kind, line in reversed(lines.items()):
        x, y = [row.error for row in line], [row.seconds for row in line]
        style: dict[str, object] = {"color": KINDS[kind], "linewidth": 2.2 if kind in OWN_KINDS else 1.4}
        if kind == "rbfmu's plan":
            style |= {"linestyle": "none", "marker": "*", "markersize": 11, "zorder": 5}
        elif len(line) == 1:
            style |= {"marker": "D", "markersize": 7}
        axes.loglog(x, y, clip_on=False, **style)
        if line[-1].method in stopped:
            axes.loglog(x[-1:], y[-1:], marker=">", markersize=8, color=KINDS[kind], clip_on=False)
    axes.invert_xaxis()
    axes.xaxis.set_major_locator(ticker.LogLocator(numticks=9))
    open_frame(axes, grid=True)


def name_lines(axes: Axes, lines: dict[str, list[Row]], text: Callable[[str], str] = str, apart: float = 0.047) -> None:
    """Write the kinds' names in a column at the right, in the order of the lines' ends, each tied to its line's end.

    text: returns the text for a kind; apart: the least distance of two names, as a part of the axes' height.
    """
    bottom, top = axes.get_ylim()

    def height(seconds: float) -> float:
        return math.log(seconds / bottom) / math.log(top / bottom)

    ends = {kind: line[-1] for kind, line in lines.items()}
    kinds = sorted(ends, key=lambda kind: ends[kind].seconds)
    tie = {"arrowstyle": "-", "linewidth": 0.5, "alpha": 0.7, "shrinkA": 1, "shrinkB": 3, "relpos": (0.0, 0.5)}
    for kind, y in zip(kinds, spread([height(ends[kind].seconds) for kind in kinds], apart), strict=True):
        color, weight = KINDS[kind], "bold" if kind in OWN_KINDS else "normal"
        axes.annotate(text(kind), (ends[kind].error, ends[kind].seconds), (1.035, y), textcoords="axes fraction",
                      annotation_clip=False, color=color, fontsize=10, weight=weight, va="center",
                      arrowprops=tie | {"color": color})  # fmt: skip


def spread(places: Sequence[float], apart: float) -> list[float]:
    """Return rising places, moved so little that they are `apart` or more from each other and at most 1.

    Places that are too close are spread about their mean.
    """
    groups: list[list[float]] = []
    for i, place in enumerate(places):
        groups.append([place - i * apart])
        while len(groups) > 1 and mean(groups[-2]) >= mean(groups[-1]):
            last = groups.pop()
            groups[-1] += last
    found = [mean(group) for group in groups for _ in group]
    found = [max(place, 0.0) + i * apart for i, place in enumerate(found)]
    limit = 1.0
    for i in reversed(range(len(found))):
        found[i] = min(found[i], limit)
        limit = found[i] - apart
    return found


# Drifts


def draw_kept(chart: Chart, path: Path) -> list[Path]:
    """Draw the drift of conserved quantities against cost; write no file if nothing is conserved."""
    kept = {}
    for name, column in cases.DRIFTS.items():
        drifts = [(row, getattr(row, column)) for row in chart.rows]
        if rows := [replace(row, error=max(drift, LEAST_DRIFT)) for row, drift in drifts if math.isfinite(drift)]:
            kept[name] = lines_of(rows)
    if not kept:
        return []
    width = 1.5 + 6.9 * len(kept)
    figure = Figure(figsize=(width, 7.0), dpi=DPI)
    panels = figure.subplots(1, len(kept), sharey=True, squeeze=False)[0]
    figure.subplots_adjust(left=1.05 / width, right=1.0 - 1.85 / width, wspace=0.4, top=0.86, bottom=0.09)
    figure.suptitle(f"{chart.scene.capitalize()}: drift of what the motion conserves\n"
                    "lines: the best of each kind; stars: as planned", fontsize=13, x=0.02, ha="left")  # fmt: skip
    panels[0].set_ylabel("processor time for a simulated second")
    for axes, (name, lines) in zip(panels, kept.items(), strict=True):
        draw_lines(axes, lines)
        axes.tick_params(labelleft=True)
        axes.set_xlabel(f"drift of the {name} (relative), better to the right")
    for axes, lines in zip(panels, kept.values(), strict=True):  # the limits of all panels are known
        _name_ticks(axes)
        name_lines(axes, lines)
    with_file(figure, path, "figure")
    return [path]


# Plans compared with peers

PEER, EXACT, NONE = "#f6b58a", "#8fd3bd", "#eeeeee"
"""The colours of cells: a peer is cheaper than the plan, the plan is a closed form, no method meets the accuracy."""
CELLS = {"Taylor": "#a9d8f5", "DOP853": "#7fb3de", "splitting": "#e3b7cf"}


def draw_answers(found: Sequence[Verdict], path: Path) -> Path:
    """Draw a table of motions and accuracies, with few and many outputs: the method to use and its cost."""
    rows, accuracies = list(dict.fromkeys(v.chart.key for v in found)), list(dict.fromkeys(v.accuracy for v in found))
    n = len(accuracies)
    columns = {(many, a): i + many * (n + 0.3) for many in (False, True) for i, a in enumerate(accuracies)}
    width, height = 3.0 + 3.2 * n, 2.0 + 0.95 * len(rows)
    figure = Figure(figsize=(width, height), dpi=DPI)
    axes = figure.add_axes((2.4 / width, 0.02, 1.0 - 2.5 / width, 0.97 - 1.5 / height))
    for key in rows:
        if not any(v.chart.many for v in found if v.chart.key == key):
            axes.text(n - 0.15, rows.index(key), "few outputs only", va="center", color="0.5")
    for v in found:
        _draw_cell(axes, columns[v.chart.many, v.accuracy], rows.index(v.chart.key), v)
    axes.set(xlim=(-0.55, max(columns.values()) + 0.55), ylim=(len(rows) - 0.5, -0.5))
    axes.set_xticks([*columns.values()], [short_number(accuracy) for _, accuracy in columns], fontsize=11)
    names = {v.chart.key: f"{v.chart.scene} ({v.chart.key})" for v in found}
    axes.set_yticks(range(len(rows)), [textwrap.fill(name, 18) for name in names.values()], fontsize=11)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    few, often = f"{cases.CHECKPOINTS} outputs over the run", f"an output every {cases.OUTPUT_STEP:g} s"
    for many, text in ((False, few), (True, often)):
        x = columns[many, accuracies[0]] + 0.5 * (n - 1)
        axes.annotate(f"{text}\nerror at most", (x, 1.0), (0, 24), xycoords=("data", "axes fraction"),
                      textcoords="offset points", ha="center", fontsize=11, annotation_clip=False)  # fmt: skip
    figure.suptitle(
        "The method to use for an accuracy; below it, the processor time for a simulated second\n"
        "orange: another package is cheaper than rbfmu's plan; even: within the noise",
        fontsize=12.5, x=0.015, ha="left", y=0.985, va="top",
    )  # fmt: skip
    with_file(figure, path, "figure")
    return path


def _draw_cell(axes: Axes, x: float, y: float, v: Verdict) -> None:
    color, name, cost, other = cell_of(v)
    axes.add_patch(patches.Rectangle((x - 0.48, y - 0.45), 0.96, 0.9, color=color, linewidth=0))
    axes.text(x, y - 0.25, name, ha="center", va="center", fontsize=9.5)
    axes.text(x, y + 0.02, cost, ha="center", va="center", fontsize=13, weight="bold")
    axes.text(x, y + 0.28, other, ha="center", va="center", fontsize=8, color=DARK)


def cell_of(v: Verdict) -> tuple[str, str, str, str]:
    """Return a cell's colour, the method to use (the plan or a peer), its cost, and a remark on the other one."""
    if v.peer and v.lead < 1.0 and not v.even:
        remark = "plan refuses" if v.is_refused else f"rbfmu's plan: {times(1.0 / v.lead)}"
        return PEER, v.peer.method, cost_text(v.peer.cost), remark
    if v.is_refused:
        return NONE, "no method", "", "plan refuses"
    color = next((color for word, color in CELLS.items() if word in v.method), EXACT)
    none = f"peers {STOPPED}" if v.stopped else "no peer reaches it"
    return color, v.plan, cost_text(v.cost), f"{v.peer.method}: {v.against}" if v.peer else none
