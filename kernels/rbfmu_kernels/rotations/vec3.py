"""Vectors as 3-tuples and their cross-product matrices."""

import math

from ..compile.decorator import kernel
from ..numerics.elementary import scale_for_squares
from ..types import Matrix, Vec3

__all__ = ["add", "add_scaled", "cross", "dot", "norm", "scale", "skew", "subtract", "unskew"]

ZERO: Vec3 = (0.0, 0.0, 0.0)


@kernel
def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s: float, a: Vec3) -> Vec3:
    """Return s a."""
    return (s * a[0], s * a[1], s * a[2])


@kernel
def add_scaled(a: Vec3, s: float, b: Vec3) -> Vec3:
    """Return a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@kernel
def dot(a: Vec3, b: Vec3) -> float:
    """Return the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return the vector product a x b.

    Units: any.  Frames: a, b and the result in one frame.
    Error <= 1 eps |a| |b|.  Singular: nowhere.  Source: lecture, "Angular velocity".
    """
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def is_nonzero(v: Vec3) -> bool:
    """Return whether any component differs from zero; NaN does."""
    return v[0] != 0.0 or v[1] != 0.0 or v[2] != 0.0


@kernel
def largest_component(v: Vec3) -> float:
    """Return the largest absolute value of a component."""
    return max(max(abs(v[0]), abs(v[1])), abs(v[2]))


@kernel
def norm(v: Vec3) -> float:
    """Return the length |v|.

    Units: any; v may have any size.  Error <= 1.3 eps.
    """
    s = scale_for_squares(largest_component(v))
    scaled = scale(s, v)
    return math.sqrt(dot(scaled, scaled)) / s


@kernel
def skew(v: Vec3) -> Matrix:
    """Return the skew-symmetric matrix with skew(v) u = v x u.

    Units: any.  Frames: v and the result in one frame.
    Exact for every v.  Singular: nowhere.  Source: lecture, "Angular velocity".
    """
    return ((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))


@kernel
def unskew(S: Matrix) -> Vec3:
    """Return the vector v of the skew-symmetric part of S: skew(v) = (S - S^T) / 2.

    Units: any.  Frames: S and the result in one frame.
    Exact where S is skew-symmetric, else with an error of 0.5 eps of each component.  Singular: nowhere.
    Source: lecture, "Angular velocity".
    """
    return (0.5 * (S[2][1] - S[1][2]), 0.5 * (S[0][2] - S[2][0]), 0.5 * (S[1][0] - S[0][1]))
