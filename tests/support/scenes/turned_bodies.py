"""Free bodies with a full inertia matrix: random ones of several kinds, and their motion to 40 digits and more."""

import math
from typing import Any

import mpmath as mp
import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.references.free_rotation_mp import DIGITS, Numbers, closed_form, compose, conjugate

Body = tuple[list[list[float]], list[float], list[float]]
KINDS = ("generic", "nearly symmetric", "rod", "disc", "nearly a sphere", "sphere", "symmetric", "near the separatrix",
         "about the middle axis")  # fmt: skip


def truth(M: Numbers, q_0: Numbers, omega_0: Numbers, t: Any, digits: int = DIGITS) -> tuple[list[Any], list[Any]]:
    """(q, omega) of the body whose matrix is M to the last bit, from its principal axes in as many digits."""
    with mp.workdps(digits):
        moments, R = mp.eigsy(mp.matrix(M))
        R = R if mp.det(R) > 0 else -R
        turn, length = quaternion_of(R), mp.sqrt(sum(mp.mpf(x) ** 2 for x in q_0))
        omega = [sum(R[i, k] * mp.mpf(omega_0[i]) for i in range(3)) for k in range(3)]
        q, w = closed_form(list(moments), compose([mp.mpf(x) / length for x in q_0], turn), omega, t, digits)
        return compose(q, conjugate(turn)), [sum(R[i, k] * w[k] for k in range(3)) for i in range(3)]


def quaternion_of(R: Any) -> list[Any]:
    """Of a rotation matrix; the column of 4 q q^T with the largest diagonal."""
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    a, b, c = R[0, 0], R[1, 1], R[2, 2]
    ab, ac, bc = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    columns = [
        [1 + a + b + c, x, y, z], [x, 1 + a - b - c, ab, ac], [y, ab, 1 - a + b - c, bc], [z, ac, bc, 1 - a - b + c],
    ]  # fmt: skip
    best = columns[max(range(4), key=lambda k: columns[k][k])]
    length = mp.sqrt(sum(s * s for s in best))
    return [s / length for s in best]


def random_body(kind: str, rng: np.random.Generator) -> Body:
    """(M, q_0, omega_0) of a body of about 1 kg m^2 in axes of its own, at some rad/s."""
    sides = rng.uniform(0.2, 1.0, 3) ** 2
    if kind in ("nearly symmetric", "symmetric"):
        sides[1] = sides[0] * (1.0 + (10.0 ** rng.uniform(-16.0, -8.0) if kind != "symmetric" else 0.0))
    moments = np.array([sides[1] + sides[2], sides[0] + sides[2], sides[0] + sides[1]])
    if kind == "rod":
        moments = np.array([10.0 ** rng.uniform(-9.0, -2.0), 1.0, 1.0])
    elif kind == "disc":
        moments = np.array([0.5, 0.5 + 1e-6 * rng.uniform(), 1.0])
    elif kind == "nearly a sphere":
        moments = 1.0 + 10.0 ** rng.uniform(-16.0, -3.0) * rng.uniform(-1.0, 1.0, 3)
    elif kind == "sphere":
        moments = np.full(3, moments[0])
    low, middle, high = moments = np.sort(moments)
    omega = rng.normal(size=3) * 10.0 ** rng.uniform(-1.0, 1.0)
    if kind == "near the separatrix":
        omega[2] = omega[0] * math.sqrt(low * (middle - low) / (high * (high - middle)))
    elif kind == "about the middle axis":
        omega[[0, 2]] = 0.0
    R = Rotation.random(random_state=rng).as_matrix()
    M, omega = R @ np.diag(moments) @ R.T, R @ omega
    q = rng.normal(size=4)
    return (0.5 * (M + M.T)).tolist(), (q / np.linalg.norm(q)).tolist(), omega.tolist()


def length(v: Numbers) -> float:
    return math.sqrt(sum(float(x) ** 2 for x in v))
