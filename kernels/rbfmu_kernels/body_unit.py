"""The rigid body as a co-simulation unit: `initialize`, `step` and `outputs` over one flat buffer.

The buffer (see BLOCKS) is the unit's whole memory. `step` commits all of a communication step or nothing.
"""

import math
from typing import Any

from ._kernel import kernel
from .dynamics import Body, Loads, State, angular_acceleration, linear_acceleration
from .euler_angles import ZYX, euler_from_quaternion
from .inertia import check_inertia, inverse_inertia, parallel_axis, principal_axes, trace
from .layout import FINE, MOST_SUBSTEPS, NOT_REACHED, places
from .quaternion import normalize, rotate
from .rigid_body import angular_momentum, kinetic_energy, relative_acceleration
from .shapes import Matrix, Quaternion, Vec3
from .steppers import rk4_step
from .vec3 import add, cross, dot, scale, subtract

INPUTS = {"force_a": 3, "force_b": 3, "torque_a": 3, "torque_b": 3}
PARAMETERS = {
    "mass": 1, "inertia": 6, "r_oc_b": 3, "gravity_a": 3, "damping_b": 3,
    "known_force_a": 3, "known_force_b": 3, "known_torque_a": 3, "known_torque_b": 3,
    "position_0": 3, "velocity_0": 3, "quaternion_0": 4, "omega_b_0": 3,
}  # fmt: skip
SETTINGS = {"pivot": 1, "substep": 1}
OUTPUTS = {
    "position": 3, "velocity": 3, "acceleration": 3, "quaternion": 4, "rpy": 3, "omega_b": 3, "omega_a": 3,
    "alpha_b": 3, "angular_momentum_a": 3, "kinetic_energy": 1,
}  # fmt: skip
MEMORY = {"r_c": 3, "v_c": 3, "q": 4, "omega": 3, "inverse_mass": 1, "M": 9, "M_inverse": 9, "arm": 3}
BLOCKS, SIZE = places(INPUTS | PARAMETERS | SETTINGS | OUTPUTS | MEMORY)

_AT = {name: block.start for name, block in BLOCKS.items()}
_FORCE_A, _FORCE_B, _TORQUE_A, _TORQUE_B = (_AT[n] for n in INPUTS)
_MASS, _INERTIA, _R_OC, _GRAVITY, _DAMPING = (_AT[n] for n in ("mass", "inertia", "r_oc_b", "gravity_a", "damping_b"))
_KNOWN, _END = _AT["known_force_a"], BLOCKS["omega_b_0"].stop
_POSITION_0, _VELOCITY_0, _Q_0, _OMEGA_0 = (_AT[n] for n in ("position_0", "velocity_0", "quaternion_0", "omega_b_0"))
_PIVOT, _SUBSTEP = _AT["pivot"], _AT["substep"]
_POSITION, _VELOCITY, _ACCELERATION, _Q, _RPY = (_AT[n] for n in list(OUTPUTS)[:5])
_OMEGA_B, _OMEGA_A, _ALPHA, _MOMENTUM, _ENERGY = (_AT[n] for n in list(OUTPUTS)[5:])
_STATE, _INVERSE_MASS, _M, _M_INVERSE, _ARM = (_AT[n] for n in ("r_c", "inverse_mass", "M", "M_inverse", "arm"))


@kernel(inline=False)
def initialize(z: Any) -> int:
    """Check the parameters, set state and outputs; returns 0 or a key of `layout.FAULTS`."""
    fault = _fault_of_parameters(z)
    if fault != 0:
        return fault
    mass, r_oc, pivot = z[_MASS], _vec3(z, _R_OC), z[_PIVOT] != 0.0
    M_c = _inertia(z)
    M = parallel_axis(M_c, mass, r_oc) if pivot else M_c
    q = normalize(_quaternion(z, _Q_0))
    omega = _vec3(z, _OMEGA_0)
    (low, middle, _), axes = principal_axes(M)
    if middle <= 1e-12 * trace(M):
        return 6
    beam_rate = axes[0][0] * omega[0] + axes[1][0] * omega[1] + axes[2][0] * omega[2]
    if low <= 1e-12 * trace(M) and abs(beam_rate) > 1e-12 * math.sqrt(dot(omega, omega)):
        return 9
    _put_matrix(z, _M, M)
    _put_matrix(z, _M_INVERSE, inverse_inertia(M))
    z[_INVERSE_MASS] = 0.0 if pivot else 1.0 / mass
    _put_vec3(z, _ARM, r_oc if pivot else scale(-1.0, r_oc))
    position, velocity = _vec3(z, _POSITION_0), _vec3(z, _VELOCITY_0)
    r_c = add(position, rotate(q, r_oc))
    v_c = add(velocity, rotate(q, cross(omega, r_oc)))
    _put_state(z, (r_c, (0.0, 0.0, 0.0) if pivot else v_c, q, omega))
    return outputs(z)


@kernel(inline=False)
def step(z: Any, h: float) -> int:
    """Advance by h with the inputs held; NOT_REACHED (and nothing changed) where the result is not finite."""
    substeps = h / z[_SUBSTEP] * (1.0 - 1e-9)  # so that round-off in the importer's clock adds none
    if not 0.0 < substeps < MOST_SUBSTEPS:
        return NOT_REACHED
    n = math.ceil(substeps)
    part = h / n
    body, loads, state = _body(z), _loads(z), _state(z)
    for _ in range(n):
        state = rk4_step(state, part, body, loads)
    r, v, q, w = state
    if not math.isfinite(dot(r, r) + dot(v, v) + dot(w, w) + q[0] + q[1] + q[2] + q[3]):
        return NOT_REACHED
    _put_state(z, state)
    return outputs(z)


@kernel(inline=False)
def outputs(z: Any) -> int:
    """Refresh the outputs from the state and the inputs now set."""
    body, loads, (r_c, v_c, q, omega) = _body(z), _loads(z), _state(z)
    pivot, r_oc = z[_PIVOT] != 0.0, _vec3(z, _R_OC)
    alpha = angular_acceleration(q, omega, body, loads)
    a_c = linear_acceleration(q, body, loads)
    v_rel = rotate(q, cross(omega, r_oc))
    if pivot:
        position, velocity, acceleration = _vec3(z, _POSITION_0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    else:
        position, velocity = subtract(r_c, rotate(q, r_oc)), subtract(v_c, v_rel)
        acceleration = subtract(a_c, rotate(q, relative_acceleration(omega, alpha, r_oc)))
    _put_vec3(z, _POSITION, position)
    _put_vec3(z, _VELOCITY, velocity)
    _put_vec3(z, _ACCELERATION, acceleration)
    z[_Q], z[_Q + 1], z[_Q + 2], z[_Q + 3] = q
    yaw, pitch, roll = euler_from_quaternion(ZYX, q)
    _put_vec3(z, _RPY, (roll, pitch, yaw))
    _put_vec3(z, _OMEGA_B, omega)
    _put_vec3(z, _OMEGA_A, rotate(q, omega))
    _put_vec3(z, _ALPHA, alpha)
    M = body[1]
    _put_vec3(z, _MOMENTUM, rotate(q, angular_momentum(M, omega)))
    z[_ENERGY] = kinetic_energy(0.0 if pivot else z[_MASS], M, v_c, omega)
    return FINE


@kernel(inline=False)
def _fault_of_parameters(z: Any) -> int:
    finite = 0.0
    for i in range(_END):
        finite += 0.0 * z[i]
    if finite != 0.0:
        return 8
    if not z[_MASS] > 0.0:
        return 1
    if z[_DAMPING] < 0.0 or z[_DAMPING + 1] < 0.0 or z[_DAMPING + 2] < 0.0:
        return 10
    q = _quaternion(z, _Q_0)
    if not (q[0] != 0.0 or q[1] != 0.0 or q[2] != 0.0 or q[3] != 0.0):
        return 7
    fault = check_inertia(_inertia(z))
    return 0 if fault == 0.0 else int(fault) + 1


@kernel
def _vec3(z: Any, i: int) -> Vec3:
    return (z[i], z[i + 1], z[i + 2])


@kernel
def _quaternion(z: Any, i: int) -> Quaternion:
    return (z[i], z[i + 1], z[i + 2], z[i + 3])


@kernel
def _matrix(z: Any, i: int) -> Matrix:
    return (_vec3(z, i), _vec3(z, i + 3), _vec3(z, i + 6))


@kernel
def _put_vec3(z: Any, i: int, v: Vec3) -> None:
    z[i], z[i + 1], z[i + 2] = v


@kernel
def _put_matrix(z: Any, i: int, A: Matrix) -> None:
    _put_vec3(z, i, A[0])
    _put_vec3(z, i + 3, A[1])
    _put_vec3(z, i + 6, A[2])


@kernel
def _inertia(z: Any) -> Matrix:
    """The symmetric matrix of (11, 22, 33, 12, 13, 23)."""
    xx, yy, zz = _vec3(z, _INERTIA)
    xy, xz, yz = _vec3(z, _INERTIA + 3)
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))


@kernel
def _state(z: Any) -> State:
    i = _STATE
    return _vec3(z, i), _vec3(z, i + 3), _quaternion(z, i + 6), _vec3(z, i + 10)


@kernel
def _put_state(z: Any, state: State) -> None:
    i = _STATE
    _put_vec3(z, i, state[0])
    _put_vec3(z, i + 3, state[1])
    z[i + 6], z[i + 7], z[i + 8], z[i + 9] = state[2]
    _put_vec3(z, i + 10, state[3])


@kernel
def _body(z: Any) -> Body:
    free = 1.0 if z[_PIVOT] == 0.0 else 0.0
    M, M_inverse = _matrix(z, _M), _matrix(z, _M_INVERSE)
    return z[_INVERSE_MASS], M, M_inverse, _vec3(z, _ARM), _vec3(z, _DAMPING), free


@kernel
def _loads(z: Any) -> Loads:
    """Known and supplied loads together; see `dynamics.Loads`."""
    gravity_a = _vec3(z, _GRAVITY)
    torque_a = add(_vec3(z, _KNOWN + 6), _vec3(z, _TORQUE_A))
    torque_b = add(_vec3(z, _KNOWN + 9), _vec3(z, _TORQUE_B))
    if z[_PIVOT] != 0.0:
        return gravity_a, scale(z[_MASS], gravity_a), (0.0, 0.0, 0.0), torque_a, torque_b
    force_a = add(_vec3(z, _KNOWN), _vec3(z, _FORCE_A))
    force_b = add(_vec3(z, _KNOWN + 3), _vec3(z, _FORCE_B))
    return gravity_a, force_a, force_b, torque_a, torque_b
