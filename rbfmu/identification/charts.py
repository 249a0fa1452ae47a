"""How numbers of a scene vary freely: each key has coordinates p, valid within simple bounds; its start is p = 0.

A mass is its start times exp(p). An inertia M is that of a distribution of mass if the matrix of the sums of m x_i x_j
about c, E = tr(M) / 2 - M, is positive definite (P. M. Wensing, S. Kim & J.-J. E. Slotine, IEEE Robotics and Automation
Letters 3, 2018). So E = L L^T, and the coordinates are the logarithms of L's diagonal and L's other elements. An
attitude is rotated by a rotation vector in b. All other numbers have their size at the start as the unit of p, or a
larger unit if that is zero or far too small.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rbfmu import arrays, sensitivities
from rbfmu.scene.body import TRIANGLE
from rbfmu.scene.scene import Scene
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.quantities import BOUNDED

INERTIA, MASS = "body.inertia", "body.mass"
WHOLE = {
    INERTIA: "so that it stays one that a body can have",
    sensitivities.ATTITUDE: "as turns about two axes add up to one about the third as well",
}
"""Keys whose numbers are not free one by one, and why."""
THINNEST = 1e-9
"""The least eigenvalue of E at the start, over its trace, as that of a plate is zero."""
FARTHEST = 15.0
"""The largest absolute value of a logarithm: a factor of three million, or its inverse."""
OWN = {"constants": "value", "states": "start"}
"""The entry of a row that varies, for tables of a scene's own numbers."""
FAR = 10.0
"""A number gets a larger unit if it is more than FAR times its unit.

It is not critical: a thrust of 3e6 N and an orbit's velocity and position, all begun at 1, were found in 60 and 39
to 42 evaluations with anything from 1.5 to 1e4.
"""
_BOUNDED = {f"loads.{load.name}" for load in BOUNDED}


class Chart:
    """One key's coordinates p: `value(p)` for the scene, and `slopes(p)`, the derivatives of its numbers by p."""

    reach = math.inf

    def __init__(self, scene: Scene, key: str) -> None:
        self.columns = sensitivities.columns_of(scene, key, "free")  # refuses unknown keys
        self.whole = key.partition("[")[0]
        self.start = np.array(value_of(scene, self.whole), dtype=np.float64).ravel()
        self.size = float(np.max(np.abs(self.start), initial=0.0)) or 1.0
        self.chosen = [column.at for column in self.columns]
        self.lowest = 0.0 if self.whole in _BOUNDED else -math.inf
        self.count = len(self.columns)

    def value(self, p: Array, before: Any = None) -> Any:
        """Return the value of the whole key, without an index: a number, a vector or matrix, or an attitude.

        before: the key's value in which other numbers have changed already.
        """
        found = np.array(self.start if before is None else before)
        found[self.chosen] = self.numbers(p)
        return found.tolist() if len(found) > 1 else found.item()

    def numbers(self, p: Array) -> Array:
        """Return the numbers that vary."""
        return np.asarray(self.start[self.chosen] + self.size * p)

    def scale(self, p: Array) -> float:
        """Return the size to which errors of the numbers are relative: their largest, at least their unit."""
        return max(self.size, float(np.max(np.abs(self.numbers(p)))))

    def outgrown(self, p: Array) -> bool:
        """If the numbers are far larger than their unit, make it as large and change p in place; return whether so."""
        size = self.scale(p)
        if type(self) is not Chart or size <= FAR * self.size:  # subclasses have no unit
            return False
        p *= self.size / size
        self.size = size
        return True

    def slopes(self, p: Array) -> Array:
        """Return the derivatives of the numbers by coordinates."""
        return self.size * np.eye(len(p))

    def is_at_edge(self, p: Array, covariance: Array) -> bool:
        """Return whether impossible numbers are within a standard error, where linear error estimates fail."""
        return False

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds of the coordinates."""
        low = np.maximum((self.lowest - self.start[self.chosen]) / self.size, -self.reach)
        return low, np.full(self.count, self.reach)


class _Mass(Chart):
    reach = FARTHEST

    def numbers(self, p: Array) -> Array:
        return np.asarray(self.start * np.exp(p))

    def slopes(self, p: Array) -> Array:
        return np.diag(self.numbers(p))


class _Attitude(Chart):
    def scale(self, p: Array) -> float:
        return 1.0

    def value(self, p: Array, before: Any = None) -> Any:
        q = arrays.compose_quaternions(self.start, arrays.quaternion_from_rotvec(p))
        return {"quaternion": np.asarray(q).tolist()}

    def numbers(self, p: Array) -> Array:
        return p

    def slopes(self, p: Array) -> Array:
        return np.linalg.inv(arrays.rotvec_rate_b(p, np.eye(3)).T)


class _Inertia(Chart):
    reach = FARTHEST

    def __init__(self, scene: Scene, key: str) -> None:
        super().__init__(scene, key)
        M = self.start.reshape(3, 3)
        E = 0.5 * np.trace(M) * np.eye(3) - M
        least = THINNEST * np.trace(E)
        values, axes = np.linalg.eigh(E)
        self._L = np.linalg.cholesky((axes * np.maximum(values, least)) @ axes.T)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return bounds by which E, the square of L, can grow from a plate's to any other, and shrink like a mass."""
        low, high = super().bounds
        low[:3] *= 0.5
        return low, high

    def is_at_edge(self, p: Array, covariance: Array) -> bool:
        """Return whether the least second moment is less than its standard error, if products vary as well."""
        L = self._factor(p)
        values, axes = np.linalg.eigh(L @ L.T)
        slopes = self._chosen_of(0.5 * np.eye(3) - (2.0 - np.eye(3)) * np.outer(axes[:, 0], axes[:, 0]))
        return len(slopes) > 3 and bool(values[0] ** 2 < slopes @ covariance @ slopes)

    def _factor(self, p: Array) -> Array:
        L = self._L.copy()
        for x, (j, i) in zip(p, TRIANGLE, strict=False):
            L[i, j] = L[i, j] * math.exp(x) if i == j else L[i, j] + x * self._L[i, i]
        return L

    def value(self, p: Array, before: Any = None) -> Any:
        return self._matrix(p).tolist()

    def _matrix(self, p: Array) -> Array:
        L = self._factor(p)
        return _inertia_of(L @ L.T)

    def numbers(self, p: Array) -> Array:
        return self._chosen_of(self._matrix(p))

    def slopes(self, p: Array) -> Array:
        L, rows = self._factor(p), []
        for j, i in TRIANGLE[: len(p)]:
            dL = np.zeros((3, 3))
            dL[i, j] = L[i, i] if i == j else self._L[i, i]
            rows.append(self._chosen_of(_inertia_of(dL @ L.T + L @ dL.T)))
        return np.array(rows).T

    def _chosen_of(self, M: Array) -> Array:
        return np.array([M[TRIANGLE[n]] for n in self.chosen])


def _inertia_of(E: Array) -> Array:
    return np.asarray(np.trace(E) * np.eye(3) - E)


def chart_of(scene: Scene, key: str) -> Chart:
    """Return the chart of a key. Raises ValueError for a single number of an inertia or an attitude."""
    for whole, why in WHOLE.items():
        if isinstance(key, str) and key != whole and key.startswith(whole):
            raise ValueError(f"free = {key!r}: expected {whole} as a whole, {why}")
    kinds: dict[str, type[Chart]] = {sensitivities.ATTITUDE: _Attitude, INERTIA: _Inertia, MASS: _Mass}
    return kinds.get(str(key), Chart)(scene, key)


def value_of(scene: Scene, key: str) -> ArrayLike:
    """Return a scene's value of a key without an index; for an attitude the quaternion."""
    table, _, name = key.partition(".")
    section, name = getattr(scene, table), "quaternion" if key == sensitivities.ATTITUDE else name
    return section[name].numbers if table in OWN else getattr(section, name)  # type: ignore[no-any-return]


def changes(charts: Sequence[Chart], p: Array) -> dict[str, Any]:
    """Return the changes for `Scene.replace` at coordinates p."""
    found: dict[str, Any] = {}
    for chart, row in by_chart(charts, p):
        found[chart.whole] = chart.value(row, found.get(chart.whole))
    return found


def by_chart(charts: Sequence[Chart], p: Any) -> Iterator[tuple[Chart, Any]]:
    """Yield each chart with its coordinates, or with its part of another array along these, such as their places."""
    return zip(charts, np.split(p, np.cumsum([chart.count for chart in charts])[:-1]), strict=True)
