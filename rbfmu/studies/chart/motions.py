"""The charts of the eight motions, with few and with many outputs, and what they say together."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from rbfmu.studies.chart.cases import CASES, few_and_many
from rbfmu.studies.chart.drawing import draw_answers, draw_kept
from rbfmu.studies.chart.findings import SIDES, above_round_off, cheapest, verdicts
from rbfmu.studies.chart.measure import Extent, Progress, extent, measure
from rbfmu.studies.chart.result import Chart, write_rows
from rbfmu.studies.chart.tables import plans_text

QUICK_MOTIONS = ("a", "c", "d")
DECADES = tuple(10.0**-k for k in range(2, 15))


def run_charts(folder: Path, quick: bool, progress: Progress, method: Path | None = None) -> list[Path]:
    """Chart the eight motions (quick: three of them, by few methods); return the files, `answers.txt` first of texts.

    progress: called with (done, total, text); method: a file with a method of one's own.
    """
    what = extent(quick, method)
    return write_charts(folder, charts_of(QUICK_MOTIONS if quick else tuple(CASES), what, progress))


def charts_of(keys: Sequence[str], what: Extent, progress: Progress) -> list[Chart]:
    """Return a chart of each motion with few and with many outputs."""
    cases, first_calls = few_and_many(keys), dict[str, float]()
    share = 1000

    def part(i: int) -> Progress:
        return lambda done, total, text: progress(i * share + done * share // total, len(cases) * share, text)

    return [measure(case, what, part(i), first_calls) for i, case in enumerate(cases)]


def write_charts(folder: Path, charts: Sequence[Chart]) -> list[Path]:
    """Write all measurements, what to use for an accuracy, and each chart; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    judged, head = verdicts(charts), charts[0].machine + charts[0].absent
    text = folder / "answers.txt"
    text.write_text(plans_text(judged, charts[0].machine) + "\n", encoding="utf-8")
    files = [
        write_rows(folder / "work_precision.csv", (_of(c) | asdict(row) for c in charts for row in c.rows), head),
        write_rows(folder / "endings.csv", (_of(c) | asdict(end) for c in charts for end in c.ends), head),
        write_rows(folder / "answers.csv", (row for c in charts for row in answers(c)), head),
        text,
        draw_answers(judged, folder / "answers.png"),
    ]
    for chart in charts:
        name = chart.key.replace("'", "2")
        files += chart.save(folder, f"case_{name}_many" if chart.many else f"case_{name}")
        files += [] if chart.many else draw_kept(chart, folder / f"kept_{name}.png")
    return files


def _of(chart: Chart) -> dict[str, object]:
    return {"case": chart.key, "title": chart.scene, "outputs": chart.outputs}


def answers(chart: Chart) -> Iterator[dict[str, object]]:
    """Yield, accuracy by accuracy, the cheapest method of the library, of plans, of common integrators and of peers."""
    for accuracy in DECADES:
        found = _of(chart) | {"accuracy": accuracy}
        for side, families in SIDES.items():
            offer = cheapest(above_round_off(chart), families, accuracy)
            cost = offer.cost * chart.span if offer else math.nan
            found |= {side: offer.method if offer else "", f"{side}_cost": cost}
        yield found
