"""Inertia matrices at which implementations lose digits: any axes, any scale, moments that are nearly equal."""

import math

import numpy as np

from rbfmu_kernels.mechanics import inertia
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion

SCALES = (1.0, 1e-160, 1e150, 1e-20, 1e-290, 1e290)


def random_rotation(rng, angle=None):
    q = rng.normal(size=4)
    if angle is not None:
        q[1:] *= math.sin(angle / 2) / np.linalg.norm(q[1:])
        q[0] = math.cos(angle / 2)
    return matrix_from_quaternion(tuple((q / np.linalg.norm(q)).tolist()))


HARD_MOMENTS = {
    "generic": (0.3, 0.7, 0.8), "sphere": (1.0, 1.0, 1.0), "disc": (0.5, 0.5, 1.0), "rod": (0.01, 1.0, 1.0),
    "beam": (0.0, 1.0, 1.0), "1:1:1e-6": (1e-6, 1.0, 1.0), "1:1:1e-10": (1e-10, 1.0, 1.0),
    "equal to 1e-13": (1.0, 1.0 + 1e-13, 1.0 + 2e-13), "two equal to 1e-9": (1.0, 1.0 + 1e-9, 1.3),
    "plate": (0.3, 0.4, 0.7),
}  # fmt: skip
HARD_ANGLES = (None, None, None, None, 1e-2, 1e-8, 1e-16, 1e-160)


def hard_matrices(name):
    """The moments in random axes and a little off the coordinate axes, at several scales."""
    rng = np.random.default_rng(7)
    for scale in SCALES:
        for angle in HARD_ANGLES:
            M = inertia.rotate_inertia(random_rotation(rng, angle), inertia.diagonal(HARD_MOMENTS[name]))
            yield inertia.scale_matrix(scale, M)
