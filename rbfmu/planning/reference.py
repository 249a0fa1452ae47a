"""The motion of a scene far more accurately than any plan's, in all quantities: what plans are judged by."""

from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.scene.scene import Scene
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.integrators import reference_series as series
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE
from rbfmu_kernels.quantities import LOADS
from rbfmu_kernels.rotations.matrix import quaternion_from_matrix

Array = NDArray[np.float64]
Motion = dict[str, Array]
DIGITS = 50
CHUNK = 500
"""The number of the scene's steps after which progress is told."""


class ReferenceTooLongError(ArithmeticError):
    """An error for a motion that takes more steps than are allowed, or leaves the range of numbers."""


def reference_motion(
    scene: Scene, steps: Sequence[float], most: int, progress: Callable[[float], Any] | None = None
) -> Motion:
    """Return all quantities of the scene (but rpy) at its start and after each step (s), its ports at zero.

    progress: a function that is told which part of the run is done.
    Raises ReferenceTooLongError beyond `most` steps of the reference.
    """
    with localcontext() as context:
        context.prec = DIGITS
        constants, state = _pairs(_constants(scene)), _pairs(_start(scene))
        times = _pairs(_times(steps))
    work, scratch = np.zeros((2, series.SERIES)), np.zeros((2, series.SCRATCH))
    rows = np.full((times.shape[1], series.ROW), np.nan)
    for first in range(0, times.shape[1], CHUNK):
        chunk = slice(max(first - 1, 0), first + CHUNK)
        taken = series.reference_motion(constants, state, times[:, chunk], rows[chunk], most, work, scratch)
        most -= taken
        if taken < 0 or most < 0 or not np.isfinite(rows[chunk, series.OUTPUTS["omega_b"]]).all():
            raise ReferenceTooLongError(scene.name)
        if progress is not None:
            progress(min((first + CHUNK) / times.shape[1], 1.0))
    return _named(rows)


def _named(rows: Array) -> Motion:
    motion = {name: rows[:, place] for name, place in series.OUTPUTS.items()}
    attitude, to_quaternion = motion.pop("R_ab").tolist(), tiered(quaternion_from_matrix)
    motion["quaternion"] = np.array([to_quaternion((tuple(R[:3]), tuple(R[3:6]), tuple(R[6:]))) for R in attitude])
    return motion


def _pairs(numbers: Sequence[Decimal]) -> Array:
    high = [float(x) for x in numbers]
    return np.array([high, [float(x - Decimal(h)) for x, h in zip(numbers, high, strict=True)]])


def _times(steps: Sequence[float]) -> list[Decimal]:
    times = [Decimal(0)]
    for h in steps:
        times.append(times[-1] + Decimal(h))
    return times


Vector = list[Decimal]
Rows = list[Vector]


def _exact(values: Sequence[float]) -> Vector:
    return [Decimal(x) for x in values]


def _flat(A: Rows) -> Vector:
    return [x for row in A for x in row]


def _dot(a: Vector, b: Vector) -> Decimal:
    return sum((x * y for x, y in zip(a, b, strict=True)), Decimal(0))


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _applied(A: Rows, v: Vector) -> Vector:
    return [_dot(row, v) for row in A]


def _inertia(scene: Scene) -> Rows:
    """Return M about the centre of mass, or about o with a pivot."""
    body = scene.body
    assert body is not None
    M, r = [_exact(row) for row in body.inertia], _exact(body.r_oc_b)
    if body.pivot:
        mass, square = Decimal(body.mass), _dot(r, r)
        M = [[M[i][j] + mass * ((square if i == j else 0) - r[i] * r[j]) for j in range(3)] for i in range(3)]
    return M


def _inverse(M: Rows) -> Rows:
    """Return the inverse of M; for a slender beam (one zero moment) of what remains about the other axes."""
    cofactors = [_cross(M[1], M[2]), _cross(M[2], M[0]), _cross(M[0], M[1])]
    determinant, trace = _dot(M[0], cofactors[0]), M[0][0] + M[1][1] + M[2][2]
    minors = cofactors[0][0] + cofactors[1][1] + cofactors[2][2]
    if determinant > Decimal(INERTIA_TOLERANCE) * trace * minors:
        return [[cofactors[j][i] / determinant for j in range(3)] for i in range(3)]
    axis = max(cofactors, key=lambda column: _dot(column, column))
    square = _dot(axis, axis)
    own = [[trace * a * b / square for b in axis] for a in axis]
    filled = _inverse([[M[i][j] + own[i][j] for j in range(3)] for i in range(3)])
    return [[filled[i][j] - own[i][j] / trace**2 for j in range(3)] for i in range(3)]


def _constants(scene: Scene) -> Vector:
    body, loads = scene.body, scene.loads
    assert body is not None
    mass, zero, r_oc = Decimal(body.mass), [Decimal(0)] * 3, _exact(body.r_oc_b)
    gravity, torque_b = _exact(loads.gravity_a), _exact(loads.torque_b)
    if body.pivot:
        arm, force_a, force_b = r_oc, [mass * g for g in gravity], zero
        turning, steady, mass = zero, zero, Decimal(0)
    else:
        arm, force_a, force_b = [-r for r in r_oc], _exact(loads.force_a), _exact(loads.force_b)
        turning = [f / mass for f in force_b]
        steady = [g + f / mass for g, f in zip(gravity, force_a, strict=True)]
    torque_b = [t + u for t, u in zip(torque_b, _cross(arm, force_b), strict=True)]
    M = _inertia(scene)
    found = {load.name: _exact(getattr(loads, load.name)) for load in LOADS} | {
        "M": _flat(M), "M_inverse": _flat(_inverse(M)), "torque_b": torque_b, "force_a": force_a, "arm_b": arm,
        "a_turning_b": turning, "a_steady_a": steady, "r_oc_b": r_oc, "mass": [mass],
    }  # fmt: skip
    return [x for name in series.CONSTANTS for x in found[name]]


def _start(scene: Scene) -> Vector:
    """Return the state of `reference_series`; velocity and position are those of o with a pivot."""
    body, initial = scene.body, scene.initial
    assert body is not None
    R, omega, r_oc = _matrix(_exact(initial.quaternion)), _exact(initial.omega_b), _exact(body.r_oc_b)
    position, velocity = _exact(initial.position), [Decimal(0)] * 3
    if not body.pivot:
        velocity = [v + u for v, u in zip(_exact(initial.velocity), _applied(R, _cross(omega, r_oc)), strict=True)]
        position = [r + u for r, u in zip(position, _applied(R, r_oc), strict=True)]
    momentum = _applied(_inertia(scene), omega)
    found = {"R_ab": _flat(R), "momentum_b": momentum, "omega_b": omega, "v_c": velocity, "r_c": position}
    return [x for name in series.STATE for x in found[name]]


def _matrix(q: Vector) -> Rows:
    """Return R of a quaternion of any length."""
    w, x, y, z = q
    n = _dot(q, q)
    return [
        [(w * w + x * x - y * y - z * z) / n, 2 * (x * y - w * z) / n, 2 * (x * z + w * y) / n],
        [2 * (x * y + w * z) / n, (w * w - x * x + y * y - z * z) / n, 2 * (y * z - w * x) / n],
        [2 * (x * z - w * y) / n, 2 * (y * z + w * x) / n, (w * w - x * x - y * y + z * z) / n],
    ]
