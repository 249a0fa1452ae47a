"""What planning, FMUs and runs know of a model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rbfmu.models.model_buffer import BodyAtStart
from rbfmu.models.question import Question
from rbfmu.types import Array
from rbfmu_kernels.body.shell import Model
from rbfmu_kernels.models import model_named
from rbfmu_kernels.quantities import ATTITUDE, FIXED_IN_SPACE, FORCES, LOADS_NOW, OUTPUTS, RATE, WEIGHTS, needing

Names = set[str] | frozenset[str]
OF_RATES, OF_ATTITUDE = needing(RATE), needing(ATTITUDE)
OF_INERTIA = {row.name for row in OUTPUTS if "inertia" in row.initially} - needing(LOADS_NOW)
"""Quantities that depend on moments of inertia at the start, whatever the loads."""


@dataclass(frozen=True)
class ModelSpec:
    """A model: the kernels that run it, what it serves, what it costs and why it is chosen.

    Only `key` and `module` are needed for a model that a plan names; planning itself chooses those with `holds`.

    key: the public name, `Plan.model`.
    module: its kernels in `rbfmu_kernels.models`, as `models.model_named` takes them, which loads them at first use.
    method: how it is computed; empty where the plan's settings say it.
    states, rate_states: numbers that it keeps of the rotation, with and without the attitude.
    holds: whether it holds for the scene's values, ports at zero, as the kernels' `initialize` sees it.
    rests_on: the names of the loads and parameters that must not vary.
    drops: the loads that it leaves out where they are too small to matter.
    closed_form: whether a formula gives the motion at any time.
    stands_still, keeps_rate: whether attitude and rate, or the rate alone, stay as they begin.
    force_keeps_direction: whether a force fixed in b keeps its first direction in a.
    may_be_unstable: whether a disturbance of its motion may grow, which a reason then says.
    angle_round_off: whether its angle is a double, whose round-off grows with it.
    rates_from: its rates from those of a motion (n, 3), rad/s; None where only a run can tell.
    conditioning: the error, rad, that the round-off of the body's moments makes.
    costs: ns a communication step, by what makes it necessary, where "" always counts; see `planning.methods`.
    substep_without_attitude: the cost of a substep without attitude, as a part of that of one with it.
    integrates_path: whether the path is part of the integration, and costs nothing besides.
    computes_all_outputs: whether all outputs are computed whatever is asked for, so that none costs more.
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
    stands_still: bool = False
    keeps_rate: bool = False
    force_keeps_direction: bool = False
    may_be_unstable: bool = False
    angle_round_off: bool = False
    rates_from: Callable[[Question, Array], Array] | None = None
    conditioning: Callable[[Question], float] = lambda asked: 0.0
    costs: Mapping[str, float] = field(default_factory=dict)
    substep_without_attitude: float = 1.0
    integrates_path: bool = False
    computes_all_outputs: bool = False
    reason: Callable[[Question], str] = lambda asked: ""

    @property
    def kernels(self) -> Model:
        """Return the kernels that run it."""
        return model_named(self.module)

    def serves(self, asked: Question) -> bool:
        """Return whether the model is exact, whatever the ports supply and listed parameters become."""
        return not self.rests_on(asked) & asked.varying and self.accepts(asked)

    def accepts(self, asked: Question) -> bool:
        """Return whether the model holds for the scene's values, as the kernels' `initialize` finds."""
        return asked.start.fault == 0 and self.holds(asked.start)

    def states_for(self, asked: Question) -> int:
        """Return how many numbers it keeps for what is needed."""
        rotation = self.states if asked.attitude else self.rate_states
        return rotation + (6 if asked.translation else 0)

    def needed_parameters(self, asked: Question) -> set[str]:
        """Return the names of the parameters that are listed, or on which an output depends in this model."""
        if asked.scene.body is None:
            return {"quaternion_0"}
        inputs = asked.scene.inputs
        body, wanted, ports, listed = asked.body, asked.quantities, set(inputs.ports), set(inputs.parameters)
        beside = any(body.r_oc_b) or "r_oc_b" in listed
        moving = asked.translation or (not body.pivot and "acceleration" in wanted)
        angular = "alpha_b" in wanted or (moving and beside and "acceleration" in wanted)
        driven = asked.rotation and (angular or not self.keeps_rate)
        turning = asked.turning - (set() if angular else self.drops) if driven else set()
        pushing = FORCES | WEIGHTS if moving else set()
        acting = asked.acting & (turning | pushing)
        names = listed | (acting - ports)
        if driven or wanted & OF_INERTIA:
            names |= {"inertia"}
            names |= {"mass"} if body.pivot and beside else set()
        turned = not self.stands_still or wanted & {"position", "acceleration", "kinetic_energy"}
        swung = moving and beside and bool(turned)
        if asked.rotation and (swung or not self.stands_still or wanted & OF_RATES):
            names |= {"omega_b_0"}
        body_force = moving and "force_b" in acting | ports | listed
        if asked.attitude and (turning & FIXED_IN_SPACE or swung or body_force or wanted & OF_ATTITUDE):
            names |= {"quaternion_0"}
        if asked.translation:
            names |= {"velocity_0"}
        if "position" in wanted:
            names |= {"position_0"}
        if (moving and (acting | ports | listed) & FORCES) or ("kinetic_energy" in wanted and moving):
            names |= {"mass"}
        if any(body.r_oc_b) and (swung or "r_oc_b" in turning or (body.pivot and "inertia" in names)):
            names |= {"r_oc_b"}
        return names
