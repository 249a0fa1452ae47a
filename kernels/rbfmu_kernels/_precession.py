"""The periodic part of the angle psi by which a free body has turned about its angular momentum."""

import math

from ._kernel import kernel
from .elementary import atan2
from .elliptic import third_kind

Precession = tuple[float, float, float, float, float]
"""1 where kappa <= rho and 2 elsewhere, with the sign of I_s - I_p; y; b; sqrt(1 + kappa); rho."""


@kernel
def precession(sn: float, cn: float, dn: float, constants: Precession) -> float:
    """Psi less a steady rate within a half turn of the polhode, |am| <= pi / 2; 0 at sn = 0.  Error <= 2 eps.

    The rate is that of a body at rest at the middle axis, where one near the separatrix lingers, so nothing here grows:
    by R_J's exchange of p and q (DLMF 19.21.12).  With n = min(kappa, rho), N the other, b = kc / sqrt(1 + n),
    y = n sqrt((1 + N) / (1 + n)), T = y b^2 sn^3 / 3 R_J(cn^2, dn^2, 1, cn^2 + b^2 sn^2), it is, for I_s > I_p,
    kappa <= rho, rate G / I_r:
        T - arg(cn (dn + y sqrt(1 + kappa) sn^2) + i sn (sqrt(1 + kappa) dn - y cn^2));
    kappa > rho, rate 2 T_kinetic / G:
        - T - arg(dn (sqrt(1 + rho) + dn) + rho cn^2 + i sqrt(1 + kappa) rho sn cn).
    """
    form, y, b, root_kappa, rho = constants
    if abs(form) == 1.0:
        angle = atan2(sn * (root_kappa * dn - y * cn * cn), cn * (dn + y * root_kappa * sn * sn))
    else:
        angle = atan2(root_kappa * rho * sn * cn, dn * (math.sqrt(1.0 + rho) + dn) + rho * cn * cn)
        y = -y
    if y != 0.0:
        angle -= third_kind(y * sn, b, sn, cn, dn)
    return math.copysign(1.0, -form) * angle
