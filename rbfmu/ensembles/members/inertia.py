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
    """Return the rows of symmetric matrices (n, 3, 3) that no body has, as the kernels' check judges."""
    found = [row for row in _doubtful(M) if _is_refused(M[row].tolist())]
    return np.array(found, dtype=np.int64)


def thin(M: Array) -> Rows:
    """Return the rows with a moment that may count as zero, or with a number that is not finite."""
    rows: Rows = _doubtful(M)
    finite = np.all(np.isfinite(M[rows]), axis=(1, 2))
    moments = np.linalg.eigvalsh(np.where(finite[:, None, None], M[rows], np.eye(3)))
    found: Rows = rows[~finite | (moments[:, 0] <= NEAR * np.abs(moments).sum(axis=1))]
    return found


def _is_refused(rows: list[list[float]]) -> bool:
    a, b, c = ((x, y, z) for x, y, z in rows)
    return bool(evaluated(check_inertia, (a, b, c)))


def _doubtful(M: Array) -> Rows:
    """Return the rows that are not plainly possible: E = t/2 - M is positive definite where M is, t the trace.

    E's eigenvalues are half of what two moments have over the third. Each is at least det E / t^2, so a moment and a
    triangle far from their borders are found without any eigenvalue.
    """
    with np.errstate(all="ignore"):
        t = np.trace(M, axis1=1, axis2=2)
        x, y, z = (0.5 * t - M[:, k, k] for k in range(3))
        xy, xz, yz = M[:, 0, 1], M[:, 0, 2], M[:, 1, 2]
        minor = x * y - xy * xy
        determinant = x * (y * z - yz * yz) - xy * (xy * z + yz * xz) - xz * (xy * yz + y * xz)
        plain = (x > 0.0) & (minor > 0.0) & (determinant > NEAR * t * t * t) & np.isfinite(determinant)
    return np.flatnonzero(~plain)
