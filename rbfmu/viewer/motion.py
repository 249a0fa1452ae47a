"""What is shown: a body's shape, and its motion at the instants of pictures, with ghosts beside it.

The shape is a scene's, or the box with the same mass and inertia.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rbfmu.arrays import angle_between, quaternion_from_euler, rotate
from rbfmu.result import Result
from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics.inertia import principal_axes
from rbfmu_kernels.rotations.matrix import quaternion_from_matrix
from rbfmu_kernels.types import Quaternion, Vec3

# The shape


THINNEST = 0.1
"""The least side of what is drawn, of the largest: so that rods and sheets are seen."""
ORIGIN: Vec3 = (0.0, 0.0, 0.0)
UNTURNED: Quaternion = (1.0, 0.0, 0.0, 0.0)


class Shape(NamedTuple):
    """What is drawn of a body: sides along its own axes p (m), its centre in b (m), and q_bp.

    kind: box, cylinder (about z) or ellipsoid.
    """

    kind: str
    sides: Vec3
    text: str
    centre: Vec3 = ORIGIN
    q_bp: Quaternion = UNTURNED

    @property
    def radius(self) -> float:
        """Return half the longest way through it (m)."""
        return float(np.linalg.norm(self.sides)) / 2.0


PLAIN = Shape("box", (3.0, 2.0, 1.0), "the inertia is not known: any body")

DRAWN: Mapping[str, tuple[str, Callable[[Any], Any]]] = {
    "box": ("box", lambda shape: shape["sides"]),
    "beam": ("box", lambda shape: (shape["length"], 0.0, 0.0)),
    "cylinder": ("cylinder", lambda shape: (2.0 * shape["radius"], 2.0 * shape["radius"], shape["length"])),
    "sphere": ("ellipsoid", lambda shape: (2.0 * shape["radius"],) * 3),
    "ellipsoid": ("ellipsoid", lambda shape: [2.0 * semiaxis for semiaxis in shape["semiaxes"]]),
}
"""By the kind of a scene's table `body.shape`: what is drawn, and its sides."""


def shape_of(scene: Scene | None, written: dict[str, Any] | None = None) -> Shape:
    """Return the shape to draw for a scene; written: the table `body.shape` of its file, where it has one."""
    if scene is None or scene.body is None:
        return PLAIN
    centre = scene.body.r_oc_b
    if written:
        kind, sides_of = DRAWN[written["kind"]]
        x, y, z = map(float, sides_of(written))
        sides = (x, y, z)
        return Shape(kind, _visible_sides(sides), f"{written['kind']}, {_metres(sides)}", centre)
    moments, axes = evaluated(principal_axes, scene.body.inertia)
    sides = equivalent_box(scene.body.mass, moments)
    q_bp = evaluated(quaternion_from_matrix, axes)
    return Shape("box", _visible_sides(sides), f"box with the body's mass and inertia, {_metres(sides)}", centre, q_bp)


def equivalent_box(mass: float, moments: Vec3 | Array) -> Vec3:
    """Return the sides (m) of the homogeneous box with these principal moments (kg m2), along their axes."""
    squares = 6.0 * (np.sum(moments) - 2.0 * np.asarray(moments)) / mass
    x, y, z = np.sqrt(np.maximum(squares, 0.0)).tolist()
    return x, y, z


def _visible_sides(sides: Vec3) -> Vec3:
    x, y, z = (max(side, THINNEST * max(sides)) for side in sides)
    return x, y, z


def _metres(sides: Vec3) -> str:
    return " × ".join(f"{side:.3g}" for side in sides) + " m"


# The motion


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
    played: float = 0.0
    pivot: bool = False
    up: Vec3 = UP
    notes: tuple[str, ...] = ()
    ghosts: tuple[Ghost, ...] = ()

    def __repr__(self) -> str:
        return f"Motion({self.title}: {len(self.result.time)} pictures, played in {self.played:.3g} s)"

    @cached_property
    def quaternion(self) -> Array:
        """Return q_ab (n, 4). Raises ValueError where the result has no attitude."""
        known = self.result.quantities
        if "quaternion" in known:
            return known["quaternion"]
        if "rpy" in known:
            return np.asarray(quaternion_from_euler("xyz", known["rpy"]))
        raise ValueError(f"quaternion or rpy: expected one of them in the result, which has {', '.join(known)}")

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
        known = self.result.quantities
        if "omega_a" in known or "omega_b" not in known:
            return known.get("omega_a")
        return np.asarray(rotate(self.quaternion, known["omega_b"]))

    @property
    def largest_rate(self) -> float:
        """Return the largest rate, rad/s; 0 where it is not known."""
        return 0.0 if self.rate is None else float(np.max(np.linalg.norm(self.rate, axis=1)))

    @cached_property
    def largest_turn(self) -> float:
        """Return the largest angle from one picture to the next (rad)."""
        return float(np.max(angle_between(self.quaternion[:-1], self.quaternion[1:])))
