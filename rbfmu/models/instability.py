"""How fast a disturbance of a motion grows."""

import math

import numpy as np
from numpy.typing import NDArray

from rbfmu.models.body_at_start import body_at_start
from rbfmu.scene.scene import Scene
from rbfmu_kernels.compile.interpreted import interpreted
from rbfmu_kernels.rotations.quaternion import rotate

Array = NDArray[np.float64]

GROWTH = 0.1
"""The exponent of a disturbance's growth over the run from which on a spin counts as unstable."""


def growth_rate(scene: Scene) -> float:
    """Return how fast a disturbance of the motion at the start grows, 1/s; 0 where it is stable.

    It is omega sqrt((I_k - I_i) (I_j - I_k) / (I_i I_j)) for a free spin about the middle axis, and
    sqrt(4 I_t m g l - (I_s omega_s)^2) / (2 I_t) for a body spinning at omega_s with its centre of mass above a pivot.
    """
    body, omega, gravity = scene.body, np.array(scene.initial.omega_b), np.array(scene.loads.gravity_a)
    assert body is not None
    moments, R = body_at_start(scene).principal_axes
    arm = np.array(body.r_oc_b)
    if body.pivot and np.any(gravity) and np.any(arm):
        return _growth_above_pivot(scene, moments, R)
    rates = np.abs(R.T @ omega)
    k = int(np.argmax(rates))
    if k != 1 or moments[0] == 0.0:
        return 0.0
    low, middle, high = moments
    return float(rates[k] * math.sqrt((middle - low) * (high - middle) / (low * high)))


def _growth_above_pivot(scene: Scene, moments: Array, R: Array) -> float:
    body = scene.body
    assert body is not None
    arm = np.array(body.r_oc_b)
    length = float(np.linalg.norm(arm))
    up = -np.array(scene.loads.gravity_a)
    if float(np.dot(interpreted(rotate)(scene.initial.quaternion, body.r_oc_b), up)) <= 0.0:
        return 0.0
    own = int(np.argmax(np.abs(R.T @ arm)))
    least = float(np.min(np.delete(moments, own)))
    spin = float(moments[own] * (R.T @ np.array(scene.initial.omega_b))[own])
    weight = body.mass * float(np.linalg.norm(up)) * length
    square = 4.0 * least * weight - spin * spin
    return math.sqrt(square) / (2.0 * least) if square > 0.0 else 0.0
