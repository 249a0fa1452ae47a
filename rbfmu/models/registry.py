"""All models, by the name that plans and FMUs have for them, from the smallest to the largest."""

from collections.abc import Iterator
from functools import partial
from itertools import takewhile

import numpy as np

from rbfmu.models.disturbances import lost_by_symmetry, lost_near_separatrix
from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.models.question import Question
from rbfmu.models.spec import ModelSpec
from rbfmu.types import Array
from rbfmu_kernels.quantities import (
    DISSIPATIVE,
    FIXED_IN_SPACE,
    FORCES,
    NOT_IN_CLOSED_FORMS,
    SPHERE_RATE,
    TORQUES,
    WEIGHTS,
    needing,
)

START = {"quaternion_0", "omega_b_0"}
closed_form = partial(ModelSpec, closed_form=True, force_keeps_direction=True, drops=NOT_IN_CLOSED_FORMS)


def moments_of(asked: Question) -> str:
    """Return the principal moments as text, kg m2."""
    return ", ".join(f"{m:.6g}" for m in asked.start.principal_axes[0])


def along_axis(asked: Question, rates: Array) -> Array:
    """Return the part of rates (n, 3), rad/s, about the one axis that the body is taken to turn about."""
    axis = np.array(asked.start.axis)
    return np.outer(rates @ axis, axis)


def loads_start_and_shape(asked: Question) -> set[str]:
    """Return the names of what a motion about one axis rests on."""
    return asked.would_turn | asked.shape | START


def _rate(asked: Question) -> str:
    return f"{float(np.linalg.norm(asked.scene.initial.omega_b)):.6g} rad/s"


def _acting(asked: Question) -> str:
    return " and ".join(sorted(asked.turning & asked.acting)) or "no torque"


def _no_rotation_rests_on(asked: Question) -> set[str]:
    turning = {"r_oc_b", "force_b"} if asked.attitude and any(asked.scene.initial.omega_b) else set()
    return (asked.turning | TORQUES | START | asked.shape if asked.rotation else set()) | turning


def _standing(asked: Question) -> str:
    if asked.attitude or not any(asked.scene.initial.omega_b):
        return "rotation: 0 of 7 states, the body begins at 0 rad/s and nothing turns it"
    return f"rotation: 0 of 7 states, the rates asked for stay as they begin ({_rate(asked)})"


NO_ROTATION = closed_form(
    "no rotation",
    "unturned.NO_ROTATION",
    "closed form",
    states=0,
    rate_states=0,
    holds=lambda start: not (start.needs_rate and start.begins_to_turn),
    rests_on=_no_rotation_rests_on,
    stands_still=True,
    keeps_rate=True,
    may_be_unstable=True,
    costs={"": 10.0, "changing": 5.0},
    reason=_standing,
)


def _constant_rate_rests_on(asked: Question) -> set[str]:
    M = asked.body.M
    sphere = M[0][0] == M[1][1] == M[2][2] and not any(M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))
    return asked.would_turn | asked.shape | (set() if sphere else {"omega_b_0"})


CONSTANT_RATE = closed_form(
    "constant rate",
    "free.CONSTANT_RATE",
    "closed form",
    states=4,
    rate_states=0,
    holds=lambda start: start.keeps_its_rate and not start.has_torque and not start.turns_path,
    rests_on=_constant_rate_rests_on,
    keeps_rate=True,
    may_be_unstable=True,
    rates_from=lambda asked, rates: rates[0],
    costs={"": 43.0},
    reason=lambda asked: (
        f"rotation: constant rate {_rate(asked)}, about a principal axis (moments {moments_of(asked)} kg m2)"
    ),
)


def _momentum_rests_on(asked: Question) -> set[str]:
    turning = asked.would_turn | ({"r_oc_b"} if asked.translation else set())
    shown = asked.shape if needing(SPHERE_RATE) & asked.quantities else set()
    return (turning - (TORQUES & FIXED_IN_SPACE)) | shown


ANGULAR_MOMENTUM = closed_form(
    "angular momentum",
    "unturned.ANGULAR_MOMENTUM",
    "closed form",
    states=3,
    rate_states=3,
    holds=lambda start: not start.has_turning_torque and not start.shows_more_than_momentum,
    rests_on=_momentum_rests_on,
    drops=DISSIPATIVE | NOT_IN_CLOSED_FORMS,
    costs={"": 35.0},
    reason=lambda asked: "rotation: 3 of 7 states, angular momentum h_0 + T t under torque_a, its attitude left out",
)

ONE_AXIS = closed_form(
    "one axis",
    "one_axis.ONE_AXIS",
    "closed form",
    states=2,
    rate_states=1,
    holds=lambda start: not start.is_swung and not start.leaves_axis,
    rests_on=loads_start_and_shape,
    may_be_unstable=True,
    angle_round_off=True,
    rates_from=along_axis,
    costs={"": 57.0, "attitude": 40.0},
    reason=lambda asked: f"rotation: one angle, closed form from {_rate(asked)} about one axis under {_acting(asked)}",
)

PENDULUM = closed_form(
    "undamped pendulum",
    "one_axis.PENDULUM",
    "elliptic functions",
    states=2,
    rate_states=2,
    holds=lambda start: not start.leaves_axis and not start.is_driven_or_damped,
    rests_on=loads_start_and_shape,
    drops=TORQUES | NOT_IN_CLOSED_FORMS,
    rates_from=along_axis,
    costs={"": 57.0},
    reason=lambda asked: f"rotation: one angle from {_rate(asked)}, swung by forces fixed in space, undamped",
)

FREE_SYMMETRIC = closed_form(
    "torque-free symmetric body",
    "free.FREE_SYMMETRIC",
    "elementary functions",
    rate_states=3,
    holds=lambda start: not start.is_driven and start.is_symmetric,
    rests_on=lambda asked: asked.would_turn | asked.shape,
    drops=TORQUES | FORCES | WEIGHTS,
    conditioning=lost_by_symmetry,
    costs={"": 46.0, "attitude": 14.0},
    reason=lambda asked: f"rotation: no torque, two equal moments ({moments_of(asked)} kg m2): elementary functions",
)


def _spins_up(start: BodyAtStart) -> bool:
    return not start.needs_attitude and not start.has_unknown_load and not start.leaves_third_axis


SPIN_UP = closed_form(
    "symmetric body spun up",
    "unturned.SPIN_UP",
    "closed form",
    rate_states=3,
    holds=_spins_up,
    rests_on=lambda asked: asked.would_turn | asked.shape | ({"r_oc_b"} if asked.attitude else set()),
    angle_round_off=True,
    costs={"": 93.0},
    reason=lambda asked: (
        f"rotation: rates in closed form from {_rate(asked)} under {_acting(asked)}, "
        f"two equal moments ({moments_of(asked)} kg m2)"
    ),
)

FREE_TRIAXIAL = closed_form(
    "torque-free body",
    "free.FREE_TRIAXIAL",
    "elliptic functions",
    rate_states=3,
    holds=lambda start: not start.is_driven,
    rests_on=lambda asked: asked.would_turn,
    drops=TORQUES | FORCES | WEIGHTS,
    conditioning=lost_near_separatrix,
    costs={"": 90.0},
    reason=lambda asked: f"rotation: no torque, moments {moments_of(asked)} kg m2: elliptic functions",
)

CLOSED_FORMS = (
    NO_ROTATION,
    CONSTANT_RATE,
    ANGULAR_MOMENTUM,
    ONE_AXIS,
    PENDULUM,
    FREE_SYMMETRIC,
    SPIN_UP,
    FREE_TRIAXIAL,
)
"""From the smallest to the largest: of two that serve a scene, planning takes the first."""


PRESCRIBED_RATES = ModelSpec(
    "prescribed rates",
    "prescribed_rates.PRESCRIBED_RATES",
    "exact rotation",
    states=4,
    rate_states=4,
    computes_all_outputs=True,
    costs={"": 96.0},
)

ONE_AXIS_TAYLOR = ModelSpec(
    "one swinging axis",
    "one_axis.ONE_AXIS_TAYLOR",
    states=2,
    rate_states=2,
    holds=lambda start: not start.leaves_axis,
    rests_on=loads_start_and_shape,
    force_keeps_direction=True,
    costs={"": 54.0},
)


def _force_rests_on(asked: Question) -> set[str]:
    return loads_start_and_shape(asked) | {"force_b", "mass"}


FREE_BODY_FORCE = ModelSpec(
    "torque-free body, body force",
    "free.FREE_BODY_FORCE",
    rate_states=3,
    holds=lambda start: not start.has_torque,
    rests_on=_force_rests_on,
    conditioning=lost_near_separatrix,
    costs={"": 68.0},
)

LOADED_SPLITTING = ModelSpec(
    "symmetric top",
    "loaded.LOADED_SPLITTING",
    holds=lambda start: start.is_symmetric and not start.is_damped and not start.has_unknown_load,
    costs={"": 72.0},
    integrates_path=True,
)

LOADED_TAYLOR = ModelSpec(
    "body under loads, by series",
    "loaded.LOADED_TAYLOR",
    rate_states=3,
    costs={"": 60.0, "evaluated": 40.0, "loads that turn": 68.0},
    substep_without_attitude=0.72,
    integrates_path=True,
)

FORMULAS = ModelSpec("formulas", "", integrates_path=True)
"""What a scene with formulas has for a model: its kernels are its own, see `models.formulas`."""

INTEGRATED = (
    ONE_AXIS_TAYLOR,
    PRESCRIBED_RATES,
    FREE_BODY_FORCE,
    LOADED_SPLITTING,
    LOADED_TAYLOR,
)
"""From the smallest to the largest. Planning chooses those that `planning.select` names; a plan may name any."""


MODELS: dict[str, ModelSpec] = {spec.key: spec for spec in (*CLOSED_FORMS, *INTEGRATED)}


def smaller_closed_forms(key: str) -> Iterator[ModelSpec]:
    """Return the models with a closed form that stand before the one named, all of them where it is none."""
    return takewhile(lambda spec: spec.key != key, CLOSED_FORMS)
