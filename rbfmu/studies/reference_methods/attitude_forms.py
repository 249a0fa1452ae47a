"""The forms in which the reference methods hold the attitude: quaternion, matrix, Euler angles."""

from typing import NamedTuple

from rbfmu_kernels.compile.decorator import kernel
from rbfmu_kernels.mechanics.equations_of_motion import State
from rbfmu_kernels.rotations.euler_angles import ZYX, euler_from_quaternion, quaternion_from_euler
from rbfmu_kernels.rotations.matrix import matrix_from_quaternion, quaternion_from_matrix
from rbfmu_kernels.rotations.quaternion import normalize
from rbfmu_kernels.types import Matrix, Vec3


class MatrixState(NamedTuple):
    """A state whose attitude is R_ab, or its time derivative."""

    r_c: Vec3
    v_c: Vec3
    R_ab: Matrix
    omega_b: Vec3


class VectorState(NamedTuple):
    """A state whose attitude is three Euler angles or a rotation vector, or its time derivative."""

    r_c: Vec3
    v_c: Vec3
    attitude: Vec3
    omega_b: Vec3


@kernel
def as_it_is(state: State) -> State:
    """Return the state itself."""
    return state


@kernel(inline=False)
def with_unit_quaternion(state: State) -> State:
    """Return the state, its quaternion scaled to length 1."""
    r, v, q, omega = state
    return State(r, v, normalize(q), omega)


@kernel(inline=False)
def with_matrix(state: State) -> MatrixState:
    """Return the state with R_ab for q_ab."""
    r, v, q, omega = state
    return MatrixState(r, v, matrix_from_quaternion(q), omega)


@kernel(inline=False)
def from_matrix(state: MatrixState) -> State:
    """Return the state with the unit quaternion nearest to R_ab."""
    r, v, R_ab, omega = state
    return State(r, v, quaternion_from_matrix(R_ab), omega)


@kernel(inline=False)
def with_angles(state: State) -> VectorState:
    """Return the state with (yaw, pitch, roll) for q_ab."""
    r, v, q, omega = state
    return VectorState(r, v, euler_from_quaternion(ZYX, q), omega)


@kernel(inline=False)
def from_angles(state: VectorState) -> State:
    """Return the state with q_ab for (yaw, pitch, roll)."""
    r, v, angles, omega = state
    return State(r, v, quaternion_from_euler(ZYX, angles), omega)
