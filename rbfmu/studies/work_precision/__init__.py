"""The study behind `rbfmu chart`: which method to use for an accuracy, and what it costs.

All measurements are collected first (CSV); answers and pictures are made from them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["run_charts"]


def run_charts(folder: Path, quick: bool, progress: Callable[[int, int, str], Any]) -> list[Path]:
    """Run all methods on all cases (quick: few), write figures, answers and charts to a folder; return the files.

    progress: called with (done, total, text). `answers.txt` among the files is for the terminal.
    """
    from rbfmu.studies.work_precision.collection import collect, extent

    return write_charts(folder, collect(extent(quick), progress))


def write_charts(folder: Path, found: Any) -> list[Path]:
    """Write figures, answers and charts of a `Collection`."""
    from dataclasses import asdict

    from rbfmu.studies.work_precision.answers import answers
    from rbfmu.studies.work_precision.collection import machine, write_points, write_rows
    from rbfmu.studies.work_precision.drawing import draw_answers, draw_case, draw_kept
    from rbfmu.studies.work_precision.plans import verdicts
    from rbfmu.studies.work_precision.tables import dearness_table, plan_table, stopped_table, wrapped

    folder.mkdir(parents=True, exist_ok=True)
    judged = verdicts(found)
    files = [
        write_points(folder / "work_precision.csv", found.points),
        write_rows(folder / "endings.csv", map(asdict, found.endings), machine()),
        write_rows(folder / "answers.csv", (answer.row() for answer in answers(found.points)), machine()),
        folder / "answers.txt",
        draw_answers(judged, folder / "answers.png"),
    ]
    tables = [plan_table(judged), dearness_table(judged), stopped_table(found), "\n".join(wrapped(machine()))]
    files[3].write_text("\n\n".join(filter(None, tables)) + "\n", encoding="utf-8")
    for case in dict.fromkeys(point.case for point in found.points):
        mine = [point for point in found.points if point.case == case]
        name = case.replace("'", "2")
        files.append(draw_case(mine, found.endings, folder / f"case_{name}.png"))
        files += draw_kept(mine, folder / f"kept_{name}.png")
    return files
