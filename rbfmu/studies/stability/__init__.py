"""Where methods fail: the laws of stability, measured and compared with their predictions, with pictures and maps.

A law is a theoretical prediction; a finding is one predicted number with its measured value. `run_stability` first
writes all numbers to CSV files and then draws them; `print_laws` shows them as a table on the terminal.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any
from warnings import catch_warnings

from rich import console, markup, padding, table

from rbfmu.exceptions import SceneWarning
from rbfmu.studies import WIDTH, one_step, tables_of, write_rows

LAWS: dict[int, dict[str, Any]] = {int(number): law for number, law in tables_of("stability/laws.toml").items()}
"""The laws by number: what each says, the source of its predicted numbers, and the rows of its findings by name."""
_FINDINGS = {name: (number, row) for number, law in LAWS.items() for name, row in law["findings"].items()}

EQUAL, AT_MOST, RECORDED, OWN = "equal", "at most", "recorded", "own"
"""The kinds of findings. The measured value equals a prediction (EQUAL), is at most a bound (AT_MOST), or equals an
earlier measurement (RECORDED). For a user's method (OWN) the prediction is that of an exact motion; any value holds."""


@dataclass(frozen=True)
class Finding:
    """One number that theory predicts, and its measured value.

    tolerance: the largest difference allowed, relative to the prediction; for AT_MOST the prediction is a bound.
    place: the cell of a map, or the motion; findings with the same `what` are reported together.
    """

    law: int
    what: str
    predicted: float
    measured: float
    tolerance: float
    kind: str = EQUAL
    place: str = ""

    @property
    def holds(self) -> bool:
        """Return whether the measurement agrees with the prediction."""
        if self.kind == OWN:
            return True
        if self.kind == AT_MOST:
            return self.measured <= self.predicted
        return math.isclose(self.measured, self.predicted, rel_tol=self.tolerance, abs_tol=0.0)

    def __str__(self) -> str:
        place = f" ({self.place})" if self.place else ""
        return f"law {self.law}, {self.what}{place}: predicted {self.predicted!r}, measured {self.measured!r}"


def finding(
    name: str, measured: float, predicted: float = math.nan, /, near: float = 0.0, place: str = "", **words: object
) -> Finding:
    """Return the finding with this name in `laws.toml`; words: the values of the names in braces there.

    predicted, near: the prediction and its relative tolerance, used if the table has none. A finding without any
    prediction (NaN) does not hold.
    """
    law, row = _FINDINGS[name]
    predicted, near = row.get("predicted", predicted), row.get("near", near)
    what, kind = row["what"].format(**words), row.get("kind", EQUAL)
    return Finding(law, what, float(predicted), float(measured), near, kind, place)  # NumPy's floats print differently


def exponent(larger: float, smaller: float, ratio: float = 2.0) -> float:
    """Return p with larger / smaller = ratio^p; NaN, which agrees with no prediction, if there is no such p."""
    quotient = larger / smaller if smaller else math.nan
    return math.log(quotient) / math.log(ratio) if 0.0 < quotient < math.inf else math.nan


Columns = dict[str, list[Any]]
"""Columns of numbers or names, of equal length, by their headings."""
CURVE = "your method"
"""The heading of the column with the curve of a user's own method."""


@dataclass
class Study:
    """Measurements of laws that share a picture: findings, and the picture's curves as columns of equal length.

    curve: computes the curve of any one-step method; None if the study has no such curve.
    """

    name: str
    findings: list[Finding]
    columns: Columns = field(default_factory=dict)
    curve: Callable[[one_step.OneStepMethod], list[float]] | None = None


_NAMES = ("law", "what", "place", "kind", "predicted", "measured", "tolerance", "holds")
"""The columns of `laws.csv`."""


def write_columns(path: Path, columns: Mapping[str, Sequence[object]]) -> Path:
    """Write a CSV file with all digits."""
    return write_rows(path, (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)), ())


_INDENT = (0, 0, 0, 2)
_VERDICTS = {RECORDED: ("NOT as recorded", "as recorded"), OWN: ("", "yours")}


def print_laws(findings: Sequence[Finding]) -> None:
    """Print law by law in at most 80 columns; findings that differ only by their place share a row."""
    out = console.Console(highlight=False, width=WIDTH)
    for law, members in groupby(sorted(findings, key=lambda f: f.law), key=lambda f: f.law):
        out.print(f"\n[bold]Law {law}.[/bold] {LAWS[law]['says']}")
        out.print(padding.Padding(f"Predicted by: {LAWS[law]['source']}", _INDENT, expand=False))
        found = table.Table(box=None, padding=(0, 1), pad_edge=False)
        found.add_column("finding", ratio=1)
        for name in ("predicted", "measured"):
            found.add_column(name, justify="right", no_wrap=True)
        found.add_column("verdict", no_wrap=True)
        for row in rows(members):
            found.add_row(*map(markup.escape, row))
        out.print(padding.Padding(found, _INDENT))
    if any(f.kind == RECORDED for f in findings):
        out.print('\n"Recorded": no theory gives this figure; it was measured when the law was written down.')


def rows(findings: Iterable[Finding]) -> Iterator[tuple[str, str, str, str]]:
    """Yield (finding, predicted, measured, verdict) for each group with the same `what`.

    Of the findings that hold, the one with the largest measured value is shown, and of the others each.
    """
    listed = [*findings]
    for what in dict.fromkeys(f.what for f in listed):
        members = [f for f in listed if f.what == what]
        if good := [f for f in members if f.holds]:
            places = f" ({len(good)} of {len(members)})" if len(members) > 1 else ""
            yield _row(max(good, key=lambda f: f.measured), what + places)
        yield from (_row(f, f"{what} ({f.place})" if f.place else what) for f in members if not f.holds)


def _row(finding: Finding, what: str) -> tuple[str, str, str, str]:
    predicted = ("<= " if finding.kind == AT_MOST else "") + _number(finding.predicted)
    verdict = _VERDICTS.get(finding.kind, ("FAILS", "holds"))[finding.holds]
    return what, predicted, _number(finding.measured), verdict


def _number(x: float) -> str:
    return f"{x:.6g}" if 1e-3 < abs(x) < 1e6 else f"{x:.3g}"


# The run


def all_studies() -> tuple[Callable[[bool], Study], ...]:
    """Return the functions that measure one or more laws each; their argument asks for a quick, coarse run."""
    from rbfmu.studies.stability import method_laws as laws, motion_laws

    return (
        laws.growth_factors, laws.drift, laws.gimbal_passage, laws.gyroscopic_blow_up, laws.damping_limits,
        laws.moser_veselov_limits, laws.energy_drift, laws.small_angles,
        motion_laws.intermediate_axis, motion_laws.sleeping_top, motion_laws.splitting_resonance,
        motion_laws.product_models, motion_laws.orders_and_error_control,
    )  # fmt: skip


def run_stability(
    folder: Path, quick: bool = False, progress: Callable[[Sequence[Any]], Iterable[Any]] | None = None,
    method: str | Path | None = None,
) -> tuple[list[Finding], list[Path]]:  # fmt: skip
    """Measure all laws and maps, write CSV files and pictures into a folder, and return findings and paths.

    progress: wraps the sequence of parts, for instance in a progress bar; a part takes a few seconds. method: a file
    with a method of your own (`rbfmu.studies.one_step`), which is measured as well.
    """
    from rbfmu.studies.stability import method_laws, motions
    from rbfmu.studies.stability.pictures import draw, draw_maps

    own = None if method is None else one_step.method_of_file(method)
    folder.mkdir(parents=True, exist_ok=True)
    studies, found, cells = all_studies(), list[Study](), list[motions.Row]()
    findings, paths = list[Finding](), list[Path]()
    judged = [(name, motions.METHODS[name]) for name in (motions.QUICK_METHODS if quick else motions.METHODS)]
    judged += [(own.name, partial(motions.verdict_of_steps, own))] if own else []

    def write() -> list[Path]:
        measured = [f for study in found for f in study.findings] + motions.findings_of_maps(cells)
        findings.extend(sorted(measured, key=lambda f: f.law))
        return [
            write_columns(folder / "laws.csv", {name: [getattr(f, name) for f in findings] for name in _NAMES}),
            *(write_columns(folder / f"{study.name}.csv", study.columns) for study in found if study.columns),
            write_rows(folder / "maps.csv", (cell._asdict() for cell in cells), ()),
        ]

    parts: list[tuple[list[Any], Callable[[], Sequence[object]]]] = [
        *((found, lambda study=study: [study(quick)]) for study in studies),
        *((cells, partial(motions.verdicts, *pair, quick)) for pair in judged),
        *([(found, lambda: [method_laws.own_laws(own, found)])] if own else ()),
        (paths, write),
        *((paths, lambda k=k: [draw(found[k], folder)]) for k in range(len(studies))),
        (paths, lambda: [draw_maps(cells, folder / "maps.png")]),
    ]
    with catch_warnings(action="ignore", category=SceneWarning):  # here whole turns between points are intended
        for results, part in parts if progress is None else progress(parts):
            results.extend(part())
    return findings, paths
