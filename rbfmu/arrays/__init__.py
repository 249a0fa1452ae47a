"""The array functions; each is made from the scalar kernel with the same name."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import rbfmu_kernels as _kernels
from rbfmu.arrays.from_kernel import array_function, checked_function, sequence_function, set_threads as set_threads
from rbfmu_kernels.mechanics import inertia as _inertia
from rbfmu_kernels.rotations import euler_angles as _euler, matrix as _rotation, rotation_vector as _rotvec

if TYPE_CHECKING:
    from rbfmu.arrays.bodies import *  # noqa: F403

REFLECTION = "some of these matrices are no rotations (det <= 0, as of a reflection), which gives NaN"
NO_DIRECTION = "some of these axes have no direction (zero, or a length outside 1e-150 to 1e150), which gives NaN"
NEGATIVE = "some of these masses or sizes are negative, which gives NaN"
HALF_TURN = "some of these rotations are half a turn (|eta| < 4 eps |q|), which gives NaN"
NO_SHADOW = "some of these parameters are 0, whose shadow set is a full turn, which gives NaN"
FULL_TURN = "some of these rotation vectors are full turns (|u| = 2 pi n, n >= 1), where they have no rates"
GIMBAL_LOCK = (
    "some of these Euler angles {seq} are in gimbal lock (|det E| < 4 eps: the middle angle is {poles} deg), "
    "where they have no rates"
)
AT_POLE = "some of these rotations are at a pole of {seq} (middle angle {poles} deg): the third angle is set to 0"

# Vectors and rotation matrices
cross = array_function(_kernels.cross)
skew = array_function(_kernels.skew)
unskew = array_function(_kernels.unskew)
rotation_x = array_function(_kernels.rotation_x)
rotation_y = array_function(_kernels.rotation_y)
rotation_z = array_function(_kernels.rotation_z)
compose_matrices = array_function(_kernels.compose_matrices)
invert_matrix = array_function(_kernels.invert_matrix)
transform = array_function(_kernels.transform)
matrix_rate_a = array_function(_kernels.matrix_rate_a)
matrix_rate_b = array_function(_kernels.matrix_rate_b)
omega_a_from_matrix_rate = array_function(_kernels.omega_a_from_matrix_rate)
omega_b_from_matrix_rate = array_function(_kernels.omega_b_from_matrix_rate)
matrix_from_quaternion = array_function(_kernels.matrix_from_quaternion)
nearest_rotation = array_function(_kernels.nearest_rotation)
quaternion_from_matrix = checked_function(_kernels.quaternion_from_matrix, _rotation.is_no_rotation, REFLECTION)

# Euler parameters
compose_quaternions = array_function(_kernels.compose_quaternions)
invert_quaternion = array_function(_kernels.invert_quaternion)
normalize = array_function(_kernels.normalize)
rotate = array_function(_kernels.rotate)
slerp = array_function(_kernels.slerp)
angle_between = array_function(_kernels.angle_between)
quaternion_rate_a = array_function(_kernels.quaternion_rate_a)
quaternion_rate_b = array_function(_kernels.quaternion_rate_b)
omega_a_from_quaternion_rate = array_function(_kernels.omega_a_from_quaternion_rate)
omega_b_from_quaternion_rate = array_function(_kernels.omega_b_from_quaternion_rate)

# Euler angles: the first argument is the sequence's name, such as "ZYX"
matrix_from_euler = sequence_function(_kernels.matrix_from_euler)
quaternion_from_euler = sequence_function(_kernels.quaternion_from_euler)
euler_from_matrix = sequence_function(
    _kernels.euler_from_matrix, _euler.matrix_has_no_three_angles, f"{AT_POLE}; or {REFLECTION}"
)
euler_from_quaternion = sequence_function(_kernels.euler_from_quaternion, _euler.quaternion_is_at_pole, AT_POLE)
euler_rate_matrix_a = sequence_function(_kernels.euler_rate_matrix_a)
euler_rate_matrix_b = sequence_function(_kernels.euler_rate_matrix_b)
euler_rate_a = sequence_function(_kernels.euler_rate_a, _kernels.euler_rate_is_singular, GIMBAL_LOCK)
euler_rate_b = sequence_function(_kernels.euler_rate_b, _kernels.euler_rate_is_singular, GIMBAL_LOCK)

# Rotation vectors, axis and angle
quaternion_from_rotvec = array_function(_kernels.quaternion_from_rotvec)
rotvec_from_quaternion = array_function(_kernels.rotvec_from_quaternion)
matrix_from_rotvec = array_function(_kernels.matrix_from_rotvec)
rotvec_from_matrix = checked_function(_kernels.rotvec_from_matrix, _rotation.is_no_rotation, REFLECTION)
quaternion_from_axis_angle = checked_function(
    _kernels.quaternion_from_axis_angle, _rotvec.axis_is_singular, NO_DIRECTION
)
matrix_from_axis_angle = checked_function(_kernels.matrix_from_axis_angle, _rotvec.axis_is_singular, NO_DIRECTION)
axis_angle_from_quaternion = array_function(_kernels.axis_angle_from_quaternion)
axis_angle_from_matrix = checked_function(_kernels.axis_angle_from_matrix, _rotation.is_no_rotation, REFLECTION)
rotvec_rate_a = checked_function(_kernels.rotvec_rate_a, _kernels.rotvec_rate_is_singular, FULL_TURN)
rotvec_rate_b = checked_function(_kernels.rotvec_rate_b, _kernels.rotvec_rate_is_singular, FULL_TURN)

# Gibbs (Rodrigues) parameters and modified ones
gibbs_from_quaternion = checked_function(_kernels.gibbs_from_quaternion, _kernels.gibbs_is_singular, HALF_TURN)
quaternion_from_gibbs = array_function(_kernels.quaternion_from_gibbs)
gibbs_rate_a = array_function(_kernels.gibbs_rate_a)
gibbs_rate_b = array_function(_kernels.gibbs_rate_b)
mrp_from_quaternion = array_function(_kernels.mrp_from_quaternion)
quaternion_from_mrp = array_function(_kernels.quaternion_from_mrp)
mrp_shadow = checked_function(_kernels.mrp_shadow, _kernels.mrp_is_singular, NO_SHADOW)
mrp_rate_a = array_function(_kernels.mrp_rate_a)
mrp_rate_b = array_function(_kernels.mrp_rate_b)

# The error of an attitude
attitude_error = array_function(_kernels.attitude_error)
attitude_error_rate = array_function(_kernels.attitude_error_rate)

# Velocities and accelerations
compose_omega = array_function(_kernels.compose_omega)
vector_rate = array_function(_kernels.vector_rate)
point_velocity = array_function(_kernels.point_velocity)
point_acceleration = array_function(_kernels.point_acceleration)

# Inertia
beam_inertia = checked_function(_kernels.beam_inertia, _inertia.is_negative, NEGATIVE)
box_inertia = checked_function(_kernels.box_inertia, _inertia.one_is_negative, NEGATIVE)
cylinder_inertia = checked_function(_kernels.cylinder_inertia, _inertia.cylinder_is_negative, NEGATIVE)
sphere_inertia = checked_function(_kernels.sphere_inertia, _inertia.is_negative, NEGATIVE)
ellipsoid_inertia = checked_function(_kernels.ellipsoid_inertia, _inertia.one_is_negative, NEGATIVE)
parallel_axis = array_function(_kernels.parallel_axis)
rotate_inertia = array_function(_kernels.rotate_inertia)
principal_axes = array_function(_kernels.principal_axes)

# Newton-Euler
euler_equation = array_function(_kernels.euler_equation)
newton_euler_c = array_function(_kernels.newton_euler_c)
newton_euler_o = array_function(_kernels.newton_euler_o)
inverse_newton_euler_c = array_function(_kernels.inverse_newton_euler_c)
inverse_newton_euler_o = array_function(_kernels.inverse_newton_euler_o)
linear_momentum = array_function(_kernels.linear_momentum)
angular_momentum = array_function(_kernels.angular_momentum)
angular_momentum_o = array_function(_kernels.angular_momentum_o)
kinetic_energy = array_function(_kernels.kinetic_energy)

# Homogeneous transforms, twists, wrenches
transform_from_matrix = array_function(_kernels.transform_from_matrix)
transform_compose = array_function(_kernels.transform_compose)
transform_invert = array_function(_kernels.transform_invert)
transform_point = array_function(_kernels.transform_point)
twist_at = array_function(_kernels.twist_at)
wrench_at = array_function(_kernels.wrench_at)
spatial_inertia = array_function(_kernels.spatial_inertia)

_LATER = ("check_inertia", "free_rotation", "inertia_of_points")

if not TYPE_CHECKING:  # type checkers see all names above; with `__getattr__` they would accept any other name too
    __all__ = ["set_threads", *_LATER]
    __all__ += [name for name, value in globals().items() if hasattr(value, "__wrapped__")]

    def __getattr__(name: str) -> Any:
        """Import functions that need more than a kernel at first use: free rotation takes as long as all the others."""
        if name not in _LATER:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module("rbfmu.arrays.bodies"), name)
        return value
