"""Array functions that are loaded when one of them is first used, so that all others start no later."""

from rbfmu.arrays.from_kernel import array_function, checked_function
from rbfmu_kernels.mechanics import rigid_body as _rigid_body
from rbfmu_kernels.rotations import quaternion as _quaternion
from rbfmu_kernels.rotations import rotation_vector as _rotvec

HALF_TURN = "some of these rotations are half a turn (|eta| < 4 eps |q|), which gives NaN"
NO_SHADOW = "some of these parameters are 0, whose shadow set is a full turn, which gives NaN"

# Gibbs (Rodrigues) parameters and modified ones
gibbs_from_quaternion = checked_function(_rotvec.gibbs_from_quaternion, _rotvec.gibbs_is_singular, HALF_TURN)
quaternion_from_gibbs = array_function(_rotvec.quaternion_from_gibbs)
gibbs_rate_a = array_function(_rotvec.gibbs_rate_a)
gibbs_rate_b = array_function(_rotvec.gibbs_rate_b)
mrp_from_quaternion = array_function(_rotvec.mrp_from_quaternion)
quaternion_from_mrp = array_function(_rotvec.quaternion_from_mrp)
mrp_shadow = checked_function(_rotvec.mrp_shadow, _rotvec.mrp_is_singular, NO_SHADOW)
mrp_rate_a = array_function(_rotvec.mrp_rate_a)
mrp_rate_b = array_function(_rotvec.mrp_rate_b)

# The error of an attitude
attitude_error = array_function(_quaternion.attitude_error)
attitude_error_rate = array_function(_quaternion.attitude_error_rate)

# Homogeneous transforms, twists, wrenches
transform_from_matrix = array_function(_rigid_body.transform_from_matrix)
transform_compose = array_function(_rigid_body.transform_compose)
transform_invert = array_function(_rigid_body.transform_invert)
transform_point = array_function(_rigid_body.transform_point)
twist_at = array_function(_rigid_body.twist_at)
wrench_at = array_function(_rigid_body.wrench_at)
spatial_inertia = array_function(_rigid_body.spatial_inertia)
