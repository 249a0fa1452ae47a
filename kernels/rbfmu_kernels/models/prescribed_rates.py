"""Attitude from prescribed body rates as a co-simulation unit: kinematics only.

Rates held over a step turn the attitude exactly. They may change as omega_b + omega_b_rate t + omega_b_rate_2 t^2 / 2,
t from the step's begin, to round-off by Taylor series; after the step they hold their last value.
"""

import math
from typing import Any

from .. import quantities
from ..body.closed_form import TURNING, put_turning_at, turning_at
from ..buffer import FINE, MOST_SUBSTEPS, NOT_REACHED, places
from ..compile.decorator import kernel
from ..exact.uniform_rotation import turned, turning_about
from ..numerics.double_double import Vector, dd_vector, two_sum
from ..rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, normalize, quaternion_rate_b, rotate
from ..rotations.vec3 import add_scaled, is_nonzero, norm, scale
from ..types import Quaternion, Vec3

INPUTS = {row.name: row.size for row in quantities.OUTPUTS if row.port}
PARAMETERS = {"quaternion_0": 4}
OUTPUTS = {row.name: row.size for row in quantities.OUTPUTS if row.kinematic}
OUTPUT_RATES = {f"d_{name}": size for name, size in OUTPUTS.items()}
RATES = {f"{name}_{order}": size for order in ("rate", "rate_2") for name, size in INPUTS.items()}
MEMORY = {"anchor": 4, "held": 3, "elapsed": 2, "turning": TURNING}
"""Attitude when the rates changed, those rates, the time since then, their turning."""
BLOCKS, SIZE = places(INPUTS | PARAMETERS | OUTPUTS | OUTPUT_RATES | RATES | MEMORY)  # the quaternion is the state

LARGEST_TURN = 1e15
"""rad: from here on an angle in double precision says nothing about the attitude."""

_OMEGA, _Q_0, _Q, _RPY, _OMEGA_A = (
    BLOCKS[n].start for n in ("omega_b", "quaternion_0", "quaternion", "rpy", "omega_a")
)
_D_Q, _D_RPY, _D_OMEGA_A = (BLOCKS[n].start for n in ("d_quaternion", "d_rpy", "d_omega_a"))
_RATES = BLOCKS["omega_b_rate"].start
_ANCHOR, _HELD, _ELAPSED, _TURNING = (BLOCKS[n].start for n in MEMORY)
_ZERO: Vector = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
_ORDER = 16
"""Of the series, for turns of at most a radian: the remainder is 2^-17 / 17! = 2e-20."""


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `buffer.FAULTS`."""
    q = (z[_Q_0], z[_Q_0 + 1], z[_Q_0 + 2], z[_Q_0 + 3])
    total = abs(q[0]) + abs(q[1]) + abs(q[2]) + abs(q[3])
    if not (total > 0.0 and math.isfinite(total)):
        return 7
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = z[_ANCHOR], z[_ANCHOR + 1], z[_ANCHOR + 2], z[_ANCHOR + 3] = normalize(q)
    z[_HELD] = z[_HELD + 1] = z[_HELD + 2] = z[_ELAPSED] = z[_ELAPSED + 1] = 0.0
    put_turning_at(z, _TURNING, turning_about(_ZERO))
    return outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Turn by h omega_b; NOT_REACHED (and nothing changed) where the result is not finite or a turn has no digits left.

    While the rates stay as they are the attitude is that of the time since they changed: no error piles up, none grows
    with the angle. Each change of the rates leaves up to 3 eps.
    """
    omega = (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2])
    slope, bend = (z[_RATES], z[_RATES + 1], z[_RATES + 2]), (z[_RATES + 3], z[_RATES + 4], z[_RATES + 5])
    if is_nonzero(slope) or is_nonzero(bend):
        return _changing_step(z, h, omega, slope, bend)
    held = omega[0] == z[_HELD] and omega[1] == z[_HELD + 1] and omega[2] == z[_HELD + 2]
    t, low = two_sum(z[_ELAPSED] if held else 0.0, h)
    low += z[_ELAPSED + 1] if held else 0.0
    i = _ANCHOR if held else _Q
    anchor = (z[i], z[i + 1], z[i + 2], z[i + 3])
    turning = turning_at(z, _TURNING) if held else turning_about(dd_vector(omega))
    q = normalize(compose_quaternions(anchor, turned(turning, (t, low))))
    if not (h > 0.0 and norm(scale(t, omega)) < LARGEST_TURN and math.isfinite(q[0] + q[1] + q[2] + q[3])):
        return NOT_REACHED
    z[_ANCHOR], z[_ANCHOR + 1], z[_ANCHOR + 2], z[_ANCHOR + 3] = anchor
    z[_HELD], z[_HELD + 1], z[_HELD + 2] = omega
    z[_ELAPSED], z[_ELAPSED + 1] = t, low
    put_turning_at(z, _TURNING, turning)
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = q
    return outputs(z)


@kernel(inline=False)
def _changing_step(z: Any, h: float, omega: Vec3, slope: Vec3, bend: Vec3) -> int:
    """The same for rates that change; their last value is then the input."""
    turn = h * (norm(omega) + h * (norm(slope) + h * norm(bend)))
    if not (h > 0.0 and turn < MOST_SUBSTEPS):
        return NOT_REACHED
    n = max(math.ceil(turn), 1)
    part, q = h / n, (z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3])
    for i in range(n):
        t = i * part
        q = normalize(
            compose_quaternions(q, _turn(part, _after(omega, slope, bend, t), add_scaled(slope, t, bend), bend))
        )
    omega = _after(omega, slope, bend, h)
    if not math.isfinite(q[0] + q[1] + q[2] + q[3] + omega[0] + omega[1] + omega[2]):
        return NOT_REACHED
    for i in range(6):
        z[_RATES + i] = 0.0
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = z[_ANCHOR], z[_ANCHOR + 1], z[_ANCHOR + 2], z[_ANCHOR + 3] = q
    z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2] = z[_HELD], z[_HELD + 1], z[_HELD + 2] = omega
    z[_ELAPSED] = z[_ELAPSED + 1] = 0.0
    put_turning_at(z, _TURNING, turning_about(dd_vector(omega)))
    return outputs(z)


@kernel
def _after(omega: Vec3, slope: Vec3, bend: Vec3, t: float) -> Vec3:
    return add_scaled(add_scaled(omega, t, slope), 0.5 * t * t, bend)


@kernel
def _turn(h: float, omega: Vec3, slope: Vec3, bend: Vec3) -> Quaternion:
    """The attitude after h, relative to that before: the series of dD/dt = D o (0, omega) / 2."""
    none = (0.0, 0.0, 0.0, 0.0)
    half, first, second = scale(0.5 * h, omega), scale(0.5 * h * h, slope), scale(0.25 * h * h * h, bend)
    term, before, earlier = (1.0, 0.0, 0.0, 0.0), none, none
    total = term
    for k in range(_ORDER):
        after = compose_quaternions(term, (0.0, half[0], half[1], half[2]))
        after = add_scaled_quaternion(after, 1.0, compose_quaternions(before, (0.0, first[0], first[1], first[2])))
        after = add_scaled_quaternion(after, 1.0, compose_quaternions(earlier, (0.0, second[0], second[1], second[2])))
        earlier, before, term = before, term, add_scaled_quaternion(none, 1.0 / (k + 1.0), after)
        total = add_scaled_quaternion(total, 1.0, term)
    return total


@kernel(inline=False)
def outputs(z: Any) -> int:
    """Refresh the outputs from the state and the inputs now set."""
    q = (z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3])
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    z[_RPY], z[_RPY + 1], z[_RPY + 2] = roll, pitch, yaw
    z[_OMEGA_A], z[_OMEGA_A + 1], z[_OMEGA_A + 2] = rotate(q, (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2]))
    return FINE


@kernel(inline=False)
def output_rates(z: Any) -> int:
    """Set the outputs' time derivatives, blocks `d_<output>`, by the inputs now set; not finite at the pole of rpy."""
    q, omega = (z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3]), (z[_OMEGA], z[_OMEGA + 1], z[_OMEGA + 2])
    d_yaw, d_pitch, d_roll = euler_rate_b(ZYX, euler_from_quaternion(ZYX, q), omega)
    slope = (z[_RATES], z[_RATES + 1], z[_RATES + 2])
    z[_D_Q], z[_D_Q + 1], z[_D_Q + 2], z[_D_Q + 3] = quaternion_rate_b(q, omega)
    z[_D_RPY], z[_D_RPY + 1], z[_D_RPY + 2] = d_roll, d_pitch, d_yaw
    z[_D_OMEGA_A], z[_D_OMEGA_A + 1], z[_D_OMEGA_A + 2] = rotate(q, slope)
    return FINE
