"""What outputs follow at once when inputs change: at a given state they are linear in the inputs."""

from typing import Any

from ..buffer_access import put_vec3_at, vec3_at
from ..compile.decorator import kernel
from .memory import BLOCKS, INPUTS, body_of, has_pivot, loads_at, rotation_of
from .outputs import accelerations

_INPUTS, _R_OC = BLOCKS[next(iter(INPUTS))].start, BLOCKS["r_oc_b"].start
_ACCELERATION, _ALPHA = BLOCKS["acceleration"].start, BLOCKS["alpha_b"].start
_AT_REST = (0.0, 0.0, 0.0)


@kernel(inline=False)
def feedthrough(z: Any, change: Any) -> int:
    """Set how much each output changes at once when the inputs change; z stays as it is.

    change: numbers in the places that they have in z, up to the outputs' end: the inputs' are those of the change, the
    outputs' must be 0 and are set. It is the derivative of `outputs` along the inputs' change, in closed form.
    """
    loads = loads_at(change, _INPUTS, has_pivot(z))
    alpha, acceleration = accelerations(rotation_of(z).q_ab, _AT_REST, body_of(z), loads, vec3_at(z, _R_OC))
    put_vec3_at(change, _ALPHA, alpha)
    put_vec3_at(change, _ACCELERATION, acceleration)
    return 0
