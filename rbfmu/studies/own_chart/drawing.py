"""The picture of a chart of one's own scene: which method to use, seen in ten seconds."""

import math
import textwrap
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from rbfmu.studies.own_chart.case import FLOOR
from rbfmu.studies.own_chart.contestants import TAKES_NO
from rbfmu.studies.own_chart.findings import (
    KINDS,
    Reach,
    clipped,
    cost_text,
    digits,
    exhausted,
    headline,
    reaches,
    short_number,
    times,
)
from rbfmu.studies.own_chart.tables import conditions
from rbfmu.studies.work_precision.answers import error_of
from rbfmu.studies.work_precision.collection import STOPPED
from rbfmu.studies.work_precision.drawing import DPI, draw_lines, lines_of, name_lines

if TYPE_CHECKING:
    from rbfmu.studies.own_chart.result import Chart, Row

LARGEST = 1.0
_HOW = (
    "Lines: the best of each kind; at their names: the cost at the accuracy asked, by the setting that just meets it, "
    "which nobody knows beforehand. Large star: the plan, made beforehand. Small stars: plans for further "
    "digits. Arrowheads: stopped, as finer runs take too long."
)
PALE, DARK = "#f3f3f3", "#333333"


def drawn(chart: "Chart") -> Figure:
    """Return the picture."""
    figure = Figure(figsize=(10.5, 8.0), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.085, 0.235, 0.635, 0.555))
    lines = _lines(chart)
    stopped = {end.method for end in chart.ends if end.why == STOPPED}
    draw_lines(axes, lines, error_of, stopped)
    _limits(axes, chart, [row for line in lines.values() for row in line])
    _accuracy_asked(axes, chart)
    _plan(axes, chart)
    labels = {reach.kind: _label(reach) for reach in reaches(chart)}
    ends = lines | {"rbfmu's plan": [row for row in clipped(chart) if row.family == "planned"][:1]}
    name_lines(axes, ends, error_of, labels.__getitem__, 0.062)
    _words(figure, chart)
    return figure


def _lines(chart: "Chart") -> dict[str, list["Row"]]:
    """Return the front of each kind; that of closed forms only where it is not the plan itself."""
    lines = lines_of(clipped(chart), error_of)
    if chart.model in (row.method for row in lines.get("exact", ())):
        del lines["exact"]
    return lines


def _limits(axes: Any, chart: "Chart", rows: Sequence["Row"]) -> None:
    errors = [row.error for row in rows] + [chart.accuracy]
    axes.set_xlim(min(3.0 * max(errors), 3.0), 0.3 * min(*errors, FLOOR))
    costs = [row.seconds for row in rows]
    axes.set_ylim(min(costs) / 2.5, max(costs) * 2.5)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda cost, _: cost_text(cost).replace(".0 ", " ")))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda error, _: short_number(error)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())  # it would name ticks within a decade
    axes.set_xlabel(f"error, more accurate to the right ({short_number(FLOOR)}: round-off)")
    axes.set_ylabel("processor time for a simulated second")


def _accuracy_asked(axes: Any, chart: "Chart") -> None:
    """Shade where the accuracy is missed, and say so."""
    left, _ = axes.get_xlim()
    axes.axvspan(left, chart.accuracy, color=PALE, linewidth=0, zorder=-1)
    axes.axvline(chart.accuracy, color=DARK, linewidth=1.2, linestyle=(0, (5, 3)))
    axes.annotate(f"asked: {short_number(chart.accuracy)}", (chart.accuracy, 1.0), (0, 4),
                  xycoords=("data", "axes fraction"), textcoords="offset points", ha="center", va="bottom",
                  fontsize=11, weight="bold", color=DARK)  # fmt: skip


def _plan(axes: Any, chart: "Chart") -> None:
    """Mark the plan for the accuracy asked by a large star; those for further digits are small ones."""
    plan = chart.plan
    axes.plot([max(plan.error, FLOOR)], [plan.seconds], marker="*", markersize=24, color="#000000",
              markeredgecolor="white", markeredgewidth=1.2, zorder=6, clip_on=False)  # fmt: skip


def _label(reach: Reach) -> str:
    """Return a kind's name, and its cost at the accuracy asked."""
    without = "stopped" if reach.stopped else "misses"
    return f"{KINDS[reach.kind]}  {cost_text(reach.cost) if math.isfinite(reach.cost) else without}"


def _words(figure: Figure, chart: "Chart") -> None:
    first, second = headline(chart)
    title = textwrap.wrap(first, 84)
    below = 0.966 - 0.036 * len(title)
    figure.text(0.015, 0.98, "\n".join(title), fontsize=13.5, weight="bold", va="top")
    figure.text(0.015, below, second, fontsize=11.5, va="top")
    figure.text(0.015, below - 0.036, "\n".join(textwrap.wrap(_HOW, 150)), fontsize=8.5, color="#555555", va="top")
    said = (f"Run: {conditions(chart)}.", _further(chart), _small(chart))
    lines = [line for text in said for line in textwrap.wrap(text, 132)]
    figure.text(0.015, 0.15, "\n".join(lines[:6]), fontsize=9.5, va="top", color=DARK, linespacing=1.35)


def _further(chart: "Chart") -> str:
    more = [(times(ratio), short_number(row.value)) for row, ratio in digits(chart)][1:]
    why = exhausted(chart)
    if not more:
        return f"Further digits: {why}" if why else ""
    spans = [(ratio, [value for _, value in group]) for ratio, group in groupby(more, lambda one: one[0])]
    said = [f"{' to '.join(dict.fromkeys((values[0], values[-1])))}: {ratio}" for ratio, values in spans]
    end = [f"no plan at {why.split(':')[0]}"] if chart.refusal else []
    return "Further digits, and their cost by that of the plan: " + ", ".join([*said, *end])


def _small(chart: "Chart") -> str:
    wrong = [f"{m.model} {short_number(m.error)}" for m in chart.too_small if not m.why]
    said = [f"Models that are too small, and their errors: {', '.join(wrong)}."] if wrong else []
    for why in dict.fromkeys(m.why for m in chart.too_small if m.why.startswith(TAKES_NO)):
        names = ", ".join(m.model for m in chart.too_small if m.why == why)
        said.append(f"Models without {why.removeprefix(TAKES_NO).strip()}: {names}.")
    return " ".join(said)
