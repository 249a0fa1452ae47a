"""The rates of a body with two equal moments under a steady torque about the third axis, and damping: a closed form.

About its axis the body speeds up or relaxes; the rate across turns in the body by (I_s - I_t) / I_t times that angle,
and fades. The attitude has no such form. Source: Whittaker, Analytical Dynamics, 4th ed. 1937, 69 (without torque).
"""

from typing import Any

from ..body.closed_form import CLOSED_FORM, finish_step, start_clocks, time_after
from ..body.fixed_axis import drive_and_damping_rate
from ..body.memory import body_of, loads_of, rotation_of
from ..body.needs import has_unknown_load, needs_attitude, skips_model_checks
from ..body.shell import entry_functions, feedthrough, output_rates, outputs
from ..body.symmetry import symmetric_frame
from ..buffer import places
from ..buffer_access import matrix_at, put_matrix_at, put_vec3_at, vec3_at
from ..compile.decorator import kernel
from ..integrators.splitting import is_symmetric_top
from ..mechanics.equations_of_motion import Body, Loads, angular_acceleration
from ..mechanics.newton_euler import damping_torque
from ..numerics.elementary import sincos
from ..numerics.phi_functions import relaxed
from ..rotations.matrix import invert_matrix, transform
from ..rotations.vec3 import cross, dot, is_nonzero
from ..types import Matrix, Quaternion

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

BLOCKS, SIZE = places(
    CLOSED_FORM | {"axes": 9, "rates": 3, "drive": 1, "damping_rate": 1, "damping_rate_across": 1, "ratio": 1}
)

_AXES, _RATES, _DRIVE, _DAMPING_RATE, _DAMPING_RATE_ACROSS, _RATIO = (
    BLOCKS[n].start for n in ("axes", "rates", "drive", "damping_rate", "damping_rate_across", "ratio")
)
_ASTRAY = 19
"""The key in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    (q, omega), body, loads = rotation_of(z), body_of(z), loads_of(z)
    across, own, axes = symmetric_frame(body.inertia)
    if not skips_model_checks(z) and (needs_attitude(z) or has_unknown_load(z) or leads_astray(q, axes, body, loads)):
        return _ASTRAY
    put_matrix_at(z, _AXES, axes)
    put_vec3_at(z, _RATES, transform(axes, omega))
    z[_DRIVE], z[_DAMPING_RATE] = drive_and_damping_rate(z, axes[2], q, body, loads)
    _, z[_DAMPING_RATE_ACROSS] = drive_and_damping_rate(z, axes[0], q, body, loads)
    z[_RATIO] = (own - across) / across
    start_clocks(z)
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h; reject the step and change nothing where the motion is not finite."""
    high, low = time_after(z, h)
    t = high + low
    w_t, w_u, w_s = vec3_at(z, _RATES)
    angle, rate = relaxed(w_s, z[_DRIVE], z[_DAMPING_RATE], t)
    _, left = relaxed(1.0, 0.0, z[_DAMPING_RATE_ACROSS], t)
    s, c = sincos(z[_RATIO] * angle)
    rates = (left * (c * w_t - s * w_u), left * (s * w_t + c * w_u), rate)
    return finish_step(z, h, rotation_of(z).q_ab, transform(invert_matrix(matrix_at(z, _AXES)), rates))


@kernel
def leads_astray(q: Quaternion, axes: Matrix, body: Body, loads: Loads) -> bool:
    """Return whether moments differ, a load depends on the attitude or acts across the axis, or damping is uneven."""
    turning = is_nonzero(loads.torque_a) or (is_nonzero(body.arm_b) and is_nonzero(loads.force_a))
    from_rest = angular_acceleration(q, (0.0, 0.0, 0.0), body, loads)
    (t, u, s), damping_b = axes, body.damping_b
    d_t, d_u, d_s = damping_torque(damping_b, t), damping_torque(damping_b, u), damping_torque(damping_b, s)
    uneven = is_nonzero(cross(t, d_t)) or is_nonzero(cross(u, d_u)) or is_nonzero(cross(s, d_s))
    uneven = uneven or dot(t, d_t) != dot(u, d_u)
    return turning or uneven or is_nonzero(cross(s, from_rest)) or not is_symmetric_top(body.inertia)


initialize, step = entry_functions(__name__, _set_up, _advance)
