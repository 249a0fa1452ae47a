"""Array functions that are loaded when one of them is first used, so that all others start no later."""

from rbfmu.arrays.from_kernel import array_function, checked_function
from rbfmu_kernels.mechanics import spatial as _spatial
from rbfmu_kernels.rotations import attitude_error as _error
from rbfmu_kernels.rotations import rodrigues as _rodrigues

HALF_TURN = "some of these rotations are half a turn (|eta| < 4 eps |q|), which gives NaN"
NO_SHADOW = "some of these parameters are 0, whose shadow set is a full turn, which gives NaN"

# Gibbs (Rodrigues) parameters and modified ones
gibbs_from_quaternion = checked_function(_rodrigues.gibbs_from_quaternion, _rodrigues.gibbs_is_singular, HALF_TURN)
quaternion_from_gibbs = array_function(_rodrigues.quaternion_from_gibbs)
gibbs_rate_a = array_function(_rodrigues.gibbs_rate_a)
gibbs_rate_b = array_function(_rodrigues.gibbs_rate_b)
mrp_from_quaternion = array_function(_rodrigues.mrp_from_quaternion)
quaternion_from_mrp = array_function(_rodrigues.quaternion_from_mrp)
mrp_shadow = checked_function(_rodrigues.mrp_shadow, _rodrigues.mrp_is_singular, NO_SHADOW)
mrp_rate_a = array_function(_rodrigues.mrp_rate_a)
mrp_rate_b = array_function(_rodrigues.mrp_rate_b)

# The error of an attitude
attitude_error = array_function(_error.attitude_error)
attitude_error_rate = array_function(_error.attitude_error_rate)

# Homogeneous transforms, twists, wrenches
transform_from_matrix = array_function(_spatial.transform_from_matrix)
transform_compose = array_function(_spatial.transform_compose)
transform_invert = array_function(_spatial.transform_invert)
transform_point = array_function(_spatial.transform_point)
twist_at = array_function(_spatial.twist_at)
wrench_at = array_function(_spatial.wrench_at)
spatial_inertia = array_function(_spatial.spatial_inertia)
