"""Models whose attitude stays or is left out: a body that does not turn, an angular momentum, rates that spin up.

`NO_ROTATION` computes the position of a body that does not turn, or whose rotation no output needs. `ANGULAR_MOMENTUM`
computes the angular momentum of a body whose only torque is fixed in space, h = h_0 + T t; a sphere's rate in a follows
from h. The model's attitude stays the first one, and its omega_ab_b is the rate that gives h at that attitude.
`SPIN_UP` computes the rates of a body with two equal moments under a steady torque about the third axis, and damping:
the rate about this axis grows or relaxes; the rate across it turns in the body by (I_s - I_t) / I_t times the angle
turned about the axis, and decays. The attitude has no such closed form.
Source: Whittaker, Analytical Dynamics, 4th ed. 1937, 69 (without torque).
"""

from ..body import closed_form, memory, outputs, principal, shell
from ..buffer import MORE_THAN_MOMENTUM, NO_SPIN_UP, OK, STEP_REJECTED, TURNS, places
from ..buffer_access import matrix_at, put_matrix_at, put_pair_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..integrators.splitting import is_symmetric_top
from ..mechanics.equations_of_motion import angular_acceleration
from ..mechanics.newton_euler import damping_torque
from ..numerics.elementary import relaxed, sincos
from ..rotations.matrix import invert_matrix, transform
from ..rotations.vec3 import ZERO, add_scaled, cross, dot, is_nonzero
from ..types import Buffer, Matrix

_NO_ROTATION_LAYOUT = places(closed_form.CLOSED_FORM)


@kernel
def _set_up_no_rotation(z: Buffer) -> int:
    if memory.needs_rate(z) and not memory.skips_model_checks(z) and begins_to_turn(z):
        return TURNS
    return closed_form.start_clocks(z)


@kernel
def _advance_no_rotation(z: Buffer, h: float) -> int:
    """Advance by h at constant inputs; reject the step and change nothing where the result is not finite."""
    if not memory.needs_translation(z):
        return outputs.outputs(z) if memory.shows_loads(z) else OK
    q, omega = memory.rotation_of(z)
    return closed_form.finish_step(z, h, q, omega)


@kernel
def begins_to_turn(z: Buffer) -> bool:
    """Return whether an output that depends on the rotation would change."""
    (q, omega), body, loads = memory.rotation_of(z), memory.body_of(z), memory.loads_of(z)
    changes = is_nonzero(angular_acceleration(q, omega, body, loads))
    return changes or (is_nonzero(omega) and (memory.needs_attitude(z) or closed_form.has_torque(z)))


NO_ROTATION = shell.make_model("NO_ROTATION", _NO_ROTATION_LAYOUT, _set_up_no_rotation, _advance_no_rotation)


_MOMENTUM_LAYOUT = places(closed_form.CLOSED_FORM | {"omega_0": 3, "alpha": 3, "since_alpha": 2})
"""After CLOSED_FORM: the rate when the torque last changed, the angular acceleration since, and the time since, s."""
_MOMENTUM = _MOMENTUM_LAYOUT.at


@kernel
def _set_up_angular_momentum(z: Buffer) -> int:
    sphere = principal.is_sphere(memory.body_of(z).inertia)
    more = closed_form.has_turning_torque(z) or memory.shows_more_than_momentum(z, sphere)
    if more and not memory.skips_model_checks(z):
        return MORE_THAN_MOMENTUM
    put_pair_at(z, _MOMENTUM.since_alpha, (0.0, 0.0))
    put_vec3_at(z, _MOMENTUM.omega_0, memory.rotation_of(z).omega_b)
    put_vec3_at(z, _MOMENTUM.alpha, ZERO)
    return closed_form.start_clocks(z)


@kernel
def _advance_angular_momentum(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite or a torque is not fixed in a."""
    if not memory.skips_model_checks(z) and closed_form.has_turning_torque(z):
        return STEP_REJECTED
    since, low, omega, q = 0.0, 0.0, vec3_at(z, _MOMENTUM.omega_0), closed_form.first_attitude(z)
    alpha = angular_acceleration(q, ZERO, memory.body_of(z), memory.loads_of(z))
    if alpha == vec3_at(z, _MOMENTUM.alpha):
        since, low = closed_form.later(z, _MOMENTUM.since_alpha, h)
    else:
        since, omega = h, memory.rotation_of(z).omega_b
    status = closed_form.finish_step(z, h, q, add_scaled(omega, since + low, alpha))
    if status == OK:
        put_pair_at(z, _MOMENTUM.since_alpha, (since, low))
        put_vec3_at(z, _MOMENTUM.omega_0, omega)
        put_vec3_at(z, _MOMENTUM.alpha, alpha)
    return status


ANGULAR_MOMENTUM = shell.make_model(
    "ANGULAR_MOMENTUM", _MOMENTUM_LAYOUT, _set_up_angular_momentum, _advance_angular_momentum
)


_SPIN_UP_LAYOUT = places(
    closed_form.CLOSED_FORM
    | {"axes": 9, "rates": 3, "drive": 1, "damping_rate": 1, "damping_rate_across": 1, "ratio": 1}
)
_AT = _SPIN_UP_LAYOUT.at


@kernel
def _set_up_spin_up(z: Buffer) -> int:
    across, own, axes = principal.symmetric_frame(memory.body_of(z).inertia)
    no_moment = own == 0.0  # a beam's about its own axis: accelerations are divided by it
    astray = no_moment or memory.needs_attitude(z) or memory.has_unknown_load(z) or leads_astray(z, axes)
    if astray and not memory.skips_model_checks(z):
        return NO_SPIN_UP
    put_matrix_at(z, _AT.axes, axes)
    put_vec3_at(z, _AT.rates, transform(axes, memory.rotation_of(z).omega_b))
    z[_AT.drive], z[_AT.damping_rate] = principal.drive_and_damping_rate(z, axes[2])
    _, z[_AT.damping_rate_across] = principal.drive_and_damping_rate(z, axes[0])
    z[_AT.ratio] = (own - across) / across
    return closed_form.start_clocks(z)


@kernel
def _advance_spin_up(z: Buffer, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    high, low = closed_form.time_after(z, h)
    t = high + low
    w_t, w_u, w_s = vec3_at(z, _AT.rates)
    angle, rate = relaxed(w_s, z[_AT.drive], z[_AT.damping_rate], t)
    _, left = relaxed(1.0, 0.0, z[_AT.damping_rate_across], t)
    s, c = sincos(z[_AT.ratio] * angle)
    rates = (left * (c * w_t - s * w_u), left * (s * w_t + c * w_u), rate)
    omega = transform(invert_matrix(matrix_at(z, _AT.axes)), rates)
    return closed_form.finish_step(z, h, memory.rotation_of(z).q_ab, omega)


@kernel
def leads_astray(z: Buffer, axes: Matrix) -> bool:
    """Return whether moments differ, a load depends on the attitude or acts across the axis, or damping is uneven."""
    body, loads = memory.body_of(z), memory.loads_of(z)
    turning = is_nonzero(loads.torque_a) or (is_nonzero(body.arm_b) and is_nonzero(loads.force_a))
    from_rest = angular_acceleration(memory.rotation_of(z).q_ab, ZERO, body, loads)
    (t, u, s), damping_b = axes, body.damping_b
    d_t, d_u, d_s = damping_torque(damping_b, t), damping_torque(damping_b, u), damping_torque(damping_b, s)
    uneven = is_nonzero(cross(t, d_t)) or is_nonzero(cross(u, d_u)) or is_nonzero(cross(s, d_s))
    uneven = uneven or dot(t, d_t) != dot(u, d_u)
    return turning or uneven or is_nonzero(cross(s, from_rest)) or not is_symmetric_top(body.inertia)


SPIN_UP = shell.make_model("SPIN_UP", _SPIN_UP_LAYOUT, _set_up_spin_up, _advance_spin_up)
