"""Equations of motion of one body, free or turning about a pivot, under known and supplied loads; its state.

Integrators have a state in a flat buffer as `STATE_BLOCKS`: q_ab, omega_b, r_c, v_c, in sizes that vectorise. No load
depends on the position, so it is integrated only if a force turns with the body (`WHOLE_STATE`). Otherwise the first
half is integrated (`ROTATION`), and the position has a closed form.
"""

import math
from typing import NamedTuple

from ..buffer import places
from ..buffer_access import put_quaternion_at
from ..compile.decorator import kernel
from ..rotations.matrix import transform
from ..rotations.quaternion import invert_quaternion, quaternion_rate_b, rotate, scale_quaternion
from ..rotations.vec3 import ZERO, add, add_scaled, cross, is_nonzero, scale, subtract
from ..types import Buffer, Matrix, Quaternion, Vec3
from .newton_euler import damping_torque, gyroscopic_torque

STATE_BLOCKS = {"q": 4, "omega": 3, "pad": 1, "r_c": 3, "v_c": 3, "pad_2": 2}
_PLACES = places(STATE_BLOCKS)
STATE_SIZE = _PLACES.size
_, OMEGA, _, R_C, V_C, _ = _PLACES.at
"""Where in a state its vectors begin; the attitude is first."""
RATE_ONLY, ROTATION, WHOLE_STATE = 3, R_C, STATE_SIZE
"""How much of a state is integrated: the rate alone (DOP853 adds the attitude), the rotation, all."""


class State(NamedTuple):
    """A state: position, m, and velocity, m/s, of the centre of mass in a; q_ab; omega_ab_b, rad/s."""

    r_c: Vec3
    v_c: Vec3
    q_ab: Quaternion
    omega_b: Vec3


class Rotation(NamedTuple):
    """Attitude and body rate omega_ab_b, rad/s."""

    q_ab: Quaternion
    omega_b: Vec3


class Centre(NamedTuple):
    """Position and velocity of the centre of mass, in a."""

    r_c: Vec3
    v_c: Vec3


@kernel
def put_unit_attitude(z: Buffer, i: int, q: Quaternion) -> None:
    """Set the quaternion of the state that begins at z[i], scaled to length 1."""
    s = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    put_quaternion_at(z, i, scale_quaternion(s, q))


Rates = State
"""The time derivative of each of a state's fields."""


class Body(NamedTuple):
    """The constants of the equations of motion; the inertia is about c of a free body, about o with a pivot.

    inverse_mass is 0 with a pivot, where o does not move. arm_b goes from the point that the inertia is about to where
    force_a and force_b act: it is -r_oc_b of a free body, r_oc_b with a pivot. is_free is 1.0 or 0.0 (with a pivot).
    """

    inverse_mass: float
    inertia: Matrix
    inertia_inverse: Matrix
    arm_b: Vec3
    damping_b: Vec3
    is_free: float


class Loads(NamedTuple):
    """The loads on a body, in m/s^2, N and N m, each fixed in the frame that its name ends in.

    force_a and force_b are the forces at o of a free body. With a pivot, which takes the forces at o, force_a is the
    weight, which acts at c.
    """

    gravity_a: Vec3
    force_a: Vec3
    force_b: Vec3
    torque_a: Vec3
    torque_b: Vec3


NO_LOADS = Loads(ZERO, ZERO, ZERO, ZERO, ZERO)


class LoadPolynomial(NamedTuple):
    """Loads during a step: value + rate t + rate_2 t^2 / 2, t from its beginning."""

    value: Loads
    rate: Loads
    rate_2: Loads


class ActingLoads(NamedTuple):
    """Whether each of the loads on which the method depends acts at any time of a step."""

    force_a: bool
    force_b: bool
    torque_a: bool


@kernel
def angular_acceleration(q_ab: Quaternion, omega_b: Vec3, body: Body, loads: Loads) -> Vec3:
    """Return alpha_b, rad/s^2, by Euler's equation about c (free) or o (pivot)."""
    torque = add(add(loads.torque_b, cross(body.arm_b, loads.force_b)), damping_torque(body.damping_b, omega_b))
    if is_nonzero(loads.force_a) or is_nonzero(loads.torque_a):  # often zero, and to turn them is half the cost
        q_ba = invert_quaternion(q_ab)
        torque_of_force = cross(body.arm_b, rotate(q_ba, loads.force_a))
        torque = add(torque, add(rotate(q_ba, loads.torque_a), torque_of_force))
    return transform(body.inertia_inverse, subtract(torque, gyroscopic_torque(body.inertia, omega_b)))


@kernel
def angular_jerk(q_ab: Quaternion, omega_b: Vec3, alpha_b: Vec3, body: Body, loads: Loads) -> Vec3:
    """Return d alpha_b / dt as seen in b, rad/s^3, under loads that are constant, each in its own frame."""
    M, q_ba = body.inertia, invert_quaternion(q_ab)
    torque_rate = cross(rotate(q_ba, loads.torque_a), omega_b)  # a vector fixed in a changes by -omega x itself
    torque_rate = add(torque_rate, cross(body.arm_b, cross(rotate(q_ba, loads.force_a), omega_b)))
    torque_rate = add(torque_rate, damping_torque(body.damping_b, alpha_b))
    gyroscopic = add(cross(alpha_b, transform(M, omega_b)), cross(omega_b, transform(M, alpha_b)))
    return transform(body.inertia_inverse, subtract(torque_rate, gyroscopic))


@kernel
def _act(loads: Loads) -> bool:
    """Return whether any load is not zero."""
    force = is_nonzero(loads.gravity_a) or is_nonzero(loads.force_a) or is_nonzero(loads.force_b)
    return force or is_nonzero(loads.torque_a) or is_nonzero(loads.torque_b)


@kernel
def is_changing(polynomial: LoadPolynomial) -> bool:
    """Return whether the loads change during the step."""
    return _act(polynomial.rate) or _act(polynomial.rate_2)


@kernel
def acting_loads(polynomial: LoadPolynomial) -> ActingLoads:
    """Return which of the loads act at any time of the step."""
    now, rate, rate_2 = polynomial.value, polynomial.rate, polynomial.rate_2
    return ActingLoads(
        is_nonzero(now.force_a) or is_nonzero(rate.force_a) or is_nonzero(rate_2.force_a),
        is_nonzero(now.force_b) or is_nonzero(rate.force_b) or is_nonzero(rate_2.force_b),
        is_nonzero(now.torque_a) or is_nonzero(rate.torque_a) or is_nonzero(rate_2.torque_a),
    )


@kernel
def _add_scaled_loads(loads: Loads, s: float, other: Loads) -> Loads:
    """Return loads + s other."""
    return Loads(
        add_scaled(loads.gravity_a, s, other.gravity_a),
        add_scaled(loads.force_a, s, other.force_a),
        add_scaled(loads.force_b, s, other.force_b),
        add_scaled(loads.torque_a, s, other.torque_a),
        add_scaled(loads.torque_b, s, other.torque_b),
    )


@kernel
def loads_after(polynomial: LoadPolynomial, t: float) -> Loads:
    """Return the loads a time t after the step's beginning."""
    linear = _add_scaled_loads(polynomial.value, t, polynomial.rate)
    return _add_scaled_loads(linear, 0.5 * t * t, polynomial.rate_2)


@kernel
def polynomial_after(polynomial: LoadPolynomial, t: float) -> LoadPolynomial:
    """Return the polynomial of the same loads in the time from t on."""
    rates = LoadPolynomial(polynomial.rate, polynomial.rate_2, NO_LOADS)
    return LoadPolynomial(loads_after(polynomial, t), loads_after(rates, t), polynomial.rate_2)


@kernel
def constant_loads(loads: Loads) -> LoadPolynomial:
    """Return the polynomial of constant loads."""
    return LoadPolynomial(loads, NO_LOADS, NO_LOADS)


@kernel
def turning_acceleration(q_ab: Quaternion, body: Body, loads: Loads) -> Vec3:
    """Return the part of a_c, in a, from the force at o that turns with the body."""
    return scale(body.inverse_mass, rotate(q_ab, loads.force_b))


@kernel
def steady_acceleration(body: Body, loads: Loads) -> Vec3:
    """Return the part of a_c, in a, that does not turn with the body: gravity and force_a; zero with a pivot."""
    return add_scaled(scale(body.is_free, loads.gravity_a), body.inverse_mass, loads.force_a)


@kernel
def linear_acceleration(q_ab: Quaternion, body: Body, loads: Loads) -> Vec3:
    """Return a_c in a: gravity and the forces at o; zero with a pivot, where c follows from the attitude."""
    return add(steady_acceleration(body, loads), turning_acceleration(q_ab, body, loads))


@kernel(inline=False)
def state_rates(state: State, body: Body, loads: Loads) -> Rates:
    """Return the time derivative of the state."""
    return Rates(
        state.v_c,
        linear_acceleration(state.q_ab, body, loads),
        quaternion_rate_b(state.q_ab, state.omega_b),
        angular_acceleration(state.q_ab, state.omega_b, body, loads),
    )
