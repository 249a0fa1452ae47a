"""How errors grow: what exact motions lose by the round-off of the body's moments, and how fast a disturbance grows."""

import math

import numpy as np

from rbfmu.models.question import Question
from rbfmu.types import Array
from rbfmu_kernels.body.principal import exact_frame, rates_along
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.exact.free_rotation_setup import polhode_axes
from rbfmu_kernels.numerics.double_double import DoubleDouble, Vector
from rbfmu_kernels.rotations.quaternion import rotate
from rbfmu_kernels.types import Vec3

GROWTH = 0.1
"""The exponent of a disturbance's growth over the run from which on a spin counts as unstable."""
TWICE = 2.0**-100
"""The relative error that double-double leaves, with room for what a flip makes of it."""


# What exact motions lose by the round-off of the moments


def lost_near_separatrix(asked: Question) -> float:
    """Return the error, rad, that double-double makes by the distance from the separatrix, added over all flips.

    It is 0 for a diagonal matrix.
    """
    if not _is_full(asked):
        return 0.0
    from rbfmu_kernels.exact.free_rotation import free_rotation_of  # large, and few scenes need it

    moments, axes = interpreted(exact_frame)(asked.start.z)
    rates = interpreted(rates_along)(axes, asked.scene.initial.omega_b)
    motion = interpreted(free_rotation_of)(moments, (1.0, 0.0, 0.0, 0.0), rates)
    half_turns = 2.0 * float(abs(motion.unit * motion.phase_rate[0])) * asked.span
    return half_turns * _lost_distance(moments, rates, asked.scene.initial.omega_b)


def lost_by_symmetry(asked: Question) -> float:
    """Return the error, rad, of taking a body as symmetric whose two moments differ; 0 for a diagonal matrix.

    It is that difference over the least moment, times the angle, times 1 plus the angle before the rate across the axis
    has turned within the body: until then that rate turns the body about its axis, the faster the thinner it is.
    """
    M, omega, span = asked.body.M, asked.scene.initial.omega_b, asked.span
    if not _is_full(asked) and len({M[0][0], M[1][1], M[2][2]}) < 3:
        return 0.0
    moments, axes = interpreted(exact_frame)(asked.start.z)
    low, middle, high = sorted(range(3), key=lambda k: moments[k])
    below, above = _difference(moments[middle], moments[low]), _difference(moments[high], moments[middle])
    gap, s = (below, high) if below <= above else (above, low)
    if gap == 0.0 or moments[low][0] <= 0.0:
        return gap * math.inf if gap else 0.0
    rate = interpreted(rates_along)(axes, omega)[s][0]
    own = abs(rate * _difference(moments[s], moments[middle])) / moments[middle][0]
    speed = _speed(omega)
    return gap / moments[low][0] * speed * span * (1.0 + speed * min(span, 1.0 / own if own else math.inf))


def _speed(omega: Vec3) -> float:
    return math.sqrt(sum(w * w for w in omega))


def _lost_distance(moments: Vector, rates: Vector, omega: Vec3) -> float:
    """Return the relative error of L^2 - 2 T I_r, I_r the middle moment, which is 0 on the separatrix."""
    *axes, distance, unit = interpreted(polhode_axes)(moments, rates)
    p, r, s = map(int, axes)
    levers = sum(abs(rates[k][0]) * moments[k][0] * abs(_difference(moments[k], moments[r])) for k in (p, s))
    exact = float(distance[0] * unit * unit)
    return TWICE * _speed(omega) * levers / exact if exact > 0.0 else 0.0


def _difference(a: DoubleDouble, b: DoubleDouble) -> float:
    return (a[0] - b[0]) + (a[1] - b[1])


def _is_full(asked: Question) -> bool:
    M = asked.body.M
    return asked.body.pivot or any(M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))


# How fast a disturbance grows


def growth_rate(asked: Question) -> float:
    """Return how fast a disturbance of the motion at the start grows, 1/s; 0 where it is stable.

    It is omega sqrt((I_k - I_i) (I_j - I_k) / (I_i I_j)) for a free spin about the middle axis, and
    sqrt(4 I_t m g l - (I_s omega_s)^2) / (2 I_t) for a body spinning at omega_s with its centre of mass above a pivot.
    """
    moments, R = asked.start.principal_axes
    arm, rates = R.T @ np.array(asked.body.r_oc_b), R.T @ np.array(asked.scene.initial.omega_b)
    if asked.body.pivot and any(asked.scene.loads.gravity_a) and any(asked.body.r_oc_b):
        return _growth_above_pivot(asked, moments, int(np.argmax(np.abs(arm))), rates)
    if int(np.argmax(np.abs(rates))) != 1 or moments[0] == 0.0:
        return 0.0
    low, middle, high = moments
    return float(abs(rates[1]) * math.sqrt((middle - low) * (high - middle) / (low * high)))


def _growth_above_pivot(asked: Question, moments: Array, own: int, rates: Array) -> float:
    """Return the same above a pivot; own: the principal axis that the centre of mass is nearest to."""
    body, up = asked.body, -np.array(asked.scene.loads.gravity_a)
    if float(np.dot(interpreted(rotate)(asked.scene.initial.quaternion, body.r_oc_b), up)) <= 0.0:
        return 0.0
    least = float(np.min(np.delete(moments, own)))
    spin = float(moments[own] * rates[own])
    weight = body.mass * float(np.linalg.norm(up)) * float(np.linalg.norm(np.array(body.r_oc_b)))
    square = 4.0 * least * weight - spin * spin
    return math.sqrt(square) / (2.0 * least) if square > 0.0 else 0.0
