"""How numbers of a scene vary freely: each key by coordinates that any value is possible of, zero at its start.

A mass is its start times exp(p). Of an inertia, the sums of m x_i x_j about c, E = tr(M) / 2 - M, are those of a
distribution of mass if E is positive definite (P. M. Wensing, S. Kim & J.-J. E. Slotine, IEEE Robotics and Automation
Letters 3, 2018): E = L L^T, with the logarithms of L's diagonal as coordinates. An attitude is turned by a rotation
vector in b. What else there is has its size for a unit; a larger one where that is zero or far too small.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.scene.body import TRIANGLE
from rbfmu.scene.scene import Scene
from rbfmu.sensitivities import ATTITUDE, columns_of
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.quantities import BOUNDED

INERTIA, MASS = "body.inertia", "body.mass"
THINNEST = 1e-9
"""The least E over its trace that a coordinate begins with: a plate has none across."""
FARTHEST = 15.0
"""How far a logarithm may go: three million times as much, or as little."""
OWN = {"constants": "value", "states": "start"}
"""By table of numbers of your own, which entry of a row varies."""
FAR = 10.0
"""How many times larger than its unit a number has to be to get a larger one.

It is not critical: a thrust of 3e6 N and an orbit's velocity and position, all begun at 1, were found in 60 and 39
to 42 evaluations with anything from 1.5 to 1e4.
"""
_BOUNDED = {f"loads.{load.name}" for load in BOUNDED}


class Chart:
    """One key's coordinates: `value(p)` for the scene, and `slopes(p)`, of its numbers by coordinates."""

    reach = math.inf

    def __init__(self, scene: Scene, key: str) -> None:
        self.columns = columns_of(scene, key, "free")  # which refuses what is no key
        self.whole = key.partition("[")[0]
        self.start = np.array(value_of(scene, self.whole), dtype=np.float64).ravel()
        self.size = float(np.max(np.abs(self.start), initial=0.0)) or 1.0
        self.chosen = [column.at for column in self.columns]
        self.lowest = 0.0 if self.whole in _BOUNDED else -math.inf
        self.count = len(self.columns)

    def value(self, p: Array, before: Any = None) -> Any:
        """Return what the scene has for the key, without an index: a number, a vector or matrix, or an attitude.

        before: with another of its numbers.
        """
        found = np.array(self.start if before is None else before)
        found[self.chosen] = self.numbers(p)
        return found.tolist() if len(found) > 1 else found.item()

    def numbers(self, p: Array) -> Array:
        """Return the numbers that vary."""
        return np.asarray(self.start[self.chosen] + self.size * p)

    def scale(self, p: Array) -> float:
        """Return what errors of the numbers are relative to: how large they are, at least their unit."""
        return max(self.size, float(np.max(np.abs(self.numbers(p)))))

    def outgrown(self, p: Array) -> bool:
        """Give coordinates, in place, the unit of what they come to, if that is far larger; return whether it is."""
        size = self.scale(p)
        if type(self) is not Chart or size <= FAR * self.size:  # coordinates of others have no unit
            return False
        p *= self.size / size
        self.size = size
        return True

    def slopes(self, p: Array) -> Array:
        """Return the derivatives of the numbers by coordinates."""
        return self.size * np.eye(len(p))

    def is_at_edge(self, p: Array, covariance: Array) -> bool:
        """Return whether the numbers are less than a standard error from some that cannot be, so that errors turn."""
        return False

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Return the least and the largest that each coordinate may be."""
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
        """Return bounds that let E, a square, grow from a plate's to any other, and shrink as far as a mass may."""
        low, high = super().bounds
        low[:3] *= 0.5
        return low, high

    def is_at_edge(self, p: Array, covariance: Array) -> bool:
        """Return whether E, whose axes its products turn, is less than an error from one that is not positive."""
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
    """Return the coordinates of a key. Raises ValueError for one of an inertia's numbers alone."""
    if isinstance(key, str) and key != INERTIA and key.startswith(INERTIA):
        raise ValueError(f"free = {key!r}: expected {INERTIA} as a whole, so that it stays one that a body can have")
    kinds: dict[str, type[Chart]] = {ATTITUDE: _Attitude, INERTIA: _Inertia, MASS: _Mass}
    return kinds.get(str(key), Chart)(scene, key)


def value_of(scene: Scene, key: str) -> ArrayLike:
    """Return what a scene has for a key without an index, of an attitude the quaternion."""
    table, _, name = key.partition(".")
    section, name = getattr(scene, table), "quaternion" if key == ATTITUDE else name
    return section[name].numbers if table in OWN else getattr(section, name)  # type: ignore[no-any-return]


def changes(charts: Sequence[Chart], p: Array) -> dict[str, Any]:
    """Return what `Scene.replace` takes for coordinates."""
    found: dict[str, Any] = {}
    for chart, row in by_chart(charts, p):
        found[chart.whole] = chart.value(row, found.get(chart.whole))
    return found


def by_chart(charts: Sequence[Chart], p: Any) -> Iterator[tuple[Chart, Any]]:
    """Return each chart with its coordinates, or what else there is of each, such as their places."""
    return zip(charts, np.split(p, np.cumsum([chart.count for chart in charts])[:-1]), strict=True)
