"""The picture of an ensemble: bands over time, how runs end, and what drives the ends."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from rbfmu.ensembles import attitudes, variables
from rbfmu.ensembles.result import Drivers, EnsembleResult
from rbfmu.plot import COLORS, Picture, open_frame, quantity_label, with_file, with_unit
from rbfmu.types import Array
from rbfmu_kernels.quantities import Quantity, indices

BANDS = ((0.05, 0.95, 0.16), (0.25, 0.75, 0.3))
"""The lower and upper quantile of each band, and its opacity."""
MOST_DOTS = 3000
SIGMAS = (1.0, 2.0, 3.0)
WORDS = (
    "Left: median, half of the runs, and 90 % of them. Right: runs at the end, with ellipses at 1, 2 and 3 standard "
    "deviations.\nBelow: rank correlations of what varies with how the runs end, where chance alone does not make them."
)


def plot_ensemble(result: EnsembleResult, path: str | Path | None = None) -> Figure:
    """Draw an ensemble, also to a file if a path is given; return the figure."""
    names, drivers = tuple(result.rows), result.drivers()
    events = tuple(result.counts)
    heights = [*[1.9] * len(names), *[1.5] * len(events), 0.7 + 0.24 * len(drivers.varied)]
    figure = Picture(figsize=(10.0, 1.3 + sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights, width_ratios=(2.2, 1.0))
    first = None
    for row, name in enumerate(names):
        first = figure.add_subplot(grid[row, 0], sharex=first)
        _bands(first, result, name, row == len(names) - 1)
        if name in result.ended and len(result.good) > 1:
            _ends(figure.add_subplot(grid[row, 1]), result, name)
    for row, name in enumerate(events, len(names)):
        _event(figure.add_subplot(grid[row, 0], sharex=first), figure.add_subplot(grid[row, 1]), result, name)
    _drivers(figure, figure.add_subplot(grid[-1, :]), drivers)
    failed = f", {len(result.failed):,} failed" if result.failed else ""
    figure.suptitle(f"{result.scene.name}: {result.runs:,} runs{failed}", fontsize=12)
    figure.supxlabel(WORDS, fontsize=8, color="#444444")
    return with_file(figure, path)


def _bands(axes: Any, result: EnsembleResult, name: str, is_last: bool) -> None:
    row, is_kept = result.rows[name], name in result.quantiles
    turned = is_kept and name == attitudes.ATTITUDE
    components = ("angle from the mean",) if turned else row.components
    if is_kept:
        quantiles = result.quantiles[name].reshape(len(result.probabilities), len(result.time), -1)
        at = {p: quantiles[k] for k, p in enumerate(result.probabilities.tolist())}
        for j, component in enumerate(components):
            for low, high, opacity in BANDS:
                ends = at[low][:, j], at[high][:, j]
                axes.fill_between(result.time, *ends, color=COLORS[j], alpha=opacity, linewidth=0.0)
            axes.plot(result.time, at[0.5][:, j], color=COLORS[j], linewidth=1.2, label=component)
    else:
        axes.text(0.5, 0.5, "statistics over time are not kept", ha="center", transform=axes.transAxes, color="#777777")
    axes.set_ylabel("angle from the mean\nattitude (rad)" if turned else quantity_label(row), fontsize=9)
    axes.tick_params(labelsize=8, labelbottom=is_last)
    axes.yaxis.get_offset_text().set_fontsize(8)
    axes.margins(x=0.0)
    open_frame(axes, grid=True, legend=is_kept and len(components) > 1)
    if is_last:
        axes.set_xlabel("time (s)", fontsize=9)


def _ends(axes: Any, result: EnsembleResult, name: str) -> None:
    """Draw the ends in the two components that spread most, or a histogram if only one component differs."""
    row, ends = result.rows[name], result.good_ends(name)
    apart = variables.differ(ends)
    if not apart.any():
        _say(axes, "all runs end alike")
        return
    spread = np.argsort(-np.where(apart, ends.std(axis=0), -1.0), kind="stable")
    open_frame(axes)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=5)
    axes.ticklabel_format(scilimits=(-2, 4))
    for axis in (axes.xaxis, axes.yaxis):
        axis.get_offset_text().set_fontsize(8)  # as large as the axis' numbers
    if np.count_nonzero(apart) == 1:
        axes.hist(ends[:, spread[0]], bins=40, color=COLORS[0], alpha=0.6)
        axes.set_xlabel(_component(row, spread[0]), fontsize=8, loc="left")
        axes.set_ylabel("runs", fontsize=8)
        return
    j, k = sorted(spread[:2].tolist())
    dots = ends[:: max(1, len(ends) // MOST_DOTS)]
    axes.plot(dots[:, j], dots[:, k], ".", markersize=2.0, color="#888888", alpha=0.5, markeredgewidth=0.0, zorder=1)
    pair = ends[:, [j, k]]
    for sigma in SIGMAS:
        axes.add_patch(_ellipse(pair.mean(axis=0), np.cov(pair.T), sigma))
    axes.set_xlabel(_component(row, j), fontsize=8, loc="left")  # on the right is the power of ten
    axes.set_ylabel(_component(row, k), fontsize=8)


def _component(row: Quantity, k: int) -> str:
    return with_unit(f"{row.name}{indices(row)[k]}", row.unit)


def _event(axes: Any, beside: Any, result: EnsembleResult, name: str) -> None:
    """Draw the share of runs in which an event has happened, over time, and how often it happens in a run."""
    times, counts = np.sort(result.first_of(name)), result.counts[name][result.good]
    share = np.arange(len(times) + 1) / max(len(counts), 1)
    ends = np.concatenate([result.time[:1], times, result.time[-1:]])
    axes.step(ends, [*share, share[-1]], where="post", color=COLORS[0], linewidth=1.2)
    axes.set_ylim(-0.03, 1.03)
    axes.set_ylabel(f"{name}\nhas happened\n(share of runs)", fontsize=9)
    axes.set_xlabel("time (s)", fontsize=9)
    often, runs = np.unique(counts, return_counts=True)
    beside.bar(often, runs, color=COLORS[0], alpha=0.6)
    beside.xaxis.get_major_locator().set_params(integer=True, nbins=5, min_n_ticks=1)
    beside.set_xlabel(f"how often {name} happens", fontsize=8)
    beside.set_ylabel("runs", fontsize=8)
    for one in (axes, beside):
        one.tick_params(labelsize=8)
        open_frame(one, grid=one is axes)


def _say(axes: Any, text: str) -> None:
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", transform=axes.transAxes, color="#777777")


def _ellipse(middle: Array, covariance: Array, sigma: float) -> Ellipse:
    variances, axes = np.linalg.eigh(covariance)
    width, height = 2.0 * sigma * np.sqrt(np.maximum(variances, 0.0))
    angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
    return Ellipse(tuple(middle), width, height, angle=angle, fill=False, edgecolor=COLORS[1], linewidth=1.1, zorder=2)


def _drivers(figure: Any, axes: Any, drivers: Drivers) -> None:
    if not drivers.varied or not drivers.ends:
        _say(axes, "no correlations: no ends of runs that differ")
        return
    image = axes.imshow(drivers.correlations, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    axes.set_yticks(range(len(drivers.varied)), drivers.varied, fontsize=8)
    axes.set_xticks(range(len(drivers.ends)), drivers.ends, fontsize=8, rotation=35, ha="right", rotation_mode="anchor")
    axes.tick_params(length=0.0)
    for i, j in np.ndindex(drivers.correlations.shape):
        value = float(drivers.correlations[i, j])
        if abs(value) > drivers.chance:
            color = "white" if abs(value) > 0.6 else "black"
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", fontsize=7, color=color)
    figure.colorbar(image, ax=axes, shrink=0.9, pad=0.01).ax.tick_params(labelsize=7)
