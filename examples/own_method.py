"""A method of one's own, on the chart and under the laws: `rbfmu stability --method examples/own_method.py`.

Heun's method, as one writes it first: nothing keeps the quaternion at length 1. `body` and `loads` are what the
library's own methods get, and `rbfmu_kernels.mechanics.equations_of_motion` says what is in them.
"""

from rbfmu_kernels import quaternion_rate_b
from rbfmu_kernels.mechanics.equations_of_motion import angular_acceleration
from rbfmu_kernels.rotations.quaternion import add_scaled_quaternion
from rbfmu_kernels.rotations.vec3 import add_scaled


def step(q, omega, h, body, loads):
    """Return attitude and rates after h: the mean of the rates at both ends, of which the second is Euler's."""
    dq, alpha = quaternion_rate_b(q, omega), angular_acceleration(q, omega, body, loads)
    p, w = add_scaled_quaternion(q, h, dq), add_scaled(omega, h, alpha)
    dp, beta = quaternion_rate_b(p, w), angular_acceleration(p, w, body, loads)
    q = add_scaled_quaternion(add_scaled_quaternion(q, 0.5 * h, dq), 0.5 * h, dp)
    return q, add_scaled(add_scaled(omega, 0.5 * h, alpha), 0.5 * h, beta)
