"""Series of a free body's motion about a state that is exact, for outputs that are many times denser than it turns.

Each begins at a state of the closed form, so that no error adds up, and reaches as far as its terms are below
round-off.
"""

from ..compile.decorator import kernel
from ..mechanics.equations_of_motion import ROTATION, Body, Rotation
from ..rotations.vec3 import norm
from ..types import Buffer, Quaternion, Vec3
from . import dense_output as dense
from .substeps import LONGEST_STEP, Method
from .taylor_coefficients import FORCE, FORCE_RATE, MAX_ORDER, RATE, SpaceFixedLoads, motion_series, put_factors

FREE_SERIES = dense.SERIES_BLOCKS | {"next_reach": 1}
FREE_WORK = FORCE_RATE
"""The size of the work space: series of rate and attitude, and the latter's products where loads would stand."""
LEAST_REACH = 16.0
"""Communication steps that a series has to reach over at least: below, the closed form costs less."""
_NEXT = dense.SERIES_SIZE
_ROUND_OFF = 2.0**-50
"""The size of the last two terms: those that are left out are some 2^-54."""
_FARTHEST = 8.0
"""A turn, rad, over which no series reaches: its order's last term, (turn / 2)^24 / 24!, is then 4e-10."""
_NO_TORQUES = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@kernel
def start_without_series(z: Buffer, i: int, ever: bool, omega: Vec3) -> None:
    """Set what is kept, from z[i] on; ever: whether there may ever be a series; omega: the rate at the start."""
    z[i], z[i + _NEXT] = dense.NONE, min(LONGEST_STEP, _FARTHEST / max(norm(omega), 1e-300)) if ever else 0.0


@kernel
def series_pays(z: Buffer, i: int, h: float) -> bool:
    """Return whether a series would reach over many steps of h."""
    return bool(LEAST_REACH * h <= z[i + _NEXT])


@kernel(inline=False)
def begin_free_series(z: Buffer, w: int, i: int, h: float, q: Quaternion, omega: Vec3, body: Body) -> None:
    """Make the series in z[w:] from attitude and rate on, and keep it if it reaches over many steps of h."""
    s, method = z[w : w + FREE_WORK], Method(ROTATION, MAX_ORDER, _ROUND_OFF, 0.0)
    put_factors(s, RATE, omega)
    motion_series(s, 0, MAX_ORDER, 0, _undamped(body), _NO_TORQUES, SpaceFixedLoads(False, False, False))
    dense.end_series(s, RATE, MAX_ORDER)
    reach = dense.likely_reach(s, MAX_ORDER, z[i + _NEXT])
    reach, _ = dense.reach_within(s, method, 0, 1.0, reach, 1.0)
    m = dense.attitude_series(s, FORCE, q, MAX_ORDER, reach, 0.5 * _ROUND_OFF)
    reach, z[i + _NEXT] = dense.reach_within(s, method, m, 1.0, reach, 1.0)
    dense.begin_clock(z, i, ROTATION, m, reach)
    if not LEAST_REACH * h <= reach:
        z[i] = dense.NONE


@kernel
def _undamped(body: Body) -> Body:
    """Return the body as the closed form has it, which a plan may have taken although a little damping acts.

    With the damping the rate would drift over each series and jump back at its end.
    """
    return Body(
        inverse_mass=body.inverse_mass, inertia=body.inertia, inertia_inverse=body.inertia_inverse, arm_b=body.arm_b,
        damping_b=(0.0, 0.0, 0.0), is_free=body.is_free,
    )  # fmt: skip


@kernel
def motion_after(z: Buffer, w: int, i: int, h: float) -> Rotation:
    """Return the motion a step h further along the series in z[w:]."""
    t, _ = dense.clock_after(z, i, h)
    return Rotation(dense.attitude_at(z, w, dense.turn_order_of(z, i), t), dense.rate_at(z, w, MAX_ORDER, t))
