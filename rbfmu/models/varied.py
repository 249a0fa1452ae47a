"""The model of a varied motion: its states, and their errors (derivatives) by numbers of the start and the body.

Any scene of a body has a graph, with formulas or without, as all loads are part of the same equations of motion. Errors
are defined as in `linearization.linearize`: that of the attitude is a rotation vector u in b, with
q_ab = q_ab(t) exp(u / 2); those of all other states are their changes.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rbfmu.formulas.graph import Number, Symbol, changes_of, numbers_of
from rbfmu.formulas.motion import CHANGE, MADE, Start, by_element, inertia_of, skew
from rbfmu.formulas.program import Program, whole_vectors
from rbfmu.models import formulas, model_buffer
from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE
from rbfmu_kernels.quantities import elements

Key = TypeVar("Key", int, str)
TURN = elements("rotvec_b", 3)
ROWS_MEET, APART = 64, 8
"""Rows whose distance is a multiple of 64 numbers share places of a cache, which can hold only few of them.

Their length is therefore a multiple of 64 plus 8 numbers, a line of the cache, so that each begins at another place.
"""


class Column(NamedTuple):
    """A number by which a motion is varied: its names in the scene and on the graph, and its place in its block."""

    name: str
    element: str
    at: int

    @property
    def block(self) -> str:
        """The block that contains it; an attitude's is in no buffer."""
        return self.element.partition("[")[0]


class VariedStart:
    """The errors at the start, and the changes of places of the graph, by a small change of each column."""

    def __init__(self, scene: Scene, columns: Sequence[Column]) -> None:
        names = [column.element for column in columns]
        motion = formulas.texts_of(scene, (*MADE, *names)).motion
        start = Start(motion.graph, names)
        turned = np.array(start.change_of(start.leaves("rotvec_b", 3)), object)
        start.set(motion.q, turned @ np.array([*motion.turns()], object))
        start.begin(motion)
        self._graph, self._changes = motion.graph, {repr(leaf): dx for leaf, dx in start.changes.items()}
        self._inertia = [*np.ravel(inertia_of(motion, about_o=motion.given.pivot))]
        units = np.eye(len(names), whole_vectors(len(names)))
        self._by_column = {f"{CHANGE}{x}": row for x, row in zip(names, units, strict=True)}

    def at(self, z: Array) -> dict[str, Array]:
        """Return rows of changes by name, one for each column, then zeros up to whole vectors; without zero rows.

        z: the numbers of the body's blocks.
        """
        known = dict(by_element({name: z[block] for name, block in model_buffer.BLOCKS.items()})) | self._by_column
        M = np.reshape(numbers_of(self._graph, self._inertia, known), (3, 3))
        known |= by_element({"M_inverse": np.linalg.pinv(M, rcond=INERTIA_TOLERANCE)})  # z need not have it
        rows = numbers_of(self._graph, [*self._changes.values()], known)
        return {name: row for name, row in zip(self._changes, rows, strict=True) if np.any(row)}


def _perturbed_numbers(scene: Scene, columns: Sequence[Column]) -> Array:
    """Return the body's numbers, slightly changed in each column: rows that are zero for these are always zero."""
    z = model_buffer.BodyAtStart(scene).z.copy()
    for n, column in enumerate(columns):
        if column.block in model_buffer.BLOCKS:
            at = model_buffer.BLOCKS[column.block].start + column.at
            z[at] += 1e-3 * np.sqrt(n + 2.0) * (abs(z[at]) or 1.0)
    return z


Slopes = dict[int, Number]
"""The derivatives of a number, by row of errors or by -1 - column; zeros are left out."""


class VariedModel(formulas.FormulaModel):
    """The model of a motion and its errors by columns."""

    def __init__(self, scene: Scene, columns: Sequence[Column]) -> None:
        self._start = VariedStart(scene, columns)
        varied = self._start.at(_perturbed_numbers(scene, columns))
        super().__init__(formulas.texts_of(scene, varied))
        motion = self.motion
        graph, plain = motion.graph, [name for name in self.rates if name != "t" and not name.startswith("q[")]
        self.columns = whole_vectors(len(columns))
        self.errors = (*(TURN if "q[1]" in self.rates else ()), *plain)
        q = [graph.leaf("state", name) for name in elements("q", 4)] if "q[1]" in self.rates else []
        turns = [*motion.turns()] if q else []
        known = {str(x.value) for x in graph.operations if x.kind == "place"}
        self.seeded = [(name, d) for name, row in varied.items() for d in np.flatnonzero(row).tolist() if name in known]
        self._changes_of_leaves: dict[int, dict[Symbol, Number]] = {
            **{i: dict(zip(q, turn, strict=True)) for i, turn in enumerate(turns)},
            **{i: {graph.leaf("state", name): 1.0} for i, name in enumerate(plain, len(turns))},
            **{-1 - d: {} for d in range(len(columns))},
        }
        for seed, (name, d) in zip(elements("seeds", len(self.seeded)), self.seeded, strict=True):
            self._changes_of_leaves[-1 - d][graph.leaf("place", name)] = graph.leaf("place", seed)
        rows = self._slopes_of({i: self.rates[name] for i, name in enumerate(self.errors) if name not in TURN})
        rows |= {i: self._slopes_of_turn(i) for i in range(len(turns))}
        sides = {len(self.errors) + n: i for n, i in enumerate(self.program.sides) if self._event_of_side[n] < 0}
        rows |= self._slopes_of({n: Symbol(graph, graph.operations[i].of[0]) for n, i in sides.items()})
        self.shown_slopes = self._slopes_of(dict(by_element(self.shown)))
        self._finish(rows)

    def _finish(self, rows: Mapping[int, Slopes]) -> None:
        """Make the program again, with series of the rows' slopes, and with values of the outputs' slopes."""
        beside: dict[Number, int] = {}
        self.pattern: list[float] = []
        for of, i, x in sorted((of, i, x) for i, slopes in rows.items() for of, x in slopes.items()):
            constant = not isinstance(x, Symbol) or x.is_constant
            self.pattern += [i, of, beside.setdefault(x, len(beside)), float(constant)]
        values = {x: None for slopes in self.shown_slopes.values() for x in slopes.values()}
        if any(event.stop for event in self.scene.events.values()):
            more = (self.shown, self.rates_shown, *self.shown_by_inputs.values())
            values |= {x: None for named in more for _, x in by_element(named)}
        self.wanted = {x: n for n, x in enumerate(values)}
        wanted = {**self.program.wanted, **dict(zip(elements("slopes", len(values)), values, strict=True))}
        watched = [Symbol(self.motion.graph, i) for i in self._sides]
        self.program = Program(self.motion.graph, self.rates, wanted, watched, tuple(beside))
        row = self.program.row + len(self.errors) * self.columns  # with room for errors, a template's series
        self.program.row = row + (APART - row) % ROWS_MEET

    def _slopes_of_turn(self, i: int) -> Slopes:
        """Return the slopes of a rate of the rotation vector: u' = the error of omega_b - omega_b x u."""
        carried = {n: -x for n, x in enumerate(skew(self.motion.omega)[i]) if x != 0.0}
        return {**carried, self.errors.index(f"omega[{i + 1}]"): 1.0}

    def _slopes_of(self, numbers: Mapping[Key, Number]) -> dict[Key, Slopes]:
        """Return the slopes of numbers, error by error: then products of q, which occur in all, are made once."""
        found: dict[Key, Slopes] = {key: {} for key in numbers}
        for of, leaves in self._changes_of_leaves.items():
            for key, slope in zip(numbers, changes_of([*numbers.values()], leaves), strict=True):
                if slope != 0.0:
                    found[key][of] = slope
        return found

    @cached_property
    def rates_shown(self) -> dict[str, list[Number]]:
        """Return the time derivatives of shown quantities, by name; of the attitude its rate in b, rad/s."""
        leaves = {self.motion.graph.leaf("state", name): rate for name, rate in self.rates.items()}
        found = {name: changes_of([*np.ravel(value)], leaves) for name, value in self.shown.items()}
        return found | ({"quaternion": [*self.motion.omega]} if "quaternion" in found else {})

    @cached_property
    def shown_by_inputs(self) -> dict[str, dict[str, list[Number]]]:
        """Return the derivatives of shown quantities by each input: input -> quantity; the attitude has none."""
        names = [element for port, size in self.given.ports.items() for element in elements(port, size)]
        shown = {name: [*np.ravel(value)] for name, value in self.shown.items() if name != "quaternion"}
        leaves = {name: {self.motion.graph.leaf("input", name): 1.0} for name in names}
        return {name: {of: changes_of(value, leaves[name]) for of, value in shown.items()} for name in names}

    def rates_at(self, name: str, values: Array, inputs: Mapping[str, float]) -> Array:
        """Return the time derivatives of a shown quantity.

        values (n,): of the block "slopes"; inputs: rates of inputs, by the names of their elements.
        """
        total = np.array([values[self.wanted[x]] for x in self.rates_shown[name]])
        for element, rate in inputs.items():
            if name in self.shown_by_inputs[element]:
                total += rate * np.array([values[self.wanted[x]] for x in self.shown_by_inputs[element][name]])
        return total

    @property
    def more_blocks(self) -> dict[str, int]:
        """Return the sizes of the blocks of errors."""
        size = len(self.errors) * self.columns
        blocks = {"errors": size, "seeds": len(self.seeded), "slopes": len(self.wanted), "pattern": len(self.pattern)}
        return blocks | {"shifts": self.columns, "rates_before": len(self.errors), "bounded": 1}

    @property
    def _places(self) -> dict[str, Any]:
        blocks, rows = self.blocks.blocks, self.blocks.blocks["series.work"].start + self.program.start
        size, states = len(self.errors) * self.columns, [*self.rates]
        of = [name.partition("[")[0] for name in self.errors]
        return super()._places | {
            "NUMBER_OF_ERRORS": len(self.errors), "COLUMNS": self.columns, "NUMBER_OF_SLOPES": len(self.pattern) // 4,
            "STATE_OF": tuple(-1 if n in TURN else states.index(n) for n in self.errors) or (-1,),
            "GROUPS": tuple((of.index(n), of.index(n) + of.count(n)) for n in dict.fromkeys(of)) or ((0, 0),),
            "OF_SLOPES": rows + self.program.beside_at, "OF_ERRORS": rows + self.program.row - size,
            **{n.upper(): blocks[n].start for n in ("errors", "pattern", "shifts", "rates_before", "bounded")},
        }  # fmt: skip

    def numbers(self, z: Array) -> dict[str, list[float]]:
        """Return the first numbers of the buffer's blocks of errors; z: the buffer, with the body's numbers."""
        varied, zero = self._start.at(z), np.zeros(self.columns)
        errors = np.ravel([varied.get(name, zero) for name in self.errors])
        seeds = [float(varied.get(name, zero)[d]) for name, d in self.seeded]
        return {"errors": errors.tolist(), "seeds": seeds, "pattern": self.pattern}

    def slopes_at(self, name: str, errors: Array, values: Array, columns: int) -> Array:
        """Return the derivatives of a shown quantity (times, numbers, columns).

        errors (times, rows, columns): of the states; values (times, n): of the block "slopes".
        """
        changes = [*np.moveaxis(errors[:, :, :columns], 1, 0), *np.eye(columns)[::-1]]  # as `Slopes` counts them
        found = []
        for element in elements(name, int(np.size(self.shown[name]))):
            total = np.zeros((len(errors), columns))
            for of, x in self.shown_slopes[element].items():
                total += values[:, self.wanted[x], None] * changes[of]
            found.append(total)
        return np.stack(found, axis=1)
