"""Euler angles, all 24 sequences from one formula.

A sequence is an integer constant, spelled as in SciPy: upper case intrinsic (about rotated axes), lower case extrinsic
(about fixed axes). Angles are in the order of the letters. If the compiler knows the constant, branches on it vanish.
"""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import atan2, sincos
from ..types import Matrix, Quaternion, Vec3
from .matrix import invert_matrix, is_no_rotation, matrix_from_quaternion, quaternion_from_matrix

__all__ = [
    "XYX", "XYZ", "XZX", "XZY", "YXY", "YXZ", "YZX", "YZY", "ZXY", "ZXZ", "ZYX", "ZYZ", "euler_from_matrix",
    "euler_from_quaternion", "euler_rate_a", "euler_rate_b", "euler_rate_is_singular", "euler_rate_matrix_a",
    "euler_rate_matrix_b", "matrix_from_euler", "quaternion_from_euler", "xyx", "xyz", "xzx", "xzy", "yxy", "yxz",
    "yzx", "yzy", "zxy", "zxz", "zyx", "zyz",
]  # fmt: skip

NAMES = ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "XYX", "XZX", "YXY", "YZY", "ZXZ", "ZYZ"]
NAMES += [name.lower() for name in NAMES]


def sequence(name: str) -> int:
    """Return the integer constant of a sequence's name."""
    if not isinstance(name, str) or name not in NAMES:
        raise ValueError(f"an Euler sequence is one of {' '.join(NAMES)}; got {name!r:.40}")
    i, j, k = ("XYZ".index(letter) for letter in name.upper())
    return (64 if name.islower() else 0) + 16 * i + 4 * j + k


XYZ, XZY, YXZ, YZX, ZXY, ZYX, XYX, XZX, YXY, YZY, ZXZ, ZYZ = (sequence(name) for name in NAMES[:12])
xyz, xzy, yxz, yzx, zxy, zyx, xyx, xzx, yxy, yzy, zxz, zyz = (sequence(name) for name in NAMES[12:])


EPS = 2.0**-52
_POLE = (1.5 * EPS) ** 2  # bound of tan^2 of half the angle from a pole: an angle of 3 eps


@kernel
def _axes(seq: int) -> tuple[int, int, int, int]:
    """Return first, second and third axis of the intrinsic sequence, and the axis that is neither first nor second."""
    first = (seq >> 4) & 3
    second = (seq >> 2) & 3
    third = seq & 3
    extrinsic = seq >= 64
    i = third if extrinsic else first
    return (i, second, first if extrinsic else third, 3 - i - second)


@kernel
def _order(seq: int, v: Vec3) -> Vec3:
    """Return the angles in the order of the intrinsic sequence, which is the reverse of an extrinsic one."""
    return (v[2], v[1], v[0]) if seq >= 64 else (v[0], v[1], v[2])


@kernel
def _pick(v: Vec3, axis: int) -> float:
    """Return the component along an axis."""
    return v[0] if axis == 0 else (v[1] if axis == 1 else v[2])


@kernel
def _place(u: float, v: float, w: float, i: int, j: int) -> Vec3:
    """Return the vector with component u along axis i, v along j and w along the third."""
    return (
        u if i == 0 else (v if j == 0 else w),
        u if i == 1 else (v if j == 1 else w),
        u if i == 2 else (v if j == 2 else w),
    )


@kernel
def _parity(i: int, j: int) -> float:
    """Return 1 where (i, j, the third axis) is right-handed, else -1."""
    return 1.0 if j - i == 1 or j - i == -2 else -1.0


@kernel
def quaternion_from_euler(seq: int, angles: Vec3) -> Quaternion:
    """Return q_ab = q_i(angle 1) q_j(angle 2) q_k(angle 3).

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; q_ab is dimensionless.  Frames: q_ab takes coordinates in b to a.
    Error <= 2 eps to angles of 4e5, then that of `sincos`.  Singular: nowhere.  Source: E&G 6.5.
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
    return (q0, *_place(u, v, w, i, j))


@kernel
def matrix_from_euler(seq: int, angles: Vec3) -> Matrix:
    """Return R_ab = R_i(angle 1) R_j(angle 2) R_k(angle 3).

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; R_ab is dimensionless.  Frames: R_ab takes coordinates in b to a.
    Error <= 4 eps to angles of 4e5, then that of `sincos`.  Singular: nowhere.  Source: E&G 6.5.
    """
    return matrix_from_quaternion(quaternion_from_euler(seq, angles))


@kernel
def euler_from_quaternion(seq: int, q_ab: Quaternion) -> Vec3:
    """Return the Euler angles: outer ones in (-pi, pi], the middle one in [-pi/2, pi/2] (proper Euler: [0, pi]).

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; q_ab has either sign and any length from 1e-75 to 1e75.
    Frames: q_ab takes coordinates in b to a.
    Error <= 5 eps in the rotation, 3 eps in the middle angle.
    Singular: within 3 eps of a pole the middle angle is the pole's and the third angle is 0; the zero quaternion gives
    NaN.
    Source: Bernardes & Viollet 2022; E&G 6.5.
    """
    i, j, k, _ = _axes(seq)
    p = _parity(i, j)
    proper = i == k
    q0, qi, qj, qn = _in_axes(seq, q_ab)
    c, d, a, b = _sums(seq, q_ab)
    h_cd, h_ab = c * c + d * d, a * a + b * b
    at_ab, at_cd = h_ab <= _POLE * h_cd, h_cd <= _POLE * h_ab
    c = math.nan if at_ab and at_cd else c  # both hold for the zero quaternion
    free = -1.0 if seq >= 64 else 1.0  # decides which of the outer angles is zero at a pole
    h_ab, a, b = (0.0 if at_ab else h_ab), (c if at_ab else a), (free * d if at_ab else b)
    h_cd, c, d = (0.0 if at_cd else h_cd), (a if at_cd else c), (free * b if at_cd else d)
    if proper:
        middle = 2.0 * atan2(math.sqrt(h_ab), math.sqrt(h_cd))
    else:
        middle = atan2(2.0 * (q0 * qj + qi * qn), math.sqrt(h_ab * h_cd))
    middle = math.nan if at_ab and at_cd else middle
    first = atan2(c * b + d * a, c * a - d * b)
    third = atan2(d * a - c * b, c * a + d * b)
    return _order(seq, (_outer(first), middle, _outer(third if proper else p * third)))


@kernel
def _in_axes(seq: int, q_ab: Quaternion) -> Quaternion:
    """Return eta and the components of eps along first, second and remaining axis, the last with the parity's sign."""
    i, j, _, n = _axes(seq)
    eps = q_ab[1:]
    return (q_ab[0], _pick(eps, i), _pick(eps, j), _parity(i, j) * _pick(eps, n))


@kernel
def _sums(seq: int, q_ab: Quaternion) -> Quaternion:
    """Return (c, d, a, b), from which the angles follow; p: the parity.

    (c, d) = |c, d| (cos, sin)((angle 1 + p angle 3) / 2), (a, b) = |a, b| (cos, sin)((angle 1 - p angle 3) / 2).
    """
    i, _, k, _ = _axes(seq)
    q0, qi, qj, qn = _in_axes(seq, q_ab)
    return (q0, qi, qj, qn) if i == k else (q0 + qj, qi + qn, q0 - qj, qi - qn)


@kernel
def quaternion_is_at_pole(seq: int, q_ab: Quaternion) -> bool:
    """Return whether q_ab is at a pole of the Euler angles: only the outer angles' sum or difference is known."""
    c, d, a, b = _sums(seq, q_ab)
    h_cd, h_ab = c * c + d * d, a * a + b * b
    return (h_ab <= _POLE * h_cd) != (h_cd <= _POLE * h_ab)  # both hold for the zero quaternion


@kernel
def matrix_has_no_three_angles(seq: int, R_ab: Matrix) -> bool:
    """Return whether R_ab is at a pole of the Euler angles, or no rotation."""
    return is_no_rotation(R_ab) or quaternion_is_at_pole(seq, quaternion_from_matrix(R_ab))


@kernel
def _outer(angle: float) -> float:
    """Return the angle, but pi instead of -pi."""
    return math.pi if angle <= -math.pi else angle


@kernel
def euler_from_matrix(seq: int, R_ab: Matrix) -> Vec3:
    """Return the Euler angles, by `euler_from_quaternion`: no digits are lost near a pole.

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; R_ab is a rotation to round-off.  Frames: R_ab takes coordinates in b to a.
    Error <= 5 eps in the rotation, 4.5 eps in the middle angle.
    Singular: within 3 eps of a pole the middle angle is the pole's and the third angle is 0; where det R_ab <= 0, as
    for a reflection, NaN.
    Source: Bernardes & Viollet 2022; E&G 6.5.
    """
    return euler_from_quaternion(seq, quaternion_from_matrix(R_ab))


@kernel
def _fixed_columns(i: int, j: int, k: int, sincos1: tuple[float, float], sincos2: tuple[float, float]) -> Matrix:
    """Return the axes about which three successive rotations turn, in the frame before the first, as rows."""
    s1, c1 = sincos1
    s2, c2 = sincos2
    p = _parity(i, j)
    first = _place(1.0, 0.0, 0.0, i, j)
    second = _place(0.0, c1, p * s1, i, j)
    if i == k:
        return (first, second, _place(c2, s1 * s2, -p * (c1 * s2), i, j))
    return (first, second, _place(p * s2, -p * (s1 * c2), c1 * c2, i, j))


@kernel
def _solve_fixed(i: int, j: int, k: int, sincos1: tuple[float, float], sincos2: tuple[float, float], w: Vec3) -> Vec3:
    """Return the angle rates (x1, x2, x3) with x1 column 1 + x2 column 2 + x3 column 3 of `_fixed_columns` = w."""
    s1, c1 = sincos1
    s2, c2 = sincos2
    p = _parity(i, j)
    wi, wj, wn = _pick(w, i), _pick(w, j), p * _pick(w, 3 - i - j)
    proper = i == k
    across = s1 * wj - c1 * wn
    determinant = s2 if proper else -p * c2
    along = c2 if proper else p * s2
    third = across / determinant if determinant != 0.0 else across * math.inf
    return (wi - along * third, c1 * wj + s1 * wn, third)


@kernel
def euler_rate_matrix_a(seq: int, angles: Vec3) -> Matrix:
    """Return E_a with omega_ab_a = E_a d(angles)/dt, its columns in the order of the sequence's letters.

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; E_a is dimensionless.  Frames: the columns in a.
    Error <= 1 eps to angles of 2e5, then that of `sincos`.
    Singular: nowhere; E_a has no inverse in gimbal lock.  Source: E&G 6.9.
    """
    i, j, k, _ = _axes(seq)
    a1, a2, _ = _order(seq, angles)
    a, b, c = _fixed_columns(i, j, k, sincos(a1), sincos(a2))
    return _columns(seq, a, b, c)


@kernel
def euler_rate_matrix_b(seq: int, angles: Vec3) -> Matrix:
    """Return E_b = R_ab^T E_a with omega_ab_b = E_b d(angles)/dt, its columns in the order of the sequence's letters.

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad; E_b is dimensionless.  Frames: the columns in b.
    Error <= 1 eps to angles of 2e5, then that of `sincos`.
    Singular: nowhere; E_b has no inverse in gimbal lock.  Source: E&G 6.9.
    """
    i, j, k, _ = _axes(seq)
    _, a2, a3 = _order(seq, angles)
    s2, c2 = sincos(a2)
    s3, c3 = sincos(a3)
    c, b, a = _fixed_columns(k, j, i, (-s3, c3), (-s2, c2))
    return _columns(seq, a, b, c)


@kernel
def _columns(seq: int, a: Vec3, b: Vec3, c: Vec3) -> Matrix:
    """Return the matrix of three columns of the intrinsic sequence, in the order of the sequence's letters."""
    first, third = (c if seq >= 64 else a), (a if seq >= 64 else c)
    return invert_matrix((first, b, third))


@kernel
def euler_rate_a(seq: int, angles: Vec3, omega_ab_a: Vec3) -> Vec3:
    """Return d(angles)/dt = E_a^-1 omega_ab_a.

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad, omega_ab_a and the result in rad/s.  Frames: omega_ab_a in a.
    Error <= 4 eps |omega| / |det E|.
    Singular: in gimbal lock, |det E| < 4 eps; not finite only where det E is 0 in floating point.  Source: E&G 6.9.
    """
    i, j, k, _ = _axes(seq)
    a1, a2, _ = _order(seq, angles)
    return _order(seq, _solve_fixed(i, j, k, sincos(a1), sincos(a2), omega_ab_a))


@kernel
def euler_rate_b(seq: int, angles: Vec3, omega_ab_b: Vec3) -> Vec3:
    """Return d(angles)/dt = E_b^-1 omega_ab_b.

    seq is a sequence's constant, for array functions its name.
    Units: angles in rad, omega_ab_b and the result in rad/s.  Frames: omega_ab_b in b.
    Error <= 4 eps |omega| / |det E|.
    Singular: in gimbal lock, |det E| < 4 eps; not finite only where det E is 0 in floating point.  Source: E&G 6.9.
    """
    i, j, k, _ = _axes(seq)
    _, a2, a3 = _order(seq, angles)
    s2, c2 = sincos(a2)
    s3, c3 = sincos(a3)
    c, b, a = _solve_fixed(k, j, i, (-s3, c3), (-s2, c2), omega_ab_b)
    return _order(seq, (a, b, c))


@kernel
def euler_rate_is_singular(seq: int, angles: Vec3) -> bool:
    """Return whether the angles are in gimbal lock: |det E| < 4 eps.

    |det E| is |cos| of the middle angle; for proper Euler angles it is |sin|.
    """
    i, _, k, _ = _axes(seq)
    s, c = sincos(angles[1])
    return abs(s if i == k else c) < 4.0 * EPS
