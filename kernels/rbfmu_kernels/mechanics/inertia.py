"""Inertia matrices: of points and simple shapes, about other points, in other axes, principal axes, plausibility."""

import math
from collections.abc import Sequence

from ..compile.decorator import kernel
from ..numerics import double_double as dd, elementary
from ..rotations.matrix import compose_matrices, invert_matrix
from ..rotations.vec3 import ZERO, add, add_scaled, dot, scale, subtract
from ..types import Array, Matrix, Vec3

__all__ = [
    "add_scaled_matrix", "adjugate_symmetric", "beam_inertia", "box_inertia", "check_inertia", "cylinder_inertia",
    "diagonal", "ellipsoid_inertia", "inertia_of_points", "inverse_inertia", "parallel_axis", "point_inertia",
    "principal_axes", "rotate_inertia", "scale_matrix", "sphere_inertia", "trace",
]  # fmt: skip

INERTIA_TOLERANCE = 1e-12
"""Share of the trace by which round-off may break symmetry, sign and triangle inequality; below it a moment is zero."""
NOT_FINITE, NOT_SYMMETRIC, NEGATIVE, TRIANGLE = 1, 2, 3, 4


@kernel
def diagonal(d: Vec3) -> Matrix:
    """Return the matrix diag(d)."""
    return ((d[0], 0.0, 0.0), (0.0, d[1], 0.0), (0.0, 0.0, d[2]))


@kernel
def add_scaled_matrix(A: Matrix, s: float, B: Matrix) -> Matrix:
    """Return A + s B."""
    return (add_scaled(A[0], s, B[0]), add_scaled(A[1], s, B[1]), add_scaled(A[2], s, B[2]))


@kernel
def scale_matrix(s: float, A: Matrix) -> Matrix:
    """Return s A."""
    return (scale(s, A[0]), scale(s, A[1]), scale(s, A[2]))


@kernel
def is_diagonal(M: Matrix) -> bool:
    """Return whether a symmetric matrix has only zeros off its diagonal."""
    return M[0][1] == 0.0 and M[0][2] == 0.0 and M[1][2] == 0.0


@kernel
def trace(A: Matrix) -> float:
    """Return the sum of the diagonal."""
    return A[0][0] + A[1][1] + A[2][2]


@kernel
def point_inertia(mass: float, r: Vec3) -> Matrix:
    """Return -m skew(r) skew(r), the inertia about the origin of a particle at r.

    Units: mass in kg, r in m; the result in kg m^2.  Error <= 0.8 eps of its trace.
    """
    x, y, z = mass * r[0], mass * r[1], mass * r[2]
    xx, yy, zz = x * r[0], y * r[1], z * r[2]
    xy, xz, yz = -x * r[1], -x * r[2], -y * r[2]
    return ((yy + zz, xy, xz), (xy, xx + zz, yz), (xz, yz, xx + yy))


@kernel(inline=False)
def inertia_of_points(masses: Sequence[float], positions: Sequence[Vec3]) -> tuple[float, Vec3, Matrix]:
    """Return (mass, r_oc, M_c) of particles: their mass, centre of mass, and inertia about that.

    masses are n numbers, positions n points from o: arrays (n) and (n, 3), or tuples.
    Units: masses in kg, together above 0, positions in m; M_c in kg m^2.  Frames: all in one frame.
    Error <= 1 eps of the mass and of the largest position, 2 eps of the trace, for any n, if no mass is negative: sums
    are compensated, and a cloud far away loses only the digits of its positions. With negative masses, for holes, the
    error of M_c is 2 eps of the trace for the masses' absolute values.
    Singular: where the masses' sum is 0, which gives NaN.  Source: E&G (7.30); lecture, "Inertia dyadic".
    """
    _, about = _centre_of_mass(masses, positions, ZERO)
    mass, correction = _centre_of_mass(masses, positions, about)
    x = y = z = (ZERO, ZERO)
    for n in range(len(masses)):
        M = point_inertia(masses[n], subtract(_offset(positions, n, about), correction))
        x, y, z = _sum_with(x, M[0]), _sum_with(y, M[1]), _sum_with(z, M[2])
    return mass, add(about, correction), (add(x[0], x[1]), add(y[0], y[1]), add(z[0], z[1]))


@kernel(inline=False)
def _centre_of_mass(masses: Sequence[float], positions: Sequence[Vec3], about: Vec3) -> tuple[float, Vec3]:
    """Return mass and centre of mass of particles, the latter as a vector from `about`; without mass it is NaN."""
    mass, error = 0.0, 0.0
    total = (ZERO, ZERO)
    for n in range(len(masses)):
        mass, lost = dd.two_sum(mass, masses[n])
        error += lost
        total = _sum_with(total, scale(masses[n], _offset(positions, n, about)))
    mass += error
    moment, divisor = add(total[0], total[1]), mass if mass != 0.0 else math.nan
    return mass, (moment[0] / divisor, moment[1] / divisor, moment[2] / divisor)


@kernel
def _offset(positions: Sequence[Vec3], n: int, about: Vec3) -> Vec3:
    """Return the vector from `about` to particle n."""
    return (positions[n][0] - about[0], positions[n][1] - about[1], positions[n][2] - about[2])


@kernel
def _sum_with(total: tuple[Vec3, Vec3], term: Vec3) -> tuple[Vec3, Vec3]:
    """Return a compensated sum of vectors, as (sum, sum of errors), after a further term."""
    (a, b, c), errors = total
    a, p = dd.two_sum(a, term[0])
    b, q = dd.two_sum(b, term[1])
    c, r = dd.two_sum(c, term[2])
    return (a, b, c), add(errors, (p, q, r))


@kernel(inline=False)
def inertia_of_clouds(masses: Array, positions: Array, mass: Array, r_oc: Array, M_c: Array) -> None:
    """Set mass (clouds,), r_oc (clouds, 3), M_c (clouds, 3, 3) to `inertia_of_points` of each cloud.

    masses: (clouds, n), kg; positions: (clouds, n, 3), m.
    """
    for k in range(len(masses)):
        mass[k], centre, M = inertia_of_points(masses[k], positions[k])
        for i in range(3):
            r_oc[k, i] = centre[i]
            for j in range(3):
                M_c[k, i, j] = M[i][j]


@kernel
def parallel_axis(M_c: Matrix, mass: float, r_oc: Vec3) -> Matrix:
    """Return M_o = M_c - m skew(r_oc) skew(r_oc), the inertia about o, with r_oc from o to the centre of mass.

    Units: M_c in kg m^2, mass in kg, r_oc in m; M_o in kg m^2.  Frames: all in one frame.
    Error <= 1 eps of its trace.  Singular: nowhere.  Source: E&G (7.39).
    """
    return add_scaled_matrix(M_c, 1.0, point_inertia(mass, r_oc))


@kernel
def rotate_inertia(R_ab: Matrix, M_b: Matrix) -> Matrix:
    """Return M_a = R_ab M_b R_ab^T of a symmetric M_b; the result is symmetric to the bit.

    Units: M_b any, commonly kg m^2, the result alike.  Frames: M_b in b, the result in a.
    Error <= 2.2 eps of the trace.  Singular: nowhere.  Source: E&G (7.33).
    """
    H = compose_matrices(R_ab, M_b)
    xy, xz, yz = dot(H[0], R_ab[1]), dot(H[0], R_ab[2]), dot(H[1], R_ab[2])
    return ((dot(H[0], R_ab[0]), xy, xz), (xy, dot(H[1], R_ab[1]), yz), (xz, yz, dot(H[2], R_ab[2])))


@kernel
def adjugate_symmetric(M: Matrix) -> Matrix:
    """Return adj(M) = det(M) M^-1 of a symmetric matrix."""
    (a, d, e), (_, b, f), (_, _, c) = M
    xy, xz, yz = e * f - d * c, d * f - e * b, d * e - a * f
    return ((b * c - f * f, xy, xz), (xy, a * c - e * e, yz), (xz, yz, a * b - d * d))


@kernel
def inverse_inertia(M: Matrix) -> Matrix:
    """Return M^-1 of a symmetric inertia matrix; where one principal moment is zero, its pseudo-inverse.

    M may have any scale. A moment at most 1e-12 of the trace counts as zero (a slender beam), with no angular
    acceleration about its axis.
    Error <= 5 eps times the condition number, 2.5 eps for a diagonal matrix, 8 eps for a beam in any axes.
    Two zero moments give NaN.
    """
    p = elementary.power_of_two_for(trace(M))  # so that products of three moments neither over- nor underflow
    M = scale_matrix(p, M)
    A = adjugate_symmetric(M)
    t, d, det = trace(M), trace(A), dot(M[0], A[0])
    d = d if d > 0.0 and t > 0.0 else math.nan
    regular = det > INERTIA_TOLERANCE * t * d
    # Singular: adj(M) = d n n^T, n the beam's axis, and M^2 - t M + d (I - n n^T) = 0 (Cayley & Hamilton).
    N = add_scaled_matrix(diagonal((d, d, d)), -1.0, A)
    pseudo = add_scaled_matrix(scale_matrix(t / d, N), -1.0, M)
    f, g = 0.0 if regular else 1.0 / d, 1.0 / det if regular else 0.0
    return scale_matrix(p, add_scaled_matrix(scale_matrix(f, pseudo), g, A))  # p / det itself may underflow


@kernel
def _jacobi(p: float, q: float, o: float) -> tuple[float, float, float]:
    """Return cosine, sine and tangent of the rotation that annihilates o of ((p, o), (o, q)).

    Where o is negligible, it is the identity.
    """
    if o == 0.0 or abs(o) <= 2.0**-55 * math.sqrt(abs(p)) * math.sqrt(abs(q)):
        return 1.0, 0.0, 0.0
    x = (q - p) / (2.0 * o)
    t = math.copysign(1.0, x) / (abs(x) + math.sqrt(x * x + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    return c, t * c, t


@kernel(inline=False)
def principal_axes(M: Matrix) -> tuple[Vec3, Matrix]:
    """Return (moments, R) with M = R diag(moments) R^T, the moments ascending, R a rotation.

    The columns of R are the principal axes. A diagonal matrix gives its own numbers and a signed permutation matrix.
    Units: M symmetric (its upper triangle is read), any unit and scale, commonly kg m^2; the moments alike.
    Frames: M in b gives R_bp, from principal axes p to b.
    Error: R diag(moments) R^T is M to 2 eps of the trace, or to 6 eps of the largest moment if one is negative; R is
    orthonormal to 2 eps.
    Singular: equal moments give any axes of their plane.  Source: cyclic Jacobi, Golub & Van Loan 8.5.
    """
    (a, d, e), (_, b, f), (_, _, c) = M
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # the axes, columns of R
    for _ in range(12):  # 5 sweeps were the most seen
        if d == 0.0 and e == 0.0 and f == 0.0:
            break
        cos, sin, tan = _jacobi(a, b, d)
        a, b, d, e, f = a - tan * d, b + tan * d, 0.0, cos * e - sin * f, sin * e + cos * f
        x, y = _turn(x, y, cos, sin)
        cos, sin, tan = _jacobi(a, c, e)
        a, c, e, d, f = a - tan * e, c + tan * e, 0.0, cos * d - sin * f, sin * d + cos * f
        x, z = _turn(x, z, cos, sin)
        cos, sin, tan = _jacobi(b, c, f)
        b, c, f, d, e = b - tan * f, c + tan * f, 0.0, cos * d - sin * e, sin * d + cos * e
        y, z = _turn(y, z, cos, sin)
    if a > b:
        a, b, x, y = b, a, y, (-x[0], -x[1], -x[2])
    if b > c:
        b, c, y, z = c, b, z, (-y[0], -y[1], -y[2])
    if a > b:
        a, b, x, y = b, a, y, (-x[0], -x[1], -x[2])
    return (a, b, c), invert_matrix(_orthonormal(x, y, z))


@kernel
def _turn(u: Vec3, v: Vec3, cos: float, sin: float) -> tuple[Vec3, Vec3]:
    """Return two columns after a Jacobi rotation."""
    return (
        (cos * u[0] - sin * v[0], cos * u[1] - sin * v[1], cos * u[2] - sin * v[2]),
        (sin * u[0] + cos * v[0], sin * u[1] + cos * v[1], sin * u[2] + cos * v[2]),
    )


@kernel
def _orthonormal(x: Vec3, y: Vec3, z: Vec3) -> tuple[Vec3, Vec3, Vec3]:
    """Return columns without the round-off of many rotations, by a Newton step to orthonormal: R (3 I - R^T R) / 2."""
    xy, xz, yz = -0.5 * dot(x, y), -0.5 * dot(x, z), -0.5 * dot(y, z)
    dx, dy, dz = 0.5 * (1.0 - dot(x, x)), 0.5 * (1.0 - dot(y, y)), 0.5 * (1.0 - dot(z, z))
    return (
        add(x, add_scaled(add_scaled(scale(dx, x), xy, y), xz, z)),
        add(y, add_scaled(add_scaled(scale(dy, y), xy, x), yz, z)),
        add(z, add_scaled(add_scaled(scale(dz, z), xz, x), yz, y)),
    )


@kernel(inline=False)
def check_inertia(M: Matrix) -> float:
    """Return 0 for a possible inertia matrix, else NOT_FINITE, NOT_SYMMETRIC, NEGATIVE or TRIANGLE.

    A violation counts beyond 1e-12 of the trace; one zero moment is a slender beam, and allowed.
    """
    t = trace(M)
    total = t + M[0][1] + M[0][2] + M[1][2] + M[1][0] + M[2][0] + M[2][1]
    if not math.isfinite(total):
        return 1.0 * NOT_FINITE
    bound = INERTIA_TOLERANCE * t
    off = max(abs(M[0][1] - M[1][0]), abs(M[0][2] - M[2][0]), abs(M[1][2] - M[2][1]))
    if off > abs(bound):
        return 1.0 * NOT_SYMMETRIC
    (low, middle, high), _ = principal_axes(M)
    if t < 0.0 or low < -bound:
        return 1.0 * NEGATIVE
    return 1.0 * TRIANGLE if low + middle < high - bound else 0.0


# Homogeneous bodies of simple shape


@kernel
def is_negative(mass: float, size: float) -> bool:
    """Return whether the mass or the size of a shape is negative, which their product and square would hide."""
    return mass < 0.0 or size < 0.0


@kernel
def one_is_negative(mass: float, sizes: Vec3) -> bool:
    """Return whether the mass or one of three sizes is negative."""
    return mass < 0.0 or sizes[0] < 0.0 or sizes[1] < 0.0 or sizes[2] < 0.0


@kernel
def cylinder_is_negative(mass: float, radius: float, length: float) -> bool:
    """Return whether the mass or a size is negative."""
    return mass < 0.0 or radius < 0.0 or length < 0.0


@kernel
def beam_inertia(mass: float, length: float) -> Matrix:
    """Return M of a slender beam about its centre, diag(0, m l^2/12, m l^2/12).

    Units: mass in kg, length in m; M in kg m^2.  Frames: the beam lies along x.
    Error <= 1.5 eps.  Singular: a negative mass or size gives NaN.  Source: E&G 7.2; lecture, "Example: Slender beam".
    """
    mass = math.nan if is_negative(mass, length) else mass
    m = mass * length * length / 12.0
    return diagonal((0.0, m, m))


@kernel
def box_inertia(mass: float, sides: Vec3) -> Matrix:
    """Return M of a homogeneous box about its centre.

    Units: mass in kg, sides in m; M in kg m^2.  Frames: axes along the sides.
    Error <= 2 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    return _of_extents(mass, 12.0, sides)


@kernel
def cylinder_inertia(mass: float, radius: float, length: float) -> Matrix:
    """Return M of a homogeneous cylinder about its centre.

    Units: mass in kg, radius and length in m; M in kg m^2.  Frames: the cylinder's axis along z.
    Error <= 2.5 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    mass = math.nan if cylinder_is_negative(mass, radius, length) else mass
    r2 = radius * radius
    side = mass * (3.0 * r2 + length * length) / 12.0
    return diagonal((side, side, 0.5 * mass * r2))


@kernel
def sphere_inertia(mass: float, radius: float) -> Matrix:
    """Return M of a homogeneous ball about its centre, 2/5 m r^2 in any axes.

    Units: mass in kg, radius in m; M in kg m^2.  Frames: any.
    Error <= 1.8 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    mass = math.nan if is_negative(mass, radius) else mass
    m = 0.4 * mass * radius * radius
    return diagonal((m, m, m))


@kernel
def ellipsoid_inertia(mass: float, semiaxes: Vec3) -> Matrix:
    """Return M of a homogeneous ellipsoid about its centre.

    Units: mass in kg, semiaxes in m; M in kg m^2.  Frames: axes along the semiaxes.
    Error <= 2 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    return _of_extents(mass, 5.0, semiaxes)


@kernel
def _of_extents(mass: float, parts: float, extents: Vec3) -> Matrix:
    """Return mass / parts (e^2 I - diag(e_i^2)) of a body with extents e along the axes; NaN where one is negative."""
    x, y, z = extents[0] * extents[0], extents[1] * extents[1], extents[2] * extents[2]
    m = math.nan if one_is_negative(mass, extents) else mass / parts
    return diagonal((m * (y + z), m * (z + x), m * (x + y)))
