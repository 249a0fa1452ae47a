"""Vectors, quaternions and matrices in a flat buffer."""

from typing import Any

from .compile.decorator import kernel
from .types import Matrix, Quaternion, Vec3


@kernel
def copy_numbers(z: Any, source: int, target: int, n: int) -> None:
    """Copy n numbers from z[source] on to z[target] on; the two do not overlap."""
    for i in range(n):
        z[target + i] = z[source + i]


@kernel
def pair_at(z: Any, i: int) -> tuple[float, float]:
    """Return the two numbers from z[i] on: a pair, or the high and low parts of one number."""
    return (z[i], z[i + 1])


@kernel
def put_pair_at(z: Any, i: int, a: tuple[float, float]) -> None:
    """Store two numbers from z[i] on."""
    z[i], z[i + 1] = a


@kernel
def vec3_at(z: Any, i: int) -> Vec3:
    """Return the vector that begins at z[i]."""
    return (z[i], z[i + 1], z[i + 2])


@kernel
def quaternion_at(z: Any, i: int) -> Quaternion:
    """Return the quaternion that begins at z[i]."""
    return (z[i], z[i + 1], z[i + 2], z[i + 3])


@kernel
def put_quaternion_at(z: Any, i: int, q: Quaternion) -> None:
    """Store a quaternion from z[i] on."""
    z[i], z[i + 1], z[i + 2], z[i + 3] = q


@kernel
def matrix_at(z: Any, i: int) -> Matrix:
    """Return the matrix that begins at z[i]."""
    return (vec3_at(z, i), vec3_at(z, i + 3), vec3_at(z, i + 6))


@kernel
def put_vec3_at(z: Any, i: int, v: Vec3) -> None:
    """Store a vector from z[i] on."""
    z[i], z[i + 1], z[i + 2] = v


@kernel
def put_matrix_at(z: Any, i: int, A: Matrix) -> None:
    """Store a matrix from z[i] on."""
    put_vec3_at(z, i, A[0])
    put_vec3_at(z, i + 3, A[1])
    put_vec3_at(z, i + 6, A[2])
