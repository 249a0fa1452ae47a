"""The maps of verdicts as small multiples: one panel for each method."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from rbfmu.studies.stability.maps import ACCURACY, LARGEST_ERROR, LONG_TURN, OURS, TURN, VERDICTS, Row

_COLORS = ("#009e73", "#e69f00", "#000000", "#56b4e9")
"""The colours of VERDICTS, from the Okabe-Ito palette."""
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
        _draw(panel, name, [row for row in rows if row[0] == name])
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


def _draw(panel: Any, name: str, rows: Sequence[Row]) -> None:
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
