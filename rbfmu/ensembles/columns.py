"""Where the numbers of each quantity stand in a row of a member's outputs, and which quantity a key sets."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene.body import TRIANGLE
from rbfmu.scene.variations import QUANTITY_OF, SHAPE
from rbfmu_kernels.buffer import places
from rbfmu_kernels.quantities import OUTPUT, Parameter, Quantity

Array = NDArray[np.float64]
SIZES = {"sides": 3, "length": 1, "radius": 1, "semiaxes": 3}
"""Sizes of a body's shape, and how many numbers they have."""
KEYS: Mapping[str, Quantity] = {
    **QUANTITY_OF,
    **{f"{SHAPE}.{name}": Parameter(name, size, "m", "size of the body's shape") for name, size in SIZES.items()},
}
"""The quantity that each key sets which may vary, and each size of a shape."""


_ROWS, _COLUMNS = np.transpose(TRIANGLE)


def flat(values: Array) -> Array:
    """Return numbers (m, k) of values (m, ...): of matrices (m, 3, 3) the six of an inertia."""
    chosen = values[:, _ROWS, _COLUMNS] if values.ndim == 3 else values
    return chosen.reshape(len(values), -1)


def symmetric(numbers: Array) -> Array:
    """Return the matrices (m, 3, 3) of the six numbers of inertias (m, 6)."""
    M = np.empty((len(numbers), 3, 3))
    M[:, _ROWS, _COLUMNS] = M[:, _COLUMNS, _ROWS] = numbers
    return M


@dataclass(frozen=True)
class Columns:
    """The columns of the quantities named."""

    names: tuple[str, ...]

    @property
    def slices(self) -> dict[str, slice]:
        """Return the columns of each quantity."""
        return places({name: OUTPUT[name].size for name in self.names})[0]

    @property
    def width(self) -> int:
        """Return the number of columns."""
        return sum(OUTPUT[name].size for name in self.names)

    @property
    def pairs(self) -> NDArray[np.int64]:
        """Return the pairs of columns (P, 2) whose covariance is taken: all of one quantity."""
        found = [(a, b) for s in self.slices.values() for a in range(s.start, s.stop) for b in range(a, s.stop)]
        return np.array(found, dtype=np.int64)

    def split(self, rows: Array) -> dict[str, Array]:
        """Return the quantities of rows (..., K): (...) or (..., k) each."""
        return {name: rows[..., s.start] if _is_number(s) else rows[..., s] for name, s in self.slices.items()}

    def matrices(self, products: Array) -> dict[str, Array]:
        """Return the symmetric matrices of rows (..., P) of pairs: (...) or (..., k, k) each."""
        found = {}
        for name, s in self.slices.items():
            chosen = [p for p, (a, _) in enumerate(self.pairs) if s.start <= a < s.stop]
            size = s.stop - s.start
            matrix = np.empty((*products.shape[:-1], size, size))
            for p in chosen:
                a, b = self.pairs[p] - s.start
                matrix[..., a, b] = matrix[..., b, a] = products[..., p]
            found[name] = matrix[..., 0, 0] if _is_number(s) else matrix
        return found

    def places(self, blocks: dict[str, slice]) -> NDArray[np.int64]:
        """Return where the columns stand in a model's buffer."""
        return np.concatenate([np.arange(blocks[n].start, blocks[n].stop) for n in self.names]).astype(np.int64)


def _is_number(columns: slice) -> bool:
    return bool(columns.stop - columns.start == 1)
