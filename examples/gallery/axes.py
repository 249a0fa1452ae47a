"""What the gallery's pictures share: panels under a title that says the finding, and names of lines and axes."""

from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image


def panels(title: str, *widths: float) -> tuple[Figure, list[Any]]:
    """Return a figure under a title that says the finding, with panels side by side."""
    figure = Figure(figsize=(7.0, 2.7), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    found = figure.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0].tolist()
    for axes in found:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e6e6e6", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.0)
    return figure, found


def name_axes(axes: Any, x: str, y: str) -> None:
    """Labels of both axes."""
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)


def at_end(axes: Any, line: Any, text: str) -> None:
    """Write a line's name at its right end, in its colour."""
    axes.annotate(
        text, (line.get_xdata()[-1], line.get_ydata()[-1]), xytext=(4, 0), textcoords="offset points", va="center",
        color=line.get_color(), fontsize=9, annotation_clip=False,
    )  # fmt: skip


def save(figure: Figure, path: Path) -> None:
    """As a PNG of 64 colours, a third of the size."""
    file = BytesIO()
    figure.savefig(file, dpi=110)
    Image.open(file).convert("RGB").quantize(64).save(path, optimize=True)
