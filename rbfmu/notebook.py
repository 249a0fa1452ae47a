"""Scenes, plans and results as tables of HTML, which notebooks show."""

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from rbfmu_kernels.quantities import OUTPUT

if TYPE_CHECKING:
    from rbfmu.ensembles.result import EnsembleResult
    from rbfmu.results.result import Result
    from rbfmu.runs.plan import Plan
    from rbfmu.scene.scene import Scene


def table(caption: str, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return a table of texts."""
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def scene_html(scene: "Scene") -> str:
    """Return what the scene says, without what is as by default."""
    return table(scene.name, ("key", "value", "unit", "meaning"), scene.rows())


def plan_html(plan: "Plan") -> str:
    """Return what the plan says."""
    rows = [
        ("method", plan.method),
        ("states", plan.states),
        ("error expected", f"{plan.error:.1e}"),
        *(("because", reason) for reason in plan.reasons),
    ]
    return table(plan.model, ("", ""), rows)


def result_html(result: "Result") -> str:
    """Return the first, last, smallest and largest values of each quantity."""
    time = result.time
    header = ("quantity", "unit", f"t = {time[0]:g} s", f"t = {time[-1]:g} s", "smallest", "largest")
    rows = (
        (name, OUTPUT[name].unit, *map(_numbers, (v[0], v[-1], v.min(axis=0), v.max(axis=0))))
        for name, v in result.quantities.items()
    )
    return table(f"{len(time)} points in time", header, rows)


def ensemble_html(result: "EnsembleResult") -> str:
    """Return mean and spread of each quantity at the end of the runs that did not fail."""
    header = ("quantity", "unit", "mean", "standard deviation")
    rows = ((name, OUTPUT[name].unit, *map(_numbers, result.at_end(name))) for name in result.ended)
    caption = f"{result.scene.name}: {result.runs:,} runs, {len(result.failed):,} failed; at t = {result.time[-1]:g} s"
    return table(caption, header, rows)


def _numbers(values: Any) -> str:
    return ", ".join(f"{x:.5g}" for x in np.atleast_1d(values))
