"""Vectors, quaternions, matrices and named tuples of numbers in a flat buffer."""

import sys
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any, Generic, NamedTuple, TypeVar, get_args, get_type_hints

from .compile.decorator import kernel
from .compile.wide import bits_of
from .types import Buffer, Matrix, Quaternion, Vec3


@kernel
def copy_numbers(z: Buffer, source: int, target: int, n: int) -> None:
    """Copy n numbers from z[source] on to z[target] on; the two do not overlap."""
    for i in range(n):
        z[target + i] = z[source + i]


# Bits of several numbers are joined by OR, which is done in vectors, as no result waits for the one before. A zero of
# either sign has no bits but its sign, which is shifted out.


@kernel
def are_finite(z: Buffer, first: int, end: int) -> bool:
    """Return whether z[first], ..., z[end - 1] are finite: x - x is zero where x is."""
    bits = bits_of(0.0)
    for i in range(first, end):
        bits |= bits_of(z[i] - z[i])
    return bool(bits << 1 == 0)


@kernel
def are_zero(z: Buffer, first: int, end: int) -> bool:
    """Return whether z[first], ..., z[end - 1] are zero."""
    bits = bits_of(0.0)
    for i in range(first, end):
        bits |= bits_of(z[i])
    return bool(bits << 1 == 0)


@kernel
def are_equal(z: Buffer, i: int, j: int, n: int) -> bool:
    """Return whether n numbers from z[i] on equal those from z[j] on, all of them finite."""
    bits = bits_of(0.0)
    for k in range(n):
        bits |= bits_of(z[i + k] - z[j + k])
    return bool(bits << 1 == 0)


@kernel
def pair_at(z: Buffer, i: int) -> tuple[float, float]:
    """Return the two numbers from z[i] on: a pair, or the high and low parts of one number."""
    return (z[i], z[i + 1])


@kernel
def put_pair_at(z: Buffer, i: int, a: tuple[float, float]) -> None:
    """Store two numbers from z[i] on."""
    z[i], z[i + 1] = a


@kernel
def vec3_at(z: Buffer, i: int) -> Vec3:
    """Return the vector that begins at z[i]."""
    return (z[i], z[i + 1], z[i + 2])


@kernel
def quaternion_at(z: Buffer, i: int) -> Quaternion:
    """Return the quaternion that begins at z[i]."""
    return (z[i], z[i + 1], z[i + 2], z[i + 3])


@kernel
def put_quaternion_at(z: Buffer, i: int, q: Quaternion) -> None:
    """Store a quaternion from z[i] on."""
    z[i], z[i + 1], z[i + 2], z[i + 3] = q


@kernel
def matrix_at(z: Buffer, i: int) -> Matrix:
    """Return the matrix that begins at z[i]."""
    return (vec3_at(z, i), vec3_at(z, i + 3), vec3_at(z, i + 6))


@kernel
def put_vec3_at(z: Buffer, i: int, v: Vec3) -> None:
    """Store a vector from z[i] on."""
    z[i], z[i + 1], z[i + 2] = v


@kernel
def put_matrix_at(z: Buffer, i: int, A: Matrix) -> None:
    """Store a matrix from z[i] on."""
    put_vec3_at(z, i, A[0])
    put_vec3_at(z, i + 3, A[1])
    put_vec3_at(z, i + 6, A[2])


T = TypeVar("T", bound=tuple[object, ...])


class Record(NamedTuple, Generic[T]):
    """The kernels of one kind of named tuple: `size, put, read, flatten = record(Kind)`."""

    size: int
    """How many numbers it holds."""
    put: Callable[[Buffer, int, T], None]
    """`put(z, i, value)` stores the value from z[i] on."""
    read: Callable[[Buffer | tuple[float, ...]], T]
    """`read(numbers)` returns the value whose numbers a buffer's slice or a flat tuple holds."""
    flatten: Callable[[T], Any]
    """`flatten(value)` returns its numbers as one flat tuple."""


def record(kind: type[T], size: int = 0) -> Record[T]:
    """Return the kernels that store and read a named tuple of floats, tuples of floats, and named tuples of these.

    size: how many numbers `flatten` gives at least; it fills up with zeros.
    """
    name, paths, known = kind.__name__, _paths(kind, "value"), dict[str, Any](__name__=kind.__module__)
    stores = [f"    z[i + {k}] = {path}" for k, path in enumerate(paths)]
    numbers = ", ".join([*paths, *["0.0"] * (size - len(paths))])
    source = [f"def put_{name}(z, i, value):", *stores]
    source += [f"def read_{name}(numbers):", f"    return {_expression(kind, count(), known)}"]
    source += [f"def flatten_{name}(value):", f"    return ({numbers},)"]
    # as if the file that defines the named tuple defined them too, so that they share its cache
    exec(compile("\n".join(source), str(sys.modules[kind.__module__].__file__), "exec"), known)
    return Record(len(paths), *(kernel(known[f"{what}_{name}"]) for what in ("put", "read", "flatten")))


def _fields(kind: Any) -> dict[str, Any]:
    """Return the types of a tuple's fields, by the text that selects a field, such as .x or [0]."""
    if hasattr(kind, "_fields"):
        return {f".{name}": part for name, part in get_type_hints(kind).items()}
    return {f"[{i}]": part for i, part in enumerate(get_args(kind))}


def _paths(kind: Any, value: str) -> list[str]:
    """Return the expressions of all numbers of a value, in order."""
    if kind is float:
        return [value]
    return [path for step, part in _fields(kind).items() for path in _paths(part, value + step)]


def _expression(kind: Any, places: Iterator[int], known: dict[str, Any]) -> str:
    """Return the expression that makes a value of numbers[0], numbers[1], ...; add the named tuples used to `known`."""
    if kind is float:
        return f"numbers[{next(places)}]"
    parts = [_expression(part, places, known) for part in _fields(kind).values()]
    if not hasattr(kind, "_fields"):
        return f"({', '.join(parts)},)"
    known[kind.__name__] = kind
    return f"{kind.__name__}({', '.join(parts)})"
