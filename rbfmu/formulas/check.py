"""All formulas of a scene: their graph, and messages for what is wrong with them, with a caret."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from rbfmu.formulas.functions import CONSTANTS, FUNCTIONS, Array, Table, shape_of
from rbfmu.formulas.graph import Symbol
from rbfmu.formulas.motion import CONSTANT, LOADS, STATE, Given, Motion, by_element
from rbfmu.formulas.text import FormulaError, names_in
from rbfmu_kernels.body import driven, memory
from rbfmu_kernels.quantities import BY_NAME, OUTPUT

ENERGIES = ("potential_energy", "total_energy")
TAKEN = (
    "order", "time", "status", "step", "save", "restore", "reset", "hold", "values", "plot", "scene", "plan", "events",
)  # fmt: skip
"""Names that results, simulators or FMUs have."""
ATTRIBUTES = (
    "buffer", "columns", "load", "of_rows", "quantities", "rows", "step_to_event",
    "to_dataframe", "to_xarray", "touches", "units", "until",
)  # fmt: skip
"""More names that results and simulators have, so that no output can have them."""


class Texts:
    """The values of a scene's formulas on a graph; faults: messages with keys.

    A formula that is wrong has None as its value. unread: whether some own outputs could not be read, so that an event
    may name one that is unknown here.
    """

    def __init__(self, scene: Any, given: Given, unread: bool = False) -> None:
        self.motion = Motion(given)
        self.faults: list[str] = []
        self._wrong: set[str] = set()  # names that are at fault: a formula that reads one gets no message
        self.scene = scene
        self._check_names(scene)
        for name, row in scene.tables.items():
            self.motion.names[name] = Table.through(row.x, row.y, row.method == "cubic")
        self._read_formulas(scene.formulas)
        texts = {name: text for name, text in scene.loads.formulas.items() if name != "potential"}
        self.loads = {name: self._value_of(f"loads.{name}", text, (3,)) for name, text in texts.items()}
        self._take_potential(scene.loads.formulas.get("potential"))
        self.states = {
            name: self._value_of(f"states.{name}.rate", row.rate, () if len(row.start) == 1 else (3,))
            for name, row in scene.states.items()
        }
        read = {name for row in scene.events.values() for name in names_in(row.when)}  # their outputs come first
        self.own = self._own_values(scene.outputs.own, lambda name: name in read)
        self.motion.names |= self.own
        self._wrong |= {name for name, value in self.own.items() if value is None}
        if unread:
            self._wrong |= read - {*self.motion.names, *self.motion.functions, *CONSTANTS}
        self.events = {name: self._event_value(f"events.{name}.when", row.when) for name, row in scene.events.items()}
        self.own |= self._own_values(scene.outputs.own, lambda name: name not in read)
        self.own = {name: self.own[name] for name in scene.outputs.own}

    @property
    def rates(self) -> dict[str, Any]:
        """Return the rates of the body's states and of the scene's own states, by their elements' names."""
        own = {f"{STATE}{name}": rate for name, rate in self.states.items()}
        return {**self.motion.rates(self.loads), **dict(by_element(own))}

    @property
    def loads_by_key(self) -> dict[str, Any]:
        """Return the loads by the names of their keys; those that only the potential makes have its key."""
        given = {name: load for name, load in self.loads.items() if name in self.scene.loads.formulas}
        return given | {"potential": [load for name, load in self.loads.items() if name not in given]}

    def _own_values(self, own: Mapping[str, Any], which: Callable[[str], bool]) -> dict[str, Any]:
        """Return the values of some own outputs, by name."""
        return {name: self._value_of(f"outputs.{name}.value", own[name].value, None) for name in own if which(name)}

    def _event_value(self, key: str, text: str) -> Any:
        """Return the value of a scalar formula that depends on the motion, the time or an input, not only by jumps."""
        found = self._value_of(key, text, ())
        if found is None or self.motion.graph.reached_of(("state", "input"), [found], "side"):
            return found
        jumps = ", not by jumps alone" if isinstance(found, Symbol) and not found.is_constant else ""
        changing = f"a formula that changes with the motion, the time or an input{jumps}"
        self.faults.append(f"{key}: expected {changing}: {text}")
        return None

    def _take_potential(self, text: str | None) -> None:
        """Add the force and the torque of a potential to the loads, and energies to the names that outputs can read."""
        potential: Any = None if text is None else self._value_of("loads.potential", text, ())
        if potential is not None and not self._reads_place_alone(potential):
            self.faults.append(f"loads.potential: expected a formula of position and attitude: {text}")
        elif potential is not None:
            for name, force in self.motion.forces_of(potential).items():
                known = self.loads.get(name)
                self.loads[name] = force + (np.array(getattr(self.scene.loads, name)) if known is None else known)
        if asked := [name for name in ENERGIES if name in self.scene.outputs.own]:
            self.faults += self._faults_without_potential(asked[0])
        rates = self.motion.rates({name: load for name, load in self.loads.items() if load is not None})
        kinetic = self.motion.outputs(rates)["kinetic_energy"][0]
        # with a potential the buffer's force_a is the sum of both; a load that is not given is a scalar zero here
        force_a = None if potential is None else np.zeros(3) + np.array(self.scene.loads.force_a)
        energy = self.motion.potential_energy(0.0 if potential is None else potential, force_a)
        self.motion.names |= {"kinetic_energy": kinetic, "potential_energy": energy, "total_energy": kinetic + energy}

    def _faults_without_potential(self, asked: str) -> Iterator[str]:
        """Yield a message if loads act that have no potential; asked: the energy that an output shows."""
        loads, inputs = self.scene.loads, self.scene.inputs
        acting = [name for name in ("force_b", "torque_a", "torque_b") if any(getattr(loads, name))]
        acting += [*(name for name in loads.formulas if name != "potential"), *inputs.ports]
        acting += ["damping_b"] if any(loads.damping_b) else []
        if acting:
            yield f"outputs.quantities: expected no {asked}: {acting[0]} has no potential"

    def _reads_place_alone(self, potential: Any) -> bool:
        """Return whether a potential depends only on the path and the attitude."""
        changing = self.motion.graph.reached_of(("state", "input"), [potential])
        return {str(x.value).partition("[")[0] for x in changing} <= {"q", "r_c"}

    def _check_names(self, scene: Any) -> None:
        taken = {*self.motion.given_names, *FUNCTIONS, *CONSTANTS, "to_a", "to_b", *OUTPUT, *ENERGIES, *TAKEN, *LOADS}
        blocks = {*driven.DRIVEN, *(f"{name}{end}" for name in scene.inputs.own for end in ("_rate", "_rate_2"))}
        beside = {
            "inputs.ports": blocks,
            "outputs": {*blocks, *ATTRIBUTES},
            "constants": {*BY_NAME},
            "states": {*BY_NAME},
        }
        tables = {name: getattr(scene, name) for name in ("constants", "tables", "formulas", "states", "events")}
        tables |= {"outputs": scene.outputs.own, "inputs.ports": scene.inputs.own}
        seen: dict[str, str] = {}
        for table, names in tables.items():
            for name in names:
                known = len(self.faults)
                is_energy = table == "outputs" and name in ENERGIES and names[name].value == name
                if table == "inputs.ports" and name == "h":
                    self.faults.append("inputs.ports.h: expected another name: h is a simulator's step")
                elif table == "outputs" and name.startswith("_"):  # it could be an attribute of a simulator
                    message = "expected another name, without _ in front: results have such names themselves"
                    self.faults.append(f"outputs.{name}: {message}")
                elif not is_energy and (name in taken or name in beside.get(table, ())):
                    self.faults.append(f"{table}.{name}: expected another name: {name} means something else here")
                elif name in seen:
                    self.faults.append(f"{table}.{name}: expected another name: there is {seen[name]}.{name}")
                self._wrong |= {name} if len(self.faults) > known else set()
                seen.setdefault(name, table)
        made = {f"{name}_{what}": f"an FMU's of events.{name}" for name in scene.events for what in ("count", "time")}
        made |= {f"{name}_0": f"the start of states.{name}" for name in scene.states}
        for name, why in made.items():
            if name in seen:
                self.faults.append(f"{seen[name]}.{name}: expected another name: that is {why}")

    def _read_formulas(self, texts: Mapping[str, str]) -> None:
        """Evaluate formulas in an order in which each comes after those that it names."""
        left = dict(texts)
        while left:
            ready = [name for name, text in left.items() if not names_in(text) & {*left}]
            if not ready:
                circle = _circle({n: names_in(t) & {*left} for n, t in left.items()})
                self._wrong |= {*left}
                message = f"expected formulas without a circle, not {' -> '.join(circle)}"
                self.faults.append(f"formulas.{circle[0]}: {message}")
                return
            for name in ready:
                found = self._value_of(f"formulas.{name}", left.pop(name), None)
                self.motion.names[name] = found
                self._wrong |= {name} if found is None else set()

    def _value_of(self, key: str, text: str, shape: tuple[int, ...] | None) -> Array:
        """Return the value of a formula, with the shape asked for, if any; None if it is wrong, with a fault added."""
        if names_in(text) & self._wrong:
            return None
        try:
            found = self.motion.value(text)
            if shape is not None and shape_of(found) != shape:
                vector = "a vector of 3 numbers in one text, such as [0, 0, t]; texts of a list add up"
                raise FormulaError(text, 0, "a scalar" if shape == () else vector)
            if shape is None and not key.startswith("formulas") and shape_of(found) not in ((), (3,)):
                raise FormulaError(text, 0, "a scalar or a vector of 3 numbers")
        except FormulaError as error:
            own = sorted(names_in(text) & {*self.scene.outputs.own} - {*self.motion.names})
            hint = f"\n{own[0]} is an output: give its formula a name in [formulas], which both can read" if own else ""
            self.faults.append(f"{key}: {error}{hint}")
            return None
        return found


def _circle(reads: Mapping[str, set[str]]) -> list[str]:
    """Return a circle of names: each reads the next, and the last is the first again."""
    path = [next(iter(reads))]
    while path[-1] not in path[:-1]:
        path.append(sorted(reads[path[-1]])[0])
    return path[path.index(path[-1]) :]


def given_to(scene: Any, numbers: Mapping[str, Sequence[float]], varied: Iterable[str] = ()) -> Given:
    """Return the numbers of a scene that formulas can read.

    numbers: of the body's blocks of a buffer, by name; varied: elements whose blocks' zeros may become other numbers.
    """
    numbers = {**numbers, **{f"{CONSTANT}{name}": row.value for name, row in scene.constants.items()}}
    constants = {name: len(row.value) for name, row in scene.constants.items()}
    states = {name: len(row.start) for name, row in scene.states.items()}
    own = scene.inputs.own
    ports = {name: own[name].size if name in own else 3 for name in scene.inputs.ports}
    listed = (*scene.inputs.parameters, *(scene.ensemble.parameters if scene.ensemble else ()))
    blocks = (name.partition("[")[0] for name in varied)
    symbolic = frozenset({*(f"{CONSTANT}{name}" for name in constants), *blocks_of(listed), *blocks})
    return Given(numbers, symbolic, ports, states, constants, bool(scene.body and scene.body.pivot))


def blocks_of(parameters: Iterable[str]) -> Iterator[str]:
    """Yield the blocks whose zeros may become other numbers if parameters are listed."""
    for name in parameters:
        yield name
        yield f"constant_{name}"
        if name in ("inertia", "mass", "r_oc_b"):
            yield from ("M", "M_inverse")
        if name == "r_oc_b":
            yield "arm"


def unit_numbers() -> dict[str, list[float]]:
    """Return placeholder numbers for a body's blocks, for use where only names and shapes matter."""
    return {name: [1.0] * (block.stop - block.start) for name, block in memory.BLOCKS.items()}


@lru_cache(maxsize=32)
def faults_of_texts(scene: Any, unread: bool = False) -> tuple[str, ...]:
    """Return the faults of a scene's formulas; unread: as in `Texts`. Cached, as the graph takes milliseconds."""
    if "omega_b" in scene.inputs.ports:
        rows = {"loads": scene.loads.formulas, "outputs": scene.outputs.own}
        rows |= {name: getattr(scene, name) for name in ("formulas", "states", "tables", "events")}
        keys = [f"{table}.{name}" for table, found in rows.items() for name in found]
        why = "the port omega_b prescribes the rates, and nothing else is modelled"
        return tuple(f"{key}: expected no formulas, nor what they read: {why}" for key in keys)
    return tuple(Texts(scene, given_to(scene, unit_numbers()), unread).faults)
