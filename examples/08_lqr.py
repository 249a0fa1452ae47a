"""A satellite held by an LQR: gains from `rbfmu.linearize`, tried on the body, whose torques are held over a step.

It needs SciPy: `pip install scipy`, or `pip install "rbfmu[bench]"`.
"""

import numpy as np

import rbfmu
from rbfmu.extras import needed_of

with needed_of("bench"):
    from scipy.linalg import solve_discrete_are
    from scipy.signal import cont2discrete

STEP, STEPS = 0.5, 240
DISTURBANCE = np.array([2e-4, -1e-4, 3e-4])
"""N m, body axes: what the controller does not know of."""
SATELLITE = rbfmu.Scene.from_dict(
    {
        "name": "held_satellite",
        "body": {"mass": 50.0, "inertia": [[4.0, 0.1, -0.2], [0.1, 5.0, 0.3], [-0.2, 0.3, 3.0]]},
        "inputs": {"ports": ["torque_b"], "parameters": ["quaternion_0", "omega_b_0"]},
        "outputs": {"quantities": ["quaternion", "omega_b"]},
        "run": {"stop": STEP * STEPS, "step": STEP},
    }
)
LARGEST_ERRORS = np.array([np.radians(1.0)] * 3 + [np.radians(0.2)] * 3)
LARGEST_TORQUE = 0.02
"""N m: an error of its largest size counts as much as a torque of this one."""


def gains() -> tuple[np.ndarray, np.ndarray]:
    """Return K (3, 6) of u = -K x, x = (rotvec_b, omega_b), and the poles of the loop in z."""
    A, B, C, D = rbfmu.linearize(SATELLITE)
    F, G, *_ = cont2discrete((A, B, C, D), STEP)  # exact for torques that are held
    Q, R = np.diag(LARGEST_ERRORS**-2.0), np.eye(3) * LARGEST_TORQUE**-2.0
    P = solve_discrete_are(F, G, Q, R)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    return K, np.linalg.eigvals(F - G @ K)


def held(K: np.ndarray, rotvec: np.ndarray, disturbance: np.ndarray) -> np.ndarray:
    """Return the angle off (rad) after each step of the body in the loop, from an attitude at rest."""
    start = rbfmu.quaternion_from_rotvec(rotvec)
    body, angles = rbfmu.Simulator(SATELLITE, quaternion_0=start.tolist(), omega_b_0=[0.0, 0.0, 0.0]), []
    for _ in range(STEPS):
        x = np.concatenate([rbfmu.rotvec_from_quaternion(body.quaternion), body.omega_b])
        body.step(torque_b=disturbance - K @ x)
        angles.append(float(rbfmu.angle_between(body.quaternion, [1.0, 0.0, 0.0, 0.0])))
    return np.array(angles)


def main() -> None:
    """Print what the linear system promises and what the body does."""
    K, poles = gains()
    slowest = float(np.max(np.abs(poles)))
    print(f"slowest pole of the loop: {slowest:.4f} a step, e-fold in {-STEP / np.log(slowest):.1f} s")
    axis = np.array([0.6, -0.48, 0.64])
    for degrees in (1.0, 120.0):
        angles = np.degrees(held(K, np.radians(degrees) * axis, np.zeros(3)))
        print(
            f"from {degrees:5.1f} deg: {angles[19]:.4f} deg after 10 s, {angles[-1]:.1e} deg after {STEP * STEPS:.0f} s"
        )
    offset = np.degrees(held(K, np.zeros(3), DISTURBANCE)[-1])
    promised = np.degrees(np.linalg.norm(np.linalg.solve(K[:, :3], DISTURBANCE)))
    print(f"under an unknown torque it stays {offset:.5f} deg off, {promised:.5f} deg by the gains")


if __name__ == "__main__":
    main()
