"""What a law of stability predicts and what was measured, and the numbers behind its picture."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

EQUAL, AT_MOST = "equal", "at most"


@dataclass(frozen=True)
class Finding:
    """One number that theory predicts, and its measured value.

    tolerance: how far they may differ, relative to the prediction; for AT_MOST the prediction is a bound.
    """

    law: int
    what: str
    predicted: float
    measured: float
    tolerance: float
    kind: str = EQUAL

    @property
    def holds(self) -> bool:
        """Whether the measurement agrees with the prediction."""
        if self.kind == AT_MOST:
            return self.measured <= self.predicted
        return math.isclose(self.measured, self.predicted, rel_tol=self.tolerance, abs_tol=0.0)


@dataclass
class Study:
    """Measurements of laws that share a picture: findings, and the picture's curves as columns of equal length."""

    name: str
    findings: list[Finding]
    columns: dict[str, Any] = field(default_factory=dict)


def write_columns(path: Path, columns: Mapping[str, Sequence[Any]]) -> Path:
    """A CSV file, every digit."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def write_findings(path: Path, findings: Sequence[Finding]) -> Path:
    """A CSV file: law, what, kind, predicted, measured, tolerance, holds."""
    names = ("law", "what", "kind", "predicted", "measured", "tolerance", "holds")
    return write_columns(path, {name: [getattr(f, name) for f in findings] for name in names})


def failures(folder: Path) -> list[str]:
    """The findings in a folder that `run_stability` has written which do not hold, in words."""
    with (folder / "laws.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [
        f"law {row['law']}, {row['what']}: predicted {row['predicted']}, measured {row['measured']}"
        for row in rows
        if row["holds"] != "True"
    ]
