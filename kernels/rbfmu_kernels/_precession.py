"""The periodic part of the angle psi by which a free body has turned about its angular momentum."""

from ._kernel import kernel
from .elementary import atan2
from .elliptic import third_kind

Precession = tuple[float, float, float, float, float, float, float]
"""1 where kappa <= rho, sign of I_s - I_p, y, b, sqrt(1 + kappa), sqrt(1 + rho), rho."""


@kernel
def precession(sn: float, cn: float, dn: float, constants: Precession) -> float:
    """Psi - G t / I_r within a half turn of the polhode, |am| <= pi / 2; 0 at sn = 0.  Error <= 3 eps.

    From R_J's exchange of p and q (DLMF 19.21.12): the rate G / I_r is that of the middle axis, where a body near the
    separatrix rests, so nothing here grows.  With n = min(kappa, rho), N the other, b = kc / sqrt(1 + n),
    y = n sqrt((1 + N) / (1 + n)), T = y b^2 sn^3 / 3 R_J(cn^2, dn^2, 1, cn^2 + b^2 sn^2), it is `sign` times
    kappa <= rho:   T - arg(cn (dn + y sqrt(1 + kappa) sn^2) + i sn (sqrt(1 + kappa) dn - y cn^2));
    kappa > rho:  - T - arg(dn (sqrt(1 + rho) + dn) + rho cn^2 + i sqrt(1 + kappa) rho sn cn).
    """
    first, sign, y, b, root_kappa, root_rho, rho = constants
    if first != 0.0:
        angle = atan2(sn * (root_kappa * dn - y * cn * cn), cn * (dn + y * root_kappa * sn * sn))
    else:
        angle = atan2(root_kappa * rho * sn * cn, dn * (root_rho + dn) + rho * cn * cn)
        y = -y
    if y == 0.0:
        return -sign * angle
    return sign * (third_kind(y * sn, b, sn, cn, dn) - angle)
