"""Vectors as 3-tuples and their cross-product matrices."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import scale_for_squares
from ..types import Matrix, Vec3


@kernel
def add(a: Vec3, b: Vec3) -> Vec3:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def subtract(a: Vec3, b: Vec3) -> Vec3:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s: float, a: Vec3) -> Vec3:
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@kernel
def add_scaled(a: Vec3, s: float, b: Vec3) -> Vec3:
    """a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@kernel
def dot(a: Vec3, b: Vec3) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vec3, b: Vec3) -> Vec3:
    """a x b, both in one frame.

    Any units.  Error <= 1 eps |a| |b|.  Singular: nowhere.
    """
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def is_nonzero(v: Vec3) -> bool:
    """Whether any component is (a NaN is)."""
    return v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0


@kernel
def largest_component(v: Vec3) -> float:
    """Return the largest size of a component."""
    return max(max(abs(v[0]), abs(v[1])), abs(v[2]))


@kernel
def norm(v: Vec3) -> float:
    """|v|.

    v: any unit, any size.  Error <= 1 eps.
    """
    s = scale_for_squares(largest_component(v))
    scaled = scale(s, v)
    return math.sqrt(dot(scaled, scaled)) / s


@kernel
def skew(v: Vec3) -> Matrix:
    """The matrix with skew(v) u = v x u.

    v: any unit.  Exact.
    """
    return ((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))


@kernel
def unskew(S: Matrix) -> Vec3:
    """v of skew(v): from the skew-symmetric part of S, (S - S^T) / 2.

    Exact where S is skew-symmetric.
    """
    return (0.5 * (S[2][1] - S[1][2]), 0.5 * (S[0][2] - S[2][0]), 0.5 * (S[1][0] - S[0][1]))
