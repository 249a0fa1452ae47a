"""A scene as a case on which methods compete: its outputs, its accuracy, its true motion; and eight motions as such.

The true motion is what `planning.reference` gives in double-double arithmetic; that of the eight motions was computed
once, to 40 digits.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.models.question import Question
from rbfmu.planning.judge import MAX_REFERENCE_STEPS, least_sizes
from rbfmu.planning.reference import ReferenceTooLongError, reference_motion
from rbfmu.runs.motion import largest_error
from rbfmu.runs.plan import Plan, start_run
from rbfmu.runs.time_grid import communication_steps
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Motion
from rbfmu_kernels.body.memory import body_of, loads_of, motion_of
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.integrators.splitting import is_symmetric_top
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State
from rbfmu_kernels.models.loaded import LOADED_TAYLOR
from rbfmu_kernels.quantities import OUTPUT, active_flags

RATES, PATH, ROTATION, ALL = 3, 6, 7, 13
"""How many numbers solvers integrate: omega_b; r_c and v_c; q_ab and omega_b; q_ab, omega_b, r_c and v_c."""
POINTS, MAX_OUTPUTS = 200, 20_000
"""The largest number of points at which errors are measured, and of communication steps of a charted run."""
FLOOR = 1e-15
"""The least error that is told from round-off: the true motion is rounded to doubles."""
MOST_RADIANS = 1e6
"""The angle beyond which a motion is one of many turns, which takes peers too long."""
CHECKPOINTS = 5
"""The number of points at which the eight motions are known, and of the outputs of a run with few outputs."""
OUTPUT_STEP = 0.01
"""The time in s between the outputs of a run with many outputs."""
DRIFTS = ("energy", "momentum", "vertical momentum")
REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by examples/references/reference_motions.py."""
_GENERAL = Plan("body under loads, by series", "", 13, order=12)


@dataclass(frozen=True, eq=False)
class Case:
    """A scene with its outputs at all communication points, and its ports at zero.

    outputs: the number of equally spaced states that a method returns over the run; names: the blocks by which it is
    judged; quantities: those that models compute; points: the largest number of checkpoints among the outputs.
    Of the eight motions, key: that of its true motion; title: the name that a user would give it; keeps: what it
    conserves out of `DRIFTS`; accuracies: those that plans are made for (none: that of the scene, and further digits).
    """

    scene: Scene
    outputs: int = CHECKPOINTS
    names: tuple[str, ...] = ("quaternion", "omega_b")
    quantities: tuple[str, ...] = ("quaternion", "omega_b")
    points: int = CHECKPOINTS
    key: str = ""
    title: str = ""
    keeps: tuple[str, ...] = ()
    accuracies: tuple[float, ...] = ()

    @property
    def span(self) -> float:
        """Return the simulated time, s."""
        return self.scene.run.stop - self.scene.run.start

    @property
    def interval(self) -> float:
        """Return the time between outputs, s."""
        return self.span / self.outputs

    @property
    def checkpoints(self) -> slice:
        """Return the checkpoints among the outputs, equally spaced up to the last."""
        every = math.ceil(self.outputs / self.points)
        return slice((self.outputs - 1) % every, None, every)

    @property
    def outputs_between(self) -> list[int]:
        """Return the number of outputs up to each checkpoint from the one before."""
        at = [0, *(i + 1 for i in range(self.outputs)[self.checkpoints])]
        return [b - a for a, b in pairwise(at)]

    @property
    def many(self) -> bool:
        """Return whether outputs are more than checkpoints."""
        return self.outputs > self.points

    def with_many_outputs(self) -> "Case":
        """Return the same motion with an output every `OUTPUT_STEP`."""
        return replace(self, outputs=round(self.span / OUTPUT_STEP))

    def asking(self, accuracy: float) -> Scene:
        """Return the scene with this accuracy, and with the quantities and output times of all methods."""
        shown = [name for name in self.quantities if name in OUTPUT]
        return self.scene.replace({"run.accuracy": accuracy, "run.step": self.interval, "outputs.quantities": shown})

    @cached_property
    def asked(self) -> Scene:
        """Return the scene with its own accuracy, and with the quantities and output times of all methods."""
        return self.asking(self.scene.run.accuracy)

    @cached_property
    def needs(self) -> Question:
        """Return the degrees of freedom that the quantities depend on, which are those that solvers integrate."""
        return Question(self.asked.replace({"inputs.ports": [], "inputs.parameters": []}))

    @property
    def numbers(self) -> int:
        """Return how many numbers solvers integrate: those alone that the quantities depend on."""
        if not self.needs.rotation:
            return PATH
        if self.needs.translation:
            return ALL
        return ROTATION if self.needs.attitude else RATES

    # The equations of motion

    @property
    def blocks(self) -> Mapping[str, slice]:
        """Return the places of a model's quantities in its buffer."""
        return LOADED_TAYLOR.BLOCKS

    @cached_property
    def buffer(self) -> Array:
        """Return the buffer of a body under loads at the start, which holds body and loads."""
        return start_run(self.scene, _GENERAL)

    @cached_property
    def body(self) -> Body:
        """Return the constants of the equations of motion."""
        return body_of(self.buffer)

    @cached_property
    def loads(self) -> Loads:
        """Return the loads of the equations of motion."""
        return loads_of(self.buffer)

    @cached_property
    def start(self) -> State:
        """Return position and velocity of the centre of mass, q_ab, omega_b; at rest if nothing asked for turns."""
        start = motion_of(self.buffer)
        return start if self.needs.rotation else start._replace(omega_b=(0.0, 0.0, 0.0))

    @property
    def moments(self) -> tuple[float, float, float]:
        """Return the diagonal of the inertia about the reference point: the principal moments in principal axes."""
        M = self.body.inertia
        return M[0][0], M[1][1], M[2][2]

    @property
    def torque_free(self) -> bool:
        """Return whether no load makes a torque."""
        loads = self.loads
        pulled = any(self.body.arm_b) and any((*loads.force_a, *loads.force_b))
        return not pulled and not any((*loads.torque_a, *loads.torque_b, *self.body.damping_b))

    @property
    def top(self) -> bool:
        """Return whether splitting with the symmetric free rotation applies."""
        return not self.torque_free and bool(is_symmetric_top(self.body.inertia)) and not any(self.body.damping_b)

    @cached_property
    def rate(self) -> float:
        """Return the largest |omega| at start and checkpoints, rad/s; 0 where no quantity depends on the rotation."""
        return float(np.max(np.linalg.norm(self.truth["omega_b"], axis=1))) if self.needs.rotation else 0.0

    # Errors

    @cached_property
    def truth(self) -> Motion:
        """Return the judged quantities and omega_b at the start and at the checkpoints."""
        if self.key:
            return _known_motion(self)
        if self.scene.body is None:  # rates are prescribed, and zero
            count, q = len(self.outputs_between) + 1, np.array(self.scene.initial.quaternion)
            resting = {name: np.zeros((count, 3)) for name in (*self.names, "omega_b")}
            return resting | {"quaternion": np.tile(q, (count, 1))}
        return reference_motion(self.scene, [self.interval * n for n in self.outputs_between], MAX_REFERENCE_STEPS)

    @cached_property
    def floors(self) -> Mapping[str, float]:
        """Return the least sizes that errors are relative to, by name."""
        return least_sizes(Question(self.scene), self.truth) if self.scene.body else {}

    def states_of(self, rows: Array) -> Motion:
        """Return the quantities at the checkpoints from a model's rows of `quantities` at the outputs."""
        chosen, motion, first = rows[self.checkpoints], {}, 0
        for name in self.quantities:
            size = self.blocks[name].stop - self.blocks[name].start
            motion[name] = chosen[:, first : first + size]
            first += size
        return motion

    def error(self, states: Any) -> float:
        """Return the largest error of states, or of quantities, at the checkpoints as the scene's accuracy counts."""
        with np.errstate(all="ignore"):
            found = self._judged_quantities(states)
            if not all(np.all(np.isfinite(found[name])) for name in self.names):
                return math.inf
            whole = {name: np.vstack((self.truth[name][:1], found[name])) for name in self.names}
            return largest_error(whole, self.truth, self.names, self.floors)

    def drifts(self, states: Any) -> dict[str, float]:
        """Return the largest changes of what is conserved, relative to its start, at the checkpoints."""
        if not self.keeps:
            return {}
        with np.errstate(all="ignore"):
            now = self._conserved(self._judged_quantities(states))
            before = self._conserved({name: rows[:1] for name, rows in self.truth.items()})
            sizes = {name: np.linalg.norm(before["momentum" if "momentum" in name else name]) for name in DRIFTS}
            found = {name: np.linalg.norm(now[name] - before[name], axis=1) / sizes[name] for name in self.keeps}
        return {f"{name.replace(' ', '_')}_drift": float(np.max(rows)) for name, rows in found.items()}

    def _conserved(self, motion: Motion) -> dict[str, Array]:
        """Return the energy (with that of the weight about a pivot) and the angular momentum as rows."""
        q, omega = motion["quaternion"], motion["omega_b"]
        h_b = arrays.angular_momentum(np.array(self.body.inertia), omega)
        h_a, energy = arrays.rotate(q, h_b), 0.5 * np.sum(omega * h_b, axis=-1, keepdims=True)
        if self.body.is_free == 0.0:
            energy = energy - (arrays.rotate(q, np.array(self.body.arm_b)) @ np.array(self.loads.force_a))[:, None]
        return {"energy": energy, "momentum": h_a, "vertical momentum": h_a[:, 2:]}

    def _judged_quantities(self, states: Any) -> Motion:
        """Return the judged quantities of states; what is one already, as it is."""
        if isinstance(states, dict):
            return states
        z, blocks, outputs = self.buffer.copy(), LOADED_TAYLOR.BLOCKS, tiered(LOADED_TAYLOR.outputs)
        z[blocks["active"]] = active_flags(self.names)
        rows: dict[str, list[Array]] = {name: [] for name in self.names}
        for r, v, q, omega in states:
            z[blocks["q"]], z[blocks["omega"]] = np.array(q) / np.linalg.norm(q), omega
            z[blocks["r_c"]], z[blocks["v_c"]] = r, v
            outputs(z)
            for name in self.names:
                rows[name].append(z[blocks[name]].copy())
        return {name: np.array(found) for name, found in rows.items()}


def state_of(r: Any, v: Any, q: Any, omega: Any) -> State:
    """Return a state made from any sequences of numbers."""
    return State(*(tuple(map(float, x)) for x in (r, v, q, omega)))  # type: ignore[arg-type]


def case_of(scene: Scene) -> Case:
    """Return the case of a scene, of whose run so much is charted as the reference follows in some seconds."""
    from rbfmu.studies.chart.formulas import kind_of_case  # of which one is a case of those here

    question, kind = Question(scene), kind_of_case(scene)
    names = question.judged
    quantities = tuple(dict.fromkeys((*scene.outputs.quantities, *names)))
    if scene.body is not None:
        question.start.check()
    steps = communication_steps(scene)
    whole = steps * scene.run.step <= (scene.run.stop - scene.run.start) * (1.0 + 1e-9)
    outputs = min(max(steps if whole else steps - 1, 1), MAX_OUTPUTS)
    while True:
        case = kind(_first_steps(scene, outputs), outputs, names, quantities, POINTS)
        try:
            assert case.truth
            return case
        except ReferenceTooLongError:
            if outputs == 1:
                expected = "expected a step over which the true motion can be followed in some seconds"
                raise SceneError(f"run.step = {scene.run.step!r}: {expected}; no chart without", scene.name) from None
            outputs = max(outputs // 4, 1)


def _first_steps(scene: Scene, outputs: int) -> Scene:
    if outputs == communication_steps(scene):
        return scene
    return scene.replace({"run.stop": scene.run.start + outputs * scene.run.step})


# The eight motions


@cache
def reference(key: str) -> dict[str, Array]:
    """Return the true motion of one of the eight at its checkpoints: q (5, 4), omega_b and r_c (5, 3)."""
    motion = json.loads(REFERENCES.read_text(encoding="utf-8"))["motions"][key]
    names = {"quaternion": "q", "omega_b": "omega_b", "r_c": "r_c"}
    return {short: np.array(motion[name], dtype=float) for name, short in names.items()}


def _known_motion(case: Case) -> Motion:
    """Return the motion with its start, and the position of the body's origin."""
    known, initial, body = reference(case.key), case.scene.initial, case.scene.body
    assert body is not None
    arms = arrays.rotate(known["q"], np.array(body.r_oc_b))
    after = {"quaternion": known["q"], "omega_b": known["omega_b"], "position": known["r_c"] - arms}
    return {name: np.vstack((getattr(initial, name), rows)) for name, rows in after.items()}


BRICK = {"inertia": [1.0, 2.0, 3.0]}
_LEANING = {"attitude": {"quaternion": [math.cos(0.3), math.sin(0.3), 0.0, 0.0]}}
_PLANNED = (1e-3, 1e-6, 1e-9, 1e-12)


def _motion(
    key: str, title: str, name: str, stop: float, body: Mapping[str, Any], omega_b: Sequence[float],
    keeps: tuple[str, ...] = (), asked: tuple[str, ...] = ("quaternion", "omega_b"), **more: Any,
) -> Case:  # fmt: skip
    tables = {
        "name": name,
        "body": {"mass": 1.0, **body},
        "initial": {"omega_b": list(omega_b)} | more.pop("initial", {}),
        "loads": {"gravity_a": [0.0, 0.0, 0.0]} | more,
        "run": {"stop": stop, "step": stop / CHECKPOINTS},
    }
    scene = Scene.from_dict(tables, name)
    return Case(scene, names=asked, quantities=asked, key=key, title=title, keeps=keeps, accuracies=_PLANNED)


def _top(key: str, title: str, name: str, middle: float) -> Case:
    """Return a heavy top, m g r = 1 N m, moments (1, middle, 0.3) about the pivot, numbers exact in binary."""
    arm = 0.125
    body = {"inertia": [1.0 - arm * arm, middle - arm * arm, 0.3], "r_oc_b": [0.0, 0.0, arm], "pivot": True}
    keeps, weight = ("energy", "vertical momentum"), [0.0, 0.0, -8.0]
    return _motion(key, title, name, 10.0, body, (0.0, 0.0, 50.0), keeps, initial=_LEANING, gravity_a=weight)


_KEPT, _RATES, _TURNED = ("energy", "momentum"), (0.3, 1.0, 0.2), {"attitude": {"quaternion": [0.5, 0.5, 0.5, 0.5]}}
_OFF_CENTRE = {"mass": 2.0, "inertia": [1.0, 2.0, 2.5], "r_oc_b": [0.1, -0.2, 0.05]}
CASES = {
    case.key: case
    for case in (
        _motion("a", "free body", "free_body", 100.0, BRICK, _RATES, _KEPT, initial=_TURNED),
        _motion("b", "free body, flipping", "flipping", 60.0, BRICK, (1e-4, 2.0, 1e-4), _KEPT),
        _motion("g", "free body, 1e6 turns", "million_turns", 6e6, BRICK, _RATES, _KEPT, initial=_TURNED),
        _top("c", "heavy top", "heavy_top", 1.0),
        _top("c'", "heavy top, three moments", "three_moments", 1.25),
        _motion("d", "constant body torque", "body_torque", 20.0, BRICK, (0.1, 0.2, 0.3), torque_b=[0.1, 0.05, -0.2]),
        _motion("e", "damped spin", "damped_spin", 10.0, BRICK, (0.0, 0.0, 10.0), damping_b=[0.5, 0.5, 0.5]),
        _motion("f", "thruster off the centre", "thruster", 20.0, _OFF_CENTRE, (0.3, -0.5, 0.8),
                asked=("quaternion", "omega_b", "position"), initial={"velocity": [1.0, 0.0, 0.0]},
                gravity_a=[0.0, 0.0, -9.81], force_b=[1.0, 0.5, -2.0]),
    )
}  # fmt: skip
"""The eight motions by key: a to e as in the literature on these methods, f with six degrees of freedom, g a long run.

Of all but f the path has a closed form, so that no method has to compute it.
"""


def few_and_many(keys: Sequence[str] = tuple(CASES)) -> list[Case]:
    """Return each motion with few and with many outputs; the long one, of which these were millions, with few only."""
    found = [case for key in keys for case in (CASES[key], CASES[key].with_many_outputs())]
    return [case for case in found if case.outputs <= MAX_OUTPUTS]
