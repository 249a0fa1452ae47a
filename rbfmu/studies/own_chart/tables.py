"""The chart of one's own scene as text, in at most 80 columns."""

import math
import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rbfmu.studies.own_chart.findings import (
    KINDS,
    Reach,
    cost_text,
    digits,
    exhausted,
    headline,
    noise,
    reaches,
    short_number,
    times,
)
from rbfmu.studies.work_precision.tables import WIDTH, wrapped

if TYPE_CHECKING:
    from rbfmu.studies.own_chart.result import Chart

_KIND = "{:22}{:29.28}{:>9}{:>9}{:>10}"
_DIGIT = "{:10}{:41.40}{:>9}{:>9}{:>10}"
_MODEL = "{:30}{:>10}{:>14}"


def chart_text(chart: "Chart") -> str:
    """Return all that the chart says."""
    parts = (_head(chart), _kinds(chart), _digits(chart), _models(chart), wrapped([*chart.absent]))
    blocks = ["\n".join(line.rstrip() for line in part) for part in parts]
    return "\n\n".join(filter(None, [*blocks, "\n".join(wrapped(chart.machine))]))


def conditions(chart: "Chart") -> str:
    """Return how the scene was run."""
    part = f"the first {chart.span:,.8g} s of " if chart.span < 0.999 * chart.whole else ""
    said = f"{part}{chart.whole:,.8g} s, an output every {chart.span / chart.outputs:,.8g} s"
    if not chart.ports:
        return said
    return f"{said}; {' and '.join(chart.ports)} at zero all the time, so that others may step over outputs"


def _head(chart: "Chart") -> list[str]:
    return [part for line in (*headline(chart), f"charted: {conditions(chart)}") for part in wrapped([line])]


def _kinds(chart: "Chart") -> Iterator[str]:
    asked = short_number(chart.accuracy)
    yield from textwrap.wrap(
        f"What an error of at most {asked} costs: processor time, for a simulated second and for the run, of the "
        f"cheapest method of each kind. Costs within a factor of {noise(chart):.2f} are even.",
        WIDTH,
    )
    yield _KIND.format("kind", "cheapest method", "for 1 s", "the run", "of plan's")
    for reach in reaches(chart):
        yield from _kind(chart, reach)


def _kind(chart: "Chart", reach: Reach) -> Iterator[str]:
    name = KINDS[reach.kind]
    if math.isfinite(reach.cost):
        ratio = times(reach.cost / chart.plan.seconds)
        yield _KIND.format(name, reach.method, cost_text(reach.cost), cost_text(reach.cost * chart.span), ratio)
    else:
        least = short_number(reach.least) if math.isfinite(reach.least) else "none below 1"
        so_far = "stopped" if reach.stopped else "misses it"
        yield from textwrap.wrap(f"{name:22}{so_far}: {least} by {reach.best} ({reach.why})", WIDTH,
                                 subsequent_indent=" " * 24)  # fmt: skip


def _digits(chart: "Chart") -> Iterator[str]:
    yield "What each further digit costs, as rbfmu plans it:"
    yield _DIGIT.format("accuracy", "method", "error", "for 1 s", "of plan's")
    for row, ratio in digits(chart):
        yield _DIGIT.format(
            short_number(row.value), row.detail, short_number(row.error), cost_text(row.seconds), times(ratio)
        )
    if why := exhausted(chart):
        yield from textwrap.wrap(why, WIDTH)


def _models(chart: "Chart") -> Iterator[str]:
    if not chart.too_small:
        return
    yield "Smaller models than the plan's, which do not serve:"
    yield _MODEL.format("model", "error", "of accuracy's")
    for model in chart.too_small:
        if model.why:
            yield from textwrap.wrap(f"{model.model:30}{model.why}", WIDTH, subsequent_indent=" " * 32)
        else:
            ratio = f"{model.error / chart.accuracy:.1e} x" if math.isfinite(model.error) else ""
            yield _MODEL.format(model.model, short_number(model.error), ratio)
