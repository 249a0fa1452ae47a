"""All models by their public names, from the smallest to the largest, with their properties."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.models.question import Question
from rbfmu_kernels import quantities
from rbfmu_kernels.body import principal, shell
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.exact.free_rotation_setup import polhode_axes
from rbfmu_kernels.models import model_named
from rbfmu_kernels.numerics.double_double import DoubleDouble, Vector
from rbfmu_kernels.types import Array, Vec3

Names = set[str] | frozenset[str]
OF_RATES, OF_ATTITUDE, OF_LOADS = map(quantities.needing, (quantities.RATE, quantities.ATTITUDE, quantities.LOADS_NOW))
OF_INERTIA = {row.name for row in quantities.OUTPUTS if "inertia" in row.initially} - OF_LOADS
"""Quantities that depend on moments of inertia at the start, whatever the loads."""
TWICE = 2.0**-100
"""The relative error of double-double arithmetic, with room for its growth in a flip."""


@dataclass(frozen=True)
class ModelSpec:
    """A model: the kernels that run it, the scenes that it is valid for, its cost, and why it is chosen.

    Only `key` and `module` are needed for a model that a plan names; planning itself chooses those with `holds`.

    key: the public name, `Plan.model`.
    module: its kernels in `rbfmu_kernels.models`, as an argument of `models.model_named`, which loads them when used.
    method: how the motion is computed; empty if the plan's settings say it.
    states, rate_states: how many numbers describe the rotation, with and without the attitude; constant ones do not
    count.
    holds: whether it is valid for the scene's values with ports at zero, as checked by the kernels' `initialize`.
    rests_on: the names of the loads and parameters that must not vary.
    drops: the loads that it neglects if they are too small to matter.
    closed_form: whether a formula gives the motion at any time.
    force_keeps_direction: whether a force fixed in b keeps its first direction in a.
    may_be_unstable: whether a disturbance of its motion may grow; then a reason says so.
    angle_round_off: whether its angle is a double, whose round-off grows with the angle.
    rates_from: computes its rates from those of a larger model (n, 3), rad/s; None if it takes a run.
    conditioning: the error, rad, caused by round-off of the body's moments, or of the modulus of elliptic functions.
    costs: ns a communication step, by what requires it; "" always counts; see `planning.methods`.
    integrates_path: whether the path is part of the integration, without additional cost.
    reason: why it is exact.
    """

    key: str
    module: str
    method: str = ""
    states: int = 7
    rate_states: int = 7
    holds: Callable[[BodyAtStart], bool] = lambda start: True
    rests_on: Callable[[Question], Names] = lambda asked: frozenset()
    drops: Names = frozenset()
    closed_form: bool = False
    force_keeps_direction: bool = False
    may_be_unstable: bool = False
    angle_round_off: bool = False
    rates_from: Callable[[Question, Array], Array] | None = None
    conditioning: Callable[[Question], float] = lambda asked: 0.0
    costs: Mapping[str, float] = field(default_factory=dict)
    integrates_path: bool = False
    reason: Callable[[Question], str] = lambda asked: ""

    @property
    def kernels(self) -> shell.Model:
        """Return the kernels that run it."""
        return model_named(self.module)

    def serves(self, asked: Question) -> bool:
        """Return whether the model is valid, whatever ports supply and listed parameters become."""
        return not self.rests_on(asked) & asked.varying and self.accepts(asked)

    def accepts(self, asked: Question) -> bool:
        """Return whether the model is valid for the scene's values, as checked by the kernels' `initialize`."""
        return asked.start.fault == 0 and self.holds(asked.start)

    def states_for(self, asked: Question) -> int:
        """Return the number of states for what a question needs."""
        return (self.states if asked.attitude else self.rate_states) + (6 if asked.translation else 0)

    def needed_parameters(self, asked: Question) -> set[str]:
        """Return the names of the parameters that are listed, and of those on which an output of this model depends."""
        if asked.scene.body is None:
            return {"quaternion_0"}
        inputs = asked.scene.inputs
        body, wanted, ports, listed = asked.body, asked.quantities, set(inputs.ports), set(inputs.parameters)
        beside = any(body.r_oc_b) or "r_oc_b" in listed
        moving = asked.translation or (not body.pivot and "acceleration" in wanted)
        angular = "alpha_b" in wanted or (moving and beside and "acceleration" in wanted)
        driven = asked.rotation and (angular or self.rate_states)
        turning = asked.turning - (set() if angular else self.drops) if driven else set()
        pushing = quantities.FORCES | quantities.WEIGHTS if moving else set()
        acting = asked.acting & (turning | pushing)
        turned = self.states or wanted & {"position", "acceleration", "kinetic_energy"}
        swung = moving and beside and bool(turned)
        pushes = (acting | ports | listed) & quantities.FORCES if moving else set()
        by_space = turning & quantities.FIXED_IN_SPACE
        shaped = bool(driven or wanted & OF_INERTIA)
        swings = body.pivot and (shaped or "inertia" in listed)
        needed = {
            "inertia": shaped,
            "mass": (shaped and body.pivot and beside) or pushes or (moving and "kinetic_energy" in wanted),
            "r_oc_b": any(body.r_oc_b) and (swung or "r_oc_b" in turning or swings),
            "omega_b_0": asked.rotation and (swung or self.states or wanted & OF_RATES),
            "quaternion_0": asked.attitude and (by_space or swung or "force_b" in pushes or wanted & OF_ATTITUDE),
            "velocity_0": asked.translation,
            "position_0": "position" in wanted,
        }
        return listed | (acting - ports) | {name for name, is_needed in needed.items() if is_needed}


# Errors of exact motions by round-off of the moments


def lost_near_separatrix(asked: Question) -> float:
    """Return the error, rad, of the distance from the separatrix in double-double arithmetic, added over all flips.

    It is 0 for a diagonal inertia matrix.
    """
    if not _is_full(asked):
        return 0.0
    from rbfmu_kernels.exact.free_rotation import free_rotation_of  # a large module that few scenes need

    moments, axes = interpreted(principal.exact_frame)(asked.start.z)
    rates = interpreted(principal.rates_along)(axes, asked.scene.initial.omega_b)
    motion = interpreted(free_rotation_of)(moments, (1.0, 0.0, 0.0, 0.0), rates)
    half_turns = 2.0 * float(abs(motion.unit * motion.phase_rate[0])) * asked.span
    return half_turns * _lost_distance(moments, rates, asked.scene.initial.omega_b)


def lost_at_the_top(asked: Question) -> float:
    """Return the error, rad, of a pendulum near the separatrix by round-off of its modulus, see `pendulum_at`."""
    from rbfmu_kernels.exact.pendulum import half_angle_rates  # a large module as well

    x, z = interpreted(half_angle_rates)(*asked.start.swing)
    y = 0.5 * float(np.dot(asked.start.axis, asked.scene.initial.omega_b))
    w_0, fastest = math.hypot(x[0], z[0]), math.hypot(x[0], max(abs(y), z[0]))
    gap = abs((z[0] - abs(y)) + z[1])  # known to 1e-32 w_0; the square of the modulus is its product with z + |y|
    return 0.5e-32 * w_0 * asked.span * (fastest / gap) if gap > 0.0 else 0.0


def lost_by_symmetry(asked: Question) -> float:
    """Return the error, rad, of two moments that count as equal but differ; 0 if they are equal.

    It is their difference over the least moment, times the angle of rotation, times 1 plus the angle until the rate
    across the axis has turned within the body. Until then it turns the body about its axis, faster if that is thin.
    """
    omega, span = asked.scene.initial.omega_b, asked.span
    moments, axes = interpreted(principal.exact_frame)(asked.start.z)
    low, middle, high = sorted(range(3), key=lambda k: moments[k])
    below, above = _difference(moments[middle], moments[low]), _difference(moments[high], moments[middle])
    gap, s = (below, high) if below <= above else (above, low)
    if gap == 0.0 or moments[low][0] <= 0.0:
        return gap * math.inf if gap else 0.0
    rate = interpreted(principal.rates_along)(axes, omega)[s][0]
    own = abs(rate * _difference(moments[s], moments[middle])) / moments[middle][0]
    speed = _speed(omega)
    return gap / moments[low][0] * speed * span * (1.0 + speed * min(span, 1.0 / own if own else math.inf))


def _speed(omega: Vec3) -> float:
    return math.sqrt(sum(w * w for w in omega))


def _lost_distance(moments: Vector, rates: Vector, omega: Vec3) -> float:
    """Return the relative round-off error of L^2 - 2 T I_r, I_r the middle moment, which is 0 on the separatrix."""
    *axes, distance, unit = interpreted(polhode_axes)(moments, rates)
    p, r, s = map(int, axes)
    levers = sum(abs(rates[k][0]) * moments[k][0] * abs(_difference(moments[k], moments[r])) for k in (p, s))
    exact = float(distance[0] * unit * unit)
    return TWICE * _speed(omega) * levers / exact if exact > 0.0 else 0.0


def _difference(a: DoubleDouble, b: DoubleDouble) -> float:
    return (a[0] - b[0]) + (a[1] - b[1])


def _is_full(asked: Question) -> bool:
    return asked.body.pivot or any(asked.body.M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))


# The models


START = {"quaternion_0", "omega_b_0"}
_ALL_LOADS = quantities.TORQUES | quantities.FORCES | quantities.WEIGHTS
closed_form = partial(
    ModelSpec, method="closed form", closed_form=True, force_keeps_direction=True, drops=quantities.NOT_IN_CLOSED_FORMS
)


def moments_text(asked: Question) -> str:
    """Return the principal moments as text, kg m2."""
    return ", ".join(f"{m:.6g}" for m in asked.start.principal_axes[0])


def along_axis(asked: Question, rates: Array) -> Array:
    """Return the part (n, 3) of rates, rad/s, about the model's one axis of rotation."""
    axis = np.array(asked.start.axis)
    return np.outer(rates @ axis, axis)


def loads_start_and_shape(asked: Question) -> set[str]:
    """Return the names of all that a motion about one axis depends on."""
    return asked.would_turn | asked.shape | START


def _rate(asked: Question) -> str:
    return f"{float(np.linalg.norm(asked.scene.initial.omega_b)):.6g} rad/s"


def _torques(asked: Question) -> str:
    return " and ".join(sorted(asked.turning & asked.acting)) or "no torque"


def _no_rotation_rests_on(asked: Question) -> set[str]:
    turning = {"r_oc_b", "force_b"} if asked.attitude and any(asked.scene.initial.omega_b) else set()
    return (asked.turning | quantities.TORQUES | START | asked.shape if asked.rotation else set()) | turning


def _reason_of_no_rotation(asked: Question) -> str:
    if asked.attitude or not any(asked.scene.initial.omega_b):
        return "rotation: 0 of 7 states, the body begins at 0 rad/s and nothing turns it"
    return f"rotation: 0 of 7 states, the rates asked for stay as they begin ({_rate(asked)})"


NO_ROTATION = closed_form(
    "no rotation", "unturned.NO_ROTATION", states=0, rate_states=0, costs={"": 10.0, "changing": 8.0},
    holds=lambda start: not (start.needs_rate and start.begins_to_turn), rests_on=_no_rotation_rests_on,
    may_be_unstable=True, reason=_reason_of_no_rotation,
)  # fmt: skip


def _constant_rate_rests_on(asked: Question) -> set[str]:
    return asked.would_turn | asked.shape | (set() if asked.start.is_sphere else {"omega_b_0"})


CONSTANT_RATE = closed_form(
    "constant rate", "free.CONSTANT_RATE", states=4, rate_states=0, costs={"": 43.0},
    holds=lambda start: start.keeps_its_rate and not start.has_torque and not start.turns_path,
    rests_on=_constant_rate_rests_on, may_be_unstable=True, rates_from=lambda asked, rates: rates[0],
    reason=lambda asked:
        f"rotation: constant rate {_rate(asked)}, about a principal axis (moments {moments_text(asked)} kg m2)",
)  # fmt: skip


def _momentum_rests_on(asked: Question) -> set[str]:
    turning = asked.would_turn | ({"r_oc_b"} if asked.translation else set())
    shown = asked.shape if quantities.needing(quantities.SPHERE_RATE) & asked.quantities else set()
    return (turning - (quantities.TORQUES & quantities.FIXED_IN_SPACE)) | shown


ANGULAR_MOMENTUM = closed_form(
    "angular momentum", "unturned.ANGULAR_MOMENTUM", states=3, rate_states=3, costs={"": 35.0},
    holds=lambda start: not start.has_turning_torque and not start.shows_more_than_momentum,
    rests_on=_momentum_rests_on, drops=quantities.DISSIPATIVE | quantities.NOT_IN_CLOSED_FORMS,
    reason=lambda asked: "rotation: 3 of 7 states, angular momentum h_0 + T t under torque_a, its attitude left out",
)  # fmt: skip

ONE_AXIS = closed_form(
    "one axis", "one_axis.ONE_AXIS", states=2, rate_states=1, costs={"": 29.0, "attitude": 18.0},
    holds=lambda start: not any(part[0] for part in start.swing) and not start.leaves_axis,
    rests_on=loads_start_and_shape, may_be_unstable=True, angle_round_off=True, rates_from=along_axis,
    reason=lambda asked: f"rotation: one angle, closed form from {_rate(asked)} about one axis under {_torques(asked)}",
)  # fmt: skip

PENDULUM = closed_form(
    "undamped pendulum", "one_axis.PENDULUM", method="elliptic functions", states=2, rate_states=2, costs={"": 57.0},
    holds=lambda start: not start.leaves_axis and not any(start.drive_and_damping),
    rests_on=loads_start_and_shape, drops=quantities.TORQUES | quantities.NOT_IN_CLOSED_FORMS, rates_from=along_axis,
    conditioning=lost_at_the_top,
    reason=lambda asked: f"rotation: one angle from {_rate(asked)}, swung by forces fixed in space, undamped",
)  # fmt: skip

FREE_SYMMETRIC = closed_form(
    "torque-free symmetric body", "free.FREE_SYMMETRIC", method="elementary functions", rate_states=3,
    costs={"": 46.0, "attitude": 14.0}, holds=lambda start: not start.is_driven and start.is_symmetric,
    rests_on=lambda asked: asked.would_turn | asked.shape, drops=_ALL_LOADS, conditioning=lost_by_symmetry,
    reason=lambda asked: f"rotation: no torque, two equal moments ({moments_text(asked)} kg m2): elementary functions",
)  # fmt: skip


SPIN_UP = closed_form(
    "symmetric body spun up", "unturned.SPIN_UP", rate_states=3, costs={"": 48.0}, angle_round_off=True,
    holds=lambda start: not (
        start.needs_attitude or start.has_unknown_load or start.is_slender or start.leaves_third_axis
    ),
    rests_on=lambda asked: asked.would_turn | asked.shape | ({"r_oc_b"} if asked.attitude else set()),
    reason=lambda asked:
        f"rotation: rates in closed form from {_rate(asked)} under {_torques(asked)}, "
        f"two equal moments ({moments_text(asked)} kg m2)",
)  # fmt: skip

FREE_TRIAXIAL = closed_form(
    "torque-free body", "free.FREE_TRIAXIAL", method="elliptic functions", rate_states=3, costs={"": 90.0},
    holds=lambda start: not start.is_driven, rests_on=lambda asked: asked.would_turn, drops=_ALL_LOADS,
    conditioning=lost_near_separatrix,
    reason=lambda asked: f"rotation: no torque, moments {moments_text(asked)} kg m2: elliptic functions",
)  # fmt: skip

CLOSED_FORMS = (
    NO_ROTATION, CONSTANT_RATE, ANGULAR_MOMENTUM, ONE_AXIS, PENDULUM, FREE_SYMMETRIC, SPIN_UP, FREE_TRIAXIAL,
)  # fmt: skip
"""From the smallest to the largest: planning chooses the first that is valid for a scene."""


PRESCRIBED_RATES = ModelSpec(
    "prescribed rates", "prescribed_rates.PRESCRIBED_RATES", method="exact rotation", states=4, rate_states=4,
    costs={"": 96.0},
)  # fmt: skip

ONE_AXIS_TAYLOR = ModelSpec(
    "one swinging axis", "one_axis.ONE_AXIS_TAYLOR", states=2, rate_states=2, costs={"": 54.0},
    holds=lambda start: not start.leaves_axis, rests_on=loads_start_and_shape, force_keeps_direction=True,
)  # fmt: skip

FREE_BODY_FORCE = ModelSpec(
    "torque-free body, body force", "free.FREE_BODY_FORCE", rate_states=3, costs={"": 68.0},
    holds=lambda start: not start.has_torque, conditioning=lost_near_separatrix,
    rests_on=lambda asked: loads_start_and_shape(asked) | {"force_b", "mass"},
)  # fmt: skip

LOADED_SPLITTING = ModelSpec(
    "symmetric top", "loaded.LOADED_SPLITTING", costs={"": 72.0}, integrates_path=True,
    holds=lambda start: start.is_symmetric and not any(start.body.damping_b) and not start.has_unknown_load,
)  # fmt: skip

LOADED_TAYLOR = ModelSpec(
    "body under loads, by series", "loaded.LOADED_TAYLOR", rate_states=3, integrates_path=True,
    costs={"": 49.0, "evaluated path": 25.0, "loads that turn": 68.0},
)  # fmt: skip

FORMULAS = ModelSpec("formulas", "", integrates_path=True)
"""The model of a scene with formulas; its kernels are generated, see `models.formulas`."""

INTEGRATED = (ONE_AXIS_TAYLOR, PRESCRIBED_RATES, FREE_BODY_FORCE, LOADED_SPLITTING, LOADED_TAYLOR)
"""From the smallest to the largest. Planning chooses those that `planning.select` names; a plan may name any."""


MODELS: dict[str, ModelSpec] = {spec.key: spec for spec in (*CLOSED_FORMS, *INTEGRATED)}
