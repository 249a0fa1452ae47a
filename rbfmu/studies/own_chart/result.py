"""What a chart of one's own scene holds: all measurements, and what they say."""

import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rbfmu.studies.own_chart.contestants import TooSmall


@dataclass(frozen=True)
class Row:
    """One method at one setting, or a plan at the accuracy that it was made for.

    kind: the line of the picture; detail: what a plan chose; error: as the scene's accuracy counts; seconds: of the
    processor, for a simulated second; run_seconds: for the whole run; spread: the ratio between the least times of two
    halves of the repeats; right_hand_sides: evaluations in a run (0: none, NaN: not counted).
    """

    kind: str
    method: str
    detail: str
    family: str
    setting: str
    value: float
    error: float
    seconds: float
    run_seconds: float
    spread: float
    right_hand_sides: float


@dataclass(frozen=True)
class End:
    """The smallest error that a method reached (infinite: none below 1), and why no finer setting was tried."""

    kind: str
    method: str
    error: float
    why: str


@dataclass(frozen=True)
class Chart:
    """Accuracy against cost on a scene; `print` shows a table, `save` writes table, CSV file and picture.

    model: the plan's; accuracy: the one asked; span, outputs: of the charted run, s; whole: the length of the scene's
    run, s; ports: those that are at zero; rows: all measurements; ends: how far each method came; too_small: models
    that the plan's is larger than; absent: lines on peers that are not charted; refusal: why no tighter plan is made;
    machine: what it was measured on.
    """

    scene: str
    model: str
    accuracy: float
    span: float
    whole: float
    outputs: int
    ports: tuple[str, ...]
    rows: tuple[Row, ...]
    ends: tuple[End, ...]
    too_small: tuple[TooSmall, ...]
    absent: tuple[str, ...]
    refusal: str
    machine: tuple[str, ...]

    @property
    def plans(self) -> tuple[Row, ...]:
        """Return the plans, first that for the accuracy asked, then for each further digit."""
        return tuple(row for row in self.rows if row.family == "planned")

    @property
    def plan(self) -> Row:
        """Return the plan for the accuracy asked."""
        return self.plans[0]

    @cached_property
    def table(self) -> str:
        """Return the findings as text of at most 80 columns."""
        from rbfmu.studies.own_chart.tables import chart_text

        return chart_text(self)

    def figure(self) -> Any:
        """Return the picture as a figure of matplotlib."""
        from rbfmu.studies.own_chart.drawing import drawn

        return drawn(self)

    def save(self, folder: str | Path) -> list[Path]:
        """Write NAME.csv (all measurements), NAME.txt (the table) and NAME.png to a folder; return the files."""
        from rbfmu.studies.work_precision.collection import write_rows

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        stem = folder / (re.sub(r"[^\w.-]+", "_", self.scene) or "scene")
        csv, text, picture = (stem.with_name(stem.name + ending) for ending in (".csv", ".txt", ".png"))
        write_rows(csv, map(asdict, self.rows), [*self.machine, *self.absent])
        text.write_text(self.table + "\n", encoding="utf-8")
        self.figure().savefig(picture)
        return [csv, text, picture]

    def __str__(self) -> str:
        return self.table

    def __repr__(self) -> str:
        return f"Chart of {self.scene}: {len(self.rows)} points; print it, or save(folder)\n" + "\n".join(self._head())

    def _head(self) -> Iterator[str]:
        from rbfmu.studies.own_chart.findings import headline

        yield from headline(self)

    def _repr_html_(self) -> str:
        """Return picture and table for a notebook."""
        from base64 import b64encode
        from html import escape
        from io import BytesIO

        buffer = BytesIO()
        self.figure().savefig(buffer, format="png")
        picture = b64encode(buffer.getvalue()).decode()
        return f'<img src="data:image/png;base64,{picture}" width="880"/><pre>{escape(self.table)}</pre>'
