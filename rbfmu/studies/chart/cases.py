"""A scene as a case on which methods compete: its outputs, its accuracy, its true motion; and eight motions as such.

The true motion is what `planning.reference` gives in double-double arithmetic; that of the eight motions was computed
once, to 40 digits. What solvers integrate are the states that the quantities come of, by the equations of motion on a
graph, with formulas or without.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu import arrays
from rbfmu.models import formulas
from rbfmu.models.question import Question
from rbfmu.planning import judge, methods, reference
from rbfmu.runs.motion import largest_error, least_sizes
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.studies import tables_of
from rbfmu.types import Array, Motion
from rbfmu_kernels.body.memory import motion_of
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State
from rbfmu_kernels.quantities import OUTPUT, elements

WHOLE = (*elements("q", 4), *elements("omega", 3), *elements("r_c", 3), *elements("v_c", 3))
"""The names of a body's states: q_ab, omega_b, r_c and v_c."""
POINTS, MAX_OUTPUTS = 200, 20_000
"""The largest number of points at which errors are measured, and of communication steps of a charted run."""
FLOOR = 1e-15
"""The least error that is told from round-off: the true motion is rounded to doubles."""
CHECKPOINTS = 5
"""The number of points at which the eight motions are known, and of the outputs of a run with few outputs."""
OUTPUT_STEP = 0.01
"""The time in s between the outputs of a run with many outputs."""
DRIFTS = {name: f"{name.replace(' ', '_')}_drift" for name in ("energy", "momentum", "vertical momentum")}
"""The columns of the drifts of what a motion may conserve."""
REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by examples/references/reference_motions.py."""


Found = Sequence[State] | Motion
"""What a method returns at the checkpoints: states, or the quantities by which it is judged."""


@dataclass(frozen=True, eq=False)
class Case:
    """A scene with its outputs at all communication points, and its ports at zero.

    outputs: the number of equally spaced states that a method returns over the run; points: the largest number of
    checkpoints among the outputs. Of the eight motions, key: that of its true motion; keeps: what it conserves out of
    `DRIFTS`; accuracies: those that plans are made for (none: that of the scene, and further digits).
    """

    scene: Scene
    outputs: int = CHECKPOINTS
    points: int = CHECKPOINTS
    key: str = ""
    keeps: tuple[str, ...] = ()
    accuracies: tuple[float, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the blocks by which methods are judged."""
        return Question(self.scene).judged

    @property
    def quantities(self) -> tuple[str, ...]:
        """Return the blocks that models compute."""
        return tuple(dict.fromkeys((*self.scene.outputs.quantities, *self.names)))

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
        return np.diff(range(1, self.outputs + 1)[self.checkpoints], prepend=0).tolist()

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
    def question(self) -> Question:
        """Return the question of that."""
        return Question(self.asked)

    # The equations of motion

    @cached_property
    def general(self) -> Plan:
        """Return a plan of the model of everything that may act, whose buffer holds body, loads and states."""
        return methods.whole_series(self.asked, methods.ORDERS_OF_SERIES[0], 1.0)

    @cached_property
    def buffer(self) -> Array:
        """Return the buffer of that model at the start."""
        return start_run(self.asked, self.general, self.names)

    @cached_property
    def equations(self) -> formulas.FormulaModel:
        """Return the equations of motion of all states that the quantities come of."""
        free: dict[str, list[str]] = {"inputs.ports": [], "inputs.parameters": []}  # formulas may read ports
        return formulas.equations_of(self.asked if self.scene.has_formulas else self.asked.replace(free))

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Return the names of the numbers that solvers integrate: those alone that the quantities come of."""
        return tuple(name for name in self.equations.rates if name != "t")

    @property
    def turns(self) -> bool:
        """Return whether the quantities come of the rotation."""
        return any(name.startswith("omega") for name in self.states)

    @property
    def only_turns(self) -> bool:
        """Return whether they come of attitude and rates alone."""
        return self.turns and {*self.states} <= {*WHOLE[:7]}

    def place(self, name: str) -> int:
        """Return where the buffer has a state, or a number of the equations."""
        block, _, index = name.partition("[")
        return int(self.general.kernels.BLOCKS[block].start) + (int(index[:-1]) - 1 if index else 0)

    @property
    def integrated(self) -> Array:
        """Return the numbers that solvers integrate, at the start."""
        return self.buffer[[*map(self.place, self.states)]]

    @property
    def times(self) -> Array:
        """Return the times of the start and of all outputs, from 0 on."""
        return np.arange(self.outputs + 1.0) * self.interval

    @property
    def body(self) -> Body:
        """Return the constants of the equations of motion."""
        return self.question.start.body

    @property
    def loads(self) -> Loads:
        """Return the loads of the equations of motion."""
        return self.question.start.loads

    @cached_property
    def start(self) -> State:
        """Return position and velocity of the centre of mass, q_ab, omega_b; at rest if nothing asked for turns."""
        start = motion_of(self.question.start.z)
        return start if self.turns else start._replace(omega_b=(0.0, 0.0, 0.0))

    @property
    def moments(self) -> tuple[float, float, float]:
        """Return the diagonal of the inertia about the reference point: the principal moments in principal axes."""
        M = self.body.inertia
        return M[0][0], M[1][1], M[2][2]

    @property
    def torque_free(self) -> bool:
        """Return whether no load makes a torque."""
        return not self.question.start.has_torque

    @property
    def top(self) -> bool:
        """Return whether splitting with the symmetric free rotation applies."""
        return not self.torque_free and self.question.start.is_symmetric and not any(self.body.damping_b)

    @property
    def turns_freely(self) -> bool:
        """Return whether attitude and rates of a torque-free body in principal axes are all that is asked for."""
        mixed = [x for i, row in enumerate(self.body.inertia) for j, x in enumerate(row) if i != j]
        return self.torque_free and self.only_turns and not any(mixed) and all(self.moments)

    @cached_property
    def rate(self) -> float:
        """Return the largest |omega| that is known, rad/s; 0 where no quantity comes of the rotation."""
        rates = self.truth.get("omega_b", np.array([self.scene.initial.omega_b]))
        return float(np.max(np.linalg.norm(rates, axis=1))) if self.turns else 0.0

    @property
    def turned(self) -> float:
        """Return the angle in rad that the body turns by, at most."""
        return self.rate * self.span

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
        times = [self.interval * n for n in self.outputs_between]
        return reference.reference_motion(self.scene, times, judge.MAX_REFERENCE_STEPS)

    @cached_property
    def floors(self) -> Mapping[str, float]:
        """Return the least sizes that errors are relative to, by name."""
        return least_sizes(self.question, self.truth) if self.scene.body else {}

    def error(self, states: Found) -> float:
        """Return the largest error of states, or of quantities, at the checkpoints as the scene's accuracy counts."""
        with np.errstate(all="ignore"):
            found = self._judged_quantities(states)
            if not all(np.all(np.isfinite(found[name])) for name in self.names):
                return math.inf
            whole = {name: np.vstack((self.truth[name][:1], found[name])) for name in self.names}
            return largest_error(whole, self.truth, self.names, self.floors)

    def drifts(self, states: Found) -> dict[str, float]:
        """Return the largest changes of what is conserved, relative to its start, at the checkpoints."""
        if not self.keeps:
            return {}
        with np.errstate(all="ignore"):
            now = self.conserved(self._judged_quantities(states))
            before = self.conserved({name: rows[:1] for name, rows in self.truth.items()})
            sizes = {name: np.linalg.norm(before["momentum" if "momentum" in name else name]) for name in DRIFTS}
            found = {name: np.linalg.norm(now[name] - before[name], axis=1) / sizes[name] for name in self.keeps}
        return {DRIFTS[name]: float(np.max(rows)) for name, rows in found.items()}

    def conserved(self, motion: Motion) -> dict[str, Array]:
        """Return the energy (with that of the weight about a pivot) and the angular momentum as rows."""
        q, omega = motion["quaternion"], motion["omega_b"]
        h_b = arrays.angular_momentum(np.array(self.body.inertia), omega)
        h_a, energy = arrays.rotate(q, h_b), 0.5 * np.sum(omega * h_b, axis=-1, keepdims=True)
        if self.body.is_free == 0.0:
            energy = energy - (arrays.rotate(q, np.array(self.body.arm_b)) @ np.array(self.loads.force_a))[:, None]
        return {"energy": energy, "momentum": h_a, "vertical momentum": h_a[:, 2:]}

    def _judged_quantities(self, states: Found) -> Motion:
        """Return the judged quantities of states; what is one already, as it is."""
        if isinstance(states, dict):
            return states
        return self._motion_of(((*q, *omega, *r, *v) for r, v, q, omega in states), WHOLE)

    def motion_of(self, rows: Array) -> Motion:
        """Return what is judged from the numbers that solvers integrate, at the start and at all outputs."""
        return self._motion_of(rows[1:][self.checkpoints], self.states)

    def _motion_of(self, rows: Iterable[Sequence[float] | Array], states: Iterable[str]) -> Motion:
        """Return what is judged from states at the checkpoints, by their names; quaternions may have any length."""
        z, kernels, places = self.buffer.copy(), self.general.kernels, [*map(self.place, states)]
        blocks, outputs = kernels.BLOCKS, tiered(kernels.outputs)
        found: dict[str, list[Array]] = {name: [] for name in self.names}
        for time, row in zip(np.cumsum(self.outputs_between) * self.interval, rows, strict=True):
            z[places] = row
            if "series.time" in blocks:  # which formulas may read
                z[blocks["series.time"]] = self.scene.run.start + time, 0.0
            z[blocks["q"]] /= np.linalg.norm(z[blocks["q"]])
            outputs(z)
            for name in self.names:
                found[name].append(z[blocks[name]].copy())
        return {name: np.array(values) for name, values in found.items()}


def state_of(r: Iterable[float], v: Iterable[float], q: Iterable[float], omega: Iterable[float]) -> State:
    """Return a state made from any sequences of numbers."""
    return State(*(tuple(map(float, x)) for x in (r, v, q, omega)))  # type: ignore[arg-type]


def case_of(scene: Scene) -> Case:
    """Return the case of a scene, of whose run so much is charted as the reference follows in some seconds."""
    if scene.body is not None:
        Question(scene).start.check()
    steps = scene.run.count
    whole = steps * scene.run.step <= (scene.run.stop - scene.run.start) * (1.0 + 1e-9)
    outputs = min(max(steps if whole else steps - 1, 1), MAX_OUTPUTS)
    while True:
        part = scene if outputs == steps else scene.replace({"run.stop": scene.run.start + outputs * scene.run.step})
        case = Case(part, outputs, POINTS)
        try:
            _ = case.truth  # kept, where it can be followed
            return case
        except reference.ReferenceTooLongError:
            if outputs == 1:
                expected = "expected a step over which the true motion can be followed in some seconds"
                raise SceneError(f"run.step = {scene.run.step!r}: {expected}; no chart without", scene.name) from None
            outputs = max(outputs // 4, 1)


# The eight motions


def _known_motion(case: Case) -> Motion:
    """Return the true motion of one of the eight at its checkpoints, with its start, and that of the body's origin."""
    motion, body = json.loads(REFERENCES.read_text(encoding="utf-8"))["motions"][case.key], case.question.body
    q, omega_b, r_c = (np.array(motion[name], dtype=float) for name in ("quaternion", "omega_b", "r_c"))
    after = {"quaternion": q, "omega_b": omega_b, "position": r_c - arrays.rotate(q, np.array(body.r_oc_b))}
    return {name: np.vstack((getattr(case.scene.initial, name), rows)) for name, rows in after.items()}


def _known_case(key: str, tables: dict[str, Any]) -> Case:
    """Return one of the eight, which is asked for attitude and rates if its tables name no quantities."""
    keeps, stop = tuple(tables.pop("keeps", ())), tables["run"]["stop"]
    asked = {"outputs": {"quantities": ["quaternion", "omega_b"]}, "run": {"stop": stop, "step": stop / CHECKPOINTS}}
    return Case(Scene.from_dict(asked | tables | {"run": asked["run"]}, key), key=key, keeps=keeps, accuracies=_PLANNED)


_PLANNED = (1e-3, 1e-6, 1e-9, 1e-12)
CASES = {key: _known_case(key, tables) for key, tables in tables_of("chart/motions.toml").items()}
"""The eight motions by key."""


def few_and_many(keys: Sequence[str] = tuple(CASES)) -> list[Case]:
    """Return each motion with few and with many outputs; the long one, of which these were millions, with few only."""
    found = [case for key in keys for case in (CASES[key], CASES[key].with_many_outputs())]
    return [case for case in found if case.outputs <= MAX_OUTPUTS]
