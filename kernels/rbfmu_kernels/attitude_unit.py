"""Attitude from prescribed body rates as a co-simulation unit: kinematics only, exact for rates held over a step."""

import math
from typing import Any

from ._kernel import kernel
from .double_double import two_sum
from .euler_angles import ZYX, euler_from_quaternion
from .layout import FINE, NOT_REACHED, places
from .quaternion import compose_quaternions, normalize, rotate
from .rotvec import quaternion_from_rotvec
from .vec3 import norm, scale

INPUTS = {"omega_b": 3}
PARAMETERS = {"quaternion_0": 4}
SETTINGS: dict[str, int] = {}
OUTPUTS = {"quaternion": 4, "rpy": 3, "omega_a": 3}
MEMORY = {"anchor": 4, "held": 3, "elapsed": 2}  # attitude when the rates changed, those rates, the time since then
BLOCKS, SIZE = places(INPUTS | PARAMETERS | SETTINGS | OUTPUTS | MEMORY)  # the quaternion is the state

LARGEST_TURN = 1e15
"""rad: from here on an angle in double precision says nothing about the attitude."""

_OMEGA, _Q_0, _Q, _RPY, _OMEGA_A = (
    BLOCKS[n].start for n in ("omega_b", "quaternion_0", "quaternion", "rpy", "omega_a")
)
_ANCHOR, _HELD, _ELAPSED = (BLOCKS[n].start for n in MEMORY)


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    q = (z[_Q_0], z[_Q_0 + 1], z[_Q_0 + 2], z[_Q_0 + 3])
    total = abs(q[0]) + abs(q[1]) + abs(q[2]) + abs(q[3])
    if not (total > 0.0 and math.isfinite(total)):
        return 7
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = z[_ANCHOR], z[_ANCHOR + 1], z[_ANCHOR + 2], z[_ANCHOR + 3] = normalize(q)
    z[_HELD] = z[_HELD + 1] = z[_HELD + 2] = z[_ELAPSED] = z[_ELAPSED + 1] = 0.0
    return outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Turn by h omega_b; NOT_REACHED (and nothing changed) where the result is not finite or a turn has no digits left.

    While the rates stay as they are the attitude is that of the time since they changed: no error piles up.
    """
    omega = (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2])
    held = omega[0] == z[_HELD] and omega[1] == z[_HELD + 1] and omega[2] == z[_HELD + 2]
    t, low = two_sum(z[_ELAPSED] if held else 0.0, h)
    low += z[_ELAPSED + 1] if held else 0.0
    i = _ANCHOR if held else _Q
    anchor = (z[i], z[i + 1], z[i + 2], z[i + 3])
    turn = scale(t + low, omega)
    q = normalize(compose_quaternions(anchor, quaternion_from_rotvec(turn)))
    if not (h > 0.0 and norm(turn) < LARGEST_TURN and math.isfinite(q[0] + q[1] + q[2] + q[3])):
        return NOT_REACHED
    z[_ANCHOR], z[_ANCHOR + 1], z[_ANCHOR + 2], z[_ANCHOR + 3] = anchor
    z[_HELD], z[_HELD + 1], z[_HELD + 2] = omega
    z[_ELAPSED], z[_ELAPSED + 1] = t, low
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
