"""What drives the ends of an ensemble's runs: rank correlations of what varies with how they end."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.variables import flat
from rbfmu.extras import needed
from rbfmu.types import Array
from rbfmu_kernels.quantities import Quantity, indices

MOST_RANKED, LEAST = 20_000, 3
"""The most runs that are ranked, the first ones, and the fewest."""
SURE = 3.0
"""Standard deviations of a correlation of independent numbers, above which one is not chance."""
ALIKE = 1e-12
"""The part of a quantity's largest number by which round-off alone makes runs differ."""


class Drivers(NamedTuple):
    """Rank correlations (p, q) of p numbers that vary with q numbers at the end; chance: what chance alone may make."""

    varied: tuple[str, ...]
    ends: tuple[str, ...]
    correlations: Array
    chance: float

    def __repr__(self) -> str:
        """Return what drives each number at the end most."""
        lines = [
            f"Drivers({len(self.varied)} numbers that vary, {len(self.ends)} at the end; the largest correlations:"
        ]
        for end, column in zip(self.ends, self.correlations.T, strict=True):
            if len(column) and abs(column[k := int(np.argmax(np.abs(column)))]) > self.chance:
                lines.append(f"{end}: {column[k]:.2f} with {self.varied[k]}")
        return "\n  ".join(lines) + ")"


def drivers_of(applied: Mapping[str, Array], ended: Mapping[str, Array]) -> Drivers:
    """Return Spearman's rank correlations of columns (n,); numbers that are the same in all runs are left out."""
    varied, ends = _varying(applied), _varying(ended)
    if not varied or not ends:
        return Drivers(tuple(varied), tuple(ends), np.empty((len(varied), len(ends))), 1.0)
    rank = needed("scipy.stats", "ensemble").rankdata
    a, b = (_centred(rank(np.column_stack([*columns.values()]), axis=0)) for columns in (varied, ends))
    return Drivers(tuple(varied), tuple(ends), a.T @ b, SURE / float(np.sqrt(len(a) - 1)))


def columns(name: str, row: Quantity, values: Array) -> dict[str, Array]:
    """Return the numbers (n,) of a quantity (n, ...) by their names."""
    return {f"{name}{index}": column for index, column in zip(indices(row), flat(values).T, strict=True)}


def _varying(columns: Mapping[str, Array]) -> dict[str, Array]:
    return {name: values for name, values in columns.items() if np.ptp(values) > 0.0}


def differ(values: Array) -> NDArray[np.bool_]:
    """Return which components (k,) of a quantity's numbers (n, k) differ by more than round-off."""
    return np.asarray(np.ptp(values, axis=0) > ALIKE * np.max(np.abs(values)))


def _centred(ranks: Array) -> Array:
    apart = ranks - ranks.mean(axis=0)
    return np.asarray(apart / np.linalg.norm(apart, axis=0))
