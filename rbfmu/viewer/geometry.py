"""Where things are drawn: a motion in lengths of which 1 is half the body's size as drawn."""

from functools import cached_property

import numpy as np

from rbfmu.arrays import rotate
from rbfmu.types import Array
from rbfmu.viewer.motion import Motion

LONGEST = 8.0
"""The reach of a path, in sizes of the body, up to which the body is drawn to the scale of its path."""
AXIS_B, AXIS_A, MOMENTUM, RATE = 1.6, 2.1, 2.6, 2.0
"""Lengths of the axes of b, of a, of the longest angular momentum and of the longest rate."""
LETTER = 0.25
"""How far letters stand out beyond tips."""
STILL = 0.05
"""The way of an axis' tip (rad) that is no trace."""
STROBE = 1.0
"""The angle between pictures (rad) from which on a spin looks wrong."""


class Geometry:
    """A motion as it is drawn."""

    def __init__(self, motion: Motion) -> None:
        self.motion, shape = motion, motion.shape
        self.paths = np.vstack([motion.position, *(ghost.position for ghost in motion.ghosts)])
        """Where o comes to (n, 3), m, also those of the ghosts."""
        self.reach = float(np.linalg.norm(np.ptp(self.paths, axis=0))) / 2.0
        """The half of the box round all paths of o, diagonally (m)."""
        self.body_radius = shape.radius + float(np.linalg.norm(shape.centre))
        """The radius of the body about o (m)."""
        self.enlarged = max(1.0, self.reach / (LONGEST * self.body_radius))
        """How many times too large the body is drawn beside all paths."""
        self.unit = self.body_radius * self.enlarged
        """The metres of a path in one length of the drawing."""
        begin = motion.position[0]
        is_far = np.linalg.norm(begin) > 2.0 * self.reach + 4.0 * self.unit
        self.origin_a = begin if is_far else np.zeros(3)
        """Where the axes of a are drawn (m): at its origin, or at the path's beginning if that is far off."""
        points = np.vstack([self.paths, self.origin_a[None]])
        self.middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        """The middle of what is drawn (m)."""
        self.path, self.ghost_paths = self.place(motion.position), [self.place(g.position) for g in motion.ghosts]
        """o in the drawing (n, 3), and that of each ghost."""
        lever = rotate(motion.quaternion, np.array(shape.centre) / self.body_radius)
        self.base = self.path if motion.pivot else self.path + lever
        """Where arrows begin (n, 3): at the centre of mass, with a pivot at o."""
        self.toward = _toward(np.array(motion.up), self.path[-1] - self.path[0])
        """The direction from the middle to whom looks."""
        right = np.cross(motion.up, self.toward)
        right /= np.linalg.norm(right)
        self.screen = np.stack([right, np.cross(self.toward, right), self.toward])
        """The directions to the right, upwards and to whom looks, as rows."""

    def place(self, points: Array) -> Array:
        """Return points of a (..., 3), m, in the drawing."""
        return np.asarray((points - self.middle) / self.unit)

    @cached_property
    def points(self) -> Array:
        """Return the outermost points of all that is drawn (n, 3): bodies, and tips of axes and arrows."""
        h, omega = self.motion.angular_momentum, self.motion.rate
        arrows = [self.base + self.arrows(v, length) for v, length in ((h, MOMENTUM), (omega, RATE)) if v is not None]
        tips = [self.path + AXIS_B * self._tips(k) for k in range(3)]
        paths = self.place(self.paths)
        bodies = [paths + sign * side for sign in (-1.0, 1.0) for side in self.screen[:2]]
        return np.vstack([self.place(self.origin_a) + AXIS_A * np.eye(3), *tips, *arrows, *bodies])

    def camera(self, field_of_view: float) -> tuple[Array, Array]:
        """Return the point that is looked at, and where from, so that all that is drawn just fits, with its letters."""
        seen = self.points @ self.screen.T
        middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
        aside = np.max(np.abs(seen - middle)[:, :2], axis=1) + LETTER
        distance = float(np.max(aside / np.tan(field_of_view / 2.0) + seen[:, 2] - middle[2]))
        return middle @ self.screen, (middle + np.array([0.0, 0.0, distance])) @ self.screen

    def arrows(self, vectors: Array, length: float) -> Array:
        """Return vectors (n, 3) as arrows, of which the longest of the run has this length."""
        largest = float(np.max(np.linalg.norm(vectors, axis=1)))
        return vectors * (length / largest if largest > 0.0 else 0.0)

    @cached_property
    def traced(self) -> int | None:
        """Return the axis of b whose tip goes the shortest way that is one, or None."""
        ways = [float(np.sum(np.linalg.norm(np.diff(self._tips(k), axis=0), axis=1))) for k in range(3)]
        moved = [k for k in range(3) if ways[k] > STILL]
        return min(moved, key=lambda k: (ways[k], -k)) if moved and self.motion.largest_turn < STROBE else None

    @cached_property
    def trace(self) -> Array:
        """Return the way of the traced axis' tip (n, 3) in the drawing."""
        return self.path + AXIS_B * self._tips(self.traced or 0)

    def _tips(self, axis: int) -> Array:
        return np.asarray(rotate(self.motion.quaternion, np.eye(3)[axis]))


def _toward(up: Array, way: Array) -> Array:
    """Return the direction to look from: across the way of o, a little from above."""
    side = np.eye(3)[int(np.argmin(np.abs(up)))]
    across = np.cross(up, way)
    if np.linalg.norm(across) > 1.0:
        side = -across
    side = side - up * (up @ side)
    side /= np.linalg.norm(side)
    direction = 0.85 * side + 0.35 * np.cross(up, side) + 0.4 * up
    return np.asarray(direction / np.linalg.norm(direction))
