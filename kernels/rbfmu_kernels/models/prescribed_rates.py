"""The model of an attitude that follows from prescribed body rates: kinematics only.

For rates that are constant over a step the attitude is exact. For rates that change within it, as
omega_b + omega_b_rate t + omega_b_rate_2 t^2 / 2 with t from the step's beginning, it is accurate to round-off, by
Taylor series; after the step the rates keep their last value.
"""

import math

from .. import quantities
from ..body.shell import Model, bind, step
from ..buffer import MAX_SUBSTEPS, NO_ATTITUDE, OK, STEP_REJECTED, places
from ..buffer_access import pair_at, put_pair_at, put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..exact.uniform_rotation import TURNING_SIZE, Turning, put_turning, rotation_after, turning_about, turning_at
from ..numerics import double_double as dd
from ..rotations.euler_angles import ZYX, euler_from_quaternion, euler_rate_b
from ..rotations.quaternion import add_scaled_quaternion, compose_quaternions, normalize, quaternion_rate_b, rotate
from ..rotations.vec3 import ZERO, add_scaled, is_nonzero, norm, scale
from ..types import Buffer, Quaternion, Vec3

INPUTS = {row.name: row.size for row in quantities.OUTPUTS if row.port}
PARAMETERS = {"quaternion_0": 4}
OUTPUTS = {row.name: row.size for row in quantities.OUTPUTS if row.kinematic}
OUTPUT_RATES = {f"d_{name}": size for name, size in OUTPUTS.items()}
RATES = {f"{name}_{order}": size for order in ("rate", "rate_2") for name, size in INPUTS.items()}
MEMORY = {"anchor": 4, "omega_anchor": 3, "elapsed": 2, "turning": TURNING_SIZE}
"""The attitude when the rates last changed, these rates, the time since then, s, and the turn at these rates."""
_LAYOUT = places(INPUTS | PARAMETERS | OUTPUTS | OUTPUT_RATES | RATES | MEMORY)  # the quaternion is the state

LARGEST_TURN = 1e15
"""The angle, rad, from which on a double has no digit of the attitude left; steps are then refused."""

_AT = _LAYOUT.at
_ORDER = 27
"""The order of the series, for turns of at most a radian: the remainder is at most 2e-17, near rates that begin at zero
and rise as t^2. At steady rates order 16 would do.
"""


@kernel(inline=False)
def initialize(z: Buffer) -> int:
    """Check the parameters, and set state and outputs; return 0 or a key of `buffer.FAULTS`."""
    q = quaternion_at(z, _AT.quaternion_0)
    total = abs(q[0]) + abs(q[1]) + abs(q[2]) + abs(q[3])
    if not (total > 0.0 and math.isfinite(total)):
        return NO_ATTITUDE
    put_quaternion_at(z, _AT.quaternion, normalize(q))
    _put_anchor(z, quaternion_at(z, _AT.quaternion), ZERO, (0.0, 0.0), turning_about(dd.vector(ZERO)))
    return outputs(z)


@kernel
def _advance(z: Buffer, h: float) -> int:
    """Turn by h omega_b; reject the step and change nothing where the result is not finite or an angle has no digits.

    While the rates stay constant, the attitude follows from the time since they changed: no error adds up, and none
    grows with the angle. Each change of the rates adds an error of up to 3 eps.
    """
    omega = vec3_at(z, _AT.omega_b)
    slope, bend = vec3_at(z, _AT.omega_b_rate), vec3_at(z, _AT.omega_b_rate_2)
    if is_nonzero(slope) or is_nonzero(bend):
        return _changing_step(z, h, omega, slope, bend)
    steady = omega == vec3_at(z, _AT.omega_anchor)
    high, rest = pair_at(z, _AT.elapsed) if steady else (0.0, 0.0)
    t, low = dd.two_sum(high, h)
    low += rest
    anchor = quaternion_at(z, _AT.anchor if steady else _AT.quaternion)
    kept = turning_at(z, _AT.turning)
    turning = kept if steady else turning_about(dd.vector(omega))
    q = normalize(compose_quaternions(anchor, rotation_after(turning, (t, low))))
    if not (norm(scale(t, omega)) < LARGEST_TURN and math.isfinite(q[0] + q[1] + q[2] + q[3])):
        return STEP_REJECTED
    _put_anchor(z, anchor, omega, (t, low), turning)
    put_quaternion_at(z, _AT.quaternion, q)
    return outputs(z)


@kernel
def _put_anchor(z: Buffer, anchor: Quaternion, omega: Vec3, elapsed: dd.DoubleDouble, turning: Turning) -> None:
    """Store the attitude when the rates last changed, these rates, the time since then, and the turn at these rates."""
    put_quaternion_at(z, _AT.anchor, anchor)
    put_vec3_at(z, _AT.omega_anchor, omega)
    put_pair_at(z, _AT.elapsed, elapsed)
    put_turning(z, _AT.turning, turning)


@kernel(inline=False)
def _changing_step(z: Buffer, h: float, omega: Vec3, slope: Vec3, bend: Vec3) -> int:
    """Take a step with rates that change within it; afterwards the input is their last value."""
    turn = h * (norm(omega) + h * (norm(slope) + h * norm(bend)))
    if not turn < MAX_SUBSTEPS:
        return STEP_REJECTED
    n = max(math.ceil(turn), 1)
    part, q = h / n, quaternion_at(z, _AT.quaternion)
    for i in range(n):
        t = i * part
        turned = _turn(part, _after(omega, slope, bend, t), add_scaled(slope, t, bend), bend)
        q = normalize(compose_quaternions(q, turned))
    omega = _after(omega, slope, bend, h)
    if not math.isfinite(q[0] + q[1] + q[2] + q[3] + omega[0] + omega[1] + omega[2]):
        return STEP_REJECTED
    put_vec3_at(z, _AT.omega_b_rate, ZERO)
    put_vec3_at(z, _AT.omega_b_rate_2, ZERO)
    put_vec3_at(z, _AT.omega_b, omega)
    put_quaternion_at(z, _AT.quaternion, q)
    _put_anchor(z, q, omega, (0.0, 0.0), turning_about(dd.vector(omega)))
    return outputs(z)


@kernel
def _after(omega: Vec3, slope: Vec3, bend: Vec3, t: float) -> Vec3:
    return add_scaled(add_scaled(omega, t, slope), 0.5 * t * t, bend)


@kernel
def _turn(h: float, omega: Vec3, slope: Vec3, bend: Vec3) -> Quaternion:
    """Return D, the attitude after h relative to that before, by the series of dD/dt = D o (0, omega) / 2."""
    none = (0.0, 0.0, 0.0, 0.0)
    half, first, second = scale(0.5 * h, omega), scale(0.5 * h * h, slope), scale(0.25 * h * h * h, bend)
    term, before, earlier = (1.0, 0.0, 0.0, 0.0), none, none
    total, idle = term, 0
    for k in range(_ORDER):
        after = compose_quaternions(term, (0.0, *half))
        after = add_scaled_quaternion(after, 1.0, compose_quaternions(before, (0.0, *first)))
        after = add_scaled_quaternion(after, 1.0, compose_quaternions(earlier, (0.0, *second)))
        earlier, before, term = before, term, add_scaled_quaternion(none, 1.0 / (k + 1.0), after)
        sum_before, total = total, add_scaled_quaternion(total, 1.0, term)
        idle = idle + 1 if total == sum_before else 0
        if idle == 3:  # each term is at most half of the largest of three before it
            break
    return total


@kernel(inline=False)
def outputs(z: Buffer) -> int:
    """Refresh the outputs from the state and the inputs now set."""
    q = quaternion_at(z, _AT.quaternion)
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    put_vec3_at(z, _AT.rpy, (roll, pitch, yaw))
    put_vec3_at(z, _AT.omega_a, rotate(q, vec3_at(z, _AT.omega_b)))
    return OK


@kernel(inline=False)
def output_rates(z: Buffer) -> int:
    """Set the outputs' time derivatives, blocks `d_<output>`, by the inputs now set; not finite at the pole of rpy."""
    q, omega = quaternion_at(z, _AT.quaternion), vec3_at(z, _AT.omega_b)
    d_yaw, d_pitch, d_roll = euler_rate_b(ZYX, euler_from_quaternion(ZYX, q), omega)
    slope = vec3_at(z, _AT.omega_b_rate)
    put_quaternion_at(z, _AT.d_quaternion, quaternion_rate_b(q, omega))
    put_vec3_at(z, _AT.d_rpy, (d_roll, d_pitch, d_yaw))
    put_vec3_at(z, _AT.d_omega_a, rotate(q, slope))
    return OK


@kernel(inline=False)
def feedthrough(z: Buffer, change: Buffer) -> int:
    """Set how much omega_a changes at once when the rates do; see `body.outputs.feedthrough`."""
    put_vec3_at(change, _AT.omega_a, rotate(quaternion_at(z, _AT.quaternion), vec3_at(change, _AT.omega_b)))
    return OK


PRESCRIBED_RATES = Model(
    "prescribed_rates.PRESCRIBED_RATES", *_LAYOUT, initialize,
    step=bind(step, __name__, "PRESCRIBED_RATES", advance=_advance),
    outputs=outputs, output_rates=output_rates, feedthrough=feedthrough,
)  # fmt: skip
