"""The study behind `rbfmu chart`: accuracy against cost of every method, on a scene of one's own or on eight motions.

All methods and installed peers are run on a scene as it is, with its ports at zero, and judged by its true motion.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rbfmu.scene.scene import Scene, of_scene_or_path
from rbfmu.studies.chart.result import SIDES, Measured, Progress, verdicts, write_rows
from rbfmu.studies.chart.tables import chart_text, headline, plans_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Chart", "chart", "run_charts", "write_charts"]

QUICK_MOTIONS = ("a", "c", "d")
DECADES = tuple(10.0**-k for k in range(2, 15))


class Chart(Measured):
    """Accuracy against cost on a scene; `print` shows a table, `save` writes table, CSV file and picture.

    What it holds, such as `rows`: see `result.Measured`.
    """

    @cached_property
    def table(self) -> str:
        """Return the findings as text of at most 80 columns."""
        return chart_text(self)

    def figure(self) -> "Figure":
        """Return the picture as a figure of matplotlib."""
        from rbfmu.studies.chart.drawing import figure_of

        return figure_of(self)

    def save(self, folder: str | Path, name: str = "") -> list[Path]:
        """Write NAME.csv (all measurements), NAME.txt (the table) and NAME.png to a folder; return the files.

        name: the scene's, if none is given.
        """
        return _save(self, Path(folder), name or self.scene)

    def __str__(self) -> str:
        return self.table

    def __repr__(self) -> str:
        what = f"Chart of {self.scene}: {len(self.rows)} points; print it, or save(folder)"
        return "\n".join((what, *headline(self)))

    def _repr_html_(self) -> str:
        """Return picture and table for a notebook."""
        from base64 import b64encode
        from html import escape
        from io import BytesIO

        buffer = BytesIO()
        self.figure().savefig(buffer, format="png")
        picture = b64encode(buffer.getvalue()).decode()
        return f'<img src="data:image/png;base64,{picture}" width="880"/><pre>{escape(self.table)}</pre>'


def _save(chart: Measured, folder: Path, name: str) -> list[Path]:
    from rbfmu.studies.chart.drawing import figure_of

    folder.mkdir(parents=True, exist_ok=True)
    stem = re.sub(r"[^\w.-]+", "_", name) or "scene"
    csv, text, picture = (folder / f"{stem}{ending}" for ending in (".csv", ".txt", ".png"))
    write_rows(csv, map(asdict, chart.rows), [*chart.machine, *chart.absent])
    text.write_text(chart_text(chart) + "\n", encoding="utf-8")
    figure_of(chart).savefig(picture)
    return [csv, text, picture]


@of_scene_or_path
def chart(
    scene: Scene, quick: bool = False, progress: Progress | None = None, method: str | Path | None = None
) -> Chart:
    """Chart accuracy against cost of every method and installed peer on a scene, or that of a scene file.

    quick: few methods and settings, to see that it runs; progress: called with (done, total, text); method: a
    file with a method of one's own (`rbfmu.studies.one_step`), which competes.
    A full chart takes one or two minutes. Raises SceneError where the accuracy asked cannot be met.
    """
    from rbfmu.studies.chart.cases import case_of
    from rbfmu.studies.chart.measure import extent, measure

    what = extent(quick, method)
    progress = progress or (lambda done, total, text: None)
    progress(0, 1, f"{scene.name}: the true motion")
    found = measure(case_of(scene), what, progress)
    known = {field.name: getattr(found, field.name) for field in fields(found)}
    return Chart(**known | {"whole": scene.run.stop - scene.run.start})


# The charts of the eight motions, and what they say together


def run_charts(folder: Path, quick: bool, progress: Progress, method: Path | None = None) -> list[Path]:
    """Chart the eight motions (quick: three of them, by few methods); return the files, `answers.txt` first of texts.

    progress, method: as in `chart`.
    """
    from rbfmu.studies.chart.cases import CASES
    from rbfmu.studies.chart.measure import charts_of, extent

    return write_charts(folder, charts_of(QUICK_MOTIONS if quick else tuple(CASES), extent(quick, method), progress))


def write_charts(folder: Path, charts: Sequence[Measured]) -> list[Path]:
    """Write all measurements, what to use for an accuracy, and each chart; return the files."""
    from rbfmu.studies.chart.drawing import draw_answers, draw_kept

    folder.mkdir(parents=True, exist_ok=True)
    judged, head = verdicts(charts), charts[0].machine + charts[0].absent
    text = folder / "answers.txt"
    text.write_text(plans_text(judged, charts[0].machine) + "\n", encoding="utf-8")
    files = [
        write_rows(folder / "work_precision.csv", (_of(c) | asdict(row) for c in charts for row in c.rows), head),
        write_rows(folder / "endings.csv", (_of(c) | end._asdict() for c in charts for end in c.ends), head),
        write_rows(folder / "answers.csv", (row for c in charts for row in answers(c)), head),
        text,
        draw_answers(judged, folder / "answers.png"),
    ]
    for one in charts:
        name = one.key.replace("'", "2")
        files += _save(one, folder, f"case_{name}_many" if one.many else f"case_{name}")
        files += [] if one.many else draw_kept(one, folder / f"kept_{name}.png")
    return files


def _of(chart: Measured) -> dict[str, object]:
    return {"case": chart.key, "title": chart.scene, "outputs": chart.outputs}


def answers(chart: Measured) -> Iterator[dict[str, object]]:
    """Yield, accuracy by accuracy, the cheapest method of the library, of plans, of common integrators and of peers."""
    for accuracy in DECADES:
        found = _of(chart) | {"accuracy": accuracy}
        for side, families in SIDES.items():
            offer = chart.cheapest(families, accuracy)
            cost = offer.cost * chart.span if offer else math.nan
            found |= {side: offer.method if offer else "", f"{side}_cost": cost}
        yield found
