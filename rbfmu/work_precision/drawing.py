"""Draws the collected figures: one chart for each case, and one that answers the question at a glance."""

import math
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator
from matplotlib.transforms import Bbox

from rbfmu.charts import open_frame
from rbfmu.work_precision.answers import Answer, advice, front, rival, text_of
from rbfmu.work_precision.collection import Point

COLORS = {
    "exact": "#009e73",
    "DOP853": "#0072b2",
    "kicks": "#cc79a7",
    "Taylor": "#56b4e9",
    "Moser-Veselov": "#e69f00",
    "peer": "#d55e00",
    "classic": "#8c8c8c",
    "planned": "#000000",
}
"""By family; Okabe and Ito's, grey for what people have always used."""
WIDTHS = {"classic": 0.9, "peer": 1.1, "Taylor": 1.6, "Moser-Veselov": 1.4}
SHORT = {
    "RK4, quaternion": "RK4, q",
    "RK4, quaternion not normalised": "RK4, q not normalised",
    "Moser-Veselov, order 10": "Moser-Veselov 10",
    "kicks, order 2 (Strang)": "kicks 2 (Strang)",
    "kicks, order 4": "kicks 4",
    "kicks, order 6": "kicks 6",
    **{f"Taylor, order {n}": f"Taylor {n}" for n in (6, 8, 12, 16, 20, 24)},
    "DOP853, fixed steps": "DOP853 fixed",
    "DOP853, error control": "DOP853",
    "SciPy LSODA, f in NumPy": "SciPy LSODA, NumPy",
    "rbfmu, as planned": "rbfmu's plan",
}
IMPORTANCE = ("planned", "exact", "kicks", "DOP853", "Taylor", "Moser-Veselov", "peer", "classic")
DPI = 120
GAIN = 0.8
"""Points that gain less are left out: a line ends where its digits do."""
_ERROR = "attitude error (rad), more accurate to the right"


def draw_case(points: Sequence[Point], found: Sequence[Answer], path: Path) -> Path:
    """Cost against accuracy, large; right-hand sides and drifts beside it."""
    drifts = [
        (f"{name.replace('_', ' ')} drift", name + "_drift")
        for name in ("energy", "momentum", "vertical_momentum")
        if any(math.isfinite(getattr(p, name + "_drift")) for p in points)
    ]
    figure = Figure(figsize=(14.0, 8.2), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    counted = len({p.method for p in points if p.right_hand_sides > 0.0}) > 1
    side = counted + len(drifts)
    grid = figure.add_gridspec(side, 2, width_ratios=(2.1, 1.0))
    main = figure.add_subplot(grid[:, 0])
    _draw(main, points, lambda p: p.attitude_error, lambda p: p.cost, 9)
    main.set_xlabel(_ERROR)
    main.set_ylabel("time per simulated second (s)")
    panels = [figure.add_subplot(grid[k, 1]) for k in range(side)]
    if counted:
        _draw(panels[0], points, lambda p: p.attitude_error, lambda p: p.right_hand_sides / p.simulated)
        panels[0].set_ylabel("right-hand sides\nper simulated second")
        panels[0].set_xlabel(_ERROR)
    for axes, (label, name) in zip(panels[counted:], drifts, strict=True):
        _draw(axes, points, lambda p, name=name: max(getattr(p, name), 1e-17), lambda p: p.cost)  # type: ignore[misc]
        axes.set_xlabel(f"{label} (relative), better to the right")
        axes.set_ylabel("time per\nsimulated second (s)")
    figure.suptitle(f"{points[0].title}. Cheapest: {advice(found)}", fontsize=13)
    main.set_xlim(right=main.get_xlim()[1] * 10.0**-1.3)  # room for names
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    _name_lines(main, points)
    figure.savefig(path, dpi=DPI)
    return path


def _methods(points: Sequence[Point]) -> list[str]:
    families = {p.method: p.family for p in points}
    return sorted(families, key=lambda name: IMPORTANCE.index(families[name]))


def _draw(
    axes: Any, points: Sequence[Point], x: Callable[[Point], float], y: Callable[[Point], float], ticks: int = 6
) -> None:
    for name in reversed(_methods(points)):
        mine = [p for p in points if p.method == name and math.isfinite(x(p)) and y(p) > 0.0]
        shown = front(mine, x, GAIN)
        if not shown:
            continue
        family = shown[0].family
        style = "none" if family == "planned" or len(shown) == 1 else "-"
        axes.loglog(
            [x(p) for p in shown],
            [y(p) for p in shown],
            color=COLORS[family],
            linewidth=WIDTHS.get(family, 2.0),
            linestyle=style,
            marker={"planned": "*", "exact": "D"}.get(family, "o" if len(shown) == 1 else None),
            markersize=9 if family == "planned" else 6,
            clip_on=False,
        )
    axes.invert_xaxis()
    axes.xaxis.set_major_locator(LogLocator(numticks=ticks))
    open_frame(axes, grid=True)


def _name_lines(axes: Any, points: Sequence[Point]) -> None:
    """Names at the lines' most accurate ends or, without room there, along them; the important first."""
    renderer = axes.figure.canvas.get_renderer()
    places = {}
    for name in _methods(points):
        line = front([p for p in points if p.method == name], gain=GAIN)
        places[name] = [axes.transData.transform((p.attitude_error, p.cost)) for p in reversed(line)]
    taken = [_box(place[0]) for place in places.values()]
    frame = axes.get_window_extent(renderer)
    for name in _methods(points):
        family = next(p.family for p in points if p.method == name)
        for at, offset in product(places[name][::4], _OFFSETS):
            text = _annotation(axes, name, family, at, offset)
            box = text.get_window_extent(renderer)
            inside = box.x1 < frame.x1 + 20 and box.y0 > frame.y0 and box.x0 > frame.x0
            if inside and not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            text.remove()


def _annotation(axes: Any, name: str, family: str, at: Any, offset: tuple[int, int]) -> Any:
    far = math.hypot(*offset) > 16
    arrow = {"arrowstyle": "-", "color": COLORS[family], "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2} if far else None
    place = {"xycoords": "figure pixels", "textcoords": "offset points", "va": "center"}
    return axes.annotate(
        SHORT.get(name, name),
        at,
        offset,
        color="#666666" if family == "classic" else COLORS[family],
        fontsize=8 if family == "classic" else 9.5,
        ha="left" if offset[0] >= 0 else "right",
        arrowprops=arrow,
        **place,
    )


_OFFSETS = [
    (round(r * math.cos(a)), round(r * math.sin(a)))
    for r in (8, 16, 26, 38)
    for a in np.radians([0, 20, -20, 45, -45, 70, -70, 110, -110, 160, -160])
]


def _box(at: Any, half: float = 3.0) -> Bbox:
    return Bbox([at - half, at + half])


def draw_answers(found: Sequence[Answer], path: Path) -> Path:
    """Case by accuracy: the cheapest method by colour and name, its cost, how much more the best peer costs."""
    cases = list(dict.fromkeys(answer.case for answer in found))
    decades = sorted({answer.accuracy for answer in found}, reverse=True)
    figure = Figure(figsize=(2.2 + 1.12 * len(decades), 1.6 + 0.95 * len(cases)), layout="constrained")
    axes = figure.subplots()
    for answer in found:
        column, row = decades.index(answer.accuracy), cases.index(answer.case)
        _draw_cell(axes, column, row, answer)
    axes.set_xlim(-0.5, len(decades) - 0.5)
    axes.set_ylim(len(cases) - 0.5, -0.5)
    axes.set_xticks(range(len(decades)), [f"$10^{{{round(math.log10(x))}}}$" for x in decades], fontsize=11)
    axes.set_yticks(range(len(cases)), [_wrapped(_title(found, case)) for case in cases], fontsize=11)
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.set_xlabel("attitude error at most (rad)", fontsize=11)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    strip = "; strip: a cheaper contestant from outside the library" if any(a.own and rival(a) for a in found) else ""
    figure.suptitle(
        "For this accuracy, use this method; it costs this much time per simulated second\n"
        f"(peers: how much more the cheapest of them costs{strip})",
        fontsize=13,
    )
    figure.savefig(path, dpi=DPI)
    return path


def _draw_cell(axes: Any, column: int, row: int, answer: Answer) -> None:
    own = answer.own
    other = rival(answer)
    if own is None:
        text = f"only {SHORT.get(other.method, other.method)}\n{text_of(other.cost)}" if other else "nobody"
        axes.text(column, row, text, ha="center", va="center", fontsize=8, color="0.4")
        return
    axes.add_patch(Rectangle((column - 0.48, row - 0.46), 0.96, 0.92, color=COLORS[own.family], linewidth=0))
    name = SHORT.get(own.method, own.method).replace(" (Strang)", "")
    ink = "white" if own.family in ("exact", "DOP853") else "black"
    axes.text(column, row - 0.26, name, ha="center", va="center", fontsize=8.5, color=ink)
    axes.text(column, row + 0.02, text_of(own.cost), ha="center", va="center", fontsize=12, color=ink, weight="bold")
    if answer.peer:
        ratio = answer.peer.cost / own.cost
        axes.text(column, row + 0.22, f"peers {_rounded(ratio)}×", ha="center", va="center", fontsize=8, color=ink)
    if other:
        axes.add_patch(Rectangle((column - 0.48, row + 0.31), 0.96, 0.15, color=COLORS[other.family], linewidth=0))
        text = f"{SHORT.get(other.method, other.method)} {_rounded(other.cost / own.cost)}×"
        axes.text(column, row + 0.385, text, ha="center", va="center", fontsize=7.5, color="black")


def _rounded(ratio: float) -> str:
    digits = 1 - math.floor(math.log10(ratio))
    return f"{round(ratio, digits):,.{max(0, digits)}f}" if ratio < 10.0 else f"{round(ratio, digits):,.0f}"


def _title(found: Sequence[Answer], case: str) -> str:
    return next(answer.title for answer in found if answer.case == case)


def _wrapped(title: str) -> str:
    return title.replace(", ", ",\n").replace("thruster ", "thruster\n").replace("constant ", "constant\n")
