"""Torque-free motion of many bodies at several times, in the lanes of a vector: the bits are those of `free_rotation`.

Bodies share a vector whose motions are of one kind, away from the separatrix or near it, by a margin that leaves no
doubt; all others, as rare as steady and symmetric ones, are taken alone.
"""

from typing import Any

from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..compile.wide_arrays import eight_wide, four_wide, lane_at, put_lane_at, width_of
from ..numerics.double_double import dd_vector
from ..numerics.jacobi_theta import NEAREST_KC
from ..types import Quaternion, Vec3
from .free_rotation import (
    free_attitude_at,
    free_rate_at,
    free_rotation_at,
    free_rotation_is_singular,
    free_rotation_setup,
    place_at,
    scaled_for_setup,
    scaled_time,
)
from .free_rotation_series import NEAR, TUMBLING
from .free_rotation_setup import tumbling_setup

_MOMENTS, _Q, _OMEGA, _TIME, _BODY, _RESULT = 0, 3, 7, 10, 11, 12
_ROWS = 20
SCRATCH = 2 * 8 * _ROWS
"""The numbers of work space, at a cache line: of a vector of bodies of each kind."""
_ALONE = -1.0
_MARGIN = 1e-3
_LEAST_KC_SQUARED = 1e-6
_LEAST, _LARGEST = 1e-60, 1e60


@kernel(inline=False)
def free_rotations_in_four(moments: Any, q_0: Any, omega_b_0: Any, t: Any, scratch: Any, q: Any, omega: Any) -> bool:
    """Set q (m, n, 4) and omega (m, n, 3) to the motions of m bodies at n times, four bodies at a time.

    moments (m, 3), q_0 (m, 4), omega_b_0 (m, 3): see `free_rotation`. t (m, n), or (1, n) of all bodies. Returns
    whether any of the moments are singular.
    """
    return _motions(moments, q_0, omega_b_0, t, q, omega, four_wide(scratch, 0), four_wide(scratch, 4 * _ROWS))


@kernel(inline=False)
def free_rotations_in_eight(moments: Any, q_0: Any, omega_b_0: Any, t: Any, scratch: Any, q: Any, omega: Any) -> bool:
    """Do the same, eight at a time."""
    return _motions(moments, q_0, omega_b_0, t, q, omega, eight_wide(scratch, 0), eight_wide(scratch, 8 * _ROWS))


@kernel
def _motions(
    moments: Any, q_0: Any, omega_b_0: Any, t: Any, q: Any, omega: Any, tumbling: Any, near: Any
) -> bool:  # fmt: skip
    width, tumblers, nearers, singular = width_of(tumbling), 0, 0, False
    for i in range(len(moments)):
        kind = _kind_of(vec3_at(moments[i], 0), vec3_at(omega_b_0[i], 0))
        if kind == TUMBLING:
            _load(tumbling, tumblers, i, moments[i], q_0[i], omega_b_0[i])
            tumblers += 1
        elif kind == NEAR:
            _load(near, nearers, i, moments[i], q_0[i], omega_b_0[i])
            nearers += 1
        else:
            singular |= free_rotation_is_singular(vec3_at(moments[i], 0))
            _alone(moments[i], q_0[i], omega_b_0[i], t[i % len(t)], q[i], omega[i])
        if tumblers == width:
            _together(tumbling, tumblers, moments, q_0, omega_b_0, t, q, omega)
            tumblers = 0
        if nearers == width:
            _together(near, nearers, moments, q_0, omega_b_0, t, q, omega)
            nearers = 0
    if tumblers > 0:
        _together(tumbling, tumblers, moments, q_0, omega_b_0, t, q, omega)
    if nearers > 0:
        _together(near, nearers, moments, q_0, omega_b_0, t, q, omega)
    return singular


@kernel
def _kind_of(moments: Vec3, omega: Vec3) -> float:
    """Return the kind of a motion where plain doubles leave no doubt about it, or that it is to be taken alone.

    A screen: d as of `polhode.polhode_axes`, kappa of `polhode.kappa_of`, kc^2 of `free_rotation_setup.tumbling_setup`.
    """
    (a, b, c), (x, y, z) = moments, omega
    for moment in moments:
        if not _LEAST < moment < _LARGEST:
            return _ALONE
    for rate in omega:
        if not _LEAST < abs(rate) < _LARGEST:
            return _ALONE
    if a > b:
        a, b, x, y = b, a, y, x
    if b > c:
        b, c, y, z = c, b, z, y
    if a > b:
        a, b, x, y = b, a, y, x
    if a == b or b == c:
        return _ALONE
    d = z * z * c * (c - b) - x * x * a * (b - a)
    if d < 0.0:
        a, c, x, z, d = c, a, z, x, -d
    kappa = c * (b - a) / (a * (c - b))
    kc_squared = d * c / (abs(c - b) * (c * c * z * z + b * b * y * y * kappa / (1.0 + kappa)))
    if kc_squared > NEAREST_KC * NEAREST_KC + _MARGIN:
        return TUMBLING
    return NEAR if _LEAST_KC_SQUARED < kc_squared < NEAREST_KC * NEAREST_KC - _MARGIN else _ALONE


@kernel
def _load(c: Any, lane: int, body: int, moments: Any, q_0: Any, omega: Any) -> None:
    for k in range(3):
        put_lane_at(c, _MOMENTS + k, lane, moments[k])
        put_lane_at(c, _OMEGA + k, lane, omega[k])
    for k in range(4):
        put_lane_at(c, _Q + k, lane, q_0[k])
    put_lane_at(c, _BODY, lane, float(body))


@kernel(inline=False)
def _alone(moments: Any, q_0: Any, omega_b_0: Any, t: Any, q: Any, omega: Any) -> None:
    setup = free_rotation_setup(vec3_at(moments, 0), quaternion_at(q_0, 0), vec3_at(omega_b_0, 0))
    for k in range(len(t)):
        attitude, rate = free_rotation_at(setup, t[k])
        put_quaternion_at(q[k], 0, attitude)
        put_vec3_at(omega[k], 0, rate)


@kernel(inline=False)
def _together(c: Any, count: int, moments: Any, q_0: Any, omega_b_0: Any, t: Any, q: Any, omega: Any) -> None:
    for lane in range(count, width_of(c)):
        first = int(lane_at(c, _BODY, 0))
        _load(c, lane, first, moments[first], q_0[first], omega_b_0[first])
    _set_up_and_run(c, count, t, q, omega)


@kernel
def _set_up_and_run(c: Any, count: int, t: Any, q: Any, omega: Any) -> None:
    attitude: Quaternion = quaternion_at(c, _Q)
    start, rates = dd_vector(vec3_at(c, _MOMENTS)), dd_vector(vec3_at(c, _OMEGA))
    scaled, attitude, rates, unit = scaled_for_setup(start, attitude, rates)
    motion = tumbling_setup(scaled, attitude, rates, unit)
    for k in range(t.shape[1]):
        for lane in range(width_of(c)):
            put_lane_at(c, _TIME, lane, t[int(lane_at(c, _BODY, lane)) % len(t), k])
        time = scaled_time(motion, (c[_TIME], 0.0))
        place = place_at(motion, time)
        put_quaternion_at(c, _RESULT, free_attitude_at(motion, time, place))
        put_vec3_at(c, _RESULT + 4, free_rate_at(motion, place))
        for lane in range(count):
            body = int(lane_at(c, _BODY, lane))
            for j in range(4):
                q[body, k, j] = lane_at(c, _RESULT + j, lane)
            for j in range(3):
                omega[body, k, j] = lane_at(c, _RESULT + 4 + j, lane)
