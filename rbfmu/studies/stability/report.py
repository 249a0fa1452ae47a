"""The table of laws on the terminal: prediction, its source, measurement, verdict."""

from collections.abc import Sequence
from itertools import groupby

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

from rbfmu.studies.stability.findings import AT_MOST, EQUAL, RECORDED, Finding
from rbfmu.studies.stability.laws import LAWS

WIDTH = 80
_INDENT = (0, 0, 0, 2)
_RECORDED = '"Recorded": no theory gives this figure; it was measured when the law was written down.'
_HOLDS = {EQUAL: "holds", AT_MOST: "holds", RECORDED: "as recorded"}
_FAILS = {EQUAL: "FAILS", AT_MOST: "FAILS", RECORDED: "NOT as recorded"}


def print_laws(findings: Sequence[Finding]) -> None:
    """Print law by law in at most 80 columns; findings that differ only by their place share a row."""
    console = Console(highlight=False, width=WIDTH)
    for law, members in groupby(sorted(findings, key=lambda f: f.law), key=lambda f: f.law):
        console.print(f"\n[bold]Law {law}.[/bold] {LAWS[law].says}")
        console.print(Padding(f"Predicted by: {LAWS[law].source}", _INDENT, expand=False))
        table = Table(box=None, padding=(0, 1), pad_edge=False)
        table.add_column("finding", ratio=1)
        for name in ("predicted", "measured"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("verdict", no_wrap=True)
        for row in rows(list(members)):
            table.add_row(*map(escape, row))
        console.print(Padding(table, _INDENT))
    if any(f.kind == RECORDED for f in findings):
        console.print(f"\n{_RECORDED}")


def rows(findings: Sequence[Finding]) -> list[tuple[str, str, str, str]]:
    """Return (finding, predicted, measured, verdict) of the worst in each group, and of each that does not hold."""
    found: list[tuple[str, str, str, str]] = []
    together: dict[str, list[Finding]] = {}
    for finding in findings:
        together.setdefault(finding.what, []).append(finding)
    for what, members in together.items():
        good = [f for f in members if f.holds]
        if good:
            places = f" ({len(good)} of {len(members)})" if len(members) > 1 else ""
            found.append(_row(max(good, key=lambda f: f.measured), what + places))
        found += [_row(f, f"{what} ({f.place})" if f.place else what) for f in members if not f.holds]
    return found


def _row(finding: Finding, what: str) -> tuple[str, str, str, str]:
    predicted = ("<= " if finding.kind == AT_MOST else "") + _number(finding.predicted)
    verdict = (_HOLDS if finding.holds else _FAILS)[finding.kind]
    return what, predicted, _number(finding.measured), verdict


def _number(x: float) -> str:
    return f"{x:.6g}" if 1e-3 < abs(x) < 1e6 else f"{x:.3g}"
