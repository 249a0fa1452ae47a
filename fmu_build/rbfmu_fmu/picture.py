"""The picture of an FMU: the body as a box, the axes of b at the body's origin, the centre of mass."""

import io
import math
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu import Scene
from rbfmu.viewer.shape import Shape, shape_of
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion

Array = NDArray[np.float64]
INCHES, DPI = 2.0, 100
AZIMUTH, ELEVATION = math.radians(30.0), math.radians(28.0)
"""From where it is looked at: beside axis x towards y, from above; z is upwards."""
RIGHT = (-math.sin(AZIMUTH), math.cos(AZIMUTH), 0.0)
EYE = (math.cos(ELEVATION) * math.cos(AZIMUTH), math.cos(ELEVATION) * math.sin(AZIMUTH), math.sin(ELEVATION))
VIEW: Array = np.array([RIGHT, np.cross(EYE, RIGHT), EYE])
"""Rows: the directions right, up and towards the eye, in b."""
COLOURS = {"x": "#c8372d", "y": "#2d8a3e", "z": "#2a5db0"}
SHADES = {"x": "#b9c4d6", "y": "#94a3bb", "z": "#dbe2ee"}
"""Of the faces across the body's own axes."""
EDGE = "#4a5568"
AXIS = 0.8
"""The length of an axis beyond the box, in halves of its diagonal."""


def picture(scene: Scene) -> bytes:
    """Return a PNG of 200 by 200 points, the same bytes for the same scene and the same matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(INCHES, INCHES), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_axis_off()
    axes.set_aspect("equal")
    shape = shape_of(scene)
    _draw_box(axes, shape)
    _draw_axes(axes, shape)
    axes.margins(0.06)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return file.getvalue()


def _draw_box(axes: Any, shape: Shape) -> None:
    """Draw the three faces that are seen; a box hides none of them by another."""
    R_bp = np.array(evaluated(matrix_from_quaternion, shape.q_bp))
    for k, name in enumerate(SHADES):
        normal = R_bp[:, k] if R_bp[:, k] @ VIEW[2] > 0.0 else -R_bp[:, k]
        across = [R_bp[:, j] * shape.sides[j] / 2.0 for j in range(3) if j != k]
        middle = np.array(shape.centre) + normal * shape.sides[k] / 2.0
        corners = [middle + a * across[0] + b * across[1] for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        seen = (np.array(corners) @ VIEW.T)[:, :2]
        axes.fill(seen[:, 0], seen[:, 1], facecolor=SHADES[name], edgecolor=EDGE, linewidth=0.8, joinstyle="round")


def _draw_axes(axes: Any, shape: Shape) -> None:
    """Draw the axes of b from o, beyond the box, and the centre of mass."""
    R_bp = np.array(evaluated(matrix_from_quaternion, shape.q_bp))
    corners = [np.array(shape.centre) + R_bp @ (np.array(s) * shape.sides / 2.0) for s in product((-1, 1), repeat=3)]
    for k, name in enumerate(COLOURS):
        length = max(0.0, *(corner[k] for corner in corners)) + AXIS * shape.radius
        x, y, _ = VIEW[:, k] * length
        arrow = {"arrowstyle": "-|>", "color": COLOURS[name], "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x, y), (0.0, 0.0), arrowprops=arrow)
        axes.annotate(name, (1.08 * x, 1.08 * y), color=COLOURS[name], fontsize=9, ha="center", va="center")
        axes.plot([0.0, 1.12 * x], [0.0, 1.12 * y], alpha=0.0)  # what the view must have in it
    x, y, _ = VIEW @ np.array(shape.centre)
    axes.plot(
        [x], [y], marker="o", markersize=4.5, markerfacecolor="white", markeredgecolor="black", markeredgewidth=1.0
    )
