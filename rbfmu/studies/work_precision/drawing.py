"""Draw the collected measurements: one chart for each motion, and one that shows which method to use."""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator

from rbfmu.plot import open_frame
from rbfmu.studies.work_precision.answers import M, Measured, error_of, front, rounded, text_of
from rbfmu.studies.work_precision.cases import CHECKPOINTS, OUTPUT_STEP
from rbfmu.studies.work_precision.collection import STOPPED, Ending, Point
from rbfmu.studies.work_precision.plans import REFUSED, Verdict
from rbfmu.studies.work_precision.tables import method_of, short

GROUPS = {
    "rbfmu's plan": "#000000",
    "exact": "#009e73",
    "Taylor series": "#56b4e9",
    "DOP853": "#0072b2",
    "splitting": "#cc79a7",
    "Moser-Veselov": "#8a7500",
    "heyoka.py": "#d55e00",
    "numbalsoda": "#e69f00",
    "SciPy odeint": "#a0522d",
    "SciPy solve_ivp": "#c97b63",
    "MuJoCo": "#7b3294",
    "Basilisk": "#b58ac2",
    "Drake": "#5e3c99",
    "RK4, Euler and others": "#8c8c8c",
}
"""The colour of each line, which is the best of a group of methods; the library's own groups come first."""
OWN_GROUPS = frozenset(("rbfmu's plan", "exact", "Taylor series", "DOP853", "splitting"))
_FAMILIES = {
    "planned": "rbfmu's plan",
    "Taylor": "Taylor series",
    "classic": "RK4, Euler and others",
}
PEER = "#f6b58a"
"""The colour of a cell in which a peer is cheaper than the plan."""
CELLS = {"Taylor": "#a9d8f5", "DOP853": "#7fb3de", "splitting": "#e3b7cf"}
EXACT = "#8fd3bd"
DPI = 120
GAIN = 0.8
"""A point is drawn only if its error is below this part of the last one's, so that a line ends with its digits."""


def group_of(point: Measured) -> str:
    """Return the line that a point belongs to."""
    return kind_of(point.method, point.family)


def kind_of(method: str, family: str) -> str:
    """Return the line that a method of a family belongs to."""
    if family != "peer":
        return _FAMILIES.get(family, family)
    if method.startswith("SciPy") and method != "SciPy odeint":
        return "SciPy solve_ivp"
    return next(name for name in GROUPS if method.startswith(name))


def draw_case(points: Sequence[Point], endings: Sequence[Ending], path: Path) -> Path:
    """Draw time against accuracy: few outputs at the left, many at the right."""
    counts = sorted({p.outputs for p in points})
    figure, panels = _panels(len(counts), points[0])
    title = f"{points[0].title.capitalize()}: what an accuracy costs\nlines: the best of each kind; stars: as planned"
    figure.suptitle(f"{title}; arrowheads: {STOPPED}", fontsize=13, x=0.02, ha="left")
    drawn = []
    for axes, count in zip(panels, counts, strict=True):
        mine = [p for p in points if p.outputs == count]
        stopped = {e.method for e in endings if (e.case, e.outputs) == mine[0].motion and e.stopped}
        drawn.append((lines_of(mine, error_of), error_of))
        draw_lines(axes, *drawn[-1], stopped)
        axes.set_title(_outputs(count), fontsize=12, loc="left")
        axes.set_xlabel("attitude error (rad), more accurate to the right")
    return _finished(figure, panels, drawn, path)


def draw_kept(points: Sequence[Point], path: Path) -> list[Path]:
    """Draw the drift of conserved quantities against time, for few outputs; no file if nothing is conserved."""
    few = [p for p in points if p.outputs == CHECKPOINTS]
    names = [n for n in ("energy", "momentum", "vertical_momentum") if any(math.isfinite(drift_of(n)(p)) for p in few)]
    if not names:
        return []
    figure, panels = _panels(len(names), few[0])
    title = f"{few[0].title.capitalize()}: drift of what the motion conserves\nlines: the best of each kind"
    figure.suptitle(f"{title}; stars: as planned", fontsize=13, x=0.02, ha="left")
    drawn = []
    for axes, name in zip(panels, names, strict=True):
        drawn.append((lines_of(few, drift_of(name)), drift_of(name)))
        draw_lines(axes, *drawn[-1], set())
        axes.set_xlabel(f"drift of the {name.replace('_', ' ')} (relative), better to the right")
    return [_finished(figure, panels, drawn, path)]


def _panels(count: int, example: Point) -> tuple[Figure, Any]:
    width = 1.5 + 6.9 * count
    figure = Figure(figsize=(width, 7.0), dpi=DPI)
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, count, sharey=True, squeeze=False)[0]
    figure.subplots_adjust(left=1.05 / width, right=1.0 - 1.85 / width, wspace=0.4, top=0.86, bottom=0.09)
    panels[0].set_ylabel(f"processor time of the run of {example.simulated:,.0f} s, less is better")
    return figure, panels


def _finished(figure: Figure, panels: Any, drawn: Sequence[Any], path: Path) -> Path:
    """Write the names last, when the limits of all panels are known, and save the figure."""
    for axes, (lines, error) in zip(panels, drawn, strict=True):
        axes.tick_params(labelleft=True)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda seconds, _: _tick(seconds)))
        name_lines(axes, lines, error)
    figure.savefig(path, dpi=DPI)
    return path


def drift_of(name: str) -> Callable[[Point], float]:
    """Return a function that gives a point's drift, which is shown as at least 1e-17."""
    return lambda p: max(getattr(p, name + "_drift"), 1e-17)


def _outputs(count: int) -> str:
    if count == CHECKPOINTS:
        return f"{count} outputs over the run"
    return f"{count:,} outputs, one every {OUTPUT_STEP:g} s"


def _tick(seconds: float) -> str:
    return text_of(seconds).replace(".0 ", " ")


def lines_of(points: Sequence[M], error: Callable[[M], float]) -> dict[str, list[M]]:
    """Return the Pareto front of each group."""
    lines = {}
    for name in GROUPS:
        mine = [p for p in points if group_of(p) == name and math.isfinite(error(p)) and p.seconds > 0.0]
        if mine:
            lines[name] = front(mine, error, GAIN)
    return lines


def draw_lines(axes: Any, lines: dict[str, list[M]], error: Callable[[M], float], stopped: set[str]) -> None:
    """Draw the lines by name, those of the library over all others; stopped: methods whose line ends in an arrow."""
    for name, line in reversed(lines.items()):
        x, y = [error(p) for p in line], [p.seconds for p in line]
        style: dict[str, Any] = {"color": GROUPS[name], "linewidth": 2.2 if name in OWN_GROUPS else 1.4}
        if name == "rbfmu's plan":
            style |= {"linestyle": "none", "marker": "*", "markersize": 11, "zorder": 5}
        elif len(line) == 1:
            style |= {"marker": "D", "markersize": 7}
        axes.loglog(x, y, clip_on=False, **style)
        if line[-1].method in stopped:
            axes.loglog(x[-1:], y[-1:], marker=">", markersize=8, color=GROUPS[name], clip_on=False)
    axes.invert_xaxis()
    axes.xaxis.set_major_locator(LogLocator(numticks=9))
    open_frame(axes, grid=True)


def name_lines(
    axes: Any,
    lines: dict[str, list[M]],
    error: Callable[[M], float],
    text: Callable[[str], str] = str,
    apart: float = 0.047,
) -> None:
    """Write names in a column at the right, in the order of the lines' ends, each tied to its end.

    text: what is written for a name; apart: the least distance of two, as a part of the axes' height.
    """
    bottom, top = axes.get_ylim()

    def height(seconds: float) -> float:
        return math.log(seconds / bottom) / math.log(top / bottom)

    ends = {name: line[-1] for name, line in lines.items()}
    names = sorted(ends, key=lambda name: ends[name].seconds)
    for name, y in zip(names, spread([height(ends[name].seconds) for name in names], apart), strict=True):
        color = GROUPS[name]
        axes.annotate(
            text(name),
            (error(ends[name]), ends[name].seconds),
            (1.035, y),
            textcoords="axes fraction",
            annotation_clip=False,
            color=color,
            fontsize=10,
            weight="bold" if name in OWN_GROUPS else "normal",
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": color,
                "linewidth": 0.5,
                "alpha": 0.7,
                "shrinkA": 1,
                "shrinkB": 3,
                "relpos": (0.0, 0.5),
            },
        )


def spread(places: Sequence[float], apart: float, highest: float = 1.0) -> list[float]:
    """Return rising places, moved as little as may be so that they are `apart` and none is above `highest`.

    Where places are too close, they are spread about their mean.
    """
    groups: list[list[float]] = []
    for i, place in enumerate(places):
        groups.append([place - i * apart])
        while len(groups) > 1 and mean(groups[-2]) >= mean(groups[-1]):
            last = groups.pop()
            groups[-1] += last
    found = [mean(group) for group in groups for _ in group]
    found = [max(place, 0.0) + i * apart for i, place in enumerate(found)]
    limit = highest
    for i in reversed(range(len(found))):
        found[i] = min(found[i], limit)
        limit = found[i] - apart
    return found


# The overview: which method to use


def draw_answers(found: Sequence[Verdict], path: Path) -> Path:
    """Draw motion by accuracy, few outputs and many: what to use, its time, and what the other costs."""
    cases, accuracies = list(dict.fromkeys(v.case for v in found)), list(dict.fromkeys(v.accuracy for v in found))
    width = 1.6 * len(accuracies)
    figure = Figure(figsize=(3.0 + 2.0 * width, 2.0 + 0.95 * len(cases)))
    FigureCanvasAgg(figure)
    axes = figure.add_axes(
        (2.4 / figure.get_figwidth(), 0.02, 1.0 - 2.5 / figure.get_figwidth(), 0.97 - 1.5 / figure.get_figheight())
    )
    columns = dict(_columns(accuracies))
    for case in (case for case in cases if not any(v.many for v in found if v.case == case)):
        axes.text(columns[True, accuracies[0]] - 0.45, cases.index(case), "few outputs only", va="center", color="0.5")
    for v in found:
        _draw_cell(axes, columns[v.many, v.accuracy], cases.index(v.case), v)
    axes.set_xlim(-0.55, max(columns.values()) + 0.55)
    axes.set_ylim(len(cases) - 0.5, -0.5)
    axes.set_xticks(list(columns.values()), [short(accuracy) for _, accuracy in columns], fontsize=11)
    axes.set_yticks(range(len(cases)), [_row_name(found, case) for case in cases], fontsize=11)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    half = 0.5 * (len(accuracies) - 1)
    for many, text in ((False, f"{CHECKPOINTS} outputs over the run"), (True, f"an output every {OUTPUT_STEP:g} s")):
        x = columns[many, accuracies[0]] + half
        axes.annotate(f"{text}\nattitude error at most (rad)", (x, 1.0), (0, 24), xycoords=("data", "axes fraction"),
                      textcoords="offset points", ha="center", fontsize=11, annotation_clip=False)  # fmt: skip
    figure.suptitle(
        "The method to use for an accuracy; below it, the processor time of the run\n"
        f"orange: another package is cheaper than rbfmu's plan; even: within noise, {found[0].noise:.2f} times",
        fontsize=12.5, x=0.015, ha="left", y=0.985, va="top",
    )  # fmt: skip
    figure.savefig(path, dpi=DPI)
    return path


def _columns(accuracies: Sequence[float]) -> Iterator[tuple[tuple[bool, float], float]]:
    for i, accuracy in enumerate(accuracies):
        yield (False, accuracy), float(i)
    for i, accuracy in enumerate(accuracies):
        yield (True, accuracy), i + len(accuracies) + 0.3


def _row_name(found: Sequence[Verdict], case: str) -> str:
    title = next(v.title for v in found if v.case == case)
    return (
        f"{title} ({case})".replace(", ", ",\n").replace("thruster ", "thruster\n").replace("constant ", "constant\n")
    )


def _draw_cell(axes: Any, x: float, y: float, v: Verdict) -> None:
    color, name, cost, other = cell_of(v)
    axes.add_patch(Rectangle((x - 0.48, y - 0.45), 0.96, 0.9, color=color, linewidth=0))
    axes.text(x, y - 0.25, name, ha="center", va="center", fontsize=9.5)
    axes.text(x, y + 0.02, cost, ha="center", va="center", fontsize=13, weight="bold")
    axes.text(x, y + 0.28, other, ha="center", va="center", fontsize=8, color="#333333")


def cell_of(v: Verdict) -> tuple[str, str, str, str]:
    """Return a cell's colour, the method to use, its time, and a remark on the other."""
    if v.method == REFUSED:
        return ("#eeeeee", "no method", "", "plan refuses") if v.peer is None else (
            PEER, v.peer.method, text_of(v.peer.cost), "plan refuses")  # fmt: skip
    if v.peer and v.lead < 1.0 and not v.even:
        return PEER, v.peer.method, text_of(v.peer.cost), f"rbfmu's plan: {rounded(1.0 / v.lead)}×"
    color = next((color for word, color in CELLS.items() if word in v.method), EXACT)
    if v.peer is None:
        other = f"peers {STOPPED}" if v.stopped else "no peer reaches it"
    else:
        other = f"{v.peer.method}: {'even' if v.even else rounded(v.lead) + '×'}"
    return color, method_of(v), text_of(v.cost), other
