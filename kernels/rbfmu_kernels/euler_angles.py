"""Euler angles, all 24 sequences from one formula.

A sequence is an integer constant, spelled as SciPy spells it: upper case intrinsic (about rotated axes), lower case
extrinsic (about fixed axes); the angles stand in the order of the letters. Formulas fold where the constant is known.
"""

import math

from ._kernel import kernel
from .elementary import atan2, sincos
from .rotation import matrix_from_quaternion, quaternion_from_matrix
from .shapes import Matrix, Quaternion, Vec3

NAMES = ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"]
NAMES += [name.lower() for name in NAMES]


def sequence(name: str) -> int:
    """The integer constant of a sequence's name."""
    if name not in NAMES:
        raise ValueError(f"an Euler sequence is one of {' '.join(NAMES)}; got {name!r}")
    i, j, k = ("XYZ".index(letter) for letter in name.upper())
    return (64 if name.islower() else 0) + 16 * i + 4 * j + k


XYZ, XZY, YXZ, YZX, ZXY, ZYX, XYX, XZX, YXY, YZY, ZXZ, ZYZ = (sequence(name) for name in NAMES[:12])
xyz, xzy, yxz, yzx, zxy, zyx, xyx, xzx, yxy, yzy, zxz, zyz = (sequence(name) for name in NAMES[12:])


@kernel
def _axes(seq: int) -> tuple[int, int, int, int]:
    """First, second and third axis of the intrinsic sequence, and the axis that is neither first nor second."""
    first = (seq >> 4) & 3
    second = (seq >> 2) & 3
    third = seq & 3
    extrinsic = seq >= 64
    i = third if extrinsic else first
    return (i, second, first if extrinsic else third, 3 - i - second)


@kernel
def _order(seq: int, v: Vec3) -> Vec3:
    """Extrinsic angles about fixed axes are intrinsic ones in reverse."""
    return (v[2], v[1], v[0]) if seq >= 64 else v


@kernel
def _pick(v: Vec3, axis: int) -> float:
    return v[0] if axis == 0 else (v[1] if axis == 1 else v[2])


@kernel
def _place(u: float, v: float, w: float, i: int, j: int) -> Vec3:
    """The vector with component u along axis i, v along j and w along the third."""
    return (
        u if i == 0 else (v if j == 0 else w),
        u if i == 1 else (v if j == 1 else w),
        u if i == 2 else (v if j == 2 else w),
    )


@kernel
def _parity(i: int, j: int) -> float:
    """1 where (i, j, the third axis) is right-handed, else -1."""
    return 1.0 if j - i == 1 or j - i == -2 else -1.0


@kernel
def quaternion_from_euler(seq: int, angles: Vec3) -> Quaternion:
    """q_ab = q_i(angle 1) q_j(angle 2) q_k(angle 3).

    seq: sequence constant; angles: rad, any size.  Error <= 3 eps.
    """
    i, j, k, _ = _axes(seq)
    a1, a2, a3 = _order(seq, angles)
    s1, c1 = sincos(0.5 * a1)
    s2, c2 = sincos(0.5 * a2)
    s3, c3 = sincos(0.5 * a3)
    p = _parity(i, j)
    cc, cs, sc, ss = c1 * c2, c1 * s2, s1 * c2, s1 * s2
    proper = i == k
    q0 = cc * c3 - (sc * s3 if proper else p * (ss * s3))
    u = sc * c3 + (cc * s3 if proper else p * (cs * s3))
    v = cs * c3 + (ss * s3 if proper else -p * (sc * s3))
    w = (p * (ss * c3 - cs * s3)) if proper else (cc * s3 + p * (ss * c3))
    x, y, z = _place(u, v, w, i, j)
    return (q0, x, y, z)


@kernel
def matrix_from_euler(seq: int, angles: Vec3) -> Matrix:
    """R_ab = R_i(angle 1) R_j(angle 2) R_k(angle 3).

    seq: sequence constant; angles: rad, any size.
    """
    return matrix_from_quaternion(quaternion_from_euler(seq, angles))


@kernel
def euler_from_quaternion(seq: int, q_ab: Quaternion) -> Vec3:
    """Angles of R_ab: outer ones in (-pi, pi], the middle one in [-pi/2, pi/2] (proper Euler: [0, pi]).

    q_ab: unit, either sign.  Bernardes & Viollet 2022.
    """
    i, j, k, n = _axes(seq)
    p = _parity(i, j)
    proper = i == k
    eps = (q_ab[1], q_ab[2], q_ab[3])
    q0, qi, qj, qn = q_ab[0], _pick(eps, i), _pick(eps, j), p * _pick(eps, n)
    # (c, d) = |c, d| (cos, sin)((angle 1 + p angle 3) / 2), (a, b) = |a, b| (cos, sin)((angle 1 - p angle 3) / 2)
    c, d = (q0, qi) if proper else (q0 + qj, qi + qn)
    a, b = (qj, qn) if proper else (q0 - qj, qi - qn)
    h_cd, h_ab = c * c + d * d, a * a + b * b
    if proper:
        middle = 2.0 * atan2(math.sqrt(h_ab), math.sqrt(h_cd))
    else:
        middle = atan2(2.0 * (q0 * qj + qi * qn), math.sqrt(h_ab * h_cd))
    pole = 1.5 * 2.220446049250313e-16
    at_ab, at_cd = h_ab <= pole * pole, h_cd <= pole * pole
    free = -1.0 if seq >= 64 else 1.0  # at a pole: which of the outer angles is zero
    a, b = (c if at_ab else a), (free * d if at_ab else b)
    c, d = (a if at_cd else c), (free * b if at_cd else d)
    first = atan2(c * b + d * a, c * a - d * b)
    third = atan2(d * a - c * b, c * a + d * b)
    third = third if proper else p * third
    return _order(seq, (first, middle, third))


@kernel
def euler_from_matrix(seq: int, R_ab: Matrix) -> Vec3:
    """Angles of R_ab, as `euler_from_quaternion` of its quaternion."""
    return euler_from_quaternion(seq, quaternion_from_matrix(R_ab))
