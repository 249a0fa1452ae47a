"""`rbfmu chart`: for accuracy X, use method Y, it costs Z.

Figures are collected first (CSV), answers and pictures are made from them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["run_charts"]


def run_charts(folder: Path, quick: bool, progress: Callable[[int, int, str], Any]) -> list[Path]:
    """Run all methods on all cases (quick: few), write figures, answers and charts to a folder; returns the files.

    progress: called with (done, total, text). `answers.txt` among the files is for the terminal.
    """
    from rbfmu.work_precision.answers import answer_table, answers
    from rbfmu.work_precision.collection import collect, extent, machine, write_points, write_rows
    from rbfmu.work_precision.drawing import draw_answers, draw_case
    from rbfmu.work_precision.plans import verdict_table, verdicts

    points, notes = collect(extent(quick), progress)
    folder.mkdir(parents=True, exist_ok=True)
    found = answers(points)
    files = [
        write_points(folder / "work_precision.csv", points, notes),
        write_rows(folder / "answers.csv", (answer.row() for answer in found), machine()),
        folder / "answers.txt",
        draw_answers(found, folder / "answers.png"),
    ]
    kept = verdicts(points)
    tables = [answer_table(found), "", *([verdict_table(kept), ""] if kept else [])]
    files[2].write_text("\n".join([*tables, *machine()]) + "\n", encoding="utf-8")
    for case in dict.fromkeys(point.case for point in points):
        mine, answered = [p for p in points if p.case == case], [a for a in found if a.case == case]
        files.append(draw_case(mine, answered, folder / f"case_{case.replace(chr(39), '2')}.png"))
    return files
