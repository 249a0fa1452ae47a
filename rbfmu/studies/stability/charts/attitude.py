"""Pictures of laws 1 to 4 and 9: measurements (dots) on predictions (lines)."""

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
    end_labels,
    explain,
    ink,
    law,
    mark,
    titled_axes,
)
from rbfmu.studies.stability.findings import Study


def growth_factors(study: Study) -> Figure:
    """Draw laws 1 to 3."""
    axes = titled_axes(
        "Beyond its largest stable step a method makes |q| or |R| grow: explicit Euler at once,\n"
        "RK4 on matrices at hω = 2.83, RK4 on quaternions at 5.66, DOP853 (order 8) at 11.92",
        "hω: turn in one step (rad)", "factor on |q| or |R| in one step",
    )  # fmt: skip
    axes.set(yscale="log", ylim=(0.3, 12.0), xlim=(0.0, 13.0))
    axes.set_yticks([0.3, 1.0, 3.0, 10.0], ["0.3", "1", "3", "10"])
    axes.minorticks_off()
    x = study.columns["h_omega"]
    places = {
        "explicit Euler": ("explicit Euler, q", 8.6, 3.6),
        "RK4, matrix": ("RK4, R", 2.95, 6.5),
        "RK4, quaternion not normalised": ("RK4, q", 6.6, 1.75),
        "DOP853": ("DOP853, q", 8.9, 0.62),
    }
    for method, (name, at_x, at_y) in places.items():
        color = COLOR_OF[method]
        predicted, measured = (study.columns[f"{method}, {what}"] for what in ("predicted", "measured"))
        law(axes, x, predicted, measured, color, 65)
        axes.text(at_x, at_y, name, color=ink(color), fontsize=10)
    axes.axhline(1.0, color=BLACK, linewidth=0.8)
    for limit, text in ((2 * math.sqrt(2), "2√2"), (4 * math.sqrt(2), "4√2"), (11.92, "2 × 5.96")):
        mark(axes, limit, text, y=0.06)
    explain(axes)
    return axes.figure  # type: ignore[no-any-return]


def drift(study: Study) -> Figure:
    """Draw laws 2 and 3."""
    axes = titled_axes(
        "RK4 without normalisation drifts off the rotations, matrices 64 times as fast as |q|²;\n"
        "normalised at each step it stays within round-off  (hω = 0.1)",
        "steps", "distance from a rotation", right=0.8,
    )  # fmt: skip
    n, columns = study.columns["steps"], study.columns
    axes.set(xscale="log", yscale="log", xlim=(1, n[-1]), ylim=(3e-17, 3.0))
    labels = []
    for name, column, color in (
        ("RK4 on R:\n|RᵀR − I|", "R", PURPLE),
        ("RK4 on q:\n1 − |q|", "q", GREEN),
        ("normalised:\n||q| − 1|", "q normalised", BLUE),
    ):
        values = [max(float(v), 2.0**-54) for v in columns[column]]
        axes.plot(n, values, "o", color=color, markersize=5, clip_on=False)
        if f"{column}, predicted" in columns:
            axes.plot(n, columns[f"{column}, predicted"], color=color, linewidth=1.2)
        labels.append((values[-1], name, color))
    end_labels(axes, labels)
    explain(axes)
    return axes.figure  # type: ignore[no-any-return]


def gimbal_passage(study: Study) -> Figure:
    """Draw law 4."""
    axes = titled_axes(
        "Passing the vertical at 0.01 rad, roll, pitch, yaw lose accuracy, quaternions do not:\n"
        "at h = 0.1 s, RK4 is 0.08 rad off on angles and 0.0000002 rad on quaternions",
        "h ω / δ: step over the time of the passage", "attitude error after half a turn (rad)", right=0.8,
    )  # fmt: skip
    x = study.columns["h_omega_over_delta"]
    axes.set(xscale="log", yscale="log", xlim=(x[0], x[-1]), ylim=(1e-16, 10.0))
    labels = []
    for name in ("RK4, Euler angles", "RK4, quaternion"):
        values = [max(float(v), 1e-16) for v in study.columns[name]]
        axes.plot(x, values, "o-", color=COLOR_OF[name], markersize=3, linewidth=1.0)
        labels.append((values[-1], name.replace(", ", " on\n"), COLOR_OF[name]))
    axes.plot((10, 1, 0.1), (8e-2, 3.6e-5, 3e-9), "D", color=BLACK, markersize=6, markerfacecolor="none", clip_on=False)
    axes.annotate("predicted", (1.0, 3.6e-5), xytext=(-14, 12), textcoords="offset points", ha="right", fontsize=9)
    end_labels(axes, labels)
    return axes.figure  # type: ignore[no-any-return]


def small_angles(study: Study) -> Figure:
    """Draw law 9."""
    axes = titled_axes(
        "Formulas with cancellation lose small angles altogether: acos of the trace and (1 − cos θ) / θ²\n"
        "are 100 % wrong below 1e-8; rbfmu's rotation vector keeps every digit",
        "angle θ (rad)", "relative error",
    )  # fmt: skip
    x = study.columns["theta"]
    axes.set(xscale="log", yscale="log", xlim=(1e-12, 1.0), ylim=(5e-18, 20.0))
    for name, color, marker, size in (
        ("acos of the trace", ORANGE, "o", 5.0),
        ("(1 - cos) / theta^2", PURPLE, ".", 4.0),
        ("rotvec_from_quaternion", BLUE, ".", 4.0),
    ):
        axes.plot(x, study.columns[name], marker, color=color, markersize=size)
    axes.text(3e-6, 1e-2, "acos of the trace", color=ink(ORANGE), fontsize=10)
    axes.text(3e-6, 1e-3, "(1 − cos θ) / θ²", color=ink(PURPLE), fontsize=10)
    axes.text(1e-10, 1e-15, "rotvec_from_quaternion (points at the bottom: no error)", color=BLUE, fontsize=10)
    axes.axhline(2.0**-52, color=GREY, linewidth=0.8)
    axes.text(1.3e-12, 3e-16, "eps", color=GREY, fontsize=9)
    return axes.figure  # type: ignore[no-any-return]
