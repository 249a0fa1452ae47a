"""Numbers with derivatives, which kernels that run as plain Python take as they take others."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rbfmu.types import Array


class Dual:
    """A number, and its derivatives with respect to some variables; what is added and multiplied has them as well."""

    __slots__ = ("gradient", "value")

    def __init__(self, value: float, gradient: Array) -> None:
        self.value, self.gradient = value, gradient

    def __add__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.gradient + other.gradient)
        return Dual(self.value + other, self.gradient)

    __radd__ = __add__

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.gradient)

    def __sub__(self, other: Any) -> "Dual":
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> "Dual":
        return self.__neg__().__add__(other)

    def __mul__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.value * other.gradient + other.value * self.gradient)
        return Dual(self.value * other, other * self.gradient)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Dual":
        if isinstance(other, Dual):
            return self * other.__rtruediv__(1.0)
        return Dual(self.value / other, self.gradient / other)

    def __rtruediv__(self, other: float) -> "Dual":
        quotient = other / self.value
        return Dual(quotient, self.gradient * (-quotient / self.value))

    def __gt__(self, other: Any) -> bool:
        return self.value > (other.value if isinstance(other, Dual) else other)

    def __lt__(self, other: Any) -> bool:
        return self.value < (other.value if isinstance(other, Dual) else other)

    def __eq__(self, other: object) -> bool:
        """Return whether it is that number and stays so: what a kernel leaves out as zero must not begin to change."""
        return self.value == other and not self.gradient.any()

    __hash__ = None  # type: ignore[assignment]


def variables(values: Sequence[float], first: int, count: int) -> list[Any]:
    """Return numbers that are variables themselves, from number `first` of `count` on."""
    return [Dual(float(x), np.eye(1, count, first + k)[0]) for k, x in enumerate(values)]


def jacobian(numbers: Sequence[Any], count: int) -> Array:
    """Return the derivatives of numbers, a row each; those of a plain number are zero."""
    return np.array([x.gradient if isinstance(x, Dual) else np.zeros(count) for x in numbers]).reshape(-1, count)
