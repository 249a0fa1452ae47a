"""What is shown: attitude, path, angular momentum and rate of a body at the instants of pictures, and ghosts."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rbfmu.arrays import angle_between, quaternion_from_euler, rotate
from rbfmu.result import Result
from rbfmu.types import Array
from rbfmu.viewer.shape import Shape
from rbfmu_kernels.types import Vec3

UP: Vec3 = (0.0, 0.0, 1.0)


class Ghost(NamedTuple):
    """The attitude q_ab (n, 4) and the place of o in a (n, 3), m, of a member."""

    quaternion: Array
    position: Array


@dataclass(frozen=True, repr=False)
class Shown:
    """A motion at the instants of its pictures; up: against gravity, or z."""

    title: str
    result: Result
    shape: Shape
    played: float
    pivot: bool = False
    up: Vec3 = UP
    notes: tuple[str, ...] = ()
    ghosts: tuple[Ghost, ...] = ()

    def __repr__(self) -> str:
        return f"Motion({self.title}: {len(self.result.time)} pictures, played in {self.played:.3g} s)"

    @cached_property
    def quaternion(self) -> Array:
        """Return q_ab (n, 4)."""
        return attitude_of(self.result)

    @cached_property
    def position(self) -> Array:
        """Return the place of o in a (n, 3), m; zero where the result does not say."""
        return self.result.quantities.get("position", np.zeros((len(self.result.time), 3)))

    @property
    def angular_momentum(self) -> Array | None:
        """Return h_a (n, 3), kg m2/s, or None."""
        return self.result.quantities.get("angular_momentum_a")

    @property
    def rate(self) -> Array | None:
        """Return omega_ab_a (n, 3), rad/s, or None."""
        return rate_of(self.result)

    @cached_property
    def largest_turn(self) -> float:
        """Return the largest angle from one picture to the next (rad)."""
        return float(np.max(angle_between(self.quaternion[:-1], self.quaternion[1:])))


def attitude_of(result: Result) -> Array:
    """Return q_ab (n, 4) of a result. Raises ValueError where it has no attitude."""
    if "quaternion" in result.quantities:
        return result.quaternion
    if "rpy" in result.quantities:
        return np.asarray(quaternion_from_euler("xyz", result.rpy))
    raise ValueError(f"quaternion or rpy: expected one of them in the result, which has {', '.join(result.quantities)}")


def rate_of(result: Result) -> Array | None:
    """Return omega_ab_a (n, 3) of a result, rad/s, or None."""
    if "omega_a" in result.quantities:
        return result.omega_a
    if "omega_b" in result.quantities:
        return np.asarray(rotate(attitude_of(result), result.omega_b))
    return None
