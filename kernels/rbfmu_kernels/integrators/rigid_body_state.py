"""The state of a body in a flat buffer, as the integrators hold it: q_ab, omega_b, r_c, v_c, in sizes that vectorise.

No load depends on the position, so it is integrated only where a force turns with the body (`WHOLE_STATE`); else the
first half suffices (`ROTATION`) and the position has a closed form.
"""

import math
from typing import NamedTuple

from ..buffer import places
from ..buffer_access import put_quaternion_at, put_vec3_at, quaternion_at, vec3_at
from ..compile.decorator import kernel
from ..types import Buffer, Quaternion, Vec3

STATE_BLOCKS = {"q": 4, "omega": 3, "pad": 1, "r_c": 3, "v_c": 3, "pad_2": 2}
_PLACES, STATE_SIZE = places(STATE_BLOCKS)
Q, OMEGA, R_C, V_C = (_PLACES[name].start for name in ("q", "omega", "r_c", "v_c"))
"""Where in a state its vectors begin."""
RATE_ONLY, ROTATION, WHOLE_STATE = 3, R_C, STATE_SIZE
"""How much of a state is integrated: the rate alone (by DOP853 with the attitude), rotation, all."""


class Rotation(NamedTuple):
    """Attitude and body rate omega_ab_b."""

    q_ab: Quaternion
    omega_b: Vec3


class Centre(NamedTuple):
    """Position and velocity of the centre of mass, in a."""

    r_c: Vec3
    v_c: Vec3


@kernel
def attitude(z: Buffer, i: int) -> Quaternion:
    """Return the quaternion of the state that begins at z[i]."""
    return quaternion_at(z, i + Q)


@kernel
def omega(z: Buffer, i: int) -> Vec3:
    """Return the body rate of the state that begins at z[i]."""
    return vec3_at(z, i + OMEGA)


@kernel
def position(z: Buffer, i: int) -> Vec3:
    """Return the position of the centre of mass of the state that begins at z[i]."""
    return vec3_at(z, i + R_C)


@kernel
def velocity(z: Buffer, i: int) -> Vec3:
    """Return the velocity of the centre of mass of the state that begins at z[i]."""
    return vec3_at(z, i + V_C)


@kernel
def put_attitude(z: Buffer, i: int, q: Quaternion) -> None:
    """Set the quaternion of the state that begins at z[i]."""
    put_quaternion_at(z, i + Q, q)


@kernel
def put_unit_attitude(z: Buffer, i: int, q: Quaternion) -> None:
    """Set the quaternion of the state that begins at z[i], scaled to length 1."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    put_quaternion_at(z, i + Q, (s * q[0], s * q[1], s * q[2], s * q[3]))


@kernel
def put_omega(z: Buffer, i: int, omega_b: Vec3) -> None:
    """Set the body rate of the state that begins at z[i]."""
    put_vec3_at(z, i + OMEGA, omega_b)


@kernel
def put_position(z: Buffer, i: int, r_c: Vec3) -> None:
    """Set the position of the centre of mass of the state that begins at z[i]."""
    put_vec3_at(z, i + R_C, r_c)


@kernel
def put_velocity(z: Buffer, i: int, v_c: Vec3) -> None:
    """Set the velocity of the centre of mass of the state that begins at z[i]."""
    put_vec3_at(z, i + V_C, v_c)
