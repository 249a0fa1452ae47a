"""The motion of a scene far more accurately than any plan's, in all quantities: what plans are judged by."""

from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, localcontext
from itertools import accumulate
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
Decimals = Any
"""Arrays of `Decimal`, with which NumPy computes as with any objects, and of which its types know nothing."""
Motion = dict[str, Array]
DIGITS = 50
"""More than the 32 of double-double, to which what is made of the scene's own numbers is rounded once."""
ONE = np.array([[Decimal(int(i == j)) for j in range(3)] for i in range(3)])
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
        constants, state = pairs_of(_constants(scene)), pairs_of(_start(scene))
        times = pairs_of(accumulate(map(Decimal, steps), initial=Decimal(0)))
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


def pairs_of(numbers: Iterable[Decimal]) -> Array:
    """Return numbers as double-double ones: rows of their high and low parts."""
    exact = [*numbers]
    high = [float(x) for x in exact]
    return np.array([high, [float(x - Decimal(h)) for x, h in zip(exact, high, strict=True)]])


def decimals_of(values: Any) -> Decimals:
    """Return the exact decimals of floats, with which NumPy computes as with any numbers."""
    return np.vectorize(Decimal, otypes=[object])(values)


def _inertia(scene: Scene) -> Decimals:
    """Return M about the centre of mass, or about o with a pivot."""
    body = scene.body
    assert body is not None
    M, r = decimals_of(body.inertia), decimals_of(body.r_oc_b)
    if body.pivot:
        M = M + Decimal(body.mass) * (r @ r * ONE - np.outer(r, r))
    return M


def _inverse(M: Decimals) -> Decimals:
    """Return the inverse of M; for a slender beam (one zero moment) of what remains about the other axes."""
    cofactors = np.array([np.cross(M[k - 2], M[k - 1]) for k in range(3)])
    determinant, trace = M[0] @ cofactors[0], np.trace(M)
    if determinant > Decimal(INERTIA_TOLERANCE) * trace * np.trace(cofactors):
        return cofactors.T / determinant
    axis = max(cofactors, key=lambda column: column @ column)
    own = np.outer(axis, axis) * trace / (axis @ axis)
    return _inverse(M + own) - own / trace**2


def _constants(scene: Scene) -> list[Decimal]:
    found = exact_constants(scene)
    return [x for name in series.CONSTANTS for x in found[name].flat]


def exact_constants(scene: Scene) -> dict[str, Decimals]:
    """Return what stays as it is, by name: see `reference_series.CONSTANTS`."""
    body, loads = scene.body, scene.loads
    assert body is not None
    mass, zero, r_oc, M = Decimal(body.mass), 0 * ONE[0], decimals_of(body.r_oc_b), _inertia(scene)
    found = {load.name: decimals_of(getattr(loads, load.name)) for load in LOADS}
    if body.pivot:
        arm, force_a, force_b = r_oc, mass * found["gravity_a"], zero
        turning, steady, mass = zero, zero, Decimal(0)
    else:
        arm, force_a, force_b = -r_oc, found["force_a"], found["force_b"]
        turning, steady = force_b / mass, found["gravity_a"] + force_a / mass
    found |= {
        "M": M, "M_inverse": _inverse(M), "torque_b": found["torque_b"] + np.cross(arm, force_b), "force_a": force_a,
        "arm_b": arm, "a_turning_b": turning, "a_steady_a": steady, "r_oc_b": r_oc, "mass": np.array(mass),
    }  # fmt: skip
    return found


def _start(scene: Scene) -> list[Decimal]:
    found = exact_start(scene)
    return [x for name in series.STATE for x in found[name].flat]


def exact_start(scene: Scene) -> dict[str, Decimals]:
    """Return the state at the start, by name: see `reference_series.STATE`; with a pivot the path is that of o."""
    body, initial = scene.body, scene.initial
    assert body is not None
    R, omega, r_oc = _matrix(decimals_of(initial.quaternion)), decimals_of(initial.omega_b), decimals_of(body.r_oc_b)
    position, velocity = decimals_of(initial.position), 0 * ONE[0]
    if not body.pivot:
        velocity = decimals_of(initial.velocity) + R @ np.cross(omega, r_oc)
        position = position + R @ r_oc
    momentum = _inertia(scene) @ omega
    return {"R_ab": R, "momentum_b": momentum, "omega_b": omega, "v_c": velocity, "r_c": position}


def _matrix(q: Decimals) -> Decimals:
    """Return R of a quaternion of any length."""
    w, v = q[0], q[1:]
    turn = np.array([np.cross(v, unit) for unit in ONE]).T  # v x
    return ((w * w - v @ v) * ONE + 2 * np.outer(v, v) + 2 * w * turn) / (q @ q)
