"""Numba kernels of one rigid body: scalar functions on floats and tuples, callable from anyone's `@njit` code.

Vectors are 3-tuples, quaternions 4-tuples (scalar first), matrices tuples of rows; Euler sequences are integer
constants: `euler_from_quaternion(ZYX, q_ab)`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# fmt: off
# isort: off
from .mechanics.inertia import (
    add_scaled_matrix, adjugate_symmetric, check_inertia, diagonal, inertia_of_points, inverse_inertia, parallel_axis,
    point_inertia, principal_axes, rotate_inertia, scale_matrix, trace,
)
from .mechanics.kinematics import compose_omega, point_acceleration, point_velocity, vector_rate
from .mechanics.newton_euler import (
    angular_momentum, angular_momentum_o, damping_torque, euler_equation, gyroscopic_torque, inverse_newton_euler_c,
    inverse_newton_euler_o, kinetic_energy, linear_momentum, newton_euler_c, newton_euler_o, relative_acceleration,
)
from .mechanics.shape_inertia import beam_inertia, box_inertia, cylinder_inertia, ellipsoid_inertia, sphere_inertia
from .numerics.elementary import atan2, sincos
from .rotations.euler_angles import (
    XYX, XYZ, XZX, XZY, YXY, YXZ, YZX, YZY, ZXY, ZXZ, ZYX, ZYZ, euler_from_matrix, euler_from_quaternion, euler_rate_a,
    euler_rate_b, euler_rate_is_singular, euler_rate_matrix_a, euler_rate_matrix_b, matrix_from_euler,
    quaternion_from_euler, xyx, xyz, xzx, xzy, yxy, yxz, yzx, yzy, zxy, zxz, zyx, zyz,
)
from .rotations.matrix import (
    compose_matrices, invert_matrix, matrix_from_quaternion, matrix_rate_a, matrix_rate_b, nearest_rotation,
    omega_a_from_matrix_rate, omega_b_from_matrix_rate, quaternion_from_matrix, rotation_x, rotation_y, rotation_z,
    transform,
)
from .rotations.quaternion import (
    add_scaled_quaternion, angle_between, compose_quaternions, invert_quaternion, normalize,
    omega_a_from_quaternion_rate, omega_b_from_quaternion_rate, quaternion_rate_a, quaternion_rate_b, rotate, slerp,
)
from .rotations.rotation_vector import (
    axis_angle_from_matrix, axis_angle_from_quaternion, matrix_from_axis_angle, matrix_from_rotvec,
    quaternion_from_axis_angle, quaternion_from_rotvec, rotvec_from_matrix, rotvec_from_quaternion, rotvec_rate_a,
    rotvec_rate_b, rotvec_rate_is_singular,
)
from .rotations.vec3 import add, add_scaled, cross, dot, norm, scale, skew, subtract, unskew
from .types import Matrix, Quaternion, Vec3

if TYPE_CHECKING:
    from .exact.free_rotation import free_rotation, free_rotation_at, free_rotation_setup
    from .mechanics.spatial import (
        spatial_inertia, transform_compose, transform_from_matrix, transform_invert, transform_point, twist_at,
        wrench_at,
    )
    from .rotations.attitude_error import attitude_error, attitude_error_rate
    from .rotations.rodrigues import (
        gibbs_from_quaternion, gibbs_is_singular, gibbs_rate_a, gibbs_rate_b, mrp_from_quaternion, mrp_is_singular,
        mrp_rate_a, mrp_rate_b, mrp_shadow, quaternion_from_gibbs, quaternion_from_mrp,
    )

_LATER = {
    ".exact.free_rotation": ("free_rotation", "free_rotation_at", "free_rotation_setup"),
    ".mechanics.spatial": (
        "spatial_inertia", "transform_compose", "transform_from_matrix", "transform_invert", "transform_point",
        "twist_at", "wrench_at",
    ),
    ".rotations.attitude_error": ("attitude_error", "attitude_error_rate"),
    ".rotations.rodrigues": (
        "gibbs_from_quaternion", "gibbs_is_singular", "gibbs_rate_a", "gibbs_rate_b", "mrp_from_quaternion",
        "mrp_is_singular", "mrp_rate_a", "mrp_rate_b", "mrp_shadow", "quaternion_from_gibbs", "quaternion_from_mrp",
    ),
}
_HOMES = {name: module for module, names in _LATER.items() for name in names}

__all__ = [
    "XYX", "XYZ", "XZX", "XZY", "YXY", "YXZ", "YZX", "YZY", "ZXY", "ZXZ", "ZYX", "ZYZ", "Matrix", "Quaternion",
    "Vec3", "add", "add_scaled", "add_scaled_matrix", "add_scaled_quaternion", "adjugate_symmetric",
    "angle_between", "angular_momentum", "angular_momentum_o", "atan2", "attitude_error", "attitude_error_rate",
    "axis_angle_from_matrix", "axis_angle_from_quaternion", "beam_inertia", "box_inertia", "check_inertia",
    "compose_matrices", "compose_omega", "compose_quaternions", "cross", "cylinder_inertia", "damping_torque",
    "diagonal", "dot", "ellipsoid_inertia", "euler_equation", "euler_from_matrix", "euler_from_quaternion",
    "euler_rate_a", "euler_rate_b", "euler_rate_is_singular", "euler_rate_matrix_a", "euler_rate_matrix_b",
    "free_rotation", "free_rotation_at", "free_rotation_setup", "gibbs_from_quaternion", "gibbs_is_singular",
    "gibbs_rate_a", "gibbs_rate_b", "gyroscopic_torque", "inertia_of_points", "inverse_inertia",
    "inverse_newton_euler_c", "inverse_newton_euler_o", "invert_matrix", "invert_quaternion", "kinetic_energy",
    "linear_momentum", "matrix_from_axis_angle", "matrix_from_euler", "matrix_from_quaternion",
    "matrix_from_rotvec", "matrix_rate_a", "matrix_rate_b", "mrp_from_quaternion", "mrp_is_singular", "mrp_rate_a",
    "mrp_rate_b", "mrp_shadow", "nearest_rotation", "newton_euler_c", "newton_euler_o", "norm", "normalize",
    "omega_a_from_matrix_rate", "omega_a_from_quaternion_rate", "omega_b_from_matrix_rate",
    "omega_b_from_quaternion_rate", "parallel_axis", "point_acceleration", "point_inertia", "point_velocity",
    "principal_axes", "quaternion_from_axis_angle", "quaternion_from_euler", "quaternion_from_gibbs",
    "quaternion_from_matrix", "quaternion_from_mrp", "quaternion_from_rotvec", "quaternion_rate_a",
    "quaternion_rate_b", "relative_acceleration", "rotate", "rotate_inertia", "rotation_x", "rotation_y",
    "rotation_z", "rotvec_from_matrix", "rotvec_from_quaternion", "rotvec_rate_a", "rotvec_rate_b",
    "rotvec_rate_is_singular", "scale", "scale_matrix", "sincos", "skew", "slerp", "spatial_inertia",
    "sphere_inertia", "subtract", "trace", "transform", "transform_compose", "transform_from_matrix",
    "transform_invert", "transform_point", "twist_at", "unskew", "vector_rate", "wrench_at", "xyx", "xyz", "xzx",
    "xzy", "yxy", "yxz", "yzx", "yzy", "zxy", "zxz", "zyx", "zyz",
]
# isort: on
# fmt: on


def __getattr__(name: str) -> Any:
    """Load what is seldom needed when it is first used: free rotation alone takes as long as all others."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_HOMES[name], __name__), name)
    return value
