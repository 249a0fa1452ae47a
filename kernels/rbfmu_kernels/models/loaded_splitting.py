"""The model of a body with two equal moments by splitting: the loads' impulses between exact flows of the free body.

It serves loads that depend on the attitude alone, without damping, such as those of heavy tops.
"""

from typing import Any

from ..body.memory import COMMON, body_of, loads_of, motion_of, substep_of
from ..body.needs import has_unknown_load
from ..body.shell import commit_motion, entry_functions, feedthrough, output_rates, outputs
from ..buffer import STEP_REJECTED, places
from ..compile.decorator import kernel
from ..integrators.splitting import is_symmetric_top, resonant_step, rkn4_steps, rkn6_steps, strang_steps
from ..integrators.substeps import substeps_in
from ..rotations.vec3 import is_nonzero

__all__ = ["BLOCKS", "SIZE", "feedthrough", "initialize", "output_rates", "outputs", "step"]

ORDERS = (2, 4, 6)
BLOCKS, SIZE = places(COMMON | {"order": 1})

_ORDER = BLOCKS["order"].start
_NO_TOP, _RESONANT = 12, 13
"""The keys in `buffer.FAULTS`."""


@kernel
def _set_up(z: Any) -> int:
    body = body_of(z)
    if not is_symmetric_top(body.inertia) or is_nonzero(body.damping_b) or has_unknown_load(z):
        return _NO_TOP
    if substep_of(z) > 0.5 * resonant_step(body.inertia, motion_of(z).omega_b):
        return _RESONANT
    return 0


@kernel
def _advance(z: Any, h: float) -> int:
    """Advance by h at constant inputs; reject the step and change nothing where the result is not finite."""
    n = substeps_in(h, substep_of(z))
    if n == 0:
        return STEP_REJECTED
    part = h / n
    body, loads, motion, order = body_of(z), loads_of(z), motion_of(z), z[_ORDER]
    if order == 2.0:
        motion = strang_steps(motion, part, n, body, loads)
    elif order == 4.0:
        motion = rkn4_steps(motion, part, n, body, loads)
    else:
        motion = rkn6_steps(motion, part, n, body, loads)
    return commit_motion(z, motion)


initialize, step = entry_functions(__name__, _set_up, _advance)
