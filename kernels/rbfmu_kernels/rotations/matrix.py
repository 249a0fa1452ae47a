"""Rotation matrices: R_ab takes coordinates in b to coordinates in a."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import power_of_two_for, sincos
from ..types import Matrix, Quaternion, Vec3
from . import vec3
from .quaternion import compose_quaternions, normalize, scale_quaternion, square_of

__all__ = [
    "compose_matrices", "invert_matrix", "matrix_from_quaternion", "matrix_rate_a", "matrix_rate_b",
    "nearest_rotation", "omega_a_from_matrix_rate", "omega_b_from_matrix_rate", "quaternion_from_matrix",
    "rotation_x", "rotation_y", "rotation_z", "transform",
]  # fmt: skip


@kernel
def rotation_x(angle: float) -> Matrix:
    """Return R_x(angle), the simple rotation about the x axis.

    Units: angle in rad; the matrix is dimensionless.  Frames: the result is R_ab where b is a turned by the angle.
    Error <= 0.5 eps to an angle of 2e5, then that of `sincos`.  Singular: nowhere.  Source: E&G 6.4.
    """
    s, c = sincos(angle)
    return ((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c))


@kernel
def rotation_y(angle: float) -> Matrix:
    """Return R_y(angle), the simple rotation about the y axis.

    Units: angle in rad; the matrix is dimensionless.  Frames: the result is R_ab where b is a turned by the angle.
    Error <= 0.5 eps to an angle of 2e5, then that of `sincos`.  Singular: nowhere.  Source: E&G 6.4.
    """
    s, c = sincos(angle)
    return ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))


@kernel
def rotation_z(angle: float) -> Matrix:
    """Return R_z(angle), the simple rotation about the z axis.

    Units: angle in rad; the matrix is dimensionless.  Frames: the result is R_ab where b is a turned by the angle.
    Error <= 0.5 eps to an angle of 2e5, then that of `sincos`.  Singular: nowhere.  Source: E&G 6.4.
    """
    s, c = sincos(angle)
    return ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))


@kernel
def compose_matrices(R_ab: Matrix, R_bc: Matrix) -> Matrix:
    """Return the composite rotation R_ac = R_ab R_bc, the product of any two matrices.

    Units: dimensionless, or any.  Frames: R_ab takes coordinates in b to a, R_bc those in c to b.
    Error <= 1.5 eps |R_ab| |R_bc|.  Singular: nowhere.  Source: E&G 6.4.
    """
    columns = invert_matrix(R_bc)
    return (
        (vec3.dot(R_ab[0], columns[0]), vec3.dot(R_ab[0], columns[1]), vec3.dot(R_ab[0], columns[2])),
        (vec3.dot(R_ab[1], columns[0]), vec3.dot(R_ab[1], columns[1]), vec3.dot(R_ab[1], columns[2])),
        (vec3.dot(R_ab[2], columns[0]), vec3.dot(R_ab[2], columns[1]), vec3.dot(R_ab[2], columns[2])),
    )


@kernel
def invert_matrix(R_ab: Matrix) -> Matrix:
    """Return R_ba = R_ab^T; if R_ab is not orthogonal, this is the transpose and not the inverse.

    Units: dimensionless, or any.  Frames: R_ab takes coordinates in b to a, the result those in a to b.
    Exact for every matrix.  Singular: nowhere.  Source: E&G 6.4.
    """
    a, b, c = R_ab
    return ((a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2]))


@kernel
def transform(R_ab: Matrix, v_b: Vec3) -> Vec3:
    """Return v_a = R_ab v_b, the coordinates in a of a vector; R_ab may be any matrix.

    Units: v_b any, the result alike.  Frames: v_b in b, the result in a.
    Error <= 1.5 eps |R_ab| |v_b|.  Singular: nowhere.  Source: E&G 6.4.
    """
    return (vec3.dot(R_ab[0], v_b), vec3.dot(R_ab[1], v_b), vec3.dot(R_ab[2], v_b))


@kernel
def matrix_rate_a(R_ab: Matrix, omega_ab_a: Vec3) -> Matrix:
    """Return dR_ab/dt = skew(omega_ab_a) R_ab.

    Units: omega_ab_a in rad/s, the result in 1/s.  Frames: omega_ab_a in a.
    Error <= 1 eps |omega|.  Singular: nowhere.  Source: E&G 6.8.
    """
    return compose_matrices(vec3.skew(omega_ab_a), R_ab)


@kernel
def matrix_rate_b(R_ab: Matrix, omega_ab_b: Vec3) -> Matrix:
    """Return dR_ab/dt = R_ab skew(omega_ab_b).

    Units: omega_ab_b in rad/s, the result in 1/s.  Frames: omega_ab_b in b.
    Error <= 1 eps |omega|.  Singular: nowhere.  Source: E&G 6.8.
    """
    return compose_matrices(R_ab, vec3.skew(omega_ab_b))


@kernel
def omega_a_from_matrix_rate(R_ab: Matrix, dR: Matrix) -> Vec3:
    """Return omega_ab_a of skew(omega_ab_a) = dR R_ab^T, with dR = dR_ab/dt.

    The symmetric part of the product, 0 in exact arithmetic, is dropped.
    Units: dR in 1/s, the result in rad/s.  Frames: the result in a.
    Error <= 2 eps |omega|.  Singular: nowhere.  Source: E&G 6.8.
    """
    return vec3.unskew(compose_matrices(dR, invert_matrix(R_ab)))


@kernel
def omega_b_from_matrix_rate(R_ab: Matrix, dR: Matrix) -> Vec3:
    """Return omega_ab_b of skew(omega_ab_b) = R_ab^T dR, with dR = dR_ab/dt.

    The symmetric part of the product, 0 in exact arithmetic, is dropped.
    Units: dR in 1/s, the result in rad/s.  Frames: the result in b.
    Error <= 2 eps |omega|.  Singular: nowhere.  Source: E&G 6.8, with omega_ab_b = R_ab^T omega_ab_a.
    """
    return vec3.unskew(compose_matrices(invert_matrix(R_ab), dR))


@kernel
def matrix_from_quaternion(q_ab: Quaternion) -> Matrix:
    """Return R_ab = I + s eta skew(eps) + s skew(eps)^2, with s = 2 / |q_ab|^2.

    Textbooks have s = 2, for a q_ab that is exactly unit; here it may have any length from 1e-150 to 1e150.
    Units: dimensionless.  Frames: q_ab and R_ab take coordinates in b to a.
    Error <= 3.5 eps, of a unit q_ab 2 eps.  Singular: at the zero quaternion, which gives NaN.  Source: E&G 6.7.
    """
    w, x, y, z = q_ab
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    square = (ww + xx) + (yy + zz)
    s = 2.0 / square if square > 0.0 else math.nan
    wx, wy, wz, xy, xz, yz = w * x, w * y, w * z, x * y, x * z, y * z
    return (
        (_diagonal(s, ww + xx, yy + zz), s * (xy - wz), s * (xz + wy)),
        (s * (xy + wz), _diagonal(s, ww + yy, xx + zz), s * (yz - wx)),
        (s * (xz - wy), s * (yz + wx), _diagonal(s, ww + zz, xx + yy)),
    )


@kernel
def _diagonal(s: float, plus: float, minus: float) -> float:
    """Return (plus - minus) / (plus + minus), given s = 2 / (plus + minus).

    It is exact where minus is 0, and never doubles an error of s.
    """
    return 1.0 - s * minus if plus > minus else 0.5 * s * (plus - minus)


@kernel
def quaternion_from_matrix(R_ab: Matrix) -> Quaternion:
    """Return q_ab of R_ab with eta >= 0: the row of 4 q q^T with the largest diagonal element, normalised.

    If a matrix is no rotation to round-off, use `nearest_rotation` first.
    Units: dimensionless; R_ab is a rotation to round-off.  Frames: R_ab and q_ab take coordinates in b to a.
    Error <= 1.5 eps.  Singular: at half a turn q_ab is one of two; where det R_ab <= 0, as for a reflection, NaN.
    Source: Shepperd 1978, Markley 2008.
    """
    (a, b, c), (d, e, f), (g, h, i) = R_ab
    t0, t1, t2, t3 = 1.0 + a + e + i, 1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i
    wx, wy, wz = h - f, c - g, d - b
    xy, xz, yz = b + d, c + g, f + h
    x_first = t1 > t0
    z_second = t3 > t2
    second = (t3 if z_second else t2) > (t1 if x_first else t0)
    q = (
        (wz if z_second else wy) if second else (wx if x_first else t0),
        (xz if z_second else xy) if second else (t1 if x_first else wx),
        (yz if z_second else t2) if second else (xy if x_first else wy),
        (t3 if z_second else yz) if second else (xz if x_first else wz),
    )
    s = math.copysign(1.0 / math.sqrt(square_of(q)), q[0])
    s = math.nan if is_no_rotation(R_ab) else s
    return scale_quaternion(s, q)


@kernel
def is_no_rotation(R_ab: Matrix) -> bool:
    """Return whether det R_ab <= 0, as for a reflection, for which SciPy too refuses a quaternion."""
    return vec3.dot(R_ab[0], vec3.cross(R_ab[1], R_ab[2])) <= 0.0


@kernel(inline=False)
def nearest_rotation(R: Matrix) -> Matrix:
    """Return the rotation nearest to R in the Frobenius norm: for R near a rotation, its polar factor.

    Its quaternion is the dominant eigenvector of Davenport's 4x4 matrix, found by repeated squaring of the matrix, then
    corrected by Newton's method.
    Units: any; R may be any matrix.  Frames: those of R.
    Error <= 3 eps for R within 0.1 of a rotation; in general, eps over the gap between the two best ones.
    Singular: where two rotations are equally near, as for some reflections, one of them is returned; zero gives I.
    Source: Davenport's q-method.
    """
    rows = (vec3.largest_component(R[0]), vec3.largest_component(R[1]), vec3.largest_component(R[2]))
    s = power_of_two_for(vec3.largest_component(rows))
    M = (vec3.scale(s, R[0]), vec3.scale(s, R[1]), vec3.scale(s, R[2]))
    (a, b, c), (d, e, f), (g, h, i) = M
    size = vec3.dot(M[0], M[0]) + vec3.dot(M[1], M[1]) + vec3.dot(M[2], M[2])
    shift = math.sqrt(3.0 * size) if size > 0.0 else 1.0
    u = 0.25 / shift
    p = (
        (u * (shift + a + e + i), u * (h - f), u * (c - g), u * (d - b)),
        (u * (shift + a - e - i), u * (b + d), u * (c + g)),
        (u * (shift - a + e - i), u * (f + h)),
        u * (shift - a - e + i),
    )
    spread, count = 1.0, 0
    while spread > 1e-9 and count < 56:  # by then a gap of 1e-15 is 21 powers of e
        p, spread = _square(p)
        count += 1
    (p00, p01, p02, p03), (p11, p12, p13), (p22, p23), p33 = p
    first = (p01, p11, p12, p13) if p11 > p00 else (p00, p01, p02, p03)
    second = (p03, p13, p23, p33) if p33 > p22 else (p02, p12, p22, p23)
    q = second if max(p22, p33) > max(p00, p11) else first  # of equal ones any, but none that is smaller
    q = _toward_symmetry(normalize(q), M)
    return matrix_from_quaternion(_toward_symmetry(q, M))


_Symmetric4 = tuple[Quaternion, Vec3, tuple[float, float], float]


@kernel
def _square(p: _Symmetric4) -> tuple[_Symmetric4, float]:
    """Return p^2 / tr p^2 and tr(p)^2 - tr(p^2) of a symmetric p with trace 1, given as rows from the diagonal on."""
    (a, b, c, d), (e, f, g), (h, i), j = p
    bb, cc, dd, ff, gg, ii = b * b, c * c, d * d, f * f, g * g, i * i
    aa, ee, hh, jj = a * a + bb + cc + dd, bb + e * e + ff + gg, cc + ff + h * h + ii, dd + gg + ii + j * j
    trace = aa + ee + hh + jj
    u = 1.0 / trace
    first = (
        u * aa,
        u * (b * (a + e) + c * f + d * g),
        u * (c * (a + h) + b * f + d * i),
        u * (d * (a + j) + b * g + c * i),
    )
    second = (u * ee, u * (f * (e + h) + b * c + g * i), u * (g * (e + j) + b * d + f * i))
    return (first, second, (u * hh, u * (i * (h + j) + c * d + f * g)), u * jj), 1.0 - trace


@kernel
def _toward_symmetry(q: Quaternion, M: Matrix) -> Quaternion:
    """Make one Newton step towards the q for which S = R(q)^T M is symmetric.

    The step delta solves (tr(S) I - S) delta = the antisymmetric part of S.
    """
    N = compose_matrices(invert_matrix(matrix_from_quaternion(q)), M)
    x, y, z = N[1][1] + N[2][2], N[2][2] + N[0][0], N[0][0] + N[1][1]
    u, v, w = -0.5 * (N[1][2] + N[2][1]), -0.5 * (N[0][2] + N[2][0]), -0.5 * (N[0][1] + N[1][0])
    first, second, third = (x, w, v), (w, y, u), (v, u, z)
    adjugate = (vec3.cross(second, third), vec3.cross(third, first), vec3.cross(first, second))
    determinant = vec3.dot(first, adjugate[0])
    delta = transform(adjugate, vec3.unskew(N))  # half of the rotation vector
    delta = vec3.scale(1.0 / determinant if determinant != 0.0 else 0.0, delta)
    size = x + y + z
    # else two rotations are equally near, or three nearly, and this is round-off over round-off
    is_step = vec3.dot(delta, delta) < 1e-6 and determinant > 1e-12 * size * size * size
    x, y, z = delta if is_step else vec3.scale(0.0, q[1:])
    return normalize(compose_quaternions(q, (1.0, x, y, z)))
