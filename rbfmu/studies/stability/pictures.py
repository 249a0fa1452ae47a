"""The pictures of the laws, as rows of one table: measurements on predictions; and the maps of verdicts."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rbfmu.plot import COLORS, open_frame
from rbfmu.studies.stability.findings import CURVE, Study
from rbfmu.studies.stability.maps import ACCURACY, LARGEST_ERROR, LONG_TURN, OURS, TURN, VERDICTS, Row

BLUE, VERMILION, GREEN, PURPLE = COLORS
ORANGE, SKY, BLACK, GREY = "#e69f00", "#56b4e9", "#000000", "#777777"
"""Further colours of the Okabe-Ito palette, and a grey for everything that is no method."""
_INK = {ORANGE: "#b37700", SKY: "#2c7fb0", PURPLE: "#b0568c"}
"""Colours of text, which are darker for pale colours."""
_DASHES = (0, (4, 3))
_LARGEST = 1e3
"""Names stand at the last value below this: what is larger has left the picture."""


class Curve(NamedTuple):
    """A column of a study as a curve.

    style, size: matplotlib's format, and the width of a line or the size of a marker; name: what stands at the right
    edge, at the height of the last value; dots: how many values at most are drawn (0: all).
    """

    column: str
    color: str
    style: str = "o"
    size: float = 3.0
    name: str = ""
    dots: int = 0


def _law(method: str, color: str, dots: int, measured: str = "") -> tuple[Curve, Curve]:
    """Return a prediction as a line, and some of the measured values as dots on it."""
    return Curve(f"{method}, predicted", color, "-", 1.3), Curve(f"{method}{measured}", color, dots=dots)


class Picture(NamedTuple):
    """A row of the table: the picture of one study.

    about: titles of picture, x and y axis; set: limits and scales, as `axes.set` takes them (x: that of the first
    column, if nothing is said); curves: over the first column; floor: the least value that is drawn, on axes that
    have no zero; notes: (x, y, text, colour[, alignment]); marks: vertical lines with (x, text[, height[, alignment]]);
    levels: horizontal lines (y, colour); ticks: those of x and y; edge: the right edge of the axes, beside which names
    fit; explained: whether a note explains lines and dots; more: draws what no other picture has.
    """

    about: tuple[str, str, str]
    set: Mapping[str, Any] = MappingProxyType({})
    curves: tuple[Curve, ...] = ()
    floor: float = 0.0
    notes: tuple[tuple[Any, ...], ...] = ()
    marks: tuple[tuple[Any, ...], ...] = ()
    levels: tuple[tuple[float, str], ...] = ()
    ticks: Mapping[str, dict[float, str]] = MappingProxyType({})
    edge: float = 0.97
    explained: bool = False
    more: Callable[[Any, Study], None] | None = None


def draw(study: Study, folder: Path) -> Path:
    """Draw the study's picture, a PNG file."""
    path = folder / f"{study.name}.png"
    figure_of(study).savefig(path, dpi=130)
    return path


def figure_of(study: Study) -> Figure:
    """Return the study's picture."""
    row = PICTURES[study.name]
    axes = _titled_axes(*row.about, row.edge)
    x = next(iter(study.columns.values()))
    if not isinstance(x[0], str):
        axes.set(xlim=(x[0], x[-1]))
    axes.set(**row.set)
    for curve in row.curves:
        every = max(len(x) // curve.dots, 1) if curve.dots else 1
        size = (
            {"linewidth": curve.size} if "-" in curve.style and "o" not in curve.style else {"markersize": curve.size}
        )
        y = (
            [max(float(v), row.floor) for v in study.columns[curve.column]]
            if row.floor
            else study.columns[curve.column]
        )
        axes.plot(x[::every], y[::every], curve.style, color=curve.color, **{"linewidth": 1.0} | size)
    if CURVE in study.columns:
        axes.plot(x, study.columns[CURVE], "--", color=GREY, linewidth=2.0, label=CURVE)
        axes.figure.legend(loc="lower left", frameon=False, fontsize=9)
    for at_x, at_y, text, color, *align in row.notes:
        axes.text(at_x, at_y, text, color=_INK.get(color, color), fontsize=9.5, ha=align[0] if align else "left")
    for mark in row.marks:
        _mark(axes, *mark)
    for level, color in row.levels:
        axes.axhline(level, color=color, linewidth=0.8)
    for axis, ticks in row.ticks.items():
        (axes.set_xticks if axis == "x" else axes.set_yticks)([*ticks], [*ticks.values()])
        axes.minorticks_off()
    if row.explained:
        axes.text(0.02, 0.95, "lines: predicted, dots: measured", transform=axes.transAxes, fontsize=9)
    if row.more:
        row.more(axes, study)
    _name_ends(axes, [_end(curve, study.columns[curve.column], row.floor) for curve in row.curves if curve.name])
    return axes.figure  # type: ignore[no-any-return]


def _titled_axes(title: str, x: str, y: str, right: float) -> Any:
    """Return one panel with a title that states the finding; names fit outside its edge `right`."""
    figure, left = Figure(figsize=(8.4, 5.0)), 0.1
    axes = figure.add_axes((left, 0.12, right - left, 0.74))
    axes.set_title(title, fontsize=11, loc="left", pad=10)
    axes.set(xlabel=x, ylabel=y)
    open_frame(axes, grid=True)
    return axes


def _end(curve: Curve, values: Sequence[Any], floor: float) -> tuple[float, str, str]:
    """Return where a curve's name stands, the name, which says where values have ended, and its colour."""
    shown = [max(float(v), floor) for v in values if math.isfinite(v) and v < _LARGEST]
    return shown[-1], curve.name if math.isfinite(values[-1]) else f"{curve.name},\nthen not finite", curve.color


def _name_ends(axes: Any, names: Sequence[tuple[float, str, str]]) -> None:
    """Write names at the right edge at the height of (value, name, colour), pushed apart where they would overlap."""
    to_fraction = axes.transData + axes.transAxes.inverted()
    x = axes.get_xlim()[1]
    height = sorted((min(max(to_fraction.transform((x, v))[1], 0.02), 0.98), name, c) for v, name, c in names)
    place = -1.0
    for k, (y, name, color) in enumerate(height):
        lines = name.count("\n") + 1
        room = sum(0.052 * (n.count("\n") + 1) for _, n, _ in height[k + 1 :])
        place = max(min(y, 1.0 - room), place + 0.03 * (lines - 1))
        axes.text(1.01, place, name, color=_INK.get(color, color), transform=axes.transAxes, va="center", fontsize=9)
        place += 0.052 + 0.03 * (lines - 1)


def _mark(axes: Any, x: float, text: str, y: float = 0.06, align: str = "left") -> None:
    """Draw a vertical line at x with a label at a height, as a part of the axes'."""
    axes.axvline(x, color=GREY, linewidth=0.9, linestyle=_DASHES)
    axes.annotate(text, (x, y), (4 if align == "left" else -4, 0), xycoords=("data", "axes fraction"), color=GREY,
                  textcoords="offset points", ha=align, va="top", fontsize=9)  # fmt: skip


def _recorded_passages(axes: Any, study: Study) -> None:
    """Mark the errors that were recorded when law 4 was written down."""
    axes.plot((10, 1, 0.1), (8e-2, 3.6e-5, 3e-9), "D", color=BLACK, markersize=6, markerfacecolor="none", clip_on=False)


def _period(axes: Any, study: Study) -> None:
    """Draw the time between two flips as an arrow."""
    period = next(f.measured for f in study.findings if f.what == "time between flips, s")
    t, exact = study.columns["time"], study.columns["exact"]
    first = next(k for k, v in enumerate(exact) if float(v) < 0.0)
    start = 0.5 * (float(t[first - 1]) + float(t[first]))
    axes.annotate("", (start + period, 2.45), xytext=(start, 2.45), arrowprops={"arrowstyle": "<->", "color": BLACK})
    axes.text(start + 0.5 * period, 2.5, "ln(16 / mc) / λ", ha="center", va="bottom", fontsize=9)


def _models(axes: Any, study: Study) -> None:
    """Draw a line of dots for each model, and the bound of each dot as a bar."""
    columns = study.columns
    models = list(dict.fromkeys(columns["model"]))
    axes.figure.set_size_inches(8.4, 6.0)
    axes.set_position((0.41, 0.12, 0.54, 0.74))
    axes.set_title(axes.get_title(loc="left"), fontsize=11, x=-0.57, loc="left", pad=10)
    axes.set(ylim=(len(models) - 0.4, -0.6))
    axes.set_yticks(range(len(models)), models, fontsize=9)
    for model, error, bound in zip(columns["model"], columns["error"], columns["bound"], strict=True):
        y = models.index(model)
        axes.plot([bound, bound], [y - 0.3, y + 0.3], color=BLACK, linewidth=1.5)
        axes.plot([min(max(error, 1e-17), 1e-7)], [y], "o", color=BLUE if error <= bound else VERMILION, markersize=4)


def _orders(axes: Any, study: Study) -> None:
    """Draw each method's errors, and the slope that its order says from the first of them on."""
    orders = {f.what.removesuffix(": order"): f.predicted for f in study.findings}
    halvings = study.columns["halvings of the step"]
    axes.set(xlim=(-0.1, halvings[-1] + 0.1), xticks=halvings)
    colors = (ORANGE, GREEN, BLUE, VERMILION, PURPLE, SKY, BLACK, GREY)
    for name, color in zip(list(study.columns)[1:], colors, strict=True):
        errors = study.columns[name]
        axes.plot(halvings, [errors[0] * 2.0 ** (-orders[name] * k) for k in halvings], color=color, linewidth=0.9)
        axes.plot(halvings, errors, "o", color=color, markersize=5, label=f"{name}: {orders[name]:g}")
    axes.legend(title="order", frameon=False, loc="upper right", fontsize=9, alignment="left", ncols=2)


_LOG = {"xscale": "log", "yscale": "log"}
_ROUND_OFF = 2.0**-54
PICTURES = {
    "growth_factors": Picture(
        ("Beyond its largest stable step a method makes |q| or |R| grow: explicit Euler at once,\n"
         "RK4 on matrices at hω = 2.83, RK4 on quaternions at 5.66, DOP853 (order 8) at 11.92",
         "hω: turn in one step (rad)", "factor on |q| or |R| in one step"),
        {"yscale": "log", "ylim": (0.3, 12.0), "xlim": (0.0, 13.0)},
        (*_law("explicit Euler", VERMILION, 65, ", measured"), *_law("RK4, matrix", PURPLE, 65, ", measured"),
         *_law("RK4, quaternion not normalised", GREEN, 65, ", measured"), *_law("DOP853", BLUE, 65, ", measured")),
        notes=((8.6, 3.6, "explicit Euler, q", VERMILION), (2.95, 6.5, "RK4, R", PURPLE),
               (6.6, 1.75, "RK4, q", GREEN), (8.9, 0.62, "DOP853, q", BLUE)),
        marks=((2.0 * math.sqrt(2.0), "2√2"), (4.0 * math.sqrt(2.0), "4√2"), (11.92, "2 × 5.96")),
        levels=((1.0, BLACK),), ticks={"y": {0.3: "0.3", 1.0: "1", 3.0: "3", 10.0: "10"}}, explained=True),
    "drift": Picture(
        ("RK4 without normalisation drifts off the rotations, matrices 64 times as fast as |q|²;\n"
         "normalised at each step it stays within round-off  (hω = 0.1)", "steps", "distance from a rotation"),
        {**_LOG, "ylim": (3e-17, 3.0)},
        (Curve("R", PURPLE, size=5, name="RK4 on R:\n|RᵀR − I|"), Curve("R, predicted", PURPLE, "-", 1.2),
         Curve("q", GREEN, size=5, name="RK4 on q:\n1 − |q|"), Curve("q, predicted", GREEN, "-", 1.2),
         Curve("q normalised", BLUE, size=5, name="normalised:\n||q| − 1|")),
        floor=_ROUND_OFF, edge=0.8, explained=True),
    "gimbal_passage": Picture(
        ("Passing the vertical at 0.01 rad, roll, pitch, yaw lose accuracy, quaternions do not:\n"
         "at h = 0.1 s, RK4 is 0.08 rad off on angles and 0.0000002 rad on quaternions",
         "h ω / δ: step over the time of the passage", "attitude error after half a turn (rad)"),
        {**_LOG, "ylim": (1e-16, 10.0)},
        (Curve("RK4, Euler angles", VERMILION, "o-", name="RK4 on\nEuler angles"),
         Curve("RK4, quaternion", GREEN, "o-", name="RK4 on\nquaternion")),
        floor=1e-16, edge=0.8, notes=((0.8, 1e-4, "predicted", BLACK, "right"),), more=_recorded_passages),
    "gyroscopic_blow_up": Picture(
        ("An explicit gyroscopic term adds energy: the nutation of a thin rod\n"
         "(1 : 1 : 0.01, 30 rad/s, 60 steps a second) grows 717 times in one second",
         "time (s)", "transverse rate over its start"),
        {"yscale": "log", "ylim": (0.5, 1500)},
        (Curve("predicted", BLACK, "-", 1.0), Curve("semi-implicit Euler", ORANGE, size=6),
         Curve("explicit Euler", VERMILION, ".", 4, "semi-implicit Euler\nand explicit Euler"),
         Curve("RK4, quaternion", GREEN, "-", 2.0, "RK4"),
         Curve("implicit midpoint", SKY, "--", 2.0, "implicit midpoint")),
        edge=0.78, notes=((0.47, 42, "predicted (1 + h²W²)$^{n/2}$", BLACK, "right"),)),
    "damping_limits": Picture(
        ("Damping that a step cannot follow becomes growth:\n"
         "explicit Euler beyond h d / I = 2, RK4 beyond 2.785, DOP853 beyond 6.394",
         "h d / I", "|factor| on a damped rate in one step"),
        {"xlim": (0, 8), "ylim": (0, 1.6)},
        (Curve("exact", BLACK, "-", 1.2), *_law("explicit Euler", VERMILION, 40), *_law("RK4, quaternion", GREEN, 40),
         *_law("DOP853", BLUE, 40)),
        notes=((3.2, 0.1, "exact: exp(−h d / I)", BLACK), (0.85, 1.2, "explicit Euler", VERMILION),
               (3.1, 1.4, "RK4", GREEN), (6.65, 1.4, "DOP853", BLUE)),
        marks=((2.0, ""), (2.785, ""), (6.394, "")), levels=((1.0, BLACK),),
        ticks={"x": {tick: f"{tick:g}" for tick in (0, 1, 2, 2.785, 4, 5, 6.394, 8)}}, explained=True),
    "moser_veselov_limits": Picture(
        ("The discrete Moser-Veselov algorithm ends at hω = 1, where its equation has no solution;\n"
         "preprocessed to order 10 it turns the right way up to hω = π/2",
         "hω: turn in one step (rad)", "error of one step of a sphere (rad)"),
        {**_LOG, "ylim": (1e-17, 10.0)},
        (Curve("Moser-Veselov, predicted", BLACK, "-", 1.0), Curve("Moser-Veselov", ORANGE),
         Curve("Moser-Veselov, order 10", PURPLE)),
        floor=1e-17, notes=((0.03, 1e-3, "plain (order 2);\nline: asin(hω) − hω", ORANGE),
                            (0.3, 3e-16, "order 10", PURPLE)),
        marks=((1.0, "1", 0.06, "right"), (0.5 * math.pi, "π/2"))),
    "energy_drift": Picture(
        ("RK4 loses energy in proportion to time; the implicit midpoint, Moser-Veselov and\n"
         "exact steps only have round-off  (tumbling brick, h = 0.1 s)", "steps", "relative energy error"),
        {**_LOG, "ylim": (2e-17, 1e3)},
        (Curve("semi-implicit Euler", ORANGE, "o-", 4, "semi-implicit Euler"),
         Curve("RK4, quaternion", GREEN, "o-", 4, "RK4"), Curve("implicit midpoint", SKY, "o-", 4, "implicit midpoint"),
         Curve("Moser-Veselov, order 10", PURPLE, "o-", 4, "Moser-Veselov,\norder 10"),
         Curve("exact steps", BLUE, "o-", 4, "exact steps")),
        floor=_ROUND_OFF, edge=0.78),
    "small_angles": Picture(
        ("Formulas with cancellation lose small angles altogether: acos of the trace and (1 − cos θ) / θ²\n"
         "are 100 % wrong below 1e-8; rbfmu's rotation vector keeps every digit", "angle θ (rad)", "relative error"),
        {**_LOG, "ylim": (5e-18, 20.0)},
        (Curve("acos of the trace", ORANGE, size=5), Curve("(1 - cos) / theta^2", PURPLE, ".", 4),
         Curve("rotvec_from_quaternion", BLUE, ".", 4)),
        notes=((3e-6, 1e-2, "acos of the trace", ORANGE), (3e-6, 1e-3, "(1 − cos θ) / θ²", PURPLE),
               (1e-10, 1e-15, "rotvec_from_quaternion (points at the bottom: no error)", BLUE),
               (1.3e-12, 3e-16, "eps", GREY)),
        levels=((2.0**-52, GREY),)),
    "intermediate_axis": Picture(
        ("A spin about the middle axis turns over every 18.954193 s, as predicted;\n"
         "a method that adds energy spins faster after each flip", "time (s)", "ω₂ (rad/s)"),
        {"ylim": (-2.6, 2.9)},
        (Curve("exact", BLUE, "-", 1.8, "exact"), Curve("RK4, quaternion, h = 0.25 s", GREEN, "--", 1.2,
                                                       "RK4\nh = 0.25 s"),
         Curve("semi-implicit Euler, h = 0.05 s", ORANGE, "-", 1.2, "semi-implicit Euler\nh = 0.05 s")),
        edge=0.78, more=_period),
    "sleeping_top": Picture(
        ("A top that stands upright sleeps only above its critical spin, (I₃ω₃)² = 4 I₁ m g l:\n"
         "below it, a tilt of 0.001 rad becomes a fall",
         "spin over the critical spin", "largest tilt within a minute (rad)"),
        {"yscale": "log", "xlim": (0, 1.6), "ylim": (5e-4, 6.0)},
        (Curve("largest tilt", BLUE, size=4), Curve("predicted", BLACK, "-", 1.2)),
        notes=((1.59, math.pi * 1.06, "upside down", GREY, "right"), (0.1, 0.7, "dots: measured with RKN4", BLUE),
               (1.58, 2.3e-3, "line: predicted\n0.001 / √(1 − (critical / spin)²)", BLACK, "right")),
        marks=((1.0, "critical: predicted 1", 0.5),), levels=((math.pi, GREY),)),
    "splitting_resonance": Picture(
        ("Splitting resonates with the free precession of a fast top: at h = 2π I₁ / (I₃ω₃) = 0.419 s\n"
         "the energy error is 10.7 m g l, at a quarter of that step it is 0.0004 m g l",
         "step h (s)", "largest energy error over 10 s (m g l)"),
        {**_LOG, "ylim": (1e-15, 100.0)},
        (Curve("Strang", ORANGE, "o-"), Curve("RKN4", GREEN, "o-"), Curve("RKN6", BLUE, "o-")),
        notes=((0.033, 4e-4, "Strang, order 2", ORANGE), (0.033, 1.6e-9, "RKN4", GREEN), (0.05, 3e-13, "RKN6", BLUE)),
        marks=((2.0 * math.pi / 15.0, "resonance", 0.06, "right"),), edge=0.9,
        ticks={"x": {tick: f"{tick:g}" for tick in (0.03, 0.05, 0.1, 0.2, 0.4, 0.6)}}),
    "product_models": Picture(
        ("Each of rbfmu's models follows its motion to round-off, Strang's splitting to 1e-8:\n"
         "dots: largest error of the attitude (rad) and of all else (relative); bars: the bound", "largest error", ""),
        {"xscale": "log", "xlim": (1e-17, 1e-7)}, marks=((2.0**-52, "eps", 0.99),), more=_models),
    "orders_and_error_control": Picture(
        ("Halving the step divides the error by 2 to the method's order, until round-off is reached\n"
         "(lines: that slope from the first dot on)", "halvings of the step", "largest error"),
        {"yscale": "log", "ylim": (1e-16, 1e2)}, more=_orders),
}  # fmt: skip
"""The pictures, by the study's name."""


# Maps: small multiples, one panel for each method

_COLORS = (GREEN, ORANGE, BLACK, SKY)
"""The colours of VERDICTS."""
_COLUMNS = 4


def draw_maps(rows: Sequence[Row], path: Path) -> Path:
    """Draw panels in the order of the rows, with the titles of rbfmu's in bold."""
    names = list(dict.fromkeys(row[0] for row in rows))
    lines = math.ceil((len(names) + 1) / _COLUMNS)
    figure = Figure(figsize=(11.5, 1.5 + 2.25 * lines))
    panels = figure.subplots(lines, _COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(0.075, 0.62 / height, 0.99, 1.0 - 1.15 / height, wspace=0.11, hspace=0.3)
    for panel, name in zip(panels, names, strict=False):
        _draw_map(panel, name, [row for row in rows if row[0] == name])
    for k, panel in enumerate(panels):
        if k + _COLUMNS >= len(names):
            panel.tick_params(labelbottom=True)
        if k >= len(names):
            panel.set_axis_off()
    worst = _worst([row for row in rows if row[0] in OURS])
    seen = {row[3] for row in rows}
    handles = [
        Patch(color=color, label=verdict) for color, verdict in zip(_COLORS, VERDICTS, strict=True) if verdict in seen
    ]
    panels[len(names)].legend(handles=handles, loc="center", frameon=False, fontsize=11)
    figure.supxlabel("hω: turn in one step (rad)")
    figure.supylabel("least moment over the largest (0.01: rod, 1: sphere)")
    figure.suptitle(
        "Each method of fixed step computes wrong motions, without notice, where the step is too long.\n"
        f"The largest error of rbfmu (bold) is {worst:.0e} rad at any step, where {ACCURACY:g} rad is asked.\n"
        f"(Torque-free bodies that turn by {TURN:g} rad, for hω > 1 by {LONG_TURN:g} rad; right: attitude error "
        f"at most {LARGEST_ERROR:g} rad.)",
        fontsize=12,
    )
    figure.savefig(path, dpi=110)
    return path


def _draw_map(panel: Any, name: str, rows: Sequence[Row]) -> None:
    steps, ratios = sorted({row[1] for row in rows}), sorted({row[2] for row in rows})
    values = np.zeros((len(ratios), len(steps)))
    for _, h, ratio, verdict, _ in rows:
        values[ratios.index(ratio), steps.index(h)] = VERDICTS.index(verdict)
    panel.pcolormesh(_edges(steps), _edges(ratios), values, cmap=ListedColormap(_COLORS), vmin=-0.5, vmax=3.5)
    panel.set(xscale="log", yscale="log")
    panel.set_xticks([0.01, 0.1, 1.0, 10.0], ["0.01", "0.1", "1", "10"], fontsize=8)
    panel.set_yticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"], fontsize=8)
    panel.minorticks_off()
    right = sum(row[3] == VERDICTS[0] for row in rows) / len(rows)
    title = f"{name.replace('quaternion not', 'q not')}: {right:.0%} right"
    if name in OURS:
        title = f"{name}: within {_worst(rows):.0e} rad"
    panel.set_title(title, fontsize=9, fontweight="bold" if name in OURS else "normal", loc="left")


def _worst(rows: Sequence[Row]) -> float:
    """Return the largest error, rounded up to one digit."""
    largest = max(row[4] for row in rows)
    unit = 10.0 ** math.floor(math.log10(largest)) if 0.0 < largest < math.inf else 1.0
    return math.ceil(largest / unit) * unit if math.isfinite(largest) else largest


def _edges(centres: Sequence[float]) -> Any:
    """Return the edges of cells around points on a logarithmic axis."""
    c = np.array(centres)
    middle = np.sqrt(c[1:] * c[:-1])
    return np.array([c[0] ** 2 / middle[0], *middle, c[-1] ** 2 / middle[-1]])
