"""Distributions of single numbers, and the names of the numbers of a key."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from rbfmu.scene.body import TRIANGLE, six_numbers
from rbfmu.scene.fields import flattened
from rbfmu_kernels.quantities import BY_NAME, indices

FIXED, NORMAL, UNIFORM, LOGNORMAL, TRIANGULAR, RELATIVE = (
    "fixed", "normal", "uniform", "lognormal", "triangular", "relative",
)  # fmt: skip
EXPECTED: Mapping[str, str] = {
    NORMAL: "[mean, standard deviation]",
    UNIFORM: "[low, high]",
    LOGNORMAL: "[median, standard deviation of the logarithm]",
    TRIANGULAR: "[low, most likely, high]",
    RELATIVE: "the standard deviation over the scene's value",
}


class Marginal(NamedTuple):
    """The distribution of one number; arguments as in `EXPECTED`; points: in a grid."""

    name: str
    kind: str
    arguments: tuple[float, ...]
    points: int = 0

    @property
    def varies(self) -> bool:
        """Return whether the number varies."""
        if self.kind in (UNIFORM, TRIANGULAR):
            return self.arguments[0] < self.arguments[-1]
        return self.kind != FIXED and self.arguments[-1] > 0.0

    @property
    def constant(self) -> float:
        """Return the value where nothing varies: what is relative is then 1."""
        return 1.0 if self.kind == RELATIVE else self.arguments[0]


def component_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of a key's numbers: of a matrix the six of one triangle."""
    if len(shape) == 2:
        return [f"{name}{index}" for index in indices(BY_NAME["inertia"])]
    return [f"{name}[{k}]" for k in range(1, shape[0] + 1)] if shape else [name]


def components(value: Any, shape: tuple[int, ...]) -> list[float]:
    """Return a key's numbers one after another. Raises ValueError where a matrix is not symmetric."""
    if len(shape) < 2:
        return list(flattened(value))
    largest = max(map(abs, flattened(value)))
    if any(not math.isclose(value[i][j], value[j][i], abs_tol=1e-12 * largest) for i, j in TRIANGLE):
        raise ValueError("a symmetric matrix")
    return six_numbers(value)
