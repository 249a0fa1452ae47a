"""The attitude of a scene: a quaternion, read from any of its representations."""

import math
from collections.abc import Mapping
from typing import Annotated

import numpy as np

from rbfmu.scene.section import Apart, Numbers, Section, fault, one_word
from rbfmu_kernels.compile.tiered import evaluated
from rbfmu_kernels.rotations import euler_angles, quaternion
from rbfmu_kernels.rotations import matrix as rotation
from rbfmu_kernels.rotations import rotation_vector as rotvec
from rbfmu_kernels.types import Matrix, Quaternion, Vec3

UNIT_TOLERANCE = 1e-6
"""The largest deviation of a quaternion's length from 1, or of R R^T from the identity; seven digits suffice."""
LARGEST_ANGLE = 1e9
"""A float resolves a larger angle no finer than 1e-7, so a larger angle must be a mistake."""
NORMALIZED = 8 * 2.0**-52
"""A quaternion whose |q|^2 differs from 1 by no more than this is already normalised, and no bit of it changes."""


def unit_quaternion(q: Quaternion) -> Quaternion:
    """Return the quaternion, of unit length to round-off; raise ValueError with what was expected for any other."""
    length = math.hypot(*q)
    if length == 0.0:
        raise ValueError("a unit quaternion, not zero")
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise ValueError(f"a unit quaternion to {UNIT_TOLERANCE:g}, not one of length {length:.9g}")
    return normalized(q)


def normalized(q: Quaternion) -> Quaternion:
    """Return q / |q|; one that is unit to round-off stays as it is, so that reading what was written changes no bit."""
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    return q if abs(square - 1.0) <= NORMALIZED else evaluated(quaternion.normalize, q)


def rotation_matrix(R: Matrix) -> Matrix:
    """Return the rows of R_ab, orthogonal to 1e-6 and right-handed; raise ValueError for any other."""
    with np.errstate(all="ignore"):
        error = float(np.max(np.abs(np.array(R) @ np.array(R).T - np.eye(3))))
    if not error <= UNIT_TOLERANCE:
        raise ValueError(f"a rotation matrix: R R^T is off the identity by {error:.2g}, above {UNIT_TOLERANCE:g}")
    if np.linalg.det(np.array(R)) < 0.0:
        raise ValueError("a rotation matrix: the determinant is -1, a reflection")
    return R


def _angles(unit: str, meaning: str) -> Numbers:
    return Numbers((3,), unit, " from -1e9 to 1e9", lambda angle: abs(angle) <= LARGEST_ANGLE).means(meaning)


_EULER = one_word(tuple(euler_angles.NAMES), 'an Euler sequence such as "ZYX" or "xyz"').means(
    'Euler sequence such as "ZYX" (intrinsic) or "xyz" (extrinsic), with angles_deg or angles'
)
_QUATERNION = Numbers((4,), bound=": eta, eps_1, eps_2, eps_3", then=unit_quaternion)
_MATRIX = Numbers((3, 3), then=rotation_matrix)
_IN_ORDER = "Euler angles in the sequence's order"


class Attitude(Section, path="initial.attitude"):
    """The table `initial.attitude`, which gives the attitude in exactly one representation."""

    euler: Annotated[str | None, _EULER] = None
    angles_deg: Annotated[Vec3 | None, _angles("deg", _IN_ORDER)] = None
    angles: Annotated[Vec3 | None, _angles("rad", _IN_ORDER)] = None
    quaternion: Annotated[Quaternion | None, _QUATERNION.means("Euler parameters q_ab, scalar first")] = None
    rotvec: Annotated[Vec3 | None, _angles("rad", "rotation vector: axis times angle")] = None
    matrix: Annotated[Matrix | None, _MATRIX.means("rotation matrix R_ab, by rows")] = None

    def _apart(self, data: Mapping[str, object], faults: list[str]) -> Apart:
        given, known = set(data) - {"angles_deg", "angles"}, set(data) <= self._keys.keys()
        ways = "euler (with angles_deg or angles), quaternion, rotvec or matrix"
        if len(given) != 1 and known:
            faults.append(fault(self._path, data, f"exactly one of {ways}"))
        elif given == {"euler"} and len(data) != 2:
            faults.append(fault(self._path, data, "euler with either angles_deg or angles"))
        elif len(given) == 1 and given != {"euler"} and len(data) != 1:
            faults.append(fault(self._path, data, f"{given.pop()} alone; angles belong to euler"))
        return data, {}

    def q_ab(self) -> Quaternion:
        """Return q_ab."""
        if self.euler is not None:
            x, y, z = self.angles or map(math.radians, self.angles_deg or ())
            sequence = euler_angles.sequence(self.euler)
            return normalized(evaluated(euler_angles.quaternion_from_euler, sequence, (x, y, z)))
        if self.rotvec is not None:
            return normalized(evaluated(rotvec.quaternion_from_rotvec, self.rotvec))
        if self.matrix is not None:
            return normalized(evaluated(rotation.quaternion_from_matrix, self.matrix))
        assert self.quaternion is not None
        return self.quaternion
