"""The motion of a scene with formulas in double-double arithmetic: what its plans are judged by."""

from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal, localcontext
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rbfmu.formulas.graph import Symbol, cosine, sine
from rbfmu.formulas.motion import STATE, by_element, closure
from rbfmu.models.formulas import FormulaModel, formulas_of
from rbfmu.planning import reference as exact
from rbfmu.planning.reference import CHUNK, DIGITS, Motion, ReferenceTooLongError
from rbfmu.scene.scene import Scene, SceneError
from rbfmu_kernels.integrators import formula_reference as kernels

MOST_WORK = 20_000_000
"""Operations in all steps of a reference, each with its coefficients: some 20 s."""
Integers = NDArray[np.int64]


class Listed:
    """What is asked for, as a list of operations that `kernels.formula_motion` walks."""

    def __init__(self, formulas: FormulaModel) -> None:
        self.formulas, self.graph = formulas, formulas.motion.graph
        self.wanted = [self.graph.index_of(x) for _, x in by_element(formulas.shown)]
        symbols = [Symbol(self.graph, i) for i in self.wanted]
        self.states = closure(formulas.all_rates, symbols, self.graph)
        self.leaves = {name: self.graph.leaf("state", name).index for name in self.states}
        self.rates = {name: self.graph.index_of(formulas.all_rates[name]) for name in self.states}
        self.found = self._with_pairs([*self.wanted, *self.leaves.values(), *self.rates.values()])
        self._place = {i: n for n, i in enumerate(self.found)}

    def _with_pairs(self, ends: Sequence[int]) -> list[int]:
        """Return all operations that some come of, and of each sine the cosine: the recurrences need both."""
        symbols = [Symbol(self.graph, i) for i in ends]
        for i in self.graph.reached(symbols):
            operation = self.graph.operations[i]
            if operation.kind in ("sin", "cos"):
                angle = Symbol(self.graph, operation.of[0])
                symbols += [self.graph.symbol_of(f(angle)) for f in (sine, cosine)]
        return self.graph.reached(symbols)

    @cached_property
    def operations(self) -> Integers:
        """Return a row for each operation: its kind, and what it is of; of a sine the cosine is second."""
        rows = np.zeros((len(self.found), 4), np.int64)
        for n, i in enumerate(self.found):
            kind, of, _ = self.graph.operations[i]
            if kind in ("sin", "cos"):
                angle = Symbol(self.graph, of[0])
                of = (of[0], self.graph.index_of(cosine(angle) if kind == "sin" else sine(angle)))
            rows[n] = [kernels.KINDS.index(kind), *(self._place[j] for j in of), *[0] * (3 - len(of))]
        return rows

    @cached_property
    def states_with_rates(self) -> tuple[Integers, NDArray[np.float64]]:
        """Return a row for each state: its operation, that of its rate, its group; and the least size of each group."""
        groups = self.formulas.groups_of(self.states)
        group_of = {name: g for g, group in enumerate(groups) for name in group.states}
        rows = [(self._place[self.leaves[n]], self._place[self.rates[n]], group_of[n]) for n in self.states]
        least = [group.least if group.relative else -group.least for group in groups]
        return np.array(rows, np.int64).reshape(-1, 3), np.array(least)

    @property
    def sides(self) -> list[int]:
        """Return the operations that tell on which side of zero something is."""
        return [n for n, i in enumerate(self.found) if self.graph.operations[i].kind == "side"]

    @property
    def touching(self) -> Integers:
        """Return the operations that roots and angles of points may find at zero."""
        operations = (self.graph.operations[i] for i in self.found)
        return np.array([*{self._place[o.of[-1]] for o in operations if o.kind in ("sqrt", "atan2")}], np.int64)

    @property
    def places_of_wanted(self) -> Integers:
        """Return the operations that are asked for."""
        return np.array([self._place[i] for i in self.wanted], np.int64)

    def keys_at_fault(self, work: NDArray[np.float64], sides: NDArray[np.float64]) -> str:
        """Return what is wrong where a motion ends; work, sides: of `kernels.formula_motion` there."""
        finite = np.isfinite(work[0].reshape(-1, kernels.LENGTH)).all(axis=1)
        lost = [i for n, i in enumerate(self.found) if not finite[n] and self.graph.operations[i].kind != "state"]
        if lost:
            named = " or ".join(self.formulas.keys_of(lost[0])) or "the motion"
            return f"{named} is not finite"
        sliding = [int(n) for n, begun, _ in sides if begun == kernels.SLIDES]
        named = " or ".join(key for n in sliding for key in self.formulas.keys_of(self.found[n]))
        return f"{named or 'the motion'} slides along a corner of abs, min, max, clip, where or a table"

    def at_start(self, values: Mapping[str, Decimal]) -> list[Decimal]:
        """Return the numbers, and the values of parameters, states and inputs at the start."""
        rows = (self.graph.operations[i] for i in self.found)
        return [Decimal(x) if kind == "number" else values.get(str(x), Decimal(0)) for kind, _, x in rows]


def formula_motion(
    scene: Scene, steps: Sequence[float], most: int, progress: Callable[[float], Any] | None = None
) -> Motion:
    """Return all that is asked for at the start and after each step (s), as `reference_motion` does.

    Ports are as at first.
    """
    formulas = formulas_of(scene)
    assert formulas is not None
    listed = Listed(formulas)
    most = min(most, MOST_WORK // len(listed.found))
    sides = np.array([[n, 0.0, 0.0] for n in listed.sides]).reshape(-1, 3)
    (states, least), wanted = listed.states_with_rates, listed.places_of_wanted
    with localcontext() as context:
        context.prec = DIGITS
        here = exact.pairs_of(listed.at_start(_exact_values(formulas, scene)))
        times = exact.pairs_of(accumulate(map(Decimal, steps), initial=Decimal(0)))
    work, sizes = np.zeros((2, len(listed.found) * kernels.LENGTH)), np.zeros(len(least))
    rows = np.full((times.shape[1], len(wanted)), np.nan)
    for first in range(0, times.shape[1], CHUNK):
        chunk = slice(max(first - 1, 0), first + CHUNK)
        taken = kernels.formula_motion(
            listed.operations,
            states,
            least,
            sides,
            listed.touching,
            wanted,
            times[:, chunk],
            rows[chunk],
            most,
            work,
            here,
            sizes,
        )
        if taken == kernels.NOWHERE:
            raise _leads_nowhere(scene, steps, rows, listed.keys_at_fault(work, sides))
        most -= taken
        if taken < 0 or most < 0 or not np.isfinite(rows[chunk]).all():
            raise ReferenceTooLongError(scene.name)
        if progress is not None:
            progress(min((first + CHUNK) / times.shape[1], 1.0))
    ends = np.cumsum([np.size(value) for value in formulas.shown.values()])[:-1]
    return dict(zip(formulas.shown, np.split(rows, ends, axis=1), strict=True))


def _leads_nowhere(scene: Scene, steps: Sequence[float], rows: NDArray[np.float64], said: str) -> SceneError:
    """Return the error for a motion that ends; rows: of its outputs, not finite from then on; said: what fails."""
    done = int(np.isfinite(rows).all(axis=1).sum()) - 1
    reached = scene.run.start + sum(steps[: max(done, 0)])
    return SceneError(
        f"run.stop = {scene.run.stop!r}: expected one before t = {reached:.6g} s, where {said}", scene.name
    )


def _exact_values(formulas: FormulaModel, scene: Scene) -> dict[str, Decimal]:
    """Return the values of places and, at the start, of states, by their elements' names."""
    assert scene.body is not None
    found, start = exact.exact_constants(scene), exact.exact_start(scene)
    q = exact.decimals_of(scene.initial.quaternion)
    given = {name: exact.decimals_of(values) for name, values in formulas.given.numbers.items()}
    own = {f"{STATE}{name}": exact.decimals_of(row.start) for name, row in scene.states.items()}
    own |= {name: exact.decimals_of(port.start) for name, port in scene.inputs.own.items()}
    body = {
        "M": found["M"], "M_inverse": found["M_inverse"], "arm": found["arm_b"],
        "inverse_mass": np.array([1 / Decimal(scene.body.mass)]), "q": q / (q @ q).sqrt(),
        "omega": start["omega_b"], "r_c": start["r_c"], "v_c": start["v_c"], "t": np.array([Decimal(scene.run.start)]),
    }  # fmt: skip
    return dict(by_element({**given, **own, **body}))
