"""What a chart holds: all measurements on a case, how far each method came, and the models that are too small."""

import csv
import math
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rbfmu.studies.chart.contestants import TooSmall

STOPPED = "stopped: time limit"
YOURS = "your method"
KINDS = {
    "rbfmu's plan": "#000000",
    "exact": "#009e73",
    "Taylor series": "#56b4e9",
    "DOP853": "#0072b2",
    "splitting": "#cc79a7",
    "Moser-Veselov": "#8a7500",
    "heyoka.py": "#d55e00",
    "numbalsoda": "#e69f00",
    "SciPy odeint": "#a0522d",
    "SciPy solve_ivp": "#c97b63",
    "MuJoCo": "#7b3294",
    "Basilisk": "#b58ac2",
    "Drake": "#5e3c99",
    "RK4, Euler and others": "#8c8c8c",
    YOURS: "#e7298a",
}
"""The kinds of methods, the library's own first, and the colour of the line that is the best of each."""
OWN_KINDS = tuple(KINDS)[:5]
_FAMILIES = {"planned": "rbfmu's plan", "Taylor": "Taylor series", "classic": "RK4, Euler and others"}


def kind_of(method: str, family: str) -> str:
    """Return the kind of a method of a family."""
    if family != "peer":
        return _FAMILIES.get(family, family)
    if method.startswith("SciPy") and method != "SciPy odeint":
        return "SciPy solve_ivp"
    return next(name for name in KINDS if method.startswith(name))


def name_of(kind: str) -> str:
    """Return how a kind of methods is called."""
    return "closed form" if kind == "exact" else kind


@dataclass(frozen=True)
class Row:
    """One method at one setting, or a plan at the accuracy that it was made for.

    detail: what a plan chose; error: as the scene's accuracy counts; seconds: of the processor, for a simulated second;
    run_seconds: for the whole run; spread: the ratio between the least times of two halves of the repeats;
    right_hand_sides: evaluations in a run (0: none, NaN: not counted); compiling: the additional time of the method's
    very first call, s; drifts: of what the motion conserves, relative (NaN: it does not).
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
    compiling: float = 0.0
    energy_drift: float = math.nan
    momentum_drift: float = math.nan
    vertical_momentum_drift: float = math.nan


@dataclass(frozen=True)
class End:
    """The smallest error that a method reached (infinite: none below 1), and why no finer setting was tried."""

    kind: str
    method: str
    error: float
    why: str

    @property
    def stopped(self) -> bool:
        """Return whether the time limit stopped the method."""
        return self.why == STOPPED


@dataclass(frozen=True)
class Chart:
    """Accuracy against cost on a scene; `print` shows a table, `save` writes table, CSV file and picture.

    model: the plan's; accuracy: the one asked; span, outputs: of the charted run, s; ports: those that are at zero;
    rows: all measurements; ends: how far each method came; too_small: models that the plan's is larger than; absent:
    lines on peers that are not charted; refusal: why no tighter plan is made; machine: what it was measured on; whole:
    the length of the scene's run, s (0: `span`); key, many: which of the eight motions, and of its numbers of outputs.
    """

    scene: str
    model: str
    accuracy: float
    span: float
    outputs: int
    ports: tuple[str, ...]
    rows: tuple[Row, ...]
    ends: tuple[End, ...]
    too_small: tuple[TooSmall, ...]
    absent: tuple[str, ...]
    refusal: str
    machine: tuple[str, ...]
    whole: float = 0.0
    key: str = ""
    many: bool = False

    @property
    def plans(self) -> tuple[Row, ...]:
        """Return the plans, first that for the accuracy asked, then for each further digit."""
        return tuple(row for row in self.rows if row.family == "planned" and row.value <= self.accuracy)

    @property
    def plan(self) -> Row:
        """Return the plan for the accuracy asked."""
        return self.plans[0]

    @cached_property
    def table(self) -> str:
        """Return the findings as text of at most 80 columns."""
        from rbfmu.studies.chart.tables import chart_text

        return chart_text(self)

    def figure(self) -> Any:
        """Return the picture as a figure of matplotlib."""
        from rbfmu.studies.chart.drawing import figure_of

        return figure_of(self)

    def save(self, folder: str | Path, name: str = "") -> list[Path]:
        """Write NAME.csv (all measurements), NAME.txt (the table) and NAME.png to a folder; return the files.

        name: the scene's, if none is given.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        stem = re.sub(r"[^\w.-]+", "_", name or self.scene) or "scene"
        csv, text, picture = (folder / f"{stem}{ending}" for ending in (".csv", ".txt", ".png"))
        write_rows(csv, map(asdict, self.rows), [*self.machine, *self.absent])
        text.write_text(self.table + "\n", encoding="utf-8")
        self.figure().savefig(picture)
        return [csv, text, picture]

    def __str__(self) -> str:
        return self.table

    def __repr__(self) -> str:
        from rbfmu.studies.chart.tables import headline

        return "\n".join(
            (f"Chart of {self.scene}: {len(self.rows)} points; print it, or save(folder)", *headline(self))
        )

    def _repr_html_(self) -> str:
        """Return picture and table for a notebook."""
        from base64 import b64encode
        from html import escape
        from io import BytesIO

        buffer = BytesIO()
        self.figure().savefig(buffer, format="png")
        picture = b64encode(buffer.getvalue()).decode()
        return f'<img src="data:image/png;base64,{picture}" width="880"/><pre>{escape(self.table)}</pre>'


def write_rows(path: Path, rows: Iterable[dict[str, Any]], head: Iterable[str]) -> Path:
    """Write a CSV file whose first lines, after #, say where the figures come from."""
    rows = list(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {' '.join(line.split())}\n" for line in head)
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path
