"""Rotation vectors u = k theta: axis times angle."""

import math

from ._kernel import kernel
from .elementary import sincos
from .shapes import Quaternion, Vec3


@kernel
def quaternion_from_rotvec(u: Vec3) -> Quaternion:
    """Q of the rotation about u by the angle |u|, rad."""
    angle = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    s, c = sincos(0.5 * angle)
    k = s / angle if angle > 0.0 else 0.5
    return (c, k * u[0], k * u[1], k * u[2])
