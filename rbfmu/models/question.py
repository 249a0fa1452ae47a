"""The question that planning answers: what a scene asks, what varies, the body at the start, and how errors grow.

Each is found once: a question is made of a scene and passed on; who plans, judges or explains asks it and not the scene
again. Errors grow by what exact motions lose by the round-off of the body's moments, and as a disturbance does.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.scene.body import Body
from rbfmu.scene.scene import PARAMETERS, Scene
from rbfmu.scene.section import flattened
from rbfmu.types import Array
from rbfmu_kernels.body.principal import exact_frame, rates_along
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.exact.free_rotation_setup import polhode_axes
from rbfmu_kernels.numerics.double_double import DoubleDouble, Vector
from rbfmu_kernels.quantities import FIXED_IN_SPACE, FORCES, IN_BUFFER_ORDER, LOADS, OUTPUT, TORQUES, WEIGHTS
from rbfmu_kernels.rotations.quaternion import rotate
from rbfmu_kernels.rotations.vec3 import cross
from rbfmu_kernels.types import Vec3

if TYPE_CHECKING:
    from rbfmu.models.formulas import FormulaModel

GROWING = {row.name for row in IN_BUFFER_ORDER if row.grows}
"""Loads and parameters with which positions, velocities, accelerations and energy grow."""
GROWTH = 0.1
"""The exponent of a disturbance's growth over the run from which on a spin counts as unstable."""
TWICE = 2.0**-100
"""The relative error that double-double leaves, with room for what a flip makes of it."""


@dataclass(frozen=True)
class Question:
    """What a scene asks of a model: quantities, an accuracy, and which inputs and parameters stay open."""

    scene: Scene

    @property
    def body(self) -> Body:
        """Return the scene's body, which all have but those whose rates are prescribed."""
        assert self.scene.body is not None
        return self.scene.body

    @cached_property
    def start(self) -> BodyAtStart:
        """Return the answers of the kernels about the body at the start."""
        return BodyAtStart(self.scene)

    @cached_property
    def formulas(self) -> "FormulaModel | None":
        """Return the model of the scene's formulas, None where it has none."""
        if not self.scene.has_formulas:
            return None
        from rbfmu.models.formulas import equations_of  # what has none starts sooner

        return equations_of(self.scene)

    # What is asked

    @property
    def accuracy(self) -> float:
        """Return the error that any quantity may have, rad or relative."""
        return self.scene.run.accuracy

    @property
    def span(self) -> float:
        """Return the length of the run, s."""
        return self.scene.run.stop - self.scene.run.start

    @cached_property
    def quantities(self) -> frozenset[str]:
        """Return the outputs asked for."""
        return frozenset(self.scene.outputs.quantities)

    @cached_property
    def judged(self) -> tuple[str, ...]:
        """Return blocks that show every quantity asked for, and what states of one's own these come of.

        Roll, pitch and yaw count as the attitude that they describe.
        """
        shown = self.scene.outputs
        known = dict.fromkeys(OUTPUT[name].judged_by or name for name in shown.quantities)
        known |= dict.fromkeys((*shown.own, *(f"when.{name}" for name in self.scene.events)))
        read = self.formulas.own_states if self.scene.states and self.formulas else ()
        return (*known, *(f"states.{name}" for name in read))

    # What varies

    @cached_property
    def varying(self) -> frozenset[str]:
        """Return the names of loads and parameters whose values are not known when the scene is planned."""
        return frozenset((*self.scene.inputs.ports, *self.scene.inputs.parameters))

    @property
    def pinned(self) -> tuple[str, ...]:
        """Return the parameters on whose values a pilot run or a comparison rests: all but those listed."""
        own = (*self.scene.constants, *(f"{name}_0" for name in self.scene.states))
        return tuple(name for name in (*PARAMETERS, *own) if name not in self.scene.inputs.parameters)

    # Degrees of freedom that the outputs depend on, by the kernels' own rules, and by what varies

    @cached_property
    def translation(self) -> bool:
        """Return whether the path is needed."""
        return self.start.needs_translation and not self.start.has_pivot

    @cached_property
    def rotation(self) -> bool:
        """Return whether the rates are needed."""
        return self.start.needs_rate or self._shows_attitude

    @cached_property
    def attitude(self) -> bool:
        """Return whether the attitude is needed: an output shows it, or a load fixed in space turns the body."""
        return self._shows_attitude or (self.rotation and bool(self.turning & FIXED_IN_SPACE))

    @property
    def _shows_attitude(self) -> bool:
        moved = self.translation or (not self.start.has_pivot and "acceleration" in self.quantities)
        return self.start.needs_attitude or (moved and bool(self.varying & {"r_oc_b", "force_b"}))

    # What acts

    @cached_property
    def acting(self) -> frozenset[str]:
        """Return the names of the known loads that are not zero."""
        loads = self.scene.loads
        return frozenset(row.name for row in LOADS if any(flattened(getattr(loads, row.name))))

    @cached_property
    def turning(self) -> set[str]:
        """Return the names of loads that act, or may come to act, and then turn the body, and of the arm of these."""
        body, varying, acting = self.body, self.varying, self.acting | self.varying
        levers = acting & (WEIGHTS if body.pivot else FORCES)
        arm = any(body.r_oc_b) or "r_oc_b" in varying
        force = self.scene.loads.force_b
        if not varying & {"force_b", "r_oc_b"} and not any(interpreted(cross)(body.r_oc_b, force)):
            levers -= {"force_b"}
        return {*(acting & TORQUES), *(levers | {"r_oc_b"} if arm and levers else ())}

    @property
    def would_turn(self) -> set[str]:
        """Return the names of what would turn the body, or a force with it, if it came to act."""
        return self.turning | TORQUES | (FORCES - FIXED_IN_SPACE if self.translation else set())

    @property
    def shape(self) -> set[str]:
        """Return the names of the parameters that the moments about the centre of mass, or the pivot, follow from."""
        return {"inertia"} | ({"mass", "r_oc_b"} if self.body.pivot else set())

    @cached_property
    def load_shares(self) -> tuple[float, float]:
        """Return, as 0 or 1, whether loads may turn in b, and a force with a body whose path is asked for."""
        start, varying = self.start, self.varying
        levered = any(start.body.arm_b) and (any(start.loads.force_a) or "force_a" in varying)
        turned = levered or any(start.loads.torque_a) or "torque_a" in varying
        body_force = any(start.loads.force_b) or ("force_b" in varying and not start.has_pivot)
        return float(turned), float(body_force and start.needs_translation)


# What exact motions lose by the round-off of the moments


def lost_near_separatrix(asked: Question) -> float:
    """Return the error, rad, that double-double makes by the distance from the separatrix, added over all flips.

    It is 0 for a diagonal matrix.
    """
    if not _is_full(asked):
        return 0.0
    from rbfmu_kernels.exact.free_rotation import free_rotation_of  # large, and few scenes need it

    moments, axes = interpreted(exact_frame)(asked.start.z)
    rates = interpreted(rates_along)(axes, asked.scene.initial.omega_b)
    motion = interpreted(free_rotation_of)(moments, (1.0, 0.0, 0.0, 0.0), rates)
    half_turns = 2.0 * float(abs(motion.unit * motion.phase_rate[0])) * asked.span
    return half_turns * _lost_distance(moments, rates, asked.scene.initial.omega_b)


def lost_by_symmetry(asked: Question) -> float:
    """Return the error, rad, of taking a body as symmetric whose two moments differ; 0 for a diagonal matrix.

    It is that difference over the least moment, times the angle, times 1 plus the angle before the rate across the axis
    has turned within the body: until then that rate turns the body about its axis, the faster the thinner it is.
    """
    M, omega, span = asked.body.M, asked.scene.initial.omega_b, asked.span
    if not _is_full(asked) and len({M[0][0], M[1][1], M[2][2]}) < 3:
        return 0.0
    moments, axes = interpreted(exact_frame)(asked.start.z)
    low, middle, high = sorted(range(3), key=lambda k: moments[k])
    below, above = _difference(moments[middle], moments[low]), _difference(moments[high], moments[middle])
    gap, s = (below, high) if below <= above else (above, low)
    if gap == 0.0 or moments[low][0] <= 0.0:
        return gap * math.inf if gap else 0.0
    rate = interpreted(rates_along)(axes, omega)[s][0]
    own = abs(rate * _difference(moments[s], moments[middle])) / moments[middle][0]
    speed = _speed(omega)
    return gap / moments[low][0] * speed * span * (1.0 + speed * min(span, 1.0 / own if own else math.inf))


def _speed(omega: Vec3) -> float:
    return math.sqrt(sum(w * w for w in omega))


def _lost_distance(moments: Vector, rates: Vector, omega: Vec3) -> float:
    """Return the relative error of L^2 - 2 T I_r, I_r the middle moment, which is 0 on the separatrix."""
    *axes, distance, unit = interpreted(polhode_axes)(moments, rates)
    p, r, s = map(int, axes)
    levers = sum(abs(rates[k][0]) * moments[k][0] * abs(_difference(moments[k], moments[r])) for k in (p, s))
    exact = float(distance[0] * unit * unit)
    return TWICE * _speed(omega) * levers / exact if exact > 0.0 else 0.0


def _difference(a: DoubleDouble, b: DoubleDouble) -> float:
    return (a[0] - b[0]) + (a[1] - b[1])


def _is_full(asked: Question) -> bool:
    M = asked.body.M
    return asked.body.pivot or any(M[i][j] for i, j in ((0, 1), (0, 2), (1, 2)))


# How fast a disturbance grows


def growth_rate(asked: Question) -> float:
    """Return how fast a disturbance of the motion at the start grows, 1/s; 0 where it is stable.

    It is omega sqrt((I_k - I_i) (I_j - I_k) / (I_i I_j)) for a free spin about the middle axis, and
    sqrt(4 I_t m g l - (I_s omega_s)^2) / (2 I_t) for a body spinning at omega_s with its centre of mass above a pivot.
    """
    moments, R = asked.start.principal_axes
    arm, rates = R.T @ np.array(asked.body.r_oc_b), R.T @ np.array(asked.scene.initial.omega_b)
    if asked.body.pivot and any(asked.scene.loads.gravity_a) and any(asked.body.r_oc_b):
        return _growth_above_pivot(asked, moments, int(np.argmax(np.abs(arm))), rates)
    if int(np.argmax(np.abs(rates))) != 1 or moments[0] == 0.0:
        return 0.0
    low, middle, high = moments
    return float(abs(rates[1]) * math.sqrt((middle - low) * (high - middle) / (low * high)))


def _growth_above_pivot(asked: Question, moments: Array, own: int, rates: Array) -> float:
    """Return the same above a pivot; own: the principal axis that the centre of mass is nearest to."""
    body, up = asked.body, -np.array(asked.scene.loads.gravity_a)
    if float(np.dot(interpreted(rotate)(asked.scene.initial.quaternion, body.r_oc_b), up)) <= 0.0:
        return 0.0
    least = float(np.min(np.delete(moments, own)))
    spin = float(moments[own] * rates[own])
    weight = body.mass * float(np.linalg.norm(up)) * float(np.linalg.norm(np.array(body.r_oc_b)))
    square = 4.0 * least * weight - spin * spin
    return math.sqrt(square) / (2.0 * least) if square > 0.0 else 0.0
