"""What is asked of a model: ports that may come to act, outputs that are computed, what those need of the motion."""

from typing import Any

from .. import quantities
from ..buffer_access import vec3_at
from ..compile.decorator import kernel
from ..rotations.vec3 import is_nonzero
from .memory import BLOCKS, INPUTS, OUTPUTS, has_pivot

_AT = {name: block.start for name, block in BLOCKS.items()}
_FORCE_B, _CONSTANT_FORCE_B, _R_OC = _AT["force_b"], _AT["constant_force_b"], _AT["r_oc_b"]
_SKIP_MODEL_CHECKS = _AT["skip_model_checks"]
PORTS = {name: _AT["ports"] + i for i, name in enumerate(INPUTS)}
"""The place of each port's flag in the buffer."""
_PORT_FORCE_B = PORTS["force_b"]
ACTIVE = {name: _AT["active"] + i for i, name in enumerate(OUTPUTS)}
"""The place of each output's flag in the buffer."""
_TRANSLATION, _PATH, _ATTITUDE, _RATE, _LEVER_RATE, _LOADS_NOW, _BODY_AXES, _SPHERE_RATE = (
    _AT["active"] + len(OUTPUTS) + i for i in range(len(quantities.NEEDS))
)
_UNKNOWN = tuple(
    (BLOCKS[name].start, BLOCKS[name].stop)
    for load in quantities.LOADS
    if not load.in_closed_forms
    for name in ((load.block, load.name) if load.port else (load.block,))
) or ((0, 0),)
"""The places of the loads that models with a closed form do not know."""


@kernel
def has_port(z: Any, flag: int) -> bool:
    """Return whether an input may come to act; flag: one of PORTS."""
    return bool(z[flag] != 0.0)


@kernel
def has_unknown_load(z: Any) -> bool:
    """Return whether a load acts that models with a closed form do not know."""
    for k in range(len(_UNKNOWN)):
        first, end = _UNKNOWN[k]
        for i in range(first, end):
            if z[i] != 0.0:
                return True
    return False


@kernel
def skips_model_checks(z: Any) -> bool:
    """Return whether a plan answers for the model; see `memory.SETTINGS`."""
    return bool(z[_SKIP_MODEL_CHECKS] != 0.0)


@kernel
def is_active(z: Any, flag: int) -> bool:
    """Return whether an output is computed; flag: one of ACTIVE."""
    return bool(z[flag] != 0.0)


@kernel
def needs_translation(z: Any) -> bool:
    """Return whether an output needs the position or velocity."""
    return bool(z[_TRANSLATION] != 0.0)


@kernel
def shows_loads(z: Any) -> bool:
    """Return whether an output changes at once when a load does."""
    return bool(z[_LOADS_NOW] != 0.0)


@kernel
def shows_rates(z: Any) -> bool:
    """Return whether an output is computed from the body's rate, be it only the velocity of a point."""
    return bool(z[_RATE] != 0.0 or z[_LEVER_RATE] != 0.0)


@kernel
def needs_attitude(z: Any) -> bool:
    """Return whether an output needs the attitude: itself, for a point off the centre of mass, or a turning force."""
    return bool(z[_ATTITUDE] != 0.0 or _shows_turning_path(z))


@kernel
def _shows_turning_path(z: Any) -> bool:
    body_force = (
        is_nonzero(vec3_at(z, _CONSTANT_FORCE_B)) or is_nonzero(vec3_at(z, _FORCE_B)) or has_port(z, _PORT_FORCE_B)
    )
    beside = body_force or is_nonzero(vec3_at(z, _R_OC))
    return bool(beside and not has_pivot(z) and z[_PATH] != 0.0)


@kernel
def shows_more_than_momentum(z: Any, is_sphere: bool) -> bool:
    """Return whether an output needs the attitude besides the angular momentum in a; a sphere's omega_a does not."""
    return bool(z[_BODY_AXES] != 0.0 or (z[_SPHERE_RATE] != 0.0 and not is_sphere) or _shows_turning_path(z))


@kernel
def needs_rate(z: Any) -> bool:
    """Return whether an output needs the body's rate."""
    return bool(needs_attitude(z) or z[_RATE] != 0.0)
