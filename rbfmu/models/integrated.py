"""The models that integrate some of the motion, and that of prescribed rates: their specifications."""

from rbfmu.models.closed_forms import loads_start_and_shape
from rbfmu.models.conditioning import lost_near_separatrix
from rbfmu.models.scene_needs import Needs
from rbfmu.models.spec import ModelSpec
from rbfmu.scene.scene import Scene

PRESCRIBED_RATES = ModelSpec(
    "prescribed rates",
    "prescribed_rates",
    "exact rotation",
    states=4,
    rate_states=4,
    computes_all_outputs=True,
    costs={"": 96.0},
)

ONE_AXIS_TAYLOR = ModelSpec(
    "one swinging axis",
    "one_axis_taylor",
    states=2,
    rate_states=2,
    holds=lambda start: not start.leaves_axis,
    rests_on=loads_start_and_shape,
    force_keeps_direction=True,
    costs={"": 54.0},
)


def _force_rests_on(scene: Scene, needs: Needs) -> set[str]:
    return loads_start_and_shape(scene, needs) | {"force_b", "mass"}


FREE_BODY_FORCE = ModelSpec(
    "torque-free body, body force",
    "free_body_force",
    rate_states=3,
    holds=lambda start: not start.has_torque,
    rests_on=_force_rests_on,
    conditioning=lost_near_separatrix,
    costs={"": 68.0},
)

LOADED_SPLITTING = ModelSpec(
    "symmetric top",
    "loaded_splitting",
    holds=lambda start: start.is_symmetric and not start.is_damped and not start.has_unknown_load,
    costs={"": 72.0},
    integrates_path=True,
)

LOADED_DOP853 = ModelSpec("body under loads", "loaded_dop853")

LOADED_TAYLOR = ModelSpec(
    "body under loads, by series",
    "loaded_taylor",
    rate_states=3,
    costs={"": 60.0, "evaluated": 40.0, "loads that turn": 68.0},
    substep_without_attitude=0.72,
    integrates_path=True,
)

INTEGRATED = (
    ONE_AXIS_TAYLOR,
    PRESCRIBED_RATES,
    FREE_BODY_FORCE,
    LOADED_SPLITTING,
    LOADED_DOP853,
    LOADED_TAYLOR,
)
"""From the smallest to the largest. Planning chooses those that `planning.select` names; a plan may name any."""
