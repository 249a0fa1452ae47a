"""The periodic part of the angle psi by which a free body has turned about its angular momentum."""

import math

from ._kernel import kernel
from .elementary import atan2
from .elliptic import third_kind

Precession = tuple[float, float, float, float, float, float, float]
"""n = min(kappa, rho), sign, weight of the integral, sqrt(1 + kappa), kappa, rho, sqrt(1 + rho)."""


@kernel
def precession(sn: float, cn: float, dn: float, constants: Precession) -> float:
    """Psi - rate t within a half turn of the polhode, |am| <= pi / 2, 0 at sn = 0.

    kappa <= rho (rate G / I_p): - S kappa / 3 sn^3 R_J(cn^2, dn^2, 1, 1 + kappa sn^2) - arg(cn + i sqrt(1 + kappa) sn);
    kappa > rho (rate G / I_s): + S rho / 3 sn^3 R_J(cn^2, dn^2, 1, 1 + rho sn^2) + the difference of the angles of
    (cn dn, S sn) and (cn, sqrt(1 + kappa) sn), S = sqrt((1 + kappa) (1 + rho)).  `sign` is that of I_s - I_p.
    """
    n, sign, weight, root_kappa, kappa, rho, root_rho = constants
    s2 = sn * sn
    if kappa <= rho:
        angle = -atan2(root_kappa * sn, cn)
    else:
        y = sn * cn * root_kappa * rho * (1.0 + kappa * s2) / (root_rho + dn)
        angle = atan2(y, cn * cn * dn + (1.0 + kappa) * root_rho * s2)
    angle *= sign
    if n == 0.0:
        return angle
    return angle + third_kind(weight * s2 * sn, 1.0 + n * s2, cn, dn)


@kernel
def weight_of_integral(n: float, sign: float, kappa: float, rho: float) -> float:
    """The factor w / sn^3 of `third_kind`: w^2 = (p - cn^2) (p - dn^2) (p - 1) = (n S sn^3)^2."""
    return (-sign if kappa <= rho else sign) * n * math.sqrt((1.0 + kappa) * (1.0 + rho))
