"""A scene of one's own as a case on which methods compete: its outputs, its accuracy, its true motion."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rbfmu.models.question import Question
from rbfmu.planning.judge import MAX_REFERENCE_STEPS, least_sizes
from rbfmu.planning.reference import ReferenceTooLongError, reference_motion
from rbfmu.runs.motion import Motion, largest_error
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies.work_precision.cases import ALL, PATH, RATES, ROTATION, Array, Case
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.mechanics.equations_of_motion import State
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from rbfmu_kernels.quantities import active_flags

POINTS = 200
"""The largest number of points at which errors are measured."""
MAX_OUTPUTS = 20_000
"""The largest number of communication steps of a charted run."""
FLOOR = 1e-15
"""The least error that is told from round-off: the true motion is rounded to doubles."""
_NOTHING = {"attitude": math.nan} | dict.fromkeys(("position", "energy", "momentum", "vertical momentum"), math.nan)


@dataclass(frozen=True, eq=False)
class OwnCase(Case):
    """A scene with its outputs at all communication points, and its ports at zero.

    names: the blocks that show what is asked for; truth: these (and omega_b) at the start and at the checkpoints;
    floors: the least sizes that errors are relative to, by name.
    """

    names: tuple[str, ...] = ()
    truth: Motion = field(default_factory=dict)
    floors: Mapping[str, float] = field(default_factory=dict)

    @property
    def span(self) -> float:
        """Return the simulated time, s."""
        return self.scene.run.stop - self.scene.run.start

    @property
    def quantities(self) -> tuple[str, ...]:
        """Return the quantities that models compute: those asked for, and those by which they are judged."""
        return tuple(dict.fromkeys((*self.scene.outputs.quantities, *self.names)))

    @cached_property
    def needs(self) -> Question:
        """Return the degrees of freedom that the quantities depend on, which are those that solvers integrate."""
        return Question(self.scene.replace({"inputs.ports": [], "inputs.parameters": []}))

    @property
    def numbers(self) -> int:
        """Return how many numbers solvers integrate: those alone that the quantities depend on."""
        if not self.needs.rotation:
            return PATH
        if self.needs.translation:
            return ALL
        return ROTATION if self.needs.attitude else RATES

    @cached_property
    def start(self) -> State:
        """Return the state at the start; at rest where no quantity depends on the rotation."""
        start = super().start
        return start if self.needs.rotation else start._replace(omega_b=(0.0, 0.0, 0.0))

    @property
    def rate(self) -> float:
        """Return the largest |omega| at start and checkpoints, rad/s; 0 where no quantity depends on the rotation."""
        return float(np.max(np.linalg.norm(self.truth["omega_b"], axis=1))) if self.needs.rotation else 0.0

    @property
    def long(self) -> bool:
        """Return that every method may try: time limits stop it."""
        return False

    def asking(self, accuracy: float) -> Scene:
        """Return the scene with this accuracy, and with the quantities by which it is judged."""
        return self.scene.replace({"run.accuracy": accuracy, "outputs.quantities": list(self.quantities)})

    # Errors

    def states_of(self, rows: Array) -> Motion:
        """Return the judged quantities at the checkpoints from rows of `quantities` at the outputs."""
        chosen, motion, first = rows[self.checkpoints], {}, 0
        for name in self.quantities:
            size = LOADED_TAYLOR.BLOCKS[name].stop - LOADED_TAYLOR.BLOCKS[name].start
            motion[name] = chosen[:, first : first + size]
            first += size
        return motion

    def judged(self, errors: Mapping[str, float]) -> float:
        """Return the largest error as the scene's accuracy counts it."""
        return errors["scene"]

    def errors(self, states: Any) -> dict[str, float]:
        """Return the largest error as the scene's accuracy counts it, under "scene"."""
        with np.errstate(all="ignore"):
            found = states if isinstance(states, dict) else self._shown(states)
            if not all(np.all(np.isfinite(found[name])) for name in self.names):
                return _NOTHING | {"scene": math.inf}
            whole = {name: np.vstack((self.truth[name][:1], found[name])) for name in self.names}
            return _NOTHING | {"scene": largest_error(whole, self.truth, self.names, self.floors)}

    def _shown(self, states: Any) -> Motion:
        """Return the judged quantities of states."""
        z, blocks, outputs = self.buffer.copy(), LOADED_TAYLOR.BLOCKS, tiered(LOADED_TAYLOR.outputs)
        z[blocks["active"]] = active_flags(self.names)
        rows: dict[str, list[Array]] = {name: [] for name in self.names}
        for state in states:
            q = np.array(state.q_ab)
            z[blocks["q"]], z[blocks["omega"]] = q / np.linalg.norm(q), state.omega_b
            z[blocks["r_c"]], z[blocks["v_c"]] = state.r_c, state.v_c
            outputs(z)
            for name in self.names:
                rows[name].append(z[blocks[name]].copy())
        return {name: np.array(found) for name, found in rows.items()}


def own_case(scene: Scene) -> OwnCase:
    """Return the case of a scene, of whose run so much is charted as the reference follows in some seconds."""
    outputs = min(_whole_steps(scene), MAX_OUTPUTS)
    while True:
        shorter = _first_steps(scene, outputs)
        case = OwnCase("own", scene.name, shorter, outputs=outputs, points=POINTS, names=Question(scene).judged)
        try:
            return _with_truth(case)
        except ReferenceTooLongError:
            if outputs == 1:
                expected = (
                    "expected a step over which the true motion can be followed in some seconds; no chart without"
                )
                raise SceneError(f"run.step = {scene.run.step!r}: {expected}", scene.name) from None
            outputs = max(outputs // 4, 1)


def _whole_steps(scene: Scene) -> int:
    """Return how many whole communication steps the run has, at least 1."""
    count = communication_steps(scene)
    whole = count * scene.run.step <= (scene.run.stop - scene.run.start) * (1.0 + 1e-9)
    return max(count if whole else count - 1, 1)


def _first_steps(scene: Scene, outputs: int) -> Scene:
    run = scene.run
    if outputs == communication_steps(scene):
        return scene
    return scene.replace({"run.stop": run.start + outputs * run.step})


def _with_truth(case: OwnCase) -> OwnCase:
    if case.scene.body is None:
        return replace(case, truth=_at_rest(case))
    asked = Question(case.scene)
    asked.start.check()
    steps = [case.interval * n for n in case.outputs_between]
    truth = reference_motion(case.scene, steps, MAX_REFERENCE_STEPS)
    return replace(case, truth=truth, floors=least_sizes(asked, truth))


def _at_rest(case: OwnCase) -> Motion:
    """Return the motion by prescribed rates that are zero."""
    count, q = len(case.outputs_between) + 1, np.array(case.scene.initial.quaternion)
    return {name: np.tile(q, (count, 1)) if name == "quaternion" else np.zeros((count, 3)) for name in
            (*case.names, "omega_b")}  # fmt: skip
