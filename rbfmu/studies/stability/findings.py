"""What a law of stability predicts and what was measured, and the numbers behind its picture."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

EQUAL, AT_MOST, RECORDED = "equal", "at most", "recorded"
"""The kinds of findings: the value equals a prediction, is at most a bound, or equals a value recorded earlier."""


@dataclass(frozen=True)
class Finding:
    """One number that theory predicts, and its measured value.

    tolerance: the largest difference allowed, relative to the prediction; for AT_MOST the prediction is a bound.
    place: the place in a map, or the motion; findings with the same `what` are reported together.
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
        if self.kind == AT_MOST:
            return self.measured <= self.predicted
        return math.isclose(self.measured, self.predicted, rel_tol=self.tolerance, abs_tol=0.0)


def exponent(larger: float, smaller: float, ratio: float = 2.0) -> float:
    """Return the power of a ratio by which two numbers differ; NaN, which no law predicts, where there is none."""
    quotient = larger / smaller if smaller else math.nan
    return math.log(quotient) / math.log(ratio) if 0.0 < quotient < math.inf else math.nan


@dataclass
class Study:
    """Measurements of laws that share a picture: findings, and the picture's curves as columns of equal length."""

    name: str
    findings: list[Finding]
    columns: dict[str, Any] = field(default_factory=dict)


_NUMBERS = {"law": int, "predicted": float, "measured": float, "tolerance": float}
_NAMES = ("law", "what", "place", "kind", "predicted", "measured", "tolerance", "holds")


def write_columns(path: Path, columns: Mapping[str, Sequence[Any]]) -> Path:
    """Write a CSV file with all digits."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def write_findings(path: Path, findings: Sequence[Finding]) -> Path:
    """Write a CSV file with the columns law, what, place, kind, predicted, measured, tolerance, holds."""
    return write_columns(path, {name: [getattr(f, name) for f in findings] for name in _NAMES})


def read_findings(folder: Path) -> list[Finding]:
    """Return the findings in a folder that `run_stability` has written."""
    with (folder / "laws.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [Finding(**{name: _NUMBERS.get(name, str)(row[name]) for name in _NAMES[:-1]}) for row in rows]


def failures(folder: Path) -> list[str]:
    """Return a line for each finding that does not hold, from a folder that `run_stability` has written."""
    return [in_words(f) for f in read_findings(folder) if not f.holds]


def in_words(finding: Finding) -> str:
    """Return a line that describes a finding."""
    place = f" ({finding.place})" if finding.place else ""
    return f"law {finding.law}, {finding.what}{place}: predicted {finding.predicted!r}, measured {finding.measured!r}"
