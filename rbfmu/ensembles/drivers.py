"""Which dispersion drives which result: rank correlations of what was applied with how the runs end."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.columns import KEYS, flat
from rbfmu.extras import needed
from rbfmu_kernels.quantities import OUTPUT, indices

if TYPE_CHECKING:
    from rbfmu.ensembles.result import EnsembleResult

Array = NDArray[np.float64]
MOST = 20_000
"""Runs that are ranked; the first ones."""
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


def drivers_of(result: "EnsembleResult") -> Drivers:
    """Return Spearman's rank correlations; numbers that are the same in all runs are left out."""
    rows = result.good[:MOST]
    varied, ends = ({}, {}) if len(rows) < 3 else (_varying(_applied(result, rows)), _varying(_ended(result, rows)))
    if not varied or not ends:
        return Drivers(tuple(varied), tuple(ends), np.empty((len(varied), len(ends))), 1.0)
    rank = needed("scipy.stats", "ensemble").rankdata
    a, b = (_centred(rank(np.column_stack([*columns.values()]), axis=0)) for columns in (varied, ends))
    return Drivers(tuple(varied), tuple(ends), a.T @ b, SURE / float(np.sqrt(len(rows) - 1)))


def differ(values: Array) -> NDArray[np.bool_]:
    """Return which components (k,) of a quantity's numbers (n, k) differ by more than round-off."""
    return np.asarray(np.ptp(values, axis=0) > ALIKE * np.max(np.abs(values)))


def _centred(ranks: Array) -> Array:
    apart = ranks - ranks.mean(axis=0)
    return np.asarray(apart / np.linalg.norm(apart, axis=0))


def _applied(result: "EnsembleResult", rows: Any) -> dict[str, Array]:
    """Return the numbers applied (n,); of an attitude the vector part of its quaternion."""
    found: dict[str, Array] = {}
    for key, values in result.samples.items():
        columns = flat(values[rows])
        names = [f"{key}{index}" for index in indices(KEYS[key])]
        found |= {name: columns[:, k] for k, name in enumerate(names) if not (columns.shape[1] == 4 and k == 0)}
    return found


def _ended(result: "EnsembleResult", rows: Any) -> dict[str, Array]:
    found: dict[str, Array] = {}
    for name in result.ended:
        columns = flat(result.ends(name)[rows])
        apart = differ(columns)
        found |= {f"{name}{index}": columns[:, k] for k, index in enumerate(indices(OUTPUT[name])) if apart[k]}
    return found


def _varying(columns: dict[str, Array]) -> dict[str, Array]:
    return {name: values for name, values in columns.items() if len(values) and np.ptp(values) > 0.0}
