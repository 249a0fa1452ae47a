"""The axes of a body with two equal moments."""

from ._kernel import kernel
from .body_memory import principal_frame
from .shapes import Matrix, Vec3


@kernel
def symmetric_frame(M: Matrix) -> tuple[float, float, Matrix]:
    """(I_t, I_s, axes): the moment that two axes share (else their mean), that of the third; axes t, u, s as rows in b.

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
def _odd_one(moments: Vec3) -> int:
    """The axis whose moment is farthest from the other two."""
    a, b, c = moments
    x, y, w = abs(b - c), abs(c - a), abs(a - b)
    return 0 if x <= y and x <= w else (1 if y <= w else 2)
