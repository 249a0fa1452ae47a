"""Attitude from prescribed body rates as a co-simulation unit: kinematics only, exact for rates held over a step."""

import math
from typing import Any

from ._kernel import kernel
from .euler_angles import ZYX, euler_from_quaternion
from .layout import FINE, NOT_REACHED, places
from .quaternion import compose_quaternions, normalize, rotate
from .rotvec import quaternion_from_rotvec
from .vec3 import scale

INPUTS = {"omega_b": 3}
PARAMETERS = {"quaternion_0": 4}
SETTINGS: dict[str, int] = {}
OUTPUTS = {"quaternion": 4, "rpy": 3, "omega_a": 3}
BLOCKS, SIZE = places(INPUTS | PARAMETERS | SETTINGS | OUTPUTS)  # the quaternion is the state

_OMEGA, _Q_0, _Q, _RPY, _OMEGA_A = (
    BLOCKS[n].start for n in ("omega_b", "quaternion_0", "quaternion", "rpy", "omega_a")
)


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    q = (z[_Q_0], z[_Q_0 + 1], z[_Q_0 + 2], z[_Q_0 + 3])
    total = abs(q[0]) + abs(q[1]) + abs(q[2]) + abs(q[3])
    if not (total > 0.0 and math.isfinite(total)):
        return 7
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = normalize(q)
    return outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Turn by the rotation vector h omega_b; NOT_REACHED (and nothing changed) where the result is not finite."""
    omega = (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2])
    turn = quaternion_from_rotvec(scale(h, omega))
    q = normalize(compose_quaternions((z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3]), turn))
    if not (h > 0.0 and math.isfinite(q[0] + q[1] + q[2] + q[3])):
        return NOT_REACHED
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = q
    return outputs(z)


@kernel(inline=False)
def outputs(z: Any) -> int:
    """Refresh the outputs from the state and the inputs now set."""
    q = (z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3])
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    z[_RPY], z[_RPY + 1], z[_RPY + 2] = roll, pitch, yaw
    z[_OMEGA_A], z[_OMEGA_A + 1], z[_OMEGA_A + 2] = rotate(q, (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2]))
    return FINE
