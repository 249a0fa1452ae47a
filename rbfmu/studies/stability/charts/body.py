"""Pictures of laws 5 to 8 and 10 to 12: measurements (dots) on predictions (lines)."""

import math

from matplotlib.figure import Figure

from rbfmu.studies.stability.charts.figures import (
    BLACK,
    BLUE,
    COLOR_OF,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    end_labels,
    explain,
    ink,
    law,
    mark,
    titled_axes,
)
from rbfmu.studies.stability.findings import Study


def gyroscopic_blow_up(study: Study) -> Figure:
    """Draw law 5."""
    axes = titled_axes(
        "An explicit gyroscopic term adds energy: the nutation of a thin rod\n"
        "(1 : 1 : 0.01, 30 rad/s, 60 steps a second) grows 717 times in one second",
        "time (s)", "transverse rate over its start", right=0.78,
    )  # fmt: skip
    t = study.columns["time"]
    axes.set(yscale="log", xlim=(0, 1.0), ylim=(0.5, 1500))
    axes.plot(t, study.columns["predicted"], color=BLACK, linewidth=1.0)
    axes.text(0.47, 42, "predicted (1 + h²W²)$^{n/2}$", fontsize=9, ha="right")
    axes.plot(t, study.columns["semi-implicit Euler"], "o", color=ORANGE, markersize=6)
    axes.plot(t, study.columns["explicit Euler"], ".", color=VERMILION, markersize=4)
    axes.plot(t, study.columns["RK4, quaternion"], "-", color=GREEN, linewidth=2.0)
    axes.plot(t, study.columns["implicit midpoint"], "--", color=SKY, linewidth=2.0)
    both, rk4 = "semi-implicit Euler\nand explicit Euler", float(study.columns["RK4, quaternion"][-1])
    end_labels(axes, [(717.0, both, VERMILION), (rk4, "RK4", GREEN), (1.0, "implicit midpoint", SKY)])
    return axes.figure  # type: ignore[no-any-return]


def damping_limits(study: Study) -> Figure:
    """Draw law 6."""
    axes = titled_axes(
        "Damping that a step cannot follow becomes growth:\n"
        "explicit Euler beyond h d / I = 2, RK4 beyond 2.785, DOP853 beyond 6.394",
        "h d / I", "|factor| on a damped rate in one step",
    )  # fmt: skip
    x = study.columns["h d / I"]
    axes.set(xlim=(0, 8), ylim=(0, 1.6))
    axes.plot(x, study.columns["exact"], color=BLACK, linewidth=1.2)
    axes.text(3.2, 0.1, "exact: exp(−h d / I)", fontsize=9)
    places = {
        "explicit Euler": (0.85, 1.2, "explicit Euler"),
        "RK4, quaternion": (3.1, 1.4, "RK4"),
        "DOP853": (6.65, 1.4, "DOP853"),
    }
    for name, (at_x, at_y, text) in places.items():
        color = COLOR_OF[name]
        law(axes, x, study.columns[f"{name}, predicted"], study.columns[name], color, 40)
        axes.text(at_x, at_y, text, color=color, fontsize=10, ha="left")
    axes.axhline(1.0, color=BLACK, linewidth=0.8)
    limits = (2.0, 2.785, 6.394)
    for limit in limits:
        axes.axvline(limit, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
    ticks = (0, 1, *limits, 4, 5, 8)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    explain(axes)
    return axes.figure  # type: ignore[no-any-return]


def moser_veselov_limits(study: Study) -> Figure:
    """Draw law 7."""
    axes = titled_axes(
        "The discrete Moser-Veselov algorithm ends at hω = 1, where its equation has no solution;\n"
        "preprocessed to order 10 it turns the right way up to hω = π/2",
        "hω: turn in one step (rad)", "error of one step of a sphere (rad)",
    )  # fmt: skip
    x = study.columns["h_omega"]
    axes.set(xscale="log", yscale="log", xlim=(x[0], x[-1]), ylim=(1e-17, 10.0))
    axes.plot(x, study.columns["Moser-Veselov, predicted"], color=BLACK, linewidth=1.0)
    for name in ("Moser-Veselov", "Moser-Veselov, order 10"):
        axes.plot(x, [max(float(v), 1e-17) for v in study.columns[name]], "o", color=COLOR_OF[name], markersize=3)
    axes.text(0.03, 1e-3, "plain (order 2);\nline: asin(hω) − hω", color=ink(ORANGE), fontsize=10, ha="left")
    axes.text(0.3, 3e-16, "order 10", color=ink(PURPLE), fontsize=10)
    mark(axes, 1.0, "1", y=0.06, align="right")
    mark(axes, 0.5 * math.pi, "π/2", y=0.06)
    return axes.figure  # type: ignore[no-any-return]


def energy_drift(study: Study) -> Figure:
    """Draw law 8."""
    axes = titled_axes(
        "RK4 loses energy in proportion to time; the implicit midpoint, Moser-Veselov and\n"
        "exact steps only have round-off  (tumbling brick, h = 0.1 s)",
        "steps", "relative energy error", right=0.78,
    )  # fmt: skip
    n = study.columns["steps"]
    axes.set(xscale="log", yscale="log", xlim=(1, n[-1]), ylim=(2e-17, 1e3))
    labels = []
    for name in list(study.columns)[1:]:
        values = [max(float(v), 2.0**-54) for v in study.columns[name]]
        shown = [v if math.isfinite(v) else math.nan for v in values]
        axes.plot(n, shown, "o-", color=COLOR_OF[name], markersize=4, linewidth=1.0)
        last = [v for v in shown if v < 1e3][-1]
        label = name.replace(", order", ",\norder").replace("RK4, quaternion", "RK4")
        labels.append((last, label if math.isfinite(values[-1]) else f"{name},\nthen not finite", COLOR_OF[name]))
    end_labels(axes, labels)
    return axes.figure  # type: ignore[no-any-return]


def intermediate_axis(study: Study) -> Figure:
    """Draw law 10."""
    axes = titled_axes(
        "A spin about the middle axis turns over every 18.954193 s, as predicted;\n"
        "a method that adds energy spins faster after each flip",
        "time (s)", "ω₂ (rad/s)", right=0.78,
    )  # fmt: skip
    t = study.columns["time"]
    axes.set(xlim=(0, t[-1]), ylim=(-2.6, 2.9))
    names = list(study.columns)[1:]
    colors = (BLUE, GREEN, ORANGE)
    for name, color, style in zip(names, colors, ("-", "--", "-"), strict=True):
        axes.plot(t, study.columns[name], style, color=color, linewidth=1.8 if color == BLUE else 1.2)
    labels = [n.replace("quaternion, ", "").replace(", h", "\nh") for n in names]
    end_labels(
        axes, [(float(study.columns[n][-1]), label, c) for n, label, c in zip(names, labels, colors, strict=True)]
    )
    period = next(f.measured for f in study.findings if f.what == "time between flips, s")
    first = next(k for k, v in enumerate(study.columns["exact"]) if float(v) < 0.0)
    start = 0.5 * (float(t[first - 1]) + float(t[first]))
    axes.annotate("", (start + period, 2.45), xytext=(start, 2.45), arrowprops={"arrowstyle": "<->", "color": BLACK})
    axes.text(start + 0.5 * period, 2.5, "ln(16 / mc) / λ", ha="center", va="bottom", fontsize=9)
    return axes.figure  # type: ignore[no-any-return]


def sleeping_top(study: Study) -> Figure:
    """Draw law 11."""
    axes = titled_axes(
        "A top that stands upright sleeps only above its critical spin, (I₃ω₃)² = 4 I₁ m g l:\n"
        "below it, a tilt of 0.001 rad becomes a fall",
        "spin over the critical spin", "largest tilt within a minute (rad)",
    )  # fmt: skip
    x = study.columns["spin over critical"]
    axes.set(yscale="log", xlim=(0, 1.6), ylim=(5e-4, 6.0))
    axes.plot(x, study.columns["largest tilt"], "o", color=BLUE, markersize=4)
    axes.plot(x, study.columns["predicted"], color=BLACK, linewidth=1.2)
    mark(axes, 1.0, "critical: predicted 1", y=0.5)
    axes.axhline(math.pi, color=GREY, linewidth=0.8)
    axes.text(1.59, math.pi * 1.06, "upside down", color=GREY, fontsize=9, ha="right")
    axes.text(1.58, 2.3e-3, "line: predicted\n0.001 / √(1 − (critical / spin)²)", fontsize=9, ha="right")
    axes.text(0.1, 0.7, "dots: measured with RKN4", color=BLUE, fontsize=10)
    return axes.figure  # type: ignore[no-any-return]


def splitting_resonance(study: Study) -> Figure:
    """Draw law 12."""
    axes = titled_axes(
        "Splitting resonates with the free precession of a fast top: at h = 2π I₁ / (I₃ω₃) = 0.419 s\n"
        "the energy error is 10.7 m g l, at a quarter of that step it is 0.0004 m g l",
        "step h (s)", "largest energy error over 10 s (m g l)", right=0.9,
    )  # fmt: skip
    x = study.columns["h"]
    axes.set(xscale="log", yscale="log", xlim=(x[0], x[-1]), ylim=(1e-15, 100.0))
    colors = {"Strang": ORANGE, "RKN4": GREEN, "RKN6": BLUE}
    for name, color in colors.items():
        axes.plot(x, study.columns[name], "o-", color=color, markersize=3, linewidth=0.9)
    places = {
        "Strang": (0.033, 4e-4, "Strang, order 2"),
        "RKN4": (0.033, 1.6e-9, "RKN4"),
        "RKN6": (0.05, 3e-13, "RKN6"),
    }
    for name, (at_x, at_y, text) in places.items():
        axes.text(at_x, at_y, text, color=ink(colors[name]), fontsize=10)
    axes.set_xticks([0.03, 0.05, 0.1, 0.2, 0.4, 0.6], ["0.03", "0.05", "0.1", "0.2", "0.4", "0.6"])
    axes.minorticks_off()
    mark(axes, 2.0 * math.pi / 15.0, "resonance", y=0.06, align="right")
    return axes.figure  # type: ignore[no-any-return]
