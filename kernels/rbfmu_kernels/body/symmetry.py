"""The axes of a body with two equal moments."""

from typing import Any

from ..compile.decorator import kernel
from ..numerics.double_double import DoubleDouble, dd_add, dd_scale
from ..types import Matrix, Vec3
from .memory import principal_frame
from .principal import Axes, exact_frame


@kernel
def symmetric_frame(M: Matrix) -> tuple[float, float, Matrix]:
    """Return (I_t, I_s, axes) of a body with two equal moments.

    I_t is the moment that two axes share, or their mean; I_s is that of the third axis; the axes t, u, s are rows in b.
    M: symmetric, kg m^2.
    """
    moments, R_bp = principal_frame(M)
    s = _odd_one(moments)
    t, u = (s + 1) % 3, (s + 2) % 3
    e_t = (R_bp[0][t], R_bp[1][t], R_bp[2][t])
    e_u = (R_bp[0][u], R_bp[1][u], R_bp[2][u])
    e_s = (R_bp[0][s], R_bp[1][s], R_bp[2][s])
    mean = moments[t] if moments[t] == moments[u] else 0.5 * (moments[t] + moments[u])
    return mean, moments[s], (e_t, e_u, e_s)


@kernel
def exact_symmetric_frame(z: Any) -> tuple[DoubleDouble, DoubleDouble, Axes]:
    """Return `symmetric_frame` of the buffer's body to twice the digits; the moments in some power of two of kg m^2."""
    moments, axes = exact_frame(z)
    s = _odd_one((moments[0][0], moments[1][0], moments[2][0]))
    t, u = (s + 1) % 3, (s + 2) % 3
    return dd_scale(0.5, dd_add(moments[t], moments[u])), moments[s], (axes[t], axes[u], axes[s])


@kernel
def _odd_one(moments: Vec3) -> int:
    """Return the index of the axis whose moment is farthest from the other two."""
    a, b, c = moments
    x, y, w = abs(b - c), abs(c - a), abs(a - b)
    return 0 if x <= y and x <= w else (1 if y <= w else 2)


@kernel
def is_sphere(M: Matrix) -> bool:
    """Return whether the three moments are equal to the bit, so that every axis is principal.

    M: symmetric, kg m^2.
    """
    mixed = M[0][1] != 0.0 or M[0][2] != 0.0 or M[1][2] != 0.0
    return M[0][0] == M[1][1] and M[1][1] == M[2][2] and not mixed
