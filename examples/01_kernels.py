"""The kernels by themselves: one item, many items, and inside one's own compiled loop."""

import numpy as np
from numba import njit

import rbfmu
import rbfmu_kernels as k


@njit
def turns(q_ab, omega_b, h, steps):
    """Explicit Euler on a quaternion, normalised each step: anyone's loop, with the kernels inlined into it."""
    for _ in range(steps):
        dq = k.quaternion_rate_b(q_ab, omega_b)
        q_ab = k.normalize(k.add_scaled_quaternion(q_ab, h, dq))
    return q_ab


def main() -> None:
    """Print a few results that can be checked by eye."""
    # One item: yaw 90 degrees takes the body's x axis to the inertial y axis.
    q_ab = rbfmu.quaternion_from_euler("ZYX", np.radians([90.0, 0.0, 0.0]))
    print("x axis of the body in a:", np.round(rbfmu.rotate(q_ab, [1.0, 0.0, 0.0]), 15))

    # A million items: NumPy broadcasting over leading axes, and out= to reuse memory.
    v_b = np.random.default_rng(1).normal(size=(1_000_000, 3))
    v_a = rbfmu.rotate(q_ab, v_b, out=np.empty_like(v_b))
    change = np.max(np.abs(np.linalg.norm(v_a, axis=1) / np.linalg.norm(v_b, axis=1) - 1.0))
    print(f"a million vectors rotated; largest relative change of a length: {change:.1e}")

    # Inside @njit: floats and tuples in, a tuple out.
    q = turns((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, np.pi), 1e-5, 100_000)
    print("a half turn about z in 100,000 small steps:", np.round(q, 6))

    # Euler's equation: a free body keeps its angular momentum, so its rates must change.
    M_c = rbfmu.box_inertia(2.27, [0.2032, 0.1016, 0.05715])
    alpha = rbfmu.euler_equation(M_c, np.radians([10.0, 20.0, 30.0]), [0.0, 0.0, 0.0])
    print("angular acceleration of a tumbling brick (deg/s2):", np.round(np.degrees(alpha), 6))


if __name__ == "__main__":
    main()
