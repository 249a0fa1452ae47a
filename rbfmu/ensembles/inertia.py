"""Which of many inertia matrices no rigid body has."""

import numpy as np
from numpy.typing import NDArray

from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE, check_inertia

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
NEAR = 1e3 * INERTIA_TOLERANCE
"""The part of the trace within which a border is left to the kernels' own judgement."""


def impossible(M: Array) -> Rows:
    """Return the rows of matrices (n, 3, 3) that no body has, as the kernels' check judges."""
    moments, finite = _moments(M)
    border = NEAR * np.abs(moments).sum(axis=1)
    low, middle, high = moments.T
    doubtful = np.flatnonzero(~((low > border) & (low + middle - high > border) & finite))
    found = [row for row in doubtful if _is_refused(M[row].tolist())]
    return np.array(found, dtype=np.int64)


def _is_refused(rows: list[list[float]]) -> bool:
    a, b, c = ((x, y, z) for x, y, z in rows)
    return bool(evaluated(check_inertia, (a, b, c)))


def thin(M: Array) -> Rows:
    """Return the rows with a moment that may count as zero."""
    moments, finite = _moments(M)
    return np.flatnonzero(~finite | (moments[:, 0] <= NEAR * np.abs(moments).sum(axis=1)))


def _moments(M: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the principal moments, ascending, and where they are finite."""
    finite = np.all(np.isfinite(M), axis=(1, 2))
    return np.linalg.eigvalsh(np.where(finite[:, None, None], M, np.eye(3))), finite
