"""Panels of the gallery in three dimensions: a top, and the way of its axis."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from rbfmu.plot import COLORS

BLUE, VERMILION = COLORS[:2]
GREY = "#777777"
ROUND = np.linspace(0.0, 2.0 * np.pi, 61)


def in_space(figure: Figure, panel: Any) -> Any:
    """Put a panel in three dimensions, without axes, in the place of a flat one."""
    place = panel.get_subplotspec()
    panel.remove()
    axes = figure.add_subplot(place, projection="3d", computed_zorder=False)
    axes.set_axis_off()
    axes.set_proj_type("ortho")
    axes.view_init(elev=22.0, azim=-55.0)
    return axes


def draw_top_in_space(axes: Any, z: Any) -> None:
    """Draw the tip of a top's axis z (n, 3) on the unit sphere, its horizon, and the top where it begins."""
    axes.plot(np.cos(ROUND), np.sin(ROUND), 0.0 * ROUND, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot([0.0, 0.0], [0.0, 0.0], [0.0, 1.05], color=GREY, linewidth=0.8)
    axes.plot(*z.T, color=BLUE, linewidth=1.0)
    axes.plot(*zip(np.zeros(3), z[0], strict=True), color="black", linewidth=1.5)
    axes.add_collection3d(Poly3DCollection([_disc(z[0])], facecolor=BLUE, edgecolor=BLUE, alpha=0.35))
    axes.plot(*z[:1].T, "o", color=VERMILION, markersize=4)
    low = min(0.0, float(z[:, 2].min()))
    axes.set(xlim=(-1.0, 1.0), ylim=(-1.0, 1.0), zlim=(low, 1.05))
    axes.set_box_aspect((2.0, 2.0, 1.05 - low), zoom=1.35)


def _disc(axis: Any) -> Any:
    """Return the rim (61, 3) of a disc about an axis, two thirds up."""
    across = np.cross(axis, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    return 0.65 * axis + 0.35 * (np.cos(ROUND)[:, None] * across + np.sin(ROUND)[:, None] * np.cross(axis, across))
