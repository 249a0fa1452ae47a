"""The body that is drawn: a scene's shape, or the box with the same mass and inertia."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.mechanics.inertia import principal_axes
from rbfmu_kernels.rotations.matrix import quaternion_from_matrix
from rbfmu_kernels.types import Quaternion, Vec3

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
