"""The table `ensemble.correlation`: how the numbers that vary depend on each other."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar

from pydantic import Field

from rbfmu.scene.fields import Numbers, Rule, fault
from rbfmu.scene.section import Section

Rows = tuple[tuple[float, ...], ...]
ROUND_OFF, NEGLIGIBLE = 1e-10, 1e-5
"""Of a correlation matrix: how far below 0 an eigenvalue's share may lie, and what a component without one may add."""


class _ComponentNames(Rule):
    def expected(self) -> str:
        return 'a list of at least two distinct numbers that vary, such as ["body.mass", "loads.torque_b[2]"]'

    def __call__(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
            self.refuse()
        return tuple(value) if 2 <= len(value) == len(set(value)) else self.refuse()


class _Square(Rule):
    def expected(self) -> str:
        return "a symmetric matrix: a list of rows of finite numbers"

    def __call__(self, value: Any) -> Rows:
        value = value.tolist() if hasattr(value, "tolist") else value
        if not isinstance(value, list | tuple) or not value:
            self.refuse()
        rows: Rows = tuple(Numbers((len(value),), "")(row) for row in value)
        sizes = [abs(x) for row in rows for x in row]
        for i, j in _below(len(rows)):
            if not math.isclose(rows[i][j], rows[j][i], abs_tol=1e-12 * max(sizes)):
                raise ValueError(f"a symmetric matrix; rows {i + 1} and {j + 1} differ")
        return rows


class Correlation(Section):
    """Which numbers depend on each other, by the correlation or the covariance of them."""

    _path: ClassVar[str] = "ensemble.correlation"

    components: Annotated[tuple[str, ...], _ComponentNames(), Field(description="numbers that depend on each other")]
    matrix: Annotated[
        Rows | None, _Square(), Field(description="their correlations, or of what is not normal those of its scores")
    ] = None
    covariance: Annotated[Rows | None, _Square(), Field(description="in place of matrix: of normal numbers")] = None

    def _contradictions(self) -> Iterator[str]:
        given = [name for name in ("matrix", "covariance") if getattr(self, name) is not None]
        if len(given) != 1:
            yield fault(self._path, list(given), "either matrix (of correlations) or covariance")
            return
        rows, path, n = getattr(self, given[0]), f"{self._path}.{given[0]}", len(self.components)
        if len(rows) != n:
            yield fault(path, rows, f"{n} rows of {n} numbers, as components has")
        elif any(rows[i][i] <= 0.0 for i in range(n)):
            yield fault(path, rows, "numbers > 0 on the diagonal")
        elif self.matrix is not None and any(rows[i][i] != 1.0 for i in range(n)):
            yield fault(path, rows, "1 on the diagonal; or the key covariance")
        elif lower_factor(self.correlations) is None:
            yield fault(path, rows, "a positive semidefinite matrix; these correlations contradict each other")

    @property
    def correlations(self) -> Rows:
        """Return the matrix of correlations."""
        if self.matrix is not None:
            return self.matrix
        assert self.covariance is not None
        spread = [math.sqrt(row[i]) for i, row in enumerate(self.covariance)]
        return tuple(
            tuple(1.0 if i == j else x / spread[i] / spread[j] for j, x in enumerate(row))
            for i, row in enumerate(self.covariance)
        )


def _below(n: int) -> Iterator[tuple[int, int]]:
    return ((i, j) for i in range(n) for j in range(i))


def lower_factor(matrix: Sequence[Sequence[float]]) -> list[list[float]] | None:
    """Return the lower triangular L with L L^T the matrix of correlations; None where it is not semidefinite.

    Cholesky's factor, with a column of zeros where a component follows from those before it. It is computed in Python's
    floats, so that its bits are the same on every machine.
    """
    n = len(matrix)
    L = [[0.0] * n for _ in range(n)]
    for j in range(n):
        square = matrix[j][j] - math.fsum(x * x for x in L[j][:j])
        if square < -ROUND_OFF:
            return None
        dependent = square <= ROUND_OFF
        L[j][j] = 0.0 if dependent else math.sqrt(square)
        for i in range(j + 1, n):
            rest = matrix[i][j] - math.fsum(x * y for x, y in zip(L[i][:j], L[j][:j], strict=True))
            if dependent and abs(rest) > NEGLIGIBLE:
                return None
            L[i][j] = 0.0 if dependent else rest / L[j][j]
    return L
