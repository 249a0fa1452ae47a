"""A scene with formulas as a case: its states, and its formulas for solvers of others, made from the same graph."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from rbfmu.formulas.graph import KNOWN, numbers_of
from rbfmu.formulas.source import function_of
from rbfmu.models.formulas import FormulaModel, formulas_of
from rbfmu.planning.methods import whole_series
from rbfmu.runs.plan import start_run
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import Case
from rbfmu.types import Array, Motion
from rbfmu_kernels.compile.tiered import tiered


class FormulaCase(Case):
    """A scene whose loads, states or outputs are formulas; its time counts from the start of the run."""

    @cached_property
    def formulas(self) -> FormulaModel:
        """Return the model of the formulas."""
        found = formulas_of(self.asked)
        assert found is not None
        return found

    @property
    def blocks(self) -> Mapping[str, slice]:
        """Return the places of the quantities in the buffer of the formulas' model."""
        return self.formulas.blocks.blocks

    @cached_property
    def buffer(self) -> Array:
        """Return the buffer of the formulas' model at the start."""
        return start_run(self.asked, whole_series(self.asked, self.formulas.model.ORDERS[0], 1.0))

    @cached_property
    def names_of_states(self) -> list[str]:
        """Return the names of the numbers that solvers integrate."""
        return [name for name in self.formulas.rates if name != "t"]

    @property
    def numbers(self) -> int:
        """Return how many numbers solvers integrate."""
        return len(self.names_of_states)

    @property
    def places(self) -> list[int]:
        """Return where the buffer has them."""
        return [self.formulas.place(name) for name in self.names_of_states]

    @cached_property
    def rate(self) -> float:
        """Return the largest |omega| that is known, rad/s."""
        rates = self.truth.get("omega_b", np.array([self.scene.initial.omega_b]))
        return float(np.max(np.linalg.norm(rates, axis=1)))

    @property
    def has_corners(self) -> bool:
        """Return whether formulas have corners, or tables."""
        graph = self.formulas.motion.graph
        return any(graph.operations[i].kind == "side" for i in graph.reached(self.formulas.rates.values()))

    def motion_of(self, rows: Array) -> Motion:
        """Return what is judged from rows of states at the checkpoints."""
        z, blocks, model = self.buffer.copy(), self.blocks, self.formulas.model
        outputs, clock = tiered(model.outputs), self.formulas.place("time")
        found: dict[str, list[Array]] = {name: [] for name in self.names}
        for time, row in zip(np.cumsum(self.outputs_between) * self.interval, rows, strict=True):
            z[self.places], z[clock], z[clock + 1] = row, self.scene.run.start + time, 0.0
            z[blocks["q"]] /= np.linalg.norm(z[blocks["q"]])
            outputs(z)
            for name in self.names:
                found[name].append(z[blocks[name]].copy())
        return {name: np.array(values) for name, values in found.items()}

    # The formulas for others

    @property
    def _ends(self) -> list[Any]:
        return [self.formulas.rates[name] for name in self.names_of_states]

    def _leaves(self, states: Sequence[Any], time: Any) -> dict[str, Any]:
        """Return what stands for states and time, and the values of all that stays as it is at the start."""
        graph, z = self.formulas.motion.graph, self.buffer
        known = {str(row.value) for row in graph.operations if row.kind in ("place", "input")}
        values = {name: float(z[self.formulas.place(name)]) for name in known}
        return {**values, **dict(zip(self.names_of_states, states, strict=True)), "t": time}

    @cached_property
    def put_rates(self) -> Any:
        """Return a compiled function of t, f, y and z that puts the rates of the numbers y into f."""
        begin, names = self.scene.run.start, dict[str, Any]()
        leaves = self._leaves([f"y[{i}]" for i in range(self.numbers)], f"(t + {begin!r})" if begin else "t")
        exec(function_of("put_rates", self.formulas.motion.graph, self._ends, leaves), names)  # our own text
        return njit(error_model="numpy")(names["put_rates"])

    def in_heyoka(self, heyoka: Any) -> list[tuple[Any, Any]]:
        """Return (variable, rate) of the numbers that are integrated, as expressions of heyoka.py."""
        variables = [heyoka.make_vars(f"y{i}") for i in range(self.numbers)]
        leaves = self._leaves(variables, heyoka.time + self.scene.run.start)
        rates = numbers_of(self.formulas.motion.graph, self._ends, leaves, heyoka_functions(heyoka))
        return list(zip(variables, map(heyoka.expression, rates), strict=True))


def kind_of_case(scene: Scene) -> type[Case]:
    """Return the kind of case that a scene is."""
    return FormulaCase if scene.has_formulas else Case


def heyoka_functions(heyoka: Any) -> dict[str, Callable[..., Any]]:
    """Return the operations on expressions of heyoka.py; of numbers alone they are known."""
    theirs = {name: getattr(heyoka, name) for name in ("sqrt", "sin", "cos", "exp", "log")}
    theirs |= {"atan2": lambda y, x, _: heyoka.atan2(y, x), "power": lambda x, exponent: x**exponent}

    def chosen(kind: str) -> Callable[..., Any]:
        def operation(*of: Any) -> Any:
            return KNOWN[kind](*of) if all(isinstance(x, float) for x in of) else theirs[kind](*of)

        return operation

    return {**KNOWN, **{kind: chosen(kind) for kind in theirs}}
