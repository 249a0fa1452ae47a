"""Euler parameters (unit quaternions), scalar first: q_ab = (eta, eps) of R_ab."""

import math

from ._kernel import kernel
from .shapes import Quaternion, Vec3


@kernel
def compose_quaternions(q_ab: Quaternion, q_bc: Quaternion) -> Quaternion:
    """q_ac of R_ac = R_ab R_bc.

    q_ab, q_bc: Euler parameters, scalar first.  Error <= 2 eps |q_ab| |q_bc|.  E&G (6.190).
    """
    a0, a1, a2, a3 = q_ab
    b0, b1, b2, b3 = q_bc
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@kernel
def rotate(q_ab: Quaternion, v_b: Vec3) -> Vec3:
    e, x, y, z = q_ab
    a, b, c = v_b
    u = 2.0 * (y * c - z * b)
    v = 2.0 * (z * a - x * c)
    w = 2.0 * (x * b - y * a)
    return (a + e * u + (y * w - z * v), b + e * v + (z * u - x * w), c + e * w + (x * v - y * u))
