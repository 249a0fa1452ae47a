"""Common parts of the laws' pictures: colours, axes with a title that states the finding, and direct labels."""

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from rbfmu.plot import COLORS, open_frame

BLUE, VERMILION, GREEN, PURPLE = COLORS
ORANGE, SKY, BLACK, GREY = "#e69f00", "#56b4e9", "#000000", "#777777"
"""Further colours of the Okabe-Ito palette, and a grey for everything that is no method."""
COLOR_OF = {
    "explicit Euler": VERMILION,
    "semi-implicit Euler": ORANGE,
    "implicit midpoint": SKY,
    "RK4, quaternion": GREEN,
    "RK4, quaternion not normalised": GREEN,
    "RK4, matrix": PURPLE,
    "RK4, Euler angles": VERMILION,
    "DOP853": BLUE,
    "Moser-Veselov": ORANGE,
    "Moser-Veselov, order 10": PURPLE,
    "exact": BLUE,
    "exact steps": BLUE,
}


def ink(color: str) -> str:
    """Return the colour for text, which is darker for pale colours."""
    return {ORANGE: "#b37700", SKY: "#2c7fb0", PURPLE: "#b0568c"}.get(color, color)


def titled_axes(title: str, x: str, y: str, *, left: float = 0.1, right: float = 0.97) -> Any:
    """Return one panel with a title that states the finding; labels fit outside its edges `left` and `right`."""
    figure = Figure(figsize=(8.4, 5.0))
    axes = figure.add_axes((left, 0.12, right - left, 0.74))
    axes.set_title(title, fontsize=11, x=(0.1 - left) / (right - left), loc="left", pad=10)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    open_frame(axes, grid=True)
    return axes


def law(axes: Any, x: Any, predicted: Any, measured: Any, color: str, dots: int) -> None:
    """Draw the prediction as a line, and some of the measured values as dots on it."""
    every = max(len(x) // dots, 1)
    axes.plot(x, predicted, color=color, linewidth=1.3)
    axes.plot(x[::every], measured[::every], "o", color=color, markersize=3)


def explain(axes: Any) -> None:
    """Write a note that explains lines and dots."""
    axes.text(0.02, 0.95, "lines: predicted, dots: measured", transform=axes.transAxes, fontsize=9)


def end_labels(axes: Any, labels: Sequence[tuple[float, str, str]]) -> None:
    """Write names at the right edge at the height of (value, name, colour), pushed apart where they would overlap."""
    to_fraction = axes.transData + axes.transAxes.inverted()
    x = axes.get_xlim()[1]
    height = sorted((min(max(to_fraction.transform((x, v))[1], 0.02), 0.98), name, c) for v, name, c in labels)
    place = -1.0
    for k, (y, name, color) in enumerate(height):
        lines = name.count("\n") + 1
        room = sum(0.052 * (n.count("\n") + 1) for _, n, _ in height[k + 1 :])
        place = max(min(y, 1.0 - room), place + 0.03 * (lines - 1))
        axes.text(1.01, place, name, color=ink(color), transform=axes.transAxes, va="center", fontsize=9)
        place += 0.052 + 0.03 * (lines - 1)


def mark(axes: Any, x: float, text: str, *, y: float = 0.97, align: str = "left", color: str = GREY) -> None:
    """Draw a vertical line at x with a label."""
    axes.axvline(x, color=color, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.annotate(
        text, (x, y), xycoords=("data", "axes fraction"), xytext=(4 if align == "left" else -4, 0),
        textcoords="offset points", ha=align, va="top", fontsize=9, color=color,
    )  # fmt: skip
