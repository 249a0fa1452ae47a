"""Substeps of `taylor` for several bodies at once, each in its lane with its own step, to the bit as if it were alone.

What a lane's body has is in columns, see `COLUMNS`, and its series are in a work space of `WORK` wide numbers. Loads
hold, and no force turns with the body. A lane whose body cannot go on is left to `taylor_advance`.
"""

import math

from ..buffer import MAX_SUBSTEPS, places
from ..buffer_access import matrix_at, vec3_at
from ..compile.decorator import kernel
from ..compile.wide import alike, all_of, any_of, choose
from ..mechanics.equations_of_motion import Body
from ..rotations.quaternion import compose_quaternions, invert_quaternion, rotate
from ..types import Buffer, Vec3
from . import rigid_body_state as state
from . import taylor
from .rigid_body_state import RATE_ONLY, STATE_BLOCKS
from .substeps import Method, nearer_size, parts_in, tolerance_of_substep
from .taylor_coefficients import FORCE, RATE, TORQUE, SpaceFixedLoads, Torques, motion_series, put_factors

COLUMNS = STATE_BLOCKS | {
    "inertia": 9, "inverse": 9, "arm": 3, "damping": 3, "force_a": 3, "torque_a": 3, "torque_b": 3,
    "size": 1, "count": 1, "rest": 1, "low": 1, "tried": 1, "is_new": 1, "has_failed": 1, "member": 1,
}  # fmt: skip
"""State and constants of a lane's body, force_a 0 where it has no arm; the step size and the substeps taken; what is
left of the communication step, as a sum; the tries in it; whether it has just begun, and whether it cannot go on; the
body's number, -1 for none."""
_, COLUMNS_SIZE = _LAYOUT = places(COLUMNS)
STATE = 0
(
    INERTIA, INVERSE, ARM, DAMPING, FORCE_A, TORQUE_A, TORQUE_B, SIZE, COUNT, REST, LOW, TRIED, IS_NEW, HAS_FAILED,
    MEMBER,
) = _LAYOUT.starts(*list(COLUMNS)[len(state.STATE_BLOCKS) :])  # fmt: skip
_TRIES = 64
"""Shorter and shorter steps that are tried at once."""


@kernel
def _bodies(c: Buffer) -> Body:
    return Body(
        inverse_mass=0.0, inertia=matrix_at(c, INERTIA), inertia_inverse=matrix_at(c, INVERSE), arm_b=vec3_at(c, ARM),
        damping_b=vec3_at(c, DAMPING), is_free=0.0,
    )  # fmt: skip


@kernel
def _torques(c: Buffer) -> Torques:
    """Return coefficients of the torque that is known in b, of which only the first is not zero."""
    zero = alike(c[REST], 0.0)
    return vec3_at(c, TORQUE_B), (zero, zero, zero), (zero, zero, zero)


@kernel
def _choose_vector(condition: bool, a: Vec3, b: Vec3) -> Vec3:
    return (choose(condition, a[0], b[0]), choose(condition, a[1], b[1]), choose(condition, a[2], b[2]))


@kernel
def _turn_loads_anew(c: Buffer, s: Buffer, anew: bool) -> None:
    """Set row 0 of the loads that are fixed in a, as b sees them, in the lanes that begin anew."""
    q_ba = invert_quaternion(state.attitude(c, STATE))
    put_factors(s, FORCE, _choose_vector(anew, rotate(q_ba, vec3_at(c, FORCE_A)), vec3_at(s, FORCE)))
    put_factors(s, TORQUE, _choose_vector(anew, rotate(q_ba, vec3_at(c, TORQUE_A)), vec3_at(s, TORQUE)))


@kernel(inline=False)
def begin_substeps(c: Buffer, s: Buffer, method: Method, fixed: SpaceFixedLoads) -> None:
    """Make the series of all lanes.

    Where a lane begins, those of the others are made again, to the same bits.
    """
    (n, order, _, _), body, torques = method, _bodies(c), _torques(c)
    m = taylor.derivatives_of_attitude(order)
    turned = fixed.lever_force or fixed.torque
    is_new, eighth = c[IS_NEW] > 0.0, c[TRIED] / taylor.STEPS_OF_LOADS
    first = 0 if n == RATE_ONLY else m
    if any_of(is_new):
        put_factors(s, RATE, state.omega(c, STATE))
        if turned:
            _turn_loads_anew(c, s, is_new)
        motion_series(s, 0, first, m, body, torques, fixed)
        c[IS_NEW] = 0.0
    anew = eighth == math.ceil(eighth)
    if turned and any_of(anew):
        _turn_loads_anew(c, s, anew)
        first = 0
    motion_series(s, first, order, 0, body, torques, fixed)


@kernel(inline=False)
def take_substeps(c: Buffer, s: Buffer, method: Method, fixed: SpaceFixedLoads) -> None:
    """Take a substep in each lane, whose size meets the tolerance there."""
    body, rest, low, order = _bodies(c), c[REST], c[LOW], method.order
    acceleration = alike(rest, 0.0)
    if fixed.lever_force or fixed.torque:
        acceleration = taylor.space_fixed_acceleration(s, body, fixed)
    part, count, excess = _try_substeps(c, s, method, acceleration)
    for _ in range(_TRIES):
        fits = excess <= 1.0
        if all_of(fits):
            break
        c[SIZE] = choose(fits, c[SIZE], nearer_size(part, order, 2.0 * excess))
        c[TRIED] = choose(fits, c[TRIED], c[TRIED] + 1.0)
        part, count, excess = _try_substeps(c, s, method, acceleration)
    c[TRIED], c[COUNT] = c[TRIED] + 1.0, c[COUNT] + 1.0
    goes_on = (excess <= 1.0) & (rest < MAX_SUBSTEPS * c[SIZE]) & (c[TRIED] < MAX_SUBSTEPS)
    c[HAS_FAILED] = choose(goes_on, 0.0, 1.0)
    nearer, is_last = nearer_size(part, order, 1.4 * excess), count == 1.0
    c[SIZE] = choose(is_last, max(c[SIZE], nearer), nearer)
    left = choose(is_last, 0.0, rest - part)
    c[LOW], c[REST] = low + ((rest - left) - part), left
    _move(c, s, method.n, order, part, body, fixed)


@kernel
def _try_substeps(c: Buffer, s: Buffer, method: Method, acceleration: float) -> tuple[float, float, float]:
    """Return the substeps to be taken, how many are left, and the estimated errors over those which are allowed."""
    count: float = parts_in(c[REST], c[SIZE])
    part = (c[REST] + c[LOW]) / count
    alpha_fixed = choose(count > 1.0, acceleration, 0.0)
    steps = choose(count < taylor.STEPS_OF_LOADS, count, float(taylor.STEPS_OF_LOADS))
    error = taylor.estimated_error(s, method, part, 0.0, alpha_fixed, steps)
    return part, count, error / tolerance_of_substep(method.tolerance, method.span, part)


@kernel
def _move(c: Buffer, s: Buffer, n: int, order: int, part: float, body: Body, fixed: SpaceFixedLoads) -> None:
    q, half, m = state.attitude(c, STATE), (1.0, 0.0, 0.0, 0.0), taylor.derivatives_of_attitude(order)
    if n != RATE_ONLY:
        half = taylor.half_turn(s, m, part)
    taylor.put_sums(s, order, part, fixed)
    state.put_omega(c, STATE, vec3_at(s, RATE))
    if n != RATE_ONLY:
        motion_series(s, 0, m, m, body, _torques(c), fixed)
        q = compose_quaternions(compose_quaternions(q, half), invert_quaternion(taylor.half_turn(s, m, -part)))
        state.put_unit_attitude(c, STATE, q)
