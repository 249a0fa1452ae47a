"""Array functions about inertia that are more than a kernel over leading axes."""

import math

import numpy as np
from numpy.typing import ArrayLike

from rbfmu.arrays.from_kernel import array_function, as_floats
from rbfmu.types import Array
from rbfmu_kernels.mechanics import inertia as _inertia

_reasons = array_function(_inertia.check_inertia)
_principal_axes = array_function(_inertia.principal_axes)


def inertia_of_points(masses: ArrayLike, positions: ArrayLike) -> tuple[Array, Array, Array]:
    """Return (mass, r_oc, M_c) of particles: their mass, centre of mass, and inertia about that.

    Shapes: masses (n), positions (n, 3) -> (), (3), (3, 3); leading axes broadcast.
    Units: masses in kg, together above 0, positions in m, from o; M_c in kg m^2.  Frames: all in one frame.
    Error <= 1 eps of the mass, of the largest position and of the trace, for any n: sums are compensated, and a cloud
    far away loses no digits but those of its positions.
    Singular: where the masses' sum is not above 0, a ValueError.  Source: E&G (7.30); lecture, "Inertia dyadic".
    """
    m, r = as_floats("inertia_of_points", "masses", masses), as_floats("inertia_of_points", "positions", positions)
    if r.ndim < 2 or r.shape[-1] != 3:
        raise ValueError(f"inertia_of_points: positions must have trailing shape (n, 3), got {r.shape}")
    if m.ndim < 1 or m.shape[-1] != r.shape[-2]:
        raise ValueError(f"inertia_of_points: masses must have trailing shape ({r.shape[-2]},), got {m.shape}")
    leading, n = np.broadcast_shapes(m.shape[:-1], r.shape[:-2]), m.shape[-1]
    clouds = math.prod(leading)
    mass, r_oc, M_c = np.empty(clouds), np.empty((clouds, 3)), np.empty((clouds, 3, 3))
    m = np.array(np.broadcast_to(m, (*leading, n))).reshape(clouds, n)  # copies: packed, as the kernel was compiled for
    r = np.array(np.broadcast_to(r, (*leading, n, 3))).reshape(clouds, n, 3)
    _inertia.inertia_of_clouds(m, r, mass, r_oc, M_c)
    if np.any(mass <= 0.0):
        raise ValueError("inertia_of_points: masses must have a sum above 0 (kg)")
    return mass.reshape(leading)[()], r_oc.reshape(*leading, 3), M_c.reshape(*leading, 3, 3)


def check_inertia(M: ArrayLike) -> None:
    """Raise a ValueError that says why M is no inertia matrix of a rigid body, where it is none.

    It is none where it is not finite, not symmetric, or a principal moment is negative or above the sum of the other
    two. One zero moment is a slender beam and allowed, all three are a particle.
    Shapes: M (3, 3), with any leading axes.
    Units: any, commonly kg m^2.  Frames: any.
    Error: each condition may be broken by 1e-12 of the trace.  Singular: nowhere.  Source: lecture, "Inertia dyadic".
    """
    M = as_floats("check_inertia", "M", M)
    reasons = np.asarray(_reasons(M))
    if not reasons.any():
        return
    index = np.unravel_index(np.flatnonzero(reasons)[0], reasons.shape)
    where = "M" + (f"[{', '.join(map(str, index))}]" if index else "")
    raise ValueError(f"check_inertia: {where} {_said(int(reasons[index]), M[index])}")


def _said(reason: int, M: Array) -> str:
    if reason == _inertia.NOT_FINITE:
        return f"is not finite: {M.tolist()}"
    if reason == _inertia.NOT_SYMMETRIC:
        return f"is not symmetric: {M.tolist()}"
    low, middle, high = _principal_axes(M)[0]
    if reason == _inertia.NEGATIVE:
        return f"has a negative principal moment: {low:.6g}, {middle:.6g}, {high:.6g} kg m2"
    return f"breaks the triangle inequality: {high:.6g} kg m2 is above {low:.6g} + {middle:.6g}"
