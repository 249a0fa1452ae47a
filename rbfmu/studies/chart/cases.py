"""Cases, on which methods are compared: a scene with its outputs, accuracy and true motion; and eight such motions.

`planning.reference` computes the true motion in double-double arithmetic; that of the eight motions was computed once,
to 40 digits. Solvers integrate the states on which the quantities depend. The equations of motion are a graph, with
or without formulas.
"""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rbfmu import arrays, studies
from rbfmu.models import formulas
from rbfmu.models.question import Question
from rbfmu.planning import judge, methods, reference
from rbfmu.runs.motion import largest_error, least_sizes
from rbfmu.runs.plan import Plan, start_run
from rbfmu.scene.scene import Scene, SceneError
from rbfmu.types import Array, Motion
from rbfmu_kernels.body.memory import motion_of
from rbfmu_kernels.compile.tiered import tiered
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State
from rbfmu_kernels.quantities import OUTPUT, elements

WHOLE = (*elements("q", 4), *elements("omega", 3), *elements("r_c", 3), *elements("v_c", 3))
"""The names of a body's states: q_ab, omega_b, r_c and v_c."""
POINTS, MAX_OUTPUTS = 200, 20_000
"""POINTS: the largest number of points at which errors are measured. MAX_OUTPUTS: the largest number of communication
steps of a charted run."""
FLOOR = 1e-15
"""Errors below this count as round-off, since the true motion is rounded to doubles."""
CHECKPOINTS = 5
"""The number of points at which the eight motions are known, and of outputs in a run with few outputs."""
OUTPUT_STEP = 0.01
"""The time in s between the outputs of a run with many outputs."""
DRIFTS = {name: f"{name.replace(' ', '_')}_drift" for name in ("energy", "momentum", "vertical momentum")}
"""The columns for the drifts of what a motion may conserve, by its name."""
REFERENCES = Path(__file__).with_name("reference_motions.json")
"""The file is written by examples/references/reference_motions.py."""


@dataclass(frozen=True, eq=False)
class Case:
    """A scene with outputs at all communication points, and with its ports constant at their start values.

    outputs: the number of equally spaced states that a method returns over the run; points: the largest number of
    checkpoints among the outputs. Only for the eight motions: key, of the true motion; keeps, the names in `DRIFTS` of
    what it conserves; accuracies, for which plans are made (none: for that of the scene, and further digits).
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
        """Return which outputs are checkpoints: they are equally spaced, and the last output is one."""
        every = math.ceil(self.outputs / self.points)
        return slice((self.outputs - 1) % every, None, every)

    @property
    def outputs_between(self) -> list[int]:
        """Return the number of outputs from each checkpoint (or the start) to the next."""
        return np.diff(range(1, self.outputs + 1)[self.checkpoints], prepend=0).tolist()

    @property
    def many(self) -> bool:
        """Return whether there are more outputs than checkpoints."""
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
        """Return the question of that scene."""
        return Question(self.asked)

    # The equations of motion

    @cached_property
    def general(self) -> Plan:
        """Return a plan of the full model, whose buffer has the body, all loads and all states."""
        return methods.whole_series(self.asked, methods.ORDERS_OF_SERIES[0], 1.0)

    @cached_property
    def buffer(self) -> Array:
        """Return the buffer of the full model at the start."""
        return start_run(self.asked, self.general, self.names)

    @cached_property
    def equations(self) -> formulas.FormulaModel:
        """Return the equations of motion of all states on which the quantities depend."""
        free: dict[str, list[str]] = {"inputs.ports": [], "inputs.parameters": []}  # formulas may read ports
        return formulas.equations_of(self.asked if self.scene.has_formulas else self.asked.replace(free))

    @cached_property
    def states(self) -> tuple[str, ...]:
        """Return the names of the states that solvers integrate: only those on which the quantities depend."""
        return tuple(name for name in self.equations.rates if name != "t")

    @property
    def turns(self) -> bool:
        """Return whether the quantities depend on the rotation."""
        return any(name.startswith("omega") for name in self.states)

    @property
    def only_turns(self) -> bool:
        """Return whether they depend on attitude and rates alone."""
        return self.turns and {*self.states} <= {*WHOLE[:7]}

    def place(self, name: str) -> int:
        """Return the place in the buffer of a state, or of a number in the equations."""
        block, _, index = name.partition("[")
        return int(self.general.kernels.BLOCKS[block].start) + (int(index[:-1]) - 1 if index else 0)

    @property
    def integrated(self) -> Array:
        """Return the start values of the states that solvers integrate."""
        return self.buffer[[*map(self.place, self.states)]]

    @property
    def times(self) -> Array:
        """Return the times in s of the start, which is 0 here, and of all outputs."""
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
        """Return position and velocity of the centre of mass, q_ab, and omega_b (0 if no quantity needs rotation)."""
        start = motion_of(self.question.start.z)
        return start if self.turns else start._replace(omega_b=(0.0, 0.0, 0.0))

    @property
    def moments(self) -> tuple[float, float, float]:
        """Return the diagonal of the inertia matrix of the equations of motion: the moments, if axes are principal."""
        M = self.body.inertia
        return M[0][0], M[1][1], M[2][2]

    @property
    def torque_free(self) -> bool:
        """Return whether no load has a torque."""
        return not self.question.start.has_torque

    @property
    def top(self) -> bool:
        """Return whether splitting with the free rotation of a symmetric body can be used."""
        return not self.torque_free and self.question.start.is_symmetric and not any(self.body.damping_b)

    @property
    def turns_freely(self) -> bool:
        """Return whether only attitude and rates are asked for, of a torque-free body in principal axes."""
        mixed = [x for i, row in enumerate(self.body.inertia) for j, x in enumerate(row) if i != j]
        return self.torque_free and self.only_turns and not any(mixed) and all(self.moments)

    @cached_property
    def rate(self) -> float:
        """Return the largest known |omega|, rad/s; 0 if no quantity depends on the rotation."""
        rates = self.truth.get("omega_b", np.array([self.scene.initial.omega_b]))
        return float(np.max(np.linalg.norm(rates, axis=1))) if self.turns else 0.0

    @property
    def turned(self) -> float:
        """Return an upper bound of the angle by which the body turns, rad."""
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

    @np.errstate(all="ignore")
    def error(self, found: Motion) -> float:
        """Return the largest error of the quantities at the checkpoints, as an accuracy counts it.

        It is infinite if a number is not finite.
        """
        least = least_sizes(self.question, self.truth) if self.scene.body else {}
        whole = {name: np.vstack((self.truth[name][:1], found[name])) for name in self.names}
        return largest_error(whole, self.truth, self.names, least)

    @np.errstate(all="ignore")
    def drifts(self, found: Motion) -> dict[str, float]:
        """Return the largest drifts at the checkpoints, of the energy relative to its start, of momenta to |h|."""
        if not self.keeps:
            return {}
        now = self.conserved(found)
        before = self.conserved({name: rows[:1] for name, rows in self.truth.items()})
        sizes = {name: np.linalg.norm(before["momentum" if "momentum" in name else name]) for name in DRIFTS}
        moved = {name: np.linalg.norm(now[name] - before[name], axis=1) / sizes[name] for name in self.keeps}
        return {DRIFTS[name]: float(np.max(rows)) for name, rows in moved.items()}

    def conserved(self, motion: Motion) -> dict[str, Array]:
        """Return energy (n, 1), angular momentum (n, 3) and its vertical component (n, 1), both in a.

        About a pivot, the potential energy of the weight is included.
        """
        q, omega = motion["quaternion"], motion["omega_b"]
        h_b = arrays.angular_momentum(np.array(self.body.inertia), omega)
        h_a, energy = arrays.rotate(q, h_b), 0.5 * np.sum(omega * h_b, axis=-1, keepdims=True)
        if self.body.is_free == 0.0:
            energy = energy - (arrays.rotate(q, np.array(self.body.arm_b)) @ np.array(self.loads.force_a))[:, None]
        return {"energy": energy, "momentum": h_a, "vertical momentum": h_a[:, 2:]}

    def motion_of(self, rows: Array) -> Motion:
        """Return the judged quantities at the checkpoints from a solver's states at the start and at all outputs."""
        return self.at_checkpoints(rows[1:][self.checkpoints], self.states)

    @np.errstate(all="ignore")
    def at_checkpoints(self, rows: Iterable[Sequence[float] | Array], states: Iterable[str] = WHOLE) -> Motion:
        """Return the judged quantities from rows of named states at the checkpoints; quaternions need no length 1.

        What a row leaves out at its end keeps its value at the start.
        """
        z, kernels, places = self.buffer.copy(), self.general.kernels, [*map(self.place, states)]
        blocks, outputs = kernels.BLOCKS, tiered(kernels.outputs)
        found: dict[str, list[Array]] = {name: [] for name in self.names}
        for time, row in zip(np.cumsum(self.outputs_between) * self.interval, rows, strict=True):
            z[places[: len(row)]] = row
            if "series.time" in blocks:  # formulas may depend on it
                z[blocks["series.time"]] = self.scene.run.start + time, 0.0
            z[blocks["q"]] /= np.linalg.norm(z[blocks["q"]])
            outputs(z)
            for name in self.names:
                found[name].append(z[blocks[name]].copy())
        return {name: np.array(values) for name, values in found.items()}


def case_of(scene: Scene) -> Case:
    """Return the case of a scene, its run cut to `MAX_OUTPUTS` steps, or to what the reference follows in some seconds.

    A last communication step that is shorter than the others is left out. Raises SceneError if one step is too much.
    """
    if scene.body is not None:
        Question(scene).start.check()
    steps = scene.run.count
    whole = steps * scene.run.step <= (scene.run.stop - scene.run.start) * (1.0 + 1e-9)
    outputs = min(max(steps if whole else steps - 1, 1), MAX_OUTPUTS)
    while True:
        part = scene if outputs == steps else scene.replace({"run.stop": scene.run.start + outputs * scene.run.step})
        case = Case(part, outputs, POINTS)
        try:
            _ = case.truth  # computed here and kept, or refused as too long
            return case
        except reference.ReferenceTooLongError:
            if outputs == 1:
                expected = "expected a step over which the true motion can be followed in some seconds"
                raise SceneError(f"run.step = {scene.run.step!r}: {expected}; no chart without", scene.name) from None
            outputs = max(outputs // 4, 1)


# The eight motions


def _known_motion(case: Case) -> Motion:
    """Return the true attitude, rates and position of o for one of the eight motions, at its start and checkpoints."""
    motion, body = json.loads(REFERENCES.read_text(encoding="utf-8"))["motions"][case.key], case.question.body
    q, omega_b, r_c = (np.array(motion[name], dtype=float) for name in ("quaternion", "omega_b", "r_c"))
    after = {"quaternion": q, "omega_b": omega_b, "position": r_c - arrays.rotate(q, np.array(body.r_oc_b))}
    return {name: np.vstack((getattr(case.scene.initial, name), rows)) for name, rows in after.items()}


def _known_case(key: str, tables: dict[str, Any]) -> Case:
    """Return one of the eight motions; without quantities in its tables, attitude and rates are asked for."""
    keeps, stop = tuple(tables.pop("keeps", ())), tables["run"]["stop"]
    asked = {"outputs": {"quantities": ["quaternion", "omega_b"]}, "run": {"stop": stop, "step": stop / CHECKPOINTS}}
    return Case(Scene.from_dict(asked | tables | {"run": asked["run"]}, key), key=key, keeps=keeps, accuracies=_PLANNED)


_PLANNED = (1e-3, 1e-6, 1e-9, 1e-12)
CASES = {key: _known_case(key, tables) for key, tables in studies.tables_of("chart/motions.toml").items()}
"""The eight motions by key."""


def few_and_many(keys: Sequence[str] = tuple(CASES)) -> list[Case]:
    """Return each motion with few and with many outputs; the long motion, which would have millions, with few only."""
    found = [case for key in keys for case in (CASES[key], CASES[key].with_many_outputs())]
    return [case for case in found if case.outputs <= MAX_OUTPUTS]
