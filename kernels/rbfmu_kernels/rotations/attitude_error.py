"""The error of an attitude: of the body's frame b against a desired frame d, and how it moves."""

from ..compile.decorator import kernel
from ..types import Quaternion, Vec3
from . import vec3
from .quaternion import compose_quaternions, invert_quaternion, quaternion_rate_b, rotate

__all__ = ["attitude_error", "attitude_error_rate"]


@kernel
def attitude_error(q_ad: Quaternion, q_ab: Quaternion) -> Quaternion:
    """Return q_db of R_db = R_ad^T R_ab with eta >= 0: how b is turned from d, the shorter way round.

    Units: dimensionless; q_ad and q_ab are unit, of either sign.  Frames: q_ad takes coordinates in the desired frame
    d to a, q_ab those in b to a, the result those in b to d; eps is the same in d and b.
    Error <= 1.2 eps.  Singular: at half a turn q_db is one of two.  Source: E&G 6.9, "Attitude deviation".
    """
    q_db = compose_quaternions(invert_quaternion(q_ad), q_ab)
    sign = -1.0 if q_db[0] < 0.0 else 1.0
    return (sign * q_db[0], sign * q_db[1], sign * q_db[2], sign * q_db[3])


@kernel
def attitude_error_rate(q_db: Quaternion, omega_ad_d: Vec3, omega_ab_b: Vec3) -> tuple[Quaternion, Vec3]:
    """Return (dq_db/dt, omega_db_b) of an attitude error, with omega_db_b = omega_ab_b - R_db^T omega_ad_d.

    With both at zero b is d and stays it. To there the torque -k eps - c omega_db_b leads, if d is at rest.
    Units: omega_ad_d, omega_ab_b and omega_db_b in rad/s, dq_db in 1/s; q_db is unit.
    Frames: omega_ad_d, the rate of the desired frame, in d; omega_ab_b and omega_db_b in b.
    Error <= 3 eps (|omega_ad| + |omega_ab|), of either.  Singular: nowhere.
    Source: E&G 6.9, "Attitude deviation", in b.
    """
    omega_db_b = vec3.subtract(omega_ab_b, rotate(invert_quaternion(q_db), omega_ad_d))
    return quaternion_rate_b(q_db, omega_db_b), omega_db_b
