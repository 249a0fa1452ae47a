"""Rotations in 50-digit arithmetic (mpmath): the truth that kernels are measured against.

Numbers come as floats and count as exact. Formulas are those of NOTATION, not those of the kernels.
"""

from typing import Any

import mpmath

EPS = 2.0**-52
mp = mpmath.MPContext()
mp.dps = 50
Vector = list[Any]
Rows = list[list[Any]]


def exact(value: Any) -> Any:
    """Floats, arrays and nested tuples as (lists of) exact numbers; integers stay."""
    if isinstance(value, int):
        return value
    return [exact(v) for v in value] if hasattr(value, "__len__") else mp.mpf(value)


def rounded(value: Any) -> Any:
    """The nearest floats, as nested tuples: a kernel's argument."""
    return tuple(rounded(v) for v in value) if isinstance(value, list | tuple) else float(value)


def flat(value: Any) -> Vector:
    return [x for v in value for x in flat(v)] if isinstance(value, list | tuple) else [value]


def error(value: Any, truth: Any, scale: Any = 1) -> float:
    """Largest difference of components, in eps times the scale."""
    differences = [abs(mp.mpf(v) - t) for v, t in zip(flat(value), flat(truth), strict=True)]
    return float(max(differences) / (mp.mpf(scale) * mp.mpf(EPS)))


def norm(v: Vector) -> Any:
    return mp.sqrt(mp.fsum([mp.mpf(x) ** 2 for x in flat(v)]))


def unit(v: Vector) -> Vector:
    length = norm(v)
    return [x / length for x in v]


def add(*vectors: Vector) -> Vector:
    return [mp.fsum(parts) for parts in zip(*vectors, strict=True)]


def scaled(s: Any, v: Vector) -> Vector:
    return [s * x for x in v]


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def product(A: Rows, B: Rows) -> Rows:
    return [[mp.fdot(row, column) for column in zip(*B, strict=True)] for row in A]


def apply(A: Rows, v: Vector) -> Vector:
    return [mp.fdot(row, v) for row in A]


def transpose(A: Rows) -> Rows:
    return [list(column) for column in zip(*A, strict=True)]


def skew(v: Vector) -> Rows:
    return [[mp.zero, -v[2], v[1]], [v[2], mp.zero, -v[0]], [-v[1], v[0], mp.zero]]


def combine(*terms: tuple[Any, Rows]) -> Rows:
    """The sum of number times matrix."""
    return [[mp.fsum([s * A[i][j] for s, A in terms]) for j in range(3)] for i in range(3)]


IDENTITY: Rows = [[mp.mpf(i == j) for j in range(3)] for i in range(3)]


def simple_rotation(axis: int, angle: Any) -> Rows:
    c, s = mp.cos(angle), mp.sin(angle)
    k = [mp.mpf(i == axis) for i in range(3)]
    kk = [[x * y for y in k] for x in k]
    return combine((c, IDENTITY), (s, skew(k)), (1 - c, kk))


def compose_quaternions(a: Vector, b: Vector) -> Vector:
    scalar = a[0] * b[0] - mp.fdot(a[1:], b[1:])
    return [scalar, *add(scaled(a[0], b[1:]), scaled(b[0], a[1:]), cross(a[1:], b[1:]))]


def matrix_from_quaternion(q: Vector) -> Rows:
    """I + 2 eta skew(eps) + 2 skew(eps)^2 of q / |q|."""
    q = unit(q)
    S = skew(q[1:])
    return combine((mp.one, IDENTITY), (2 * q[0], S), (mp.mpf(2), product(S, S)))


def quaternion_from_rotvec(u: Vector) -> Vector:
    angle = norm(u)
    if angle == 0:
        return [mp.one, mp.zero, mp.zero, mp.zero]
    return [mp.cos(angle / 2), *scaled(mp.sin(angle / 2) / angle, u)]


def rotvec_from_quaternion(q: Vector) -> Vector:
    """|u| <= pi; at half a turn with the sign of q's."""
    length = norm(q[1:])
    if length == 0:
        return [mp.zero] * 3
    sign = -1 if q[0] < 0 else 1
    return scaled(sign * 2 * mp.atan2(length, abs(q[0])) / length, q[1:])


def letters(name: str) -> list[int]:
    return ["xyz".index(letter) for letter in name.lower()]


def simple_rotations(name: str, angles: Vector) -> list[Rows]:
    """Factors of R from the left: in the order of the letters, or for fixed axes in reverse."""
    factors = [simple_rotation(axis, angle) for axis, angle in zip(letters(name), angles, strict=True)]
    return factors if name.isupper() else factors[::-1]


def matrix_from_euler(name: str, angles: Vector) -> Rows:
    a, b, c = simple_rotations(name, angles)
    return product(product(a, b), c)


def euler_rate_matrix_a(name: str, angles: Vector) -> Rows:
    """Columns: each simple rotation's axis, taken to frame a by the factors before it; in the letters' order."""
    before, columns = IDENTITY, []
    axes = letters(name) if name.isupper() else letters(name)[::-1]
    for axis, factor in zip(axes, simple_rotations(name, angles), strict=True):
        columns.append([row[axis] for row in before])
        before = product(before, factor)
    return transpose(columns if name.isupper() else columns[::-1])


def euler_rate_matrix_b(name: str, angles: Vector) -> Rows:
    return product(transpose(matrix_from_euler(name, angles)), euler_rate_matrix_a(name, angles))


def solve(A: Rows, b: Vector) -> Vector:
    return list(mp.lu_solve(mp.matrix(A), mp.matrix(b)))


def left_jacobian(u: Vector) -> Rows:
    """Jl(u) with omega_a = Jl du/dt: the integral of exp(s skew(u)) over s in [0, 1]."""
    angle, S = norm(u), skew(u)
    if angle < mp.mpf(10) ** -20:
        return combine((mp.one, IDENTITY), (mp.mpf(1) / 2, S), (mp.mpf(1) / 6, product(S, S)))
    a, b = (1 - mp.cos(angle)) / angle**2, (angle - mp.sin(angle)) / angle**3
    return combine((mp.one, IDENTITY), (a, S), (b, product(S, S)))


def slerp(a: Vector, b: Vector, s: Any) -> Vector:
    """Of the unit vectors along a and b or -b, whichever is nearer."""
    a, b = unit(a), unit(b)
    if mp.fdot(a, b) < 0:
        b = scaled(-1, b)
    difference = norm(add(b, scaled(-1, a)))
    w = 2 * mp.asin(difference / 2)
    if w == 0:
        return a
    return add(scaled(mp.sin((1 - s) * w) / mp.sin(w), a), scaled(mp.sin(s * w) / mp.sin(w), b))


def angle_between(a: Vector, b: Vector) -> Any:
    a, b = unit(a), unit(b)
    apart = min(norm(add(a, scaled(-1, b))), norm(add(a, b)))
    return 4 * mp.asin(apart / 2)


def polar_factor(M: Rows) -> Rows:
    """The orthogonal factor of M (Newton's iteration): for det M > 0 the nearest rotation."""
    X = mp.matrix(M)
    for _ in range(100):
        Y = (X + (X**-1).T) / 2
        if mp.mnorm(Y - X, "f") < mp.mpf(10) ** -40:
            break
        X = Y
    return [[Y[i, j] for j in range(3)] for i in range(3)]
