"""The model of a scene whose motion is varied: beside its states, their errors by numbers of the start and the body.

Any scene of a body has a graph, with formulas or without: what its loads are, closed form or not, is in the same
equations of motion. Errors are those of `linearization.linearize`: of the attitude a rotation vector u in b, with
q_ab = q_ab(t) exp(u / 2), of all other states their own.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rbfmu.formulas.dual import jacobian, variables
from rbfmu.formulas.graph import Number, Symbol, changes_of
from rbfmu.formulas.motion import CONSTANT, STATE, by_element
from rbfmu.formulas.program import WIDTH, Program
from rbfmu.models.formulas import FormulaModel, texts_of
from rbfmu.models.model_buffer import BLOCKS, SIZE
from rbfmu.scene.scene import Scene
from rbfmu.types import Array
from rbfmu_kernels.body.memory import inertia_of
from rbfmu_kernels.compile.tiered import interpreted
from rbfmu_kernels.mechanics.inertia import INERTIA_TOLERANCE, parallel_axis
from rbfmu_kernels.quantities import elements
from rbfmu_kernels.rotations.quaternion import compose_quaternions, rotate
from rbfmu_kernels.rotations.vec3 import cross, skew

Key = TypeVar("Key", int, str)
TURN = elements("rotvec_b", 3)
ROWS_MEET, APART = 64, 8
"""Rows that are 64 numbers apart, or a multiple, share places of a cache, which has room for few of a column.

They are as long as a multiple and 8 numbers, a line of the cache, so that each begins in another place than the last.
"""


class Column(NamedTuple):
    """A number by which a motion is varied: its name, the block that has it, and its place in this."""

    name: str
    block: str
    at: int


class Variation(NamedTuple):
    """What a small change of each column makes of the numbers that a motion begins with and hangs on, (n columns,)."""

    start: Mapping[str, Array]
    seeds: Mapping[str, Array]


def variation_of(scene: Scene, columns: Sequence[Column], z: Array) -> Variation:
    """Return what columns make of the start of all errors, by their names, and of the places of the graph.

    z: the numbers of the body's blocks, once the body is set.
    """
    count, numbers = len(columns), z[:SIZE].tolist()
    turned: list[Any] = [0.0, 0.0, 0.0]
    own: dict[str, Any] = {}
    for n, column in enumerate(columns):
        one = variables((0.0,), n, count)[0]
        if column.block == "rotvec_b":
            turned[column.at] = one
        elif column.block in BLOCKS:
            numbers[BLOCKS[column.block].start + column.at] += one
        else:
            own[elements(column.block, scene.own_parameters[column.block].size)[column.at]] = one.gradient
    body = {name: tuple(numbers[block]) for name, block in BLOCKS.items()}
    q = interpreted(compose_quaternions)(body["q"], (1.0, *(0.5 * u for u in turned)))
    mass, arm, omega, pivot = body["mass"][0], body["r_oc_b"], body["omega_b_0"], bool(numbers[BLOCKS["pivot"].start])
    M = interpreted(inertia_of)(numbers)
    M = interpreted(parallel_axis)(M, mass, arm) if pivot else M
    values = [float(getattr(x, "value", x)) for x in np.ravel(np.array(M, object))]
    inverse = np.linalg.pinv(np.reshape(values, (3, 3)), rcond=INERTIA_TOLERANCE)
    by_M = jacobian([x for row in M for x in row], count)
    lever = interpreted(rotate)(q, interpreted(cross)(omega, arm))
    moved = [x + dx for x, dx in zip(body["position_0"], interpreted(rotate)(q, arm), strict=True)]
    start = {"rotvec_b": turned, "omega": omega, "r_c": moved}
    start["v_c"] = [x + dx for x, dx in zip(body["velocity_0"], lever, strict=True)]
    derived = {
        "M": by_M,
        "M_inverse": -np.einsum("ij,jkn,kl->iln", inverse, by_M.reshape(3, 3, count), inverse).reshape(9, count),
        "inverse_mass": jacobian([0.0 if pivot else 1.0 / mass], count),
        "arm": jacobian(arm if pivot else [-1.0 * x for x in arm], count),
    }
    given = {name: jacobian(row, count) for name, row in body.items() if name not in derived}
    rows = {name: jacobian(x, count) for name, x in start.items()}
    return Variation(
        dict(by_row(rows)) | {n: x for n, x in own.items() if n.startswith(STATE)},
        {element: row for element, row in by_row(given | derived) if row.any()}
        | {n: x for n, x in own.items() if n.startswith(CONSTANT)},
    )


def by_row(values: Mapping[str, Array]) -> list[tuple[str, Array]]:
    """Return the rows of matrices, by their elements' names."""
    return [one for name, rows in values.items() for one in zip(elements(name, len(rows)), rows, strict=True)]


Slopes = dict[int, Number]
"""The derivatives of a number, by the row of errors, or -1 - column; those that are zero are left out."""


class VariedModel(FormulaModel):
    """The model of a motion and its errors."""

    def __init__(self, scene: Scene, columns: Sequence[Column], seeded: Mapping[str, Sequence[int]]) -> None:
        """seeded: by the names of places, in which columns they vary."""
        super().__init__(*texts_of(scene, (name.partition("[")[0] for name in seeded)))
        motion = self.motion
        graph, plain = motion.graph, [name for name in self.rates if name != "t" and not name.startswith("q[")]
        self.columns = -(-len(columns) // WIDTH) * WIDTH
        self.errors = (*(TURN if "q[1]" in self.rates else ()), *plain)
        q = [graph.leaf("state", name) for name in elements("q", 4)] if "q[1]" in self.rates else []
        turns = [*motion.turns()] if q else []
        known = {str(x.value) for x in graph.operations if x.kind == "place"}
        self.seeded = [(name, d) for name, row in seeded.items() for d in row if name in known]
        self._changes_of_leaves: dict[int, dict[Symbol, Number]] = {
            **{i: dict(zip(q, turn, strict=True)) for i, turn in enumerate(turns)},
            **{i: {graph.leaf("state", name): 1.0} for i, name in enumerate(plain, len(turns))},
            **{-1 - d: {} for d in range(len(columns))},
        }
        for one, (name, d) in zip(elements("seeds", len(self.seeded)), self.seeded, strict=True):
            self._changes_of_leaves[-1 - d][graph.leaf("place", name)] = graph.leaf("place", one)
        rows = self._slopes_of({i: self.rates[name] for i, name in enumerate(self.errors) if name not in TURN})
        rows |= {i: self._turning(i) for i in range(len(turns))}
        sides = {len(self.errors) + n: i for n, i in enumerate(self.program.sides) if self._event_of_side[n] < 0}
        rows |= self._slopes_of({n: Symbol(graph, graph.operations[i].of[0]) for n, i in sides.items()})
        self.shown_slopes = self._slopes_of(dict(by_element(self.shown)))
        self._finish(rows)

    def _finish(self, rows: Mapping[int, Slopes]) -> None:
        """Make the program again, with the series of the rows' slopes beside and those of outputs as values."""
        beside: dict[Number, int] = {}
        self.pattern: list[float] = []
        for of, i, x in sorted((of, i, x) for i, slopes in rows.items() for of, x in slopes.items()):
            constant = not isinstance(x, Symbol) or x.is_constant
            self.pattern += [i, of, beside.setdefault(x, len(beside)), float(constant)]
        values = {x: None for slopes in self.shown_slopes.values() for x in slopes.values()}
        if any(event.stop for event in self.scene.events.values()):
            values |= {x: None for _, x in by_element(self.rates_shown)}
        self.wanted = {x: n for n, x in enumerate(values)}
        wanted = {**self.program.wanted, **dict(zip(elements("slopes", len(values)), values, strict=True))}
        watched = [Symbol(self.motion.graph, i) for i in self._sides]
        self.program = Program(self.motion.graph, self.rates, wanted, watched, tuple(beside))
        row = self.program.row + len(self.errors) * self.columns  # room for the series of errors, which templates make
        self.program.row = row + (APART - row) % ROWS_MEET

    def _turning(self, i: int) -> Slopes:
        """Return the slopes of a rate of the rotation vector: u' = the error of omega_b - omega_b x u."""
        carried = interpreted(skew)(tuple(self.motion.omega))[i]
        slopes: Slopes = {n: -carried[n] for n in range(3) if isinstance(carried[n], Symbol) or carried[n] != 0.0}
        return slopes | {self.errors.index(f"omega[{i + 1}]"): 1.0}

    def _slopes_of(self, numbers: Mapping[Key, Number]) -> dict[Key, Slopes]:
        """Return the slopes of numbers, error by error: where all turns with q, products of q serve over and over."""
        found: dict[Key, Slopes] = {key: {} for key in numbers}
        for of, leaves in self._changes_of_leaves.items():
            for key, slope in zip(numbers, changes_of([*numbers.values()], leaves), strict=True):
                if isinstance(slope, Symbol) or slope != 0.0:
                    found[key][of] = slope
        return found

    @cached_property
    def rates_shown(self) -> dict[str, list[Number]]:
        """Return the time derivatives of what is shown, by its name; of an attitude its rate in b."""
        leaves = {self.motion.graph.leaf("state", name): rate for name, rate in self.rates.items()}
        found = {name: changes_of([*np.ravel(value)], leaves) for name, value in self.shown.items()}
        return found | ({"quaternion": [*self.motion.omega]} if "quaternion" in found else {})

    def rates_at(self, name: str, values: Array) -> Array:
        """Return the time derivatives of what is shown; values: those of the block "slopes", (n,)."""
        return np.array([values[self.wanted[x]] for x in self.rates_shown[name]])

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
            "NUMBER_OF_ERRORS": len(self.errors), "COLUMNS": self.columns, "ENTRIES": len(self.pattern) // 4,
            "STATE_OF": tuple(-1 if n in TURN else states.index(n) for n in self.errors) or (-1,),
            "GROUPS": tuple((of.index(n), of.index(n) + of.count(n)) for n in dict.fromkeys(of)) or ((0, 0),),
            "OF_ENTRIES": rows + self.program.beside_at, "OF_ERRORS": rows + self.program.row - size,
            **{n.upper(): blocks[n].start for n in ("errors", "pattern", "shifts", "rates_before", "bounded")},
        }  # fmt: skip

    def numbers(self, variation: Variation) -> dict[str, list[float]]:
        """Return what the buffer's blocks of errors begin with."""
        errors = np.zeros((len(self.errors), self.columns))
        for i, name in enumerate(self.errors):
            row = variation.start.get(name, ())
            errors[i, : len(row)] = row
        zero = np.zeros(self.columns)
        seeds = [float(variation.seeds.get(name, zero)[d]) for name, d in self.seeded]
        return {"errors": errors.ravel().tolist(), "seeds": seeds, "pattern": self.pattern}

    def slopes_at(self, name: str, errors: Array, values: Array, columns: int) -> Array:
        """Return the derivatives of what is shown, (times, numbers, columns).

        errors: (times, rows, columns); values: those of the block "slopes", (times, n).
        """
        found = []
        for element in elements(name, int(np.size(self.shown[name]))):
            total = np.zeros((len(errors), columns))
            for of, x in self.shown_slopes[element].items():
                slope = values[:, self.wanted[x]]
                if of < 0:
                    total[:, -1 - of] += slope
                else:
                    total += slope[:, None] * errors[:, of, :columns]
            found.append(total)
        return np.stack(found, axis=1)
