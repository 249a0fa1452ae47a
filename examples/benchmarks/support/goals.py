"""A benchmark's verdict: its figures against the goals that it states; and the words that a command takes."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Goal:
    """A figure, and the range that it should be in."""

    name: str
    figure: float
    least: float = -math.inf
    most: float = math.inf

    @property
    def kept(self) -> bool:
        """NaN is not."""
        return self.least <= self.figure <= self.most

    def __str__(self) -> str:
        bounds = [f"at least {self.least:g}"] if self.least > -math.inf else []
        bounds += [f"at most {self.most:g}"] if self.most < math.inf else []
        return f"{self.name}: {self.figure:.3g}, goal {' and '.join(bounds)}"


def status(goals: Sequence[Goal]) -> int:
    """Print which goals are missed; the status to exit with: 0 where none is, else 1."""
    missed = [goal for goal in goals if not goal.kept]
    for goal in missed:
        print(f"MISSED {goal}")
    print(f"{len(goals) - len(missed)} of {len(goals)} goals kept")
    return int(bool(missed))


def known(words: Sequence[str], names: Collection[str]) -> Sequence[str]:
    """Return the words of a command. Raises SystemExit where one of them is none of these names."""
    if wrong := [word for word in words if word not in names]:
        raise SystemExit(f"{', '.join(wrong)}: expected of {', '.join(names)}")
    return words
