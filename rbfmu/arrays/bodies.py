"""Array functions that need more than a kernel over leading axes: inertia of points, its check, exact free rotation.

Free rotation is set up once per body, whatever the number of times. For many bodies at several times, some bodies are
computed side by side in the lanes of a vector register, with the same bits.
"""

import math
from typing import Any

import numpy as np
from numba import config

from rbfmu.arrays import from_kernel
from rbfmu.types import Array, ArrayLike
from rbfmu_kernels.exact import free_rotation as _free
from rbfmu_kernels.mechanics import inertia as _inertia

_reasons = from_kernel.array_function(_inertia.check_inertia)
_principal_axes = from_kernel.array_function(_inertia.principal_axes)


def inertia_of_points(masses: ArrayLike, positions: ArrayLike) -> tuple[Array, Array, Array]:
    """Return (mass, r_oc, M_c) of particles: their total mass, their centre of mass, and their inertia about it.

    Shapes: masses (n), positions (n, 3) -> (), (3), (3, 3); leading axes broadcast.
    Units: masses in kg, together above 0, positions in m, from o; M_c in kg m^2.  Frames: all in one frame.
    Error <= 1 eps of the mass and of the largest position, 2 eps of the trace, for any n, if no mass is negative: sums
    are compensated, so that a cloud far from o loses only the digits that its positions lack. With negative masses, as
    for holes, the error of M_c is 2 eps of the trace that their absolute values give.
    Singular: ValueError if the sum of the masses is not above 0.  Source: E&G (7.30); lecture, "Inertia dyadic".
    """
    m = from_kernel.as_floats("inertia_of_points", "masses", masses)
    r = from_kernel.as_floats("inertia_of_points", "positions", positions)
    if r.ndim < 2 or r.shape[-1] != 3:
        raise ValueError(f"inertia_of_points: positions must have trailing shape (n, 3), got {r.shape}")
    if m.ndim < 1 or m.shape[-1] != r.shape[-2]:
        raise ValueError(f"inertia_of_points: masses must have trailing shape ({r.shape[-2]},), got {m.shape}")
    axes, n = {"masses": m.shape[:-1], "positions": r.shape[:-2]}, m.shape[-1]
    try:
        leading = np.broadcast_shapes(*axes.values())
    except ValueError:
        raise ValueError(f"inertia_of_points: leading shapes {axes} do not broadcast") from None
    clouds = math.prod(leading)
    mass, r_oc, M_c = np.empty(clouds), np.empty((clouds, 3)), np.empty((clouds, 3, 3))
    m = np.array(np.broadcast_to(m, (*leading, n))).reshape(clouds, n)  # contiguous, as the kernel needs them
    r = np.array(np.broadcast_to(r, (*leading, n, 3))).reshape(clouds, n, 3)
    _inertia.inertia_of_clouds(m, r, mass, r_oc, M_c)
    if np.any(mass <= 0.0):
        raise ValueError(f"inertia_of_points: masses must have a sum above 0 (kg), got {np.min(mass)}")
    return mass.reshape(leading)[()], r_oc.reshape(*leading, 3), M_c.reshape(*leading, 3, 3)


def check_inertia(M: ArrayLike) -> None:
    """Raise a ValueError with the reason if M is not an inertia matrix of a rigid body.

    It is not one if it is not finite or not symmetric, or if a principal moment is negative or above the sum of the
    other two. Zero moments are allowed: one is zero for a slender beam, all three for a particle.
    Shapes: M (3, 3), with any leading axes.
    Units: any, commonly kg m^2.  Frames: any.
    Error: a condition may be violated by 1e-12 of the trace.  Singular: nowhere.  Source: lecture, "Inertia dyadic".
    """
    M = from_kernel.as_floats("check_inertia", "M", M)
    reasons = np.asarray(_reasons(M))
    if not reasons.any():
        return
    index = np.unravel_index(np.flatnonzero(reasons)[0], reasons.shape)
    where = "M" + (f"[{', '.join(map(str, index))}]" if index else "")
    raise ValueError(f"check_inertia: {where} {_words_of(int(reasons[index]), M[index])}")


def _words_of(reason: int, M: Array) -> str:
    if reason == _inertia.NOT_FINITE:
        return f"is not finite: {M.tolist()}"
    if reason == _inertia.NOT_SYMMETRIC:
        return f"is not symmetric: {M.tolist()}"
    low, middle, high = _principal_axes(M)[0]
    if reason == _inertia.NEGATIVE:
        return f"has a negative principal moment: {low:.6g}, {middle:.6g}, {high:.6g} kg m2"
    above = f"{high:.6g} kg m2 is above {low:.6g} + {middle:.6g} by {high - low - middle:.2g}"
    return f"breaks the triangle inequality: {above}"


# Exact free motion

_FEW = 8
"""The number of bodies from which on lanes are faster."""
_impossible = "free_rotation: some of these moments are of no body (negative, infinite, or 0 beside two that differ)"
_one_time_per_body, _setup = (
    from_kernel.array_function(kernel, singular=_free.free_rotation_is_singular, warning=_impossible)
    for kernel in (_free.free_rotation, _free.free_rotation_setup)
)
_at = from_kernel.array_function(_free.free_rotation_at)


@from_kernel.documented_by(_free.free_rotation)
def free_rotation(*args: Any, **kwargs: Any) -> Any:
    args, kwargs = from_kernel.in_order(_free.free_rotation, args, kwargs)
    try:
        args = from_kernel.plain_arrays(args, 4)
        if not kwargs and (found := _in_lanes(*args)):
            return found
        if len(args) < 4 or np.ndim(args[3]) == 0 or not _times_exceed_bodies(*args[:4]):
            return _one_time_per_body(*args, **kwargs)
        return _at(_setup(*args[:3]), *args[3:], **kwargs)
    except (TypeError, ValueError) as error:
        raise from_kernel.clear_error(_free.free_rotation, args, kwargs, error) from None


def _times_exceed_bodies(moments: ArrayLike, q_0: ArrayLike, omega_b_0: ArrayLike, t: ArrayLike) -> bool:
    bodies = np.broadcast_shapes(*(np.shape(a)[:-1] for a in (moments, q_0, omega_b_0)))
    return math.prod(np.broadcast_shapes(bodies, np.shape(t))) > math.prod(bodies)


def _in_lanes(*arrays: Array) -> tuple[Array, Array] | None:
    """Return q_ab (..., n, 4) and omega_b (..., n, 3) of bodies (..., 1) at n times; None for other shapes."""
    if config.DISABLE_JIT or len(arrays) != 4 or not all(np.can_cast(a.dtype, float) for a in arrays):
        return None
    if any(a.shape[-1:] != (n,) for a, n in zip(arrays, (3, 4, 3), strict=False)):
        return None
    bodies, t = np.broadcast_shapes(*(a.shape[:-1] for a in arrays[:3])), arrays[3]
    shape = np.broadcast_shapes(bodies, t.shape)
    if bodies[-1:] != (1,) or len(shape) != len(bodies) or math.prod(bodies) < _FEW or shape[-1:] < (2,):
        return None
    moments, q_0, omega_b_0 = (_flat(a, (*shape[:-1], 1, a.shape[-1]), a.shape[-1]) for a in arrays[:3])
    t = _flat(t, t.shape if math.prod(t.shape) == shape[-1] else shape, shape[-1])
    q, omega = np.empty((len(moments), t.shape[-1], 4)), np.empty((len(moments), t.shape[-1], 3))
    if _free.free_rotations(moments, q_0, omega_b_0, t, np.zeros(_free.SCRATCH), q, omega):
        from_kernel.warn_of_singular(_impossible)
    return q.reshape(*shape, 4), omega.reshape(*shape, 3)


def _flat(a: Array, shape: tuple[int, ...], width: int) -> Array:
    """Return an array, broadcast to a shape, as rows of `width` numbers."""
    return np.require(np.broadcast_to(a, shape).reshape(-1, width), float, ("C", "W"))
